"""Ways over the ground that keep off the edges of a fence's areas, whatever their shape. Pure."""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from gcs.control.path_search import along_m, find_corners, from_paths_m
from gcs.model.state import Array, Mask
from gcs.safety.fenced_areas import FencedArea, beyond_m

CELL_M: Final = 0.5
"""Places this near to each other are looked at once."""

CELLS_MAX: Final = 100
"""Cells of a search along one axis."""

MEETS_M: Final = 1e-6
"""Lines that cross are hardly ever exactly 0 m apart: their nearest points are rounded."""


def _edges_m(areas: Sequence[FencedArea]) -> Array:
    """(m, 2, 3) Begin and end of all edges, at height 0."""
    rings_m = [np.array(area.corners_m) for area in areas]
    each_m = [np.stack([ring_m, np.roll(ring_m, -1, axis=0)], axis=1) for ring_m in rings_m]
    edges_m = np.concatenate([np.zeros((0, 2, 2)), *each_m])
    return np.concatenate([edges_m, np.zeros((len(edges_m), 2, 1))], axis=2)


PIECE: Final = 4_000
"""Places that are judged at once: a planner in a thread of its own lets the tick pass in between."""


def in_pieces(place_m: Array) -> Iterator[Array]:
    """Yield at least one part of (n, 3)."""
    for begin in range(0, max(len(place_m), 1), PIECE):
        yield place_m[begin : begin + PIECE]


def keep_off(areas: Sequence[FencedArea], place_m: Array, clear_m: float) -> Mask:
    """(n,) Which places (n, 3) are at least so far from every edge, to `CELL_M`.

    A path from within, of which all places are, stays within where they are no farther apart than that.
    """
    if not areas:
        return np.ones(len(place_m), dtype=np.bool_)
    clear = np.ones(len(place_m), dtype=np.bool_)
    if with_heights := [area for area in areas if not _is_tall(area)]:
        over_m = [beyond_m(with_heights, part_m) for part_m in in_pieces(place_m)]
        clear &= np.concatenate(over_m) <= -clear_m
    if tall := [area for area in areas if _is_tall(area)]:
        edges_m = _edges_m(tall)
        at, back = np.unique(np.rint(place_m[:, :2] / CELL_M) @ (1.0, 1.0j), return_inverse=True)
        cell_m = CELL_M * np.column_stack([at.real, at.imag, np.zeros(len(at))])
        off = [from_paths_m(each_m, edges_m).min() >= clear_m for each_m in cell_m]
        clear &= np.array(off, np.bool_)[back]
    return clear


def _is_tall(area: FencedArea) -> bool:
    """Whether it has no heights: its edges are walls from the ground up."""
    return area.height_min_m is None and area.height_max_m is None


def way_within(
    areas: Sequence[FencedArea],
    one_m: Array,
    other_m: Array,
    clear_m: float,
    ground: tuple[FencedArea, float] | None = None,
) -> Array:
    """(k, 2) Places to fly to one after the other, before `other_m` (2,); none where no way is found.

    `ground` is the controlled ground, and what is kept from its edges.
    """
    edges_m, start_m, goal_m = _edges_m(areas), np.append(one_m, 0.0), np.append(other_m, 0.0)
    kept_m = np.full(len(edges_m), clear_m)
    if ground is not None:
        of_ground_m = _edges_m(ground[:1])
        edges_m = np.concatenate([edges_m, of_ground_m])
        kept_m = np.append(kept_m, np.full(len(of_ground_m), ground[1]))
    low_m = np.minimum(edges_m.min(axis=(0, 1)), np.minimum(start_m, goal_m)) - 2.0 * clear_m
    high_m = np.maximum(edges_m.max(axis=(0, 1)), np.maximum(start_m, goal_m)) + 2.0 * clear_m
    low_m[2] = high_m[2] = 0.0
    cell_m = max(1.0, float((high_m - low_m).max()) / CELLS_MAX)
    corners_m, reaches = find_corners(start_m, goal_m, edges_m, kept_m, low_m, high_m, cell_m, 1.0, np.inf)
    return np.asarray(corners_m[:-1, :2] if reaches else np.zeros((0, 2)))


def cross_edges(areas: Sequence[FencedArea], from_m: Array, to_m: Array) -> Mask:
    """(n,) Which straight ways over the ground between places (n, 3) meet an edge of an area."""
    edges_m, level = _edges_m(areas), (1.0, 1.0, 0.0)
    ends = zip(from_m * level, to_m * level, strict=True)
    return np.array(
        [along_m(one_m, other_m[None], edges_m).min() <= MEETS_M for one_m, other_m in ends], np.bool_
    )
