"""Rules of the road for vehicles with goals: turn early, keep right; the one nearer its goal goes first."""

from math import radians, tan
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from gcs.model.jit import kernel, kernel_in_any_order
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import TINY, Array, Mask
from gcs.safety.neighbours import Rows, near_pairs

STANDING_M_S = 0.2
"""A vehicle with a lower desired speed counts as standing."""

STRAIGHT_UP_M = 1e-6
"""A path with less horizontal extent has no right side; its side depends on whether it leads up or down."""


MUCH_NEARER = 0.5
"""A vehicle with less than this share of another's time left has right of way; else the filter decides."""

SOON_S, FAR_S = 16.0, 20.0
"""Vehicles keep right of a meeting that is sooner than the first, and turn early for one later than the
second; between both they do either in part.
"""

CLEAR_M, CLEAR_S = 3.6, 1.0
"""Two vehicles that meet far ahead are to pass at the first distance, and at so many m more for each m/s of
their relative speed.
"""

FURTHER = 2.0
"""A vehicle turns this many times as far as the miss lacks: the rest of its way leads back to its goal."""

ASIDE_M = 3.0
"""Two vehicles turn to their right if their ways miss by much less, else to the side on which they pass."""


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
    way_m, speed_m_s = goal_m - position_m, np.linalg.norm(desired_m_s, axis=1)
    left_m = np.linalg.norm(way_m, axis=1)
    lasts_s = left_m / np.maximum(speed_m_s, STANDING_M_S)
    rows = np.flatnonzero(to_goal & (lasts_s > SOON_S) & (speed_m_s > STANDING_M_S))
    if len(rows) < 2 or settings.angle_max_deg == 0.0:
        return desired_m_s
    scale, speed_m_s = np.array([1.0, 1.0, flatness]), speed_m_s[rows]
    along = way_m[rows] / left_m[rows, None]
    aside = scale * cubes_aside(position_m[rows] * scale, desired_m_s[rows] * scale, lasts_s[rows])
    aside -= (aside * along).sum(axis=1, keepdims=True) * along
    size = np.linalg.norm(aside, axis=1)
    aside_m_s = np.minimum(FURTHER * np.cbrt(size), tan(radians(settings.angle_max_deg)) * speed_m_s)
    turned_m_s = desired_m_s[rows] + (aside_m_s / np.maximum(size, TINY))[:, None] * aside
    early_m_s = desired_m_s.copy()
    early_m_s[rows] = (speed_m_s / np.linalg.norm(turned_m_s, axis=1))[:, None] * turned_m_s
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
    path is free again, it is flown straight.

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
    turned = to_goal & np.isfinite(goal_m).all(axis=1)
    if not turned.any() or settings.angle_max_deg == 0.0:
        return desired_m_s
    course_m_s = np.where(commanded[:, None], desired_m_s, velocity_m_s)
    met = airborne & np.isfinite(position_m).all(axis=1) & np.isfinite(course_m_s).all(axis=1)
    turned &= met
    speed_m_s = np.linalg.norm(course_m_s, axis=1)
    left_m = np.linalg.norm(np.where(turned[:, None], goal_m - position_m, 0.0), axis=1)
    lasts_s = np.where(turned, left_m / np.maximum(speed_m_s, STANDING_M_S), settings.horizon_s)
    lasts_s = np.where(speed_m_s > STANDING_M_S, lasts_s, 0.0)
    scale = np.array([1.0, 1.0, flatness])
    meetings = count_meetings(
        np.flatnonzero(met), turned, position_m * scale, course_m_s * scale, lasts_s, settings.passing_m
    )
    angle_rad = radians(settings.angle_max_deg) * -np.expm1(-meetings / settings.crowd)
    aside_m_s = _to_the_right(desired_m_s, goal_m - position_m, angle_rad)
    kept: Array = np.where(turned[:, None], aside_m_s, desired_m_s)
    return kept


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
    left_m, speed_m_s = np.linalg.norm(goal_m - position_m, axis=1), np.linalg.norm(desired_m_s, axis=1)
    takes_part = to_goal & np.isfinite(left_m) & (speed_m_s > STANDING_M_S)
    scale = np.array([1.0, 1.0, flatness])
    given_up_m_s = approach_given_up(
        desired_m_s * scale,
        position_m * scale,
        left_m / np.maximum(speed_m_s, STANDING_M_S),
        takes_part,
        settings.give_way_fully_m,
        settings.give_way_m,
    )
    given: Array = desired_m_s - given_up_m_s / scale
    return given


