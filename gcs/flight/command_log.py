"""Accepted commands, and their outcome for each vehicle."""

import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

from gcs.model.errors import UnknownError
from gcs.model.state import VehicleId
from gcs.service import CALLER, CommandRecord, Outcome, VehicleOutcome

KEPT = 1000


class Listener(Protocol):
    """Is called for every command and outcome; never raises, never waits."""

    def opened(self, record: CommandRecord, who: str) -> None:
        """Called when a command is accepted."""
        ...

    def closed(self, command_id: str, vehicle_id: VehicleId, outcome: Outcome, reason: str) -> None:
        """Called when one vehicle's part of a command has ended."""
        ...


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
        outcomes = {vehicle_id: VehicleOutcome(Outcome.PENDING) for vehicle_id in vehicles}
        outcomes |= {name: VehicleOutcome(Outcome.NOT_INCLUDED, why) for name, why in left_out.items()}
        record = CommandRecord(f"o{self._next}", action, time.time(), outcomes, CALLER.get())
        self._next += 1
        self._records[record.id] = record
        while len(self._records) > KEPT:
            self._records.popitem(last=False)
        if self._listener is not None:
            self._listener.opened(record, CALLER.get())
        return record

    def close(self, command_id: str, vehicle_id: VehicleId, outcome: Outcome, reason: str = "") -> None:
        """Record one vehicle's outcome; only a pending one changes."""
        record = self._records.get(command_id)
        if record is not None and record.outcomes[vehicle_id].outcome is Outcome.PENDING:
            changed = record.outcomes | {vehicle_id: VehicleOutcome(outcome, reason)}
            self._records[command_id] = replace(record, outcomes=changed)
            if self._listener is not None:
                self._listener.closed(command_id, vehicle_id, outcome, reason)

    def closer(self, record: CommandRecord, vehicle_id: VehicleId) -> Callable[[Outcome, str], None]:
        """Return a function that records one vehicle's outcome and reason."""
        return lambda outcome, reason: self.close(record.id, vehicle_id, outcome, reason)

    def newest(self) -> Sequence[CommandRecord]:
        """All kept commands, newest first."""
        return tuple(reversed(self._records.values()))

    def get(self, command_id: str) -> CommandRecord:
        """Return a command's record. Raises: UnknownError."""
        try:
            return self._records[command_id]
        except KeyError:
            raise UnknownError(f"there is no command {command_id}") from None
