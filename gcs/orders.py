"""Accepted orders and what became of them, vehicle by vehicle."""

import time
from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from gcs.errors import UnknownError
from gcs.service import WHO, OrderRecord, Outcome, VehicleOutcome
from gcs.state import VehicleId

KEPT = 1000


class OrderBook:
    """The last orders, oldest forgotten first."""

    def __init__(self) -> None:
        self._records: OrderedDict[str, OrderRecord] = OrderedDict()
        self._next = 1

    def open(
        self, action: str, vehicles: Iterable[VehicleId], left_out: Mapping[VehicleId, str]
    ) -> OrderRecord:
        """Note an order: pending for `vehicles`, not including those `left_out` for the reasons given."""
        outcomes = {vehicle_id: VehicleOutcome(Outcome.PENDING) for vehicle_id in vehicles}
        outcomes |= {name: VehicleOutcome(Outcome.NOT_INCLUDED, why) for name, why in left_out.items()}
        record = OrderRecord(f"o{self._next}", action, time.time(), outcomes, WHO.get())
        self._next += 1
        self._records[record.id] = record
        while len(self._records) > KEPT:
            self._records.popitem(last=False)
        return record

    def close(self, order_id: str, vehicle_id: VehicleId, outcome: Outcome, reason: str = "") -> None:
        """Note one vehicle's outcome, once: only what is pending changes."""
        record = self._records.get(order_id)
        if record is not None and record.outcomes[vehicle_id].outcome is Outcome.PENDING:
            changed = record.outcomes | {vehicle_id: VehicleOutcome(outcome, reason)}
            self._records[order_id] = replace(record, outcomes=changed)

    def newest(self) -> Sequence[OrderRecord]:
        """All that are kept, the newest first."""
        return tuple(reversed(self._records.values()))

    def get(self, order_id: str) -> OrderRecord:
        """The record as it stands. Raises: UnknownError."""
        try:
            return self._records[order_id]
        except KeyError:
            raise UnknownError(f"there is no order {order_id}") from None
