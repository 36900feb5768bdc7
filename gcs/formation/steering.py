"""Flying around obstacles along their tangents (article, sections 4.2 and 4.3, corrected). Compiled.

A vehicle that would meet an ellipse takes a tangent instead: of all tangents of all ellipses within reach the
one that meets no other ellipse and changes the desired velocity least, on the side already chosen if there is
one. Where ellipses overlap, the tangents between them are blocked by the other one, so only those of the
common outline remain, and no vehicle is led into the notch.

An ellipse may move: the velocity relative to it counts, so a tangent leads past where it will be.
The formation's centre does the same farther ahead: `gcs.formation.orbit`.
"""

from collections.abc import Mapping
from math import inf
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.formation.obstacles import AvoidanceSettings, Ellipse, Outlines
from gcs.model.jit import kernel
from gcs.model.state import Array, Mask

Index: TypeAlias = NDArray[np.intp]

LEFT, RIGHT = -1.0, 1.0
"""Sides on which to pass, seen in the direction of flight; y points right."""

WRONG_SIDE_M_S = 1e3
"""Cost of passing on the side not chosen: more than any change of velocity."""

BLOCKED_M_S = 1e6
"""Cost of meeting another obstacle: more than the wrong side."""

ENDS_M = 1.0
"""A contact counts in full when it is so far before the slot where a vehicle's way ends."""

STANDING_M_S = 1e-6
"""A vehicle slower than this, relative to an obstacle, does not meet it."""


@kernel
def tangent(x_m: float, y_m: float, semi_x_m: float, semi_y_m: float, side: float) -> tuple[float, float]:
    """Unit vector from (x, y), relative to the ellipse's centre, along its left or right tangent.

    The article's arctan points backwards and loses the quadrant; this points ahead, to the tangent point,
    and on or inside the ellipse along its contour. Left and right as seen looking towards the ellipse.
    Source: article, section 4.1; the system solved for the unit circle.
    """
    qx, qy = x_m / semi_x_m, y_m / semi_y_m
    square = qx * qx + qy * qy
    if square > 1.0:
        across = -side * np.sqrt(square - 1.0) / square
        along_x = (qx / square - across * qy - qx) * semi_x_m
        along_y = (qy / square + across * qx - qy) * semi_y_m
        length = np.hypot(along_x, along_y)
        if length > 1e-6:
            return along_x / length, along_y / length
    nx, ny = qx / semi_x_m, qy / semi_y_m
    length = np.hypot(nx, ny)
    if length < 1e-9:
        nx, ny, length = 1.0, 0.0, 1.0
    return side * ny / length, -side * nx / length


@kernel
def contact_m(
    x_m: float, y_m: float, semi_x_m: float, semi_y_m: float, vx_m_s: float, vy_m_s: float
) -> float:
    """Distance from (x, y), relative to the ellipse's centre, to the contact with that relative velocity.

    Infinity without contact; 0 on or inside the ellipse, unless on the way out.
    """
    speed_m_s = np.hypot(vx_m_s, vy_m_s)
    if speed_m_s < STANDING_M_S:
        return inf
    qx, qy = x_m / semi_x_m, y_m / semi_y_m
    hx, hy = vx_m_s / speed_m_s / semi_x_m, vy_m_s / speed_m_s / semi_y_m
    b = qx * hx + qy * hy
    if b >= 0.0:
        return inf
    c = qx * qx + qy * qy - 1.0
    if c <= 0.0:
        return 0.0
    a = hx * hx + hy * hy
    root = b * b - a * c
    return inf if root <= 0.0 else (-b - np.sqrt(root)) / a


@kernel
def contacts_m(place: Array, velocity: Array, center_m: Array, semi_m: Array, moving_m_s: Array) -> Array:
    """(m,) `contact_m` from one position with one velocity, (2,) or more each, for every ellipse."""
    ahead_m = np.empty(len(center_m))
    for j in range(len(center_m)):
        ahead_m[j] = contact_m(
            place[0] - center_m[j, 0],
            place[1] - center_m[j, 1],
            semi_m[j, 0],
            semi_m[j, 1],
            velocity[0] - moving_m_s[j, 0],
            velocity[1] - moving_m_s[j, 1],
        )
    return ahead_m


