"""A flight that was cut off, when the service ended or stalled: what is known of it, what can be offered."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from gcs.model.lifecycle import AIRBORNE, Phase, ShowPhase
from gcs.model.state import Mode, VehicleId

Triple = tuple[float, float, float]


class Offer(StrEnum):
    """What can be done about it. Nothing is done without an order."""

    TAKE_OVER = "take-over"  # hold, and back into the formation, which stands until it is resumed
    BRING_HOME = "bring-home"  # hold, and home together to where they took off


TAKEN_OVER_FROM = frozenset({ShowPhase.ARMING, ShowPhase.ASSEMBLING, ShowPhase.RUNNING, ShowPhase.PAUSED})
"""Who was on the way down is not sent back into a formation."""


@dataclass(frozen=True, slots=True)
class Before:
    """One vehicle where the record ends."""

    system_id: int
    phase: Phase
    reason: str
    pad_m: Triple | None  # show frame of its session: where it took off


@dataclass(frozen=True, slots=True)
class Written:
    """The written show that was flown, and where in it."""

    name: str
    hash: str
    cue: str
    clock_s: float
    parts: Mapping[VehicleId, int]  # rows of the lights


@dataclass(frozen=True, slots=True)
class Interruption:
    """What the record knows of a flight whose session did not end as it should."""

    session: str
    unix_s: float  # the last that was noted
    show: ShowPhase
    reason: str
    frame: Mapping[str, float]  # `show_frame` of its configuration
    vehicles: Mapping[VehicleId, Before]
    written: Written | None
    plan: (
        Mapping[str, Any] | None
    )  # as recorded, see `gcs.model.plan_json`; None: the plan flown still stands
    stalled_s: float | None = None  # no setpoints left for so long; None: the service ended

    @property
    def cause(self) -> str:
        """What cut the flight off, in words."""
        if self.stalled_s is None:
            return "the service was cut off"
        return f"the service stalled for {self.stalled_s:.1f} s"

    def to_json(self) -> dict[str, Any]:
        """For the record: the next session must know it, however soon this one ends."""
        return asdict(self)

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> "Interruption":
        """The same again. Raises: KeyError, TypeError or ValueError for what is none."""
        written = raw["written"]
        return cls(
            session=raw["session"],
            unix_s=float(raw["unix_s"]),
            show=ShowPhase(raw["show"]),
            reason=raw["reason"],
            frame=raw["frame"],
            vehicles={
                name: Before(one["system_id"], Phase(one["phase"]), one["reason"], triple(one["pad_m"]))
                for name, one in raw["vehicles"].items()
            },
            written=None if written is None else Written(**written),
            plan=raw["plan"],
            stalled_s=raw.get("stalled_s"),
        )


def triple(values: Sequence[float] | None) -> Triple | None:
    """Three numbers, or not known. Raises: ValueError."""
    if values is None:
        return None
    x, y, z = values
    return float(x), float(y), float(z)


@dataclass(frozen=True, slots=True)
class Remaining:
    """One vehicle that was in the air, and what is known of it now."""

    id: VehicleId
    before: Phase
    pad_known: bool
    waits: bool  # for an order: it can be taken over, or brought home
    text: str


@dataclass(frozen=True, slots=True)
class InterruptedFlight:
    """What an operator is shown, until everybody is accounted for."""

    session: str
    unix_time_s: float
    show: ShowPhase
    written: Written | None
    vehicles: tuple[Remaining, ...]
    offers: tuple[Offer, ...]
    problems: tuple[str, ...]  # what speaks against the others
    cause: str = "the service was cut off"
    stalled: bool = False  # it did not end

    @property
    def notice(self) -> str:
        """In words."""
        what = "" if self.written is None else f" of {self.written.name!r}, cue {self.written.cue!r},"
        reported = f"{self.cause} while the show{what} was {self.show}"
        if self.show is ShowPhase.COUNTDOWN:
            return f"{reported}: it does not start by itself"
        if self.offers:
            reported += f": {' or '.join(self.offers)} can be ordered"
        absent = [f"{one.id}: {one.text}" for one in self.vehicles if not one.waits]
        return "; ".join([reported, *absent, *self.problems])


def mismatches(
    found: Interruption, frame: Mapping[str, float], system_ids: Mapping[VehicleId, int]
) -> list[str]:
    """What keeps the record from being believed under this configuration, in words."""
    wrong = []
    if dict(found.frame) != dict(frame):
        wrong.append("show_frame is another than when it was cut off: places of the record mean nothing")
    for name, before in found.vehicles.items():
        now = system_ids.get(name)
        if now is None:
            wrong.append(f"{name} was in the air, and is not in this configuration")
        elif now != before.system_id:
            wrong.append(f"{name} had system id {before.system_id}, and has {now} in this configuration")
    return wrong


def is_left_alone(before: Phase, mode: Mode, setpoint_loss_action: str, *, in_failsafe: bool) -> bool:
    """Whether a mode is one in which our end, and no pilot, left a vehicle.

    Args:
        before: its phase when control ended.
        mode: now.
        setpoint_loss_action: see `gcs.config.schema.OperationSettings`.
        in_failsafe: whether its autopilot reports a failsafe. With "descend" it flies in a pilot's mode, or
            lands where it cannot; only the failsafe tells these from a pilot.
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


def left_by(cause: str, mode: Mode) -> str:
    """Why a vehicle that this station flew is in a mode of its autopilot's, in words."""
    return f"{cause}; in mode {mode} by the setpoint-loss failsafe"


def remaining(
    name: VehicleId,
    before: Before,
    phase: Phase,
    mode: Mode,
    loss_action: str,
    *,
    in_failsafe: bool = False,
    taken_again: bool = False,
) -> Remaining:
    """What is known of one vehicle now.

    Args:
        name: of the vehicle.
        before: what it was when control ended.
        phase: now.
        mode: now.
        loss_action: `operation.setpoint_loss_action`.
        in_failsafe: whether its autopilot reports a failsafe.
        taken_again: this station has controlled it since, and then a pilot or another station took it.
    """
    waits, text = False, f"{phase}"
    if phase is Phase.OFFLINE:
        text = f"was {before.phase}, and has not been heard since"
    elif phase is Phase.STANDBY:
        text = "on the ground"
    elif phase in AIRBORNE:
        waits, text = phase is Phase.HOLD, f"ours again: {phase}"
    elif phase is Phase.PILOT:
        waits = not taken_again and is_left_alone(before.phase, mode, loss_action, in_failsafe=in_failsafe)
        text = f"was {before.phase}, waits in mode {mode}"
        if not waits:
            text = f"in mode {mode}, a pilot may have it: take-control when the pilot agrees"
    return Remaining(name, before.phase, before.pad_m is not None, waits, text)
