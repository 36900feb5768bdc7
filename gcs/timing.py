"""The control loop's clock, and how well it is kept."""

import asyncio
from collections import deque
from collections.abc import AsyncIterator

import numpy as np

from gcs.service import TickView

REMEMBERED = 2000


async def ticks(period_s: float) -> AsyncIterator[tuple[float, float, int]]:
    """Yield (now, due, missed) once a period of the loop's clock; late ticks are dropped, not made up.

    `due` is when the tick should have come, `missed` how many were dropped just before it.
    """
    loop = asyncio.get_running_loop()
    start_s, index = loop.time(), 0
    missed = 0
    while True:
        now_s = loop.time()
        yield now_s, start_s + index * period_s, missed
        passed = int((loop.time() - start_s) / period_s)
        missed = max(0, passed - index)
        index = max(index, passed) + 1  # whole numbers: no drift, no double tick
        await asyncio.sleep(start_s + index * period_s - loop.time())


class TickClock:
    """Counts ticks and remembers how long and how late the last ones were."""

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self.count = 0
        self.missed = 0
        self.gap_s = 0.0  # between the beginnings of the last two ticks
        self._began_s = 0.0
        self._duration_s: deque[float] = deque(maxlen=REMEMBERED)
        self._lateness_s: deque[float] = deque(maxlen=REMEMBERED)
        self._summary = TickView(rate_hz, 0, 0, 0.0, 0.0, 0.0)

    def note(self, began_s: float, duration_s: float, lateness_s: float, missed: int) -> None:
        """Take one tick into account, which began at `began_s` of the loop's clock."""
        self.gap_s = began_s - self._began_s if self.count else 0.0
        self._began_s = began_s
        self.count += 1
        self.missed += missed
        self._duration_s.append(duration_s)
        self._lateness_s.append(lateness_s)

    def summary(self) -> TickView:
        """Percentiles over the last ticks; recomputed once a second, as they are for people."""
        if self.count % max(1, round(self.rate_hz)) == 1:
            duration_ms = np.array(self._duration_s) * 1e3
            p50, p99 = np.percentile(duration_ms, (50, 99))
            late = np.percentile(np.array(self._lateness_s) * 1e3, 99)
            self._summary = TickView(
                self.rate_hz, self.count, self.missed, float(p50), float(p99), float(late)
            )
        return self._summary
