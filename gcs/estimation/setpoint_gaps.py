"""Recent gaps between the setpoints sent to each vehicle: a stall of the station leaves one.

Pure; times are given.
"""

from typing import Final

import numpy as np

from gcs.model.state import Array, Mask

REMEMBERED_S: Final = 10.0
"""A failsafe shows in a heartbeat, seconds after the gap that caused it where heartbeats are lost."""


class SetpointGaps:
    """Columns of all vehicles, rows as in FleetState."""

    def __init__(self, count: int) -> None:
        self._last_s = np.full(count, np.nan)  # when it was last commanded
        self._gap_s, self._ended_s = np.zeros(count), np.full(count, -np.inf)  # the longest recent one

    def note(self, commanded: Mask, now_s: float) -> None:
        """Add a tick: (n,) vehicles to which a setpoint was sent at `now_s`."""
        gap_s = np.where(commanded, now_s - self._last_s, np.nan)
        longer = (gap_s >= self._gap_s) | (commanded & (now_s - self._ended_s > REMEMBERED_S))
        self._gap_s = np.where(longer, np.nan_to_num(gap_s), self._gap_s)
        self._ended_s = np.where(longer, now_s, self._ended_s)
        self._last_s = np.where(commanded, now_s, self._last_s)

    def longest_s(self, row: int, now_s: float) -> float:
        """The longest gap of the last REMEMBERED_S, including one still open; NaN: never commanded."""
        open_s = now_s - float(self._last_s[row])
        ended_s = float(self._gap_s[row]) if now_s - self._ended_s[row] <= REMEMBERED_S else 0.0
        return float(np.fmax(open_s, ended_s)) if np.isfinite(open_s) else np.nan

    @property
    def last_s(self) -> Array:
        """(n,) when each was last commanded, NaN: never."""
        return self._last_s
