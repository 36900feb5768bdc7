"""When a target was where its source says: by the source's own clock, as far as that can be trusted. Pure."""

from dataclasses import dataclass, field
from math import inf, isfinite, nan
from typing import Final

AGREES_S: Final = 3.0
"""A source's clock that differs from this computer's by no more shows the same time: both are set by UTC."""

AHEAD_S: Final = 0.2
"""A report from so much in the future is still one: both clocks have errors."""

STEP_S, STEPPED = 2.0, 3
"""A clock has stepped when so many reports in a row disagree by more than this with those before."""

DRIFTS: Final = 1e-4
"""Share by which a source's clock may run slower than this computer's."""


@dataclass(slots=True, eq=False)
class SourceClock:
    """Turns the times of one source into those of the loop's clock.

    A clock set by UTC has its delay measured. Of any other one the soonest report counts as `delay_s` late,
    and what is later than that as delayed by the network.

    Attributes:
        delay_s: how late reports arrive at least, where nothing measures it.
        steps: how often the source's clock was set.
    """

    delay_s: float
    steps: int = 0
    _soonest_s: float = field(default=nan, init=False)  # arrival minus the source's time
    _noted_s: float = field(default=-inf, init=False)
    _off: int = field(default=0, init=False)

    def was_s(self, arrived_s: float, source_s: float, unix_minus_loop_s: float) -> float:
        """When a report was true, loop clock; NaN: its time cannot be, or is that of a clock just set.

        Args:
            arrived_s: loop clock.
            source_s: by the source's clock, NaN: it has none.
            unix_minus_loop_s: this computer's clock minus the loop's; NaN: it is not to be trusted.
        """
        if not isfinite(source_s):
            return arrived_s - self.delay_s
        later_s = arrived_s + unix_minus_loop_s - source_s
        if isfinite(later_s) and -AHEAD_S <= later_s <= AGREES_S:
            self._soonest_s, self._off = arrived_s - source_s, 0
            return min(source_s - unix_minus_loop_s, arrived_s)
        away_s = arrived_s - source_s
        if isfinite(self._soonest_s) and abs(away_s - self._soonest_s) > STEP_S:
            self._off += 1
            if self._off < STEPPED:
                return nan
            self._soonest_s, self.steps = away_s, self.steps + 1
        elapsed_s = arrived_s - self._noted_s if isfinite(self._noted_s) else 0.0
        slower_s = self._soonest_s + DRIFTS * elapsed_s
        self._soonest_s = away_s if not isfinite(slower_s) else min(away_s, slower_s)
        self._noted_s, self._off = arrived_s, 0
        return min(source_s + self._soonest_s - self.delay_s, arrived_s)
