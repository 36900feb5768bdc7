"""Makes drawn shows of any size: a fleet morphs from shape to shape at a given spacing. Seeded.

The spacing holds by construction. All vehicles of a transition move on straight lines with one time law, from
points at least sqrt(2) spacings apart to points as far apart, assigned with the least sum of squares. They
then stay one spacing apart: Turpin, Michael and Kumar, "CAPT", Int. J. Robotics Research 33, 2014.
Distances are those of the floor between vehicles: up and down 1.5 times as much as sideways.

`python -m tests.support.drawn_shows 500 300 3.0 OUT.skyc [SHAPE ...]` writes one: vehicles, seconds, spacing.
"""

import sys
from collections.abc import Callable, Sequence
from colorsys import hsv_to_rgb
from dataclasses import dataclass, replace
from itertools import cycle, pairwise
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from gcs.model.frames import ShowFrame
from gcs.model.state import Array
from gcs.shows.drawn import (
    Claims,
    DrawnCue,
    DrawnShow,
    FencePolygon,
    LightPrograms,
    Trajectories,
    Trajectory,
    YawPrograms,
)
from gcs.shows.drawn.light_programs import LightProgram
from gcs.shows.drawn.yaw_programs import YawProgram
from gcs.shows.timeline import shortest_s

ORIGIN = ShowFrame(47.397742, 8.545594, 488.0, 40.0)
STRETCH = np.array([1.0, 1.0, 1.5])  # of distances sideways, and up and down, for the same safety
SPEED_MAX_M_S, CLIMB_MAX_M_S, SINK_MAX_M_S, ACCELERATION_MAX_M_S2 = 4.0, 2.2, 1.2, 2.0
TAKEOFF_HEIGHT_M, LEAST_HEIGHT_M, HOLD_S = 5.0, 8.0, 3.0


def grid(count: int) -> Array:
    columns = int(np.ceil(np.sqrt(count)))
    index = np.arange(count)
    return np.stack([index // columns, index % columns, np.zeros(count)], axis=1).astype(float)


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


def spacing_m(positions_m: Array) -> float:
    """Least distance of n positions, up and down divided by 1.5."""
    if len(positions_m) < 2:
        return np.inf
    away_m, _ = cKDTree(positions_m / STRETCH).query(positions_m / STRETCH, k=[2])
    return float(np.min(away_m))


def scaled(points: Array, least_m: float, lowest_m: float) -> Array:
    """Return a pattern at its least size, about the origin, its lowest point at a height; z down."""
    stretched = points * STRETCH
    stretched = stretched * (least_m / spacing_m(stretched))
    stretched[:, :2] -= (stretched[:, :2].min(axis=0) + stretched[:, :2].max(axis=0)) / 2.0
    stretched[:, 2] = -(stretched[:, 2] - stretched[:, 2].min() + lowest_m)
    return np.asarray(stretched)


@dataclass(frozen=True)
class Stage:
    """All vehicles move on straight lines, with one time law, to these positions."""

    name: str
    begin_s: float
    end_s: float
    positions_m: Array  # (n, 3) at its end


def over_s(moves_m: Array) -> float:
    """Time in which no vehicle of a transition exceeds a limit."""
    sideways_m = float(np.linalg.norm(moves_m[:, :2], axis=1).max())
    climb_m, sink_m = float(np.max(-moves_m[:, 2], initial=0.0)), float(np.max(moves_m[:, 2], initial=0.0))
    whole_m = float(np.linalg.norm(moves_m, axis=1).max())
    limits = ((sideways_m, SPEED_MAX_M_S), (climb_m, CLIMB_MAX_M_S), (sink_m, SINK_MAX_M_S))
    longest_s = max(shortest_s(size_m, rate_m_s, np.inf) for size_m, rate_m_s in limits)
    return float(np.ceil(max(longest_s, shortest_s(whole_m, np.inf, ACCELERATION_MAX_M_S2), 1.0) + 0.05))


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


def squares(from_m: Array, to_m: Array) -> Array:
    apart_m = (from_m[:, None] - to_m[None]) / STRETCH
    return np.asarray((apart_m**2).sum(axis=2))


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


def of_stages(stages: list[Stage], spacing: float) -> DrawnShow:
    """Return the show that begins and ends above its pads, and keeps this spacing in m."""
    pads_m, vehicles = stages[0].positions_m, len(stages[0].positions_m)
    trajectories = Trajectories.joined([_trajectory(stages, row) for row in range(vehicles)])
    end_s = stages[-1].end_s
    reach_m = 10.0 + float(np.abs(trajectories.hull_m()[:, :2]).max())
    corners_m = reach_m * np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])
    return DrawnShow(
        title=f"{vehicles} vehicles {spacing:g} m apart",
        vehicles=tuple(f"drone {row + 1}" for row in range(vehicles)),
        trajectories=trajectories,
        lights=LightPrograms.joined([_lights(stages, row, vehicles) for row in range(vehicles)]),
        yaw=YawPrograms.joined([YawProgram(np.array([0.0, end_s]), np.array([0.0, np.pi]))] * vehicles),
        home_m=pads_m * (1.0, 1.0, 0.0),
        takeoff_s=np.zeros(vehicles),
        landing_s=np.full(vehicles, end_s),
        origin=ORIGIN,
        show_s=(0.0, end_s),
        cues=tuple(DrawnCue(f"{at} {stage.name}", stage.begin_s) for at, stage in enumerate(stages)),
        claims=Claims(
            separation_min_m=spacing,
            speed_max_m_s=SPEED_MAX_M_S,
            climb_max_m_s=CLIMB_MAX_M_S,
            sink_max_m_s=SINK_MAX_M_S,
            height_max_m=float(-trajectories.hull_m()[0, 2]),
        ),
        fence=(FencePolygon(corners_m),),
    )


