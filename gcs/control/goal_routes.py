"""Routes past the paths that lost vehicles may take, to goals and to slots (decision 0042).

A tangent sees one obstacle, and no height: walls of columns held vehicles on three sides, and one that
climbed over them came down again before it was past. A route is searched in space, and remembered.
All distances are in the floor's metric, in which the filter keeps the same distance in every direction.
"""

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from gcs.control.inputs import TickInputs
from gcs.control.memory import CORNERS, GoalRoutes
from gcs.control.path_search import BEGUN_SHARE, along_m, find_corners, from_paths_m, sees
from gcs.control.routes_among_boxes import Boxes, boxes_of, is_clear_round, passes_boxes, way_among
from gcs.model.jit import kernel
from gcs.model.state import TINY, Array, Mask

ROUTE_SPARE_M, SEEN_SPARE_M = 0.6, 0.2
"""A route keeps this much more than the filter demands; the straight way to a corner, this much."""

BEYOND_M, REACHED_M = 2.0, 1.0
"""A vehicle farther than the first from a corner aims as far beyond it. Nearer than the second it goes on."""

NARROWS_M = 0.005
"""A route that leads nearer to a path by less than this, inside its margin, is no passage."""

CELL_M, CELLS_MAX = 1.0, 200_000
"""Edge of a cell of the search; larger where there would be more cells than that."""

MARGINS = 3.0
"""The search goes this many kept distances beyond start and goal, and past all paths that are near."""

AGAIN_S, FAILED_AGAIN_S = 4.0, 15.0
"""A vehicle that sees no corner searches again after the first time; where no route led on, the second."""

STUCK_S, STUCK_ASSEMBLING_S, STUCK_M = 6.0, 3.0, 6.0
"""A vehicle off its slot that has not left a place by the third for the first is led by a route. While the
formation assembles, its slots stand, and the second suffices.
"""

STALLED_S, STALLED_M, STANDING_M_S = 16.0, 6.0, 0.3
"""A vehicle is stalled that has not left a place by the second for the first. Then its route also leads past
vehicles slower than the third; when it stalls once more, no longer.
"""

THERE_M = 3.0
"""A vehicle this near to its goal, slot or end of route is not led. A goal moved by more is a new one."""


def _later(
    before: GoalRoutes, rows: NDArray[np.intp], time_s: float, position_m: Array, goal_m: Array
) -> GoalRoutes:
    """Drop the routes of those rows (k,) with another goal (k, 3), and of stalled vehicles."""
    routes = GoalRoutes(**{each.name: getattr(before, each.name).copy() for each in fields(before)})
    anew = ~(np.linalg.norm(goal_m - before.goal_m[rows], axis=1) < THERE_M)
    left = ~(np.linalg.norm(position_m - before.place_m[rows], axis=1) < STALLED_M) | anew
    left |= np.linalg.norm(goal_m - position_m, axis=1) < THERE_M
    routes.goal_m[rows], routes.wary[rows[anew]] = goal_m, False
    routes.place_m[rows[left]], routes.since_s[rows[left]] = position_m[left], time_s
    stalled = time_s - routes.since_s[rows] > STALLED_S
    routes.since_s[rows[stalled]], routes.wary[rows[stalled]] = time_s, ~routes.wary[rows[stalled]]
    dropped, routes.no_way[rows[left]] = rows[anew | stalled], False
    routes.corner_m[dropped], routes.next_s[dropped], routes.passage[dropped] = np.nan, -np.inf, False
    return routes


