"""A way past closed paths in space: A* over cells, then as straight as possible (decision 0042). Kernels.

All distances are in the floor's metric, in which the filter keeps the same distance in every direction.
"""

from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from gcs.model.jit import kernel
from gcs.model.state import TINY, Array

BEGUN_SHARE = 0.98
"""Of the present distance: a vehicle inside the closed space comes no nearer to a path than this."""

SEARCHED_MAX = 12_000
"""Cells after which a search ends with the place nearest to the goal: about 20 ms."""

GREED = 1.3
"""Factor on the estimated rest of a way: fewer cells are searched, a route is at most so much longer."""


@kernel
def from_paths_m(place_m: Array, path_m: Array) -> Array:
    """(m,) distances of a place (3,) from all paths (m, 2, 3)."""
    away_m = np.empty(len(path_m))
    for k in range(len(path_m)):
        away_m[k] = lines_apart_m(place_m, place_m, path_m[k, 0], path_m[k, 1])
    return away_m


@kernel
def along_m(start_m: Array, corner_m: Array, path_m: Array) -> Array:
    """(m,) least distances of a way from `start_m` (3,) by corners (k, 3) from all paths (m, 2, 3)."""
    away_m = from_paths_m(start_m, path_m)
    for i in range(len(corner_m)):
        before_m = corner_m[i - 1] if i else start_m
        for k in range(len(path_m)):
            away_m[k] = min(away_m[k], lines_apart_m(before_m, corner_m[i], path_m[k, 0], path_m[k, 1]))
    return away_m


@kernel
def sees(
    one_m: Array, other_m: Array, path_m: Array, kept_m: Array, spare_m: float, leads_in: bool = False
) -> bool:
    """Whether the straight way between two places (3,) is clear of all paths; inside it may only lead out.

    With `leads_in` it may come as near to a path as it ends.
    """
    for k in range(len(path_m)):
        least_m, near = kept_m[k] + spare_m, True
        for axis in range(3):
            low_m = min(path_m[k, 0, axis], path_m[k, 1, axis]) - least_m
            high_m = max(path_m[k, 0, axis], path_m[k, 1, axis]) + least_m
            near &= max(one_m[axis], other_m[axis]) > low_m and min(one_m[axis], other_m[axis]) < high_m
        if not near or kept_m[k] == 0.0:
            continue
        away_m = lines_apart_m(one_m, other_m, path_m[k, 0], path_m[k, 1])
        if away_m < least_m:
            begun_m = BEGUN_SHARE * lines_apart_m(one_m, one_m, path_m[k, 0], path_m[k, 1])
            if leads_in:
                begun_m = min(
                    begun_m, BEGUN_SHARE * lines_apart_m(other_m, other_m, path_m[k, 0], path_m[k, 1])
                )
            if away_m < min(least_m, begun_m):
                return False
    return True


@kernel
def lines_apart_m(a_m: Array, b_m: Array, c_m: Array, d_m: Array) -> float:
    """Least distance between the straight line from a to b and the one from c to d, (3,) each.

    Source: C. Ericson, Real-Time Collision Detection, section 5.1.9.
    """
    own2, other2, along2, ahead, beside = 0.0, 0.0, 0.0, 0.0, 0.0
    for axis in range(3):
        own, other, from_m = b_m[axis] - a_m[axis], d_m[axis] - c_m[axis], a_m[axis] - c_m[axis]
        own2 += own * own
        other2 += other * other
        along2 += own * other
        ahead += own * from_m
        beside += other * from_m
    s = 0.0
    across = own2 * other2 - along2 * along2
    if across > TINY:
        s = min(max((along2 * beside - ahead * other2) / across, 0.0), 1.0)
    t = min(max((along2 * s + beside) / max(other2, TINY), 0.0), 1.0)
    s = min(max((along2 * t - ahead) / max(own2, TINY), 0.0), 1.0)
    away2 = 0.0
    for axis in range(3):
        apart_m = a_m[axis] + s * (b_m[axis] - a_m[axis]) - c_m[axis] - t * (d_m[axis] - c_m[axis])
        away2 += apart_m * apart_m
    away_m: float = np.sqrt(away2)
    return away_m