def _trajectory(stages: list[Stage], row: int) -> Trajectory:
    """Return rests, and between them straight lines with the time law 10 u^3 - 15 u^4 + 6 u^5."""
    times_s, pieces = [0.0, stages[0].end_s], [np.zeros((6, 3))]
    pieces[0][0] = stages[0].positions_m[row]
    for before, stage in pairwise(stages):
        from_m, to_m = before.positions_m[row], stage.positions_m[row]
        rest_m = np.zeros((6, 3))
        rest_m[0] = from_m
        pieces += [rest_m, rest_m + np.outer((0.0, 0.0, 0.0, 10.0, -15.0, 6.0), to_m - from_m)]
        times_s += [stage.begin_s, stage.end_s]
    return Trajectory(np.array(times_s), np.stack(pieces))


def _lights(stages: list[Stage], row: int, vehicles: int) -> LightProgram:
    """Return a colour for each shape, shaded along the fleet, with fades while they morph."""
    times_s, before, after = [0.0], [], []
    now = np.zeros(3, np.uint8)
    for at, stage in enumerate(stages):
        hue = (0.37 * at + 0.25 * row / vehicles) % 1.0
        colour = np.rint(255.0 * np.array(hsv_to_rgb(hue, 1.0, 1.0))).astype(np.uint8)
        if stage.begin_s > times_s[-1]:
            times_s.append(stage.begin_s)
            before.append(now)
            after.append(now)
        times_s.append(stage.end_s)
        before.append(now)
        after.append(colour)
        now = colour
    return LightProgram(np.array(times_s), np.stack(before), np.stack(after))


def main(arguments: list[str]) -> None:
    """Write the show that the command line describes."""
    from gcs.shows.formats import write_drawing  # noqa: PLC0415 - tests that make shows need no formats

    vehicles, seconds, spacing, path, *shapes = arguments
    show = drawn_show(int(vehicles), float(seconds), float(spacing), shapes or tuple(SHAPES))
    write_drawing(show, Path(path))


if __name__ == "__main__":
    main(sys.argv[1:])
