"""Remaining battery of vehicles, of which each may have several packs: one rule for every link."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gcs.model.state import Array

_IDS: Final = 256
_UNKNOWN: Final = 127
"""In int8, above every percentage, so that the minimum ignores it."""


class BatteryPacks:
    """The newest percentage of every pack, and of each vehicle the least of them.

    PX4 sends one BATTERY_STATUS for each pack, and a SYS_STATUS that reports its emptiest pack. A vehicle
    with a full and an empty pack is in danger, thus the least counts, whichever message arrived last. A
    pack that reports an unknown percentage (-1) is left out until it reports one again. A pack that stops
    reporting keeps its last percentage until the autopilot restarts: a connection that broke in flight has
    not charged it.

    Attributes:
        remaining: (n,) 0 to 1; NaN where no pack reports.
    """

    def __init__(self, count: int) -> None:
        self.remaining: Array = np.full(count, np.nan)
        self._percent = np.full((count, _IDS + 1), _UNKNOWN, np.int8)  # the last column: SYS_STATUS

    def take_packs(self, rows: ArrayLike, ids: ArrayLike, percent: ArrayLike) -> None:
        """Read BATTERY_STATUS messages: (k,) rows, battery ids, and percentages in order of arrival."""
        self._take(np.asarray(rows), np.asarray(ids), np.asarray(percent))

    def take_totals(self, rows: ArrayLike, percent: ArrayLike) -> None:
        """Read SYS_STATUS messages: (k,) rows, and percentages in order of arrival."""
        rows = np.asarray(rows)
        self._take(rows, np.full(rows.shape, _IDS), np.asarray(percent))

    def forget(self, rows: ArrayLike) -> None:
        """The autopilots of (k,) rows have restarted: their packs may have been replaced."""
        rows = np.asarray(rows)
        self._percent[rows] = _UNKNOWN
        self.remaining[rows] = np.nan

    def _take(self, rows: NDArray[np.int_], ids: NDArray[np.int_], percent: NDArray[np.int_]) -> None:
        self._percent[rows, ids] = np.where(percent >= 0, np.minimum(percent, 100), _UNKNOWN)
        least = self._percent[rows].min(axis=1)
        self.remaining[rows] = np.where(least == _UNKNOWN, np.nan, least / 100.0)
