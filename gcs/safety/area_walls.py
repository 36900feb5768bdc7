"""Rows of the fence's areas: how fast vehicles may fly to their walls, and how they are led out. Pure."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from gcs.model.jit import kernel
from gcs.model.response import FleetResponse
from gcs.model.state import Array, Mask
from gcs.safety.area_exits import way_out
from gcs.safety.constraints import (
    DECELERATION,
    ESCAPE,
    LEAD,
    NO_ROW,
    REACTION,
    Braking,
    Constraints,
    allowed_speed_m_s,
    along_m_s,
    any_broken,
    nearest,
    shortened,
)
from gcs.safety.fenced_areas import (
    ACROSS_M,
    LED_SHARE,
    ON_EDGE_M,
    FencedArea,
    Shapes,
    edges_seen,
    inward,
    is_within,
    passable,
    shapes_of,
    surely_clear_m,
    without_tops,
)
from gcs.safety.neighbours import Rows

OPPOSITE: Final = -0.5
"""Walls whose normals agree less than this face each other."""

WALL, LEADS, HOLDS = range(3)
"""Kinds of walls: that are kept off, over which a vehicle is led, and from which it gets no farther."""


def area_constraints(
    position_m: Array,
    commanded: Mask,
    areas: Sequence[FencedArea],
    braking: Braking,
    *,
    velocity_m_s: Array,
    standoff_m: Array,
    response: FleetResponse | None = None,
    fastest_m_s: float = np.inf,
    descending: Mask | None = None,
    heights_m: tuple[float, float] = (-np.inf, np.inf),
    course_m_s: Array | None = None,
) -> Constraints:
    """Bound the speed towards every wall to the speed that can still be braked, as `fence_constraints` does.

    A vehicle on the wrong side is led to the nearest edge behind which all areas allow it, no faster than the
    other walls leave it; out of closed space over its top or below it where that is nearer, and flight is
    allowed there. Without such a way it is not led, but gets no farther from an area that it shall be in.

    One that descends to land is led sideways or down, never up, and no wall slows its descent: for it closed
    space has no top, because it comes through all of that. It would else be held in the air.

    Args:
        position_m: (n, 3), show frame.
        commanded: (n,).
        areas: any number.
        braking: how vehicles stop.
        velocity_m_s: (n, 3) measured, finite.
        standoff_m: (n,) how far from the edges each is kept.
        response: (n,) in what they differ from `braking`; None: in nothing.
        fastest_m_s: greatest speed of any vehicle: what it does not break is left out.
        descending: (n,) descend to land, also below the least height of the areas that they stay inside of;
            None: none does.
        heights_m: least and greatest height in which the fence allows flight.
        course_m_s: (n,) that of each, if it is less; None: it is not.
    """
    if not areas:
        return Constraints.none()
    shapes = shapes_of(passable(tuple(areas), heights_m))
    rows, which, normal, bound_m_s, leads = _area_rows(
        (np.array(position_m), np.array(velocity_m_s)),
        (np.array(commanded), np.zeros_like(commanded) if descending is None else np.array(descending)),
        (shapes, without_tops(shapes)),
        np.array(standoff_m),
        braking.of_each(len(position_m), response),
        np.full(len(position_m), fastest_m_s) if course_m_s is None else np.minimum(course_m_s, fastest_m_s),
        LED_SHARE * fastest_m_s,
    )
    reasons = np.array([f"area {number} of the fence" for number in range(1, len(areas) + 1)], dtype=object)
    if len(areas) > 1 and np.count_nonzero(leads):
        _leave_room(rows, leads, normal, bound_m_s)
    return Constraints(rows, np.full(len(rows), NO_ROW), normal, bound_m_s, reasons[which])


@kernel
def _leave_room(rows: Rows, leads: Mask, normal: Array, bound_m_s: Array) -> None:
    """Lower the bounds (k,) of walls that lead to what the others of each vehicle leave: none contradicts.

    Args:
        rows: (k,) those of a vehicle follow each other.
        leads: (k,).
        normal: (k, 3).
        bound_m_s: (k,) changed.
    """
    begin = 0
    while begin < len(rows):
        end = begin + 1
        while end < len(rows) and rows[end] == rows[begin]:
            end += 1
        walls = begin + np.flatnonzero(~leads[begin:end])
        for k in begin + np.flatnonzero(leads[begin:end]):
            bound_m_s[k] = _left_m_s(normal[k], bound_m_s[k], normal[walls], bound_m_s[walls])
        begin = end


@kernel
def _left_m_s(way: Array, led_m_s: float, normal: Array, bound_m_s: Array) -> float:
    """What walls (k,) leave of the speed with which a vehicle is led along `way` (3,): no row contradicts."""
    none, first = np.full(len(bound_m_s), NO_ROW), np.zeros(len(bound_m_s), np.intp)
    velocity_m_s = np.empty((1, 3))
    velocity_m_s[0] = led_m_s * way
    if not any_broken(velocity_m_s, first, none, normal, bound_m_s):
        return led_m_s
    left_m_s = nearest(velocity_m_s, first, none, normal, bound_m_s)
    left_m_s = shortened(left_m_s, first, none, normal, bound_m_s, np.zeros(1, np.bool_))
    return min(led_m_s, along_m_s(left_m_s, 0, way.reshape(1, 3), 0))


@kernel
def _area_rows(
    motion: tuple[Array, Array],
    roles: tuple[Mask, Mask],
    both: tuple[Shapes, Shapes],
    standoff_m: Array,
    each: Array,
    possible_m_s: Array,
    led_m_s: float,
) -> tuple[Rows, Rows, Array, Array, Mask]:
    """Rows (k,), areas (k,), normals (k, 3), bounds (k,) of all walls that could bind, and which lead (k,).

    `motion` are positions and velocities (n, 3), `roles` which are commanded, and which descend (n,), `both`
    the areas, and those for vehicles that descend. `each` (4, n) is that of `Braking.of_each`, `possible_m_s`
    (n,) greatest speeds, `led_m_s` that of being led back.
    """
    (position_m, velocity_m_s), (commanded, descending), (shapes, for_landing) = motion, roles, both
    edges, first, inside, heights_m = shapes.edge, shapes.first, shapes.inside, shapes.heights_m
    turn, box, clear_m, tops_m = shapes.turn, shapes.box, shapes.clear_m, for_landing.heights_m[:, 1]
    most, kept = 64, 0
    rows, which = np.empty(most, np.intp), np.empty(most, np.intp)
    normal, bound_m_s, leads = np.empty((most, 3)), np.empty(most), np.empty(most, np.bool_)
    walls = len(edges) + 2 * len(inside)
    off_m, wall, owner = np.empty((len(edges), 3)), np.empty((walls, 4)), np.empty(walls, np.intp)
    kind = np.empty(walls, np.intp)
    for i in range(len(position_m)):
        if not commanded[i]:
            continue
        x_m_s, y_m_s, z_m_s = velocity_m_s[i, 0], velocity_m_s[i, 1], velocity_m_s[i, 2]
        speed_m_s = np.sqrt(x_m_s * x_m_s + y_m_s * y_m_s + z_m_s * z_m_s)
        near_m = _within_m(each, i, possible_m_s[i], speed_m_s) + standoff_m[i]
        count, lands = 0, descending[i]
        for area in range(len(inside)):
            before, tall = count, heights_m[area, 0] == -np.inf and heights_m[area, 1] == np.inf
            sure_m = surely_clear_m(position_m[i, 0], position_m[i, 1], box, clear_m, area)
            if (tall and sure_m > near_m) if inside[area] else -sure_m > near_m:
                continue
            count = _walls_of(
                (position_m[i, 0], position_m[i, 1], -position_m[i, 2]),
                (edges, first[area], first[area + 1]),
                (inside[area], turn[area], lands),
                (heights_m[area, 0], tops_m[area] if lands else heights_m[area, 1]),
                near_m,
                off_m,
                wall,
                count,
            )
            owner[before:count], kind[before:count] = area, WALL
        if count == 0:
            continue
        if (wall[:count, 3] < 0.0).any():
            place = position_m[i, 0], position_m[i, 1], -position_m[i, 2]
            count = _led_out(place, for_landing if lands else shapes, wall, owner, kind, count)
        for k in range(count):
            closing_m_s = max(-(wall[k, 0] * x_m_s + wall[k, 1] * y_m_s + wall[k, 2] * z_m_s), 0.0)
            own_m = 0.0 if _is_squeezed(wall, k, count, standoff_m[i]) else standoff_m[i]
            gap_m = wall[k, 3] - own_m - each[LEAD, i] * closing_m_s
            allowed_m_s = allowed_speed_m_s(gap_m, each[REACTION, i], each[DECELERATION, i], each[ESCAPE, i])
            if not allowed_m_s <= possible_m_s[i]:
                continue
            if kept == most:
                rows, which = np.append(rows, rows), np.append(which, which)
                normal, bound_m_s = np.concatenate((normal, normal)), np.append(bound_m_s, bound_m_s)
                leads = np.append(leads, leads)
                most *= 2
            rows[kept], which[kept], leads[kept] = i, owner[k], kind[k] == LEADS
            bound_m_s[kept] = min(-allowed_m_s, 0.0 if kind[k] == HOLDS else led_m_s)
            normal[kept, 0], normal[kept, 1], normal[kept, 2] = wall[k, 0], wall[k, 1], wall[k, 2]
            kept += 1
    return rows[:kept], which[:kept], normal[:kept], bound_m_s[:kept], leads[:kept]


@kernel
def _led_out(
    place: tuple[float, float, float], shapes: Shapes, wall: Array, owner: Rows, kind: Rows, count: int
) -> int:
    """Put the one way out of all areas in place of the walls over which each alone leads a vehicle.

    Args:
        place: x, y and height.
        shapes: of all areas.
        wall: (w, 4) normals and gaps; changed.
        owner: (w,) areas; changed.
        kind: (w,) see `WALL`; changed.
        count: number of walls.

    Returns: the new number.
    """
    wrong = _mark(place, shapes, wall, owner, kind, count)
    if len(wrong) == 1 or not wrong.any():
        return count
    way, kept, led = np.empty(2), 0, False
    away_m = way_out(place, shapes, wrong, way)
    for k in range(count):
        is_way = kind[k] == LEADS and wrong[owner[k]]
        if is_way and (led if np.isfinite(away_m) else not shapes.inside[owner[k]]):
            continue
        owner[kept], kind[kept], wall[kept] = owner[k], kind[k], wall[k]
        if is_way and np.isfinite(away_m):
            wall[kept, 0], wall[kept, 1], wall[kept, 2], wall[kept, 3] = way[0], way[1], 0.0, -away_m
            led = True
        elif is_way:
            kind[kept] = HOLDS
        kept += 1
    return kept


@kernel
def _mark(
    place: tuple[float, float, float], shapes: Shapes, wall: Array, owner: Rows, kind: Rows, count: int
) -> Mask:
    """Set which walls lead; arguments as of `_led_out`. Returns: (a,) which areas are to be left sideways.

    Ceiling and floor of areas that vehicles stay inside of lead nowhere else.
    """
    wrong = np.zeros(len(shapes.inside), np.bool_)
    for k in range(count):
        upright = wall[k, 2] == 0.0
        if not wall[k, 3] < 0.0 or (shapes.inside[owner[k]] and not upright):
            continue
        kind[k] = LEADS
        wrong[owner[k]] = upright or not _is_open(place, shapes, owner[k], wall[k, 2])
    return wrong


@kernel
def _is_open(place: tuple[float, float, float], shapes: Shapes, out_of: int, down: float) -> bool:
    """Whether a vehicle that leaves closed space upright, as `down` says, comes into no other and no lid."""
    x_m, y_m, _ = place
    least_m, most_m = shapes.heights_m[out_of, 0], shapes.heights_m[out_of, 1]
    height_m = least_m - ACROSS_M if down > 0.0 else most_m + ACROSS_M
    for area in range(len(shapes.inside)):
        if area == out_of:
            continue
        low_m, high_m = shapes.heights_m[area, 0], shapes.heights_m[area, 1]
        if shapes.inside[area]:
            if not low_m <= height_m <= high_m:
                return False
        elif low_m <= height_m <= high_m and is_within(x_m, y_m, shapes, area):
            return False
    return True


@kernel
def _is_squeezed(wall: Array, k: int, count: int, standoff_m: float) -> bool:
    """Whether wall k of (w, 4) and one opposite leave no room to keep off both: it is flown between."""
    if not 0.0 <= wall[k, 3] < 2.0 * standoff_m:
        return False
    for other in range(count):
        across = wall[k, 0] * wall[other, 0] + wall[k, 1] * wall[other, 1] + wall[k, 2] * wall[other, 2]
        if across < OPPOSITE and 0.0 <= wall[other, 3] < 2.0 * standoff_m - wall[k, 3]:
            return True
    return False


@kernel
def _within_m(each: Array, i: int, possible_m_s: float, closing_m_s: float) -> float:
    """The gap beyond which no speed that is possible breaks a wall; see `allowed_speed_m_s`."""
    stop_m = possible_m_s * each[REACTION, i] + possible_m_s**2 / (2.0 * each[DECELERATION, i])
    gap_m: float = stop_m + each[LEAD, i] * closing_m_s
    return gap_m


@kernel
def _walls_of(
    place: tuple[float, float, float],
    ring: tuple[Array, int, int],
    kind: tuple[bool, float, bool],
    heights_m: tuple[float, float],
    near_m: float,
    off_m: Array,
    wall: Array,
    count: int,
) -> int:
    """Write the walls of one area near a place into `wall` (w, 4): normal and gap. Returns the new number.

    Args:
        place: x, y and height.
        ring: edges (m, 5), the first and the last + 1 of this area.
        kind: stays inside; the sense of its turn; descends to land.
        heights_m: of the area.
        near_m: walls farther away are left out.
        off_m: (m, 3) as of `edges_seen`.
        wall: changed.
        count: of the walls before.
    """
    (x_m, y_m, height_m), (edges, begin, end), (inside, turn, descends) = place, ring, kind
    is_inside, nearest = edges_seen(x_m, y_m, edges, begin, end, off_m)
    over_m, under_m = height_m - heights_m[1], heights_m[0] - height_m
    apart_m = max(over_m, under_m)
    if inside:
        if -over_m < near_m:
            wall[count, 0], wall[count, 1], wall[count, 2], wall[count, 3] = 0.0, 0.0, 1.0, -over_m
            count += 1
        if -under_m < near_m and not descends:
            wall[count, 0], wall[count, 1], wall[count, 2], wall[count, 3] = 0.0, 0.0, -1.0, -under_m
            count += 1
        apart_m = 0.0
    elif is_inside and apart_m > 0.0:
        wall[count, 0], wall[count, 1] = 0.0, 0.0
        wall[count, 2], wall[count, 3] = (-1.0 if over_m > 0.0 else 1.0), apart_m
        count += 1
    elif is_inside and -apart_m < np.sqrt(off_m[nearest, 2]):  # out of closed space up or down
        wall[count, 0], wall[count, 1] = 0.0, 0.0
        wall[count, 2], wall[count, 3] = (-1.0 if over_m >= under_m else 1.0), apart_m
        return count + 1
    rise_m = max(apart_m, 0.0)
    allowed = is_inside == inside or rise_m > 0.0
    side = 1.0 if allowed else -1.0
    for edge in range(begin, end):
        if not allowed and edge != nearest:
            continue
        square_m2 = off_m[edge, 2] + rise_m * rise_m
        if allowed and square_m2 > near_m * near_m:
            continue
        away_m = np.sqrt(square_m2)
        if away_m > ON_EDGE_M:
            wall[count, 0], wall[count, 1] = side * off_m[edge, 0] / away_m, side * off_m[edge, 1] / away_m
            wall[count, 2] = (-rise_m if over_m > 0.0 else rise_m) / away_m
        else:
            across_x, across_y = inward(edges, edge, turn if inside else -turn)
            wall[count, 0], wall[count, 1], wall[count, 2] = across_x, across_y, 0.0
        wall[count, 3] = side * away_m
        count += 1
    return count
