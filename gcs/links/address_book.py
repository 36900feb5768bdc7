"""Addresses of the configured systems, with duplicates and unknown systems. No I/O but the log."""

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import InitVar, dataclass
from typing import Final

import numpy as np

from gcs.links.endpoints.ports import Datagrams
from gcs.links.link import Address, Counters
from gcs.links.odd_frames import odd_frames
from gcs.mavlink.kernels import DATAGRAM, SYSTEM, Whole
from gcs.mavlink.reports import SILENT_AFTER_S
from gcs.model.jit import kernel
from gcs.model.state import Array, Mask

log = logging.getLogger(__name__)

CONFLICT_KEPT_S = 5.0
"""A duplicate is reported until it has been silent this long."""

_STRANGERS_LOGGED_MAX: Final = 64
NOWHERE: Final = -1
"""The source of a vehicle without an address."""


@kernel
def known_sources(
    frames: Whole, source: Whole, time_s: Array, row_of: Whole, known: Whole, received_s: Array
) -> tuple[Whole, Mask, bool, Array]:
    """Frames that came from the known sources of their systems.

    Args:
        frames: (k, FRAME_COLUMNS).
        source: (m,) of each datagram.
        time_s: (m,) of its arrival.
        row_of: (256,) the row of each system id, or NOWHERE.
        known: (n,) the source of each row, or NOWHERE.
        received_s: (n,) arrival of the newest frame of each row, written.

    Returns: (k,) the row of each, (k,) whether its source is known, whether all are, (k,) times of arrival.
    """
    rows, taken, all_known = np.empty(len(frames), np.int64), np.empty(len(frames), np.bool_), True
    arrived_s = np.empty(len(frames))
    for k in range(len(frames)):
        datagram, row = frames[k, DATAGRAM], row_of[frames[k, SYSTEM]]
        rows[k], taken[k] = row, row != NOWHERE and known[row] == source[datagram]
        arrived_s[k] = time_s[datagram]
        if taken[k]:
            received_s[row] = max(time_s[datagram], received_s[row])
        all_known = all_known and taken[k]
    return rows, taken, all_known, arrived_s


@dataclass(eq=False)
class Addresses:
    """The source of every vehicle, rows as on the link.

    Attributes:
        source: (n,) where each vehicle's frames go, see `source_of`; NOWHERE: none.
        received_s: (n,) arrival of its newest frame, -inf before.
    """

    name: str
    system_ids: InitVar[Sequence[int]]
    address_of: Callable[[int], Address]
    counters: Counters
    clock: Callable[[], float]

    def __post_init__(self, system_ids: Sequence[int]) -> None:
        self.source: Whole = np.full(len(system_ids), NOWHERE, np.int64)
        self.received_s: Array = np.full(len(system_ids), -np.inf)
        self._conflicts: dict[int, tuple[str, float]] = {}  # by row: the text, and when it was last true
        self._row_of = np.full(256, NOWHERE, np.int64)
        self._row_of[list(system_ids)] = np.arange(len(system_ids))
        self._strangers: set[tuple[int, str]] = set()

    def conflicts(self) -> Mapping[int, str]:
        """Rows with recent frames of their system id from two addresses, both named in the text."""
        since_s = self.clock() - CONFLICT_KEPT_S
        return {row: text for row, (text, time_s) in self._conflicts.items() if time_s >= since_s}

    def address(self, row: int) -> Address | None:
        """Source of the vehicle's newest frame; None before the first."""
        source = int(self.source[row])
        return None if source == NOWHERE else self.address_of(source)

    def forget(self, sources: Iterable[int]) -> None:
        """Remove sources whose connection ended. Their systems may come back from any address at once."""
        for source in sources:
            self.source[self.source == source] = NOWHERE

    def one_per_source(self) -> Whole:
        """(k,) rows of known vehicles, one for each address, though several may share it."""
        _, rows = np.unique(self.source, return_index=True)
        known: Whole = rows[self.source[rows] != NOWHERE]
        return known

    def judge(self, frames: Whole, arrived: Datagrams) -> tuple[Whole, Whole, Array]:
        """The accepted frames (k,), their rows and their arrival: unknown systems and duplicates are not."""
        source, time_s = arrived.source, arrived.time_s
        rows, taken, all_known, arrived_s = known_sources(
            frames, source, time_s, self._row_of, self.source, self.received_s
        )
        if all_known:
            return frames, rows, arrived_s
        odd = odd_frames(frames, source, rows, taken)
        self.counters.strangers += odd.strangers
        self.counters.duplicates += odd.others
        for group, (first, count) in enumerate(zip(odd.first.tolist(), odd.size.tolist(), strict=True)):
            row, system_id, datagram = (
                int(rows[first]),
                int(frames[first, SYSTEM]),
                int(frames[first, DATAGRAM]),
            )
            if self._judge_new(row, system_id, int(source[datagram]), float(time_s[datagram]), count):
                taken |= odd.group == group
        return frames[taken], rows[taken], arrived_s[taken]

    def _judge_new(self, row: int, system_id: int, source: int, time_s: float, count: int) -> bool:
        """Whether `count` frames from an address new for their system are accepted. Each change is logged."""
        address = self.address_of(source)
        about = {"link": self.name, "system_id": system_id, "address": str(address)}
        if row == NOWHERE:
            self.counters.strangers += count
            stranger = (system_id, address.host)
            if stranger not in self._strangers and len(self._strangers) < _STRANGERS_LOGGED_MAX:
                self._strangers.add(stranger)
                log.info("stranger_ignored", extra=about)
            return False
        known = self.address(row)
        if known is None:
            log.info("vehicle_connected", extra=about)
        elif known != address and time_s - self.received_s[row] <= SILENT_AFTER_S:
            text = f"system id {system_id} at {known} and at {address}"
            self.counters.duplicates += count
            _, before_s = self._conflicts.get(row, ("", -np.inf))
            self._conflicts[row] = text, time_s
            if time_s - before_s > CONFLICT_KEPT_S:  # once, whatever addresses a flood has
                log.error("duplicate_system_id", extra={**about, "cause": text})
            return False
        elif known != address:
            log.warning("vehicle_moved", extra=about)
        if known != address:
            self._conflicts.pop(row, None)
        self.source[row] = source
        self.received_s[row] = max(time_s, self.received_s[row])
        return True
