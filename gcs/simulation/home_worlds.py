"""Random boxes between a formation and its pads: walls, corners, pockets, rings, and boxes that move. Pure.

The formation flies about the origin, its pads lie beyond. Every world is turned at random by quarters.
"""

from collections.abc import Callable
from math import hypot
from typing import Final

import numpy as np

from gcs.model.plan import Obstacle
from gcs.model.state import Array

Walls = list[tuple[Array, Array, Array]]
"""Centre, half-lengths and velocity (2,) of each box, with the pads towards -x."""

SHAPES: Final = ("wall", "corner", "pocket", "ring", "moving")
"""By turns, seed by seed; `closed` is a ring without a door."""


def home_world(
    random: np.random.Generator, kind: str, sphere_m: float, pads_m: float
) -> tuple[tuple[Obstacle, ...], Array]:
    """Draw boxes, and the (2,) middle of the pads.

    Args:
        random: whatever is drawn is drawn of it.
        kind: one of `SHAPES`, or `closed`.
        sphere_m: radius of the formation, which no box is nearer to than its margins.
        pads_m: distance of the farthest pad from the middle of them all.
    """
    clear_m = sphere_m + 8.0  # to the near faces of the walls: the formation stays where it is
    walls, farthest_m = _DRAWN[kind](random, clear_m)
    away_m = farthest_m + pads_m + random.uniform(10.0, 30.0)
    turn = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), int(random.integers(0, 4)))
    height_m = random.uniform(30.0, 60.0) if kind == "ring" else 60.0
    boxes = []
    for number, (middle_m, half_m, velocity_m_s) in enumerate(walls, 1):
        x_m, y_m = (turn @ middle_m).tolist()
        half_x_m, half_y_m = np.abs(turn @ half_m).tolist()
        moves_m_s = (turn @ velocity_m_s).tolist()
        boxes.append(Obstacle(f"box {number}", x_m, y_m, half_x_m, half_y_m, height_m, *moves_m_s))
    return tuple(boxes), turn @ np.array([-away_m, random.uniform(-10.0, 10.0)])


def _box(
    x_m: float, y_m: float, half_x_m: float, half_y_m: float, moves_m_s: float = 0.0
) -> tuple[Array, Array, Array]:
    return np.array([x_m, y_m]), np.array([half_x_m, half_y_m]), np.array([0.0, moves_m_s])


def _wall(random: np.random.Generator, clear_m: float) -> tuple[Walls, float]:
    """One wall across the way."""
    thick_m, half_m = random.uniform(1.0, 4.0), random.uniform(0.6, 2.0) * clear_m
    wall = _box(-clear_m - thick_m, random.uniform(-0.5, 0.5) * clear_m, thick_m, half_m)
    return [wall], clear_m + 2.0 * thick_m + 0.5 * half_m


def _corner(random: np.random.Generator, clear_m: float) -> tuple[Walls, float]:
    """An L about the formation: a wall across the way, and another beside it."""
    walls, farthest_m = _pocket(random, clear_m)
    return walls[:2], farthest_m


def _pocket(random: np.random.Generator, clear_m: float) -> tuple[Walls, float]:
    """A U about the formation, with its bottom on the way."""
    thick_m, deep_m = random.uniform(1.0, 4.0), random.uniform(1.2, 2.2) * clear_m
    wide_m = 1.3 * clear_m  # the ellipses of the walls bulge
    arms = [_box(deep_m / 2.0 - clear_m, y * wide_m, deep_m / 2.0, thick_m) for y in (-1.0, 1.0)]
    return [_box(-clear_m - thick_m, 0.0, thick_m, wide_m), *arms], 1.5 * clear_m + 2.0 * thick_m


def _ring(random: np.random.Generator, clear_m: float) -> tuple[Walls, float]:
    """Four walls about the formation; in the side away from the pads there is a door."""
    walls, farthest_m = _closed(random, clear_m)
    wide_m = 1.3 * clear_m
    thick_m, door_m = float(walls[0][1][0]), random.uniform(0.3, 0.8) * wide_m
    half_m = wide_m - door_m
    sides = [_box(wide_m, y * (wide_m - half_m / 2.0), thick_m, half_m / 2.0) for y in (-1.0, 1.0)]
    return [*walls[:3], *sides], farthest_m


def _closed(random: np.random.Generator, clear_m: float) -> tuple[Walls, float]:
    """Four walls about the formation."""
    thick_m, wide_m = random.uniform(1.0, 3.0), 1.3 * clear_m
    across = [_box(0.0, y * wide_m, wide_m, thick_m) for y in (-1.0, 1.0)]
    ends = [_box(x * wide_m, 0.0, thick_m, wide_m) for x in (-1.0, 1.0)]
    return [ends[0], *across, ends[1]], 1.6 * wide_m


def _moving(random: np.random.Generator, clear_m: float) -> tuple[Walls, float]:
    """One to three boxes that cross the way, from both sides."""
    boxes, at_m = [], clear_m
    for _ in range(int(random.integers(1, 4))):
        half_m, speed_m_s = random.uniform(2.5, 12.0, 2), random.uniform(0.3, 1.5)
        side = float(random.choice([-1.0, 1.0]))
        begins_m = side * random.uniform(0.0, 20.0 * speed_m_s + half_m[1])
        boxes.append(_box(-at_m - half_m[0], begins_m, half_m[0], half_m[1], -side * speed_m_s))
        at_m += 2.0 * half_m[0] + random.uniform(8.0, 20.0)
    widest_m = max(hypot(*half_m) for _, half_m, _ in boxes)
    return boxes, at_m + 0.5 * widest_m


_DRAWN: Final[dict[str, Callable[[np.random.Generator, float], tuple[Walls, float]]]] = {
    "wall": _wall,
    "corner": _corner,
    "pocket": _pocket,
    "ring": _ring,
    "moving": _moving,
    "closed": _closed,
}
