"""The floor between vehicles, an ellipsoid taller than wide because of downwash, and how near they are."""

from typing import Final

import numpy as np

from gcs.model.jit import kernel
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import Array, Mask
from gcs.safety.neighbours import Rows, near_pairs

WALL_DEVIATIONS: Final = 3.0
"""So many standard deviations of its position a vehicle keeps off the walls of areas."""


class Floor(Settings):
    """The minimum-separation ellipsoid (semi-axes, centre to centre) that no pair may enter, and margins."""

    horizontal_m: Positive = 2.0
    """Least distance of two vehicles sideways, centre to centre, in m."""
    vertical_m: Positive = 3.0
    """Least distance one above the other, in m; more, because of downwash."""
    margin_m: NotNegative = 0.3
    """Added sideways, in proportion up: half of it for each vehicle's tracking, in m."""
    uncertainty_m: NotNegative = 0.05
    """Standard deviation of a position, sideways, where none is reported, in m."""
    vertical_uncertainty: Positive = 2.0
    """Factor of it for up and down (recorded: 0.41 m against 0.19 m)."""
    deviations: Positive = 6.0
    """So many standard deviations of a pair's relative position its margin covers."""
    pad_height_m: NotNegative = 2.0
    """Two vehicles that are both below this height on their pads are exempt, in m."""

    @property
    def scale(self) -> Array:
        """(3,) factors that turn the ellipsoid into a sphere of radius `horizontal_m`."""
        return np.array([1.0, 1.0, self.horizontal_m / self.vertical_m])

    def reserve_m(self, first_m: Array | float, second_m: Array | float) -> Array:
        """(k,) sideways margins for the error of a pair's relative position: the two variances add.

        Args:
            first_m: (k,) standard deviations of the positions, sideways.
            second_m: (k,) those of the other vehicles.
        """
        reserved_m: Array = self.deviations * np.hypot(first_m, second_m)
        return reserved_m

    def standoff_m(self, uncertainty_m: Array) -> Array:
        """(n,) how far inside the fence vehicles are kept: their part of the margin, and one deviation.

        Args:
            uncertainty_m: (n,) standard deviations of the positions, sideways.
        """
        kept_m: Array = self.margin_m / 2.0 + uncertainty_m
        return kept_m

    def off_walls_m(self, uncertainty_m: Array) -> Array:
        """(n,) how far off the walls of areas vehicles are kept, where they may wait for long.

        Args:
            uncertainty_m: (n,) standard deviations of the positions, sideways.
        """
        kept_m: Array = self.margin_m / 2.0 + WALL_DEVIATIONS * uncertainty_m
        return kept_m

    def worst_reserve_m(self, uncertainty_m: Array | None = None) -> float:
        """`reserve_m` of the least certain two of (n,); without them, of two that report nothing."""
        if uncertainty_m is None or len(uncertainty_m) == 0:
            return float(self.reserve_m(self.uncertainty_m, self.uncertainty_m))
        each_m = np.zeros(1 + len(uncertainty_m))
        each_m[1:] = uncertainty_m
        each_m.partition(-2)
        second_m, first_m = each_m[-2:]
        return float(self.reserve_m(first_m, second_m))

    def kept_m(self, reserve_m: float) -> tuple[float, float]:
        """Semi-axes, sideways and up, with margin, for a pair with this `reserve_m`."""
        stretch = self.vertical_m / self.horizontal_m
        return (
            self.horizontal_m + self.margin_m + reserve_m,
            self.vertical_m + self.margin_m * stretch + self.vertical_uncertainty * reserve_m,
        )

    def widest_m(self, uncertainty_m: Array | None = None) -> float:
        """Separation that satisfies floor and margin in every direction, for any two of (n,) vehicles."""
        return max(self.kept_m(self.worst_reserve_m(uncertainty_m)))


def pairs_that_count(position_m: Array, airborne: Mask, floor: Floor) -> tuple[Rows, Rows]:
    """Rows (k,) and (k,) of all pairs of which at least one is in the air, pads exempt.

    A pair is exempt while both are below `pad_height_m`; unknown positions (NaN) take no part.
    """
    first, second = np.triu_indices(len(position_m), 1)
    located: Mask = np.asarray(np.isfinite(position_m).all(axis=1))
    low: Mask = np.asarray(-position_m[:, 2] < floor.pad_height_m)
    flying: Mask = airborne[first] | airborne[second]
    counts = np.flatnonzero(flying & located[first] & located[second] & ~(low[first] & low[second]))
    return first[counts], second[counts]


