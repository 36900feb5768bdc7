"""What can be ordered, by whom it was, and what became of it."""

from contextvars import ContextVar
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from gcs.model.state import VehicleId

WHO: Final[ContextVar[str]] = ContextVar("who", default="service")
"""Who orders, in this task: a token's name, `local` without tokens, `service` when nobody has called."""


class ShowAction(StrEnum):
    """What can be asked of the whole show."""

    START = "start"
    STOP = "stop"  # come home and land
    PAUSE = "pause"
    RESUME = "resume"
    ABORT = "abort"  # filtered descent to distinct places, now


class VehicleAction(StrEnum):
    """What can be asked of one vehicle, and (but for CONFIRM_DOWN) of several at once."""

    HOLD = "hold"  # leaves the formation, the autopilot holds position
    JOIN = "join"  # from HOLD back into the formation
    RETURN = "return"  # home through the filter, and land
    LAND = "land"  # filtered descent where it is
    TAKE_CONTROL = "take-control"  # a vehicle in the air comes under this station's control, in HOLD
    CONFIRM_DOWN = "confirm-down"  # an operator has seen a lost vehicle on the ground


class Outcome(StrEnum):
    """How far an order has got with one vehicle."""

    PENDING = "pending"
    DONE = "done"
    FAILED = "failed"
    NOT_INCLUDED = "not-included"  # the order does not touch it; the reason says why


@dataclass(frozen=True, slots=True)
class VehicleOutcome:
    """One vehicle's part of an order."""

    outcome: Outcome
    reason: str = ""


@dataclass(frozen=True, slots=True)
class CommandRecord:
    """An accepted order and what has become of it, vehicle by vehicle."""

    id: str
    action: str
    accepted_time_s: float  # Unix time
    outcomes: dict[VehicleId, VehicleOutcome]
    by: str  # see WHO

    @property
    def outcome(self) -> Outcome:
        """PENDING while any vehicle is, then FAILED if any has, else DONE."""
        seen = {part.outcome for part in self.outcomes.values()}
        for worst in (Outcome.PENDING, Outcome.FAILED):
            if worst in seen:
                return worst
        return Outcome.DONE
