"""The one-way delay to each other station, from echoes of batches: no synchronised clocks are needed."""

from collections import deque
from typing import Final

REMEMBERED: Final = 40
"""Batches sent, whose echoes still count, and echoes of which the median is taken."""


class Delays:
    """Half of the round trip to each of the site's stations, without the time that the echo was held."""

    def __init__(self, stations: int) -> None:
        self._sent_s: dict[int, float] = {}
        self._measured_s = [deque[float](maxlen=REMEMBERED) for _ in range(stations)]
        self._one_way_s = [0.0] * stations

    def sent(self, sequence: int, now_s: float) -> None:
        self._sent_s[sequence] = now_s
        self._sent_s.pop(sequence - REMEMBERED, None)

    def echoed(self, station: int, sequence: int, held_s: float, arrived_s: float) -> None:
        """Note an echo of our batch by the station with that number."""
        sent_s = self._sent_s.get(sequence)
        if sent_s is None or not 0.0 <= held_s <= arrived_s - sent_s:
            return
        measured_s = self._measured_s[station]
        measured_s.append((arrived_s - sent_s - held_s) / 2.0)
        self._one_way_s[station] = sorted(measured_s)[len(measured_s) // 2]

    def one_way_s(self, station: int) -> float:
        """Median of the last measurements; 0 before the first."""
        return self._one_way_s[station]
