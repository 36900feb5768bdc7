"""Routes of the formation's centre past standing and moving boxes, in space and time. Compiled.

Every box is grown by the sphere and its margins, and moves on with its velocity. A route leads from corner
to corner of the grown boxes, each corner at its place at the time of arrival: the accessibility graph of
Fujimura and Samet, "Planning a time-minimal motion among moving obstacles" (Algorithmica 10, 1993). Where a
moving box will pass over the goal, the route waits beside a corner, and arrives when the goal stays free.
"""

from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from gcs.formation.obstacles import Outlines
from gcs.model.jit import kernel
from gcs.model.state import Array, Mask

HORIZON_S = 120.0
"""A moving box is foreseen for this long."""

SPARE_M = 0.3
"""Corners of a route lie this far outside the grown boxes."""

WAITING_STEP_S = 1.0
"""Departures from a corner are tried this far apart."""

REFUGE_S = 15.0
"""Where the goal cannot be had, the centre goes to the nearest place that stays free for this long."""

LENGTH_COST = 0.1
"""Of two ways that arrive when the goal becomes free, the shorter one is taken."""

SIGN_X, SIGN_Y = np.array([-1.0, -1.0, 1.0, 1.0]), np.array([-1.0, 1.0, -1.0, 1.0])
"""Corner k of box j has the number 4 j + k."""


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Boxes as the centre's route knows them: grown by sphere and margins. Show frame, now."""

    names: tuple[str, ...]
    table: Array  # (m, 6): centre x and y, velocity x and y, half-length x and y
    first: Array  # (m, 2) half-lengths for the way from where the centre is: no farther than to itself

    @staticmethod
    def grown(outlines: Outlines, by_m: Array, center_m: Array, *, strict: bool = False) -> "Boxes":
        """The boxes of these outlines grown by `by_m` (m,), as seen by a centre at (2,).

        A centre inside a grown box may leave it, but not go deeper; `strict`: it has no way out.
        """
        half_m = outlines.half_length_m + by_m[:, None]
        table = np.hstack([outlines.center_m, outlines.velocity_m_s, half_m])
        return Boxes(outlines.names, table, half_m if strict else _first(table, center_m))

    def corner_m(self, corner: int, time_s: float) -> Array:
        """(2,) place of a corner after `time_s`."""
        return np.array(_corner(self.table, corner, time_s))

    def velocity_m_s(self, corner: int) -> Array:
        """(2,) of the corner's box."""
        velocity: Array = self.table[corner // 4, 2:4]
        return velocity


@dataclass(frozen=True, slots=True, eq=False)
class Goal:
    """Where a route leads: a place over the ground that may move."""

    place_m: Array  # (2,) now
    velocity_m_s: Array  # (2,)
    stay_s: float = HORIZON_S  # time for which it must stay free after the arrival


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """Corners to pass in their order, then the goal."""

    corners: tuple[int, ...]
    arrival_s: tuple[float, ...]  # from now, at each corner and at the end
    reaches: bool  # False: it ends at its last corner, or where the centre is, as near as it can
    length_m: float  # to the last corner
    leaves_s: float = 0.0  # departure from there to the goal


def _first(table: Array, center_m: Array) -> Array:
    """(m, 2) half-lengths, shortened to the centre (2,) along the axis on which its way out is shortest."""
    half_m = table[:, 4:6].copy()
    away_m = np.abs(center_m[:2] - table[:, :2])
    depth_m = half_m - away_m
    for j in np.flatnonzero((depth_m > 0.0).all(axis=1)):
        axis = int(np.argmin(depth_m[j]))
        half_m[j, axis] = away_m[j, axis]
    return half_m


@kernel
def _corner(table: Array, corner: int, time_s: float) -> tuple[float, float]:
    j, k = corner // 4, corner % 4
    x_m = table[j, 0] + time_s * table[j, 2] + SIGN_X[k] * (table[j, 4] + SPARE_M)
    y_m = table[j, 1] + time_s * table[j, 3] + SIGN_Y[k] * (table[j, 5] + SPARE_M)
    return x_m, y_m


@kernel
def _meeting_s(dx_m: float, dy_m: float, vx_m_s: float, vy_m_s: float, speed_m_s: float) -> float:
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
def _inside(
    table: Array, half_m: Array, j: int, x_m: float, y_m: float, vx_m_s: float, vy_m_s: float, at_s: float
) -> tuple[float, float]:
    """Times after `at_s` between which a point moving on from (x, y) is inside box j; inf, -inf: never."""
    enter_s, leave_s = -inf, inf
    for axis in range(2):
        place = (x_m if axis == 0 else y_m) - table[j, axis] - at_s * table[j, 2 + axis]
        rate = (vx_m_s if axis == 0 else vy_m_s) - table[j, 2 + axis]
        half = half_m[j, axis] - 1e-6
        if abs(rate) < 1e-9:
            if abs(place) >= half:
                return inf, -inf
            continue
        one, other = (-half - place) / rate, (half - place) / rate
        if one > other:
            one, other = other, one
        enter_s, leave_s = max(enter_s, one), min(leave_s, other)
    if leave_s <= enter_s:
        return inf, -inf
    return enter_s, leave_s


@kernel
def _blocking(
    table: Array,
    half_m: Array,
    x_m: float,
    y_m: float,
    vx_m_s: float,
    vy_m_s: float,
    from_s: float,
    to_s: float,
) -> int:
    """The first box that a point moving on from (x, y) is inside of between two times; -1 for none."""
    lasts_s = min(to_s, HORIZON_S) - from_s
    first_s, first = inf, -1
    for j in range(len(table)):
        enter_s, leave_s = _inside(table, half_m, j, x_m, y_m, vx_m_s, vy_m_s, from_s)
        if leave_s > 1e-6 and enter_s < lasts_s - 1e-6 and enter_s < first_s:
            first_s, first = enter_s, j
    return first


@kernel
def _stays_free_from(
    table: Array, goal: tuple[float, float, float, float], from_s: float, stay_s: float
) -> float:
    """The first time from `from_s` on from which no box comes over the goal for `stay_s`; inf: never."""
    half_m = table[:, 4:6]
    for _ in range(len(table) + 1):
        until_s = min(from_s + stay_s, HORIZON_S)
        later_s = from_s
        for j in range(len(table)):
            enter_s, leave_s = _inside(table, half_m, j, goal[0], goal[1], goal[2], goal[3], 0.0)
            if enter_s < until_s and leave_s > from_s + 1e-6:
                later_s = max(later_s, leave_s)
        if later_s == from_s:
            return from_s
        if later_s >= HORIZON_S:
            return inf
        from_s = later_s
    return inf


@kernel
def _last_leg(
    table: Array,
    half_m: Array,
    x_m: float,
    y_m: float,
    vx_m_s: float,
    vy_m_s: float,
    at_s: float,
    goal: tuple[float, float, float, float],
    stay_s: float,
    speed_m_s: float,
) -> tuple[float, float]:
    """Departure from a moving place, and arrival at the goal where it stays free; infinity if impossible."""
    wait_s = 0.0
    while at_s + wait_s < HORIZON_S:
        leave_s = at_s + wait_s
        px_m, py_m = x_m + wait_s * vx_m_s, y_m + wait_s * vy_m_s
        gx_m, gy_m = goal[0] + leave_s * goal[2], goal[1] + leave_s * goal[3]
        fly_s = _meeting_s(gx_m - px_m, gy_m - py_m, goal[2], goal[3], speed_m_s)
        if fly_s == inf:
            return inf, inf
        free_s = _stays_free_from(table, goal, leave_s + fly_s, stay_s)
        if free_s == inf:
            return inf, inf
        if free_s <= leave_s + fly_s + WAITING_STEP_S:
            share = 1.0 / max(fly_s, 1e-9)
            wx_m_s = (gx_m + fly_s * goal[2] - px_m) * share
            wy_m_s = (gy_m + fly_s * goal[3] - py_m) * share
            if free_s == leave_s + fly_s and (
                fly_s < 1e-6
                or _blocking(table, half_m, px_m, py_m, wx_m_s, wy_m_s, leave_s, leave_s + fly_s) < 0
            ):
                return leave_s, leave_s + fly_s
        if _blocking(table, half_m, x_m, y_m, vx_m_s, vy_m_s, at_s, leave_s + WAITING_STEP_S) >= 0:
            return inf, inf
        wait_s += WAITING_STEP_S
        if vx_m_s == 0.0 and vy_m_s == 0.0 and not (table[:, 2:4] != 0.0).any():
            return inf, inf
    return inf, inf


@kernel
def _flown(
    table: Array,
    half_m: Array,
    x_m: float,
    y_m: float,
    corner: int,
    from_s: float,
    until_s: float,
    speed_m_s: float,
    reach_m: float,
) -> tuple[float, float]:
    """Time and length of the straight way from (x, y) to a corner; infinity when it is not free.

    Also when the corner is met after `until_s`, or beyond `reach_m`.
    """
    cx_m, cy_m = _corner(table, corner, from_s)
    ux_m_s, uy_m_s = table[corner // 4, 2], table[corner // 4, 3]
    fly_s = _meeting_s(cx_m - x_m, cy_m - y_m, ux_m_s, uy_m_s, speed_m_s)
    if from_s + fly_s >= until_s:
        return inf, inf
    tx_m, ty_m = cx_m + fly_s * ux_m_s, cy_m + fly_s * uy_m_s
    if np.hypot(tx_m, ty_m) > reach_m:
        return inf, inf
    if fly_s > 1e-6:
        wx_m_s, wy_m_s = (tx_m - x_m) / fly_s, (ty_m - y_m) / fly_s
        if _blocking(table, half_m, x_m, y_m, wx_m_s, wy_m_s, from_s, from_s + fly_s) >= 0:
            return inf, inf
    return fly_s, fly_s * speed_m_s


@kernel
def _next(
    table: Array, arrival_s: Array, closed: Mask, goal: tuple[float, float, float, float], speed_m_s: float
) -> tuple[int, float]:
    """The open corner from which the goal could be reached first, and that time; -1 and infinity for none."""
    best, least = -1, inf
    for v in range(len(arrival_s)):
        at_s = arrival_s[v]
        if not closed[v] and at_s < inf:
            cx_m, cy_m = _corner(table, v, at_s)
            away_m = np.hypot(goal[0] + at_s * goal[2] - cx_m, goal[1] + at_s * goal[3] - cy_m)
            if at_s + away_m / speed_m_s < least:
                best, least = v, at_s + away_m / speed_m_s
    return best, least


@kernel
def _search(
    table: Array,
    first_m: Array,
    x_m: float,
    y_m: float,
    goal: tuple[float, float, float, float],
    stay_s: float,
    speed_m_s: float,
    reach_m: float,
) -> tuple[Array, NDArray[np.intp], Array, int, float, float]:
    """Earliest arrival at every corner and at the goal.

    Returns: (4 m,) arrivals, (4 m,) corners before, -1 for the start, (4 m,) path lengths, the corner before
        the goal, -1 for the start, -2 without a way; departure from it, and arrival.
    """
    count = 4 * len(table)
    half_m = table[:, 4:6]
    arrival_s, before = np.full(count, inf), np.full(count, -1)
    length_m, closed = np.zeros(count), np.zeros(count, np.bool_)
    leave_s, best_s = _last_leg(table, first_m, x_m, y_m, 0.0, 0.0, 0.0, goal, stay_s, speed_m_s)
    best = -1 if best_s < inf else -2
    if best == -1 and leave_s == 0.0:
        return arrival_s, before, length_m, best, leave_s, best_s
    best_cost = best_s
    here, here_s, here_m = -1, 0.0, 0.0
    hx_m, hy_m = x_m, y_m
    while True:
        legs_m = first_m if here == -1 else half_m
        until_s = min(best_cost, 10.0 * HORIZON_S)
        for v in range(count):
            if closed[v]:
                continue
            fly_s, way_m = _flown(
                table, legs_m, hx_m, hy_m, v, here_s, min(until_s, arrival_s[v]), speed_m_s, reach_m
            )
            if fly_s < inf:
                arrival_s[v], before[v], length_m[v] = here_s + fly_s, here, here_m + way_m
        here, least = _next(table, arrival_s, closed, goal, speed_m_s)
        if here < 0 or least >= best_cost:
            break
        closed[here] = True
        here_s, here_m = arrival_s[here], length_m[here]
        hx_m, hy_m = _corner(table, here, here_s)
        ux_m_s, uy_m_s = table[here // 4, 2], table[here // 4, 3]
        leaves_s, there_s = _last_leg(
            table, half_m, hx_m, hy_m, ux_m_s, uy_m_s, here_s, goal, stay_s, speed_m_s
        )
        cost = there_s + LENGTH_COST * here_m / speed_m_s
        if cost < best_cost:
            best, best_cost, leave_s, best_s = here, cost, leaves_s, there_s
    return arrival_s, before, length_m, best, leave_s, best_s


@kernel
def _refuge(
    table: Array,
    first_m: Array,
    x_m: float,
    y_m: float,
    goal: tuple[float, float, float, float],
    arrival_s: Array,
) -> int:
    """The corner nearest to the goal beside which the centre can stay, -1: where it is.

    Where nothing stays free for `REFUGE_S`, what stays free for the longest time.
    """
    half_m = table[:, 4:6]
    best, least = -1, inf
    for v in range(-1, len(arrival_s)):
        at_s = 0.0 if v < 0 else arrival_s[v]
        if at_s == inf:
            continue
        px_m, py_m, vx_m_s, vy_m_s = x_m, y_m, 0.0, 0.0
        if v >= 0:
            px_m, py_m = _corner(table, v, at_s)
            vx_m_s, vy_m_s = table[v // 4, 2], table[v // 4, 3]
        legs_m = first_m if v < 0 else half_m
        free_s = REFUGE_S
        while free_s > 0.0 and _blocking(table, legs_m, px_m, py_m, vx_m_s, vy_m_s, at_s, at_s + free_s) >= 0:
            free_s -= 3.0
        until_s = at_s + max(free_s, 0.0)
        away_m = np.hypot(
            goal[0] + until_s * goal[2] - px_m - (until_s - at_s) * vx_m_s,
            goal[1] + until_s * goal[3] - py_m - (until_s - at_s) * vy_m_s,
        )
        cost = away_m + 1e4 * (REFUGE_S - max(free_s, 0.0)) + (2.0 if v >= 0 else 0.0)
        if cost < least:
            best, least = v, cost
    return best


def find_route(boxes: Boxes, center_m: Array, goal: Goal, speed_m_s: float, reach_m: float) -> Route:
    """The earliest route of a centre at (2,) to the goal, or to the nearest refuge where there is none.

    Args:
        boxes: grown by the sphere.
        center_m: show frame.
        goal: where it leads.
        speed_m_s: over the ground, on every leg.
        reach_m: no corner farther from the show's origin is used.
    """
    ends = _ends(goal)
    x_m, y_m = _pair(center_m)
    arrival_s, before, length_m, last, leaves_s, there_s = _search(
        boxes.table, boxes.first, x_m, y_m, ends, goal.stay_s, speed_m_s, reach_m
    )
    reaches = last > -2
    if not reaches:
        last = int(_refuge(boxes.table, boxes.first, x_m, y_m, ends, arrival_s))
    corners: list[int] = []
    at = int(last)
    while at >= 0:
        corners.insert(0, at)
        at = int(before[at])
    times_s = [float(arrival_s[corner]) for corner in corners]
    way_m = float(length_m[last]) if last >= 0 else 0.0
    if reaches:
        times_s.append(float(there_s))
    return Route(tuple(corners), tuple(times_s), reaches, way_m, float(leaves_s))


def timed(
    boxes: Boxes, center_m: Array, corners: tuple[int, ...], goal: Goal, speed_m_s: float, *, reaches: bool
) -> Route | None:
    """The route over these corners as it would be flown from (2,) now; None where a box is in its way."""
    here_m, now_s, way_m, leaves_s = np.asarray(center_m[:2], dtype=np.float64), 0.0, 0.0, 0.0
    times_s = []
    for k, corner in enumerate(corners):
        there_m, fly_s = _leg(boxes, here_m, corner, now_s, speed_m_s, first=k == 0)
        if fly_s == inf:
            return None
        way_m += float(np.hypot(*(there_m - here_m)))
        here_m, now_s = there_m, now_s + fly_s
        times_s.append(now_s)
    if reaches:
        velocity_m_s = boxes.velocity_m_s(corners[-1]) if corners else np.zeros(2)
        half_m = boxes.table[:, 4:6] if corners else boxes.first
        leaves_s, there_s = _last_leg(
            boxes.table,
            np.ascontiguousarray(half_m),
            float(here_m[0]),
            float(here_m[1]),
            float(velocity_m_s[0]),
            float(velocity_m_s[1]),
            now_s,
            _ends(goal),
            goal.stay_s,
            speed_m_s,
        )
        if there_s == inf:
            return None
        times_s.append(float(there_s))
    return Route(corners, tuple(times_s), reaches, way_m, float(leaves_s))


def next_leg(
    boxes: Boxes, center_m: Array, route: Route, goal: Goal, speed_m_s: float
) -> tuple[tuple[int, ...], Array] | None:
    """The corners still to pass, and the (2,) velocity of the first leg; None where no leg is free.

    Without corners the velocity leads to the goal, or is 0 where the route does not reach it.
    """
    if route.reaches and leaves_now(boxes, center_m, goal, speed_m_s):
        gap_m = goal.place_m - center_m[:2]
        gap, away = _pair(gap_m), _pair(goal.velocity_m_s)
        fly_s = max(float(_meeting_s(gap[0], gap[1], away[0], away[1], speed_m_s)), 1e-3)
        return (), gap_m / fly_s + goal.velocity_m_s
    if not route.corners:
        return ((), np.zeros(2)) if not route.reaches else None
    for k in range(len(route.corners) - 1, -1, -1):
        there_m, fly_s = _leg(boxes, center_m[:2], route.corners[k], 0.0, speed_m_s, first=True)
        if fly_s < inf:
            along_m_s = boxes.velocity_m_s(route.corners[k])
            if fly_s > 1e-3:
                along_m_s = (there_m - center_m[:2]) / fly_s
            return route.corners[k:], along_m_s
    return None


def leaves_now(boxes: Boxes, center_m: Array, goal: Goal, speed_m_s: float) -> bool:
    """Whether the straight way to the goal is free now, and the goal then stays free."""
    x_m, y_m = _pair(center_m)
    leave_s, _ = _last_leg(
        boxes.table, boxes.first, x_m, y_m, 0.0, 0.0, 0.0, _ends(goal), goal.stay_s, speed_m_s
    )
    return bool(leave_s == 0.0)


def in_the_way(boxes: Boxes, center_m: Array, goal: Goal, speed_m_s: float) -> str:
    """The box on the straight way to the goal, or the one that covers it; "" for none."""
    gap_m = goal.place_m - center_m[:2]
    fly_s = float(np.hypot(*gap_m)) / speed_m_s
    velocity_m_s = gap_m / max(fly_s, 1e-9)
    (x_m, y_m), (vx_m_s, vy_m_s) = _pair(center_m), _pair(velocity_m_s)
    j = int(_blocking(boxes.table, boxes.first, x_m, y_m, vx_m_s, vy_m_s, 0.0, fly_s))
    if j < 0:
        half_m = np.ascontiguousarray(boxes.table[:, 4:6])
        j = int(_blocking(boxes.table, half_m, *_ends(goal), 0.0, HORIZON_S))
    return boxes.names[j] if j >= 0 else ""


def _leg(
    boxes: Boxes, here_m: Array, corner: int, from_s: float, speed_m_s: float, *, first: bool
) -> tuple[Array, float]:
    """Where and after how long a corner is met; infinity when a box is in the way."""
    half_m = boxes.first if first else np.ascontiguousarray(boxes.table[:, 4:6])
    place = _pair(here_m)
    fly_s, _ = _flown(boxes.table, half_m, *place, corner, from_s, inf, speed_m_s, inf)
    if fly_s == inf:
        return here_m, inf
    return boxes.corner_m(corner, from_s + float(fly_s)), float(fly_s)


def _ends(goal: Goal) -> tuple[float, float, float, float]:
    return (*_pair(goal.place_m), *_pair(goal.velocity_m_s))


def _pair(vector: Array) -> tuple[float, float]:
    return float(vector[0]), float(vector[1])


def later(boxes: Boxes, goal: Goal, by_s: float, center_m: Array) -> tuple[Boxes, Goal]:
    """Boxes and goal after `by_s`, as a centre at (2,) sees them that stays where it is."""
    table = boxes.table.copy()
    table[:, :2] += by_s * table[:, 2:4]
    moved = replace(goal, place_m=goal.place_m + by_s * goal.velocity_m_s)
    return Boxes(boxes.names, table, _first(table, center_m)), moved


def stays_free(boxes: Boxes, center_m: Array, for_s: float) -> bool:
    """Whether no grown box comes over a centre that stays at (2,)."""
    return int(_blocking(boxes.table, boxes.first, *_pair(center_m), 0.0, 0.0, 0.0, for_s)) < 0


def warm_up() -> None:
    """Compile or load every kernel that a route needs."""
    outlines = Outlines(
        ("wall",), np.array([[20.0, 0.0]]), np.full((1, 2), 7.0), np.zeros((1, 2)), np.ones(1)
    )
    boxes, here_m = Boxes.grown(outlines, np.zeros(1), np.zeros(2)), np.zeros(2)
    for goal in (Goal(np.array([40.0, 0.0]), here_m), Goal(np.array([20.0, 0.0]), here_m)):
        route = find_route(boxes, here_m, goal, 2.0, 100.0)
        timed(boxes, here_m, route.corners, goal, 2.0, reaches=route.reaches)
        next_leg(boxes, here_m, route, goal, 2.0)
        in_the_way(boxes, here_m, goal, 2.0)
    stays_free(boxes, here_m, 1.0)
