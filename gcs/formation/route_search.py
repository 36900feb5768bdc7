"""The search for the centre's routes (`gcs.formation.route`): earliest arrivals in space and time. Compiled.

Boxes, here, are rows: `place` (m, 4), centre and velocity over the ground; `half_m` (m, 6), half-widths in
the directions of the sides; `corners` (12 m, 4), place and velocity of the corners of these dodecagons.
"""

from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from gcs.model.jit import kernel
from gcs.model.state import Array, Mask

HORIZON_S = 120.0
"""A moving box is foreseen for this long."""

WAITING_STEP_S, WAITING_GROWTH = 1.0, 1.1
"""Departures from a corner are tried this far apart, later ones farther by this factor."""

REFUGE_S = 15.0
"""Where the goal cannot be had, the centre goes to the nearest place that stays free for this long."""

LENGTH_COST = 0.1
"""Of two ways that arrive when the goal becomes free, the shorter one is taken."""

CORNERS = 12
"""Of a grown box. Corner k of box j has the number 12 j + k, and lies between the sides k and k + 1."""

AXES = CORNERS // 2
"""Sides k and k + 6 are opposite; side k faces the direction (`FACING_X[k]`, `FACING_Y[k]`)."""

FACING_X = np.cos(2.0 * np.pi * np.arange(CORNERS) / CORNERS)
FACING_Y = np.sin(2.0 * np.pi * np.arange(CORNERS) / CORNERS)

Mover = tuple[float, float, float, float]
"""A place (x, y) now and its velocity, over the ground."""


@kernel
def grown_boxes(
    place: Array, half_length_m: Array, by_m: Array, as_ellipse: Mask, spare_m: float
) -> tuple[Array, Array]:
    """`half_m` and `corners` of boxes with half-lengths (m, 2), or of their ellipses, grown by (m,).

    The corners lie `spare_m` outside.
    """
    half_m, corners = np.empty((len(place), AXES)), np.empty((CORNERS * len(place), 4))
    turn = 2.0 * np.pi / CORNERS
    for j in range(len(place)):
        for k in range(AXES):
            along_x, along_y = half_length_m[j, 0] * abs(FACING_X[k]), half_length_m[j, 1] * abs(FACING_Y[k])
            ellipse_m = sqrt(2.0 * (along_x**2 + along_y**2))
            half_m[j, k] = by_m[j] + (ellipse_m if as_ellipse[j] else along_x + along_y)
        for k in range(CORNERS):
            one_m = half_m[j, k % AXES] + spare_m
            other_m = half_m[j, (k + 1) % AXES] + spare_m
            along_m = (other_m - one_m * np.cos(turn)) / np.sin(turn)  # from the middle of side k
            corners[CORNERS * j + k, 0] = place[j, 0] + one_m * FACING_X[k] - along_m * FACING_Y[k]
            corners[CORNERS * j + k, 1] = place[j, 1] + one_m * FACING_Y[k] + along_m * FACING_X[k]
            corners[CORNERS * j + k, 2:] = place[j, 2:]
    return half_m, corners


@kernel
def out_of(place: Array, half_m: Array, here_m: Array) -> Array:
    """`half_m`, shortened to a place (2,) inside along the axis on which its way out is shortest."""
    first_m = half_m.copy()
    for j in range(len(place)):
        x_m, y_m = here_m[0] - place[j, 0], here_m[1] - place[j, 1]
        depth_m, axis = inf, 0
        for k in range(AXES):
            away_m = abs(x_m * FACING_X[k] + y_m * FACING_Y[k])
            if half_m[j, k] - away_m < depth_m:
                depth_m, axis = half_m[j, k] - away_m, k
        if depth_m > 0.0:
            first_m[j, axis] -= depth_m
    return first_m


@kernel
def gaps_m(center_m: Array, half_length_m: Array, place_m: Array) -> Array:
    """(m,) by how much each box may grow before it holds a place (2,)."""
    gap_m = np.empty(len(center_m))
    for j in range(len(center_m)):
        x_m = abs(place_m[0] - center_m[j, 0]) - half_length_m[j, 0]
        y_m = abs(place_m[1] - center_m[j, 1]) - half_length_m[j, 1]
        gap_m[j] = max(x_m, y_m, (x_m + y_m) / sqrt(2.0))
    return gap_m


