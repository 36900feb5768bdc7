"""Convergence onto the virtual sphere (article, section 2.1)."""

import numpy as np

from gcs.model.state import Array

TINY = 1e-9


def sphere_force(position_m: Array, center_m: Array, *, radius_m: float, gain: float) -> Array:
    """Draw every vehicle onto the sphere, exactly as the article writes it.

    Args:
        position_m: (n, 3), in the frame of `center_m`.
        center_m: (3,).
        radius_m: r_d.
        gain: k_s, in N/m^3 for a mass in kg.

    Returns: (n, 3) virtual forces ``-k_s (p - p_c) (|p - p_c|^2 - r_d^2)``; zero at the centre itself.

    Source: article, section 2.1.
    """
    offset_m = position_m - center_m
    excess_m2 = (offset_m**2).sum(axis=1, keepdims=True) - radius_m**2
    force: Array = -gain * offset_m * excess_m2
    return force


def sphere_velocity(
    position_m: Array, center_m: Array, *, radius_m: float, rate_per_s: float, speed_max_m_s: float
) -> Array:
    """The same pull as a velocity: `rate_per_s` near the shell, limited away from it.

    Args:
        position_m: (n, 3), show frame.
        center_m: (3,), show frame.
        radius_m: of the sphere, above 0.
        rate_per_s: how fast a small radial error decays.
        speed_max_m_s: no row is faster.

    Returns: (n, 3) in m/s along the radius. A vehicle at the centre itself is sent up, so that it is not
    stuck.

    Source: article, section 2.1, divided by ``2 r r_d`` near the shell, so that the gain is a rate.
    """
    offset_m = position_m - center_m
    distance_m = np.linalg.norm(offset_m, axis=1, keepdims=True)
    outward = np.where(distance_m > TINY, offset_m / np.maximum(distance_m, TINY), (0.0, 0.0, -1.0))
    excess_m = (distance_m**2 - radius_m**2) / (2 * radius_m)
    velocity: Array = -outward * np.clip(rate_per_s * excess_m, -speed_max_m_s, speed_max_m_s)
    return velocity