def _to_the_right(velocity_m_s: Array, way_m: Array, angle_rad: Array) -> Array:
    """(n, 3) turned by (n,) towards the right-hand side of the paths (n, 3), seen from above."""
    speed_m_s = np.linalg.norm(velocity_m_s, axis=1)
    aside_m = np.hypot(way_m[:, 0], way_m[:, 1])
    upright = aside_m < STRAIGHT_UP_M
    level = way_m[:, :2] / np.where(upright, 1.0, aside_m)[:, None]
    level[upright, 0], level[upright, 1] = np.where(way_m[upright, 2] < 0.0, 1.0, -1.0), 0.0
    right = np.stack([-level[:, 1], level[:, 0], np.zeros(len(level))], axis=1)
    ahead_m_s = np.cos(angle_rad)[:, None] * velocity_m_s
    turned: Array = ahead_m_s + (np.sin(angle_rad) * speed_m_s)[:, None] * right
    return turned


SLOW_M_S = 1e-3
SLOW_M2_S2 = SLOW_M_S**2
"""Relative speed below which two vehicles do not meet, and its square."""


@kernel_in_any_order
def count_meetings(
    members: Rows, turned: Mask, position_m: Array, course_m_s: Array, lasts_s: Array, passing_m: float
) -> Array:
    """(n,) meetings of each vehicle, all going straight on: each counts 1 head-on, 0 at `passing_m`.

    It counts less from `SOON_S` on, and 0 from `FAR_S`.

    Args:
        members: (k,) rows that take part.
        turned: (n,) rows for which meetings are counted.
        position_m: (n, 3), in a metric in which the floor is a sphere.
        course_m_s: (n, 3), in the same metric.
        lasts_s: (n,) how long each goes on.
        passing_m: distance from which on a pass does not count.
    """
    # those that are turned first, column by column: the inner loop is computed several pairs at a time
    order = np.concatenate((members[turned[members]], members[~turned[members]]))
    turns, met = turned[members].sum(), np.zeros(len(order))
    place_m = np.ascontiguousarray(position_m[order].T)
    moves_m_s = np.ascontiguousarray(course_m_s[order].T)
    left_s = lasts_s[order]
    for a in range(turns):
        x_m, y_m, z_m = place_m[0, a + 1 :], place_m[1, a + 1 :], place_m[2, a + 1 :]
        x_m_s, y_m_s, z_m_s = moves_m_s[0, a + 1 :], moves_m_s[1, a + 1 :], moves_m_s[2, a + 1 :]
        left_of_s, met_of, own_s, own = left_s[a + 1 :], met[a + 1 :], left_s[a], 0.0
        own_x_m, own_y_m, own_z_m = place_m[0, a], place_m[1, a], place_m[2, a]
        own_x_m_s, own_y_m_s, own_z_m_s = moves_m_s[0, a], moves_m_s[1, a], moves_m_s[2, a]
        for b in range(len(met_of)):
            dx, dy, dz = x_m[b] - own_x_m, y_m[b] - own_y_m, z_m[b] - own_z_m
            vx, vy, vz = x_m_s[b] - own_x_m_s, y_m_s[b] - own_y_m_s, z_m_s[b] - own_z_m_s
            closing_m2_s = -(dx * vx + dy * vy + dz * vz)
            speed_m2_s2 = vx * vx + vy * vy + vz * vz
            when_s = min(closing_m2_s / max(speed_m2_s2, SLOW_M2_S2), own_s, left_of_s[b])
            passed_m2 = dx * dx + dy * dy + dz * dz + when_s * (when_s * speed_m2_s2 - 2.0 * closing_m2_s)
            weight = max(1.0 - passed_m2 / (passing_m * passing_m), 0.0)
            weight *= min(max((FAR_S - when_s) / (FAR_S - SOON_S), 0.0), 1.0)
            if closing_m2_s <= 0.0 or speed_m2_s2 < SLOW_M2_S2:
                weight = 0.0
            own += weight
            met_of[b] += weight
        met[a] += own
    meetings = np.zeros(len(position_m))
    meetings[order] = met
    return meetings


