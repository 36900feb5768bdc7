"""The centre's way past obstacles: planned twice a second with a memory, followed in every tick.

While the law's own way is free, the law leads. Else a route (`gcs.formation.route`) leads round the boxes
with the whole sphere, or over them where the fence allows it, or with a part of the sphere: the vehicles
then pass on both sides by their own tangents. Where nothing leads to the goal, the centre stands beside the
boxes. A plan is made over several ticks, with at most one search in each.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import cos, hypot, sin, sqrt

import numpy as np

from gcs.control.inputs import TickInputs
from gcs.control.memory import Detour, Searching
from gcs.formation.obstacles import Outlines
from gcs.formation.orbit import CLEAR_OF_FENCE_M, Center, followed_target, orbit_velocity
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
from gcs.formation.route_search import CORNERS, gaps_m
from gcs.model.plan import Direction
from gcs.model.state import Array, Mask

PLANNED_EVERY_S = 0.5

KEPT_SHARE, KEPT_S = 0.1, 1.0
"""A route is kept while no other arrives earlier by more than this share and time."""

WAITS_S = 8.0
"""A centre at its goal leaves it when it could no longer leave this much later."""

AT_GOAL_M = 3.0

GAINED_M = 1.0
"""Headway: the way to the goal became this much shorter."""

ALOFT_M = 1.0
"""A centre this far above the plan's height flies over obstacles."""

OVERSHOOT_M = 1.0
"""A centre that turns at a corner may leave its route by this much; the boxes are grown by more than that."""

CLEARANCES = (1.0, 0.5, 0.0)
"""Shares of the sphere for which a route is looked for, one after the other."""

SLOWEST_M_S = 0.3
"""Routes are planned at least this fast."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What a detour is planned in."""

    now: TickInputs
    center: Center
    sphere_m: float
    reach_m: float  # how far from the show's origin the target is followed
    outlines: Outlines  # all obstacles, margin and headroom included
    known: dict[tuple[float, float | None, bytes], Boxes] = field(default_factory=dict)  # in this tick

    @property
    def place_m(self) -> Array:
        """(2,) of the centre."""
        return self.center.position_m[:2]

    @property
    def height_m(self) -> float:
        """Of the centre."""
        return float(-self.center.position_m[2])

    @property
    def plan_height_m(self) -> float:
        """At which the centre is to fly."""
        return self.now.plan.formation.height_m

    @property
    def speed_m_s(self) -> float:
        """Speed of the detour: the plan's, or twice that of the fastest box, within the centre's limit."""
        plan, law = self.now.plan, self.now.settings.law
        fastest_m_s = float(np.hypot(*self.outlines.velocity_m_s.T).max(initial=0.0))
        own_m_s = plan.orbit.speed_m_s + plan.target.speed_m_s
        return max(min(law.center_speed_max_m_s, max(own_m_s, 2.0 * fastest_m_s)), SLOWEST_M_S)

    @property
    def on_orbit(self) -> bool:
        """Whether the law leads round the target, not to it."""
        return self.now.tasks.center_moves and self.now.plan.orbit.radius_m > 0.0

    @property
    def fence_m(self) -> float:
        """How far from the show's origin the centre may be."""
        return self.now.settings.safety.fence.distance_max_m - self.sphere_m - CLEAR_OF_FENCE_M / 2

    def boxes(self, clear: float, height_m: float | None, goal_m: Array | None) -> Boxes:
        """The boxes in the way at that height, grown by that share of the sphere, but not over the goal.

        Moving boxes, and all boxes that only a part of the sphere passes, count as the ellipses that vehicles
        fly round: else vehicles are driven ahead of a box, or left behind where the centre passes a gap. At
        the plan's height a centre above it may not descend into a box.
        """
        key = (clear, height_m, b"" if goal_m is None else goal_m[:2].tobytes())
        if key not in self.known:
            self.known[key] = self._grown(clear, height_m, goal_m)
        return self.known[key]

    def _grown(self, clear: float, height_m: float | None, goal_m: Array | None) -> Boxes:
        settings = self.now.settings.law.avoidance
        level_m = min(self.plan_height_m, self.height_m) if height_m is None else height_m
        tall = level_m - self.sphere_m < self.outlines.top_height_m
        outlines = self.outlines.only(tall)
        above_m = np.maximum(level_m - outlines.top_height_m, 0.0)
        section_m = np.sqrt(np.maximum(self.sphere_m**2 - above_m**2, 0.0))
        grown_m = clear * settings.center_clearance * section_m + settings.near_m
        as_ellipse = ~outlines.stand | (clear < 1.0)
        if goal_m is not None:
            gap_m = gaps_m(outlines.center_m, outlines.half_length_m, goal_m[:2])
            grown_m = np.where(outlines.stand, np.clip(gap_m - 0.05, 0.0, grown_m), grown_m)
            off_goal = (((goal_m[:2] - outlines.center_m) / outlines.semi_m) ** 2).sum(axis=1) > 1.0
            as_ellipse &= off_goal | ~outlines.stand
        strict = height_m is None and self.height_m > self.plan_height_m + ALOFT_M
        return Boxes.grown(outlines, grown_m, self.place_m, as_ellipse=as_ellipse, strict=strict)


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


