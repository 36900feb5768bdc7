"""Distinct landing sites, and stacked vehicles. Pure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.formation.obstacles import Ellipse
from gcs.model.state import Array, Mask
from gcs.safety.fenced_areas import FencedArea, beyond_m
from gcs.safety.floor import Floor

ROUNDS = 60
"""Iterations of pushing apart; the rest is searched for, because a landing must fit between two ticks."""

RINGS = np.concatenate([np.arange(13) / 4.0, 3.0 * 1.1 ** np.arange(1, 48)]).reshape(-1, 6)
"""Radii of the rings on which the nearest free site is searched, in spacings: close by, and up to 260, no
finer in radius than the directions on a ring. Six are examined at a time.
"""

LANDS_WITHIN_S = 45.0
"""From 30 m: 10 s sideways, and down. A box that moves is not to come to the site meanwhile."""

TINY = 1e-6

INSIDE_M = 1.0
"""From the edges of the fence's areas: the safety filter keeps vehicles off them."""

CLEAR_M = 3.0
"""Clearance to obstacles, as AvoidanceSettings.near_m: nearer, the ellipse would push vehicles that land."""


def distinct_sites_m(
    desired_m: Array,
    taken_m: Array,
    spacing_m: float,
    ellipses: Mapping[str, Ellipse],
    areas: Sequence[FencedArea] = (),
    ground: tuple[FencedArea, float] | None = None,
) -> Array:
    """Return landing sites near the vehicles, no two closer than `spacing_m`, none near an obstacle.

    Moves sites that are too close apart, as little as needed, until none is. If that does not converge
    (between sites that stay), the nearest free site is taken.

    Args:
        desired_m: (n, 2) preferred sites, show frame.
        taken_m: (m, 2) sites in use or assigned; they stay.
        spacing_m: between any two.
        ellipses: obstacles with their margins; sites keep CLEAR_M to them.
        areas: of the fence, within which sites are.
        ground: the controlled ground, and how far inside its edge sites are; None: that is not kept.

    Returns: (n, 2), rows as in `desired_m`; NaN where that is NaN.
    """
    place_m = np.array(desired_m, dtype=np.float64)
    located = np.isfinite(place_m).all(axis=1)
    if not located.all():
        place_m[located] = distinct_sites_m(place_m[located], taken_m, spacing_m, ellipses, areas, ground)
        place_m[~located] = np.nan
        return place_m
    taken_m = taken_m.reshape(-1, 2)
    walls = _Walls.of(ellipses)
    n = len(place_m)

    def are_within(place_m: Array) -> Mask:
        within = beyond_m(areas, place_m) <= -INSIDE_M
        if ground is not None:
            within &= beyond_m(ground[:1], place_m) <= -ground[1]
        return np.asarray(within)

    # two equal positions have no direction in which to separate: a fixed, tiny spiral gives them one
    angle_rad = np.arange(n) * 2.399963
    place_m += TINY * np.arange(1, n + 1)[:, None] * np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=1)
    for _ in range(ROUNDS):
        offset_m, distance_m = _offsets(place_m, np.vstack([place_m, taken_m]))
        distance_m[np.arange(n), np.arange(n)] = np.inf
        clear_m, outward = walls.distance_m(place_m), walls.outward(place_m)
        if distance_m.min(initial=np.inf) >= spacing_m and clear_m.min(initial=np.inf) >= CLEAR_M:
            if are_within(place_m).all():
                return place_m
            break
        share = np.maximum(spacing_m * 1.01 - distance_m, 0.0) / np.maximum(distance_m, TINY / 100)
        inside_m = np.maximum(CLEAR_M + 0.1 - clear_m, 0.0)
        push_m = (offset_m * share).sum(axis=2).T + (outward * inside_m).sum(axis=2).T
        length_m = np.linalg.norm(push_m, axis=1, keepdims=True)
        place_m = place_m + push_m * np.minimum(0.5, spacing_m / 4.0 / np.maximum(length_m, TINY))
    return _nearest_free_m(place_m, taken_m, spacing_m, walls, are_within if areas or ground else None)


