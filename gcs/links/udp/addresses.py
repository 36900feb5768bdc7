"""Addresses of the vehicles: frames are checked against the address book in batches. No I/O but the log."""

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.links.address_book import TAKEN, Address, AddressBook, Verdict
from gcs.links.counters import Counters
from gcs.links.udp.sockets import Datagrams, host_of, port_of, socket_of
from gcs.mavlink.kernels import DATAGRAM, SYSTEM, Whole
from gcs.model.state import Array

log = logging.getLogger(__name__)

_STRANGERS_LOGGED_MAX: Final = 64
_NOWHERE: Final = -1


class Addresses:
    """The source of every vehicle, rows as on the link.

    Attributes:
        source: (n,) where each vehicle's frames go, see `sockets.source_of`; -1: no frame yet.
        received_s: (n,) arrival of its newest frame, -inf before.
    """

    def __init__(
        self, name: str, system_ids: Sequence[int], counters: Counters, clock: Callable[[], float]
    ) -> None:
        self.source: Whole = np.full(len(system_ids), _NOWHERE, np.int64)
        self.received_s: Array = np.full(len(system_ids), -np.inf)
        self._name = name
        self._counters = counters
        self._clock = clock
        self._address_book = AddressBook(system_ids)
        self._row_of = np.full(256, _NOWHERE, np.int64)
        self._row_of[list(system_ids)] = np.arange(len(system_ids))
        self._strangers: set[tuple[int, str]] = set()

    def conflicts(self) -> Mapping[int, str]:
        """System ids with recent frames from two addresses, both named in the text."""
        return self._address_book.conflicts(self._clock())

    def address(self, system_id: int) -> Address | None:
        """Source of this system's newest frame; None before the first."""
        return self._address_book.address(system_id)

    def everybody(self) -> Whole:
        """(k,) rows of known vehicles, one for each address, though several may share it."""
        _, rows = np.unique(self.source, return_index=True)
        telemetry: Whole = rows[self.source[rows] != _NOWHERE]
        return telemetry

    def judge(self, frames: Whole, arrived: Datagrams) -> tuple[Whole, NDArray[np.bool_]]:
        """The row of every frame (k,), and whether it is accepted: unknown systems and duplicates are not."""
        rows = self._row_of[frames[:, SYSTEM]]
        source = arrived.source[frames[:, DATAGRAM]]
        time_s = arrived.time_s[frames[:, DATAGRAM]]
        taken = (rows != _NOWHERE) & (self.source[rows] == source)
        np.maximum.at(self.received_s, rows[taken], time_s[taken])
        for odd in np.flatnonzero(~taken).tolist():
            row, system_id = int(rows[odd]), int(frames[odd, SYSTEM])
            taken[odd] = self._ask(row, system_id, int(source[odd]), float(time_s[odd]))
        return rows, taken

    def _ask(self, row: int, system_id: int, source: int, time_s: float) -> bool:
        """Let the address book judge a frame from an address that is not known as this system's."""
        address = Address(host_of(source), port_of(source), socket_of(source))
        known = self._address_book.address(system_id)
        if known is not None:  # the address book has not seen the frames from the known address
            self._address_book.hear(system_id, known, float(self.received_s[row]))
        verdict = self._address_book.hear(system_id, address, time_s)
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
