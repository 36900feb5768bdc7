"""Velocities with which vehicles would fall within the controlled ground, if their motors stopped now. Pure.

The disc of `gcs.safety.impact` holds all places where one may fall. Ahead of the vehicle the disc's middle
moves with its velocity; above, the disc grows with its height. So the wall is steep, not upright: a vehicle
near the edge is led inward and down.
"""

from dataclasses import dataclass

import numpy as np

from gcs.model.jit import kernel
from gcs.model.response import FleetResponse
from gcs.model.state import TINY, Array, Mask
from gcs.safety.constraints import DECELERATION, ESCAPE, LEAD, NO_ROW, REACTION, Braking, Constraints
from gcs.safety.fenced_areas import (
    LED_SHARE,
    ON_EDGE_M,
    FencedArea,
    Shapes,
    beyond_m,
    edges_seen,
    inward,
    shapes_of,
    surely_clear_m,
)
from gcs.safety.impact import (
    AHEAD,
    GROWTH,
    GROWTH_MAX,
    SPREAD,
    Impacts,
    ImpactSettings,
    Reach,
    believed_m_s,
    hover_reach_m,
    impacts,
    looked_up,
    reach_of,
)
from gcs.safety.neighbours import Rows

REASON = "where it would fall"

SLOWEST_M_S = 1.0
"""How far ahead a slower vehicle falls is taken from this speed: in proportion it is the same."""


@dataclass(frozen=True, slots=True, eq=False)
class GroundMargins:
    """How far the discs of impacts of n vehicles are inside the edge of the controlled ground."""

    margin_m: Array  # (n,) negative: a part of the disc is outside; NaN: not known
    impacts: Impacts


def ground_margins(
    position_m: Array, velocity_m_s: Array, ground: FencedArea, settings: ImpactSettings
) -> GroundMargins:
    """Judge (n, 3) positions and velocities, show frame, NaN where not known."""
    falls = impacts(position_m, velocity_m_s, settings)
    located = np.isfinite(falls.spread_m)
    margin_m = -beyond_m((ground,), falls.place_m) - falls.spread_m
    return GroundMargins(np.where(located, margin_m, np.nan), falls)


def falls_within(place_m: Array, ground: FencedArea, settings: ImpactSettings) -> Mask:
    """(n,) At which places (n, 3) a vehicle at rest would fall inside the hard line."""
    kept_m = hover_reach_m(-place_m[:, 2], settings) + settings.hard_m
    return np.asarray(-beyond_m((ground,), place_m[:, :2]) >= kept_m)


def ground_for_sites(
    ground: FencedArea | None, settings: ImpactSettings, highest_m: float
) -> tuple[FencedArea, float] | None:
    """The ground, and how far inside its edge vehicles land; None: no ground.

    They come from heights of up to `highest_m`, and fly to above their sites at these.
    """
    if ground is None or not np.isfinite(highest_m):
        return None
    return ground, float(hover_reach_m(np.array([highest_m]), settings)[0]) + settings.soft_m


def kept_in_m(height_m: Array, settings: ImpactSettings, speed_m_s: float = 0.0) -> Array:
    """(n,) how far from the edge vehicles at heights (n,) keep that fly along it with that speed."""
    place_m, velocity_m_s = np.zeros((len(height_m), 3)), np.zeros((len(height_m), 3))
    place_m[:, 2], velocity_m_s[:, 0] = -height_m, speed_m_s
    return impacts(place_m, velocity_m_s, settings).spread_m + settings.soft_m


def ground_constraints(
    position_m: Array,
    commanded: Mask,
    ground: FencedArea,
    settings: ImpactSettings,
    braking: Braking,
    *,
    velocity_m_s: Array,
    standoff_m: Array,
    response: FleetResponse | None = None,
    fastest_m_s: float = np.inf,
    course_m_s: Array | None = None,
) -> Constraints:
    """Bound the speed towards the edge so that no impact comes nearer to it than `settings.soft_m`.

    Args:
        position_m: (n, 3), show frame.
        commanded: (n,).
        ground: stays inside.
        settings: vehicle, wind, lines.
        braking: how vehicles stop.
        velocity_m_s: (n, 3) measured, finite.
        standoff_m: (n,) for the uncertainty of each position.
        response: (n,) in what they differ from `braking`; None: in nothing.
        fastest_m_s: greatest speed of any vehicle: what it does not break is left out.
        course_m_s: (n,) that of each, if it is less; None: it is not.
    """
    shapes = shapes_of((ground,))
    rows, normal, bound_m_s = _ground_rows(
        (np.array(position_m), np.array(velocity_m_s)),
        np.array(commanded),
        shapes,
        reach_of(settings.falling, settings.wind_max_m_s),
        (settings.reaction_s, settings.ground_m, settings.soft_m),
        np.array(standoff_m),
        braking.of_each(len(position_m), response),
        np.full(len(position_m), fastest_m_s) if course_m_s is None else np.minimum(course_m_s, fastest_m_s),
        LED_SHARE * fastest_m_s,
    )
    reasons = np.repeat(np.array([REASON], dtype=object), len(rows))
    return Constraints(rows, np.full(len(rows), NO_ROW), normal, bound_m_s, reasons)


