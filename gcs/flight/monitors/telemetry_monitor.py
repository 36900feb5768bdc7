"""Updates phases from telemetry, and starts what follows without a command."""

import logging
import re
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np

from gcs.config.schema import Config
from gcs.estimation.fleet_state import Table
from gcs.estimation.link_health import BEATS_LACK_MAX_S, BEATS_MAY_LACK_S, lacking, signs_of_life
from gcs.failsafe.autopilot_failsafe import FailsafeInputs, cause_of, described, lost_on_the_way
from gcs.flight.maneuvers.maneuver_steps import Maneuver
from gcs.flight.maneuvers.maneuvers import Maneuvers
from gcs.flight.state.newest import Newest
from gcs.flight.state.vehicle import NOT_RECEIVED, Explanation, FlightVehicles, Vehicle, VehicleStatus
from gcs.links.batch_link import Link
from gcs.links.link import Absent
from gcs.model.lifecycle import AIRBORNE, FLOWN, Event, Phase
from gcs.model.state import Array, Mask, Mode, Telemetry, VehicleId

log = logging.getLogger(__name__)

_TENTHS: Final = re.compile(r" for (\d+)(?:\.\d)? s\b")
"""How long something lacks, as `gcs.estimation.link_health.lacking` has it."""

TRY_AGAIN_S = 5.0
"""Interval between two attempts at an automatic action."""

AT_ONCE_MAX: Final = 200
"""Most vehicles without new telemetry that one tick inspects; the next ticks inspect the others."""

BEATS_LACK_S = {Phase.OFFLINE: 0.0, Phase.LOST: 0.0, Phase.STANDBY: BEATS_MAY_LACK_S}
"""Time by which a heartbeat may be older than `operation.silence_s`; in other phases BEATS_LACK_MAX_S.

Zero for a lost vehicle: an old heartbeat does not show whether a pilot has taken over meanwhile.
"""


