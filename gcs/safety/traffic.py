"""Rules of the road for vehicles with goals: turn early, keep right; the one nearer its goal goes first."""

from math import radians, tan
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from gcs.model.jit import kernel, kernel_within
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import TINY, Array, Mask
from gcs.safety.meetings import FAR_S, SOON_S, approach_given_up, count_meetings, cubes_aside

STANDING_M_S = 0.2
"""A vehicle with a lower desired speed counts as standing."""

STRAIGHT_UP_M = 1e-6
"""A path with less horizontal extent has no right side; its side depends on whether it leads up or down."""


FURTHER = 2.0
"""A vehicle turns this many times as far as the miss lacks: the rest of its way leads back to its goal."""


class Traffic(Settings):
    """How far vehicles keep to the right of their straight path, and from which distance they give way."""

    angle_max_deg: Annotated[float, Field(ge=0.0, le=60.0)] = 45.0
    """Most that a vehicle turns from its path by either rule, in degrees; 0: always straight on."""
    passing_m: Positive = 8.0
    """A closer approach, sideways, is a meeting, in m."""
    crowd: Positive = 4.0
    """So many meetings produce two thirds of the greatest angle."""
    horizon_s: NotNegative = 10.0
    """For how long vehicles without a goal are expected to go on, in s."""
    give_way_m: NotNegative = 10.0
    """Distance at which giving way begins, in m; 0: never."""
    give_way_fully_m: NotNegative = 6.0
    """Distance at which it is complete, in m."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if 0.0 < self.give_way_m <= self.give_way_fully_m:
            fully_m = self.give_way_fully_m
            raise ValueError(
                f"give_way_m {self.give_way_m:g} must be more than give_way_fully_m {fully_m:g}, or 0"
            )
        return self


def turn_early(
    desired_m_s: Array, position_m: Array, goal_m: Array, *, to_goal: Mask, flatness: float, settings: Traffic
) -> Array:
    """Turn vehicles on long ways to their goals, so that those that meet far ahead pass each other clear.

    A small angle suffices while a meeting is far, and each turns to the side on which it passes already.
    Where many would meet in one place the angle grows with the cube root of their number, as does the room
    that they take up. It needs no memory.

    Args:
        desired_m_s: (n, 3), show frame.
        position_m: (n, 3), show frame; NaN rows take no part.
        goal_m: (n, 3); only rows of `to_goal` count.
        to_goal: (n,) vehicles that are turned, and met.
        flatness: weight of a metre up and down, relative to one sideways.
        settings: the greatest angle.

    Returns: (n, 3) in m/s, each row as fast as before.
    """
    if settings.angle_max_deg == 0.0:
        return desired_m_s
    most = tan(radians(settings.angle_max_deg))
    return _turned_early(
        np.array(desired_m_s), np.array(position_m), np.array(goal_m), np.array(to_goal), flatness, most
    )


@kernel
def _turned_early(
    desired_m_s: Array, position_m: Array, goal_m: Array, to_goal: Mask, flatness: float, most: float
) -> Array:
    """As `turn_early`; `most` is the tangent of the greatest angle."""
    n, many = len(desired_m_s), 0
    rows, left_m, speed_m_s, lasts_s = np.empty(n, np.intp), np.empty(n), np.empty(n), np.empty(n)
    place_m, course_m_s = np.empty((n, 3)), np.empty((n, 3))
    for i in range(n):
        if not to_goal[i]:
            continue
        x_m_s, y_m_s, z_m_s = desired_m_s[i, 0], desired_m_s[i, 1], desired_m_s[i, 2]
        x_m, y_m, z_m = (
            goal_m[i, 0] - position_m[i, 0],
            goal_m[i, 1] - position_m[i, 1],
            goal_m[i, 2] - position_m[i, 2],
        )
        speed_m_s[many] = np.sqrt(x_m_s * x_m_s + y_m_s * y_m_s + z_m_s * z_m_s)
        left_m[many] = np.sqrt(x_m * x_m + y_m * y_m + z_m * z_m)
        lasts_s[many] = left_m[many] / max(speed_m_s[many], STANDING_M_S)
        if not (speed_m_s[many] > STANDING_M_S and lasts_s[many] > SOON_S):
            continue
        rows[many] = i
        place_m[many, 0], place_m[many, 1] = position_m[i, 0], position_m[i, 1]
        place_m[many, 2] = position_m[i, 2] * flatness
        course_m_s[many, 0], course_m_s[many, 1], course_m_s[many, 2] = x_m_s, y_m_s, z_m_s * flatness
        many += 1
    early_m_s = desired_m_s.copy()
    if many < 2:
        return early_m_s
    aside = cubes_aside(place_m[:many], course_m_s[:many], lasts_s[:many])
    for k in range(many):
        i = rows[k]
        x, y, z = aside[k, 0], aside[k, 1], aside[k, 2] * flatness
        along = 0.0
        for axis in range(3):
            along += (goal_m[i, axis] - position_m[i, axis]) / left_m[k] * (x, y, z)[axis]
        x -= along * (goal_m[i, 0] - position_m[i, 0]) / left_m[k]
        y -= along * (goal_m[i, 1] - position_m[i, 1]) / left_m[k]
        z -= along * (goal_m[i, 2] - position_m[i, 2]) / left_m[k]
        size = np.sqrt(x * x + y * y + z * z)
        share = min(FURTHER * np.cbrt(size), most * speed_m_s[k]) / max(size, TINY)
        x, y, z = desired_m_s[i, 0] + share * x, desired_m_s[i, 1] + share * y, desired_m_s[i, 2] + share * z
        as_fast = speed_m_s[k] / np.sqrt(x * x + y * y + z * z)
        early_m_s[i, 0], early_m_s[i, 1], early_m_s[i, 2] = as_fast * x, as_fast * y, as_fast * z
    return early_m_s


def keep_right(
    desired_m_s: Array,
    position_m: Array,
    velocity_m_s: Array,
    goal_m: Array,
    *,
    to_goal: Mask,
    commanded: Mask,
    airborne: Mask,
    flatness: float,
    settings: Traffic,
) -> Array:
    """Turn vehicles on their way to a goal to the right, the more vehicles they would meet soon.

    It looks along the straight paths, so that a crowd is seen before it forms. It needs no memory: where the
    path is free again, it is flown straight. In a crowd those on long ways up turn less than the others.

    Args:
        desired_m_s: (n, 3), show frame: straight to the goal, or another desired velocity.
        position_m: (n, 3), show frame; NaN rows take no part.
        velocity_m_s: (n, 3) measured: vehicles that are not commanded continue with it.
        goal_m: (n, 3); only rows of `to_goal` count.
        to_goal: (n,) vehicles that may be turned. A vehicle descending to a pad may not.
        commanded: (n,).
        airborne: (n,) vehicles that can be met.
        flatness: weight of a metre up and down, relative to one sideways.
        settings: angle and look-ahead.

    Returns: (n, 3) in m/s, each row as fast as before or, where it leads up or down, little faster.
    """
    if settings.angle_max_deg == 0.0:
        return desired_m_s
    return _kept_right(
        np.array(desired_m_s),
        np.array(position_m),
        np.array(velocity_m_s),
        np.array(goal_m),
        (np.array(to_goal), np.array(commanded), np.array(airborne)),
        flatness,
        (radians(settings.angle_max_deg), settings.crowd, settings.passing_m, settings.horizon_s),
    )


@kernel
def _kept_right(
    desired_m_s: Array,
    position_m: Array,
    velocity_m_s: Array,
    goal_m: Array,
    masks: tuple[Mask, Mask, Mask],
    flatness: float,
    numbers: tuple[float, float, float, float],
) -> Array:
    """As `keep_right`; masks in the order of its arguments, and greatest angle, crowd, passing, horizon."""
    (to_goal, commanded, airborne), (most_rad, crowd, passing_m, horizon_s) = masks, numbers
    n, kept_m_s = len(desired_m_s), desired_m_s.copy()
    met, turned, lasts_s = np.empty(n, np.bool_), np.empty(n, np.bool_), np.empty(n)
    place_m, course_m_s = np.empty((n, 3)), np.empty((n, 3))
    for i in range(n):
        met[i], turned[i], speed2, left2 = airborne[i], to_goal[i], 0.0, 0.0
        for axis in range(3):
            flat = flatness if axis == 2 else 1.0
            speed_m_s = desired_m_s[i, axis] if commanded[i] else velocity_m_s[i, axis]
            way_m = goal_m[i, axis] - position_m[i, axis]
            met[i] &= np.isfinite(position_m[i, axis]) and np.isfinite(speed_m_s)
            turned[i] &= np.isfinite(goal_m[i, axis])
            place_m[i, axis], course_m_s[i, axis] = flat * position_m[i, axis], flat * speed_m_s
            speed2, left2 = speed2 + speed_m_s * speed_m_s, left2 + way_m * way_m
        turned[i] &= met[i]
        fast_m_s = np.sqrt(speed2)
        lasts_s[i] = np.sqrt(left2) / max(fast_m_s, STANDING_M_S) if turned[i] else horizon_s
        if not fast_m_s > STANDING_M_S:
            lasts_s[i] = 0.0
    if not turned.any():
        return kept_m_s
    meetings = count_meetings(np.flatnonzero(met), turned, place_m, course_m_s, lasts_s, passing_m)
    for i in range(n):
        if turned[i]:
            x_m, y_m = goal_m[i, 0] - position_m[i, 0], goal_m[i, 1] - position_m[i, 1]
            up_m = position_m[i, 2] - goal_m[i, 2]
            climb = _climb(up_m, np.hypot(x_m, y_m), lasts_s[i])
            angle_rad = most_rad * _share_turned(meetings[i], crowd, climb)
            _turn_right(kept_m_s, i, x_m, y_m, up_m > 0.0, angle_rad)
    return kept_m_s


@kernel_within
def _climb(up_m: float, level_m: float, lasts_s: float) -> float:
    """Sine of the slope of a way that leads up, else 0; less for one that lasts no longer than `FAR_S`."""
    long = min(max((lasts_s - SOON_S) / (FAR_S - SOON_S), 0.0), 1.0)
    sine: float = max(up_m, 0.0) / max(np.hypot(up_m, level_m), TINY)
    return long * sine


@kernel_within
def _share_turned(meetings: float, crowd: float, climb: float) -> float:
    """Share of the greatest angle for so many meetings on a way with that `_climb`.

    One meeting counts fully. In a crowd those that climb turn less, and pass inside of those that descend:
    turned alike, both meet head on in the ring round the crowd, and stop each other.
    """
    of_one, of_all = -np.expm1(-min(meetings, 1.0) / crowd), -np.expm1(-meetings / crowd)
    share: float = max(of_one, (1.0 - climb) * of_all)
    return share


@kernel
def _turn_right(velocity_m_s: Array, i: int, x_m: float, y_m: float, climbs: bool, angle_rad: float) -> None:
    """Turn row i, in place, towards the right-hand side of its way, seen from above."""
    level_m = np.hypot(x_m, y_m)
    ahead_x, ahead_y = 1.0 if climbs else -1.0, 0.0
    if level_m >= STRAIGHT_UP_M:
        ahead_x, ahead_y = x_m / level_m, y_m / level_m
    x, y, z = velocity_m_s[i, 0], velocity_m_s[i, 1], velocity_m_s[i, 2]
    ahead, aside_m_s = np.cos(angle_rad), np.sin(angle_rad) * np.sqrt(x * x + y * y + z * z)
    velocity_m_s[i, 0], velocity_m_s[i, 1] = ahead * x - aside_m_s * ahead_y, ahead * y + aside_m_s * ahead_x
    velocity_m_s[i, 2] = ahead * z


def give_way(
    desired_m_s: Array, position_m: Array, goal_m: Array, *, to_goal: Mask, flatness: float, settings: Traffic
) -> Array:
    """Remove from vehicles with far to go the approach to a close vehicle that is nearly at its goal.

    Seen from the vehicle with right of way, the other no longer comes nearer: it stops, backs off or slides
    past. Each vehicle gives way to one at a time, the one on which it closes in the most. It needs no memory.

    Args:
        desired_m_s: (n, 3), show frame.
        position_m: (n, 3), show frame; NaN rows take no part.
        goal_m: (n, 3); only rows of `to_goal` count.
        to_goal: (n,) vehicles that give way or get right of way.
        flatness: weight of a metre up and down, relative to one sideways.
        settings: the distances.

    Returns: (n, 3) in m/s.
    """
    if settings.give_way_m == 0.0:
        return desired_m_s
    return _given_way(
        np.array(desired_m_s),
        np.array(position_m),
        np.array(goal_m),
        np.array(to_goal),
        flatness,
        settings.give_way_fully_m,
        settings.give_way_m,
    )


@kernel
def _given_way(
    desired_m_s: Array,
    position_m: Array,
    goal_m: Array,
    to_goal: Mask,
    flatness: float,
    fully_m: float,
    begins_m: float,
) -> Array:
    """As `give_way`, beginning at the second distance, complete at the first."""
    n = len(desired_m_s)
    course_m_s, place_m = desired_m_s.copy(), position_m.copy()
    left_s, takes_part = np.empty(n), np.empty(n, np.bool_)
    for i in range(n):
        speed2, left2 = 0.0, 0.0
        for axis in range(3):
            speed2 += desired_m_s[i, axis] ** 2
            left2 += (goal_m[i, axis] - position_m[i, axis]) ** 2
        speed_m_s = np.sqrt(speed2)
        left_s[i] = np.sqrt(left2) / max(speed_m_s, STANDING_M_S)
        takes_part[i] = to_goal[i] and np.isfinite(left2) and speed_m_s > STANDING_M_S
        course_m_s[i, 2] *= flatness
        place_m[i, 2] *= flatness
    given_m_s = approach_given_up(course_m_s, place_m, left_s, takes_part, fully_m, begins_m)
    for i in range(n):
        for axis in range(3):
            flat = flatness if axis == 2 else 1.0
            given_m_s[i, axis] = desired_m_s[i, axis] - given_m_s[i, axis] / flat
    return given_m_s