def open_places_m(
    pad_m: Array,
    closed: Mask,
    taken_m: Array,
    spacing_m: float,
    ellipses: Mapping[str, Ellipse],
    are_open: Callable[[Array], Mask],
) -> Array:
    """Return each vehicle's own pad, or where that is closed the nearest place that is open.

    Args:
        pad_m: (n, 3) show frame.
        closed: (n,) pads on which no vehicle can land.
        taken_m: (m, 2) other sites in use or assigned.
        spacing_m: between any two, the pads included.
        ellipses: obstacles with their margins; places keep CLEAR_M to them.
        are_open: which of (k, 3) places are open.

    Returns: (n, 3); where no place is found, the pad.
    """
    place_m, walls = np.array(pad_m, dtype=np.float64), _Walls.of(ellipses)
    for row in np.flatnonzero(closed).tolist():
        others_m = np.vstack([np.delete(place_m[:, :2], row, axis=0), taken_m.reshape(-1, 2)])
        ground_z_m = place_m[row, 2]

        def free(level_m: Array, ground_z_m: float = ground_z_m) -> Mask:
            return are_open(np.column_stack([level_m, np.full(len(level_m), ground_z_m)]))

        place_m[row, :2] = _nearest_free_m(place_m[row : row + 1, :2], others_m, spacing_m, walls, free)[0]
    return place_m


def are_covered(place_m: Array, ellipses: Mapping[str, Ellipse]) -> Mask:
    """(n,) At which landing places (n, 2 or 3) an obstacle keeps vehicles from landing."""
    nearest_m = _Walls.of(ellipses).distance_m(place_m[:, :2]).min(axis=1, initial=np.inf)
    return np.asarray(nearest_m < CLEAR_M - TINY)


@dataclass(frozen=True, slots=True, eq=False)
class _Walls:
    """All ellipses at once: `Ellipse.distance_m` and `Ellipse.outward` for k of them."""

    center_m: Array  # (k, 2)
    semi_m: Array  # (k, 2)

    @staticmethod
    def of(ellipses: Mapping[str, Ellipse]) -> "_Walls":
        center_m = [(ellipse.x_m, ellipse.y_m) for ellipse in ellipses.values()]
        semi_m = [(ellipse.semi_x_m, ellipse.semi_y_m) for ellipse in ellipses.values()]
        return _Walls(np.array(center_m).reshape(-1, 2), np.array(semi_m).reshape(-1, 2))

    def distance_m(self, place_m: Array) -> Array:
        """(n, k) Distances of (n, 2) positions, negative inside."""
        point, slope = self._point_and_slope(place_m)
        radius = _length(point)
        distance_m: Array = np.where(
            radius > TINY, (radius - 1.0) * radius / np.maximum(slope, TINY**2), -self.semi_m.min(axis=1)
        )
        return distance_m

    def outward(self, place_m: Array) -> Array:
        """(2, n, k) Unit normals away from each ellipse; along x at its centre."""
        point, slope = self._point_and_slope(place_m)
        normal = point / self.semi_m.T[:, None] / np.maximum(slope, TINY**2)
        normal[0] += slope <= TINY**2
        return normal

    def _point_and_slope(self, place_m: Array) -> tuple[Array, Array]:
        """(2, n, k) Positions scaled so that each ellipse is the unit circle, and (n, k) the gradient."""
        point = (place_m.T[:, :, None] - self.center_m.T[:, None]) / self.semi_m.T[:, None]
        return point, _length(point / self.semi_m.T[:, None])


def _offsets(place_m: Array, other_m: Array) -> tuple[Array, Array]:
    """(2, n, m) Vectors from each of the others (m, 2) to each place (n, 2), and (n, m) their lengths."""
    offset_m = place_m.T[:, :, None] - other_m.T[:, None]
    return offset_m, _length(offset_m)


def _length(vector: Array) -> Array:
    """(n, m) Lengths of (2, n, m) vectors; many times faster than a norm along an axis."""
    length: Array = np.sqrt(vector[0] * vector[0] + vector[1] * vector[1])
    return length


