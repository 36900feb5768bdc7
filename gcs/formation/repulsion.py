"""Mutual repulsion, which spreads the drones evenly (article, section 2.2)."""

import numpy as np

from gcs.formation.sphere import TINY
from gcs.state import Array

STIFFEST_MODE = 0.22
"""Largest eigenvalue of the unit-charge energy's Hessian on the unit sphere, over N^1.5.

Measured for the best known configurations of N = 3 to 100: 0.13 to 0.216, levelling off. Dividing by it
makes one step of `spread_directions` settle the stiffest mode, whatever N is.
"""

STEP_MAX_RAD = 0.15
"""Nobody's direction turns further in one step: crowded starts push hard."""


def repulsion_force(position_m: Array, charge: Array, *, gain: float) -> Array:
    """Push the drones apart like charges, exactly as the article writes it.

    Args:
        position_m: (n, 3).
        charge: (n,) q_n.
        gain: k_r.

    Returns: (n, 3) forces ``k_r q_n sum_i q_i r_ni / |r_ni|^3``; equal and opposite for each pair. Drones in
        the same place do not push each other: there is no direction to push in.
    Source: article, section 2.2.
    """
    offset_m = position_m[:, None, :] - position_m[None, :, :]
    distance_m = np.sqrt((offset_m**2).sum(axis=2))
    strength = np.zeros_like(distance_m)
    np.divide(charge[:, None] * charge[None, :], distance_m**3, out=strength, where=distance_m > TINY)
    force: Array = gain * (offset_m * strength[:, :, None]).sum(axis=1)
    return force


def spread_directions(direction: Array, charge: Array, *, steps: int) -> Array:
    """Where repulsion alone leads the drones' directions, some way ahead.

    Steepest descent of the charges' energy on the unit sphere, in steps in which the stiffest mode of the
    shape all but settles. Heading for where the repulsion leads, instead of along it, lets the soft modes of
    the shape settle nearly as fast as the stiff ones (a twist of 8 drones 13 times faster with 20 steps).

    Args:
        direction: (n, 3) unit vectors.
        charge: (n,), above 0.
        steps: how far to look ahead.

    Returns: (n, 3) unit vectors.
    Source: article, section 2.2, on the unit sphere (the Thomson problem).
    """
    stride = 1.0 / (STIFFEST_MODE * max(len(direction), 2) ** 1.5 * max(float((charge**2).mean()), TINY))
    ahead = direction
    for _ in range(steps):
        push = repulsion_force(ahead, charge, gain=stride)
        along = push - ahead * (push * ahead).sum(axis=1, keepdims=True)
        length = np.linalg.norm(along, axis=1, keepdims=True)
        ahead = ahead + along * np.minimum(1.0, STEP_MAX_RAD / np.maximum(length, TINY))
        ahead = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
    return ahead


def spreading_velocity(
    position_m: Array,
    center_m: Array,
    charge: Array,
    *,
    radius_m: float,
    rate_per_s: float,
    speed_max_m_s: float,
    steps: int,
) -> Array:
    """Repulsion between the drones' directions from the centre, as a velocity along the sphere only.

    The radial part is left out: it is what makes the article's radius grow with N. The gain is a rate,
    whatever N and R are.

    Args:
        position_m: (n, 3), show frame.
        center_m: (3,), show frame.
        charge: (n,), above 0.
        radius_m: of the sphere.
        rate_per_s: decay of the shape's error.
        speed_max_m_s: no row is faster.
        steps: how far ahead the repulsion is followed, see `spread_directions`.

    Returns: (n, 3) in m/s, each row at right angles to its radius.
    """
    offset_m = position_m - center_m
    distance_m = np.linalg.norm(offset_m, axis=1, keepdims=True)
    direction = np.where(distance_m > TINY, offset_m / np.maximum(distance_m, TINY), (0.0, 0.0, -1.0))
    ahead = spread_directions(direction, charge, steps=steps)
    cosine = (ahead * direction).sum(axis=1, keepdims=True)
    along = ahead - direction * cosine
    sine = np.linalg.norm(along, axis=1, keepdims=True)
    angle_rad = np.arctan2(sine, cosine)
    speed_m_s = np.minimum(rate_per_s * radius_m * angle_rad, speed_max_m_s)
    velocity: Array = along / np.maximum(sine, TINY) * speed_m_s
    return velocity