@dataclass(eq=False)
class TelemetryMonitor:
    """Keeps the phases consistent with the vehicles' telemetry."""

    newest: Newest
    vehicles: FlightVehicles
    links: Sequence[Link]
    config: Config
    table: Table
    note_seen: Callable[[Mask], None]
    owned: Callable[[], Mask]  # (n,) which vehicles this station flies
    inputs: Callable[[Vehicle], FailsafeInputs]
    maneuvers: Maneuvers
    come_back: Maneuver
    _resumed_s: float = -np.inf  # after a stall; messages of that time may not be read yet
    _looked: tuple[Sequence[Any], ...] = ()  # columns as of the last tick, see `_changed`
    _restless: list[int] = field(default_factory=list)  # rows to inspect again, ascending
    _next_row: int = 0  # the vehicle with which the next tick begins
    _absent: Mapping[VehicleId, Absent] = field(default_factory=dict)
    _absent_before: dict[VehicleId, Absent] = field(default_factory=dict)  # those that the reasons name
    # phases, how long heartbeats may lack in them (n,), and whether they mean that a vehicle is absent (n,)
    _judged: tuple[list[Phase], Array, Mask] = field(
        default_factory=lambda: ([], np.zeros(0), np.zeros(0, np.bool_))
    )

    def resume(self) -> None:
        """Note that the service has stalled: it cannot know yet which vehicles were silent meanwhile."""
        self._resumed_s = self.newest.state.time_s

    def look(self) -> None:
        """Let the telemetry change phases, and end maneuvers that no longer apply; called once a tick."""
        now_s, telemetry = self.newest.state.time_s, self.newest.telemetry
        for row in (self.table.reset_time_s == now_s).nonzero()[0].tolist():
            self._mind_reset(self.vehicles.rows[row])
        fresh = self._judge(now_s, telemetry)
        self._forget_heartbeats(fresh)
        changed = self._changed(telemetry, fresh)
        if not (changed or self._restless):
            return
        self._absent = {name: why for link in self.links for name, why in link.without_autopilot.items()}
        vehicles = list(self.vehicles.values())
        inspected = sorted({*changed, *self._in_turn(changed)})
        restless = set(self._restless)
        for row in inspected:
            vehicle = vehicles[row]
            if fresh[row] and vehicle.is_calm(telemetry.mode[row], armed=telemetry.armed[row]):
                restless.discard(row)
            else:
                restless.add(row)
                self._look_at(vehicle, telemetry)
        self._restless = sorted(restless)

    def _changed(self, telemetry: Telemetry, fresh: Mask) -> Sequence[int]:
        """Rows where something that `_look_at` decides by has changed since the last tick.

        Ages, batteries and status texts are left out: restless vehicles are inspected again anyway.
        """
        before = self._looked
        now: tuple[Sequence[Any], ...] = (
            *(self.vehicles.states.phases, self.vehicles.states.modes),
            *(telemetry.mode, telemetry.armed, telemetry.in_failsafe, telemetry.landed),
            *(self.newest.silent.tobytes(), self.newest.has_heartbeat.tobytes(), fresh.tobytes()),
        )
        self._looked = now
        if not before:
            return range(len(fresh))
        both = zip(now, before, strict=True)
        columns = [(one, other) for one, other in both if one is not other and one != other]
        differ: set[int] = set()
        for one, other in columns:
            differ.update(row for row, (was, is_) in enumerate(zip(other, one, strict=True)) if was != is_)
        return list(differ)

    def _in_turn(self, changed: Sequence[int]) -> Sequence[int]:
        """Restless rows to inspect in this tick besides the changed ones: a thousand would be slow."""
        waiting = self._restless
        if len(waiting) + len(changed) <= AT_ONCE_MAX:
            return waiting
        first = bisect_left(waiting, self._next_row)
        turn = (waiting[first:] + waiting[:first])[:AT_ONCE_MAX]
        self._next_row = turn[-1] + 1 if turn else 0
        return turn

    def _judge(self, now_s: float, telemetry: Telemetry) -> Mask:
        """Judge which vehicles are silent, and keep the positions of the others.

        Returns: (n,) which have sent every sign of life lately, a heartbeat as well.
        """
        phases = self.vehicles.phases
        if phases is not self._judged[0] and phases != self._judged[0]:
            lacks_s = np.array([BEATS_LACK_S.get(phase, BEATS_LACK_MAX_S) for phase in phases])
            away = np.array([phase in {Phase.OFFLINE, Phase.LOST} for phase in phases])
            self._judged = phases, lacks_s, away
        _, may_lack_s, absent = self._judged
        seen, self.newest.silent, self.newest.has_heartbeat, fresh = signs_of_life(
            now_s,
            telemetry.life_time_s,
            telemetry.heartbeat_time_s,
            telemetry.position_time_s,
            self.newest.state.position_m,
            may_lack_s,
            absent,
            self.config.operation.silence_s,
            now_s - self._resumed_s,
        )
        self.note_seen(seen)  # even without a heartbeat
        return fresh

    def _look_at(self, vehicle: Vehicle, telemetry: Telemetry) -> None:
        row, now_s = vehicle.row, self.newest.state.time_s
        if not self.owned()[row]:
            return
        silence_s = self.config.operation.silence_s
        silent, has_heartbeat = bool(self.newest.silent[row]), bool(self.newest.has_heartbeat[row])
        position_s, beat_s, life_s = (
            float(column[row])
            for column in (telemetry.position_time_s, telemetry.heartbeat_time_s, telemetry.life_time_s)
        )
        lacks = lacking(now_s, life_s, beat_s, position_s, silence_s)
        in_failsafe = vehicle.phase is Phase.PILOT and telemetry.in_failsafe[row]
        status = VehicleStatus(
            silent,
            telemetry.mode[row],
            telemetry.armed[row],
            telemetry.landed[row],
            in_failsafe,
            lacks,
            partial(self._explained, vehicle),
        )
        alone = vehicle.without_setpoints
        lost_holds = alone.changes_mode and alone.action == "hold"
        if vehicle.observe(status, lost_holds=lost_holds):
            if vehicle.phase in {Phase.LOST, Phase.PILOT, Phase.KILLED}:
                self.maneuvers.stop(vehicle, f"{vehicle.id} is {vehicle.phase} now: {vehicle.reason}")
            return
        self._note_heartbeats(vehicle, lacks)
        if vehicle.phase is Phase.PILOT:
            self._mind_failsafe(vehicle, beat_is_fresh=has_heartbeat)
        elif self.maneuvers.running(vehicle):
            return
        elif vehicle.phase in {Phase.OFFLINE, Phase.LOST} and silent:
            self._explain_absence(vehicle, lacks, has_heartbeat=has_heartbeat)
        elif vehicle.phase is Phase.LOST and status.mode is not Mode.LAND:
            self._by_itself(vehicle, self.come_back)
        elif (
            vehicle.phase is Phase.STANDBY
            and not status.armed
            and not vehicle.autopilot.rests_in(status.mode)
        ):
            self._by_itself(vehicle, self.maneuvers.rest)
        elif vehicle.phase in FLOWN and not vehicle.flags.handed_over and status.mode is Mode.HOLD:
            vehicle.apply(Event.HOLD, "a hold command that seemed to have failed was executed")

    def _explain_absence(self, vehicle: Vehicle, lacks: str, *, has_heartbeat: bool) -> None:
        if vehicle.phase is Phase.LOST:
            _count_on(vehicle, lacks)
            return
        absent, before = self._absent.get(vehicle.id), self._absent_before.pop(vehicle.id, None)
        if absent is not None:
            self._absent_before[vehicle.id] = absent
            reason = str(absent)
        elif has_heartbeat:
            reason = "received, but it has no position yet"
        else:
            _count_on(vehicle, lacks)
            reason = vehicle.reason if before is None else NOT_RECEIVED
        if reason != vehicle.reason:
            vehicle.reason = reason

    def _explained(self, vehicle: Vehicle, inputs: FailsafeInputs | None = None) -> Explanation:
        inputs = inputs or self.inputs(vehicle)
        cause = cause_of(inputs)
        return cause, described(vehicle.id, cause, inputs)

    def _mind_failsafe(self, vehicle: Vehicle, *, beat_is_fresh: bool) -> None:
        """Update the explanation, and fly on a vehicle that holds only because its link lost setpoints."""
        inputs = self.inputs(vehicle)
        by_command = not inputs.in_failsafe and Mode.HOLD in vehicle.modes
        if not (by_command and lost_on_the_way(vehicle.cause, inputs, hold_commanded=True)):
            vehicle.explain(self._explained(vehicle, inputs), inputs.mode, in_failsafe=inputs.in_failsafe)
        idle = beat_is_fresh and not self.maneuvers.running(vehicle)
        if idle and lost_on_the_way(vehicle.cause, inputs, hold_commanded=by_command):
            self._by_itself(vehicle, self.come_back)

    def _note_heartbeats(self, vehicle: Vehicle, lacks: str) -> None:
        lacking_since = self.newest.without_heartbeat
        if lacks and vehicle.phase in AIRBORNE and vehicle.id not in lacking_since:
            lacking_since[vehicle.id] = lacks
            log.warning("heartbeats_lack", extra={"vehicle": vehicle.id, "reason": lacks})

    def _forget_heartbeats(self, fresh: Mask) -> None:
        lacking_since = self.newest.without_heartbeat
        for name in list(lacking_since):
            vehicle = self.vehicles[name]
            if fresh[vehicle.row] or vehicle.phase not in AIRBORNE:
                del lacking_since[name]
                log.info(
                    "heartbeats_again" if fresh[vehicle.row] else "heartbeats_over", extra={"vehicle": name}
                )

    def _mind_reset(self, vehicle: Vehicle) -> None:
        """Freeze a vehicle whose position jumped, with a wider margin: it may be wrong now, or was before."""
        positioning = self.config.positioning
        if vehicle.phase not in FLOWN:
            return
        reason = (
            f"its position jumped: it stands for {positioning.freeze_s:g} s,"
            f" and its position counts as {positioning.reset_uncertainty_m:g} m more uncertain"
            f" for {positioning.reset_margin_s:g} s"
        )
        vehicle.freeze(
            self.newest.position_m(vehicle), self.newest.state.time_s + positioning.freeze_s, reason
        )

    def _by_itself(self, vehicle: Vehicle, maneuver: Maneuver) -> None:
        """Start an automatic maneuver: not recorded as a command, and not repeated at once when it fails."""
        if self.newest.state.time_s >= vehicle.try_again_s:
            vehicle.try_again_s = self.newest.state.time_s + TRY_AGAIN_S
            self.maneuvers.start(vehicle, maneuver, lambda _outcome, _reason: None)


def _count_on(vehicle: Vehicle, lacks: str) -> None:
    """Let the reason of a silent vehicle say how long it has been silent by now, in whole seconds."""
    if lacks and _TENTHS.search(vehicle.reason):
        reason = _TENTHS.sub(r" for \1 s", lacks)
        if reason != vehicle.reason:
            vehicle.reason = reason