@kernel
def along_tangent(
    desired: Array, tangent_x: float, tangent_y: float, moving: Array, keep_m_s: float
) -> tuple[float, float]:
    """The velocity whose part relative to an obstacle `moving` (2,) points along the tangent.

    As fast over the ground as the desired velocity (2,) along the tangent, at least `keep_m_s`, and at least
    the desired speed relative to the obstacle.
    """
    over_ground = max(desired[0] * tangent_x + desired[1] * tangent_y, keep_m_s)
    drift = moving[0] * tangent_x + moving[1] * tangent_y
    square = drift * drift + over_ground * over_ground - moving[0] * moving[0] - moving[1] * moving[1]
    relative = np.sqrt(max(square, 0.0)) - drift
    nearest = (desired[0] - moving[0]) * tangent_x + (desired[1] - moving[1]) * tangent_y
    relative = max(relative, nearest, 0.0)
    return moving[0] + relative * tangent_x, moving[1] + relative * tangent_y


@kernel
def first_contact(
    place: Array,
    velocity: Array,
    reach_m: Array,
    center_m: Array,
    semi_m: Array,
    moving_m_s: Array,
    left_out: int,
) -> tuple[float, int]:
    """Relative distance to the first ellipse met within its reach, and its index; infinity, -1 for none."""
    least_m, first = inf, -1
    for j in range(len(center_m)):
        if j != left_out:
            ahead_m = contact_m(
                place[0] - center_m[j, 0],
                place[1] - center_m[j, 1],
                semi_m[j, 0],
                semi_m[j, 1],
                velocity[0] - moving_m_s[j, 0],
                velocity[1] - moving_m_s[j, 1],
            )
            if ahead_m < reach_m[j] and ahead_m < least_m:
                least_m, first = ahead_m, j
    return least_m, first


@kernel
def turns(before: Array, after: Array, moving: Array) -> float:
    """Positive if the second velocity, relative to an obstacle, is to the right of the first; (2,) each."""
    bx, by = before[0] - moving[0], before[1] - moving[1]
    cross: float = bx * (after[1] - moving[1]) - by * (after[0] - moving[0])
    return cross


@kernel
def breaks_side(place: Array, velocity: Array, center_m: Array, moving_m_s: Array, side: Array) -> bool:
    """Whether that velocity (2,) passes an obstacle ahead on the side not chosen for it."""
    for j in range(len(center_m)):
        if side[j] != 0.0:
            vx, vy = velocity[0] - moving_m_s[j, 0], velocity[1] - moving_m_s[j, 1]
            dx, dy = center_m[j, 0] - place[0], center_m[j, 1] - place[1]
            if vx * dx + vy * dy > 0.0 and (vx * dy - vy * dx) * side[j] > 0.0:
                return True
    return False


@kernel
def best_tangent(
    place: Array,
    desired: Array,
    keep_m_s: float,
    reach_m: Array,
    center_m: Array,
    semi_m: Array,
    moving_m_s: Array,
    side: Array,
    first: int,
) -> Array:
    """The velocity (2,) that replaces the desired one (2,), which meets ellipse `first`.

    Of all tangents within reach, those that meet no other ellipse come first, then those that keep the chosen
    sides, then the one that changes the velocity least. Other arguments as in `steer`, for one vehicle.
    """
    least, best, velocity = inf, desired.copy(), np.empty(2)
    for j in range(len(center_m)):
        x_m, y_m = place[0] - center_m[j, 0], place[1] - center_m[j, 1]
        if np.hypot(x_m, y_m) - max(semi_m[j, 0], semi_m[j, 1]) > reach_m[j]:
            continue
        for way in (LEFT, RIGHT):
            tx, ty = tangent(x_m, y_m, semi_m[j, 0], semi_m[j, 1], way)
            velocity[0], velocity[1] = along_tangent(desired, tx, ty, moving_m_s[j], keep_m_s)
            cost = np.hypot(velocity[0] - desired[0], velocity[1] - desired[1])
            cost += WRONG_SIDE_M_S * (turns(desired, velocity, moving_m_s[first]) * side[first] < 0.0)
            cost += WRONG_SIDE_M_S * breaks_side(place, velocity, center_m, moving_m_s, side)
            if cost < least:
                ahead_m, other = first_contact(place, velocity, reach_m, center_m, semi_m, moving_m_s, j)
                cost += BLOCKED_M_S / (1.0 + ahead_m) if other >= 0 else 0.0
            if cost < least:
                least = cost
                best[:] = velocity
    return best


