"""How much of what a vehicle should send arrives, vehicle by vehicle. Pure: time is given."""

from typing import Final

import numpy as np

from gcs.model.state import Array

REMEMBERED_S: Final = 5.0
"""What arrived so long ago counts by 1/e."""


class LinkQuality:
    """The share of positions that arrive, of those asked for. Looks at the newest arrivals once a tick."""

    def __init__(self, expected_hz: Array) -> None:
        """`expected_hz` (n,): positions asked for, each above 0 and not more often than looked at."""
        self._expected_hz = expected_hz
        self._rate_hz = np.zeros_like(expected_hz)
        self._arrival_s = np.full_like(expected_hz, -np.inf)
        self._time_s: float | None = None

    def note(self, arrival_s: Array, now_s: float) -> None:
        """Take in when each vehicle's newest position arrived: (n,), -inf before the first."""
        before_s, self._time_s = self._time_s, now_s
        arrived, self._arrival_s = arrival_s > self._arrival_s, arrival_s
        if before_s is None or now_s <= before_s:
            return
        elapsed_s = now_s - before_s
        weight = -np.expm1(-elapsed_s / REMEMBERED_S)
        self._rate_hz = self._rate_hz + weight * (arrived / elapsed_s - self._rate_hz)

    @property
    def share(self) -> Array:
        """(n,) from 0 to 1."""
        share: Array = np.minimum(1.0, self._rate_hz / self._expected_hz)
        return share
