"""The control loop's clock, its timing statistics, and garbage collection between its ticks."""

import asyncio
import gc
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager
from typing import Final

import numpy as np

from gcs.service import Scheduling, TickView
from gcs.service.histograms import TickHistogram

REMEMBERED = 2000

BOUNDS_S = (0.0005, 0.001, 0.002, 0.003, 0.005, 0.0075, 0.01, 0.015, 0.02, 0.03, 0.05, 0.1, 0.2, 0.5)


SHIFT_MAX: Final = 0.05
"""Of the period: so much earlier or later a tick comes on the way to another phase."""


async def ticks(
    period_s: float, desired_s: Callable[[], float | None] = lambda: None
) -> AsyncIterator[tuple[float, float, int]]:
    """Yield (now, due, missed) once a period of the loop's clock; late ticks are dropped, not made up.

    `due` is when the tick should have come, `missed` how many were dropped just before it. While `desired_s`
    returns a time, the ticks are shifted, a little with each one, until one of them falls on that time.
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
        if (at_s := desired_s()) is not None:
            off_s = (at_s - start_s - index * period_s + period_s / 2) % period_s - period_s / 2
            start_s += min(max(off_s, -SHIFT_MAX * period_s), SHIFT_MAX * period_s)
        await asyncio.sleep(start_s + index * period_s - loop.time())


FULL_S: Final = 60.0
"""Between collections of all generations: they visit every object that was made in flight."""


@contextmanager
def garbage_between_ticks() -> Iterator[Callable[[float], None]]:
    """Keep the garbage collector out of the tick. Yields: a function that does what is due, given the time.

    Young generations are collected as often as the interpreter would, but when the setpoints have left.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    full_s: list[float] = []

    def collect(now_s: float) -> None:
        full_s[:] = full_s or [now_s]
        young, middle, _ = (
            count > most > 0 for count, most in zip(gc.get_count(), gc.get_threshold(), strict=True)
        )
        if now_s - full_s[0] >= FULL_S:
            full_s[0] = now_s
            gc.collect()
        elif young:
            gc.collect(int(middle))

    try:
        yield collect
    finally:
        if was_enabled:
            gc.enable()


class TickClock:
    """Counts ticks, and keeps the durations and delays of the last ones."""

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self.scheduling = Scheduling()
        self.count = 0
        self.missed = 0
        self.gap_s = 0.0  # time between the starts of the last two ticks
        self.late_s = 0.0  # delay of the last tick: started late, or after dropped ones
        self._began_s = 0.0
        self._duration_s: deque[float] = deque(maxlen=REMEMBERED)
        self._lateness_s: deque[float] = deque(maxlen=REMEMBERED)
        self._durations = TickHistogram("gcs_tick_duration_seconds", "How long a tick took.", BOUNDS_S)
        self._latenesses = TickHistogram("gcs_tick_lateness_seconds", "How late a tick began.", BOUNDS_S)
        self._summary = TickView(rate_hz, 0, 0, 0.0, 0.0, 0.0)

    def gap_before(self, now_s: float) -> float:
        """Time since the newest recorded tick began; 0 before the first."""
        return now_s - self._began_s if self.count else 0.0

    def note(self, began_s: float, duration_s: float, lateness_s: float, missed: int) -> None:
        self.gap_s = began_s - self._began_s if self.count else 0.0
        self._began_s = began_s
        self.late_s = max(lateness_s, self.gap_s - 1.0 / self.rate_hz, 0.0)
        self.count += 1
        self.missed += missed
        self._duration_s.append(duration_s)
        self._lateness_s.append(lateness_s)
        self._durations.observe(duration_s)
        self._latenesses.observe(lateness_s)

    @property
    def histograms(self) -> tuple[TickHistogram, ...]:
        return self._durations, self._latenesses

    def summary(self) -> TickView:
        """Percentiles over the last ticks, recomputed once a second for display."""
        if self.count % max(1, round(self.rate_hz)) == 1:
            p50_ms, p99_ms = (np.percentile(np.array(self._duration_s), (50, 99)) * 1e3).tolist()
            late_ms = float(np.percentile(np.array(self._lateness_s), 99)) * 1e3
            counts = self.rate_hz, self.count, self.missed
            self._summary = TickView(*counts, p50_ms, p99_ms, late_ms, self.scheduling)
        return self._summary
