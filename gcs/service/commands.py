"""Commands, their callers and their outcomes."""

from contextvars import ContextVar
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from gcs.model.state import VehicleId

CALLER: Final[ContextVar[str]] = ContextVar("caller", default="service")
"""Caller of this task's command: a token's name, `local` without tokens, `service` for automatic commands."""


class ShowAction(StrEnum):
    """A fleet-wide command."""

    START = "start"
    STOP = "stop"  # return and land
    PAUSE = "pause"
    RESUME = "resume"
    ABORT = "abort"  # filtered descent to distinct places, now


class VehicleAction(StrEnum):
    """A command to one vehicle, or (except CONFIRM_DOWN) to several at once."""

    HOLD = "hold"  # leaves the formation; the autopilot holds position
    JOIN = "join"  # from HOLD back into the formation
    RETURN = "return"  # returns through the filter, and lands
    LAND = "land"  # filtered descent in place
    TAKE_CONTROL = "take-control"  # an airborne vehicle comes under this station's control, in HOLD
    CONFIRM_DOWN = "confirm-down"  # an operator has seen a lost vehicle on the ground


class Outcome(StrEnum):
    """Progress of a command with one vehicle."""

    PENDING = "pending"
    DONE = "done"
    FAILED = "failed"
    NOT_INCLUDED = "not-included"  # the command does not affect it; the reason says why


@dataclass(frozen=True, slots=True)
class VehicleOutcome:
    """One vehicle's part of a command."""

    outcome: Outcome
    reason: str = ""


@dataclass(frozen=True, slots=True)
class CommandRecord:
    """An accepted command and its outcome for each vehicle."""

    id: str
    action: str
    accepted_time_s: float  # Unix time
    outcomes: dict[VehicleId, VehicleOutcome]
    by: str  # see CALLER

    @property
    def outcome(self) -> Outcome:
        """PENDING while any vehicle is pending, then FAILED if any failed, otherwise DONE."""
        seen = {part.outcome for part in self.outcomes.values()}
        for worst in (Outcome.PENDING, Outcome.FAILED):
            if worst in seen:
                return worst
        return Outcome.DONE
