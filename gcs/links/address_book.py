"""Addresses of the configured systems, with duplicates and unknown systems. No I/O but the log."""

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import Enum, auto
from typing import Final, NamedTuple

import numpy as np

from gcs.links.endpoints.ports import Datagrams
from gcs.links.link import Address, Counters
from gcs.mavlink.kernels import DATAGRAM, SYSTEM, Whole
from gcs.model.state import Array, Mask

log = logging.getLogger(__name__)

SILENT_AFTER_S = 3.0
"""A system without frames for this long counts as gone: nothing is sent to it, and its address may change."""

CONFLICT_KEPT_S = 5.0
"""A duplicate is reported until it has been silent this long."""

_STRANGERS_LOGGED_MAX: Final = 64
NOWHERE: Final = -1
"""The source of a vehicle without an address."""


class Verdict(Enum):
    """What to do with a frame: the first three are accepted, the others dropped."""

    KNOWN = auto()
    FIRST = auto()  # first frame of this system
    MOVED = auto()  # received from another address after a silence
    DUPLICATE = auto()  # its system id is in use at another address
    NEW_DUPLICATE = auto()  # a duplicate, for the first time
    STRANGER = auto()  # its system id is not configured


TAKEN = frozenset({Verdict.KNOWN, Verdict.FIRST, Verdict.MOVED})


class _Conflict(NamedTuple):
    text: str
    received_s: float


class AddressBook:
    """One address for each system. Used on the loop's thread."""

    def __init__(self, system_ids: Iterable[int]) -> None:
        self._configured = frozenset(system_ids)
        self._addresses: dict[int, Address] = {}
        self._received_s: dict[int, float] = {}
        self._conflicts: dict[int, _Conflict] = {}

    def address(self, system_id: int) -> Address | None:
        """Where frames for this system go; None before its first frame."""
        return self._addresses.get(system_id)

    def receive(self, system_id: int, address: Address, now_s: float) -> Verdict:
        """Record that a checked frame of `system_id` arrived from `address`, and return the verdict."""
        known = self._addresses.get(system_id)
        if known == address:
            self._received_s[system_id] = now_s
            return Verdict.KNOWN
        if system_id not in self._configured:
            return Verdict.STRANGER
        if known is not None and now_s - self._received_s[system_id] <= SILENT_AFTER_S:
            return self._conflict(system_id, known, address, now_s)
        self._addresses[system_id] = address
        self._received_s[system_id] = now_s
        self._conflicts.pop(system_id, None)
        return Verdict.FIRST if known is None else Verdict.MOVED

    def forget(self, address: Address) -> None:
        """Remove an address whose connection ended. Its systems may come back from any address at once."""
        for system_id in [known for known, at in self._addresses.items() if at == address]:
            del self._addresses[system_id]

    def _conflict(self, system_id: int, known: Address, other: Address, now_s: float) -> Verdict:
        text = f"system id {system_id} at {known} and at {other}"
        before = self._conflicts.get(system_id)
        self._conflicts[system_id] = _Conflict(text, now_s)
        is_new = before is None or before.text != text or now_s - before.received_s > CONFLICT_KEPT_S
        return Verdict.NEW_DUPLICATE if is_new else Verdict.DUPLICATE

    def conflicts(self, now_s: float) -> dict[int, str]:
        """Systems with recent frames from two addresses, both named in the text."""
        return {
            system_id: conflict.text
            for system_id, conflict in self._conflicts.items()
            if now_s - conflict.received_s <= CONFLICT_KEPT_S
        }


class Addresses:
    """The source of every vehicle, rows as on the link.

    Attributes:
        source: (n,) where each vehicle's frames go, see `source_of`; NOWHERE: none.
        received_s: (n,) arrival of its newest frame, -inf before.
    """

    def __init__(
        self,
        name: str,
        system_ids: Sequence[int],
        address_of: Callable[[int], Address],
        counters: Counters,
        clock: Callable[[], float],
    ) -> None:
        self.source: Whole = np.full(len(system_ids), NOWHERE, np.int64)
        self.received_s: Array = np.full(len(system_ids), -np.inf)
        self._name = name
        self._address_of = address_of
        self._counters = counters
        self._clock = clock
        self._address_book = AddressBook(system_ids)
        self._row_of = np.full(256, NOWHERE, np.int64)
        self._row_of[list(system_ids)] = np.arange(len(system_ids))
        self._strangers: set[tuple[int, str]] = set()

    def conflicts(self) -> Mapping[int, str]:
        """System ids with recent frames from two addresses, both named in the text."""
        return self._address_book.conflicts(self._clock())

    def address(self, system_id: int) -> Address | None:
        """Source of this system's newest frame; None before the first."""
        return self._address_book.address(system_id)

    def forget(self, sources: Iterable[int]) -> None:
        """Remove sources whose connection ended. Their systems may come back from any address at once."""
        for source in sources:
            self.source[self.source == source] = NOWHERE
            self._address_book.forget(self._address_of(source))

    def one_per_source(self) -> Whole:
        """(k,) rows of known vehicles, one for each address, though several may share it."""
        _, rows = np.unique(self.source, return_index=True)
        known: Whole = rows[self.source[rows] != NOWHERE]
        return known

    def judge(self, frames: Whole, arrived: Datagrams) -> tuple[Whole, Mask]:
        """The row of every frame (k,), and whether it is accepted: unknown systems and duplicates are not."""
        rows = self._row_of[frames[:, SYSTEM]]
        source = arrived.source[frames[:, DATAGRAM]]
        time_s = arrived.time_s[frames[:, DATAGRAM]]
        taken = (rows != NOWHERE) & (self.source[rows] == source)
        np.maximum.at(self.received_s, rows[taken], time_s[taken])
        for odd in np.flatnonzero(~taken).tolist():
            row, system_id = int(rows[odd]), int(frames[odd, SYSTEM])
            taken[odd] = self._judge_new(row, system_id, int(source[odd]), float(time_s[odd]))
        return rows, taken

    def _judge_new(self, row: int, system_id: int, source: int, time_s: float) -> bool:
        """Let the address book judge a frame from an address that is not known as this system's."""
        address = self._address_of(source)
        known = self._address_book.address(system_id)
        if known is not None:  # the address book has not seen the frames from the known address
            self._address_book.receive(system_id, known, float(self.received_s[row]))
        verdict = self._address_book.receive(system_id, address, time_s)
        self._note(verdict, system_id, address)
        if verdict not in TAKEN:
            return False
        self.source[row] = source
        self.received_s[row] = max(time_s, self.received_s[row])
        return True

    def _note(self, verdict: Verdict, system_id: int, address: Address) -> None:
        """Count frames that were not accepted, and log every change once."""
        about = {"link": self._name, "system_id": system_id, "address": str(address)}
        if verdict is Verdict.FIRST:
            log.info("vehicle_connected", extra=about)
        elif verdict is Verdict.MOVED:
            log.warning("vehicle_moved", extra=about)
        elif verdict is Verdict.STRANGER:
            self._counters.strangers += 1
            stranger = (system_id, address.host)
            if stranger not in self._strangers and len(self._strangers) < _STRANGERS_LOGGED_MAX:
                self._strangers.add(stranger)
                log.info("stranger_ignored", extra=about)
        elif verdict in (Verdict.DUPLICATE, Verdict.NEW_DUPLICATE):
            self._counters.duplicates += 1
            if verdict is Verdict.NEW_DUPLICATE:
                cause = self._address_book.conflicts(self._clock()).get(system_id, "")
                log.error("duplicate_system_id", extra=about | {"cause": cause})
