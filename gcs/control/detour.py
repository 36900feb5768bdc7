"""The centre's way past obstacles: planned twice a second with a memory, followed in every tick.

While the law's own way is free, the law leads. Else a route (`gcs.formation.route`) leads round the boxes
with the whole sphere, or over them where the fence allows it, or with a part of the sphere: the vehicles
then pass on both sides by their own tangents. Where nothing leads to the goal, the centre goes to another
place (`gcs.control.center_goals`); where nothing leads there either, it stands. A plan is made over several
ticks, with at most one search in each.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from math import hypot, sqrt

import numpy as np

from gcs.control.center_goals import AT_GOAL_M, goals_of, instead_of
from gcs.control.memory import Detour, Searching
from gcs.control.scene import ALOFT_M, Scene
from gcs.formation.route import (
    Boxes,
    Goal,
    Route,
    find_route,
    in_the_way,
    leaves_now,
    next_leg,
    stays_free,
    timed,
)
from gcs.formation.route_search import CORNERS
from gcs.model.state import Array

PLANNED_EVERY_S = 0.5

KEPT_SHARE, KEPT_S = 0.1, 1.0
"""A route is kept while no other arrives earlier by more than this share and time."""

WAITS_S = 8.0
"""A centre at its goal leaves it when it could no longer leave this much later."""

GAINED_M = 1.0
"""Headway: the way to the goal became this much shorter."""

OVERSHOOT_M = 1.0
"""A centre that turns at a corner may leave its route by this much; the boxes are grown by more than that."""

TURNED_FOR_S = 60.0
"""So long after an obstacle turned no way without headway is believed: motion is not what it seemed."""

CLEARANCES = (1.0, 0.5, 0.0)
"""Shares of the sphere for which a route is looked for, one after the other."""


def follow_detour(scene: Scene, desired_m_s: Array, before: Detour | None) -> tuple[Array, Detour]:
    """The velocity (3,) of the centre instead of the law's `desired_m_s`, and the detour it follows."""
    time_s = scene.now.fleet.time_s
    detour = before or Detour(time_s - PLANNED_EVERY_S, Goal(scene.place_m, np.zeros(2)))
    stale = not {name for name, _ in detour.corners} <= set(scene.outlines.names)
    due = time_s >= detour.planned_s + PLANNED_EVERY_S - 1e-6
    planning = stale or due or detour.searching is not None
    if planning:
        detour = _planned(scene, detour)
    led_m_s = _followed(scene, desired_m_s, detour)
    if led_m_s is None and not planning:
        detour = _planned(scene, detour)
        led_m_s = _followed(scene, desired_m_s, detour)
    if led_m_s is None:
        led_m_s = np.array([0.0, 0.0, desired_m_s[2]])
    return led_m_s, _headway(scene, detour)


def _followed(scene: Scene, desired_m_s: Array, detour: Detour) -> Array | None:
    """The velocity (3,) along the detour; None where its next leg is no longer free."""
    if not detour.active:
        return desired_m_s
    law = scene.now.settings.law
    goal = detour.goal_now(scene.now.fleet.time_s)
    boxes = scene.boxes(detour.clear, detour.height_m, goal.place_m)
    led_m_s = desired_m_s.copy()
    if detour.height_m is not None:
        climb_m_s = law.goal_rate_per_s * (detour.height_m - scene.height_m)
        led_m_s[2] = -min(max(climb_m_s, -law.climb_max_m_s), law.climb_max_m_s)
        if scene.height_m < detour.height_m - ALOFT_M / 2:
            led_m_s[:2] = 0.0
            return led_m_s
    corners = boxes.numbers(detour.corners)
    speed_m_s = scene.speed_to_m_s(goal)
    leg = next_leg(boxes, scene.place_m, corners, goal, speed_m_s, reaches=detour.reaches)
    if leg is None:
        return None
    left, along_m_s = leg
    if not left:
        if detour.goes_instead:
            along_m_s = scene.towards(goal)
        elif detour.reaches and scene.now.tasks.center_moves and not scene.on_orbit:
            along_m_s = desired_m_s[:2]
        led_m_s[:2] = along_m_s
        return led_m_s
    braking_m_s2 = law.center_acceleration_max_m_s2 / 2
    moving_m_s = boxes.velocity_m_s(left[0])
    corner_m = boxes.corner_m(left[0], 0.0)
    away_m = hypot(*(corner_m - scene.place_m))
    beyond_m = np.zeros(2)  # the next leg
    if len(left) > 1 or detour.reaches:
        beyond_m = (boxes.corner_m(left[1], 0.0) if len(left) > 1 else goal.place_m) - corner_m
    turn_m_s = _turning_speed_m_s(along_m_s, beyond_m, speed_m_s, law.center_acceleration_max_m_s2)
    most_m_s = sqrt(turn_m_s**2 + 2.0 * braking_m_s2 * away_m)
    own_m_s = along_m_s - moving_m_s
    own_m_s *= min(1.0, most_m_s / max(hypot(*own_m_s), 1e-9))
    led_m_s[:2] = moving_m_s + own_m_s
    return led_m_s


