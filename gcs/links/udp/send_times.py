"""Times at which setpoints left: a bounded record for each vehicle."""

from typing import Final

import numpy as np

from gcs.mavlink.kernels import Whole
from gcs.model.state import Array

REMEMBERED: Final = 512


class Sent:
    """Times of the latest setpoints to n vehicles, rows as on the link.

    Attributes:
        newest_s: (n,) when the newest left, -inf before the first.
    """

    def __init__(self, count: int) -> None:
        self.newest_s: Array = np.full(count, -np.inf)
        self._times_s = np.zeros((count, REMEMBERED))
        self._count = np.zeros(count, np.int64)

    def note(self, rows: Whole, time_s: float) -> None:
        """Record a setpoint to each of `rows`, which are all different."""
        self.newest_s[rows] = time_s
        self._times_s[rows, self._count[rows] % REMEMBERED] = time_s
        self._count[rows] += 1

    def times_s(self, row: int) -> tuple[float, ...]:
        """Times of one vehicle, oldest first."""
        count = int(self._count[row])
        places = np.arange(max(0, count - REMEMBERED), count) % REMEMBERED
        return tuple(self._times_s[row, places].tolist())
