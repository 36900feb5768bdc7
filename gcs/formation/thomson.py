"""The best shapes known: N unit charges on a unit sphere (the Thomson problem)."""

from math import sqrt
from typing import Final

import numpy as np
import scipy  # loads its parts on first use: 30 MB that a flight does not need

from gcs.model.errors import InvalidError
from gcs.model.state import TINY, Array

NEAREST_FACTOR: Final = 3.1
"""Smallest nearest-neighbour distance of the best configurations times sqrt(N) / R, N = 4 to 128."""

NEAREST_FACTOR_FEW: Final = {2: 2.0 * sqrt(2.0), 3: 3.0}
"""The same for a pair (2 R apart) and a triangle (sqrt(3) R)."""


def energy(direction: Array) -> float:
    """Coulomb energy of unit charges at (n, 3) unit vectors: the sum of 1 / distance over pairs."""
    first, second = np.triu_indices(len(direction), 1)
    return float((1.0 / np.linalg.norm(direction[first] - direction[second], axis=1)).sum())


def nearest_m(position_m: Array) -> float:
    """Smallest distance between any two of (n, 3) points, n at least 2; same unit as the points."""
    first, second = np.triu_indices(len(position_m), 1)
    return float(np.linalg.norm(position_m[first] - position_m[second], axis=1).min())


MANY: Final = 100
"""Above this number the shapes of all descents agree within 1e-4: one descent, from a spiral, is enough."""


def best_configuration(count: int, *, starts: int = 20, seed: int = 0) -> Array:
    """The best of several descents from random starts: (count, 3) unit vectors.

    Reaches the best known energy for the N of FACTS, section 1, up to 20 with these starts.

    Raises: InvalidError for fewer than 2.
    """
    if count < 2:
        raise InvalidError("count", count, "at least 2")
    if count > MANY:
        result = scipy.optimize.minimize(
            _descent, _spiral(count).ravel(), jac=True, method="L-BFGS-B", options={"ftol": 1e-9}
        )
        return _normalised(result.x.reshape(count, 3))
    rng = np.random.default_rng(seed)
    found = [
        scipy.optimize.minimize(
            _descent, rng.normal(size=3 * count), jac=True, method="L-BFGS-B", options={"ftol": 1e-14}
        )
        for _ in range(starts)
    ]
    return _normalised(min(found, key=lambda result: float(result.fun)).x.reshape(count, 3))


def _normalised(points: Array) -> Array:
    unit: Array = points / np.linalg.norm(points, axis=1, keepdims=True)
    return unit


def _spiral(count: int) -> Array:
    """(count, 3) unit vectors, one golden angle after the other from pole to pole."""
    index = np.arange(count) + 0.5
    z, angle = 1.0 - 2.0 * index / count, np.pi * (3.0 - 5.0**0.5) * index
    ring = np.sqrt(1.0 - z * z)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def _descent(flat: Array) -> tuple[float, Array]:
    """Energy of the points' directions and its gradient with respect to the points, flattened."""
    points = flat.reshape(-1, 3)
    length = np.linalg.norm(points, axis=1, keepdims=True)
    direction = points / length
    offset = direction[:, None] - direction[None]
    distance = np.linalg.norm(offset, axis=2) + np.diag(np.full(len(points), np.inf))
    pull = -(offset / np.maximum(distance, TINY)[..., None] ** 3).sum(axis=1)
    gradient = (pull - direction * (pull * direction).sum(axis=1, keepdims=True)) / length
    return float((1.0 / distance).sum() / 2), gradient.ravel()


def smallest_radius_m(count: int, separation_m: float) -> float:
    """The smallest sphere on which `count` vehicles settle no closer than `separation_m` to each other."""
    if count < 2:
        return 0.0
    return separation_m * sqrt(count) / NEAREST_FACTOR_FEW.get(count, NEAREST_FACTOR)
