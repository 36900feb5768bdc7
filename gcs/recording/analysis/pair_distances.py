"""Least distance of every pair of a flight, also between two samples."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.model.jit import kernel
from gcs.recording.analysis.trajectories import Single, Trajectories
from gcs.safety.separation import Floor

FAR = 8.0
"""Pairs farther apart than this multiple of the minimum separation are not examined between samples."""


@dataclass(frozen=True, slots=True, eq=False)
class PairDistances:
    """Least values of every pair (i < j), (n, n) each; inf and -1 if the pair never counted."""

    distance_m: Single  # between centres
    ratio: Single  # of the distance to the minimum, in the ellipsoid's metric: below 1 is inside
    sure_ratio: Single  # the same if both were off by their uncertainty, towards each other
    sample: NDArray[np.int32]  # of the least ratio

    def nearest(self, count: int) -> list[tuple[int, int]]:
        """Return the pairs with the least ratios, nearest first."""
        first, second = np.triu_indices(len(self.ratio), 1)
        ratio = self.ratio[first, second]
        order = np.argsort(ratio, kind="stable")[:count]
        return [(int(first[at]), int(second[at])) for at in order.tolist() if np.isfinite(ratio[at])]

    def with_nearer(self, later: "PairDistances") -> "PairDistances":
        """Return the smaller of both values, pair by pair."""
        nearer = later.ratio < self.ratio
        return PairDistances(
            np.minimum(self.distance_m, later.distance_m),
            np.where(nearer, later.ratio, self.ratio),
            np.minimum(self.sure_ratio, later.sure_ratio),
            np.where(nearer, later.sample, self.sample),
        )


def nearest_approaches(trajectories: Trajectories, floor: Floor) -> tuple[PairDistances, Single]:
    """Return each pair's least values where one at least flies and not both are low over their pads.

    Returns: the pairs, and (k,) the least distance of all in each sample.
    """
    distance_m, ratio, sure_ratio, sample, over_time_m = _nearest(
        np.ascontiguousarray(trajectories.position_m, np.float32),
        np.ascontiguousarray(trajectories.airborne),
        np.ascontiguousarray(trajectories.uncertainty_m, np.float32),
        (floor.horizontal_m, floor.vertical_m, floor.pad_height_m, floor.vertical_uncertainty),
    )
    return PairDistances(distance_m, ratio, sure_ratio, sample), over_time_m


@kernel
def _nearest(
    position_m: Single,
    airborne: NDArray[np.bool_],
    uncertainty_m: Single,
    floor: tuple[float, float, float, float],
) -> tuple[Single, Single, Single, NDArray[np.int32], Single]:
    horizontal_m, vertical_m, pad_m, vertical_uncertainty = floor
    k, n = position_m.shape[0], position_m.shape[1]
    distance_m = np.full((n, n), np.inf, np.float32)
    ratio = np.full((n, n), np.inf, np.float32)
    sure_ratio = np.full((n, n), np.inf, np.float32)
    sample = np.full((n, n), -1, np.int32)
    over_time_m = np.full(k, np.inf, np.float32)
    for t in range(k):
        for i in range(n):
            if not np.isfinite(position_m[t, i].sum()):
                continue
            for j in range(i + 1, n):
                if not (airborne[t, i] or airborne[t, j]) or not np.isfinite(position_m[t, j].sum()):
                    continue
                if -position_m[t, i, 2] < pad_m and -position_m[t, j, 2] < pad_m:
                    continue
                x = position_m[t, i, 0] - position_m[t, j, 0]
                y = position_m[t, i, 1] - position_m[t, j, 1]
                z = position_m[t, i, 2] - position_m[t, j, 2]
                away_m = np.sqrt(x * x + y * y + z * z)
                scaled = np.sqrt((x * x + y * y) / horizontal_m**2 + z * z / vertical_m**2)
                if t + 1 < k and scaled < FAR:
                    # straight to the next sample, in relative motion of the two
                    dx = position_m[t + 1, i, 0] - position_m[t + 1, j, 0] - x
                    dy = position_m[t + 1, i, 1] - position_m[t + 1, j, 1] - y
                    dz = position_m[t + 1, i, 2] - position_m[t + 1, j, 2] - z
                    along = (x * dx + y * dy) / horizontal_m**2 + z * dz / vertical_m**2
                    length = (dx * dx + dy * dy) / horizontal_m**2 + dz * dz / vertical_m**2
                    if along < 0.0 and length > 0.0 and np.isfinite(length):
                        share = min(1.0, -along / length)
                        x, y, z = x + share * dx, y + share * dy, z + share * dz
                        away_m = min(away_m, np.sqrt(x * x + y * y + z * z))
                        scaled = np.sqrt((x * x + y * y) / horizontal_m**2 + z * z / vertical_m**2)
                off_m = uncertainty_m[t, i] + uncertainty_m[t, j]
                off = off_m / min(horizontal_m, vertical_m / vertical_uncertainty)
                distance_m[i, j] = min(distance_m[i, j], away_m)
                over_time_m[t] = min(over_time_m[t], away_m)
                sure_ratio[i, j] = min(sure_ratio[i, j], scaled - off)
                if scaled < ratio[i, j]:
                    ratio[i, j] = scaled
                    sample[i, j] = t
    return distance_m, ratio, sure_ratio, sample, over_time_m