def follow_routes(
    now: TickInputs, before: GoalRoutes | None, slot_m: Array
) -> tuple[Array, NDArray[np.intp], GoalRoutes | None]:
    """Where vehicles aim at, and which do so. At most one route is searched.

    Vehicles that descend or follow a planned path aim at their goals, and so do all while no vehicle is lost.
    One with a goal of its own is led where the way round obstacles is closed, too: round both.
    One in formation that is stuck off its slot follows a route, until it sees its slot or the route ends.

    Args:
        now: inputs of this tick.
        before: routes of the tick before.
        slot_m: (m, 3) of the m vehicles in formation.

    Returns: (n, 3) goals, slots or corners; (k,) rows of the vehicles that fly there; and the routes.
    """
    tasks, time_s = now.tasks, now.fleet.time_s
    if len(tasks.segments_m) == tasks.silent_segments:
        return tasks.goal_m, now.goers, None
    under_way = ~now.descending[now.goers]
    if tasks.follows_planned_path is not None:
        under_way &= ~tasks.follows_planned_path[now.goers]
    rows, goal_m = now.goers[under_way], np.array(tasks.goal_m)
    goal_m[now.rows] = slot_m
    begun = before or GoalRoutes.none(len(now.formed))
    routes = _later(begun, rows, time_s, now.position_m[rows], goal_m[rows])
    stuck, off = _off_slots(now, routes, slot_m)
    boxes, among = boxes_of(now), np.zeros(len(now.formed), np.bool_)
    among[rows] = bool(now.ellipses)
    aim_m, seen, led = _towards(now, routes, goal_m, np.concatenate([rows, off]), boxes, among)
    routes.corner_m[off[~led[off]]], routes.no_way[seen] = np.nan, False
    searching = np.concatenate([rows[~seen[rows]], stuck[~seen[stuck]]])
    searching = searching[routes.next_s[searching] <= time_s]
    in_turn = searching[np.argsort(routes.next_s[searching], kind="stable")].tolist()
    row = next((each for each in in_turn if not now.formed[each] or _is_open(now, each, goal_m[each])), None)
    if row is not None:
        wary, passed = bool(routes.wary[row]), boxes if among[row] else None
        corner_m, reaches, routes.passage[row] = _searched(now, row, goal_m[row], passed, wary=wary)
        routes.corner_m[row], routes.goal_m[row] = np.nan, goal_m[row]
        routes.corner_m[row, : len(corner_m)] = corner_m[:CORNERS]
        routes.next_s[row] = time_s + (AGAIN_S if reaches else FAILED_AGAIN_S)
        routes.no_way[row] = not reaches
    routes.passage[~np.isfinite(routes.corner_m[:, 0, 0])] = False
    return aim_m, np.concatenate([now.goers, off[led[off]]]), routes


def _towards(
    now: TickInputs, routes: GoalRoutes, goal_m: Array, rows: NDArray[np.intp], boxes: Boxes, among: Mask
) -> tuple[Array, Mask, Mask]:
    """Where to aim at, (n, 3), from `goal_m` (n, 3); `among` (n,) vehicles go round obstacles.

    Returns also (n,) which of `rows` (k,) see that place, and (n,) which follow a route that has not ended.
    """
    scale, aim_m = now.settings.safety.floor.scale, goal_m.copy()
    seen, led = np.zeros((2, len(goal_m)), dtype=np.bool_)
    for wary in (False, True):
        some = rows[routes.wary[rows] == wary]
        if len(some) == 0:
            continue
        place_m, corner_m = now.position_m[some], routes.corner_m[some] * scale
        path_m, kept_m = _closed(now, some, routes.passage[some], wary=wary)
        about = path_m, kept_m, boxes, among[some]
        some_m, seen[some] = _aims(place_m * scale, goal_m[some] * scale, corner_m, *about)
        corner_m /= scale
        routes.corner_m[some] = corner_m
        ahead_m = some_m / scale - place_m
        at_corner = np.linalg.norm(some_m / scale - goal_m[some], axis=1) > TINY
        away_m = np.linalg.norm(ahead_m, axis=1)
        beyond_m = BEYOND_M * (at_corner & (away_m > BEYOND_M)) / np.maximum(away_m, TINY)
        aim_m[some] = place_m + (1.0 + beyond_m[:, None]) * ahead_m
        last = np.maximum(np.isfinite(corner_m[:, :, 0]).sum(axis=1) - 1, 0)
        left_m = np.linalg.norm(corner_m[np.arange(len(some)), last] - place_m, axis=1)
        led[some] = at_corner & (left_m > THERE_M)
    return aim_m, seen, led


