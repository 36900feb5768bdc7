"""The path of the formation's centre past obstacles: along tangents, for the whole sphere.

It looks farther ahead than the vehicles do, and at ellipses grown by the sphere, so that no vehicle has to
leave the shape. The side on which it passes counts for all vehicles.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

import numpy as np

from gcs.formation.obstacles import AvoidanceSettings, Ellipse, Outlines
from gcs.formation.steering import LEFT, RIGHT, contacts_m, level, steer_past, turns
from gcs.model.state import Array, Mask

FORESEEN_S = 8.0
"""A centre at rest makes way for a moving obstacle this long in advance."""

SLOWEST_M_S = 0.1
"""The centre's time of arrival is computed with at least this speed."""

SIDE_KEPT = 1.5
"""A side is kept within this many lookaheads of an obstacle."""


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """What is known beforehand of the centre's path."""

    ends_m: Array | None  # (2,) where it comes to rest, if it does
    straight_m: float  # distance over which its desired velocity stays about the same


def steer_center(
    center_m: Array,
    desired_m_s: Array,
    drones_m: Array,
    ellipses: Mapping[str, Ellipse],
    sides: Mapping[str, float],
    settings: AvoidanceSettings,
    *,
    radius_m: float,
    way: Way,
) -> tuple[Array, dict[str, float]]:
    """The velocity that leads the formation's centre, and with it the whole sphere, past every obstacle.

    The ellipses are grown by as much of the sphere as is below their tops, so that no vehicle has to leave
    the shape. Where the centre is nearer already, or its destination is, they are grown less.

    Args:
        center_m: (3,) of the sphere, show frame.
        desired_m_s: (3,).
        drones_m: (n, 3) of the formation; a side is kept while one of them is near the obstacle.
        ellipses: the obstacles, margin and headroom included.
        sides: chosen so far: LEFT or RIGHT by name.
        settings: distances and rates.
        radius_m: of the sphere.
        way: the centre's path.

    Returns: (3,) in m/s, and the sides that count from now on: one for the whole formation.
    """
    if not ellipses:
        return desired_m_s, {}
    outlines = Outlines.of(ellipses)
    tall = -center_m[2] - radius_m < outlines.top_height_m
    there_m = np.full(len(outlines), inf)
    if way.ends_m is not None:  # the future position of a moving obstacle is not known
        there_m = np.where(outlines.stand, outlines.nearest_m(way.ends_m[None]), inf)
    grown = _grown(outlines, center_m, there_m, radius_m, settings)
    reach_m = _reach_m(outlines, desired_m_s, way, settings)
    waits = bool((there_m[tall] < 0.0).any())  # the destination is inside an obstacle
    keep_m_s = np.array([0.0 if waits else float(np.hypot(desired_m_s[0], desired_m_s[1]))])
    chosen_m_s, _, met = steer_past(
        grown, sides, level(center_m[None]), level(desired_m_s[None]), keep_m_s, tall[None], reach_m
    )
    ahead = tall & (
        contacts_m(
            np.array(center_m), np.array(desired_m_s), grown.center_m, grown.semi_m, grown.velocity_m_s
        )
        < reach_m
    )
    near = outlines.nearest_m(drones_m) < SIDE_KEPT * settings.lookahead_m
    kept = _sides_taken(grown, center_m, chosen_m_s[0], ahead) | dict(sides)
    if met[0] >= 0:
        right = turns(desired_m_s[:2], chosen_m_s[0], grown.velocity_m_s[met[0]])
        kept[grown.names[met[0]]] = RIGHT if right > 0.0 else LEFT
    counts = {name for name, counting in zip(grown.names, ahead | near, strict=True) if counting}
    return np.append(chosen_m_s[0], desired_m_s[2]), {n: side for n, side in kept.items() if n in counts}


def kept_sides(
    outlines: Outlines,
    center_m: Array,
    velocity_m_s: Array,
    drones_m: Array,
    sides: Mapping[str, float],
    *,
    near_m: float,
    tall: Mask,
) -> dict[str, float]:
    """Sides (LEFT, RIGHT by name) on which a centre at (3,) passes the `tall` (m,) outlines near its drones.

    A side is kept while one of the drones (n, 3) is within `near_m` of the outline.
    """
    near = tall & (outlines.nearest_m(drones_m) < near_m)
    passing_m_s = np.hypot(*(velocity_m_s[:2] - outlines.velocity_m_s).T) > SLOWEST_M_S
    taken = _sides_taken(outlines, center_m, velocity_m_s[:2], near & passing_m_s)
    counts = {name for name, counting in zip(outlines.names, near, strict=True) if counting}
    return {name: side for name, side in (taken | dict(sides)).items() if name in counts}


def _sides_taken(outlines: Outlines, center_m: Array, velocity_m_s: Array, ahead: Mask) -> dict[str, float]:
    """The side on which a centre at (3,) passes the ellipses `ahead` (m,), with that velocity (2,)."""
    offset_m, passing_m_s = center_m[:2] - outlines.center_m, velocity_m_s - outlines.velocity_m_s
    on_right = offset_m[:, 0] * passing_m_s[:, 1] > offset_m[:, 1] * passing_m_s[:, 0]
    return {outlines.names[j]: LEFT if on_right[j] else RIGHT for j in np.flatnonzero(ahead)}


def _grown(
    outlines: Outlines, center_m: Array, there_m: Array, radius_m: float, settings: AvoidanceSettings
) -> Outlines:
    """The ellipses grown for the sphere's centre (3,), so that its section below each top passes whole.

    No farther than to the centre itself, nor than `there_m` (m,): its destination's distance to each.
    """
    above_m = np.maximum(-center_m[2] - outlines.top_height_m, 0.0)
    section_m = np.sqrt(np.maximum(radius_m**2 - above_m**2, 0.0))
    clear_m = settings.center_clearance * section_m + settings.near_m
    possible_m = np.minimum(outlines.nearest_m(center_m[None]), there_m)
    return outlines.grown(np.clip(clear_m, 0.0, np.maximum(possible_m, 0.0)))


def _reach_m(outlines: Outlines, desired_m_s: Array, way: Way, settings: AvoidanceSettings) -> Array:
    """(m,) distance ahead of the centre from which each ellipse counts: its straight path, and the lookahead.

    A moving one also counts for FORESEEN_S when the centre arrives before, or stands.
    """
    speed_m_s = float(np.hypot(desired_m_s[0], desired_m_s[1]))
    relative_m_s = np.hypot(*(desired_m_s[:2] - outlines.velocity_m_s).T)
    foreseen_s = max(way.straight_m / max(speed_m_s, SLOWEST_M_S), FORESEEN_S)
    reach_m = np.where(outlines.stand, way.straight_m, relative_m_s * foreseen_s)
    return np.minimum(reach_m, settings.center_lookahead_m)
