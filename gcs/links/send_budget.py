"""What features may use of a link, so that setpoints and telemetry have the rest."""

from dataclasses import dataclass, field
from math import inf
from typing import Final

_SAVED_S: Final = 0.25
"""Share that may be saved up: bursts are no longer than this share's time."""


@dataclass(slots=True)
class Budget:
    """Bytes that may leave over one link; `spend` may overdraw, and what follows then waits."""

    bytes_per_s: float
    _bytes: float = field(default=0.0, init=False)
    _time_s: float = field(default=-inf, init=False)

    def left_bytes(self, now_s: float) -> float:
        """What may leave now; zero or less: nothing."""
        gained = (now_s - self._time_s) * self.bytes_per_s
        self._bytes, self._time_s = min(self._bytes + gained, _SAVED_S * self.bytes_per_s), now_s
        return self._bytes

    def spend(self, count: int) -> None:
        self._bytes -= count
