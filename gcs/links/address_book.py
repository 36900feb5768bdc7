"""Senders: addresses of the configured systems, their components, duplicates, unknown systems.

No I/O but the log.
"""

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import InitVar, dataclass
from typing import Final

import numpy as np

from gcs.links.continuity import NO_CLOCK, Counted, follows, is_silent
from gcs.links.endpoints.ports import Datagrams
from gcs.links.link import Address, Counters
from gcs.links.odd_frames import odd_frames
from gcs.links.senders import ANY, AUTOPILOTS, NOWHERE, Senders, known_sources
from gcs.mavlink.framing import HEARTBEAT
from gcs.mavlink.kernels import DATAGRAM, MESSAGE, SYSTEM, Whole
from gcs.mavlink.reports import SILENT_AFTER_S
from gcs.model.state import Array

log = logging.getLogger(__name__)

CONFLICT_KEPT_S = 5.0
"""A duplicate is reported until it has been silent this long."""

BOTH_S: Final = 1.0
"""Where an address goes on for so long beside another, both send. What was on its way when the one ended
arrives within this time.
"""

UNLIKE_MAX: Final = 3
"""A single frame may be late. Where so many do not follow the autopilot's, another one sends."""

JUDGED_OF_EACH: Final = 4
"""Frames of one sender that are judged one by one in a read; the rest is as the last one."""

_STRANGERS_LOGGED_MAX: Final = 64


@dataclass(slots=True)
class _Newcomer:
    """A second address of a system.

    Attributes:
        text: both addresses in words.
        since_s, newest_s: arrival of its first and of its newest frame.
        unlike: number of its frames that do not follow the autopilot's.
    """

    source: int
    text: str
    since_s: float
    newest_s: float
    unlike: int = 0