def _goal_now(detour: Detour, time_s: float) -> Goal:
    return detour.goal.later(time_s - detour.planned_s)


def _followed(scene: Scene, desired_m_s: Array, detour: Detour) -> Array | None:
    """The velocity (3,) along the detour; None where its next leg is no longer free."""
    if not detour.active:
        return desired_m_s
    law = scene.now.settings.law
    goal = _goal_now(detour, scene.now.fleet.time_s)
    boxes = scene.boxes(detour.clear, detour.height_m, goal.place_m)
    led_m_s = desired_m_s.copy()
    if detour.height_m is not None:
        climb_m_s = law.goal_rate_per_s * (detour.height_m - scene.height_m)
        led_m_s[2] = -min(max(climb_m_s, -law.climb_max_m_s), law.climb_max_m_s)
        if scene.height_m < detour.height_m - ALOFT_M / 2:
            led_m_s[:2] = 0.0
            return led_m_s
    corners = tuple(
        CORNERS * boxes.names.index(name) + k for name, k in detour.corners if name in boxes.names
    )
    speed_m_s = scene.speed_m_s
    leg = next_leg(boxes, scene.place_m, corners, goal, speed_m_s, reaches=detour.reaches)
    if leg is None:
        return None
    left, along_m_s = leg
    if not left:
        if detour.reaches and scene.now.tasks.center_moves and not scene.on_orbit:
            return led_m_s
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
    """The detour after at most one search more: a better one, or the one before while none is known."""
    time_s, speed_m_s = scene.now.fleet.time_s, scene.speed_m_s
    searching = before.searching
    if searching is None:
        goals = tuple(_goals(scene, before if before.active else None))
        if not goals:
            return Detour(time_s, Goal(scene.place_m, np.zeros(2)))
        boxes = scene.boxes(1.0, None, goals[0].place_m)
        if not scene.on_orbit and leaves_now(boxes, scene.place_m, goals[0], speed_m_s):
            return Detour(time_s, goals[0])
        searching = Searching(time_s, goals)
        if _may_wait(scene, boxes, goals[0]):
            waits = _waits(scene, boxes, goals[0])
            return Detour(time_s, goals[0]) if waits else replace(before, searching=searching)
    choices, after_s = list(_choices(scene)), time_s - searching.begun_s
    nth, choice = divmod(searching.tried, len(choices))
    goal, (clear, height_m) = searching.goals[nth].later(after_s), choices[choice]
    boxes = scene.boxes(clear, height_m, goal.place_m)
    route = find_route(boxes, scene.place_m, goal, speed_m_s, scene.fence_m)
    kept = _kept(scene, searching.goals[0].later(after_s), before)
    if route.reaches and _climbs_in_time(scene, height_m):
        if kept is not None and route.arrival_s[-1] > (1.0 - KEPT_SHARE) * kept[1] - KEPT_S:
            return kept[0]
        return _detour(scene, goal, boxes, route, clear, height_m, before)
    left = len(choices) * (1 if kept is not None else len(searching.goals)) - searching.tried - 1
    if searching.tried == 0 and kept is None:
        before = _detour(scene, goal, boxes, route, clear, height_m, before)  # as near as it can, for now
    if left > 0:
        return replace(before, searching=replace(searching, tried=searching.tried + 1))
    if kept is not None:
        return kept[0]
    return replace(before, planned_s=time_s, goal=_goal_now(before, time_s), searching=None)


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
    if not before.active or not before.reaches:
        return None
    boxes = scene.boxes(before.clear, before.height_m, goal.place_m)
    corners = boxes.numbers(before.corners)
    if len(corners) < len(before.corners):
        return None
    leg = next_leg(boxes, scene.place_m, corners, goal, scene.speed_m_s, reaches=True)
    if leg is None:
        return None
    route = timed(boxes, scene.place_m, leg[0], goal, scene.speed_m_s)
    if route is None:
        return None
    detour = _detour(scene, goal, boxes, route, before.clear, before.height_m, before)
    return detour, route.arrival_s[-1]


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


