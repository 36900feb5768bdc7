"""Separation between vehicles: an ellipsoid, taller than wide because of downwash."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.safety.constraints import NOBODY, Braking, Constraints
from gcs.settings import NotNegative, Positive, Settings
from gcs.state import Array, Mask

TINY = 1e-9
Rows: TypeAlias = NDArray[np.intp]


class Floor(Settings):
    """No pair may be inside: semi-axes of the ellipsoid, centre to centre, and what is kept on top of it."""

    horizontal_m: Positive = 2.0
    vertical_m: Positive = 3.0
    margin_m: NotNegative = 0.3  # added horizontally, in proportion vertically: for the tracking
    uncertainty_m: NotNegative = 0.35  # of each vehicle's position, where it is not known better
    pad_height_m: NotNegative = 2.0  # pairs that are both below this height on their pads are exempt

    @property
    def scale(self) -> Array:
        """(3,) factors that turn the ellipsoid into a sphere of radius `horizontal_m`."""
        return np.array([1.0, 1.0, self.horizontal_m / self.vertical_m])

    @property
    def widest_m(self) -> float:
        """Separation that satisfies floor and margin in every direction."""
        stretch = max(1.0, self.vertical_m / self.horizontal_m)
        return (self.horizontal_m + self.margin_m + 2.0 * self.uncertainty_m) * stretch


def pairs_that_count(position_m: Array, airborne: Mask, floor: Floor) -> tuple[Rows, Rows]:
    """Rows (k,) and (k,) of all pairs of which at least one is in the air, pads exempt.

    A pair is exempt while both are below `pad_height_m`; unknown positions (NaN) take no part.
    """
    first, second = np.triu_indices(len(position_m), 1)
    known: Mask = np.asarray(np.isfinite(position_m).all(axis=1))
    low: Mask = np.asarray(-position_m[:, 2] < floor.pad_height_m)
    flying: Mask = airborne[first] | airborne[second]
    counts = np.flatnonzero(flying & known[first] & known[second] & ~(low[first] & low[second]))
    return first[counts], second[counts]


def scaled_distance_m(position_m: Array, first: Rows, second: Rows, floor: Floor) -> Array:
    """(k,) distances in the metric in which the floor is a sphere of radius ``floor.horizontal_m``."""
    distance: Array = np.linalg.norm((position_m[first] - position_m[second]) * floor.scale, axis=1)
    return distance


def minimum_separation(position_m: Array, airborne: Mask, floor: Floor) -> tuple[float, int]:
    """Smallest true distance of the pairs that count (inf without any), and how many are inside the floor."""
    first, second = pairs_that_count(position_m, airborne, floor)
    if len(first) == 0:
        return np.inf, 0
    distance_m = np.linalg.norm(position_m[first] - position_m[second], axis=1)
    inside = scaled_distance_m(position_m, first, second, floor) < floor.horizontal_m
    return float(distance_m.min()), int(inside.sum())


def separation_constraints(
    position_m: Array,
    velocity_m_s: Array,
    commanded: Mask,
    airborne: Mask,
    *,
    floor: Floor,
    braking: Braking,
    names: Sequence[str],
    uncertainty_m: Array,
    fastest_m_s: float = np.inf,
) -> Constraints:
    """Bound the closing speed of every pair that could come too close, by what can still be braked.

    Where both are commanded they share the duty, as the projection finds cheapest; where one is not (held
    by its autopilot, flown by a pilot), the other yields all the way to its measured velocity.

    Args:
        position_m: (n, 3), show frame; NaN rows take no part.
        velocity_m_s: (n, 3) measured.
        commanded: (n,) True where this tick sends a setpoint.
        airborne: (n,) True where a vehicle is in the air or may be.
        floor: ellipsoid and margin.
        braking: how surely vehicles stop.
        names: (n,) for the reasons.
        uncertainty_m: (n,) of the positions, sideways; added to the margin.
        fastest_m_s: nobody may fly faster, in any direction. Pairs that could still brake from twice the
            closing speed possible then are left out: no velocities within the limits break their constraint.
    """
    first, second = pairs_that_count(position_m, airborne, floor)
    relevant = commanded[first] | commanded[second]
    first, second = first[relevant], second[relevant]
    swap = ~commanded[first]
    first, second = np.where(swap, second, first), np.where(swap, first, second)

    scaled = (position_m[first] - position_m[second]) * floor.scale
    distance_m = np.linalg.norm(scaled, axis=1)
    apart = np.where(distance_m[:, None] > TINY, scaled / np.maximum(distance_m, TINY)[:, None], (0, 0, 1.0))
    gap_m = distance_m - floor.horizontal_m - floor.margin_m - uncertainty_m[first] - uncertainty_m[second]
    both = commanded[second]
    normal, bound_m_s = _true_bound(apart * floor.scale, gap_m, braking)
    known_m_s = np.where(np.isfinite(velocity_m_s), velocity_m_s, 0.0)  # unknown: at least keep away
    bound_m_s = bound_m_s + np.where(both, 0.0, (normal * known_m_s[second]).sum(axis=1))
    possible_m_s = np.where(both, 2.0, 1.0) * fastest_m_s
    kept = bound_m_s >= -2.0 * possible_m_s
    reasons = tuple(f"separation from {names[j]}" for j in second[kept])
    shared = np.where(both, second, NOBODY)
    return Constraints(first[kept], shared[kept], normal[kept], bound_m_s[kept], reasons)


def keepout_constraints(
    position_m: Array,
    commanded: Mask,
    segments_m: Array,
    *,
    floor: Floor,
    braking: Braking,
    uncertainty_m: Array,
    fastest_m_s: float = np.inf,
) -> Constraints:
    """Keep the commanded vehicles away from what lost vehicles may sweep.

    Args:
        position_m: (n, 3), show frame.
        commanded: (n,).
        segments_m: (m, 2, 3) straight pieces of the paths that lost vehicles may take.
        floor: as between vehicles.
        braking: how surely vehicles stop.
        uncertainty_m: (n,) of the positions; that of the lost is the floor's own.
        fastest_m_s: as in `separation_constraints`; what twice that could not reach is left out.
    """
    rows = np.flatnonzero(commanded)
    if len(rows) == 0 or len(segments_m) == 0:
        return Constraints.none()
    row, piece = (grid.ravel() for grid in np.meshgrid(rows, np.arange(len(segments_m)), indexing="ij"))
    start, end = segments_m[piece, 0] * floor.scale, segments_m[piece, 1] * floor.scale
    along = end - start
    offset = position_m[row] * floor.scale - start
    share = (offset * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), TINY)
    scaled = offset - np.clip(share, 0.0, 1.0)[:, None] * along
    distance_m = np.linalg.norm(scaled, axis=1)
    apart = np.where(distance_m[:, None] > TINY, scaled / np.maximum(distance_m, TINY)[:, None], (1.0, 0, 0))
    gap_m = distance_m - floor.horizontal_m - floor.margin_m - uncertainty_m[row] - floor.uncertainty_m
    normal, bound_m_s = _true_bound(apart * floor.scale, gap_m, braking)
    kept = bound_m_s >= -2.0 * fastest_m_s
    row, normal, bound_m_s = row[kept], normal[kept], bound_m_s[kept]
    reasons = ("the path of a lost vehicle",) * len(row)
    return Constraints(row, np.full(len(row), NOBODY), normal, bound_m_s, reasons)


def _true_bound(slope: Array, scaled_gap_m: Array, braking: Braking) -> tuple[Array, Array]:
    """Unit normals (k, 3) and bounds (k,) in true metres a second.

    `slope` (k, 3) is the gradient of the scaled distance; the gap in true metres along it is the scaled
    gap over its length.
    """
    length = np.linalg.norm(slope, axis=1)
    return slope / length[:, None], -braking.speed_m_s(scaled_gap_m / length)