def scaled_distance_m(position_m: Array, first: Rows, second: Rows, floor: Floor) -> Array:
    """(k,) distances in the metric in which the floor is a sphere of radius ``floor.horizontal_m``."""
    distance: Array = np.linalg.norm((position_m[first] - position_m[second]) * floor.scale, axis=1)
    return distance


def minimum_separation(
    position_m: Array, airborne: Mask, floor: Floor, own: int | None = None
) -> tuple[float, int]:
    """Smallest true distance of the pairs that count (inf without any), and the number inside the floor.

    Where `own` is given, one of both vehicles at least is among the first `own` rows.
    """
    # numba compiles frozen arrays as another type
    position_m, airborne = np.array(position_m), np.array(airborne)
    semi_axes = floor.horizontal_m, floor.vertical_m, floor.pad_height_m
    least_m, inside = _closest(position_m, airborne, len(position_m) if own is None else own, *semi_axes)
    return least_m, inside


@kernel
def _closest(
    position_m: Array, airborne: Mask, own: int, horizontal_m: float, vertical_m: float, pad_height_m: float
) -> tuple[float, int]:
    """As `minimum_separation`: of the near pairs; the search radius doubles until one of them counts.

    Each pair that counts has one vehicle in the air, and one above the pads: of these, the fewer are searched
    for. On the ground there are none.
    """
    located, extent_m = np.empty(len(position_m), np.bool_), 0.0
    low_m, high_m = np.full(3, np.inf), np.full(3, -np.inf)
    flying, above = np.zeros(len(position_m), np.bool_), np.zeros(len(position_m), np.bool_)
    for i in range(len(position_m)):
        widest_m = max(abs(position_m[i, 0]), abs(position_m[i, 1]), abs(position_m[i, 2]))
        located[i] = np.isfinite(position_m[i, 0] + position_m[i, 1] + position_m[i, 2])
        if located[i]:
            extent_m = max(extent_m, widest_m)
            flying[i], above[i] = airborne[i], -position_m[i, 2] >= pad_height_m
            for axis in range(3):
                low_m[axis] = min(low_m[axis], position_m[i, axis])
                high_m[axis] = max(high_m[axis], position_m[i, axis])
    some = flying if flying.sum() <= above.sum() else above
    if not some.any():
        return np.inf, 0
    if own < len(located):
        some = located & (np.arange(len(located)) < own)
    # as far as the vehicles of a sphere that wide are from their neighbours: mostly one search is enough
    apart_m = 2.2 * (high_m - low_m).max() / np.sqrt(located.sum())
    look_m = min(max(apart_m, 2.0 * max(horizontal_m, vertical_m)), 4.0 * max(horizontal_m, vertical_m))
    farthest_m = 2.0 * np.sqrt(3.0) * extent_m + look_m
    while True:
        first, second = near_pairs(some, position_m, located, np.full(len(position_m), look_m / 2.0))
        found_m, inside = _closest_of(
            position_m, airborne, first, second, horizontal_m, vertical_m, pad_height_m
        )
        if np.isfinite(found_m) or look_m > farthest_m:
            return found_m, inside
        look_m *= 2.0


@kernel
def _closest_of(
    position_m: Array,
    airborne: Mask,
    first: Rows,
    second: Rows,
    horizontal_m: float,
    vertical_m: float,
    pad_height_m: float,
) -> tuple[float, int]:
    """Of those pairs (k,) that count: the smallest distance, and the number inside the floor."""
    least_m2, inside = np.inf, 0
    for k in range(len(first)):
        i, j = first[k], second[k]
        low = -position_m[i, 2] < pad_height_m and -position_m[j, 2] < pad_height_m
        if low or not (airborne[i] or airborne[j]):
            continue
        x_m, y_m, z_m = (
            position_m[i, 0] - position_m[j, 0],
            position_m[i, 1] - position_m[j, 1],
            position_m[i, 2] - position_m[j, 2],
        )
        least_m2 = min(least_m2, x_m * x_m + y_m * y_m + z_m * z_m)
        z_m *= horizontal_m / vertical_m
        if x_m * x_m + y_m * y_m + z_m * z_m < horizontal_m * horizontal_m:
            inside += 1
    return np.sqrt(least_m2), inside
