"""Finds, for all vehicles at once, the piece of a piecewise function that holds at a time. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.model.errors import ShapeError
from gcs.model.state import Array

Rows: TypeAlias = NDArray[np.intp]

TIME_MAX_S: Final = 7200.0
"""Latest time of a drawn show; no battery lasts as long."""

_STRIDE_S: Final = 16384.0
"""A power of two beyond `TIME_MAX_S`: keys of 1,000 vehicles are exact to 2 ns."""


@dataclass(frozen=True, slots=True, eq=False)
class PieceIndex:
    """Start times of the pieces of n vehicles, m in all, one vehicle after the other.

    `keys` holds start times, each plus the vehicle's row times a stride: sorted, so one binary search
    answers for every vehicle.
    """

    keys: Array  # (m,)
    first: Rows  # (n + 1,) the vehicle in row i has the pieces first[i] to first[i + 1] - 1

    @staticmethod
    def of(starts_s: Sequence[Array]) -> "PieceIndex":
        """Index the start times (k,) of each vehicle's pieces, at least one, increasing, 0 to `TIME_MAX_S`.

        Raises: ShapeError when a vehicle has no piece, or its times are not so.
        """
        for row, times_s in enumerate(starts_s):
            if not len(times_s) or not (times_s[0] >= 0.0 and times_s[-1] <= TIME_MAX_S):
                raise ShapeError(f"vehicle {row}: pieces from 0 to {TIME_MAX_S:g} s are needed")
            if not bool((np.diff(times_s) > 0.0).all()):
                raise ShapeError(f"vehicle {row}: times that increase are needed")
        first = np.zeros(len(starts_s) + 1, dtype=np.intp)
        np.cumsum([len(times_s) for times_s in starts_s], out=first[1:])
        keyed = [times_s + row * _STRIDE_S for row, times_s in enumerate(starts_s)]
        return PieceIndex(np.concatenate(keyed) if keyed else np.empty(0), first)

    def __len__(self) -> int:
        """Return the number of vehicles."""
        return len(self.first) - 1

    def at(self, time_s: float | Array, vehicles: Rows | None = None) -> tuple[Rows, Array]:
        """Return (k,) rows of the pieces that hold, and (k,) seconds since each began.

        A time before the first piece counts as its start.

        Args:
            time_s: one time, or (k,) one for each row that is asked for.
            vehicles: (k,) rows of vehicles, in any order, also repeated; None: all n, in order.
        """
        asked = np.arange(len(self)) if vehicles is None else vehicles
        offsets_s = _STRIDE_S * asked
        first_s = self.keys[self.first[asked]]
        sought = np.maximum(np.minimum(time_s, TIME_MAX_S) + offsets_s, first_s)
        rows = np.searchsorted(self.keys, sought, side="right") - 1
        return rows, sought - self.keys[rows]

    def starts_s(self, row: int) -> Array:
        """(k,) Start times of one vehicle's pieces."""
        return np.asarray(self.keys[self.pieces(row)] - row * _STRIDE_S)

    def pieces(self, row: int) -> slice:
        """Return the rows of one vehicle's pieces."""
        return slice(int(self.first[row]), int(self.first[row + 1]))
