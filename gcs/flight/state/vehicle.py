"""Runtime state of one vehicle: its phase, its task, and its reported status."""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf
from operator import attrgetter
from typing import Any, ClassVar, Final, TypeAlias

import numpy as np

from gcs.control import Task
from gcs.failsafe.autopilot_failsafe import TERMINATED, FailsafeCause
from gcs.flight.state.flags import Flags
from gcs.links.autopilots import DEFAULT, Autopilot
from gcs.model.errors import RefusedError, UnknownError
from gcs.model.lifecycle import AIRBORNE, FLOWN, Event, Phase, ShowPhase, advance
from gcs.model.setpoint_loss import WithoutSetpoints
from gcs.model.state import Array, Landed, Mask, Mode, VehicleId

log = logging.getLogger(__name__)

SHOW_FLIES = frozenset({ShowPhase.ASSEMBLING, ShowPhase.RUNNING})

NOT_RECEIVED: Final = "not received yet"

LANDED_UNKNOWN: Final = "received, but its landed state is not known (EXTENDED_SYS_STATE): it may be flying"

Explanation: TypeAlias = tuple[FailsafeCause, str]
"""Why a vehicle is in a mode that this station did not command: the cause, and the text for the operator."""

_VAGUE = {FailsafeCause.UNKNOWN, FailsafeCause.OTHER, FailsafeCause.SETPOINT_LOSS, None}
"""Causes that later messages may replace: STATUSTEXT and battery states arrive at any time."""


def _unexplained() -> Explanation:
    return FailsafeCause.UNKNOWN, "in a mode that this station did not command: a pilot, or its autopilot"


@dataclass(frozen=True, slots=True)
class VehicleStatus:
    """The reported status of one vehicle at one tick."""

    silent: bool  # see `gcs.estimation.link_health`
    mode: Mode
    armed: bool
    landed: Landed
    in_failsafe: bool = False  # the autopilot reports a failsafe
    lacks: str = ""  # which sign of life is missing, and since when, in words
    explain: Callable[[], Explanation] = _unexplained  # explains a mode that was not commanded


