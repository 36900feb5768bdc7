"""The shortest way of one vehicle round obstacles, in plan (decision 0064). Compiled, and without a lock.

Each obstacle is an ellipse, grown by what the way keeps. A way leads from corner to corner of polygons about
the ellipses: what sees what, and the shortest way in that graph. At first only the ellipses count that the
straight way meets, then those that the way found meets as well: few of many are looked at, and a shortest way
past some that meets no other is a shortest way past all.

Ellipses of long walls cover the doorways between them: `way_between` has the boxes themselves.

Before a box that moves a vehicle cannot wait, and the shortest way past where boxes are now may be closed
when it gets there. `way_out` compares straight ways, to its goal and to places around, in space and time.
"""

from typing import Final

import numpy as np

from gcs.model.jit import kernel, kernel_apart
from gcs.model.state import TINY, Array, Mask

POINTS: Final = 12
"""Corners of the polygon about an ellipse."""

OUTSIDE: Final = float(1.001 / np.cos(np.pi / POINTS))
"""So far outside, in radii of the ellipse, lie the corners of a polygon about it that does not cut it."""

BOX_POINTS, BESIDE, ON_FACE = 4, 1.0 + 1e-3, 1.0 - 1e-9
"""Corners of a box, so far outside, in half-lengths; the last puts a face just inside of a place on it."""

DIRECTIONS, REACHES_M = 24, (6.0, 12.0, 24.0, 40.0)
"""Places around a vehicle that are compared as ways out."""

HORIZON_S: Final = 20.0
"""What stays free of boxes for so long counts as free."""

PINCHED_S, PUT_OFF_S = 10.0, 3.0
"""A vehicle over which a box moves before the first leaves if none could be left after the second."""

GAP_M: Final = 2.0
"""Beside boxes a vehicle brakes: gaps are this much narrower on each side than they are."""

COUNTED_MAX: Final = 10
"""A way that meets more ellipses than this is not looked for."""


@kernel
def passes(one_m: Array, other_m: Array, center_m: Array, semi_m: Array) -> bool:
    """Whether the straight way between two places (2,) passes an ellipse, or only leads out of it."""
    x, y = (one_m[0] - center_m[0]) / semi_m[0], (one_m[1] - center_m[1]) / semi_m[1]
    along_x, along_y = (other_m[0] - one_m[0]) / semi_m[0], (other_m[1] - one_m[1]) / semi_m[1]
    begun, ended = x * x + y * y, (x + along_x) ** 2 + (y + along_y) ** 2
    length = along_x * along_x + along_y * along_y
    share = min(max(-(x * along_x + y * along_y) / max(length, 1e-12), 0.0), 1.0)
    nearest = (x + share * along_x) ** 2 + (y + share * along_y) ** 2
    return bool(nearest >= min(1.0, 0.999 * min(begun, ended)))


@kernel
def passes_box(one_m: Array, other_m: Array, center_m: Array, half_m: Array) -> bool:
    """As `passes`, of a box with these half-lengths; one that begins or ends within it goes no deeper."""
    half_x_m, half_y_m = half_m[0], half_m[1]
    for end_m in (one_m, other_m):
        x_m, y_m = abs(end_m[0] - center_m[0]), abs(end_m[1] - center_m[1])
        if x_m < half_x_m and y_m < half_y_m:
            if half_x_m - x_m < half_y_m - y_m:
                half_x_m = ON_FACE * x_m
            else:
                half_y_m = ON_FACE * y_m
    off_m = one_m[0] - center_m[0], one_m[1] - center_m[1]
    along_m = other_m[0] - one_m[0], other_m[1] - one_m[1]
    return bool(_enters_s(off_m, along_m, (half_x_m, half_y_m)) >= 1.0)


@kernel
def _passes(one_m: Array, other_m: Array, center_m: Array, semi_m: Array, as_boxes: bool) -> bool:
    """As `passes`, or as `passes_box`."""
    if as_boxes:
        return passes_box(one_m, other_m, center_m, semi_m)
    return passes(one_m, other_m, center_m, semi_m)


@kernel
def _passes_all(
    one_m: Array, other_m: Array, center_m: Array, semi_m: Array, counted: Mask, as_boxes: bool
) -> bool:
    """As `_passes`, of those (m, 2) that count (m,)."""
    for k in range(len(center_m)):
        if counted[k] and not _passes(one_m, other_m, center_m[k], semi_m[k], as_boxes):
            return False
    return True