def _nearest_free_m(
    place_m: Array,
    taken_m: Array,
    spacing_m: float,
    walls: _Walls,
    are_open: Callable[[Array], Mask] | None = None,
) -> Array:
    """Return, row by row, the place itself if it is free, otherwise the nearest free place."""
    turn_rad = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    circle = np.stack([np.cos(turn_rad), np.sin(turn_rad)], axis=1)
    around_m = [(spacing_m * rings[:, None, None] * circle).reshape(-1, 2) for rings in RINGS]
    found_m = np.array(place_m)
    for row, desired_m in enumerate(place_m):
        settled_m = np.vstack([found_m[:row], taken_m])
        away_m = _length((settled_m - desired_m).T)
        for offset_m in (np.zeros((1, 2)), *around_m):
            candidate_m = desired_m + offset_m
            candidate_m = candidate_m[walls.distance_m(candidate_m).min(axis=1, initial=np.inf) >= CLEAR_M]
            beside_m = settled_m[away_m <= _length(offset_m.T).max() + spacing_m]
            apart_m = _offsets(candidate_m, beside_m)[1].min(axis=1, initial=np.inf)
            candidate_m = candidate_m[apart_m >= spacing_m]
            if are_open is not None and len(candidate_m):
                candidate_m = candidate_m[are_open(candidate_m)]
            if len(candidate_m):
                found_m[row] = candidate_m[0]
                break
    return found_m


TURNS = 200
NAMED_MAX = 10


def column_m(floor: Floor, uncertainty_m: Array | None = None) -> float:
    """Width of the column that a descending vehicle keeps free; `uncertainty_m` as of `Floor.widest_m`."""
    return floor.kept_m(floor.worst_reserve_m(uncertainty_m))[0]


def overlapping(position_m: Array, width_m: float) -> tuple[NDArray[np.intp], Array]:
    """Return the pairs with overlapping columns.

    Args:
        position_m: (n, 3) show frame.
        width_m: of a column.

    Returns: (k, 2) upper and lower of each pair, nearest first, seen from above; and (k,) their distances,
    seen from above.
    """
    first, second = np.triu_indices(len(position_m), 1)
    apart_m = np.hypot(*(position_m[first] - position_m[second])[:, :2].T)
    near = np.flatnonzero(apart_m < width_m)
    near = near[np.argsort(apart_m[near], kind="stable")]
    first, second = first[near], second[near]
    is_upper = position_m[first, 2] <= position_m[second, 2]  # z points down
    pairs = np.column_stack([np.where(is_upper, first, second), np.where(is_upper, second, first)])
    return pairs, apart_m[near]


def most_overlapping(position_m: Array, width_m: float) -> int:
    """Return the greatest number of overlapping pairs over all orientations of the formation (n, 3).

    The law assigns no fixed slots: the shape's orientation and the vehicles' slots are not known beforehand.
    """
    first, second = np.triu_indices(len(position_m), 1)
    chord_m = position_m[first] - position_m[second]
    upward = spiral((np.arange(TURNS) + 0.5) / TURNS)  # possible orientations of a formation
    along_m = chord_m @ upward.T
    sideways_m2 = (chord_m**2).sum(axis=1)[:, None] - along_m**2
    return int((sideways_m2 < width_m**2).sum(axis=0).max(initial=0))


def spiral(z: Array) -> Array:
    """(k, 3) Unit vectors with these components along z (k,): a golden spiral; even if `z` is."""
    level, turn = np.sqrt(1.0 - z**2), np.pi * (3.0 - np.sqrt(5.0)) * np.arange(len(z))
    return np.column_stack([level * np.cos(turn), level * np.sin(turn), z])


def describe_columns(pairs: int, rehearsed: Sequence[str] = ()) -> str:
    """Describe stacked pairs in words; empty if there are none.

    Args:
        pairs: the greatest number over all assignments of slots.
        rehearsed: the pairs of the show's check by name; others may be stacked in flight.
    """
    if not pairs and not rehearsed:
        return ""
    names = [*rehearsed[:NAMED_MAX], *(["others"] if len(rehearsed) > NAMED_MAX else [])]
    named = f" (in the show's check {', '.join(names)})" if names else ""
    return (
        f"up to {max(pairs, len(rehearsed))} pairs in the formation are stacked{named}:"
        " land now leads them apart first, and brings the lowest down first"
    )
