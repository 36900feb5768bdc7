"""Rotation of the formation about the vertical through its centre."""

from math import cos, sin

import numpy as np

from gcs.model.state import Array


def turned(vectors: Array, angle_rad: float) -> Array:
    """(n, 3) vectors of the show frame, turned about the vertical: clockwise from above (x towards y)."""
    c, s = cos(angle_rad), sin(angle_rad)
    x, y, z = vectors.T
    return np.column_stack([c * x - s * y, s * x + c * y, z])


def spin_velocity(offset_m: Array, rate_rad_s: float, lead_s: float) -> Array:
    """(n, 3) velocities in m/s of points at (n, 3) from the centre that rotate with it.

    Args:
        offset_m: from the centre, show frame.
        rate_rad_s: positive is clockwise from above.
        lead_s: lead of the rotation: vehicles respond late, and one that turns late drifts outwards.
    """
    ahead_m = turned(offset_m, rate_rad_s * lead_s)
    return np.column_stack([-rate_rad_s * ahead_m[:, 1], rate_rad_s * ahead_m[:, 0], np.zeros(len(ahead_m))])
