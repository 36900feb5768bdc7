"""Ways within the fence's areas and the controlled ground, past their corners, to goals and slots. Pure.

A vehicle that flies straight stops where a wall is in the way, and stays there. Where it does not see its
goal, it aims at the first corner of the shortest way: through points beside those corners of walls that ways
bend about, which see each other (a visibility graph, all pairs by Floyd and Warshall). Walls count that stand
between the heights of vehicle and goal; a wall of the controlled ground is as thick as vehicles fall far.
Graphs are made before the first tick (`gcs.control.area_graphs`); without them vehicles fly straight.
"""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.control.area_graphs import KEPT_M, AreaGraphs, WallsAt, band_of, layer_of, prepared_ways
from gcs.control.inputs import TickInputs
from gcs.control.memory import AreaWays
from gcs.control.path_search import BEGUN_SHARE, from_paths_m, sees
from gcs.model.jit import kernel
from gcs.model.state import TINY, Array, Mask
from gcs.safety.fenced_areas import PASSES_M

SPARES_M: Final = (1.0, 0.1)
"""What a way keeps from walls beyond what the filter keeps; the second where the first finds no way."""

STANDOFF_STEP_M: Final = 0.25
"""What the filter keeps is rounded up to this."""

BEYOND_M: Final = 2.0
"""A vehicle farther from a corner of its way than this aims as far beyond it."""

THERE_M: Final = 3.0
"""A vehicle in formation this near to its slot flies straight."""

TAKEN_SEEN_M, STANDS_M_S = 12.0, 1.0
"""So near to its corner a vehicle looks whether another one, slower than this, stands there."""

OVER_M, LOW_M = 2.0, 3.0
"""One that is so much higher passes over it, another one under it, where that leaves so much height."""

SEARCHED_MAX: Final = 4
"""Ways that are looked up in one tick; the others keep their corners, and come next."""


def lead_within(
    now: TickInputs, before: AreaWays | None, aim_m: Array, aiming: NDArray[np.intp], slot_m: Array
) -> tuple[Array, NDArray[np.intp], AreaWays | None]:
    """Where vehicles aim at so that no wall of the fence is in the way.

    Args:
        now: inputs of this tick.
        before: ways of the tick before.
        aim_m: (n, 3) where they would fly straight.
        aiming: (k,) rows that do.
        slot_m: (m, 3) of the m vehicles in formation.

    Returns: aims (n, 3), rows of vehicles that fly there, and the ways.
    """
    safety = now.settings.safety
    if safety.fence.is_plain or (graphs := prepared_ways(safety)) is None:
        return aim_m, aiming, None
    place_m, goal_m, aims = now.position_m, np.array(aim_m), np.zeros(len(aim_m), np.bool_)
    aims[aiming] = True
    rows = _under_way(now, place_m, goal_m, aims, slot_m)
    standoff_m = _standoff_m(now)
    least_m = standoff_m + SPARES_M[1]
    layer = layer_of(least_m)
    walls, step_m = graphs.walls, graphs.step_m
    hidden = _hidden(place_m, goal_m, rows, walls, step_m, layer, least_m - KEPT_M[layer])
    ways = before or AreaWays.none(len(now.formed))
    ways = replace(ways, corner_m=ways.corner_m.copy(), asked_s=ways.asked_s.copy())
    seen = np.ones(len(now.formed), np.bool_)
    seen[hidden] = False
    ways.corner_m[seen] = np.nan
    in_turn = hidden[np.argsort(ways.asked_s[hidden], kind="stable")][:SEARCHED_MAX]
    for row in in_turn.tolist():
        ways.corner_m[row] = _first_corner(graphs, standoff_m, place_m[row], goal_m[row])
        ways.asked_s[row] = now.fleet.time_s
    led = hidden[np.isfinite(ways.corner_m[hidden, 0])]
    if len(led) == 0:
        return aim_m, aiming, ways
    aim_m = np.array(aim_m)
    ahead_m = ways.corner_m[led] - place_m[led, :2]
    away_m = np.linalg.norm(ahead_m, axis=1)
    beyond = BEYOND_M * (away_m > BEYOND_M) / np.maximum(away_m, TINY)
    aim_m[led, :2] = place_m[led, :2] + (1.0 + beyond[:, None]) * ahead_m
    kept_m = safety.floor.kept_m(safety.floor.worst_reserve_m(np.array(now.traits.uncertainty_m)))
    aim_m[led, 2] = goal_m[led, 2]
    goers = led[aims[led]]
    aim_m[goers, 2] = _past_taken_corners(
        goers, ways.corner_m, goal_m, place_m, now.velocity_m_s, kept_m, safety.fence.heights_m
    )
    aims[led] = True
    return aim_m, np.flatnonzero(aims), ways


def _under_way(now: TickInputs, place_m: Array, goal_m: Array, aims: Mask, slot_m: Array) -> NDArray[np.intp]:
    """Rows of vehicles that may need a way; of those in formation the goals (n, 3) become their slots."""
    excused, planned = now.descending, now.tasks.follows_planned_path
    excused = np.array(excused) if planned is None else excused | planned
    return _far_rows(place_m, goal_m, aims & ~excused, aims, now.rows, np.array(slot_m))


@kernel
def _far_rows(
    place_m: Array, goal_m: Array, led: Mask, aims: Mask, rows: NDArray[np.intp], slot_m: Array
) -> NDArray[np.intp]:
    """Those of `led` (n,), and of `rows` (m,) that aim nowhere and are far from their slots (m, 3)."""
    far, count = np.empty(len(goal_m), np.intp), 0
    for i in range(len(goal_m)):
        if led[i]:
            far[count] = i
            count += 1
    for k in range(len(rows)):
        i, square_m2 = rows[k], 0.0
        for axis in range(3):
            square_m2 += (slot_m[k, axis] - place_m[i, axis]) ** 2
        if not aims[i] and square_m2 > THERE_M**2:  # NaN by a law without slots: never
            for axis in range(3):
                goal_m[i, axis] = slot_m[k, axis]
            far[count] = i
            count += 1
    return far[:count]