@kernel
def find_corners(
    start_m: Array,
    goal_m: Array,
    path_m: Array,
    kept_m: Array,
    low_m: Array,
    high_m: Array,
    cell_m: float,
    climb_cost: float,
    far_m: float,
) -> tuple[Array, bool]:
    """A way from start to goal, (3,) each, past closed paths: A* over cells, then as straight as possible.

    Args:
        start_m: centre of a cell.
        goal_m: see above.
        path_m: (m, 2, 3) closed.
        kept_m: (m,) distance to be kept from each.
        low_m: (3,) least coordinates of the cells' centres.
        high_m: (3,) greatest.
        cell_m: edge of a cell.
        climb_cost: of a metre up or down, in metres sideways.
        far_m: greatest distance over the ground.

    Returns: corners (k, 3), the last is the goal or the nearest place found; and whether it is the goal.
    """
    size, at = np.empty(3, np.int64), np.empty(3, np.int64)
    for axis in range(3):
        at[axis] = int(np.floor((start_m[axis] - low_m[axis]) / cell_m))
        size[axis] = at[axis] + 1 + int(np.floor((high_m[axis] - start_m[axis]) / cell_m))
    origin_m = start_m - at * cell_m
    cost, came = np.full(size.prod(), np.inf), np.full(size.prod(), -1, np.int64)
    reached, done = np.zeros(size.prod(), np.bool_), np.zeros(size.prod(), np.bool_)
    nearest = (at[0] * size[1] + at[1]) * size[2] + at[2]
    cost[nearest], reached[nearest], heap = 0.0, True, [(0.0, nearest)]
    place_m, nearest_m, tried, reaches = np.empty(3), np.inf, 0, False
    while len(heap) > 0 and tried < SEARCHED_MAX and not reaches:
        node = heappop(heap)[1]
        if done[node]:
            continue
        done[node], tried = True, tried + 1
        x, y, z = _go_to(node, size, origin_m, cell_m, place_m)
        left_m = _way_m(place_m, goal_m, climb_cost)
        if left_m < nearest_m:
            nearest, nearest_m = node, left_m
            close = left_m < 3.0 * cell_m * climb_cost
            reaches = close and sees(place_m, goal_m, path_m, kept_m, 0.0)
        for step in range(27):
            dx, dy, dz = step // 9 - 1, step // 3 % 3 - 1, step % 3 - 1
            u, v, w = x + dx, y + dy, z + dz
            other = (u * size[1] + v) * size[2] + w
            if min(u, v, w) < 0 or u >= size[0] or v >= size[1] or w >= size[2] or done[other]:
                continue
            _go_to(other, size, origin_m, cell_m, place_m)
            if not reached[other]:
                far = np.hypot(place_m[0], place_m[1]) > far_m
                reached[other], done[other] = True, far or not _is_clear(place_m, path_m, kept_m)
            spent = cost[node] + cell_m * np.sqrt(dx * dx + dy * dy + (climb_cost * dz) ** 2)
            if spent < cost[other] and not done[other]:
                cost[other], came[other] = spent, node
                heappush(heap, (spent + GREED * _way_m(place_m, goal_m, climb_cost), other))
    way_m, node = [goal_m][: int(reaches)], nearest
    while node >= 0:
        _go_to(node, size, origin_m, cell_m, place_m)
        way_m.append(place_m.copy())
        node = came[node]
    return _straightened(way_m[::-1], path_m, kept_m), reaches


@kernel
def _go_to(
    node: int, size: NDArray[np.int64], origin_m: Array, cell_m: float, place_m: Array
) -> tuple[int, int, int]:
    """Write the centre of a cell into `place_m` (3,), and return its indices."""
    x, y, z = node // (size[1] * size[2]), node // size[2] % size[1], node % size[2]
    place_m[0], place_m[1], place_m[2] = x * cell_m, y * cell_m, z * cell_m
    place_m += origin_m
    return x, y, z


@kernel
def _is_clear(place_m: Array, path_m: Array, kept_m: Array) -> bool:
    """Whether a place (3,) keeps all distances (m,) from the paths (m, 2, 3)."""
    for k in range(len(path_m)):
        near = True
        for axis in range(3):
            near &= place_m[axis] > min(path_m[k, 0, axis], path_m[k, 1, axis]) - kept_m[k]
            near &= place_m[axis] < max(path_m[k, 0, axis], path_m[k, 1, axis]) + kept_m[k]
        if near and lines_apart_m(place_m, place_m, path_m[k, 0], path_m[k, 1]) < kept_m[k]:
            return False
    return True


@kernel
def _straightened(way_m: list[Array], path_m: Array, kept_m: Array) -> Array:
    """Those of the places (3,), without the first, that are needed to go straight between them; (k, 3)."""
    corner_m, count, here = np.empty((len(way_m), 3)), 0, 0
    for k in range(1, len(way_m)):
        if k + 1 < len(way_m) and sees(way_m[here], way_m[k + 1], path_m, kept_m, 0.0):
            continue
        corner_m[count] = way_m[k]
        count, here = count + 1, k
    return corner_m[:count]


@kernel
def _way_m(one_m: Array, other_m: Array, climb_cost: float) -> float:
    """Length of the way between two places (3,), in metres sideways."""
    x, y, z = other_m[0] - one_m[0], other_m[1] - one_m[1], climb_cost * (other_m[2] - one_m[2])
    way_m: float = np.sqrt(x * x + y * y + z * z)
    return way_m