def _turning_speed_m_s(along: Array, beyond: Array, speed_m_s: float, most_m_s2: float) -> float:
    """Speed at which a centre on one leg (2,) turns into the next, and leaves it by `OVERSHOOT_M`."""
    lengths = hypot(*along) * hypot(*beyond)
    if float(along @ beyond) <= 0.0:
        return 0.0
    sine = abs(float(along[0] * beyond[1] - along[1] * beyond[0])) / lengths
    return min(speed_m_s, sqrt(2.0 * most_m_s2 * OVERSHOOT_M) / max(sine, 1e-9))


def _planned(scene: Scene, before: Detour) -> Detour:
    """The detour after at most one search more; where no way is believed, one that waits."""
    courses = before.courses.seen(scene.outlines, scene.now.fleet.time_s)
    before = replace(before, courses=courses)
    distrusted = _distrusted(scene, before)
    planned = _searched_anew(scene, before) if distrusted is None else _waits_out(scene, before, distrusted)
    return replace(planned, courses=courses, distrusted=distrusted)


def _distrusted(scene: Scene, before: Detour) -> Goal | None:
    """The goal to which no way is believed: there was no headway, and an obstacle has turned of late."""
    turned_for_s = scene.now.fleet.time_s - before.courses.turned_s
    if turned_for_s > TURNED_FOR_S or scene.outlines.stand.all():
        return None
    goal = before.distrusted
    if goal is None and before.held_by and not before.goes_instead:
        goal = before.goal
    target = next(goals_of(scene, before), None) if goal is not None else None
    if goal is None or target is None or hypot(*(target.place_m - goal.place_m)) > AT_GOAL_M:
        return None
    return goal


def _waits_out(scene: Scene, before: Detour, goal: Goal) -> Detour:
    """The detour of a centre that waits where it is while it can, and goes to open ground else."""
    time_s, searching = scene.now.fleet.time_s, before.searching
    if searching is None and stays_free(scene.boxes(1.0, None, None), scene.place_m, WAITS_S):
        return replace(before, planned_s=time_s, goal=goal, corners=(), reaches=False, active=True)
    if searching is None:
        places = tuple(instead_of(scene, goal.place_m, goal.velocity_m_s, before))
        searching = Searching(time_s, places or (goal,), widened=True)
    return _searched(scene, before, searching)


def _searched_anew(scene: Scene, before: Detour) -> Detour:
    """The detour after at most one search more: a better one, or the one before while none is known."""
    if before.searching is not None:
        return _searched(scene, before, before.searching)
    time_s = scene.now.fleet.time_s
    goals = tuple(goals_of(scene, before if before.active else None))
    if not goals:
        return Detour(time_s, Goal(scene.place_m, np.zeros(2)))
    searching = Searching(time_s, goals)
    if goals[0].held_by and before.goes_instead:
        return replace(before, searching=searching)  # followed meanwhile: the next tick searches
    if not goals[0].held_by:
        boxes = scene.boxes(1.0, None, goals[0].place_m)
        if not scene.on_orbit and leaves_now(boxes, scene.place_m, goals[0], scene.speed_m_s):
            return Detour(time_s, goals[0])
        if _may_wait(scene, boxes, goals[0]):
            waits = _waits(scene, boxes, goals[0])
            return Detour(time_s, goals[0]) if waits else replace(before, searching=searching)
    return _searched(scene, before, searching)