@kernel
def _count_met(
    one_m: Array, other_m: Array, center_m: Array, semi_m: Array, counted: Mask, as_boxes: bool
) -> bool:
    """Have those (m, 2) count (m,) that the straight way meets. Returns: whether it meets any."""
    met = False
    for k in range(len(center_m)):
        if not _passes(one_m, other_m, center_m[k], semi_m[k], as_boxes):
            counted[k] = met = True
    return met


@kernel_apart
def way_round(
    start_m: Array, goal_m: Array, center_m: Array, semi_m: Array, within_m: float
) -> tuple[Array, bool]:
    """Corners (k, 2) of the shortest way from start to goal, none where it is straight; whether there is one.

    Args:
        start_m: (2,) show frame; a start within an ellipse may be left, but no deeper.
        goal_m: (2,) likewise.
        center_m: (m, 2) of the ellipses.
        semi_m: (m, 2) their semi-axes, with all that the way keeps.
        within_m: distance from the origin beyond which no corner lies.
    """
    return _way(start_m, goal_m, center_m, semi_m, within_m, False)


@kernel
def way_between(
    start_m: Array, goal_m: Array, center_m: Array, half_m: Array, within_m: float
) -> tuple[Array, bool]:
    """As `way_round`, between boxes with these half-lengths (m, 2): also through a doorway of long walls."""
    return _way(start_m, goal_m, center_m, half_m, within_m, True)


@kernel_apart
def _way(
    start_m: Array, goal_m: Array, center_m: Array, semi_m: Array, within_m: float, as_boxes: bool
) -> tuple[Array, bool]:
    """As `way_round`, or as `way_between`."""
    counted = np.zeros(len(center_m), np.bool_)
    way_m = np.empty((0, 2))
    while True:
        met, before_m = False, start_m
        for k in range(len(way_m)):
            met |= _count_met(before_m, way_m[k], center_m, semi_m, counted, as_boxes)
            before_m = way_m[k]
        met |= _count_met(before_m, goal_m, center_m, semi_m, counted, as_boxes)
        if not met:
            return way_m, True
        if counted.sum() > COUNTED_MAX:
            return way_m[:0], False
        corner_m = _corners(center_m, semi_m, counted, within_m, as_boxes)
        way_m = _shortest(start_m, goal_m, corner_m, center_m, semi_m, counted, as_boxes)
        if len(way_m) == 0 and not _count_overlapping(center_m, semi_m, counted, as_boxes):
            return way_m, False


@kernel
def _corner_m(center_m: Array, semi_m: Array, point: int, as_boxes: bool) -> tuple[float, float]:
    """Of the polygon about an ellipse, or of a box: the corner of that number."""
    if as_boxes:
        aside = 1.0 if point % 2 else -1.0, 1.0 if point // 2 else -1.0
        return center_m[0] + BESIDE * aside[0] * semi_m[0], center_m[1] + BESIDE * aside[1] * semi_m[1]
    turn_rad = 2.0 * np.pi * point / POINTS
    x_m = center_m[0] + OUTSIDE * semi_m[0] * np.cos(turn_rad)
    return x_m, center_m[1] + OUTSIDE * semi_m[1] * np.sin(turn_rad)


@kernel
def _holds(x_m: float, y_m: float, center_m: Array, semi_m: Array, as_boxes: bool) -> bool:
    """Whether a place is within an ellipse, or a box."""
    x, y = abs(x_m - center_m[0]) / semi_m[0], abs(y_m - center_m[1]) / semi_m[1]
    return bool(max(x, y) < 1.0 if as_boxes else x * x + y * y < 1.0)


@kernel
def _count_overlapping(center_m: Array, semi_m: Array, counted: Mask, as_boxes: bool) -> bool:
    """Add to those (m, 2) that count (m,) others that hold their corners. Returns: if any was added.

    A corner within another is not used: the way past both leads by corners of the other.
    """
    added = False
    for k in np.flatnonzero(counted):
        for point in range(BOX_POINTS if as_boxes else POINTS):
            x_m, y_m = _corner_m(center_m[k], semi_m[k], point, as_boxes)
            for j in range(len(center_m)):
                if not counted[j] and _holds(x_m, y_m, center_m[j], semi_m[j], as_boxes):
                    counted[j] = added = True
    return added