@dataclass(slots=True, eq=False)
class Vehicle:
    """Runtime state of one vehicle. Changed on the event loop only, by the orchestrator and its maneuvers.

    Attributes:
        changes: how often any attribute of any vehicle was set.
    """

    changes: ClassVar[int] = 0

    id: VehicleId
    row: int
    system_id: int
    link: str
    charge: float = 1.0
    phase: Phase = Phase.OFFLINE
    reason: str = NOT_RECEIVED
    home_m: Array | None = None  # (3,) show frame, where it took off
    hold_m: Array | None = None  # (3,) where it waits while the show does not move it
    goal_m: Array | None = None  # (3,) of RETURN and LANDING
    lands_at_m: Array | None = None  # (3,) the place to which a planned path leads it
    flags: Flags = Flags()
    frozen_until_s: float = -inf  # its position jumped: until then it stands still
    try_again_s: float = 0.0  # earliest time of the next automatic attempt
    cause: FailsafeCause | None = None  # while PILOT: why it is in its mode; while KILLED: without a command
    _explained: tuple[Mode, bool] | None = None
    modes: frozenset[Mode] = field(default_factory=frozenset)  # those that a command explains
    autopilot: Autopilot = DEFAULT  # as configured
    without_setpoints: WithoutSetpoints = WithoutSetpoints()

    def __setattr__(self, name: str, value: object) -> None:
        """Set it, and count the change: see `VehicleStates`."""
        object.__setattr__(self, name, value)
        Vehicle.changes += 1

    @property
    def comes_down_alone(self) -> bool:
        """Whether the autopilot alone leads its descent: it climbs straight up, or touches down already."""
        return self.phase is Phase.TAKEOFF or self.flags.handed_over

    def apply(self, event: Event, reason: str) -> None:
        """Advance the phase, and log the change. Raises: RefusedError when the table does not allow it."""
        before, self.phase = self.phase, advance(self.phase, event)
        self.reason = reason
        if self.phase is not Phase.PILOT:
            self.cause = None
        self.flags = self.flags.after(before, self.phase, only_link_lost=self._only_link_lost)
        if self.phase not in FLOWN:
            self.goal_m = self.lands_at_m = None
        level = logging.WARNING if self.phase in {Phase.LOST, Phase.PILOT} else logging.INFO
        reported = {"vehicle": self.id, "was": before.value, "phase": self.phase.value, "reason": reason}
        log.log(level, "vehicle_phase", extra=reported)

    @property
    def _only_link_lost(self) -> bool:
        """Whether no pilot is in control: its link lost setpoints, and it just holds."""
        return self.cause is FailsafeCause.SETPOINT_LOSS

    def set_flags(self, **flags: bool) -> None:
        """Set flags of a maneuver, see `Flags`; they hold until the phase changes."""
        self.flags = replace(self.flags, **flags)

    def explain(self, explanation: Explanation, mode: Mode, *, in_failsafe: bool) -> None:
        """Keep the explanation of its mode while PILOT. An explained mode keeps its cause: texts expire."""
        cause, text = explanation
        changed = (mode, in_failsafe) != self._explained
        if not changed and (
            cause is self.cause or self.cause not in _VAGUE or cause is FailsafeCause.UNKNOWN
        ):
            return
        if self.cause is not cause:
            reported = {"vehicle": self.id, "cause": cause.value, "reason": text}
            log.warning("outside_control", extra=reported)
        self.cause, self.reason, self._explained = cause, text, (mode, in_failsafe)
        if self.phase is Phase.PILOT:
            self.set_flags(pilot_in_control=not self._only_link_lost)

    def freeze(self, position_m: Array, until_s: float, reason: str) -> None:
        """Hold it at its reported position; its maneuver and phase do not change."""
        self.hold_m, self.frozen_until_s, self.reason = position_m.copy(), until_s, reason
        log.warning("position_reset", extra={"vehicle": self.id, "reason": reason})

    def task(self, show: ShowPhase, time_s: float) -> tuple[Task, Array | None]:
        """Return its task in the tick at `time_s`, and the goal if there is one."""
        led = not self.flags.handed_over
        if led and self.phase in FLOWN and self.hold_m is not None and time_s < self.frozen_until_s:
            return Task.GOAL, self.hold_m
        if self.phase is Phase.FORMATION:
            if show in SHOW_FLIES:
                return Task.FORMATION, None
            return (Task.NONE, None) if self.hold_m is None else (Task.GOAL, self.hold_m)
        if led and self.phase in {Phase.RETURN, Phase.LANDING} and self.goal_m is not None:
            return Task.GOAL, self.goal_m
        if self.flags.entering_offboard and self.hold_m is not None:
            return Task.GOAL, self.hold_m
        return Task.NONE, None

    def is_calm(self, mode: Mode, *, armed: bool) -> bool:
        """Whether `observe` would change nothing for a vehicle received just now.

        Then nothing follows automatically either (see `telemetry_monitor`). False proves nothing.
        """
        if self.phase in AIRBORNE:
            return armed and mode in self.modes and mode is not Mode.HOLD
        return self.phase is Phase.STANDBY and not armed and self.autopilot.rests_in(mode)

    def observe(self, status: VehicleStatus, *, lost_holds: bool = True) -> bool:
        """Let the telemetry change the phase. Returns: whether it did.

        A decision of a pilot or of the autopilot is never reverted here: a mode without a command ends
        control.

        Args:
            status: at this tick.
            lost_holds: whether its failsafe has it hold, so that HOLD after a silence needs no pilot.
        """
        if self._terminates(status):
            self.apply(Event.KILL, f"{self.id} falls: {TERMINATED}")
            self.cause = FailsafeCause.TERMINATION
            return True
        event = self._noticed(status, lost_holds=lost_holds)
        if event is None:
            return False
        self.apply(*event)
        return True

    def _terminates(self, status: VehicleStatus) -> bool:
        flew = self.phase in AIRBORNE | {Phase.PILOT, Phase.LOST}
        return flew and status.mode is Mode.TERMINATED and not status.silent

    def _noticed(self, status: VehicleStatus, *, lost_holds: bool) -> tuple[Event, str] | None:
        if status.silent:
            received = self.phase in AIRBORNE | {Phase.PILOT, Phase.STANDBY}
            return (Event.SILENT, status.lacks or "no telemetry") if received else None
        if self.phase in AIRBORNE | {Phase.PILOT}:
            return self._received_in_flight(status)
        if self.phase is Phase.LOST:
            return self._received_again(status, lost_holds=lost_holds)
        flies = status.armed and status.landed is not Landed.ON_GROUND  # unknown is not "on the ground"
        flies = flies and status.mode is not Mode.TERMINATED  # it lies, and may not know that it is down
        if self.phase is Phase.OFFLINE:
            if status.landed is Landed.UNKNOWN:
                self.reason = LANDED_UNKNOWN
                return None
            if flies:
                return Event.CONNECTED_IN_AIR, "found in the air, without a command of this station"
            return Event.CONNECTED, "on the ground"
        if self.phase is Phase.STANDBY and flies:
            return Event.CONNECTED_IN_AIR, "took off without a command of this station"
        return None

    def _received_in_flight(self, status: VehicleStatus) -> tuple[Event, str] | None:
        if not status.armed:
            return Event.TOUCHED_DOWN, "on the ground, motors off"
        if self.phase in AIRBORNE and status.mode not in self.modes:
            self.cause, text = status.explain()
            self._explained = status.mode, status.in_failsafe
            return Event.TAKEN_OVER, text
        return None

    def _received_again(self, status: VehicleStatus, *, lost_holds: bool) -> tuple[Event, str] | None:
        """Return from LOST: control is resumed only if a command, or the expected HOLD, explains the mode."""
        if not status.armed:
            return Event.CONNECTED, "received again, on the ground, motors off"
        if self.flags.pilot_in_control:
            return Event.TAKEN_OVER, "received again; it had been taken over, and no take-control came since"
        if status.mode not in (self.modes | {Mode.HOLD} if lost_holds else self.modes):
            self.cause, text = status.explain()
            self._explained = status.mode, status.in_failsafe
            return Event.TAKEN_OVER, f"received again: {text}"
        return None


