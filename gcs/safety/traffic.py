"""Rules of the road for vehicles with goals of their own: keep right; the one nearer its goal goes first."""

from math import radians
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


class Traffic(Settings):
    """How far vehicles keep to the right of their straight path, and from which distance they give way."""

    angle_max_deg: Annotated[float, Field(ge=0.0, le=60.0)] = 45.0
    """Most that a vehicle turns to the right of its path, in degrees; 0: always straight on."""
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
    """Turn vehicles on their way to a goal to the right, the more vehicles they would meet.

    It looks along the straight paths to their ends, so that a crowd is seen before it forms. It needs no
    memory:
    where the path is free again, it is flown straight.

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


SLOW_M2_S2 = 1e-6
"""Squared relative speed below which two vehicles do not meet."""


@kernel_in_any_order
def count_meetings(
    members: Rows, turned: Mask, position_m: Array, course_m_s: Array, lasts_s: Array, passing_m: float
) -> Array:
    """(n,) meetings of each vehicle, all going straight on: each counts 1 head-on, 0 at `passing_m`.

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
            if closing_m2_s <= 0.0 or speed_m2_s2 < SLOW_M2_S2:
                weight = 0.0
            own += weight
            met_of[b] += weight
        met[a] += own
    meetings = np.zeros(len(position_m))
    meetings[order] = met
    return meetings


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
