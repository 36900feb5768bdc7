"""Share of each vehicle's expected telemetry that arrives. Pure: time is given."""

from typing import Final

import numpy as np

from gcs.model.state import Array

REMEMBERED_S: Final = 5.0
"""Age at which an arrival counts by 1/e."""


class LinkQuality:
    """The share of requested positions that arrive, from the newest arrivals once a tick."""

    def __init__(self, expected_hz: Array) -> None:
        """`expected_hz` (n,): rates of positions requested, each above 0 and at most the rate of `note`."""
        self._expected_hz = expected_hz
        self._rate_hz = np.zeros_like(expected_hz)
        self._arrival_s = np.full_like(expected_hz, -np.inf)
        self._time_s: float | None = None

    def note(self, arrival_s: Array, now_s: float) -> None:
        """Add the arrival of each vehicle's newest position: (n,), -inf before the first."""
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