@kernel
def meeting_s(dx_m: float, dy_m: float, vx_m_s: float, vy_m_s: float, speed_m_s: float) -> float:
    """Time until a point with that speed meets one at (dx, dy) with velocity (vx, vy); infinity if never."""
    a = vx_m_s * vx_m_s + vy_m_s * vy_m_s - speed_m_s * speed_m_s
    b = dx_m * vx_m_s + dy_m * vy_m_s
    c = dx_m * dx_m + dy_m * dy_m
    if c < 1e-18:
        return 0.0
    if abs(a) < 1e-12:
        return -c / (2.0 * b) if b < 0.0 else inf
    root = b * b - a * c
    if root < 0.0:
        return inf
    root = np.sqrt(root)
    one, other = (-b - root) / a, (-b + root) / a
    if one > other:
        one, other = other, one
    return one if one >= 0.0 else (other if other >= 0.0 else inf)


@kernel
def inside_s(place: Array, half_m: Array, j: int, mover: Mover, at_s: float) -> tuple[float, float]:
    """Times after `at_s` between which a point moving on is inside box j; inf, -inf: never.

    The point is at its place at `at_s`, the box at time 0.
    """
    enter_s, leave_s = -inf, inf
    x_m, y_m = mover[0] - place[j, 0] - at_s * place[j, 2], mover[1] - place[j, 1] - at_s * place[j, 3]
    vx_m_s, vy_m_s = mover[2] - place[j, 2], mover[3] - place[j, 3]
    for axis in range(AXES):
        along_m = x_m * FACING_X[axis] + y_m * FACING_Y[axis]
        rate = vx_m_s * FACING_X[axis] + vy_m_s * FACING_Y[axis]
        half = half_m[j, axis] - 1e-6
        if abs(rate) < 1e-9:
            if abs(along_m) >= half:
                return inf, -inf
            continue
        one, other = (-half - along_m) / rate, (half - along_m) / rate
        if one > other:
            one, other = other, one
        enter_s, leave_s = max(enter_s, one), min(leave_s, other)
        if leave_s <= enter_s:
            return inf, -inf
    return enter_s, leave_s