def _climbs_in_time(scene: Scene, height_m: float | None) -> bool:
    """Whether no box comes over the centre while it climbs to that height, straight up."""
    if height_m is None:
        return True
    climb_s = max(height_m - scene.height_m, 0.0) / scene.now.settings.law.climb_max_m_s
    return stays_free(scene.boxes(1.0, None, None), scene.place_m, climb_s)


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


SHORTEST_LOOK_M = 20.0
"""On an orbit the centre looks its radius ahead, and at least this far."""

FIELD_STEP_S, FIELD_STEPS = 1.0, 60
REJOINED_EVERY = 5
"""The orbit is foreseen for a minute; beyond a box it is joined again at the first place that can be had."""


def _goals(scene: Scene, before: Detour | None) -> Iterator[Goal]:
    """Where the law leads, best first; none while the orbit is free as far as the centre looks ahead.

    A detour begun before leads to the same place of the orbit until the centre is there.
    """
    plan, time_s = scene.now.plan, scene.now.fleet.time_s
    settings = scene.now.settings.law.avoidance
    margin_m = settings.near_m
    if not scene.now.tasks.center_moves:
        yield Goal(scene.place_m.copy(), np.zeros(2))
        return
    target_m, target_m_s = followed_target(
        np.array(plan.target.position_m(time_s)), np.array(plan.target.velocity_m_s), scene.reach_m
    )
    tall = min(scene.plan_height_m, scene.height_m) - scene.sphere_m < scene.outlines.top_height_m
    outlines = scene.outlines.only(tall)
    if plan.orbit.radius_m == 0.0:
        stands = not target_m_s.any()
        place_m = _beside(target_m, outlines, margin_m)
        yield Goal(place_m, target_m_s) if stands else Goal(place_m, target_m_s, 2.0)
        return
    if before is not None and before.reaches:
        goal = _goal_now(before, time_s)
        off_m = abs(hypot(*(goal.place_m - target_m)) - plan.orbit.radius_m)
        if off_m < AT_GOAL_M and hypot(*(goal.place_m - scene.place_m)) > AT_GOAL_M:
            yield replace(goal, velocity_m_s=target_m_s)
    path_m = _orbit_ahead(scene, target_m, target_m_s)
    free = _are_free(scene, path_m)
    if free[1:].all():
        return
    blocked = 1 + int(np.argmin(free[1:]))
    looks_m = max(SHORTEST_LOOK_M, min(plan.orbit.radius_m, settings.center_lookahead_m))
    ahead_m = np.hypot(*np.diff(path_m[: blocked + 1], axis=0).T).sum()
    if ahead_m > looks_m:
        return
    again = np.flatnonzero(free[blocked:]) + blocked
    for k in again[::REJOINED_EVERY][:4]:
        yield Goal(path_m[k] - k * FIELD_STEP_S * target_m_s, target_m_s, 1.0)
    if len(again) == 0:
        yield Goal(_beside(path_m[blocked], outlines, margin_m), target_m_s, 1.0)


