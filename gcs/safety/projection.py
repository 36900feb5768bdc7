"""The nearest velocities that break no constraint."""

import numpy as np
from numpy.typing import NDArray

from gcs.safety.constraints import NOBODY, Constraints
from gcs.state import Array

NEARLY_M_S = 1e-6
"""A constraint broken by less than this does not take part."""

TOLERANCE_M_S = 1e-3
"""What the projection may leave broken before rows are shrunk."""

ITERATIONS = 120
"""Of the dual ascent. What it leaves undone, the shrinking afterwards does."""

SHRINKS = 60


def project(wanted_m_s: Array, constraints: Constraints) -> Array:
    """Change the velocities as little as possible (least squares) so that all constraints hold.

    Accelerated projected gradient ascent on the dual (Hildreth's problem; Beck and Teboulle 2009). Only
    constraints that are broken, or near it, take part, and it is repeated while that breaks others.

    Args:
        wanted_m_s: (n, 3), finite.
        constraints: over the same n rows.

    Returns: (n, 3) in m/s. Constraints may still be broken slightly, or where they contradict each other:
        see `shrink`.
    """
    velocity = wanted_m_s
    active = np.zeros(len(constraints), dtype=bool)
    for _ in range(4):
        broken = constraints.slack_m_s(velocity) < -NEARLY_M_S
        if not (broken & ~active).any():
            break
        active |= broken
        velocity = _ascend(wanted_m_s, constraints, np.flatnonzero(active))
    return velocity


def _ascend(wanted_m_s: Array, constraints: Constraints, rows: NDArray[np.intp]) -> Array:
    """Solve for the constraints in `rows` (k,) only."""
    k, flat = len(rows), wanted_m_s.size
    matrix = np.zeros((k, flat))
    first, second = constraints.first[rows], constraints.second[rows]
    column = np.arange(3)
    matrix[np.arange(k)[:, None], first[:, None] * 3 + column] = constraints.normal[rows]
    shared = np.flatnonzero(second != NOBODY)
    matrix[shared[:, None], second[shared, None] * 3 + column] = -constraints.normal[rows[shared]]
    gram = matrix @ matrix.T
    lack = constraints.bound_m_s[rows] - matrix @ wanted_m_s.ravel()
    step = 1.0 / float(np.abs(gram).sum(axis=1).max())
    dual, ahead, momentum = np.zeros(k), np.zeros(k), 1.0
    for _ in range(ITERATIONS):
        later = np.maximum(0.0, ahead + step * (lack - gram @ ahead))
        faster = (1.0 + np.sqrt(1.0 + 4.0 * momentum**2)) / 2.0
        ahead = later + (momentum - 1.0) / faster * (later - dual)
        dual, momentum = later, faster
    solved: Array = wanted_m_s + (dual @ matrix).reshape(wanted_m_s.shape)
    return solved


def shrink(velocity_m_s: Array, constraints: Constraints) -> Array:
    """Scale rows down until every constraint holds that rest itself satisfies.

    Where rest is not enough (something else closes in), the velocity found by the projection is kept: it
    moves away.

    Args:
        velocity_m_s: (n, 3).
        constraints: over the same rows.

    Returns: (n, 3) in m/s, each row shorter or equal.
    """
    mendable = constraints.bound_m_s <= 0.0
    factor = np.ones(len(velocity_m_s))
    for _ in range(SHRINKS):
        scaled = velocity_m_s * factor[:, None]
        broken = np.flatnonzero((constraints.slack_m_s(scaled) < -TOLERANCE_M_S) & mendable)
        if len(broken) == 0:
            return scaled
        first, second = constraints.first[broken], constraints.second[broken]
        np.multiply.at(factor, first, 0.8)
        pair = second != NOBODY
        np.multiply.at(factor, second[pair], 0.8)
        factor[factor < 1e-3] = 0.0
    return velocity_m_s * factor[:, None]
