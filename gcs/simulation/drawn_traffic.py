"""Drawn shows in which vehicles pass each other at the spacing of the show: drawn for each seed.

Two kinds by turns, turned by a random angle. Opposing: lanes one spacing apart, flown both ways at a time.
Crossing: two groups cross at right angles at one height, their rows so that no two come closer than that.
"""

from colorsys import hsv_to_rgb
from dataclasses import dataclass
from hashlib import sha256
from itertools import pairwise

import numpy as np
import scipy

from gcs.model.frames import ShowFrame
from gcs.model.state import Array
from gcs.shows import LoadedShow, parse
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
from gcs.shows.importing import show_text
from gcs.shows.timeline import shortest_s
from gcs.simulation.scenario import DrawnTraffic

ORIGIN = ShowFrame(47.397742, 8.545594, 488.0, 40.0)
STRETCH = np.array([1.0, 1.0, 1.5])  # of distances sideways, and up and down, for the same safety
SPEED_MAX_M_S, CLIMB_MAX_M_S, SINK_MAX_M_S, ACCELERATION_MAX_M_S2 = 4.0, 2.2, 1.2, 2.0
FACING_M_S2 = 1.0  # with which vehicles that come to rest facing each other brake at most
TAKEOFF_HEIGHT_M, LEAST_HEIGHT_M, HOLD_S = 5.0, 8.0, 3.0

KINDS = ("opposing", "crossing")
NEARLY = 1.001  # files are rounded
LEVEL = 1.5  # spacings from one height to the next


def grid(count: int) -> Array:
    columns = int(np.ceil(np.sqrt(count)))
    index = np.arange(count)
    return np.stack([index // columns, index % columns, np.zeros(count)], axis=1).astype(float)


def spacing_m(positions_m: Array) -> float:
    """Least distance of n positions, up and down divided by 1.5."""
    if len(positions_m) < 2:
        return np.inf
    away_m, _ = scipy.spatial.cKDTree(positions_m / STRETCH).query(positions_m / STRETCH, k=[2])
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


def over_s(moves_m: Array, acceleration_m_s2: float = ACCELERATION_MAX_M_S2) -> float:
    """Time in which no vehicle of a transition exceeds a limit."""
    sideways_m = float(np.linalg.norm(moves_m[:, :2], axis=1).max())
    climb_m, sink_m = float(np.max(-moves_m[:, 2], initial=0.0)), float(np.max(moves_m[:, 2], initial=0.0))
    whole_m = float(np.linalg.norm(moves_m, axis=1).max())
    limits = ((sideways_m, SPEED_MAX_M_S), (climb_m, CLIMB_MAX_M_S), (sink_m, SINK_MAX_M_S))
    longest_s = max(shortest_s(size_m, rate_m_s, np.inf) for size_m, rate_m_s in limits)
    return float(np.ceil(max(longest_s, shortest_s(whole_m, np.inf, acceleration_m_s2), 1.0) + 0.05))


def squares(from_m: Array, to_m: Array) -> Array:
    apart_m = (from_m[:, None] - to_m[None]) / STRETCH
    return np.asarray((apart_m**2).sum(axis=2))


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


def _crossing_m(count: int, spacing: float, half_m: float) -> tuple[Array, Array]:
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


def traffic_show(traffic: DrawnTraffic, count: int, seed: int) -> DrawnShow:
    """The show of this seed, with so many vehicles."""
    random, spacing = np.random.default_rng([seed, 13]), traffic.spacing_m
    kind, half_m = KINDS[seed % len(KINDS)], float(random.uniform(12.0, 30.0))
    fast_m_s = float(random.uniform(traffic.speed_min_m_s, traffic.speed_max_m_s))
    if kind == "opposing":
        begin_m, end_m = _opposing_m(count, spacing, half_m, random)
    else:
        begin_m, end_m = _crossing_m(count, spacing, half_m)
    turn_rad = random.uniform(0.0, 2.0 * np.pi)
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    turned = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    begin_m, end_m = begin_m @ turned, end_m @ turned
    pads_m = scaled(grid(count), np.sqrt(2.0) * spacing * NEARLY, TAKEOFF_HEIGHT_M)
    _, rows = scipy.optimize.linear_sum_assignment(squares(pads_m, begin_m))
    begin_m, end_m = begin_m[rows], end_m[rows]
    stages, passing_s = [Stage("above the pads", 0.0, 1.0, pads_m)], over_s(end_m - begin_m)
    passing_s *= max(1.0, 1.875 * np.linalg.norm(end_m - begin_m, axis=1).max() / passing_s / fast_m_s)
    for name, to_m in (("apart", begin_m), ("through", end_m), ("back through", begin_m), ("back", pads_m)):
        here_m = stages[-1].positions_m
        lasts_s = passing_s if "through" in name else over_s(to_m - here_m, FACING_M_S2)
        begin_s = stages[-1].end_s + HOLD_S
        stages.append(Stage(name, begin_s, begin_s + float(np.ceil(lasts_s)), to_m))
    return of_stages(stages, spacing)


def loaded_traffic(traffic: DrawnTraffic, count: int, seed: int) -> LoadedShow:
    """The same as a show file that was imported."""
    drawn, name = traffic_show(traffic, count, seed), f"traffic-{seed}"
    digest = sha256(f"{traffic} {count} {seed}".encode()).hexdigest()
    return parse(show_text(drawn, f"{name}.skyc", digest), f"{name}.yaml", (drawn, digest))
