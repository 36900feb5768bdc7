"""Where the vehicles look. Never an accidental 0: unknown yaw is not commanded at all."""

import numpy as np

from gcs.frames import wrap_rad
from gcs.plan import Yaw, YawPolicy
from gcs.state import Array

OVERHEAD_M = 2.0
"""Closer to the target than this, horizontally, its bearing means nothing: yaw is kept."""


def wanted_yaw_rad(yaw: Yaw, held_rad: Array, position_m: Array, target_m: Array) -> Array:
    """The yaw each vehicle should have.

    Args:
        yaw: the policy.
        held_rad: (n,) yaw at engagement, or the last commanded.
        position_m: (n, 3), show frame.
        target_m: (2,), show frame.

    Returns: (n,) from the show's x axis towards y, within [-pi, pi).
    """
    if yaw.policy is YawPolicy.FIXED:
        return wrap_rad(np.full(len(position_m), yaw.fixed_rad))
    if yaw.policy is YawPolicy.HELD:
        return wrap_rad(held_rad)
    offset_m = target_m - position_m[:, :2]
    facing_rad = np.arctan2(offset_m[:, 1], offset_m[:, 0])
    overhead = np.hypot(offset_m[:, 0], offset_m[:, 1]) < OVERHEAD_M
    return wrap_rad(np.where(overhead, held_rad, facing_rad))


def turn_towards(yaw_rad: Array, wanted_rad: Array, rate_max_rad_s: float, dt_s: float) -> Array:
    """Go from `yaw_rad` (n,) to `wanted_rad` (n,) the short way round, no faster than the rate."""
    step_rad = np.clip(wrap_rad(wanted_rad - yaw_rad), -rate_max_rad_s * dt_s, rate_max_rad_s * dt_s)
    return wrap_rad(yaw_rad + step_rad)