def _are_free(scene: Scene, path_m: Array) -> Mask:
    """(k,) whether the places (k, 2) of one second after the other are outside all grown boxes."""
    boxes = scene.boxes(1.0, None, None)
    return ~boxes.hold(path_m, FIELD_STEP_S * np.arange(len(path_m), dtype=np.float64))


def _orbit_ahead(scene: Scene, target_m: Array, target_m_s: Array) -> Array:
    """(k, 2) places of a centre that follows the law's orbit undisturbed, one a second."""
    orbit = scene.now.plan.orbit
    places_m = [scene.place_m]
    for k in range(FIELD_STEPS):
        offset_m = places_m[-1] - target_m - k * FIELD_STEP_S * target_m_s
        rho_m = hypot(*offset_m)
        if abs(rho_m - orbit.radius_m) < 1.0:  # on the circle: steps along the arc, not along the tangent
            turn = FIELD_STEP_S * orbit.speed_m_s / orbit.radius_m
            turn *= -1.0 if orbit.direction is Direction.COUNTERCLOCKWISE else 1.0
            x, y = offset_m * (orbit.radius_m / rho_m)
            arc_m = np.array([cos(turn) * x - sin(turn) * y, sin(turn) * x + cos(turn) * y])
            places_m.append(arc_m + target_m + (k + 1) * FIELD_STEP_S * target_m_s)
            continue
        field_m_s = orbit_velocity(
            offset_m,
            radius_m=orbit.radius_m,
            speed_m_s=orbit.speed_m_s,
            direction=orbit.direction,
            braking_m_s2=1.0,
        )
        places_m.append(places_m[-1] + FIELD_STEP_S * (field_m_s + target_m_s))
    return np.array(places_m)


def _headway(scene: Scene, detour: Detour) -> Detour:
    """The detour with its headway; `held_by` names an obstacle after the configured time without any."""
    time_s = scene.now.fleet.time_s
    goal = _goal_now(detour, time_s)
    moving = bool(goal.velocity_m_s.any())
    if not detour.active or not scene.now.tasks.center_moves or (moving and detour.reaches):
        return replace(detour, best_m=np.inf, gained_s=time_s, held_by="")
    boxes = scene.boxes(detour.clear, detour.height_m, goal.place_m)
    if detour.reaches:
        corners = tuple(
            CORNERS * boxes.names.index(name) + k for name, k in detour.corners if name in boxes.names
        )
        left_m = _length_m(boxes, scene.place_m, corners, goal)
        if detour.height_m is not None:
            left_m += abs(detour.height_m - scene.height_m)
        if left_m < detour.best_m - GAINED_M:
            return replace(detour, best_m=left_m, gained_s=time_s, held_by="")
    if time_s - detour.gained_s < scene.now.settings.law.avoidance.no_headway_s:
        return detour
    held_by = in_the_way(boxes, scene.place_m, goal, scene.speed_m_s)
    return replace(detour, held_by=held_by or detour.held_by or scene.outlines.names[0])


def _beside(place_m: Array, outlines: Outlines, by_m: float) -> Array:
    """The place (2,) itself, or the nearest one `by_m` outside the standing boxes that hold it."""
    found_m = np.array(place_m[:2], dtype=np.float64)
    half_m = outlines.half_length_m + by_m
    for _ in range(len(outlines)):
        offset_m = found_m - outlines.center_m
        depth_m = half_m - np.abs(offset_m)
        inside = np.flatnonzero((depth_m > 1e-6).all(axis=1) & outlines.stand)
        if len(inside) == 0:
            break
        j = inside[0]
        axis = int(np.argmin(depth_m[j]))
        found_m[axis] += np.copysign(depth_m[j, axis] + 1e-3, offset_m[j, axis])
    return found_m


def _length_m(boxes: Boxes, center_m: Array, corners: tuple[int, ...], goal: Goal) -> float:
    """Length of the way over these corners to the goal, as they lie now."""
    places_m = [center_m[:2], *(boxes.corner_m(corner, 0.0) for corner in corners), goal.place_m]
    return float(sum(hypot(*(b - a)) for a, b in pairwise(places_m)))
