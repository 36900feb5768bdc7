"""What a station sends the others after each tick: its vehicles, and while it leads the whole formation."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import nan

import numpy as np

from gcs.control.inputs import Memory, Task, Tasks
from gcs.model.lifecycle import ShowPhase
from gcs.model.state import Array, FleetState, Mask
from gcs.stations.messages import Codes, FormationMessage, SlotsMessage, StateBatch
from gcs.stations.site import Site

STATES, FORMATION, SLOTS = "states", "formation", "slots."
"""Topics; the name of a station follows the last."""


@dataclass(frozen=True, slots=True, eq=False)
class Reported:
    """What the own n vehicles report, and the station says, beside positions and setpoints."""

    phases: Codes  # (n,) places in PHASES
    modes: Codes  # (n,) places in MODES
    armed: Mask
    ready: Mask
    battery_remaining: Array  # (n,) NaN: unknown
    link_quality: Array  # (n,) NaN: unknown
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
    return StateBatch(
        sequence=sequence,
        site=site.site,
        term=site.lead.term,
        lead=site.lead.number,
        show=reported.show,
        all_up=reported.all_up,
        pace=memory.pace,
        return_s=reported.return_s,
        echoes=echoes,
        position_m=fleet.position_m,
        velocity_m_s=fleet.velocity_m_s,
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
        battery_remaining=reported.battery_remaining,
        link_quality=reported.link_quality,
    )


def formation_messages(site: Site, memory: Memory, reported: Reported) -> Iterator[tuple[str, bytes]]:
    """Topics and payloads of what the leading station computes for the whole formation."""
    lead = site.lead
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
    own = len(memory.place) - site.count
    for name, station in site.stations.items():
        slots = SlotsMessage(site.site, lead.term, lead.number, memory.place[station.rows + own])
        yield SLOTS + name, slots.encode()