@kernel
def steer(
    position_m: Array,
    desired_m_s: Array,
    keep_m_s: Array,
    concerned: Mask,
    reach_m: Array,
    center_m: Array,
    semi_m: Array,
    moving_m_s: Array,
    side: Array,
) -> tuple[Array, Array, Index]:
    """The best tangent for every vehicle that would meet an ellipse.

    A side once chosen for the ellipse met first is kept by turning that way only, even backwards; for those
    behind it, by not passing them on the other side.

    Args:
        position_m: (n, 2).
        desired_m_s: (n, 2).
        keep_m_s: (n,) speed to keep along a tangent.
        concerned: (n, m) True where a vehicle has to avoid an ellipse.
        reach_m: (n, m) distance from which a contact counts.
        center_m: (m, 2) of the ellipses.
        semi_m: (m, 2).
        moving_m_s: (m, 2).
        side: (m,) LEFT, RIGHT, or 0 for the one that costs less.

    Returns: (n, 2) velocities; (n,) distances at which the desired velocities meet the first ellipse, inf
        without contact (the velocity is then unchanged); and (n,) the index of that ellipse, -1 for none.
    """
    turned_m_s = desired_m_s.copy()
    met_m, met = np.full(len(position_m), inf), np.full(len(position_m), -1)
    for i in range(len(position_m)):
        place, desired, its = position_m[i], desired_m_s[i], concerned[i].nonzero()[0]
        ellipses = reach_m[i][its], center_m[its], semi_m[its], moving_m_s[its]
        met_m[i], first = first_contact(place, desired, *ellipses, -1)
        if first < 0:
            continue
        met[i] = its[first]
        turned_m_s[i] = best_tangent(place, desired, keep_m_s[i], *ellipses, side[its], first)
    return turned_m_s, met_m, met


@kernel
def push(
    position_m: Array,
    velocity_m_s: Array,
    concerned: Mask,
    center_m: Array,
    semi_m: Array,
    moving_m_s: Array,
    near_m: float,
    rate_per_s: float,
    lead_out_m_s: float,
) -> Array:
    """Velocities (n, 2) with a push away from near ellipses; inside one, nothing leads farther in.

    Arguments as in `steer`; the push grows from `near_m` on by `rate_per_s`, up to `lead_out_m_s`.
    """
    pushed_m_s = velocity_m_s.copy()
    for i in range(len(position_m)):
        for j in range(len(center_m)):
            if not concerned[i, j]:
                continue
            qx = (position_m[i, 0] - center_m[j, 0]) / semi_m[j, 0]
            qy = (position_m[i, 1] - center_m[j, 1]) / semi_m[j, 1]
            radius = np.hypot(qx, qy)
            nx, ny = qx / semi_m[j, 0], qy / semi_m[j, 1]
            slope = np.hypot(nx, ny)
            if radius < 1e-9:
                nx, ny, slope = 1.0, 0.0, 1.0
            away_m = (radius - 1.0) * radius / slope
            if away_m >= near_m:
                continue
            nx, ny = nx / slope, ny / slope
            faster_m_s = min(rate_per_s * (near_m - away_m), lead_out_m_s)
            if away_m <= 0.0:
                vx, vy = pushed_m_s[i, 0] - moving_m_s[j, 0], pushed_m_s[i, 1] - moving_m_s[j, 1]
                faster_m_s -= min(vx * nx + vy * ny, 0.0)
            pushed_m_s[i, 0] += faster_m_s * nx
            pushed_m_s[i, 1] += faster_m_s * ny
    return pushed_m_s


def level(vectors: Array) -> Array:
    """(n, 2) horizontal parts of (n, 3), in the memory order that the kernels need."""
    return np.array(vectors[:, :2], order="C")


def steer_past(
    outlines: Outlines,
    sides: Mapping[str, float],
    position_m: Array,
    desired_m_s: Array,
    keep_m_s: Array,
    concerned: Mask,
    reach_m: Array,
) -> tuple[Array, Array, Index]:
    """`steer` past these outlines, with the sides (LEFT or RIGHT by name) that have been chosen."""
    return steer(
        position_m,
        desired_m_s,
        np.array(keep_m_s, dtype=np.float64),
        concerned,
        reach_m,
        outlines.center_m,
        outlines.semi_m,
        outlines.velocity_m_s,
        np.array([sides.get(name, 0.0) for name in outlines.names]),
    )