@kernel
def _ground_rows(
    motion: tuple[Array, Array],
    commanded: Mask,
    shapes: Shapes,
    reach: Reach,
    about: tuple[float, float, float],
    standoff_m: Array,
    each: Array,
    possible_m_s: Array,
    led_m_s: float,
) -> tuple[Rows, Array, Array]:
    """Rows (k,), normals (k, 3), bounds (k,) of all that could bind.

    `shapes` is the ground's, `about` reaction, ground and soft line, `each` (4, n) that of `Braking.of_each`,
    `possible_m_s` (n,) greatest speeds, `led_m_s` that of being led back.
    """
    (position_m, velocity_m_s), (reaction_s, ground_m, soft_m) = motion, about
    edges, turn = shapes.edge, shapes.turn[0]
    most, kept, own = 64, 0, np.empty(3)
    rows, normal, bound_m_s = np.empty(most, np.intp), np.empty((most, 3)), np.empty(most)
    off_m = np.empty((len(edges), 3))
    for i in range(len(position_m)):
        if not commanded[i]:
            continue
        x_m_s, y_m_s = believed_m_s(velocity_m_s[i, 0]), believed_m_s(velocity_m_s[i, 1])
        down_m_s = believed_m_s(velocity_m_s[i, 2])
        level_m_s = np.sqrt(x_m_s * x_m_s + y_m_s * y_m_s)
        height_m = -position_m[i, 2] - ground_m + max(-down_m_s, 0.0) * reaction_s
        ahead_m_s = max(level_m_s, SLOWEST_M_S)
        looked_up(reach, height_m, ahead_m_s, down_m_s, 3, own)
        kept_m, falls_s = own[SPREAD] + soft_m + standoff_m[i], reaction_s + own[AHEAD] / ahead_m_s
        slope = min(max(own[GROWTH], 0.0), GROWTH_MAX)  # beyond the table it goes on straight
        length = np.sqrt(1.0 + slope * slope)
        near_m = _needed_m(possible_m_s[i], each[REACTION, i], each[DECELERATION, i], falls_s)
        near_m += each[LEAD, i] * (level_m_s + max(-down_m_s, 0.0))
        near_m = length * near_m + kept_m
        if surely_clear_m(position_m[i, 0], position_m[i, 1], shapes.box, shapes.clear_m, 0) > near_m:
            continue
        is_inside, nearest = edges_seen(position_m[i, 0], position_m[i, 1], edges, 0, len(edges), off_m)
        side = 1.0 if is_inside else -1.0
        for edge in range(len(edges)):
            if (not is_inside and edge != nearest) or (is_inside and off_m[edge, 2] > near_m * near_m):
                continue
            away_m = np.sqrt(off_m[edge, 2])
            if away_m > ON_EDGE_M:
                x, y = side * off_m[edge, 0] / away_m, side * off_m[edge, 1] / away_m
            else:
                x, y = inward(edges, edge, turn)
            x, y, z = x / length, y / length, slope / length
            closing_m_s = max(-(x * x_m_s + y * y_m_s + z * down_m_s), 0.0)
            gap_m = (side * away_m - kept_m) / length - each[LEAD, i] * closing_m_s
            allowed_m_s = falling_speed_m_s(
                gap_m, each[REACTION, i], each[DECELERATION, i], each[ESCAPE, i], falls_s
            )
            if not allowed_m_s <= possible_m_s[i]:
                continue
            if kept == most:
                rows, normal = np.append(rows, rows), np.concatenate((normal, normal))
                bound_m_s, most = np.append(bound_m_s, bound_m_s), 2 * most
            rows[kept], bound_m_s[kept] = i, min(-allowed_m_s, led_m_s)
            normal[kept, 0], normal[kept, 1], normal[kept, 2] = x, y, z
            kept += 1
    return rows[:kept], normal[:kept], bound_m_s[:kept]


@kernel
def _needed_m(speed_m_s: float, reaction_s: float, deceleration_m_s2: float, falls_s: float) -> float:
    """The gap that a speed needs so that no impact passes its end; see `falling_speed_m_s`."""
    if speed_m_s <= deceleration_m_s2 * falls_s:
        return speed_m_s * (reaction_s + falls_s)
    stop_m: float = speed_m_s * speed_m_s / (2.0 * deceleration_m_s2)
    return speed_m_s * reaction_s + stop_m + 0.5 * deceleration_m_s2 * falls_s * falls_s


@kernel
def falling_speed_m_s(
    gap_m: float, reaction_s: float, deceleration_m_s2: float, escape_rate_per_s: float, falls_s: float
) -> float:
    """Fastest approach with which neither vehicle nor impact passes the end of a gap, whenever motors stop.

    A vehicle of speed v falls v `falls_s` ahead. While it brakes, from v after its reaction, its impact is
    farthest when v = a `falls_s`: it is then ahead by v^2 / (2 a) + a `falls_s`^2 / 2. Slower, it is so now.
    """
    if gap_m < 0.0:
        return escape_rate_per_s * gap_m
    slow_m_s = gap_m / max(reaction_s + falls_s, TINY)
    if slow_m_s <= deceleration_m_s2 * falls_s:
        return slow_m_s
    beyond_m2 = 2.0 * (gap_m - 0.5 * deceleration_m_s2 * falls_s * falls_s) / deceleration_m_s2
    stop_s: float = np.sqrt(reaction_s * reaction_s + beyond_m2)
    return deceleration_m_s2 * (stop_s - reaction_s)