@kernel_in_any_order
def cubes_aside(position_m: Array, course_m_s: Array, lasts_s: Array) -> Array:
    """(n, 3) sums of the directions away from meetings far ahead, each times the cube of a speed.

    It is half of the speed, in m/s, at which both would have to part from now on to pass each other clear.
    Computed in single precision, and several pairs at a time.

    Args:
        position_m: (n, 3), in a metric in which the floor is a sphere.
        course_m_s: (n, 3), in the same metric.
        lasts_s: (n,) how long each goes on.
    """
    single, n = np.float32, len(lasts_s)
    place_m, moves_m_s = np.empty((3, n), single), np.empty((3, n), single)
    left_s, aside = np.empty(n, single), np.zeros((3, n), single)
    for i in range(n):
        left_s[i] = lasts_s[i]
        for axis in range(3):
            place_m[axis, i], moves_m_s[axis, i] = position_m[i, axis], course_m_s[i, axis]
    none, half, whole, tiny = single(0.0), single(0.5), single(1.0), single(TINY)
    slow_m_s, slow_m2_s2 = single(SLOW_M_S), single(SLOW_M2_S2)
    clear_m, clear_s, right_m = single(CLEAR_M), single(CLEAR_S), single(ASIDE_M)
    soon_s, per_s = single(SOON_S), single(1.0 / (FAR_S - SOON_S))
    for i in range(n):
        x_m, y_m, z_m = place_m[0, i + 1 :], place_m[1, i + 1 :], place_m[2, i + 1 :]
        x_m_s, y_m_s, z_m_s = moves_m_s[0, i + 1 :], moves_m_s[1, i + 1 :], moves_m_s[2, i + 1 :]
        x_of, y_of, z_of, left_of_s = aside[0, i + 1 :], aside[1, i + 1 :], aside[2, i + 1 :], left_s[i + 1 :]
        own_x_m, own_y_m, own_z_m, own_s = place_m[0, i], place_m[1, i], place_m[2, i], left_s[i]
        own_x_m_s, own_y_m_s, own_z_m_s = moves_m_s[0, i], moves_m_s[1, i], moves_m_s[2, i]
        own_x, own_y, own_z = none, none, none
        for j in range(len(left_of_s)):
            dx, dy, dz = x_m[j] - own_x_m, y_m[j] - own_y_m, z_m[j] - own_z_m
            vx, vy, vz = x_m_s[j] - own_x_m_s, y_m_s[j] - own_y_m_s, z_m_s[j] - own_z_m_s
            level_m_s = np.sqrt(vx * vx + vy * vy)
            speed_m2_s2 = max(level_m_s * level_m_s + vz * vz, slow_m2_s2)
            when_s = max(min(-(dx * vx + dy * vy + dz * vz) / speed_m2_s2, own_s, left_of_s[j]), tiny)
            dx, dy, dz = dx + when_s * vx, dy + when_s * vy, dz + when_s * vz
            lack_m = clear_m + clear_s * np.sqrt(speed_m2_s2) - np.sqrt(dx * dx + dy * dy + dz * dz)
            share = min(max(when_s - soon_s, none) * per_s, whole)
            lack_m_s = half * share * max(lack_m, none) / when_s
            right_s = right_m / max(level_m_s, slow_m_s)
            away_x, away_y, away_z = right_s * vy - dx, -right_s * vx - dy, -dz
            if level_m_s <= slow_m_s:  # straight up and down: to the right of the one that climbs
                away_y += right_m if vz > none else -right_m
            away_m = np.sqrt(away_x * away_x + away_y * away_y + away_z * away_z)
            cube = lack_m_s * lack_m_s * lack_m_s / max(away_m, tiny)
            own_x, own_y, own_z = own_x + cube * away_x, own_y + cube * away_y, own_z + cube * away_z
            x_of[j] -= cube * away_x
            y_of[j] -= cube * away_y
            z_of[j] -= cube * away_z
        aside[0, i] += own_x
        aside[1, i] += own_y
        aside[2, i] += own_z
    return np.ascontiguousarray(aside.T).astype(np.float64)


@kernel
def approach_given_up(
    desired_m_s: Array, position_m: Array, left_s: Array, takes_part: Mask, fully_m: float, begins_m: float
) -> Array:
    """(n, 3) what each has to subtract from its desired velocity to give way.

    Args:
        desired_m_s: (n, 3), in a metric in which the floor is a sphere.
        position_m: (n, 3), in the same metric.
        left_s: (n,) how long each still has to go.
        takes_part: (n,) all other values of these rows are finite.
        fully_m: up to this distance the whole approach is given up.
        begins_m: up to this distance a part of it.
    """
    given_up_m_s = np.zeros_like(desired_m_s)
    most_m_s = np.zeros(len(desired_m_s))
    first, second = near_pairs(takes_part, position_m, takes_part, np.full(len(desired_m_s), 0.5 * begins_m))
    for k in range(len(first)):
        i, j = first[k], second[k]
        if left_s[i] < left_s[j]:
            i, j = j, i
        if left_s[j] >= MUCH_NEARER * left_s[i]:
            continue
        away_m2, closing_m2_s = 0.0, 0.0
        for axis in range(3):
            offset_m = position_m[j, axis] - position_m[i, axis]
            away_m2 += offset_m * offset_m
            closing_m2_s += offset_m * (desired_m_s[i, axis] - desired_m_s[j, axis])
        away_m = np.sqrt(away_m2)
        share = min(1.0, (begins_m - away_m) / (begins_m - fully_m))
        slower_m_s = share * closing_m2_s / max(away_m, TINY)
        if slower_m_s > most_m_s[i]:
            most_m_s[i] = slower_m_s
            for axis in range(3):
                offset_m = position_m[j, axis] - position_m[i, axis]
                given_up_m_s[i, axis] = slower_m_s * offset_m / max(away_m, TINY)
    return given_up_m_s