class VehicleStates:
    """Columns of all vehicles of a fleet, by row, until one of them changes: seldom in flight."""

    def __init__(self, vehicles: tuple[Vehicle, ...]) -> None:
        self._vehicles = vehicles
        self._changes = Vehicle.changes
        self._in_phases: dict[tuple[Phase, ...], list[Vehicle]] = {}

    @property
    def is_current(self) -> bool:
        return self._changes == Vehicle.changes

    @cached_property
    def phases(self) -> list[Phase]:
        return [vehicle.phase for vehicle in self._vehicles]

    @cached_property
    def reasons(self) -> list[str]:
        return [vehicle.reason for vehicle in self._vehicles]

    @cached_property
    def homes_m(self) -> list[Array | None]:
        """(3,) of each, where it took off."""
        return [vehicle.home_m for vehicle in self._vehicles]

    @cached_property
    def airborne(self) -> Mask:
        """(n,) in the air under this service's control."""
        return np.array([phase in AIRBORNE for phase in self.phases], dtype=np.bool_)

    @cached_property
    def modes(self) -> list[frozenset[Mode]]:
        """Of each vehicle those that a command explains."""
        return [vehicle.modes for vehicle in self._vehicles]

    @cached_property
    def flown(self) -> list[tuple[Any, ...]]:
        """What a stall needs of each: phase, reason, flags."""
        return list(map(_FLOWN, self._vehicles))

    @cached_property
    def frozen_until_s(self) -> float:
        """The latest of all."""
        return max([vehicle.frozen_until_s for vehicle in self._vehicles])

    def in_phase(self, phases: tuple[Phase, ...]) -> list[Vehicle]:
        if phases not in self._in_phases:
            self._in_phases[phases] = [vehicle for vehicle in self._vehicles if vehicle.phase in phases]
        return self._in_phases[phases]


_FLOWN = attrgetter("phase", "reason", "flags")


class FlightVehicles(dict[VehicleId, Vehicle]):
    """The vehicles of one flight by id, in the order of their rows; none is added or removed."""

    def __init__(self, vehicles: Iterable[Vehicle]) -> None:
        self.rows = tuple(vehicles)
        super().__init__((vehicle.id, vehicle) for vehicle in self.rows)
        self.system_ids = tuple(vehicle.system_id for vehicle in self.rows)
        self.links = tuple(vehicle.link for vehicle in self.rows)
        self.autopilots = tuple(vehicle.autopilot.name for vehicle in self.rows)
        self._states = VehicleStates(self.rows)

    def named(self, vehicle_id: VehicleId) -> Vehicle:
        """Return the vehicle with this id. Raises: UnknownError."""
        try:
            return self[vehicle_id]
        except KeyError:
            raise UnknownError(f"there is no vehicle {vehicle_id}; there are {', '.join(self)}") from None

    @property
    def states(self) -> VehicleStates:
        """The vehicles as they are now: the same object until one of them changes."""
        if not self._states.is_current:
            self._states = VehicleStates(self.rows)
        return self._states

    @property
    def phases(self) -> list[Phase]:
        """Of all vehicles, by row; not to be changed."""
        return self.states.phases

    def in_phase(self, *phases: Phase) -> list[Vehicle]:
        return self.states.in_phase(phases).copy()

    @property
    def airborne(self) -> list[Vehicle]:
        """Vehicles in the air under this service's control."""
        return self.in_phase(*AIRBORNE)


def require_phase(vehicle: Vehicle, event: Event) -> None:
    """Check that `event` is allowed now. Raises: RefusedError naming the vehicle."""
    try:
        advance(vehicle.phase, event)
    except RefusedError as error:
        raise RefusedError(f"{vehicle.id}: {error}") from None