def _off_slots(
    now: TickInputs, routes: GoalRoutes, slot_m: Array
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows that are stuck off their slots, (m, 3), and with them those with a route; updates it."""
    rows, time_s = now.rows, now.fleet.time_s
    position_m = now.position_m[rows]
    far = np.linalg.norm(slot_m - position_m, axis=1) > THERE_M
    left = ~far | ~(np.linalg.norm(position_m - routes.place_m[rows], axis=1) < STUCK_M)
    routes.place_m[rows[left]], routes.since_s[rows[left]] = position_m[left], time_s
    anew = rows[left | (np.linalg.norm(slot_m - routes.goal_m[rows], axis=1) > THERE_M)]
    routes.corner_m[rows[~far]], routes.next_s[anew], routes.goal_m[anew] = np.nan, -np.inf, np.nan
    routes.no_way[rows[left]], routes.wary[rows] = False, False
    stuck_s = STUCK_S if now.tasks.center_moves else STUCK_ASSEMBLING_S
    stuck = time_s - routes.since_s[rows] > stuck_s
    return rows[stuck], rows[stuck | np.isfinite(routes.corner_m[rows, 0, 0])]


def _closed(now: TickInputs, rows: NDArray[np.intp], passage: Mask, *, wary: bool) -> tuple[Array, Array]:
    """Closed paths (m, 2, 3), scaled, and the distance (k, m) that vehicles in `rows` (k,) keep from each.

    `passage` (k,): as in `GoalRoutes`. `wary`: other vehicles that stand are closed, too.
    """
    tasks, floor, uncertainty_m = now.tasks, now.settings.safety.floor, np.array(now.traits.uncertainty_m)
    path_m = np.array(tasks.segments_m[: len(tasks.segments_m) - tasks.silent_segments])
    lost_m = np.full(len(path_m), uncertainty_m.max(initial=0.0))
    if tasks.segments_of is not None:
        lost_m = uncertainty_m[tasks.segments_of[: len(path_m)]]
    least_m, own_m = floor.horizontal_m + floor.margin_m, uncertainty_m[rows, None]
    kept_m = least_m - floor.margin_m * passage[:, None] + floor.reserve_m(own_m, lost_m)
    if wary:
        slow = np.linalg.norm(now.velocity_m_s, axis=1) < STANDING_M_S
        stands = np.flatnonzero(slow & tasks.airborne & np.isfinite(now.position_m).all(axis=1))
        path_m = np.concatenate([path_m, np.repeat(now.position_m[stands, None], 2, axis=1)])
        from_m = least_m + floor.reserve_m(own_m, uncertainty_m[stands])
        kept_m = np.concatenate([kept_m, np.where(stands == rows[:, None], 0.0, from_m)], axis=1)
    return path_m * floor.scale, kept_m


def _is_open(now: TickInputs, row: int, slot_m: Array) -> bool:
    """Whether a slot (3,) of that row is clear of all paths; if not, it is soon moved out."""
    path_m, kept_m = _closed(now, np.array([row]), np.array([True]), wary=False)
    away_m = from_paths_m(slot_m * now.settings.safety.floor.scale, path_m)
    return bool((away_m > kept_m[0]).all())


def _searched(
    now: TickInputs, row: int, goal_m: Array, boxes: Boxes | None, *, wary: bool
) -> tuple[Array, bool, bool]:
    """A route of that row to its goal (3,), or near it. `boxes` are to be passed; None: no matter.

    Returns: corners (k, 3), whether they reach the goal, and whether they need a passage (`GoalRoutes`).
    """
    settings, both = now.settings, np.array([row, row])
    path_m, (kept_m, passage_m) = _closed(now, both, np.array([False, True]), wary=wary)
    scale, fence, limits = settings.safety.floor.scale, settings.safety.fence, settings.safety.limits
    path_m, kept_m, passage_m = path_m[kept_m > 0.0], kept_m[kept_m > 0.0], passage_m[kept_m > 0.0]
    start_m, goal_m = now.position_m[row] * scale, goal_m * scale
    low_m = np.minimum(start_m, goal_m) - MARGINS * kept_m.max()
    high_m = np.maximum(start_m, goal_m) + MARGINS * kept_m.max()
    path_low_m = path_m.min(axis=1) - kept_m[:, None] - 2.0 * CELL_M
    path_high_m = path_m.max(axis=1) + kept_m[:, None] + 2.0 * CELL_M
    near = ((path_high_m > low_m) & (path_low_m < high_m))[:, :2].all(axis=1)
    if near.any():
        low_m = np.minimum(low_m, path_low_m[near].min(axis=0))
        high_m[:2] = np.maximum(high_m[:2], path_high_m[near, :2].max(axis=0))
    low_m[2] = min(max(low_m[2], -fence.height_max_m * scale[2]), start_m[2])
    high_m[2] = max(min(high_m[2], -fence.height_min_m * scale[2]), start_m[2])
    cell_m = CELL_M
    while np.prod((high_m - low_m) / cell_m + 2.0) > CELLS_MAX:
        cell_m *= 1.25
    clear_m = np.minimum(kept_m + ROUTE_SPARE_M, BEGUN_SHARE * from_paths_m(start_m, path_m))
    clear_m = np.minimum(clear_m, np.maximum(BEGUN_SHARE * from_paths_m(goal_m, path_m), kept_m))
    climb_cost = settings.law.speed_m_s / min(limits.up_m_s, limits.down_m_s) / scale[2]
    bounds = low_m, high_m, cell_m, climb_cost, fence.distance_max_m
    corner_m, reaches = find_corners(start_m, goal_m, path_m, clear_m, *bounds)
    if boxes is not None and not _passes_boxes(start_m, corner_m, boxes):
        round_m = way_among(start_m, goal_m, boxes, path_m, clear_m)
        if round_m is None:
            clear_m = np.minimum(clear_m, passage_m)
            round_m = way_among(start_m, goal_m, boxes, path_m, clear_m)
        corner_m, reaches = (corner_m, reaches) if round_m is None else (round_m, True)
    if reaches:  # inside a margin it may lead nearer to a path: the filter would hold the vehicle there
        nearest_m = along_m(start_m, corner_m, path_m)
        narrows = nearest_m < np.minimum(kept_m, from_paths_m(start_m, path_m) - NARROWS_M)
        return corner_m / scale, True, bool(narrows.any())
    through_m, reaches = find_corners(start_m, goal_m, path_m, np.minimum(clear_m, passage_m), *bounds)
    return (through_m if reaches else corner_m) / scale, reaches, reaches


@kernel
def _passes_boxes(start_m: Array, corner_m: Array, boxes: Boxes) -> bool:
    """Whether a way from (3,) by corners (k, 3) passes all obstacles."""
    before_m = start_m
    for k in range(len(corner_m)):
        if not passes_boxes(before_m, corner_m[k], boxes):
            return False
        before_m = corner_m[k]
    return True


@kernel
def _aims(
    place_m: Array,
    goal_m: Array,
    corner_m: Array,
    path_m: Array,
    kept_m: Array,
    boxes: Boxes,
    among: Mask,
) -> tuple[Array, Mask]:
    """The farthest of goal and corners that each sees, (k, 3), and whether it sees any, (k,).

    One that sees none goes on to the first corner that is left, if there is one, else to the goal.

    Args:
        place_m: (k, 3).
        goal_m: (k, 3).
        corner_m: (k, CORNERS, 3), NaN after the last; those that are passed are dropped.
        path_m: (m, 2, 3) closed.
        kept_m: (k, m) distances to be kept.
        boxes: obstacles.
        among: (k,) which go round these. One without a route sees its goal where that way is clear of all
            paths; one with a route, where the straight way is clear of both: it goes to and fro otherwise.
    """
    aim_m, seen = goal_m.copy(), np.zeros(len(place_m), np.bool_)
    for i in range(len(place_m)):
        routed = np.isfinite(corner_m[i, 0, 0])
        if among[i] and not routed:
            seen[i] = is_clear_round(place_m[i], goal_m[i], boxes, path_m, kept_m[i], SEEN_SPARE_M)
        else:
            seen[i] = sees(place_m[i], goal_m[i], path_m, kept_m[i], SEEN_SPARE_M) and (
                not among[i] or passes_boxes(place_m[i], goal_m[i], boxes)
            )
        if seen[i] or not routed:
            continue
        passed = 0
        for k in range(CORNERS - 1, -1, -1):
            if (
                np.isfinite(corner_m[i, k, 0])
                and sees(place_m[i], corner_m[i, k], path_m, kept_m[i], SEEN_SPARE_M)
                and (not among[i] or passes_boxes(place_m[i], corner_m[i, k], boxes))
            ):
                passed, seen[i] = k, True
                break
        left = passed + 1 < CORNERS and np.isfinite(corner_m[i, min(passed + 1, CORNERS - 1), 0])
        if left and ((corner_m[i, passed] - place_m[i]) ** 2).sum() < REACHED_M**2:
            passed += 1
        if passed:
            corner_m[i, : CORNERS - passed] = corner_m[i, passed:].copy()
            corner_m[i, CORNERS - passed :] = np.nan
        aim_m[i] = corner_m[i, 0]
    return aim_m, seen
