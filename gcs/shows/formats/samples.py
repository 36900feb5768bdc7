"""Turns samples of a position into a smooth trajectory. Pure."""

from typing import Final

import numpy as np
import scipy

from gcs.model.state import Array
from gcs.shows.drawn import Trajectory

COORDINATE_MAX_M: Final = 20_000.0
"""Largest coordinate of a drawing."""

NWU: Array = np.array([1.0, -1.0, -1.0])
"""Factors between x ahead, y left, z up (Skybrush, Crazyswarm) and the show frame, in both directions."""


def through_samples(times_s: Array, positions_m: Array) -> Trajectory:
    """Return a trajectory (cubic) through k samples at increasing times.

    Args:
        times_s: (k,) increasing.
        positions_m: (k, 3) show frame.

    Straight lines between samples would jump in velocity at each. Akima's slopes, as modified in scipy,
    neither do so nor overshoot: a vehicle at rest stays at rest.

    Source: Akima, J. ACM 17, 1970; scipy.interpolate.Akima1DInterpolator, method "makima".
    """
    if len(times_s) == 1:
        return Trajectory(times_s.copy(), positions_m[None])
    if len(times_s) == 2:
        return Trajectory(times_s.copy(), np.stack([positions_m[0], positions_m[1] - positions_m[0]])[None])
    spline = scipy.interpolate.Akima1DInterpolator(times_s, positions_m, method="makima")
    durations_s = np.diff(times_s)
    powers = np.arange(4)
    # scipy's c is (4, k - 1, 3), highest power first, over seconds since the piece began
    coefficients_m = spline.c[::-1].transpose(1, 0, 2) * (durations_s[:, None] ** powers)[:, :, None]
    return Trajectory(times_s.copy(), np.ascontiguousarray(coefficients_m))