@kernel
def _corners(center_m: Array, semi_m: Array, counted: Mask, within_m: float, as_boxes: bool) -> Array:
    """(k, 2) corners about those that count; none lies within another, or beyond the fence."""
    corners_m, count = np.empty((POINTS * counted.sum(), 2)), 0
    for k in np.flatnonzero(counted):
        for point in range(BOX_POINTS if as_boxes else POINTS):
            x_m, y_m = _corner_m(center_m[k], semi_m[k], point, as_boxes)
            inside = False
            for j in range(len(center_m)):
                inside |= _holds(x_m, y_m, center_m[j], semi_m[j], as_boxes)
            if np.hypot(x_m, y_m) <= within_m and not inside:
                corners_m[count, 0], corners_m[count, 1] = x_m, y_m
                count += 1
    return corners_m[:count]


@kernel
def _shortest(
    start_m: Array,
    goal_m: Array,
    corner_m: Array,
    center_m: Array,
    semi_m: Array,
    counted: Mask,
    as_boxes: bool,
) -> Array:
    """(k, 2) corners of the shortest way past those that count; none where there is no way."""
    left_m, after = _left_from(goal_m, corner_m, center_m, semi_m, counted, as_boxes)
    first, least_m = -1, np.inf
    for i in range(len(corner_m)):
        whole_m = left_m[i] + away_m(start_m, corner_m[i])
        if whole_m < least_m and _passes_all(start_m, corner_m[i], center_m, semi_m, counted, as_boxes):
            first, least_m = i, whole_m
    way_m, length = np.empty_like(corner_m), 0
    while first >= 0:
        way_m[length] = corner_m[first]
        length, first = length + 1, after[first]
    return way_m[:length]


@kernel
def _left_from(
    goal_m: Array, corner_m: Array, center_m: Array, semi_m: Array, counted: Mask, as_boxes: bool
) -> tuple[Array, Array]:
    """(k,) the shortest ways from corners to the goal, inf: none, and the next corner on each, -1: none.

    Dijkstra's algorithm, from the goal.
    """
    count = len(corner_m)
    left_m, after, done = np.full(count, np.inf), np.full(count, -1), np.zeros(count, np.bool_)
    for i in range(count):
        if _passes_all(goal_m, corner_m[i], center_m, semi_m, counted, as_boxes):
            left_m[i] = away_m(goal_m, corner_m[i])
    for _ in range(count):
        nearest = np.argmin(np.where(done, np.inf, left_m))
        done[nearest] = True
        for i in range(count):
            way_m = left_m[nearest] + away_m(corner_m[nearest], corner_m[i])
            if way_m < left_m[i] and _passes_all(
                corner_m[nearest], corner_m[i], center_m, semi_m, counted, as_boxes
            ):
                left_m[i], after[i] = way_m, nearest
    return left_m, after


@kernel
def away_m(one_m: Array, other_m: Array) -> float:
    """Distance of two places (2,)."""
    distance_m: float = np.hypot(one_m[0] - other_m[0], one_m[1] - other_m[1])
    return distance_m


@kernel
def _enters_s(
    at_m: tuple[float, float], moves_m_s: tuple[float, float], half_m: tuple[float, float]
) -> float:
    """When a point that moves relative to a box about the origin enters it; inf: never."""
    begin_s, end_s = 0.0, np.inf
    for axis in range(2):
        place_m, speed_m_s, half = at_m[axis], moves_m_s[axis], half_m[axis]
        if abs(speed_m_s) < TINY:
            if abs(place_m) >= half:
                return np.inf
            continue
        one_s, other_s = (-half - place_m) / speed_m_s, (half - place_m) / speed_m_s
        begin_s, end_s = max(begin_s, min(one_s, other_s)), min(end_s, max(one_s, other_s))
    return begin_s if begin_s < end_s else np.inf


@kernel
def free_s(start_m: Array, end_m: Array, speed_m_s: float, boxes: tuple[Array, Array, Array]) -> float:
    """How long the straight way from start to end, and then the end, stay free of all boxes; inf: for ever.

    Args:
        start_m: (2,) show frame, now. A box that it is in only counts farther in.
        end_m: (2,).
        speed_m_s: of the vehicle.
        boxes: (m, 2) places now, velocities, and half-lengths with all that the way keeps.
    """
    along_m, first_s = end_m - start_m, np.inf
    lasts_s = np.hypot(along_m[0], along_m[1]) / speed_m_s
    x_m_s, y_m_s = along_m[0] / max(lasts_s, TINY), along_m[1] / max(lasts_s, TINY)
    for k in range(len(boxes[0])):
        off_m, own_m_s, (half_x_m, half_y_m) = start_m - boxes[0][k], boxes[1][k], boxes[2][k]
        inside_x_m, inside_y_m = half_x_m - abs(off_m[0]), half_y_m - abs(off_m[1])
        if min(inside_x_m, inside_y_m) > 0.0:
            if inside_x_m < inside_y_m:
                half_x_m -= inside_x_m
            else:
                half_y_m -= inside_y_m
        goes_m_s = x_m_s - own_m_s[0], y_m_s - own_m_s[1]
        enters_s = _enters_s((off_m[0], off_m[1]), goes_m_s, (half_x_m, half_y_m))
        if enters_s >= lasts_s:
            then_m = off_m + along_m - lasts_s * own_m_s
            stands_m_s = -own_m_s[0], -own_m_s[1]
            enters_s = lasts_s + _enters_s((then_m[0], then_m[1]), stands_m_s, (half_x_m, half_y_m))
        first_s = min(first_s, enters_s)
    return first_s


