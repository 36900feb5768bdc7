"""Shortest ways past boxes, on a grid, without the code that flies: what flown ways are compared with."""

from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from gcs.model.plan import Obstacle
from gcs.model.state import Array
from gcs.safety.surroundings import Limits

Index: TypeAlias = NDArray[np.intp]

CELL_M: Final = 1.0
STEPS: Final = ((1, 0), (0, 1), (1, 1), (1, -1), (1, 2), (1, -2), (2, 1), (2, -1))
"""Edge of the grid's cells, and its steps: knight's moves too, which leaves 3 % of detour."""


def shortest_paths_m(boxes: Sequence[Obstacle], starts_m: Array, goals_m: Array, clear_m: float) -> Array:
    """(n,) lengths of the shortest level ways from (n, 2) to (n, 2), past boxes grown by `clear_m`.

    The boxes count where they are. Infinite without a way. Up to 3 % longer than exact.
    """
    half_m = np.array([(box.half_length_x_m, box.half_length_y_m) for box in boxes]) + clear_m
    middle_m = np.array([(box.x_m, box.y_m) for box in boxes])
    ends_m = np.vstack([middle_m - half_m, middle_m + half_m, starts_m, goals_m])
    low_m = ends_m.min(axis=0) - 2.0 * CELL_M
    size = np.ceil((ends_m.max(axis=0) - low_m) / CELL_M).astype(int) + 3
    place_m = low_m + CELL_M * np.stack(np.meshgrid(*map(np.arange, size), indexing="ij"), axis=-1)
    free = np.ones(size, dtype=bool)
    for middle, half in zip(middle_m, half_m, strict=True):
        free &= (np.abs(place_m - middle) > half - CELL_M / 2).any(axis=-1)
    number = np.where(free, np.arange(free.size).reshape(size), -1)
    links = [_links(number, step) for step in STEPS]
    first, second, length_m = (np.concatenate(part) for part in zip(*links, strict=True))
    graph = scipy.sparse.csr_array((length_m, (first, second)), shape=(free.size, free.size))
    begins, ends = (
        [int(number[tuple(cell)]) for cell in np.rint((places_m - low_m) / CELL_M).astype(int)]
        for places_m in (starts_m, goals_m)
    )
    paths_m = np.full(len(starts_m), np.inf)
    ways = [at for at, pair in enumerate(zip(begins, ends, strict=True)) if min(pair) >= 0]
    if ways:
        indices = np.array([begins[at] for at in ways])
        from_m = scipy.sparse.csgraph.dijkstra(graph, directed=False, indices=indices)
        paths_m[ways] = from_m[np.arange(len(ways)), [ends[at] for at in ways]]
    return paths_m


def _links(number: Index, step: tuple[int, int]) -> tuple[Index, Index, Array]:
    """Free neighbours one step apart: their numbers, and the distance."""
    columns, rows = step
    shifted = number[columns:, max(rows, 0) : number.shape[1] + min(rows, 0)]
    base = number[: number.shape[0] - columns, max(-rows, 0) : number.shape[1] - max(rows, 0)]
    both = (base >= 0) & (shifted >= 0)
    return base[both], shifted[both], np.full(int(both.sum()), CELL_M * float(np.hypot(*step)))


def travel_time_s(way_m: Array, sideways_m_s: float, limits: Limits) -> Array:
    """(...,) durations of straight flights (..., 3) at the limits."""
    level_s = np.hypot(way_m[..., 0], way_m[..., 1]) / min(sideways_m_s, limits.horizontal_m_s)
    up_s, down_s = -way_m[..., 2] / limits.up_m_s, way_m[..., 2] / limits.down_m_s
    longest: Array = np.maximum(level_s, np.maximum(up_s, down_s))
    return longest


def shortest_ways_s(
    boxes: Sequence[Obstacle],
    start_m: Array,
    goal_m: Array,
    clear_m: float,
    speed: tuple[float, Limits],
    highest_m: float,
) -> Array:
    """(n,) durations of the shortest ways past boxes from (n, 3) to (n, 3): round those that stand, or over.

    Level, and then straight down; over, where none leads round, straight up before. Boxes that move are not
    in the way.

    Args:
        boxes: as they are now.
        start_m: (n, 3).
        goal_m: (n, 3).
        clear_m: what a way keeps from the sides and tops of boxes.
        speed: sideways, and the limits.
        highest_m: above it no way leads.

    Returns: infinite without a way.
    """
    level_m_s, limits = min(speed[0], speed[1].horizontal_m_s), speed[1]
    straight_m = np.linalg.norm((goal_m - start_m)[:, :2], axis=1)
    standing = [box for box in boxes if not box.speed_m_s]
    sinks_m, level_m = goal_m[:, 2] - start_m[:, 2], straight_m
    if standing:
        level_m = np.maximum(straight_m, shortest_paths_m(standing, start_m[:, :2], goal_m[:, :2], clear_m))
    round_s = level_m / level_m_s + np.maximum(sinks_m / limits.down_m_s, -sinks_m / limits.up_m_s)
    over_m = max((box.height_m for box in standing), default=0.0) + clear_m
    up_m = np.maximum(over_m + start_m[:, 2], 0.0)
    over_s = up_m / limits.up_m_s + straight_m / level_m_s + (up_m + sinks_m) / limits.down_m_s
    over_s = np.where(over_m <= highest_m, over_s, np.inf)
    return np.where(np.isfinite(round_s), round_s, over_s)