def _searched(scene: Scene, before: Detour, searching: Searching) -> Detour:
    """The detour after one search more."""
    time_s = scene.now.fleet.time_s
    tries, after_s = _tries(scene, searching.goals), time_s - searching.begun_s
    nth, clear, height_m = tries[min(searching.tried, len(tries) - 1)]
    goal = searching.goals[nth].later(after_s)
    climb_s, boxes, then = _once_aloft(scene, goal, clear, height_m)
    route = find_route(boxes, scene.place_m, then, scene.speed_to_m_s(goal), scene.fence_m)
    led_to = _led_to(searching, time_s, before)
    kept = None if led_to is None else _kept(scene, searching.goals[led_to].later(after_s), before)
    if route.reaches and _climbs_in_time(scene, height_m):
        there_s = climb_s + route.arrival_s[-1]
        if kept is not None and nth == led_to and there_s > (1.0 - KEPT_SHARE) * kept[1] - KEPT_S:
            return kept[0]
        return _detour(scene, goal, boxes, route, clear, height_m, before)
    if searching.tried == 0 and kept is None and not before.goes_instead:
        before = _detour(scene, goal, boxes, route, clear, height_m, before)  # as near as it can, for now
    left = tries[searching.tried + 1 :]
    if not left and kept is None and not searching.widened:
        searching = _widened(scene, searching, after_s, before)
        left = _tries(scene, searching.goals)[searching.tried + 1 :]
    if left and (kept is None or led_to is None or left[0][0] <= led_to):
        return replace(before, searching=replace(searching, tried=searching.tried + 1))
    if kept is not None:
        return kept[0]
    return replace(before, planned_s=time_s, goal=before.goal_now(time_s), searching=None)


def _widened(scene: Scene, searching: Searching, after_s: float, before: Detour) -> Searching:
    """The search with the places that can be had instead of the goals so far, none of which can."""
    first = searching.goals[0]
    instead: tuple[Goal, ...] = ()
    if not first.held_by:
        place_m = first.later(after_s).place_m
        instead = tuple(instead_of(scene, place_m, first.velocity_m_s, before if before.active else None))
    goals = (*searching.goals, *(goal.later(-after_s) for goal in instead))
    return replace(searching, goals=goals, widened=True)


def _tries(scene: Scene, goals: tuple[Goal, ...]) -> list[tuple[int, float, float | None]]:
    """What is searched for, best first: number of the goal, share of the sphere, height.

    Of the places instead of a target only the first is also looked for over boxes, and with a part of the
    sphere.
    """
    choices = list(_choices(scene))
    return [
        (nth, *choice)
        for nth, goal in enumerate(goals)
        for choice in (choices[:1] if goal.held_by and nth else choices)
    ]


def _led_to(searching: Searching, time_s: float, before: Detour) -> int | None:
    """Which of the goals the detour before leads to; None where it leads to none of them."""
    goals, place_m = searching.goals, before.goal_now(time_s).place_m
    if not before.active or not before.reaches:
        return None
    if not before.goal.held_by:
        return None if goals[0].held_by else 0
    now = [goal.later(time_s - searching.begun_s) for goal in goals]
    off_m = [hypot(*(goal.place_m - place_m)) if goal.held_by else np.inf for goal in now]
    return int(np.argmin(off_m)) if min(off_m) < AT_GOAL_M else None


