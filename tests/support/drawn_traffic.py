"""Makes drawn shows in which vehicles pass each other at the spacing of the show. Seeded.

Two kinds, turned by a random angle. Opposing: lanes one spacing apart, flown both ways at a time. Crossing:
two groups cross at right angles at one height, their rows so that no two come closer than one spacing.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from gcs.model.state import Array
from gcs.shows.drawn import DrawnShow
from tests.support.drawn_shows import (
    HOLD_S,
    LEAST_HEIGHT_M,
    TAKEOFF_HEIGHT_M,
    Stage,
    grid,
    of_stages,
    over_s,
    scaled,
    squares,
)

KINDS = ("opposing", "crossing")
NEARLY = 1.001  # files are rounded
LEVEL = 1.5  # spacings from one height to the next


def _opposing_m(
    count: int, spacing: float, half_m: float, random: np.random.Generator
) -> tuple[Array, Array]:
    """Begin and end of lanes, every other one flown the other way."""
    levels = int(random.integers(1, 3))
    lane, level = np.divmod(np.arange(count), levels)
    way = np.where((lane + level) % 2, 1.0, -1.0)
    shifted_m = random.uniform(-4.0, 4.0, count)
    across_m = spacing * NEARLY * (lane - lane.max() / 2.0)
    up_m = LEAST_HEIGHT_M + LEVEL * spacing * NEARLY * level
    begin_m = np.stack([-way * half_m + shifted_m, across_m, -up_m], axis=1)
    return begin_m, begin_m + np.outer(2.0 * half_m * way, (1.0, 0.0, 0.0))


def _crossing_m(
    count: int, spacing: float, half_m: float, random: np.random.Generator
) -> tuple[Array, Array]:
    """Begin and end of two groups at right angles, like a loom's threads.

    Both move alike, so that two of different groups pass at the difference of their offsets over sqrt(2).
    """
    grid_m = 2.0 * np.sqrt(2.0) * spacing * NEARLY
    side = int(np.ceil(np.sqrt(count / 2.0)))
    row, column = np.divmod(np.arange((count + 1) // 2), side)
    begin_m = np.zeros((count, 3))
    first, other = slice(0, (count + 1) // 2), slice((count + 1) // 2, count)
    begin_m[first, 0], begin_m[first, 1] = -half_m - grid_m * row, grid_m * (column - (side - 1) / 2.0)
    swapped = begin_m[first][: count // 2]
    begin_m[other, 0], begin_m[other, 1] = swapped[:, 1], swapped[:, 0] + 0.5 * grid_m
    begin_m[:, 2] = -LEAST_HEIGHT_M
    moves_m = np.zeros((count, 3))
    moves_m[first, 0] = moves_m[other, 1] = 2.0 * half_m + grid_m * side
    return begin_m, begin_m + moves_m


def traffic_show(seed: int, spacing: float = 3.0) -> DrawnShow:
    """Return the show of this seed: 8 to 24 vehicles, 2.5 to 4 m/s."""
    random = np.random.default_rng(seed)
    kind, count = KINDS[seed % len(KINDS)], int(random.integers(8, 25))
    half_m, fast_m_s = float(random.uniform(12.0, 30.0)), float(random.uniform(2.5, 4.0))
    made = _opposing_m if kind == "opposing" else _crossing_m
    begin_m, end_m = made(count, spacing, half_m, random)
    turn_rad = random.uniform(0.0, 2.0 * np.pi)
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    turned = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    begin_m, end_m = begin_m @ turned, end_m @ turned
    pads_m = scaled(grid(count), np.sqrt(2.0) * spacing * NEARLY, TAKEOFF_HEIGHT_M)
    _, rows = linear_sum_assignment(squares(pads_m, begin_m))
    begin_m, end_m = begin_m[rows], end_m[rows]
    stages, passing_s = [Stage("above the pads", 0.0, 1.0, pads_m)], over_s(end_m - begin_m)
    passing_s *= max(1.0, 1.875 * np.linalg.norm(end_m - begin_m, axis=1).max() / passing_s / fast_m_s)
    for name, to_m in (("apart", begin_m), ("through", end_m), ("back through", begin_m), ("back", pads_m)):
        here_m = stages[-1].positions_m
        lasts_s = passing_s if "through" in name else over_s(to_m - here_m)
        begin_s = stages[-1].end_s + HOLD_S
        stages.append(Stage(name, begin_s, begin_s + float(np.ceil(lasts_s)), to_m))
    return of_stages(stages, spacing)
