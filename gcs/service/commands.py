"""Commands, their callers and their outcomes, and the log of accepted commands."""

import logging
import time
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, replace
from enum import StrEnum
from types import MappingProxyType
from typing import Annotated, Final, Protocol

from pydantic import Field, computed_field

from gcs.model.errors import UnknownError
from gcs.model.settings import PUBLISHED
from gcs.model.state import VehicleId

log = logging.getLogger(__name__)

KEPT: Final = 1000
"""Commands that the log remembers."""

SERVICE: Final = "service"

CALLER: Final[ContextVar[str]] = ContextVar("caller", default=SERVICE)
"""Caller of this task's command: a token's name, `local` without tokens, `service` for automatic commands."""


class ShowAction(StrEnum):
    """A fleet-wide command."""

    START = "start"
    STOP = "stop"  # return and land
    PAUSE = "pause"
    RESUME = "resume"
    ABORT = "abort"  # filtered descent to distinct places, now


class VehicleAction(StrEnum):
    """A command to one vehicle, or (except CONFIRM_DOWN and FIND) to several at once."""

    HOLD = "hold"  # leaves the formation; the autopilot holds position
    JOIN = "join"  # from HOLD back into the formation
    RETURN = "return"  # returns through the filter, and lands
    LAND = "land"  # filtered descent in place
    TAKE_CONTROL = "take-control"  # an airborne vehicle comes under this station's control, in HOLD
    CONFIRM_DOWN = "confirm-down"  # an operator has seen a lost vehicle on the ground
    FIND = "find"  # its lights blink, on the ground


class Outcome(StrEnum):
    """Progress of a command with one vehicle."""

    PENDING = "pending"
    DONE = "done"
    FAILED = "failed"
    NOT_INCLUDED = "not-included"  # the command does not affect it; the reason says why


@dataclass(frozen=True, slots=True)
class VehicleOutcome:
    """One vehicle's part of a command."""

    __pydantic_config__ = PUBLISHED

    outcome: Outcome
    reason: str = ""


@dataclass(frozen=True, slots=True)
class CommandRecord:
    """An accepted command and its outcome for each vehicle."""

    id: str
    action: str
    accepted_unix_time_s: float
    outcomes: dict[VehicleId, VehicleOutcome]
    by: Annotated[
        str,
        Field(description="Name of the token; `local` without tokens, `service` for the service itself."),
    ]

    @computed_field  # type: ignore[prop-decorator]
    @property
    def outcome(self) -> Outcome:
        """Pending while any vehicle is pending, then failed if any vehicle failed, else done."""
        seen = {part.outcome for part in self.outcomes.values()}
        for worst in (Outcome.PENDING, Outcome.FAILED):
            if worst in seen:
                return worst
        return Outcome.DONE


class Listener(Protocol):
    """Is called for every command and outcome; never raises, never waits."""

    def opened(self, record: CommandRecord, caller: str) -> None:
        """Called when a command is accepted."""

    def closed(self, command_id: str, vehicle_id: VehicleId, outcome: Outcome, reason: str) -> None:
        """Called when one vehicle's part of a command has ended."""


class CommandLog:
    """The newest commands; the oldest are dropped first."""

    def __init__(self, listener: Listener | None = None) -> None:
        self._listener = listener
        self._records: OrderedDict[str, CommandRecord] = OrderedDict()
        self._next = 1

    def open(
        self, action: str, vehicles: Iterable[VehicleId], left_out: Mapping[VehicleId, str]
    ) -> CommandRecord:
        """Record a command as pending for `vehicles`, with the reasons of those `left_out`."""
        names = [*vehicles]
        outcomes = {vehicle_id: VehicleOutcome(Outcome.PENDING) for vehicle_id in names}
        outcomes |= {name: VehicleOutcome(Outcome.NOT_INCLUDED, why) for name, why in left_out.items()}
        record = CommandRecord(f"o{self._next}", action, time.time(), outcomes, CALLER.get())
        self._next += 1
        self._records[record.id] = record
        while len(self._records) > KEPT:
            self._records.popitem(last=False)
        if self._listener is not None:
            self._listener.opened(record, CALLER.get())
        if record.by != SERVICE:
            only = names[0] if len(names) == 1 else None
            given = {"action": action, "by": record.by, "count": None if only else len(names)}
            log.info("command", extra={**given, "vehicle": only})
        return record

    def done(
        self,
        action: str,
        vehicles: Collection[VehicleId],
        left_out: Mapping[VehicleId, str] = MappingProxyType({}),
        reason: str = "",
    ) -> CommandRecord:
        """Record a command that is done already. Returns: it, with its outcomes."""
        record = self.open(action, vehicles, left_out)
        for vehicle_id in vehicles:
            self.close(record.id, vehicle_id, Outcome.DONE, reason)
        return self.get(record.id)

    def close(self, command_id: str, vehicle_id: VehicleId, outcome: Outcome, reason: str = "") -> None:
        """Record one vehicle's outcome; only a pending one changes."""
        record = self._records.get(command_id)
        if record is not None and record.outcomes[vehicle_id].outcome is Outcome.PENDING:
            changed = record.outcomes | {vehicle_id: VehicleOutcome(outcome, reason)}
            self._records[command_id] = replace(record, outcomes=changed)
            if self._listener is not None:
                self._listener.closed(command_id, vehicle_id, outcome, reason)

    def include(self, command_id: str, outcomes: Mapping[VehicleId, VehicleOutcome]) -> CommandRecord:
        """Add what other stations report of a command; their own records keep it. Raises: UnknownError."""
        record = self.get(command_id)
        self._records[command_id] = record = replace(record, outcomes={**record.outcomes, **outcomes})
        return record

    def closer(self, record: CommandRecord, vehicle_id: VehicleId) -> Callable[[Outcome, str], None]:
        """Return a function that records one vehicle's outcome and reason."""
        return lambda outcome, reason: self.close(record.id, vehicle_id, outcome, reason)

    def newest(self) -> Sequence[CommandRecord]:
        return tuple(reversed(self._records.values()))

    def get(self, command_id: str) -> CommandRecord:
        try:
            return self._records[command_id]
        except KeyError:
            raise UnknownError(f"there is no command {command_id}") from None
