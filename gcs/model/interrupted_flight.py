"""An interrupted flight (the service ended or stalled): what is known of it, what can be offered."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Any, Final

from pydantic import Field, TypeAdapter

from gcs.model.lifecycle import AIRBORNE, Phase, ShowPhase
from gcs.model.state import Mode, VehicleId

Triple = tuple[float, float, float]


class Offer(StrEnum):
    """What the operator can command for an interrupted flight. Nothing is done without a command."""

    TAKE_OVER = "take-over"  # hold, then back into the formation, which stands until it is resumed
    BRING_HOME = "bring-home"  # hold, then a collective return to the take-off positions


TAKEN_OVER_FROM = frozenset({ShowPhase.ARMING, ShowPhase.ASSEMBLING, ShowPhase.RUNNING, ShowPhase.PAUSED})
"""Show phases from which a flight can be taken over; descending vehicles do not go back into formation."""


@dataclass(frozen=True, slots=True)
class Before:
    """One vehicle at the end of the record."""

    system_id: int
    phase: Phase
    reason: str
    pad_m: Triple | None  # where it took off, in the show frame of its session


@dataclass(frozen=True, slots=True)
class Written:
    """The written show that was flown, and the position in it."""

    name: str
    hash: str
    cue: str
    clock_s: float
    parts: Annotated[Mapping[VehicleId, int], Field(exclude=True)]  # rows of the lights


@dataclass(frozen=True, slots=True)
class Interruption:
    """What the record contains of a flight whose session did not end properly."""

    session: str
    unix_s: float  # time of the last record
    show: ShowPhase
    reason: str
    frame: Mapping[str, float]  # `show_frame` of the session's configuration
    vehicles: Mapping[VehicleId, Before]
    written: Written | None
    plan: Mapping[str, Any] | None  # as recorded, see `gcs.model.plan`; None: the flown one is in force
    stalled_s: float | None = None  # duration without setpoints; None: the service ended

    @property
    def cause(self) -> str:
        """What interrupted the flight, in words."""
        if self.stalled_s is None:
            return "the service was cut off"
        return f"the service stalled for {self.stalled_s:.1f} s"


INTERRUPTION: Final = TypeAdapter(Interruption)
"""Reads the record, which has it as `asdict`: the next session must know it, however soon this one ends."""


def triple(values: Sequence[float] | None) -> Triple | None:
    """Three floats; None stays None. Raises: ValueError when there are not three numbers."""
    if values is None:
        return None
    x, y, z = values
    return float(x), float(y), float(z)


@dataclass(frozen=True, slots=True)
class Remaining:
    """One vehicle that was airborne, and its state now."""

    before: Annotated[Phase, Field(description="Phase at the end of the record.")]
    pad_known: Annotated[bool, Field(description="Whether it can be brought home.")]
    waits: Annotated[bool, Field(description="Waits for a command: take-over or bring-home would reach it.")]
    text: str


@dataclass(frozen=True, slots=True)
class InterruptedFlight:
    """A flight that was interrupted when the service ended or stalled. An operator must resume or end it."""

    session: str
    unix_time_s: Annotated[float, Field(description="When the flight was interrupted.")]
    show: ShowPhase
    written: Annotated[Written | None, Field(description="The written show that was flown.")]
    vehicles: Mapping[VehicleId, Remaining]
    offers: Annotated[
        tuple[Offer, ...],
        Field(description="Commands that are accepted: POST /api/v1/show/take-over and others."),
    ]
    problems: Annotated[tuple[str, ...], Field(description="Why the other commands are refused.")]
    cause: Annotated[
        str,
        Field(
            description="What interrupted the flight, in words.", examples=["the service stalled for 4.4 s"]
        ),
    ]
    stalled: Annotated[bool, Field(description="The service stalled, it did not end.")]

    @property
    def notice(self) -> str:
        """What interrupted the flight, what can be commanded, and which vehicles are unavailable."""
        what = "" if self.written is None else f" of {self.written.name!r}, cue {self.written.cue!r},"
        reported = f"{self.cause} while the show{what} was {self.show}"
        if self.show is ShowPhase.COUNTDOWN:
            return f"{reported}: it does not start by itself"
        if self.offers:
            reported += f": {' or '.join(self.offers)} can be commanded"
        absent = [f"{name}: {vehicle.text}" for name, vehicle in self.vehicles.items() if not vehicle.waits]
        return "; ".join([reported, *absent, *self.problems])


def mismatches(
    interruption: Interruption, frame: Mapping[str, float], system_ids: Mapping[VehicleId, int]
) -> list[str]:
    """Why the record cannot be used with this configuration, in words; empty when it can."""
    wrong = []
    if dict(interruption.frame) != dict(frame):
        wrong.append("show_frame is another than when it was cut off: places of the record mean nothing")
    for name, before in interruption.vehicles.items():
        now = system_ids.get(name)
        if now is None:
            wrong.append(f"{name} was in the air, and is not in this configuration")
        elif now != before.system_id:
            wrong.append(f"{name} had system id {before.system_id}, and has {now} in this configuration")
    return wrong


def is_left_alone(before: Phase, mode: Mode, setpoint_loss_action: str, *, in_failsafe: bool) -> bool:
    """Whether the end of this station's control, and not a pilot, explains a vehicle's mode.

    `before` is its phase when control ended. With "descend" it flies in a pilot's mode, or lands where it
    cannot; only the failsafe that its autopilot reports distinguishes these from a pilot.
    """
    ours = {Mode.HOLD, Mode.OFFBOARD}
    if before is Phase.TAKEOFF:
        ours.add(Mode.TAKEOFF)
    if before is Phase.LANDING or setpoint_loss_action == "land":
        ours.add(Mode.LAND)
    if setpoint_loss_action == "return":
        ours.add(Mode.RETURN)
    if setpoint_loss_action == "descend" and in_failsafe:
        ours |= {Mode.POSITION, Mode.OTHER, Mode.LAND}
    return mode in ours


def left_by(cause: str, mode: Mode, *, changes_mode: bool) -> str:
    """Why a vehicle that this station flew is in its mode, in words.

    `changes_mode`: its autopilot has a failsafe for lost setpoints, which chose the mode.
    """
    if changes_mode:
        return f"{cause}; in mode {mode} by the setpoint-loss failsafe"
    if mode is Mode.OFFBOARD:
        return f"{cause}; in mode {mode}, in which it hovers without setpoints"
    return f"{cause}; in mode {mode} by a failsafe of its own"


def remaining(
    before: Before,
    phase: Phase,
    mode: Mode,
    loss_action: str,
    *,
    in_failsafe: bool = False,
    taken_again: bool = False,
) -> Remaining:
    """The present state of one vehicle of the interrupted flight.

    `before` is as control ended, the others are as of now. `taken_again`: this station has controlled it
    since, and then a pilot or another station took it.
    """
    waits, text = phase is Phase.HOLD, f"ours again: {phase}" if phase in AIRBORNE else f"{phase}"
    if phase is Phase.OFFLINE:
        text = f"was {before.phase}, and has not been received since"
    elif phase is Phase.STANDBY:
        text = "on the ground"
    elif phase is Phase.PILOT:
        waits = not taken_again and is_left_alone(before.phase, mode, loss_action, in_failsafe=in_failsafe)
        text = f"was {before.phase}, waits in mode {mode}"
        if not waits:
            text = f"in mode {mode}, a pilot may have it: take-control when the pilot agrees"
    return Remaining(before.phase, before.pad_m is not None, waits, text)
