"""Pairs of vehicles inside the minimum-separation ellipsoid, with hysteresis."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from gcs.model.state import Array, Mask
from gcs.safety.separation import Floor
from gcs.service.alarms import Limit, beyond

CLOSE: Final = Limit(on=1.0, off=1.05)
"""Distance as a share of the minimum, in the metric in which the ellipsoid is a sphere."""


@dataclass(frozen=True, slots=True)
class ClosePair:
    """A pair of vehicles, by their rows in FleetState."""

    rows: tuple[int, int]
    apart_m: float  # true distance


class ClosePairs:
    """Finds close pairs, and remembers them for the hysteresis."""

    def __init__(self) -> None:
        self._close: frozenset[tuple[int, int]] = frozenset()

    @property
    def any(self) -> bool:
        """Whether any pair is too close."""
        return bool(self._close)

    @staticmethod
    def reach_m(floor: Floor) -> float:
        """Distance above which a pair cannot count, provided that no pair was close before."""
        return CLOSE.off * max(floor.horizontal_m, floor.vertical_m)

    def look(self, position_m: Array, airborne: Mask, floor: Floor) -> tuple[ClosePair, ...]:
        """Return all pairs that are too close, nearest first.

        Args:
            position_m: (n, 3) show frame, NaN where not known.
            airborne: (n,) a pair counts if at least one is airborne and not both are below the pad height.
            floor: the minimum-separation ellipsoid.
        """
        known = np.flatnonzero(np.isfinite(position_m).all(axis=1))
        scaled_m = position_m[known] * floor.scale
        near = cKDTree(scaled_m).query_pairs(CLOSE.off * floor.horizontal_m, output_type="ndarray")
        first, second = known[near].T
        is_low: Mask = np.asarray(-position_m[:, 2] < floor.pad_height_m)
        counts = (airborne[first] | airborne[second]) & ~(is_low[first] & is_low[second])
        first, second = first[counts], second[counts]
        offset_m = position_m[first] - position_m[second]
        share = np.linalg.norm(offset_m * floor.scale, axis=1) / floor.horizontal_m
        rows = list(zip(first.tolist(), second.tolist(), strict=True))
        was_close = np.array([pair in self._close for pair in rows], np.bool_)
        close = beyond(was_close, share, CLOSE)
        self._close = frozenset(pair for pair, is_close in zip(rows, close, strict=True) if is_close)
        apart_m = np.linalg.norm(offset_m, axis=1)
        nearest_first = np.argsort(share).tolist()
        return tuple(ClosePair(rows[at], float(apart_m[at])) for at in nearest_first if close[at])