@kernel
def is_blocked(place: Array, half_m: Array, mover: Mover, from_s: float, to_s: float) -> bool:
    """Whether a point moving on from its place at `from_s` is inside any box before `to_s`."""
    for j in range(len(place)):
        stands = place[j, 2] == 0.0 and place[j, 3] == 0.0
        lasts_s = (to_s if stands else min(to_s, HORIZON_S)) - from_s
        wide_m, long_m = half_m[j, 0], half_m[j, AXES // 2]
        x_m, way_x_m = mover[0] - place[j, 0] - from_s * place[j, 2], lasts_s * (mover[2] - place[j, 2])
        if min(x_m, x_m + way_x_m) >= wide_m or max(x_m, x_m + way_x_m) <= -wide_m:
            continue
        y_m, way_y_m = mover[1] - place[j, 1] - from_s * place[j, 3], lasts_s * (mover[3] - place[j, 3])
        if min(y_m, y_m + way_y_m) >= long_m or max(y_m, y_m + way_y_m) <= -long_m:
            continue
        past_m2 = x_m * way_y_m - y_m * way_x_m  # the way's distance from the box's centre, times its length
        if past_m2**2 >= (wide_m**2 + long_m**2) * (way_x_m**2 + way_y_m**2) > 0.0:
            continue
        enter_s, leave_s = inside_s(place, half_m, j, mover, from_s)
        if leave_s > 1e-6 and enter_s < lasts_s - 1e-6:
            return True
    return False


@kernel
def alone_until_s(place: Array, half_m: Array, mover: Mover, from_s: float) -> float:
    """The time from which a box is over a point moving on from its place at `from_s`."""
    until_s = inf
    for j in range(len(place)):
        enter_s, leave_s = inside_s(place, half_m, j, mover, from_s)
        if leave_s > 1e-6:
            until_s = min(until_s, from_s + max(enter_s, 0.0))
    return until_s


@kernel
def covered(place: Array, half_m: Array, goal: Mover) -> Array:
    """(m, 2) times from and to which each box is over the goal; inf, -inf: never."""
    covered_s = np.empty((len(place), 2))
    for j in range(len(place)):
        covered_s[j, 0], covered_s[j, 1] = inside_s(place, half_m, j, goal, 0.0)
    return covered_s


@kernel
def _stays_free_from(covered_s: Array, from_s: float, stay_s: float) -> float:
    """The first time from `from_s` on from which no box comes over the goal for `stay_s`; inf: never."""
    for _ in range(len(covered_s) + 1):
        until_s = min(from_s + stay_s, HORIZON_S)
        later_s = from_s
        for j in range(len(covered_s)):
            if covered_s[j, 0] < until_s and covered_s[j, 1] > from_s + 1e-6:
                later_s = max(later_s, covered_s[j, 1])
        if later_s == from_s:
            return from_s
        if later_s >= HORIZON_S:
            return inf
        from_s = later_s
    return inf


@kernel
def last_leg(
    place: Array,
    half_m: Array,
    covered_s: Array,
    mover: Mover,
    at_s: float,
    goal: Mover,
    stay_s: float,
    speed_m_s: float,
    latest_s: float,
) -> tuple[float, float]:
    """Departure from a moving place, and arrival at the goal where it stays free; infinity if impossible.

    No departure is later than `latest_s`.
    """
    leave_s, alone_s, step_s = at_s, -inf, WAITING_STEP_S
    while True:
        x_m, y_m = mover[0] + (leave_s - at_s) * mover[2], mover[1] + (leave_s - at_s) * mover[3]
        to_x_m, to_y_m = goal[0] + leave_s * goal[2] - x_m, goal[1] + leave_s * goal[3] - y_m
        fly_s = meeting_s(to_x_m, to_y_m, goal[2], goal[3], speed_m_s)
        free_s = _stays_free_from(covered_s, leave_s + fly_s, stay_s) if fly_s < inf else inf
        if free_s == inf:
            return inf, inf
        if free_s == leave_s + fly_s:
            share = 1.0 / max(fly_s, 1e-9)
            leg = (x_m, y_m, to_x_m * share + goal[2], to_y_m * share + goal[3])
            if fly_s < 1e-6 or not is_blocked(place, half_m, leg, leave_s, leave_s + fly_s):
                return leave_s, leave_s + fly_s
        leave_s += max(step_s, (free_s - leave_s - fly_s) / 2.0)  # the corner may gain on the goal meanwhile
        step_s *= WAITING_GROWTH
        if leave_s > latest_s:
            return inf, inf
        if alone_s == -inf:
            stands = mover[2] == 0.0 and mover[3] == 0.0 and goal[2] == 0.0 and goal[3] == 0.0
            if stands and not place[:, 2:].any():
                return inf, inf
            alone_s = alone_until_s(place, half_m, mover, at_s)
        if leave_s > alone_s:
            return inf, inf


@kernel
def _is_tangent(corner: int, x: float, y: float) -> bool:
    """Whether a line in the direction (x, y) through a corner passes its own box by."""
    k = corner % CORNERS
    after = (k + 1) % CORNERS
    product = (x * FACING_X[k] + y * FACING_Y[k]) * (x * FACING_X[after] + y * FACING_Y[after])
    return bool(product <= 1e-9 * (x * x + y * y))


@kernel
def _leg_s(
    place: Array,
    half_m: Array,
    corners: Array,
    here: int,
    mover: Mover,
    here_s: float,
    v: int,
    until_s: float,
    speed_m_s: float,
    reach_m: float,
) -> float:
    """Duration of the leg from corner `here` (-1: a place at which a way may turn anyhow) to corner `v`.

    Infinity where no earliest route has this leg, it is blocked, too long, or ends beyond `reach_m`.
    """
    vx_m_s, vy_m_s = corners[v, 2], corners[v, 3]
    dx_m, dy_m = corners[v, 0] + here_s * vx_m_s - mover[0], corners[v, 1] + here_s * vy_m_s - mover[1]
    if here >= 0 and not _is_tangent(v, dx_m, dy_m):
        return inf
    fly_s = meeting_s(dx_m, dy_m, vx_m_s, vy_m_s, speed_m_s)
    if here_s + fly_s >= until_s:
        return inf
    if np.hypot(mover[0] + dx_m + fly_s * vx_m_s, mover[1] + dy_m + fly_s * vy_m_s) > reach_m:
        return inf
    if fly_s > 1e-6:
        leg = (mover[0], mover[1], dx_m / fly_s + vx_m_s, dy_m / fly_s + vy_m_s)
        if here >= 0 and not _is_tangent(here, leg[2] - mover[2], leg[3] - mover[3]):
            return inf
        if is_blocked(place, half_m, leg, here_s, here_s + fly_s):
            return inf
    return fly_s


@kernel
def search(
    place: Array,
    half_m: Array,
    first_m: Array,
    corners: Array,
    start: tuple[float, float],
    goal: Mover,
    stay_s: float,
    speed_m_s: float,
    reach_m: float,
) -> tuple[Array, NDArray[np.intp], int, float, float]:
    """Earliest arrival at the corners that may lie on the way, and at the goal.

    Returns: (8 m,) arrivals, (8 m,) corners before, -1 for the start, the corner before the goal, -1 for the
        start, -2 without a way; departure from it, and arrival.
    """
    count = len(corners)
    arrival_s, before = np.full(count, inf), np.full(count, -1)
    length_m, rank_s = np.zeros(count), np.full(count, inf)  # inf: not open
    closed = np.zeros(count, np.bool_)
    covered_s = covered(place, half_m, goal)
    from_inside = bool((first_m != half_m).any())
    here, here_s, here_m, x_m, y_m = -1, 0.0, 0.0, start[0], start[1]
    best, best_cost, leave_s, best_s = -2, inf, inf, inf
    while True:
        legs_m = first_m if here < 0 else half_m
        # a corner by which the start leaves a box is passed at any angle
        bends = -1 if here < 0 or (from_inside and before[here] < 0) else here
        own_m_s = (0.0, 0.0) if here < 0 else (corners[here, 2], corners[here, 3])
        mover = (x_m, y_m, own_m_s[0], own_m_s[1])
        leaves_s, there_s = last_leg(
            place, legs_m, covered_s, mover, here_s, goal, stay_s, speed_m_s, min(best_cost, HORIZON_S)
        )
        cost = there_s + LENGTH_COST * (here_m / speed_m_s + there_s - leaves_s)  # NaN without a way
        if cost < best_cost:
            best, best_cost, leave_s, best_s = here, cost, leaves_s, there_s
        if here < 0 and leave_s == 0.0:
            break
        for v in range(count):
            if closed[v]:
                continue
            until_s = min(best_cost, arrival_s[v])
            fly_s = _leg_s(place, legs_m, corners, bends, mover, here_s, v, until_s, speed_m_s, reach_m)
            if fly_s == inf:
                continue
            vx_m_s, vy_m_s = corners[v, 2], corners[v, 3]
            arrival_s[v], before[v], length_m[v] = here_s + fly_s, here, here_m + fly_s * speed_m_s
            to_x_m = goal[0] + arrival_s[v] * goal[2] - corners[v, 0] - arrival_s[v] * vx_m_s
            to_y_m = goal[1] + arrival_s[v] * goal[3] - corners[v, 1] - arrival_s[v] * vy_m_s
            rank_s[v] = arrival_s[v] + np.hypot(to_x_m, to_y_m) / speed_m_s
        here = int(np.argmin(rank_s)) if count else -1
        if here < 0 or rank_s[here] >= best_cost or rank_s[here] == inf:
            break
        closed[here], rank_s[here] = True, inf
        here_s, here_m = arrival_s[here], length_m[here]
        x_m, y_m = corners[here, 0] + here_s * corners[here, 2], corners[here, 1] + here_s * corners[here, 3]
    return arrival_s, before, best, leave_s, best_s


@kernel
def refuge(
    place: Array,
    half_m: Array,
    first_m: Array,
    corners: Array,
    start: tuple[float, float],
    goal: Mover,
    arrival_s: Array,
) -> int:
    """The corner nearest to the goal beside which the centre can stay, -1: where it is.

    Where nothing stays free for `REFUGE_S`, what stays free for the longest time.
    """
    best, least = -1, inf
    for v in range(-1, len(corners)):
        at_s, here, legs_m = 0.0, (start[0], start[1], 0.0, 0.0), first_m
        if v >= 0:
            at_s, legs_m = arrival_s[v], half_m
            vx_m_s, vy_m_s = corners[v, 2], corners[v, 3]
            here = (corners[v, 0] + at_s * vx_m_s, corners[v, 1] + at_s * vy_m_s, vx_m_s, vy_m_s)
        if at_s == inf:
            continue
        free_s = min(alone_until_s(place, legs_m, here, at_s) - at_s, REFUGE_S)
        until_s = at_s + free_s
        away_m = np.hypot(
            goal[0] + until_s * goal[2] - here[0] - free_s * here[2],
            goal[1] + until_s * goal[3] - here[1] - free_s * here[3],
        )
        cost = away_m + 1e4 * (REFUGE_S - free_s) + (2.0 if v >= 0 else 0.0)
        if cost < least:
            best, least = v, cost
    return best
