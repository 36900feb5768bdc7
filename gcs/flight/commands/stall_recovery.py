"""What this service flew when it stalled, and the vehicles that a command must still reach.

Those have sent nothing yet, or a stall before the command took them out of control after it was given.
"""

import logging
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from gcs.config.sections import ShowFrameSettings
from gcs.failsafe.autopilot_failsafe import FailsafeCause, FailsafeInputs
from gcs.flight.maneuvers.maneuvers import Maneuvers
from gcs.flight.state.newest import Newest
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.uncontrolled_space import UncontrolledSpace
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.model.interrupted_flight import Before, Interruption, Written, is_left_alone, left_by, triple
from gcs.model.lifecycle import FLOWN, Phase
from gcs.model.state import Mode, VehicleId
from gcs.service import Outcome

log = logging.getLogger(__name__)

STALL_EXPLAINS_S = 3.0
"""A stall explains modes for this time: heartbeats come once a second, and the oldest are read first."""

STALL_SHARE = 0.7
"""A stall explains a setpoint-loss failsafe from this share of the shortest loss time of any vehicle on.

The last setpoint may have been late.
"""

OTHER_FAILSAFES = frozenset(FailsafeCause) - {
    FailsafeCause.SETPOINT_LOSS,
    FailsafeCause.DATA_LINK_LOSS,
    FailsafeCause.OTHER,
    FailsafeCause.UNKNOWN,
}
"""Modes that a stall does not explain."""

RECEIVED_WITHIN_S: Final = 3.0
"""A command for an interrupted flight waits this long for vehicles that have sent nothing yet."""

REPLACED: Final = "replaced by another command"

Reached = Callable[[Vehicle], None]
Missed = Callable[[Vehicle, Outcome, str], None]


@dataclass(frozen=True, slots=True)
class Stall:
    """State when a stall began, and until when the stall explains a mode."""

    flown: Interruption
    since_s: float  # commands given later were given after the stall
    until_s: float


@dataclass(eq=False)
class StallRecovery:
    """Remembers what is flown, and explains modes by the newest stall. Changed on the event loop only."""

    newest: Newest
    vehicles: FlightVehicles
    show: ShowState
    show_frame: ShowFrameSettings
    uncontrolled: UncontrolledSpace
    unix_s: Callable[[], float]
    inputs: Callable[[Vehicle], FailsafeInputs]

    def __post_init__(self) -> None:
        # At the end of a tick: commands after a stall may come before its first tick.
        self._show = self.show.phase, self.show.reason
        self._states: list[Any] = []  # of `VehicleStates.flown`
        self.stall: Stall | None = None  # the newest, while it explains modes

    def note_setpoints(self) -> None:
        """Remember which vehicles fly under setpoints until the next tick; called at the end of each tick."""
        self._show = self.show.phase, self.show.reason
        self._states = self.vehicles.states.flown

    def _flown(self) -> dict[VehicleId, tuple[Phase, str]]:
        """Vehicles under setpoints as of the last note, with their phases and reasons."""
        return {
            name: (phase, reason)
            for name, (phase, reason, flags) in zip(self.vehicles, self._states, strict=False)
            if flags.entering_offboard or (phase in FLOWN and not flags.handed_over)
        }

    def stalled(self, gap_s: float) -> None:
        """Keep what was flown when no tick came for `gap_s`; to be called before telemetry changes phases."""
        show_run, (show, reason) = self.show.run, self._show
        now_s = self.newest.state.time_s
        noticed_s = self.uncontrolled.without_setpoints.flies_on_s.min(initial=np.inf)
        if gap_s < STALL_SHARE * noticed_s:
            return
        log.warning("service_stalled", extra={"stalled_s": round(gap_s, 1), "show": show.value})
        flown = self._flown()
        if not flown:
            return
        written, vehicles = None, {}
        if show_run is not None:
            shown = show_run.view(now_s)
            written = Written(shown.name, shown.hash, shown.cue, shown.clock_s, dict(show_run.parts))
        for name, (phase, why) in flown.items():
            vehicle = self.vehicles[name]
            pad_m = None if vehicle.home_m is None else triple(vehicle.home_m.tolist())
            vehicles[name] = Before(vehicle.system_id, phase, why, pad_m)
        unix_s, frame = self.unix_s() - gap_s, self.show_frame.model_dump()
        interruption = Interruption("", unix_s, show, reason, frame, vehicles, written, None, gap_s)
        self.stall = Stall(interruption, now_s - gap_s / 2.0, now_s + STALL_EXPLAINS_S)

    def expire(self) -> None:
        if self.stall is not None and self.newest.state.time_s > self.stall.until_s:
            self.stall = None

    def fallen(self, interrupted: Collection[VehicleId]) -> dict[VehicleId, Before]:
        """Return vehicles that the stall took out of control, without those `interrupted` already."""
        stall = self.stall
        if stall is None:
            return {}
        fallen: dict[VehicleId, Before] = {}
        for name, before in stall.flown.vehicles.items():
            vehicle = self.vehicles[name]
            if vehicle.phase is not Phase.PILOT or name in interrupted or vehicle.cause in OTHER_FAILSAFES:
                continue
            facts, alone = self.inputs(vehicle), vehicle.without_setpoints
            explained = is_left_alone(
                Phase.FORMATION, facts.mode, alone.action, in_failsafe=facts.in_failsafe
            )
            if facts.mode is not Mode.OFFBOARD and explained:
                vehicle.reason = left_by(stall.flown.cause, facts.mode, changes_mode=alone.changes_mode)
                fallen[name] = before
        return fallen