@kernel
def _past_taken_corners(
    led: NDArray[np.intp],
    corner_m: Array,
    goal_m: Array,
    place_m: Array,
    velocity_m_s: Array,
    kept_m: tuple[float, float],
    heights_m: tuple[float, float],
) -> Array:
    """(k,) z to aim at, of rows `led` (k,): that of the goal, or under, else over, what stands at the corner.

    There is only one way about a corner (n, 2). A vehicle that stands at it gives no way: it is at its goal.
    `kept_m` are the semi-axes that a pair keeps, `heights_m` those that the fence allows.
    """
    z_m, (aside_m, apart_m) = np.empty(len(led)), kept_m
    for k in range(len(led)):
        i = led[k]
        z_m[k] = goal_m[i, 2]
        x_m, y_m = corner_m[i, 0], corner_m[i, 1]
        if np.hypot(x_m - place_m[i, 0], y_m - place_m[i, 1]) > TAKEN_SEEN_M:
            continue
        for j in range(len(place_m)):
            if not abs(x_m - place_m[j, 0]) < aside_m or not abs(y_m - place_m[j, 1]) < aside_m or j == i:
                continue
            if not (velocity_m_s[j] ** 2).sum() < STANDS_M_S**2:
                continue
            over = place_m[i, 2] < place_m[j, 2] - OVER_M or -place_m[j, 2] - apart_m < heights_m[0] + LOW_M
            if over and -place_m[j, 2] + apart_m < heights_m[1] - PASSES_M:
                z_m[k] = min(z_m[k], place_m[j, 2] - apart_m)
            elif not over:
                z_m[k] = max(z_m[k], place_m[j, 2] + apart_m)
    return z_m


def _standoff_m(now: TickInputs) -> float:
    """What the filter keeps all vehicles that are flown from walls in this tick, rounded up.

    No more than graphs keep: one receiver without a fix would else hide the goals of all others.
    """
    kept_m = now.settings.safety.floor.off_walls_m(np.array(now.traits.uncertainty_m))
    most_m = np.fmax.reduce(kept_m, where=now.commanded, initial=0.0)
    return float(min(STANDOFF_STEP_M * np.ceil(most_m / STANDOFF_STEP_M), KEPT_M[-1]))


@kernel
def _hidden(
    position_m: Array,
    goal_m: Array,
    rows: NDArray[np.intp],
    walls: WallsAt,
    step_m: float,
    layer: int,
    more_m: float,
) -> NDArray[np.intp]:
    """Those of `rows` (k,) that do not see their goals (n, 3), from (n, 3), past the walls of their heights.

    Walls are those of `layer` of `KEPT_M`; a straight way keeps `more_m` more. It may come as near to a wall
    as the goal itself is.
    """
    hidden, count = np.empty(len(rows), np.intp), 0
    here_m, there_m = np.zeros(3), np.zeros(3)
    for i in rows:
        if not np.isfinite(position_m[i].sum() + goal_m[i].sum()):
            continue
        low, high = band_of(position_m[i], goal_m[i], step_m, walls.at.shape[1] - 1)
        begin, end = walls.first[walls.at[layer, low, high]], walls.first[walls.at[layer, low, high] + 1]
        here_m[:2], there_m[:2] = position_m[i, :2], goal_m[i, :2]
        if not sees(here_m, there_m, walls.edge_m[begin:end], walls.kept_m[begin:end], more_m, True):
            hidden[count] = i
            count += 1
    return hidden[:count]


def _first_corner(ways: AreaGraphs, standoff_m: float, place_m: Array, goal_m: Array) -> Array:
    """(2,) the first corner of the shortest way from a place to a goal, (3,) each; NaN: none is known."""
    band = band_of(place_m, goal_m, ways.step_m, ways.walls.at.shape[1] - 1)
    for spare_m in SPARES_M:
        graph, _ = ways.graph(band, standoff_m + spare_m)
        first = _first(place_m, goal_m, *graph)
        if first >= 0:
            return np.array(graph.point_m[first, :2])
    return np.full(2, np.nan)


@kernel
def _first(
    place_m: Array, goal_m: Array, edge_m: Array, kept_m: Array, point_m: Array, between_m: Array
) -> int:
    """The first point of the shortest way over the ground from place to goal, (3,) each; -1: there is none.

    Places nearer to walls than is kept come no nearer to them.
    """
    count, place_m, goal_m = len(point_m), place_m.copy(), goal_m.copy()
    place_m[2] = goal_m[2] = 0.0
    begun_m = np.minimum(kept_m, BEGUN_SHARE * from_paths_m(place_m, edge_m))
    ends_m = np.minimum(kept_m, BEGUN_SHARE * from_paths_m(goal_m, edge_m))
    left_m = np.full(count, np.inf)
    for j in range(count):
        if sees(point_m[j], goal_m, edge_m, ends_m, 0.0):
            last_m = np.sqrt(((point_m[j] - goal_m) ** 2).sum())
            for i in range(count):
                left_m[i] = min(left_m[i], between_m[i, j] + last_m)
    for i in range(count):
        left_m[i] += np.sqrt(((point_m[i] - place_m) ** 2).sum())
    while count > 0:
        nearest = int(np.argmin(left_m))
        if left_m[nearest] == np.inf:
            return -1
        if sees(place_m, point_m[nearest], edge_m, begun_m, 0.0):
            return nearest
        left_m[nearest] = np.inf
    return -1