@dataclass(eq=False)
class Addresses:
    """The source of every vehicle's autopilot, rows as on the link.

    Attributes:
        source: (n,) where each vehicle's frames go, see `source_of`; NOWHERE: none.
        received_s: (n,) arrival of its autopilot's newest frame, -inf before.
    """

    name: str
    system_ids: InitVar[Sequence[int]]
    address_of: Callable[[int], Address]
    counters: Counters
    clock: Callable[[], float]

    def __post_init__(self, system_ids: Sequence[int]) -> None:
        n, self._system_ids = len(system_ids), tuple(system_ids)
        self.source: Whole = np.full(n, NOWHERE, np.int64)
        self._senders = Senders.unknown(n)
        self.received_s: Array = self._senders.received_s
        self._conflicts: dict[int, tuple[str, float]] = {}  # by row: the text, and when it was last true
        self._newcomers: dict[int, _Newcomer] = {}  # by row: the newest other address
        self._moved_s = np.full(n, -np.inf)  # when its address changed last
        self._row_of = np.full(256, NOWHERE, np.int64)
        self._row_of[list(system_ids)] = np.arange(n)
        self._strangers: set[tuple[int, str]] = set()

    def conflicts(self) -> Mapping[int, str]:
        """Rows with recent frames of their system id from two addresses, both named in the text."""
        since_s = self.clock() - CONFLICT_KEPT_S
        return {row: text for row, (text, time_s) in self._conflicts.items() if time_s >= since_s}

    def without_autopilot(self) -> Mapping[int, tuple[int, bool]]:
        """Rows of which other components are received, but no autopilot.

        Returns: by row the component's id, and whether its heartbeat is an autopilot's.
        """
        since_s, (component, time_s) = self.clock() - SILENT_AFTER_S, self._senders.parts
        rows = np.flatnonzero((self.received_s < since_s) & (time_s[:, ANY] >= since_s))
        components: dict[int, tuple[int, bool]] = {}
        for row in rows.tolist():
            is_one = bool(time_s[row, AUTOPILOTS] >= since_s)
            components[row] = int(component[row, AUTOPILOTS if is_one else ANY]), is_one
        return components

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
        addressed: Whole = rows[self.source[rows] != NOWHERE]
        return addressed

    def judge(self, frames: Whole, arrived: Datagrams) -> tuple[Whole, Whole, Array]:
        """The accepted frames (k,), their rows and their arrival: unknown systems and duplicates are not."""
        source = arrived.source
        rows, taken, odd, arrived_s = known_sources(
            arrived.data, frames, source, arrived.time_s, self._row_of, self.source, self._senders
        )
        if taken.all():
            return frames, rows, arrived_s
        at, none = odd[:, 0], np.zeros(len(odd), np.bool_)
        groups = odd_frames(frames[at], source, rows[at], none)
        self.counters.strangers += groups.strangers
        self.counters.duplicates += groups.others
        for group, first in enumerate(at[groups.first].tolist()):
            members, row = np.flatnonzero(groups.group == group), int(rows[first])
            sender = int(source[frames[first, DATAGRAM]])
            if row == NOWHERE:
                self._note_strangers(int(frames[first, SYSTEM]), sender, len(members))
                continue
            judged, rest, accepted = members[:JUDGED_OF_EACH], at[members[JUDGED_OF_EACH:-1]], False
            if len(members) > JUDGED_OF_EACH:
                judged = np.append(judged, members[-1])
            for place, number, boot_ms in odd[judged].tolist():
                is_beat = bool(frames[place, MESSAGE] == HEARTBEAT)
                counted, time_s = Counted(number, boot_ms), float(arrived_s[place])
                taken[place] = accepted = self._judge_new(row, sender, time_s, counted, is_beat=is_beat)
            taken[rest] = accepted
            self.counters.duplicates += 0 if accepted else len(rest)
        return frames[taken], rows[taken], arrived_s[taken]

    def _note_strangers(self, system_id: int, source: int, count: int) -> None:
        self.counters.strangers += count
        address = self.address_of(source)
        stranger = (system_id, address.host)
        if stranger not in self._strangers and len(self._strangers) < _STRANGERS_LOGGED_MAX:
            self._strangers.add(stranger)
            about = {"link": self.name, "system_id": system_id, "address": str(address)}
            log.info("stranger_ignored", extra=about)

    def _judge_new(self, row: int, source: int, time_s: float, counted: Counted, *, is_beat: bool) -> bool:
        """Whether an autopilot's frame from an address new for its system is accepted; changes are logged."""
        senders, address = self._senders, int(self.source[row])
        goes_on = follows(senders.continuity, row, counted, time_s)
        if not self._is_same(row, address, source):
            event, level = "vehicle_connected", logging.INFO
            if address != NOWHERE:
                is_gone = time_s - senders.received_s[row] > SILENT_AFTER_S
                is_first = is_beat and not senders.confirmed[row]  # what was there before is no autopilot
                if not (is_gone or is_first or self._moves(row, source, time_s, counted, goes_on=goes_on)):
                    return False
                event, level, self._moved_s[row] = "vehicle_moved", logging.WARNING, time_s
            self._log(level, event, row, source)
            self._conflicts.pop(row, None)
            self._newcomers.pop(row, None)
            senders.confirmed[row] &= goes_on
        self.source[row] = source
        senders.confirmed[row] |= is_beat
        senders.received_s[row] = max(time_s, senders.received_s[row])
        senders.continuity.sequence[row] = counted.number
        senders.continuity.sequence_s[row] = time_s
        return True

    def _is_same(self, row: int, address: int, source: int) -> bool:
        """Whether two sources are one address, as those of a serial port are that was opened again."""
        newcomer = self._newcomers.get(row)
        if address == NOWHERE or (newcomer is not None and newcomer.source == source):
            return False
        return address == source or self.address_of(address) == self.address_of(source)

    def _log(self, level: int, event: str, row: int, source: int, **also: str) -> None:
        about = {
            "link": self.name,
            "system_id": self._system_ids[row],
            "address": str(self.address_of(source)),
        }
        log.log(level, event, extra={**about, **also})

    def _moves(self, row: int, source: int, time_s: float, counted: Counted, *, goes_on: bool) -> bool:
        """Whether the autopilot sends from another source now; a duplicate is reported instead.

        It does when the known source has fallen silent, and a message goes on with boot clock and sequence
        where that ended. While both send, or the sequence is another one, nothing is believed.
        """
        newcomer, continuity = self._newcomers.get(row), self._senders.continuity
        if newcomer is None or newcomer.source != source or time_s - newcomer.newest_s > CONFLICT_KEPT_S:
            at, also_at = self.address(row), self.address_of(source)
            text = f"system id {self._system_ids[row]} at {at} and at {also_at}"
            newcomer = self._newcomers[row] = _Newcomer(source, text, time_s, time_s)
        newcomer.newest_s = time_s
        both_send = continuity.sequence_s[row] - newcomer.since_s > BOTH_S
        if goes_on and not both_send:
            has_clock, is_another = counted.boot_ms != NO_CLOCK, newcomer.unlike >= UNLIKE_MAX
            return has_clock and not is_another and is_silent(continuity, row, time_s)
        if time_s - self._moved_s[row] > BOTH_S:  # else it was on its way when the address changed
            newcomer.unlike += 1
            self._report(row, newcomer)
        return False

    def _report(self, row: int, newcomer: _Newcomer) -> None:
        """Note a duplicate, and log it when it is new."""
        text, time_s = newcomer.text, newcomer.newest_s
        self.counters.duplicates += 1
        _, before_s = self._conflicts.get(row, ("", -np.inf))
        self._conflicts[row] = text, time_s
        if time_s - before_s > CONFLICT_KEPT_S:  # once, whatever addresses a flood has
            self._log(logging.ERROR, "duplicate_system_id", row, newcomer.source, cause=text)
