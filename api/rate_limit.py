"""Rate limit of calls."""

from dataclasses import dataclass, field
from math import inf


@dataclass(slots=True)
class Bucket:
    """A token bucket: `burst` calls at once, then `rate_per_s`. Callers pass the time, of any one clock."""

    rate_per_s: float
    burst: float
    _left: float = field(default=inf, init=False)
    _time_s: float = field(default=-inf, init=False)

    def take(self, now_s: float) -> bool:
        """Whether one more call is allowed now; a refused call takes no token."""
        gained = self.rate_per_s * (now_s - self._time_s)
        self._left, self._time_s = min(self.burst, self._left + gained), now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