STEERED_MOST = 32
"""Ellipses that one vehicle steers past at a time, the nearest ones: the work grows with their square. There
are as many as lost vehicles, and half of a large fleet may be lost at once.
"""


@kernel
def _nearest(place_m: Array, center_m: Array, semi_m: Array) -> Mask:
    """(n, m) the STEERED_MOST of m ellipses that are nearest to each place (n, 2)."""
    n, m = len(place_m), len(center_m)
    chosen = np.ones((n, m), np.bool_)
    if m <= STEERED_MOST:
        return chosen
    off_m, least_m = np.empty(m), np.empty(STEERED_MOST)
    for i in range(n):
        least_m[:] = inf  # the smallest, in order
        for j in range(m):
            x_m, y_m = place_m[i, 0] - center_m[j, 0], place_m[i, 1] - center_m[j, 1]
            off_m[j] = np.sqrt(x_m * x_m + y_m * y_m) - max(semi_m[j, 0], semi_m[j, 1])
            if off_m[j] < least_m[-1]:
                k = STEERED_MOST - 1
                while k > 0 and least_m[k - 1] > off_m[j]:
                    least_m[k] = least_m[k - 1]
                    k -= 1
                least_m[k] = off_m[j]
        chosen[i] = off_m <= least_m[-1]
    return chosen


def avoid_all(
    position_m: Array,
    velocity_m_s: Array,
    ellipses: Mapping[str, Ellipse],
    sides: Mapping[str, float],
    sliding_m_s: Array,
    settings: AvoidanceSettings,
    until_m: Array | None = None,
) -> Array:
    """Turn velocities that would meet an ellipse along a tangent, and push vehicles that are near one.

    Args:
        position_m: (n, 3), show frame, z down.
        velocity_m_s: (n, 3), desired by the law.
        ellipses: the obstacles, margin and headroom included.
        sides: LEFT or RIGHT where the formation has chosen; others are passed where it costs less.
        sliding_m_s: (n,) speed to keep along the tangent even when the desired velocity points straight at
            the obstacle: that of the formation, so that no vehicle stays behind; 0 lets a vehicle wait there.
        settings: distances and rates.
        until_m: (n,) distances of the slots, beyond which the ellipses beside slots are not met; None:
            they are.

    Returns: (n, 3) in m/s; the vertical component is unchanged, and so is every row well above the obstacles.

    Source: article, sections 4.2 and 4.3.
    """
    outlines = Outlines.of(ellipses)
    near = outlines.nearest_m(position_m) < max(settings.lookahead_m, settings.near_m)
    if not near.any():
        return velocity_m_s
    outlines = outlines.only(near)
    place_m, desired_m_s = level(position_m), level(velocity_m_s)
    concerned = (-position_m[:, 2:] < outlines.top_height_m) & _nearest(
        place_m, outlines.center_m, outlines.semi_m
    )
    reach_m = np.full(concerned.shape, settings.lookahead_m)
    if until_m is not None:
        beside = outlines.beside_slots
        reach_m[:, beside] = np.minimum(settings.lookahead_m, until_m[:, None])
    turned_m_s, met_m, met = steer_past(
        outlines, sides, place_m, desired_m_s, sliding_m_s, concerned, reach_m
    )
    blend_m = max(settings.lookahead_m - settings.near_m, 1e-9)
    weight = np.clip((settings.lookahead_m - met_m) / blend_m, 0.0, 1.0)
    if until_m is not None:
        ends = (met >= 0) & outlines.beside_slots[met]
        weight[ends] *= np.clip((until_m[ends] - met_m[ends]) / ENDS_M, 0.0, 1.0)
    result = velocity_m_s.copy()
    result[:, :2] = push(
        place_m,
        desired_m_s + weight[:, None] * (turned_m_s - desired_m_s),
        concerned & ~outlines.beside_slots,
        outlines.center_m,
        outlines.semi_m,
        outlines.velocity_m_s,
        settings.near_m,
        settings.push_rate_per_s,
        settings.lead_out_m_s,
    )
    return result
