"""From the velocity a vehicle should have to the setpoint that makes it have it."""

import numpy as np

from gcs.formation.sphere import TINY
from gcs.state import Array


def scale_to_limits(
    velocity_m_s: Array, *, horizontal_max_m_s: float, up_max_m_s: float, down_max_m_s: float
) -> Array:
    """Shorten rows that break a limit until none is broken; a vector is scaled, never bent.

    PX4 clips each axis by itself, which turns the vector.

    Args:
        velocity_m_s: (n, 3), z down. Rows not finite stay so: `gcs.safety` makes them rest.
        horizontal_max_m_s: sideways.
        up_max_m_s: of climbing.
        down_max_m_s: of sinking.

    Returns: (n, 3) in m/s.
    """
    horizontal_m_s = np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1])
    vertical_m_s = velocity_m_s[:, 2]
    vertical_max_m_s = np.where(vertical_m_s < 0.0, up_max_m_s, down_max_m_s)
    factor = np.minimum(
        horizontal_max_m_s / np.maximum(horizontal_m_s, TINY),
        vertical_max_m_s / np.maximum(np.abs(vertical_m_s), TINY),
    )
    scaled: Array = velocity_m_s * np.minimum(1.0, factor)[:, None]
    return scaled


def compensate(
    wanted_m_s: Array,
    measured_m_s: Array,
    acceleration_m_s2: Array,
    *,
    gain: float,
    vertical_gain: float,
    lead_s: float,
) -> Array:
    """Inner loop on the measured velocity, and a lead for the acceleration that is known beforehand.

    It has no state, so nothing winds up when a limit is met.

    Args:
        wanted_m_s: (n, 3) velocity the vehicle should have now.
        measured_m_s: (n, 3) velocity it has.
        acceleration_m_s2: (n, 3) or (3,) wanted acceleration.
        gain: how much of the horizontal velocity error is added to the setpoint; 0 trusts the autopilot.
        vertical_gain: likewise up and down, where PX4 answers three times as fast by itself.
        lead_s: seconds by which the autopilot's answer lags.

    Returns: (n, 3) setpoints in m/s, not yet within limits.
    """
    gains = np.array([gain, gain, vertical_gain])
    setpoint: Array = wanted_m_s + gains * (wanted_m_s - measured_m_s) + lead_s * acceleration_m_s2
    return setpoint


def limit_change(wanted_m_s: Array, before_m_s: Array, acceleration_max_m_s2: float, dt_s: float) -> Array:
    """Follow `wanted_m_s` (n, 3) from `before_m_s` (n, 3) no harder than the acceleration limit."""
    change_m_s = wanted_m_s - before_m_s
    size_m_s = np.linalg.norm(change_m_s, axis=1, keepdims=True)
    followed: Array = before_m_s + change_m_s * np.minimum(
        1.0, acceleration_max_m_s2 * dt_s / np.maximum(size_m_s, TINY)
    )
    return followed
