"""Stacked pairs, one vehicle above the other: they cannot both descend straight. Pure."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs.model.state import Array
from gcs.safety.separation import Floor

TURNS = 200
NAMED_MAX = 10

GOLDEN_ANGLE_RAD = np.pi * (3.0 - np.sqrt(5.0))


def column_m(floor: Floor) -> float:
    """Width of the column that a descending vehicle keeps free."""
    return floor.horizontal_m + floor.margin_m + 2.0 * floor.uncertainty_m


def overlapping(position_m: Array, width_m: float) -> tuple[NDArray[np.intp], Array]:
    """Return the pairs with overlapping columns.

    Args:
        position_m: (n, 3) show frame.
        width_m: of a column.

    Returns: (k, 2) upper and lower of each pair, nearest first, seen from above; and (k,) their distances,
    seen from above.
    """
    first, second = np.triu_indices(len(position_m), 1)
    apart_m = np.hypot(*(position_m[first] - position_m[second])[:, :2].T)
    found = np.flatnonzero(apart_m < width_m)
    found = found[np.argsort(apart_m[found], kind="stable")]
    first, second = first[found], second[found]
    is_upper = position_m[first, 2] <= position_m[second, 2]  # z points down
    pairs = np.column_stack([np.where(is_upper, first, second), np.where(is_upper, second, first)])
    return pairs, apart_m[found]


def most_overlapping(position_m: Array, width_m: float) -> int:
    """Return the greatest number of overlapping pairs over all orientations of the formation (n, 3).

    The law assigns no fixed slots: the shape's orientation and the vehicles' slots are not known beforehand.
    """
    first, second = np.triu_indices(len(position_m), 1)
    chord_m = position_m[first] - position_m[second]
    along_m = chord_m @ _upward().T
    sideways_m2 = (chord_m**2).sum(axis=1)[:, None] - along_m**2
    return int((sideways_m2 < width_m**2).sum(axis=0).max(initial=0))


def _upward() -> Array:
    """(TURNS, 3) Unit vectors, evenly over half a sphere: possible orientations of a formation."""
    z = (np.arange(TURNS) + 0.5) / TURNS
    level, turn = np.sqrt(1.0 - z**2), GOLDEN_ANGLE_RAD * np.arange(TURNS)
    return np.column_stack([level * np.cos(turn), level * np.sin(turn), z])


def describe(pairs: int, rehearsed: Sequence[str] = ()) -> str:
    """Describe stacked pairs in words; empty if there are none.

    Args:
        pairs: the greatest number over all assignments of slots.
        rehearsed: the pairs of the show's check by name; others may be stacked in flight.
    """
    if not pairs and not rehearsed:
        return ""
    names = [*rehearsed[:NAMED_MAX], *(["others"] if len(rehearsed) > NAMED_MAX else [])]
    named = f" (in the show's check {', '.join(names)})" if names else ""
    return (
        f"up to {max(pairs, len(rehearsed))} pairs in the formation are stacked{named}:"
        " land now leads them apart first, and brings the lowest down first"
    )
