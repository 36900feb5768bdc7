"""Makes drawn shows of any size: a fleet morphs from shape to shape at a given spacing. Seeded.

The spacing holds by construction. All vehicles of a transition move on straight lines with one time law, from
points at least sqrt(2) spacings apart to points as far apart, assigned with the least sum of squares. They
then stay one spacing apart: Turpin, Michael and Kumar, "CAPT", Int. J. Robotics Research 33, 2014.
Distances are those of the floor between vehicles: up and down 1.5 times as much as sideways.

`python -m tests.support.drawn_shows 500 300 3.0 OUT.skyc [SHAPE ...]` writes one: vehicles, seconds, spacing.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from gcs.model.state import Array
from gcs.shows.drawn import DrawnShow
from gcs.simulation.drawn_traffic import (
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


def _sphere(count: int) -> Array:
    index = np.arange(count) + 0.5
    up, turn = 1.0 - 2.0 * index / count, np.pi * (1.0 + np.sqrt(5.0)) * index
    around = np.sqrt(1.0 - up**2)
    return np.stack([around * np.cos(turn), around * np.sin(turn), up], axis=1)


def _wall(count: int) -> Array:
    """A wall four times as wide as high, of rows shifted by half a spacing."""
    row, column = np.divmod(np.arange(count), int(np.ceil(2.0 * np.sqrt(count))))
    return np.stack([np.zeros(count), column + 0.5 * (row % 2), row * np.sqrt(0.75)], axis=1)


def _cube(count: int) -> Array:
    side = int(np.ceil(np.cbrt(count)))
    x, rest = np.divmod(np.arange(count), side * side)
    y, z = np.divmod(rest, side)
    return np.stack([x, y, z], axis=1).astype(float)


def _helix(count: int) -> Array:
    turns, share = max(count / 40.0, 2.0), np.linspace(0.0, 1.0, count)
    angle = 2.0 * np.pi * turns * share
    return np.stack([np.cos(angle), np.sin(angle), 1.2 * share * turns / 3.0], axis=1)


def _rings(count: int) -> Array:
    """Two flat rings, one above the other."""
    upper = np.arange(count) % 2
    angle = 2.0 * np.pi * (np.arange(count) // 2) / max((count + 1) // 2, 1)
    return np.stack([np.cos(angle), np.sin(angle), 0.4 * upper], axis=1)


SHAPES: dict[str, Callable[[int], Array]] = {
    "wall": _wall, "sphere": _sphere, "cube": _cube, "helix": _helix, "rings": _rings,
}  # fmt: skip


def _stages(
    pads_m: Array, seconds: float, least_m: float, shapes: Sequence[str], rng: np.random.Generator
) -> list[Stage]:
    """Return the shapes in turn, as many as there is time for, and the way back; rests fill the time."""
    stages = [Stage("above the pads", 0.0, 1.0, pads_m)]
    for name in cycle(shapes):
        here_m = stages[-1].positions_m
        points = SHAPES[name](len(pads_m))
        turn = rng.uniform(0.0, 2.0 * np.pi)
        c, s = np.cos(turn), np.sin(turn)
        points = points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        shape_m = scaled(points, least_m, LEAST_HEIGHT_M)
        _, columns = linear_sum_assignment(squares(here_m, shape_m))
        there_m = shape_m[columns]
        begin_s = stages[-1].end_s + HOLD_S
        end_s = begin_s + over_s(there_m - here_m)
        if len(stages) > 1 and end_s + HOLD_S + over_s(pads_m - there_m) > seconds:
            break
        stages.append(Stage(name, begin_s, end_s, there_m))
    begin_s, here_m = stages[-1].end_s + HOLD_S, stages[-1].positions_m
    _, columns = linear_sum_assignment(squares(here_m, pads_m))
    back_m = pads_m[columns]
    stages.append(Stage("back", begin_s, begin_s + over_s(back_m - here_m), back_m))
    longer_s = max(seconds - stages[-1].end_s, 0.0) / (len(stages) - 1)  # of each rest
    return [
        replace(stage, begin_s=stage.begin_s + at * longer_s, end_s=stage.end_s + at * longer_s)
        for at, stage in enumerate(stages)
    ]


def drawn_show(
    vehicles: int,
    seconds: float,
    spacing: float,
    shapes: Sequence[str] = tuple(SHAPES),
    seed: int = 1,
    ground_m: Array | None = None,
) -> DrawnShow:
    """Return a show of about so many seconds at a spacing in m, flyable within the limits above.

    `ground_m` (n, 3): the pads, at least sqrt(2) spacings apart; None: a grid with that distance.
    """
    rng = np.random.default_rng(seed)
    least_m = 1.001 * np.sqrt(2.0) * spacing  # files are rounded
    if ground_m is None:
        pads_m = scaled(grid(vehicles), least_m, TAKEOFF_HEIGHT_M)
    else:
        pads_m = ground_m - (0.0, 0.0, TAKEOFF_HEIGHT_M)
    return of_stages(_stages(pads_m, seconds, least_m, shapes, rng), spacing)


def main(arguments: list[str]) -> None:
    """Write the show that the command line describes."""
    from gcs.shows.formats import write_drawing  # noqa: PLC0415 - tests that make shows need no formats

    vehicles, seconds, spacing, path, *shapes = arguments
    show = drawn_show(int(vehicles), float(seconds), float(spacing), shapes or tuple(SHAPES))
    write_drawing(show, Path(path))


if __name__ == "__main__":
    main(sys.argv[1:])
