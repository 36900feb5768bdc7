"""The law of a vehicle on a trajectory that was drawn for it. Pure."""

import numpy as np

from gcs.model.state import TINY, Array

KEPT_M_S, LEFT_M_S = 0.5, 1.0
"""A vehicle this near to its trajectory's velocity is led for all of its acceleration; farther off than the
second, for none.
"""


def trajectory_velocity(
    position_m: Array,
    goal_m: Array,
    goal_m_s: Array,
    *,
    rate_per_s: float,
    correction_max_m_s: Array,
    limits_m_s: tuple[float, float, float],
) -> Array:
    """Velocity of the trajectory, plus a correction at which the distance from it decays exponentially.

    Sideways and vertical parts are limited each by itself: a vehicle that cannot climb as fast as its
    trajectory does not fall behind sideways.

    Args:
        position_m: (n, 3), show frame.
        goal_m: (n, 3) where the trajectory is now; NaN: there is none, and the vehicle stops.
        goal_m_s: (n, 3) how it moves.
        rate_per_s: at which the distance decays, while no limit is met.
        correction_max_m_s: (n,) of the correction.
        limits_m_s: sideways, of climbing, of descending.

    Returns: (n, 3) in m/s.
    """
    correction_m_s = rate_per_s * (goal_m - position_m)
    size_m_s = np.linalg.norm(correction_m_s, axis=1, keepdims=True)
    correction_m_s *= np.minimum(1.0, correction_max_m_s[:, None] / np.maximum(size_m_s, TINY))
    horizontal_m_s, up_m_s, down_m_s = limits_m_s
    velocity_m_s: Array = goal_m_s + correction_m_s
    level_m_s = np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1])
    velocity_m_s[:, :2] *= np.minimum(1.0, horizontal_m_s / np.maximum(level_m_s, TINY))[:, None]
    velocity_m_s[:, 2] = np.clip(velocity_m_s[:, 2], -up_m_s, down_m_s)
    return np.where(np.isfinite(velocity_m_s).all(axis=1, keepdims=True), velocity_m_s, 0.0)


def led_share(allowed_m_s: Array, goal_m_s: Array) -> Array:
    """(n, 1) Share of the trajectory's acceleration that is fed forward: 0 for a vehicle that is held back.

    Args:
        allowed_m_s: (n, 3) velocity after the safety filter.
        goal_m_s: (n, 3) velocity of the trajectory.
    """
    off_m_s = np.linalg.norm(allowed_m_s - goal_m_s, axis=1, keepdims=True)
    return np.asarray(np.clip((LEFT_M_S - off_m_s) / (LEFT_M_S - KEPT_M_S), 0.0, 1.0))
