"""Compiled sums over pairs for metrics, deliberately independent of the code that flies."""

import numpy as np

from gcs.model.jit import kernel
from gcs.model.state import Array, Mask

FAR_M = 1e9


@kernel
def closest_m(
    position_m: Array, in_air: Mask, present: Mask, scale_z: float, pad_height_m: float, inside_m: float
) -> tuple[float, int]:
    """Smallest distance of the pairs that count, heights times `scale_z`, and the number within `inside_m`.

    A pair counts when at least one vehicle is airborne and not both are below `pad_height_m`.
    """
    n = len(position_m)
    least_m2, inside = FAR_M * FAR_M, 0
    for i in range(n):
        if not present[i]:
            continue
        x, y, z = position_m[i, 0], position_m[i, 1], position_m[i, 2]
        low = -z < pad_height_m
        for j in range(i + 1, n):
            dx = position_m[j, 0] - x
            dy = position_m[j, 1] - y
            dz = (position_m[j, 2] - z) * scale_z
            distance_m2 = dx * dx + dy * dy + dz * dz
            if distance_m2 < least_m2 or distance_m2 < inside_m * inside_m:
                counts = present[j] and (in_air[i] or in_air[j])
                if counts and not (low and -position_m[j, 2] < pad_height_m):
                    least_m2 = min(least_m2, distance_m2)
                    if distance_m2 < inside_m * inside_m:
                        inside += 1
    return np.sqrt(least_m2), inside


def energy_and_nearest(direction: Array, charge: Array | None = None) -> tuple[float, float]:
    """Coulomb energy of charges (n,), 1 each unless given, at (n, 3) unit vectors; the smallest distance."""
    return _energy_and_nearest(direction, np.ones(len(direction)) if charge is None else charge)


def energy_and_gradient(flat: Array, charge: Array | None = None) -> tuple[float, Array]:
    """Energy of charges (n,), 1 each unless given, at the directions of n points, (3 n,) flattened.

    Returns: the energy, and its gradient with respect to the points, (3 n,).
    """
    return _energy_and_gradient(flat, np.ones(len(flat) // 3) if charge is None else charge)


@kernel
def _energy_and_nearest(direction: Array, charge: Array) -> tuple[float, float]:
    n = len(direction)
    total, least2 = 0.0, 4.0
    for i in range(n):
        x, y, z = direction[i, 0], direction[i, 1], direction[i, 2]
        for j in range(i + 1, n):
            dx, dy, dz = direction[j, 0] - x, direction[j, 1] - y, direction[j, 2] - z
            distance2 = dx * dx + dy * dy + dz * dz
            least2 = min(least2, distance2)
            total += charge[i] * charge[j] / np.sqrt(max(distance2, 1e-18))
    return total, np.sqrt(least2)


@kernel
def _energy_and_gradient(flat: Array, charge: Array) -> tuple[float, Array]:
    n = len(flat) // 3
    points = flat.reshape(n, 3)
    length = np.empty(n)
    direction = np.empty((n, 3))
    for i in range(n):
        length[i] = np.sqrt(points[i, 0] ** 2 + points[i, 1] ** 2 + points[i, 2] ** 2)
        direction[i] = points[i] / length[i]
    pull = np.zeros((n, 3))
    total = 0.0
    for i in range(n):
        for j in range(i + 1, n):
            dx = direction[i, 0] - direction[j, 0]
            dy = direction[i, 1] - direction[j, 1]
            dz = direction[i, 2] - direction[j, 2]
            inverse = 1.0 / np.sqrt(max(dx * dx + dy * dy + dz * dz, 1e-18))
            both = charge[i] * charge[j]
            total += both * inverse
            cube = both * inverse * inverse * inverse
            pull[i, 0] -= dx * cube
            pull[i, 1] -= dy * cube
            pull[i, 2] -= dz * cube
            pull[j, 0] += dx * cube
            pull[j, 1] += dy * cube
            pull[j, 2] += dz * cube
    gradient = np.empty(3 * n)
    for i in range(n):
        along = pull[i, 0] * direction[i, 0] + pull[i, 1] * direction[i, 1] + pull[i, 2] * direction[i, 2]
        for axis in range(3):
            gradient[3 * i + axis] = (pull[i, axis] - direction[i, axis] * along) / length[i]
    return total, gradient
