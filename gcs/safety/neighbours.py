"""Near pairs of vehicles. For large fleets a grid of cells as wide as the longest reach is used."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.model.jit import kernel
from gcs.model.state import Array, Mask

Rows: TypeAlias = NDArray[np.intp]

SPREAD = 3.0
"""Cells reach this many standard deviations from the mean; the outermost cells hold vehicles beyond."""

CELLS_MAX = 64
"""Along each axis."""

ROOM = 40
"""Pairs per vehicle for which memory is allocated first; with more pairs the search is repeated."""

FEW = 200
"""Up to this many vehicles, comparing all pairs is faster than sorting them into cells."""


@kernel
def near_pairs(position_m: Array, takes_part: Mask, radius_m: Array) -> tuple[Rows, Rows]:
    """Rows (k,) and (k,) of every pair whose distance is below the sum of its radii; each pair once.

    Args:
        position_m: (n, 3), any frame.
        takes_part: (n,) the positions of these are finite.
        radius_m: (n,) radius of each one's search.
    """
    if len(position_m) <= FEW:
        return near_pairs_of(takes_part, position_m, takes_part, radius_m)
    rows, start, cells, across = _sorted_into_cells(position_m, takes_part, radius_m)
    place_m, look_m = position_m[rows], radius_m[rows]  # contiguous in memory, cell by cell
    first, second = np.empty(ROOM * len(rows), np.intp), np.empty(ROOM * len(rows), np.intp)
    found = _write_pairs(rows, start, cells, across, place_m, look_m, first, second)
    if found > len(first):
        first, second = np.empty(found, np.intp), np.empty(found, np.intp)
        _write_pairs(rows, start, cells, across, place_m, look_m, first, second)
    return first[:found], second[:found]


@kernel
def near_pairs_of(some: Mask, position_m: Array, takes_part: Mask, radius_m: Array) -> tuple[Rows, Rows]:
    """As `near_pairs`, but only pairs of which at least one is in `some` (n,), by comparing all pairs."""
    n, found = len(position_m), 0
    room = n * some.sum()
    first, second = np.empty(room, np.intp), np.empty(room, np.intp)
    for i in range(n):
        if not (some[i] and takes_part[i]):
            continue
        x_m, y_m, z_m, own_m = position_m[i, 0], position_m[i, 1], position_m[i, 2], radius_m[i]
        for j in range(n):
            if j <= i and some[j]:
                continue  # already found from j
            dx, dy, dz = position_m[j, 0] - x_m, position_m[j, 1] - y_m, position_m[j, 2] - z_m
            reach_m = own_m + radius_m[j]
            if takes_part[j] and dx * dx + dy * dy + dz * dz < reach_m * reach_m:
                first[found], second[found] = i, j
                found += 1
    return first[:found], second[:found]


@kernel
def _write_pairs(
    rows: Rows,
    start: Rows,
    cells: NDArray[np.int64],
    across: int,
    place_m: Array,
    look_m: Array,
    first: Rows,
    second: Rows,
) -> int:
    """Write the near pairs into `first` and `second` while there is room. Returns: their number."""
    found, room = 0, len(first)
    for a in range(len(rows)):
        x_m, y_m, z_m, own_m = place_m[a, 0], place_m[a, 1], place_m[a, 2], look_m[a]
        low, high = max(cells[a, 2] - 1, 0), min(cells[a, 2] + 2, across)
        for x in range(max(cells[a, 0] - 1, 0), min(cells[a, 0] + 2, across)):
            for y in range(max(cells[a, 1] - 1, 0), min(cells[a, 1] + 2, across)):
                column = (x * across + y) * across
                for b in range(max(start[column + low], a + 1), start[column + high]):
                    dx, dy, dz = place_m[b, 0] - x_m, place_m[b, 1] - y_m, place_m[b, 2] - z_m
                    reach_m = own_m + look_m[b]
                    if dx * dx + dy * dy + dz * dz < reach_m * reach_m:
                        if found < room:
                            first[found], second[found] = rows[a], rows[b]
                        found += 1
    return found


@kernel
def _sorted_into_cells(
    position_m: Array, takes_part: Mask, radius_m: Array
) -> tuple[Rows, Rows, NDArray[np.int64], int]:
    """Participating rows, cell by cell; start of each cell; cell of each row (k, 3); cells per axis."""
    members = np.flatnonzero(takes_part)
    count = len(members)
    low_m, wide_m = _middle(position_m, members)
    reach_m = 1e-6
    for i in members:
        reach_m = max(reach_m, 2.0 * radius_m[i])
    most = min(CELLS_MAX, int(np.ceil((8.0 * count + 1.0) ** (1.0 / 3.0))))
    cell_m = max(reach_m, wide_m / most)
    across = max(1, min(most, int(np.ceil(wide_m / cell_m))))
    cells = np.empty((count, 3), np.int64)
    number = np.empty(count, np.intp)
    start = np.zeros(across**3 + 1, np.intp)
    for a in range(count):
        for axis in range(3):
            place = (position_m[members[a], axis] - low_m[axis]) / cell_m
            cells[a, axis] = int(min(max(place, 0.0), across - 1.0))
        number[a] = (cells[a, 0] * across + cells[a, 1]) * across + cells[a, 2]
        start[number[a] + 1] += 1
    start = np.cumsum(start)
    free = start.copy()
    rows, sorted_cells = np.empty(count, np.intp), np.empty((count, 3), np.int64)
    for a in range(count):
        place_in_order = free[number[a]]
        rows[place_in_order] = members[a]
        sorted_cells[place_in_order] = cells[a]
        free[number[a]] += 1
    return rows, start, sorted_cells, across


@kernel
def _middle(position_m: Array, members: Rows) -> tuple[Array, float]:
    """Low corner (3,) and edge of the cube that contains most of them."""
    count = max(len(members), 1)
    mean_m, largest_m2 = np.zeros(3), 0.0
    for axis in range(3):
        for i in members:
            mean_m[axis] += position_m[i, axis] / count
        square_m2 = 0.0
        for i in members:
            square_m2 += (position_m[i, axis] - mean_m[axis]) ** 2 / count
        largest_m2 = max(largest_m2, square_m2)
    half_m = SPREAD * np.sqrt(largest_m2)
    return mean_m - half_m, 2.0 * half_m