def _detour(
    scene: Scene,
    goal: Goal,
    boxes: Boxes,
    route: Route,
    clear: float,
    height_m: float | None,
    before: Detour,
) -> Detour:
    time_s = scene.now.fleet.time_s
    corners = tuple((boxes.names[corner // CORNERS], corner % CORNERS) for corner in route.corners)
    best_m, gained_s = (before.best_m, before.gained_s) if before.active else (np.inf, time_s)
    return Detour(time_s, goal, corners, route.reaches, True, clear, height_m, best_m, gained_s)


def _kept(scene: Scene, goal: Goal, before: Detour) -> tuple[Detour, float] | None:
    """The detour before, planned now, and its arrival; None where it no longer leads to the goal."""
    climb_s, boxes, then = _once_aloft(scene, goal, before.clear, before.height_m)
    corners = boxes.numbers(before.corners)
    if len(corners) < len(before.corners):
        return None
    leg = next_leg(boxes, scene.place_m, corners, then, scene.speed_to_m_s(goal), reaches=True)
    if leg is None:
        return None
    route = timed(boxes, scene.place_m, leg[0], then, scene.speed_to_m_s(goal))
    if route is None:
        return None
    detour = _detour(scene, goal, boxes, route, before.clear, before.height_m, before)
    return detour, climb_s + route.arrival_s[-1]


def _choices(scene: Scene) -> Iterator[tuple[float, float | None]]:
    """Shares of the sphere and heights (None: the plan's) to look for a route with, best first."""
    settings, fence = scene.now.settings.law.avoidance, scene.now.settings.safety.fence
    yield 1.0, None
    highest_m = fence.height_max_m - scene.sphere_m
    over_m = np.unique(scene.outlines.top_height_m) + scene.sphere_m + ALOFT_M
    if settings.climbs:
        possible_m = over_m[(over_m > scene.plan_height_m) & (over_m <= highest_m)]
        for height_m in (*possible_m[:1], *possible_m[1:][-1:]):  # lowest and highest: bounded in cost
            yield 1.0, float(height_m)
    for clear in CLEARANCES[1:]:
        yield clear, None


def _once_aloft(scene: Scene, goal: Goal, clear: float, height_m: float | None) -> tuple[float, Boxes, Goal]:
    """Time of the climb to that height, and the boxes in the way there and the goal, both after it."""
    climb_s, boxes = _climb_s(scene, height_m), scene.boxes(clear, height_m, goal.place_m)
    return climb_s, boxes.later(climb_s, scene.place_m) if climb_s else boxes, goal.later(climb_s)


def _climb_s(scene: Scene, height_m: float | None) -> float:
    """Time of a climb straight up to that height, before which the centre flies nowhere."""
    height_m = scene.height_m if height_m is None else height_m
    return max(height_m - scene.height_m, 0.0) / scene.now.settings.law.climb_max_m_s


def _climbs_in_time(scene: Scene, height_m: float | None) -> bool:
    """Whether no box comes over the centre while it climbs to that height."""
    climb_s = _climb_s(scene, height_m)
    return climb_s == 0.0 or stays_free(scene.boxes(1.0, None, None), scene.place_m, climb_s)


def _may_wait(scene: Scene, boxes: Boxes, goal: Goal) -> bool:
    """Whether the centre is at its goal, which a box will come over, but not soon.

    A centre that follows a moving target does not wait: the law would lead it on into the box.
    """
    there = hypot(*(goal.place_m - scene.place_m)) <= AT_GOAL_M
    return (
        there
        and (scene.on_orbit or not goal.velocity_m_s.any())
        and stays_free(boxes, scene.place_m, WAITS_S)
    )


def _waits(scene: Scene, boxes: Boxes, goal: Goal) -> bool:
    """Whether a centre that waits at its goal can still leave it, and return, `WAITS_S` later."""
    boxes, goal = boxes.later(WAITS_S, scene.place_m), goal.later(WAITS_S)
    return find_route(boxes, scene.place_m, goal, scene.speed_m_s, scene.fence_m).reaches


def _headway(scene: Scene, detour: Detour) -> Detour:
    """The detour with its headway; `held_by` names an obstacle after the configured time without any."""
    time_s = scene.now.fleet.time_s
    goal = detour.goal_now(time_s)
    if detour.goes_instead:
        return replace(detour, best_m=np.inf, gained_s=time_s, held_by=goal.held_by)
    moving = bool(goal.velocity_m_s.any())
    if not detour.active or not scene.now.tasks.center_moves or (moving and detour.reaches):
        return replace(detour, best_m=np.inf, gained_s=time_s, held_by="")
    boxes = scene.boxes(detour.clear, detour.height_m, goal.place_m)
    if detour.reaches:
        left_m = _length_m(boxes, scene.place_m, boxes.numbers(detour.corners), goal)
        if detour.height_m is not None:
            left_m += abs(detour.height_m - scene.height_m)
        if left_m < detour.best_m - GAINED_M:
            return replace(detour, best_m=left_m, gained_s=time_s, held_by="")
    if time_s - detour.gained_s < scene.now.settings.law.avoidance.no_headway_s:
        return detour
    held_by = in_the_way(boxes, scene.place_m, goal, scene.speed_m_s)
    return replace(detour, held_by=held_by or detour.held_by or scene.outlines.names[0])


def _length_m(boxes: Boxes, center_m: Array, corners: tuple[int, ...], goal: Goal) -> float:
    """Length of the way over these corners to the goal, as they lie now."""
    places_m = [center_m[:2], *(boxes.corner_m(corner, 0.0) for corner in corners), goal.place_m]
    return float(sum(hypot(*(b - a)) for a, b in pairwise(places_m)))
