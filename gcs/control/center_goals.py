"""Where the centre's way leads: to the target, along its orbit, or to the nearest place that can be had."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import cos, hypot, sin

import numpy as np

from gcs.control.memory import Detour
from gcs.control.scene import Scene
from gcs.formation.orbit import followed_target, orbit_velocity
from gcs.formation.route import Goal, free_until_s, in_the_way
from gcs.formation.route_search import HORIZON_S, gaps_m
from gcs.model.plan import Direction
from gcs.model.state import Array, Mask

AT_GOAL_M = 3.0

PASSING_S = 2.0
"""The place of a moving target must stay free for this long."""

CARRIED_M_S = 0.3
"""A target that moves no faster than this relative to a moving box stays in it; over ground it stands."""

LEAVES_M_S = 2.0 * CARRIED_M_S
"""A target that an obstacle that stands holds moves again beyond this speed: an estimated velocity varies."""

NEARER_SHARE, NEARER_M = 0.1, 1.0
"""A place instead of the target is kept while no other is nearer by more than this."""

INSTEAD = 6
"""Places tried instead of a target that cannot be had."""

FLEES_FOR_S = 5.0
"""A place that stays free only for a time must do so for so much longer than where the centre is."""

OPEN_DIRECTIONS, OPEN_SPHERES = 16, (1.5, 3.0, 4.5, 6.0)
"""Open ground is looked for in these directions, so many radii of the sphere away."""

SHORTEST_LOOK_M = 20.0
"""On an orbit the centre looks its radius ahead, and at least this far."""

FIELD_STEP_S, FIELD_STEPS = 1.0, 60
REJOINED_EVERY = 5
"""The orbit is foreseen for a minute; beyond a box it is joined again at the first place that can be had."""


def goals_of(scene: Scene, before: Detour | None) -> Iterator[Goal]:
    """Where the plan leads, best first; none while the orbit is free as far as the centre looks ahead.

    A detour begun before leads to the same place of the orbit until the centre is there. Where an obstacle
    holds the target, the places lie beside it.
    """
    plan, time_s = scene.now.plan, scene.now.fleet.time_s
    if not scene.now.tasks.center_moves:
        yield Goal(scene.place_m.copy(), np.zeros(2))
        return
    target_m, target_m_s = followed_target(
        np.array(plan.target.position_m(time_s)), np.array(plan.target.velocity_m_s), scene.reach_m
    )
    if plan.orbit.radius_m == 0.0:
        target_m_s = _over_ground(scene, target_m_s, before)
        stay_s = PASSING_S if target_m_s.any() else HORIZON_S
        held_by = _kept_off_by(scene, target_m, target_m_s)
        if held_by:
            yield from instead_of(scene, target_m, target_m_s, before, held_by)
        else:
            yield Goal(target_m, target_m_s, stay_s)
        return
    if before is not None and before.reaches and not before.goal.held_by:
        goal = before.goal_now(time_s)
        off_m = abs(hypot(*(goal.place_m - target_m)) - plan.orbit.radius_m)
        if off_m < AT_GOAL_M and hypot(*(goal.place_m - scene.place_m)) > AT_GOAL_M:
            yield replace(goal, velocity_m_s=target_m_s)
    path_m = _orbit_ahead(scene, target_m, target_m_s)
    free = _are_free(scene, path_m)
    if free[1:].all():
        return
    blocked = 1 + int(np.argmin(free[1:]))
    looks_m = max(
        SHORTEST_LOOK_M, min(plan.orbit.radius_m, scene.now.settings.law.avoidance.center_lookahead_m)
    )
    ahead_m = np.hypot(*np.diff(path_m[: blocked + 1], axis=0).T).sum()
    if ahead_m > looks_m:
        return
    again = np.flatnonzero(free[blocked:]) + blocked
    for k in again[::REJOINED_EVERY][:4]:
        yield Goal(path_m[k] - k * FIELD_STEP_S * target_m_s, target_m_s, 1.0)
    if len(again) == 0:
        yield from instead_of(scene, path_m[blocked], target_m_s, before)


def _over_ground(scene: Scene, target_m_s: Array, before: Detour | None) -> Array:
    """(2,) the velocity of a target; 0 where it stands, and what is estimated of it is an error."""
    held = before is not None and before.goal.held_by in scene.outlines.only(scene.outlines.stand).names
    stands = hypot(*target_m_s) <= (LEAVES_M_S if held else CARRIED_M_S)
    return np.zeros(2) if stands else target_m_s


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


def _kept_off_by(scene: Scene, target_m: Array, target_m_s: Array) -> str:
    """The obstacle that keeps the sphere from a target at (2,) with (2,), and stays there; "" for none.

    A target is in it, or within its margin. One that stands is refused, too, where slots would lie in the
    obstacle's ellipse; not where the sphere surrounds the obstacle.
    """
    level_m, near_m = scene.lowest_level_m, scene.now.settings.law.avoidance.near_m
    outlines = scene.outlines_at(level_m)
    off_m, half_m = np.abs(target_m - outlines.center_m), outlines.half_length_m
    gap_m = gaps_m(outlines.center_m, half_m, target_m) - near_m
    if not target_m_s.any():
        surrounded = (gap_m > 0.0) & (np.hypot(*(off_m + half_m).T) + near_m < scene.sphere_m)
        slots_m = scene.clearance_m(outlines, level_m) - near_m
        room_m = outlines.nearest_m(target_m[None]) - slots_m
        gap_m = np.where(surrounded, gap_m, np.minimum(gap_m, room_m))
    passes_m_s = np.hypot(*(outlines.velocity_m_s - target_m_s).T)
    gap_m[~outlines.stand & (passes_m_s > CARRIED_M_S)] = np.inf
    return outlines.names[int(np.argmin(gap_m))] if gap_m.min(initial=np.inf) < 0.0 else ""


def instead_of(
    scene: Scene, target_m: Array, target_m_s: Array, before: Detour | None, held_by: str = ""
) -> Iterator[Goal]:
    """Places for the whole sphere instead of one at (2,) with (2,), best first, each far from the others.

    The nearest to a target that an obstacle holds, and open ground beyond obstacles that move. A place about
    as near as the nearest is kept.
    """
    kept_m = scene.place_m
    if before is not None and before.goal.held_by:
        kept_m = before.goal_now(scene.now.fleet.time_s).place_m
    goals = [
        *_beside(scene, target_m, target_m_s, held_by, kept_m),
        *_open_ground(scene, target_m, held_by),
    ]
    if held_by and not goals:  # it stands: no place is in its reach
        goals = [Goal(target_m, np.zeros(2), held_by=held_by)]
    yield from goals[:INSTEAD]


def _beside(scene: Scene, target_m: Array, target_m_s: Array, held_by: str, kept_m: Array) -> Iterator[Goal]:
    """Places beside the obstacles that stand, or move with the target, from the nearest to it on."""
    outlines = scene.outlines_at(scene.lowest_level_m)
    stay = outlines.stand | (np.hypot(*(outlines.velocity_m_s - target_m_s).T) <= CARRIED_M_S)
    room = scene.room(outlines.only(stay))
    places_m, goes_m_s = room.free_places(target_m, target_m_s, scene.fence_m)
    if len(places_m) == 0:
        return
    straight = Goal(target_m, target_m_s)
    name = held_by or in_the_way(room, scene.place_m, straight, scene.speed_m_s) or room.names[0]
    away_m = np.hypot(*(places_m - target_m).T)
    near = away_m <= (1.0 + NEARER_SHARE) * away_m[0] + NEARER_M
    kept = int(np.argmin(np.where(near, np.hypot(*(places_m - kept_m).T), np.inf)))
    for k in _far_apart(places_m, [kept, *range(len(places_m))], scene):
        yield Goal(places_m[k], goes_m_s[k], PASSING_S if goes_m_s[k].any() else HORIZON_S, name)


def _far_apart(places_m: Array, order: Sequence[int], scene: Scene) -> list[int]:
    """The first places of that order that are far from those chosen before; `INSTEAD` at most."""
    left, chosen = np.ones(len(places_m), np.bool_), list[int]()
    for k in order:
        if left[k]:
            chosen.append(int(k))
            left &= np.hypot(*(places_m - places_m[k]).T) > 2.0 * scene.sphere_m
        if len(chosen) == INSTEAD or not left.any():
            break
    return chosen


def _open_ground(scene: Scene, target_m: Array, held_by: str) -> Iterator[Goal]:
    """Places around the centre that stay free longest of obstacles that move, then from the nearest on."""
    boxes = scene.boxes(1.0, None, None)
    if not boxes.place[:, 2:].any():
        return
    turn_rad = 2.0 * np.pi * np.arange(OPEN_DIRECTIONS) / OPEN_DIRECTIONS
    around = np.column_stack([np.cos(turn_rad), np.sin(turn_rad)])
    by_m = scene.sphere_m * np.array(OPEN_SPHERES)[:, None, None]
    places_m = (scene.place_m + by_m * around).reshape(-1, 2)
    places_m = places_m[np.hypot(*places_m.T) <= scene.fence_m]
    free_s = np.minimum([free_until_s(boxes, place_m) for place_m in places_m], HORIZON_S)
    away_m = np.hypot(*(places_m - target_m).T)
    flown_s = np.hypot(*(places_m - scene.place_m).T) / scene.now.settings.law.center_speed_max_m_s
    stay_s = np.where(free_s == HORIZON_S, HORIZON_S, free_s - flown_s - PASSING_S)
    gains = (free_s == HORIZON_S) | (free_s > free_until_s(boxes, scene.place_m) + FLEES_FOR_S)
    name = held_by or in_the_way(boxes, scene.place_m, Goal(target_m, np.zeros(2)), scene.speed_m_s)
    order = [k for k in np.lexsort([away_m, -free_s]).tolist() if gains[k] and stay_s[k] > 0.0]
    for k in _far_apart(places_m, order, scene):
        yield Goal(places_m[k], np.zeros(2), float(stay_s[k]), name or boxes.names[0], flees=True)
