"""What a station sends the others after each tick: its vehicles, and while it leads the whole formation."""

from collections.abc import Iterator, Sequence
from math import nan
from typing import Final, NamedTuple

import numpy as np

from gcs.control.inputs import Task, Tasks
from gcs.control.memory import Memory
from gcs.formation.law import turned
from gcs.model.jit import kernel
from gcs.model.lifecycle import ShowPhase
from gcs.model.state import Array, FleetState, Mask
from gcs.stations import reported_vehicles
from gcs.stations.messages import (
    BatchHead,
    Codes,
    FormationMessage,
    SlotsMessage,
    StateBatch,
    VelocitiesMessage,
)
from gcs.stations.site import Site

STATES, FORMATION, SLOTS, VELOCITIES = "states", "formation", "slots.", "velocities."
"""Topics; the name of a station follows the last two."""

SLOTS_AGAIN_S: Final = 1.0
"""Slots that have not moved are sent again after this time."""

MOVED: Final = 5e-4
"""A slot has moved if a coordinate of its unit vector has changed by more: by 5 cm on a sphere of 100 m."""


class Reported(NamedTuple):
    """What the own n vehicles report, and the station says, beside positions and setpoints."""

    phases: Codes  # (n,) places in PHASES
    modes: Codes  # (n,) places in MODES
    armed: Mask
    ready: Mask
    numbers: Sequence[Array]  # (n,) each, those of `vehicle_columns.SENT`
    show: ShowPhase = ShowPhase.RUNNING
    all_up: bool = True
    plan: int = 0  # version of the plan
    return_s: float = nan  # time in the plan of the collective return, NaN: none is flown


def batch(
    site: Site, fleet: FleetState, tasks: Tasks, uncertainty_m: Array, memory: Memory, reported: Reported
) -> StateBatch:
    """The batch of this tick.

    Args:
        site: of this station; its next number is used.
        fleet: the own n vehicles; of silent ones their last known positions and velocities.
        tasks: theirs.
        uncertainty_m: (n,) theirs.
        memory: after the tick, own rows first.
        reported: the rest.
    """
    n = len(fleet.ids)
    sequence, echoes = site.next_sequence(fleet.time_s)
    unfollowed_s = np.zeros(n) if memory.unfollowed_s is None else memory.unfollowed_s[:n]
    lead, about = site.lead, (reported.show, reported.all_up, memory.pace, reported.return_s)
    return StateBatch(
        head=BatchHead(sequence, site.site, lead.term, lead.number, *about, echoes),
        position_m=fleet.position_m,
        velocity_m_s=fleet.velocity_m_s,
        unfiltered_m_s=memory.unfiltered_m_s[:n],
        desired_m_s=memory.desired_m_s[:n],
        setpoint_m_s=memory.setpoint_m_s[:n],
        uncertainty_m=uncertainty_m,
        age_s=fleet.age_s,
        phases=reported.phases,
        modes=reported.modes,
        airborne=tasks.airborne,
        formed=np.isfinite(memory.engaged_time_s[:n]) | (tasks.task == Task.DRAWN),
        slot_stays=unfollowed_s < 0.0,
        armed=reported.armed,
        ready=reported.ready,
        owned=site.owned,
        epochs=site.epochs,
        yaw_rad=fleet.yaw_rad,
        numbers=reported.numbers,
    )


class FormationMessages:
    """What the leading station computes for the whole formation, as messages for the others.

    The slots are sent when they are no longer where the spin leads those that were sent last, and now and
    then for stations that missed them.
    """

    def __init__(self, site: Site) -> None:
        self._site = site
        self._sent: tuple[float, Array] | None = None  # when, and (n, 3) all slots then

    def forget(self) -> None:
        """Another station leads: what was sent before counts no more."""
        self._sent = None

    def of_tick(self, now_s: float, memory: Memory, reported: Reported) -> Iterator[tuple[str, bytes]]:
        """Topics and payloads after a tick."""
        site, lead = self._site, self._site.lead
        message = FormationMessage(
            site.site,
            lead.term,
            lead.number,
            reported.plan,
            reported.show,
            memory.center,
            memory.radius_m,
            memory.spin_rad_s,
            memory.sides,
        )
        yield FORMATION, message.encode()
        if memory.led_m_s is not None:
            own = len(memory.led_m_s) - site.count
            for name, station in site.stations.items():
                led_m_s = memory.led_m_s[station.rows + own]
                made = VelocitiesMessage(site.site, lead.term, lead.number, led_m_s)
                yield VELOCITIES + name, made.encode()
        if self._are_known(now_s, memory):
            return
        self._sent = now_s, memory.place
        own = len(memory.place) - site.count
        for name, station in site.stations.items():
            slots = SlotsMessage(site.site, lead.term, lead.number, memory.place[station.rows + own])
            yield SLOTS + name, slots.encode()

    def _are_known(self, now_s: float, memory: Memory) -> bool:
        """Whether the other stations know the slots from what they received."""
        if self._sent is None or now_s - self._sent[0] >= SLOTS_AGAIN_S:
            return False
        sent_s, sent = self._sent
        turn_rad = memory.spin_rad_s * (now_s - sent_s)
        expected = turned(sent, turn_rad) if turn_rad else sent
        return not moved(np.ascontiguousarray(memory.place), np.ascontiguousarray(expected))


@kernel
def moved(now: Array, before: Array) -> bool:
    """Whether one of (n, 3) slots has moved, has come or has gone."""
    for i in range(len(now)):
        for axis in range(3):
            off = abs(now[i, axis] - before[i, axis])
            if off > MOVED or np.isnan(now[i, axis]) != np.isnan(before[i, axis]):
                return True
    return False


def warm_up() -> None:
    """Compile or load every kernel of the messages: none is compiled in flight, by a new lead either."""
    reported_vehicles.warm_up()
    moved(np.zeros((1, 3)), np.zeros((1, 3)))