@dataclass(frozen=True, slots=True, eq=False)
class _Command:
    """The newest fleet-wide command, and the vehicles that it has not reached."""

    given_s: float
    reaches_fallen: bool
    vehicles: dict[VehicleId, Vehicle]
    reached: Reached
    missed: Missed


@dataclass(eq=False)
class AwaitedVehicles:
    """Keeps the awaited vehicles of the newest command. Changed on the event loop only."""

    newest: Newest
    maneuvers: Maneuvers
    now_s: Callable[[], float]
    _command: _Command | None = None

    @property
    def any(self) -> bool:
        return self._command is not None and bool(self._command.vehicles)

    def expect(
        self, vehicles: Sequence[Vehicle], reached: Reached, missed: Missed, *, reaches_fallen: bool
    ) -> None:
        """Await `vehicles` for a command; replaces those that an earlier command awaits.

        Args:
            vehicles: have sent nothing yet.
            reached: called for each vehicle that the command may take control of.
            missed: called once for each other vehicle, with the outcome and the reason.
            reaches_fallen: whether `reached` is also called for vehicles that a stall takes out of control.
        """
        self.replace()
        awaited = {vehicle.id: vehicle for vehicle in vehicles}
        self._command = _Command(self.now_s(), reaches_fallen, awaited, reached, missed)

    def replace(self) -> None:
        """Forget the awaited vehicles: another command has replaced the one they wait for."""
        command, self._command = self._command, None
        if command is not None:
            for vehicle in command.vehicles.values():
                command.missed(vehicle, Outcome.FAILED, REPLACED)

    def falls(self, vehicle: Vehicle, since_s: float) -> bool:
        """Note that a stall took a vehicle out of control. Returns: whether the newest command reaches it.

        Args:
            vehicle: out of control now.
            since_s: commands given before this time do not reach it; the operator did not know of the stall.
        """
        command = self._command
        if command is None or not command.reaches_fallen or command.given_s < since_s:
            return False
        command.vehicles[vehicle.id] = vehicle
        return True

    def receive(
        self,
        waiting: Collection[VehicleId],
        is_unreceived: Callable[[Vehicle], bool],
        why_not: Callable[[Vehicle], str],
    ) -> None:
        """Pass on the vehicles that have sent telemetry by now; report those whose time is over as missed.

        Args:
            waiting: vehicles that the command may take control of.
            is_unreceived: whether a vehicle has not sent yet what decides that.
            why_not: returns why the command may not take control of a vehicle.
        """
        command = self._command
        if command is None:
            return
        late = self.newest.state.time_s > command.given_s + RECEIVED_WITHIN_S
        for vehicle in list(command.vehicles.values()):
            if is_unreceived(vehicle) and not late:
                continue
            del command.vehicles[vehicle.id]
            if vehicle.phase is Phase.OFFLINE:
                why = f"not received within {RECEIVED_WITHIN_S:g} s of the command"
                command.missed(vehicle, Outcome.FAILED, why)
            elif self.maneuvers.running(vehicle):
                command.missed(vehicle, Outcome.FAILED, REPLACED)
            elif vehicle.id in waiting:
                command.reached(vehicle)
            else:
                command.missed(vehicle, Outcome.NOT_INCLUDED, why_not(vehicle))
