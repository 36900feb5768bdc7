"""Which vehicles meet if all go straight on, when, and how near: the kernels of the rules of the road."""

import numpy as np

from gcs.model.jit import kernel, kernel_in_any_order
from gcs.model.state import TINY, Array, Mask
from gcs.safety.neighbours import Rows, near_pairs

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

ASIDE_M = 3.0
"""Two vehicles turn to their right if their ways miss by much less, else to the side on which they pass."""

SLOW_M_S = 1e-3
SLOW_M2_S2 = SLOW_M_S**2
"""Relative speed below which two vehicles do not meet, and its square."""


@kernel_in_any_order
def count_meetings(
    members: Rows, turned: Mask, position_m: Array, course_m_s: Array, lasts_s: Array, passing_m: float
) -> Array:
    """(n,) meetings of each vehicle, all going straight on: each counts 1 head-on, 0 at `passing_m`.

    It counts less from `SOON_S` on, and 0 from `FAR_S`. Computed in single precision: what counts is near.

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
    single, turns, many = np.float32, turned[members].sum(), len(order)
    place_m, moves_m_s = np.empty((3, many), single), np.empty((3, many), single)
    left_s, met = np.empty(many, single), np.zeros(many, single)
    for a in range(many):
        left_s[a] = lasts_s[order[a]]
        for axis in range(3):
            place_m[axis, a], moves_m_s[axis, a] = position_m[order[a], axis], course_m_s[order[a], axis]
    none, whole, slow_m2_s2 = single(0.0), single(1.0), single(SLOW_M2_S2)
    per_m2, far_s, per_s = (
        single(1.0 / (passing_m * passing_m)),
        single(FAR_S),
        single(1.0 / (FAR_S - SOON_S)),
    )
    for a in range(turns):
        x_m, y_m, z_m = place_m[0, a + 1 :], place_m[1, a + 1 :], place_m[2, a + 1 :]
        x_m_s, y_m_s, z_m_s = moves_m_s[0, a + 1 :], moves_m_s[1, a + 1 :], moves_m_s[2, a + 1 :]
        left_of_s, met_of, own_s, own = left_s[a + 1 :], met[a + 1 :], left_s[a], none
        own_x_m, own_y_m, own_z_m = place_m[0, a], place_m[1, a], place_m[2, a]
        own_x_m_s, own_y_m_s, own_z_m_s = moves_m_s[0, a], moves_m_s[1, a], moves_m_s[2, a]
        for b in range(len(met_of)):
            dx, dy, dz = x_m[b] - own_x_m, y_m[b] - own_y_m, z_m[b] - own_z_m
            vx, vy, vz = x_m_s[b] - own_x_m_s, y_m_s[b] - own_y_m_s, z_m_s[b] - own_z_m_s
            closing_m2_s = -(dx * vx + dy * vy + dz * vz)
            speed_m2_s2 = vx * vx + vy * vy + vz * vz
            when_s = min(closing_m2_s / max(speed_m2_s2, slow_m2_s2), own_s, left_of_s[b])
            dx, dy, dz = dx + when_s * vx, dy + when_s * vy, dz + when_s * vz
            weight = max(whole - per_m2 * (dx * dx + dy * dy + dz * dz), none)
            weight *= min(max((far_s - when_s) * per_s, none), whole)
            if closing_m2_s <= none or speed_m2_s2 < slow_m2_s2:
                weight = none
            own += weight
            met_of[b] += weight
        met[a] += own
    meetings = np.zeros(len(position_m))
    for a in range(many):
        meetings[order[a]] = met[a]
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
