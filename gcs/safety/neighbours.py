"""Near pairs of vehicles. For large fleets a grid of cells is used, several to the longest reach."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.model.jit import kernel
from gcs.model.state import Array, Mask

Rows: TypeAlias = NDArray[np.intp]

SPREAD = 3.0
"""Cells reach this many standard deviations from the mean; the outermost cells hold vehicles beyond."""

CELLS_IN_REACH = 4.0
"""Smaller cells leave out more vehicles that are too far, but more of them have to be visited."""

WIDER = 1.0 + 1e-9
"""For the rounding of cell numbers."""

CELLS_MAX = 64
"""Along each axis."""

ROOM = 40
"""Pairs per vehicle for which memory is allocated first; with more pairs it is doubled."""

FEW = 200
"""Up to this many vehicles, comparing all pairs is faster than sorting them into cells."""


@kernel
def near_pairs(some: Mask, position_m: Array, takes_part: Mask, radius_m: Array) -> tuple[Rows, Rows]:
    """Rows (k,) and (k,) of every pair whose distance is below the sum of its radii; each pair once.

    Args:
        some: (n,) pairs without one of these are left out.
        position_m: (n, 3), any frame.
        takes_part: (n,) the positions of these are finite.
        radius_m: (n,) radius of each one's search.
    """
    if len(position_m) <= FEW:
        return _near_pairs_of(some, position_m, takes_part, radius_m)
    rows, start, low_m, cell_m, across = sorted_into_cells(position_m, takes_part, radius_m)
    place_m, look_m, of_some = position_m[rows], radius_m[rows], some[rows]  # contiguous, cell by cell
    first, second = np.empty(ROOM * len(rows), np.intp), np.empty(ROOM * len(rows), np.intp)
    written, done = 0, 0
    while done < len(rows):
        if written + len(rows) > len(first):
            first, second = np.append(first, first), np.append(second, second)
        written, done = _write_pairs(
            rows, start, low_m, cell_m, across, place_m, look_m, of_some, first, second, written, done
        )
    return first[:written], second[:written]


@kernel
def _near_pairs_of(some: Mask, position_m: Array, takes_part: Mask, radius_m: Array) -> tuple[Rows, Rows]:
    """As `near_pairs`, but only pairs of which at least one is in `some` (n,), by comparing all pairs."""
    n, count = len(position_m), 0
    room = n * some.sum() + 1
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
            first[count], second[count] = i, j  # the next replaces it, if it is not near
            count += takes_part[j] and dx * dx + dy * dy + dz * dz < reach_m * reach_m
    return first[:count], second[:count]


@kernel
def _write_pairs(
    rows: Rows,
    start: Rows,
    low_m: Array,
    cell_m: float,
    across: int,
    place_m: Array,
    look_m: Array,
    of_some: Mask,
    first: Rows,
    second: Rows,
    written: int,
    done: int,
) -> tuple[int, int]:
    """Write the near pairs, after the `written` ones of `done` vehicles, while there is room for one more.

    Where all are in `of_some`, a vehicle finds those after it; else one in it also finds all that are not.

    Returns: `written` and `done` then.
    """
    from_, to = np.empty(3, np.int64), np.empty(3, np.int64)
    longest_m, extent_m = look_m.max(), _extents(start, across, place_m, look_m)
    every = of_some.all()
    for a in range(done, len(rows)):
        if not of_some[a]:
            continue
        if written + len(rows) > len(first):
            return written, a
        x_m, y_m, z_m, own_m = place_m[a, 0], place_m[a, 1], place_m[a, 2], look_m[a]
        far_m = (own_m + longest_m) * WIDER
        for axis in range(3):
            from_[axis] = cell_of(place_m[a, axis] - far_m, low_m[axis], cell_m, across)
            to[axis] = cell_of(place_m[a, axis] + far_m, low_m[axis], cell_m, across) + 1
        # the cells before hold earlier vehicles only
        from_[0] = max(from_[0], every * cell_of(x_m, low_m[0], cell_m, across))
        for x in range(from_[0], to[0]):
            for y in range(from_[1], to[1]):
                column = (x * across + y) * across
                begin, end = max(start[column + from_[2]], every * (a + 1)), start[column + to[2]]
                if begin >= end or _is_beyond(extent_m[x * across + y], x_m, y_m, z_m, own_m):
                    continue
                for b in range(begin, end):
                    dx, dy, dz = place_m[b, 0] - x_m, place_m[b, 1] - y_m, place_m[b, 2] - z_m
                    reach_m = own_m + look_m[b]
                    first[written], second[written] = rows[a], rows[b]  # the next replaces one that is far
                    near = dx * dx + dy * dy + dz * dz < reach_m * reach_m
                    written += near & ((b > a) | (not of_some[b]))
    return written, len(rows)


@kernel
def _extents(start: Rows, across: int, place_m: Array, look_m: Array) -> Array:
    """(across^2, 7) of each column of cells: the box about its vehicles, low and high, and longest radius."""
    extent_m = np.empty((across * across, 7))
    for column in range(across * across):
        extent_m[column, :3], extent_m[column, 3:6], extent_m[column, 6] = np.inf, -np.inf, 0.0
        for b in range(start[column * across], start[(column + 1) * across]):
            for axis in range(3):
                extent_m[column, axis] = min(extent_m[column, axis], place_m[b, axis])
                extent_m[column, 3 + axis] = max(extent_m[column, 3 + axis], place_m[b, axis])
            extent_m[column, 6] = max(extent_m[column, 6], look_m[b])
    return extent_m


@kernel
def _is_beyond(extent_m: Array, x_m: float, y_m: float, z_m: float, own_m: float) -> bool:
    """Whether a place with that radius is too far from every vehicle of a column with that extent (7,)."""
    dx = max(extent_m[0] - x_m, x_m - extent_m[3], 0.0)
    dy = max(extent_m[1] - y_m, y_m - extent_m[4], 0.0)
    dz = max(extent_m[2] - z_m, z_m - extent_m[5], 0.0)
    reach_m = WIDER * (own_m + extent_m[6])
    return bool(dx * dx + dy * dy + dz * dz > reach_m * reach_m)


@kernel
def sorted_into_cells(
    position_m: Array, takes_part: Mask, radius_m: Array
) -> tuple[Rows, Rows, Array, float, int]:
    """Participating rows, cell by cell; start of each cell; low corner (3,), width and number of cells."""
    members = np.flatnonzero(takes_part)
    count = len(members)
    low_m, wide_m = _middle(position_m, members)
    reach_m = 1e-6
    for i in members:
        reach_m = max(reach_m, 2.0 * radius_m[i])
    most = min(CELLS_MAX, int(np.ceil((8.0 * count + 1.0) ** (1.0 / 3.0))))
    cell_m = max(reach_m / CELLS_IN_REACH, wide_m / most)
    across = max(1, min(most, int(np.ceil(wide_m / cell_m))))
    number = np.empty(count, np.intp)
    start = np.zeros(across**3 + 1, np.intp)
    for a in range(count):
        number[a] = 0
        for axis in range(3):
            place_m = position_m[members[a], axis]
            number[a] = number[a] * across + cell_of(place_m, low_m[axis], cell_m, across)
        start[number[a] + 1] += 1
    start = np.cumsum(start)
    free = start.copy()
    rows = np.empty(count, np.intp)
    for a in range(count):
        rows[free[number[a]]] = members[a]
        free[number[a]] += 1
    return rows, start, low_m, cell_m, across


@kernel
def cell_of(place_m: float, low_m: float, cell_m: float, across: int) -> int:
    """Number of the cell along one axis; the outermost ones hold what is beyond."""
    cells = (place_m - low_m) / cell_m
    if not cells > 0.0:
        return 0
    return int(min(cells, across - 1.0))


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
