"""Who stands above whom: they cannot both come straight down. Pure."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs.safety.separation import Floor
from gcs.state import Array, VehicleId

NAMED_MAX = 8


def column_m(floor: Floor) -> float:
    """How wide the column is that somebody who comes down keeps free."""
    return floor.horizontal_m + floor.margin_m + 2.0 * floor.uncertainty_m


def overlapping(position_m: Array, width_m: float) -> tuple[NDArray[np.intp], Array]:
    """Pairs whose columns overlap.

    Args:
        position_m: (n, 3) show frame.
        width_m: of a column.

    Returns: (k, 2) upper and lower of each pair, those nearest to each other, seen from above, first; and
    (k,) how near that is.
    """
    first, second = np.triu_indices(len(position_m), 1)
    apart_m = np.hypot(*(position_m[first] - position_m[second])[:, :2].T)
    found = np.flatnonzero(apart_m < width_m)
    found = found[np.argsort(apart_m[found], kind="stable")]
    first, second = first[found], second[found]
    is_upper = position_m[first, 2] <= position_m[second, 2]  # z points down
    pairs = np.column_stack([np.where(is_upper, first, second), np.where(is_upper, second, first)])
    return pairs, apart_m[found]


def told(ids: Sequence[VehicleId], pairs: NDArray[np.intp]) -> str:
    """In words, empty where there are none."""
    if not len(pairs):
        return ""
    named = ", ".join(f"{ids[upper]} above {ids[lower]}" for upper, lower in pairs[:NAMED_MAX].tolist())
    more = f" and {len(pairs) - NAMED_MAX} pairs more" if len(pairs) > NAMED_MAX else ""
    return f"columns overlap in the formation: {named}{more}; land now leads them apart first, lowest first"