@kernel
def way_out(
    start_m: Array, goal_m: Array, speed_m_s: float, boxes: tuple[Array, Array, Array], within_m: float
) -> tuple[Array, float]:
    """(2,) where a vehicle flies straight to, to stay clear of boxes that move, and to come to its goal.

    To the goal, if that way is free; else where it stays clear longest, and of such places to the one nearest
    to the goal. The arguments are those of `free_s` and `way_round`.

    Returns: also for how long it stays clear on that way and there, in s; `HORIZON_S` or more: it does.
    """
    best_m, best_s, left_m = goal_m.copy(), free_s(start_m, goal_m, speed_m_s, boxes), np.inf
    if best_s >= HORIZON_S:
        return best_m, best_s
    for reach_m in REACHES_M:
        for direction in range(DIRECTIONS):
            turn_rad = 2.0 * np.pi * direction / DIRECTIONS
            end_m = start_m + reach_m * np.array([np.cos(turn_rad), np.sin(turn_rad)])
            if np.hypot(end_m[0], end_m[1]) > within_m:
                continue
            clear_s, away = min(free_s(start_m, end_m, speed_m_s, boxes), HORIZON_S), away_m(end_m, goal_m)
            if clear_s > best_s or (clear_s == best_s and away < left_m):
                best_m, best_s, left_m = end_m, clear_s, away
    return best_m, best_s


@kernel
def is_pinched(
    place_m: Array, ahead_m: Array, speed_m_s: float, boxes: tuple[Array, Array, Array], within_m: float
) -> bool:
    """Whether a box comes over a vehicle at (2,), and no straight way leads out of where it would be then.

    That is at (2,), after `PUT_OFF_S`. The other arguments are those of `way_out`.
    """
    if free_s(place_m, place_m, speed_m_s, boxes) >= PINCHED_S:
        return False
    later = boxes[0] + PUT_OFF_S * boxes[1], boxes[1], boxes[2] + GAP_M
    for k in range(len(later[0])):
        off_m = np.abs(ahead_m - later[0][k])
        if off_m[0] < later[2][k, 0] and off_m[1] < later[2][k, 1]:
            return True
    for reach_m in REACHES_M:
        for direction in range(DIRECTIONS):
            turn_rad = 2.0 * np.pi * direction / DIRECTIONS
            end_m = ahead_m + reach_m * np.array([np.cos(turn_rad), np.sin(turn_rad)])
            inside = np.hypot(end_m[0], end_m[1]) <= within_m
            if inside and free_s(ahead_m, end_m, speed_m_s, later) >= HORIZON_S:
                return False
    return True


@kernel
def climb_over(
    start_m: Array,
    end_m: Array,
    speeds_m_s: tuple[float, float],
    boxes: tuple[Array, Array, Array],
    top_m: Array,
    height_m: float,
) -> float:
    """The height at which a vehicle that climbs on its way is over all boxes in time; inf: it cannot.

    Args:
        start_m: (2,) show frame, now.
        end_m: (2,) where it flies straight to, and stays.
        speeds_m_s: of the vehicle, sideways and up.
        boxes: as of `free_s`.
        top_m: (m,) heights that a vehicle must have over them.
        height_m: of the vehicle.
    """
    over_m = height_m
    for k in range(len(top_m)):
        alone = boxes[0][k : k + 1], boxes[1][k : k + 1], boxes[2][k : k + 1]
        enters_s = free_s(start_m, end_m, speeds_m_s[0], alone)
        if enters_s < HORIZON_S:
            if (top_m[k] - height_m) / speeds_m_s[1] > enters_s:
                return np.inf
            over_m = max(over_m, top_m[k])
    return over_m
