"""Evaluates the failsafe triggers every tick, and executes what `gcs.failsafe.triggers` requests."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gcs.estimation.fleet_state import Table
from gcs.estimation.link_delay import LinkDelay
from gcs.estimation.link_health import LinkQuality
from gcs.failsafe.arbitration import Failsafes, Standing
from gcs.failsafe.policy import FLIES_ON, SEVERITY, Action, Cause, FailsafePolicy
from gcs.failsafe.triggers import FailsafeRequest, Known, Roles, Seen
from gcs.flight.commands.commander import Commander
from gcs.flight.shows.show_player import ShowPlayer
from gcs.flight.state.newest import InForce, Newest
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.ticker import TickClock
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.model.lifecycle import AIRBORNE, ON_THE_GROUND, Phase, ShowPhase
from gcs.model.plan import Formation
from gcs.service import ActiveFailsafe, CommandRecord, ShowAction, VehicleAction

log = logging.getLogger(__name__)

SHOW_COMMAND: Final = {
    Action.PAUSE: ShowAction.PAUSE,
    Action.RETURN: ShowAction.STOP,
    Action.LAND: ShowAction.ABORT,
}

VEHICLE_COMMAND: Final = {
    Action.HOLD: VehicleAction.HOLD,
    Action.RETURN: VehicleAction.RETURN,
    Action.LAND: VehicleAction.LAND,
}

STANDING: Final = {
    Phase.TAKEOFF: FLIES_ON,
    Phase.FORMATION: FLIES_ON,
    Phase.HOLD: SEVERITY[Action.HOLD],
    Phase.RETURN: SEVERITY[Action.RETURN],
    Phase.LANDING: SEVERITY[Action.LAND],
}
"""Severity of what a vehicle does already."""

SHOW_STANDING: Final = {
    ShowPhase.PAUSED: SEVERITY[Action.PAUSE],
    ShowPhase.RETURNING: SEVERITY[Action.RETURN],
    ShowPhase.ABORTING: SEVERITY[Action.LAND],
}

FORMED: Final = frozenset({ShowPhase.ASSEMBLING, ShowPhase.RUNNING})
"""Phases in which a show can be paused, and closes its gaps."""


@dataclass(eq=False)
class FailsafeMonitor:
    """The failsafes of one flight. Changed on the event loop only."""

    newest: Newest
    vehicles: FlightVehicles
    show: ShowState
    in_force: InForce
    settings: FailsafePolicy
    table: Table
    link_delay: LinkDelay
    link_quality: LinkQuality
    unix_s: Callable[[], float]
    show_player: ShowPlayer
    clock: TickClock
    commander: Commander
    is_busy: Callable[[Vehicle], bool]
    target_age_s: Callable[[], float]  # since a target that moves was last received; NaN: it does not count

    def __post_init__(self) -> None:
        settings, count = self.settings, len(self.vehicles)
        self._failsafes = Failsafes(settings, Known.nothing(count, self.newest.state.time_s, settings))
        self._commanded: dict[tuple[Cause, Action], str] = {}
        self._sent: dict[int, int] = {}  # severity of the command whose maneuver a vehicle executes
        self._held: dict[tuple[str, str], bool] = {}
        self._lost_before: set[str] = set()
        self._paused_since_s: float | None = None
        self._descended = False  # for what is near now
        self.active: tuple[ActiveFailsafe, ...] = ()

    def look(self) -> None:
        """Evaluate all triggers; called once a tick."""
        seen = self._seen()
        if self.show.phase is not ShowPhase.PAUSED:
            self._paused_since_s = None
        elif self._paused_since_s is None:
            self._paused_since_s = seen.time_s
        requests = self._failsafes.look(seen, self._roles, active=bool(self.active))
        if requests is None or not (requests or self.active):
            return
        self._sent = {row: sent for row, sent in self._sent.items() if self.is_busy(self.vehicles.rows[row])}
        self._failsafes.execute(requests, self._standing, self._command)
        self._show(requests)

    def _seen(self) -> Seen:
        fleet, telemetry = self.newest.state, self.newest.telemetry
        return Seen(
            fleet.time_s,
            fleet.position_m,
            fleet.velocity_m_s,
            self.newest.memory.asked_m_s[: len(fleet.ids)],
            telemetry.battery_remaining,
            telemetry.horizontal_accuracy_m,
            telemetry.vertical_accuracy_m,
            np.isinf(fleet.age_s)
            & (fleet.time_s - telemetry.position_time_s <= self.in_force.control.telemetry_age_max_s),
            self.table.doubts,
            self.newest.silent,
            self.table.reset_time_s,
            self.in_force.control.safety.fence,
            self.target_age_s(),
            self.clock.late_s,
            self.link_delay.late_s,
            self.link_quality.share,
            self.newest.manned,
            self._descended or (self.show.run is None and self.show.phase in FORMED),
            self.show.phase is ShowPhase.PAUSED,
        )

    def _roles(self) -> Roles:
        """Return the roles of the vehicles; vehicles lost before this show do not count as newly lost."""
        vehicles = self.vehicles.values()
        phases = [vehicle.phase for vehicle in vehicles]
        lost = {
            vehicle.id
            for vehicle in vehicles
            if vehicle.phase is Phase.KILLED
            or (vehicle.phase is Phase.LOST and not vehicle.flags.pilot_in_control)
        }
        self._lost_before = lost if self.show.phase in ON_THE_GROUND else self._lost_before & lost
        newly_lost = lost - self._lost_before
        since_s = self._paused_since_s
        return Roles(
            np.array([phase in AIRBORNE for phase in phases]),
            np.array([phase is Phase.FORMATION for phase in phases]),
            np.array([vehicle.id in newly_lost for vehicle in vehicles]),
            0.0 if since_s is None else self.newest.state.time_s - since_s,
        )

    def _command(self, request: FailsafeRequest) -> FailsafeRequest | None:
        if not request.whole_show:
            return self._act(request)
        self._note(request, self._of_show(request))
        return request

    def _standing(self) -> Standing:
        """Return what is in progress; a vehicle's maneuver counts as what it was commanded."""
        of_show = SHOW_STANDING.get(self.show.phase, FLIES_ON)
        severities = np.full(len(self.vehicles), np.nan)
        for row, vehicle in enumerate(self.vehicles.values()):
            if vehicle.phase in STANDING:
                sent = max(of_show, self._sent.get(row, 0)) if self.is_busy(vehicle) else 0
                severities[row] = max(STANDING[vehicle.phase], sent)
        possible = {Action.RETURN, Action.LAND}
        if self.show.phase in FORMED:
            possible |= {Action.PAUSE, Action.RE_FORM, Action.HOLD_TARGET, Action.DESCEND}
        led = self.show.phase not in ON_THE_GROUND | {ShowPhase.UNCONTROLLED}
        able = frozenset() if not led else frozenset(possible)
        return Standing(of_show, severities, able)

    def _of_show(self, request: FailsafeRequest) -> CommandRecord:
        if request.action is Action.RE_FORM:
            return self.commander.note_re_formed()
        if request.action is Action.DESCEND:
            return self.commander.note_descended(self._descend())
        if request.action is Action.HOLD_TARGET:
            self.show_player.hold_target()
            return self.commander.note_target_held()
        return self.commander.execute_show_failsafe(
            SHOW_COMMAND[request.action], f"{request.cause}: {request.reason}"
        )

    def _descend(self) -> Formation:
        """Have the formation fly on lower, as low as its sphere fits above the fence's least height."""
        plan, safety = self.in_force.plan, self.in_force.control.safety
        least_m = safety.fence.height_min_m + plan.formation.radius_m + safety.floor.margin_m
        height_m = max(self.settings.manned_aircraft.to_height_m, least_m)
        self._descended = True
        lower = replace(plan.formation, height_m=min(height_m, plan.formation.height_m))
        self.in_force.plan = replace(plan, formation=lower)
        return lower

    def _act(self, request: FailsafeRequest) -> FailsafeRequest | None:
        """Command the vehicles of a request; a climbing vehicle is not stopped, but may be landed."""
        named = [self.vehicles.rows[row] for row in request.rows]
        able = [v for v in named if v.phase is not Phase.TAKEOFF or request.action is not Action.HOLD]
        if not able:
            return None
        request = replace(request, rows=tuple(vehicle.row for vehicle in able))
        self._note(request, self.commander.command_some(able, VEHICLE_COMMAND[request.action]))
        return request

    def _note(self, request: FailsafeRequest, record: CommandRecord) -> None:
        rows = [v.row for v in self.vehicles.airborne] if request.whole_show else request.rows
        self._sent |= dict.fromkeys(rows, request.severity)
        self._commanded[request.cause, request.action] = record.id
        reported = {"cause": request.cause.value, "action": request.action.value, "command": record.id}
        log.warning(
            "failsafe", extra={**reported, "vehicles": self._named(request), "reason": request.reason}
        )

    def _named(self, request: FailsafeRequest) -> tuple[str, ...]:
        return tuple(self.newest.state.ids[row] for row in request.rows)

    def _show(self, requests: Sequence[FailsafeRequest]) -> None:
        """Update the active failsafes for display, and log those that are over."""
        lasting = {(request.cause, request.action) for request in requests}
        self._descended = self._descended and any(cause is Cause.MANNED_AIRCRAFT for cause, _ in lasting)
        self._commanded = {key: command for key, command in self._commanded.items() if key in lasting}
        for failsafe in self.active:
            if not any(cause == failsafe.cause for cause, _ in lasting):
                log.info("failsafe_over", extra={"cause": failsafe.cause})
        began = {(each.cause, each.action): each for each in self.active}
        now_s, unix_s = self.newest.state.time_s, self.unix_s()
        active = []
        for request in requests:
            key, named = (request.cause.value, request.action.value), self._named(request)
            before, command_id = began.get(key), self._commanded.get((request.cause, request.action))
            reason, since_unix_s = request.reason, unix_s - (now_s - request.since_s)
            if before is not None:
                since_unix_s = before.since_unix_time_s
                names_another = request.cause is Cause.MANNED_AIRCRAFT and request.holds
                same = before.vehicles == named and self._held.get(key) == request.holds
                if same and not names_another:
                    reason = before.reason  # its numbers may change in every tick
            active.append(ActiveFailsafe(*key, reason, named, request.since_s, since_unix_s, command_id))
        self._held = {(request.cause.value, request.action.value): request.holds for request in requests}
        self.active = tuple(active)
