"""Absent stations: which have ended, and which may have taken over while this one stood still."""

import logging
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Final

from gcs.bus.interface import CONNECTION_S
from gcs.stations.site import SHARES_S, Site

log = logging.getLogger(__name__)

FENCED_S: Final = 1.0
"""An owner that has not received its standby for this time has its vehicles hold."""

ENDED_WITHIN_S: Final = CONNECTION_S / 2.0
"""A connection that closes so soon after a batch is not over a cut bus."""


@dataclass(eq=False)
class Absences:
    """Used once a tick, after its batches were taken. Times are those of the own clock."""

    site: Site
    standbys: Sequence[str]  # stations that take over vehicles of this one
    stall_s: float  # a standby may take over after a longer pause of this station
    _ticked_s: float = -inf
    _arrived_s: dict[str, float] = field(default_factory=dict)  # newest batch of each station
    _after_s: dict[str, float] = field(default_factory=dict)  # the tick before the one that took it
    _ended: dict[str, bool] = field(default_factory=dict)  # of those that are not connected
    _unanswered: set[str] = field(default_factory=set)  # standbys that may have taken over
    _stalled_from: int = 0  # first batch after this station stood still

    def look(self, connected: Collection[str], now_s: float) -> None:
        """`connected`: stations that are present, as far as the bus knows."""
        before_s, self._ticked_s = self._ticked_s, now_s
        self._note_ended(connected, now_s, before_s)
        self._note_stall(now_s, before_s)

    def ended(self, station: str) -> bool:
        """Whether the process of a station that is not received has ended, as far as the bus shows it."""
        return self._ended.get(station, False)

    @property
    def all_answered(self) -> bool:
        """Whether no standby may have taken over: each was received since this station stood still."""
        return not self._unanswered

    def _note_ended(self, connected: Collection[str], now_s: float, before_s: float) -> None:
        """A connection closes at once where a process has ended, and after CONNECTION_S where the bus is cut.

        The newest batch may have arrived right after the tick before the one that took it. Where ticks were
        late nothing is known, and the station counts as cut off. So does a station that, by its
        newest batch, no longer received this one: it may have closed the connection itself.
        """
        for name, station in self.site.stations.items():
            arrived = station.arrived_s != self._arrived_s.get(name, -inf)
            if arrived:
                self._arrived_s[name], self._after_s[name] = station.arrived_s, before_s
            if arrived or name in connected:
                self._ended.pop(name, None)
            elif name not in self._ended:
                soon = now_s - self._after_s.get(name, -inf) < ENDED_WITHIN_S
                self._ended[name] = soon and station.ours_age_s <= SHARES_S

    def _note_stall(self, now_s: float, before_s: float) -> None:
        """Nothing changes with a standby cut off for FENCED_S before: the vehicles hold already."""
        if isfinite(before_s) and now_s - before_s > self.stall_s:
            stations = self.site.stations
            near = {name for name in self.standbys if before_s - stations[name].arrived_s <= FENCED_S}
            if near - self._unanswered:
                stalled_s = round(now_s - before_s, 2)
                log.error("waits_for_standby", extra={"other": min(near), "stalled_s": stalled_s})
            self._unanswered |= near
            self._stalled_from = self.site.sequence + 1
        self._unanswered = {name for name in self._unanswered if not self._has_answered(name, now_s)}

    def _has_answered(self, name: str, now_s: float) -> bool:
        """Whether a standby has received this station since it stood still, or has ended."""
        batch = self.site.stations[name].batch
        if batch is None or name not in self.site.present(now_s):
            return self.ended(name)
        echoes = [echo.sequence for echo in batch.echoes if echo.station == self.site.number]
        return max(echoes, default=0) >= self._stalled_from
