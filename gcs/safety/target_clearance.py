"""The distance that every vehicle keeps from the target: a person, or a vehicle that may not be touched.

It is kept as the floor is kept between two vehicles, by a row of the safety filter, so no law breaks it. The
target does not give way; what is not known of it widens the distance. Measured: decision page Targets.
"""

from math import sqrt
from typing import Final

import numpy as np

from gcs.model.plan import Target
from gcs.model.response import FleetResponse
from gcs.model.state import TINY, Array, Mask
from gcs.safety.constraints import LEAD, NO_ROW, Braking, Constraints, true_bound
from gcs.safety.floor import Floor

DEVIATIONS: Final = 4.0
"""So many standard deviations of a vehicle's position relative to the target are added."""

STARTS_M: Final = 2.0
"""How far a target goes that suddenly moves, with 2 m/s^2 for 1.4 s, before a vehicle answers."""


def kept_clear_m(target: Target, floor: Floor, uncertainty_m: Array) -> Array:
    """(2, n) semi-axes, sideways and up, of the space round the target that each vehicle stays out of.

    Args:
        target: with a clearance.
        floor: margins, and how much less certain heights are.
        uncertainty_m: (n,) standard deviations of the vehicles' positions, sideways.
    """
    up_m = floor.vertical_uncertainty * uncertainty_m
    around_m = DEVIATIONS * np.stack(
        [np.hypot(uncertainty_m, target.deviation_m), np.hypot(up_m, target.height_deviation_m)]
    )
    kept_m: Array = target.clearance_m + floor.margin_m + STARTS_M + around_m
    return kept_m


def clear_height_m(target: Target, orbit_m: float, sphere_m: float, kept_m: Array) -> float:
    """Least height of the centre above the origin with which the sphere is clear of its target.

    Args:
        target: with a clearance.
        orbit_m: radius of the orbit round the target.
        sphere_m: radius of the sphere.
        kept_m: (2,) semi-axes, as of `kept_clear_m`.
    """
    beside_m, above_m = (kept_m + sphere_m).tolist()
    raised_m: float = above_m * sqrt(max(1.0 - (orbit_m / beside_m) ** 2, 0.0))
    return target.height_m + raised_m


def clearance_constraints(
    position_m: Array,
    velocity_m_s: Array,
    commanded: Mask,
    target: Target,
    time_s: float,
    *,
    floor: Floor,
    braking: Braking,
    uncertainty_m: Array,
    response: FleetResponse | None = None,
    fastest_m_s: float = np.inf,
) -> Constraints:
    """Keep the commanded vehicles out of the space round a target that moves on as it does.

    Args:
        position_m: (n, 3), show frame.
        velocity_m_s: (n, 3) measured; NaN: at rest.
        commanded: (n,).
        target: with its clearance; 0: there is no constraint.
        time_s: of the positions.
        floor: as of `kept_clear_m`.
        braking: how vehicles stop.
        uncertainty_m: (n,) standard deviations of the positions, sideways.
        response: (n,) in what vehicles differ from `braking`; None: in nothing.
        fastest_m_s: constraints that twice this speed cannot break are left out.
    """
    rows = np.flatnonzero(commanded) if target.clearance_m else np.zeros(0, np.intp)
    if len(rows) == 0:
        return Constraints.none()
    kept_m = kept_clear_m(target, floor, uncertainty_m[rows])
    place_m = np.array([*target.position_m(time_s), -target.height_m])
    moves_m_s = np.array([*target.velocity_m_s, -target.climb_m_s])
    scale = np.ones((len(rows), 3))
    scale[:, 2] = kept_m[0] / kept_m[1]
    offset = (position_m[rows] - place_m) * scale
    off_m = np.linalg.norm(offset, axis=1)
    apart = np.where(off_m[:, None] > TINY, offset / np.maximum(off_m, TINY)[:, None], (0.0, 0.0, -1.0))
    each = braking.of_each(len(position_m), response)[:, rows]
    slope = apart * scale
    outward = slope / np.linalg.norm(slope, axis=1)[:, None]
    closing_m_s = ((moves_m_s - np.nan_to_num(velocity_m_s[rows])) * outward).sum(axis=1)
    gap_m = off_m - kept_m[0] - each[LEAD] * np.maximum(closing_m_s, 0.0) * np.linalg.norm(slope, axis=1)
    normal, bound_m_s = true_bound(slope, gap_m, each)
    bound_m_s = bound_m_s + normal @ moves_m_s
    binds = bound_m_s >= -2.0 * fastest_m_s
    rows, normal, bound_m_s = rows[binds], normal[binds], bound_m_s[binds]
    reasons = np.full(len(rows), "clearance of the target", dtype=object)
    return Constraints(rows, np.full(len(rows), NO_ROW), normal, bound_m_s, reasons)


def away_m(position_m: Array, target: Target, time_s: float) -> Array:
    """(n,) distances of positions (n, 3) from where the target is believed."""
    distance_m: Array = np.linalg.norm(position_m - (*target.position_m(time_s), -target.height_m), axis=1)
    return distance_m
