"""Yaw of the vehicles. Unknown yaw is never replaced by 0: it is not commanded at all."""

import numpy as np

from gcs.model.frames import wrap_rad
from gcs.model.jit import kernel
from gcs.model.plan import Yaw, YawPolicy
from gcs.model.state import Array, Mask

OVERHEAD_M = 2.0
"""Closer to the target than this, horizontally, its bearing means nothing: yaw is kept."""


def desired_yaw_rad(yaw: Yaw, held_rad: Array, position_m: Array, target_m: Array) -> Array:
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


@kernel
def begun_yaw(commanded: Mask, yaw_rad: Array, held_rad: Array, measured_rad: Array) -> tuple[Array, Array]:
    """Yaw at the start of this tick and at engagement, of the commanded vehicles.

    Args:
        commanded: (n,).
        yaw_rad: (n,) commanded by the previous tick, NaN where not commanded.
        held_rad: (n,) at engagement, NaN where not commanded.
        measured_rad: (n,).

    Returns: (n,) yaw so far and (n,) yaw at engagement; NaN where not commanded. A vehicle that was not
        commanded before starts from its measured yaw.
    """
    so_far_rad, engaged_rad = np.full(len(yaw_rad), np.nan), np.full(len(yaw_rad), np.nan)
    for i in range(len(yaw_rad)):
        if commanded[i]:
            fresh = not np.isfinite(yaw_rad[i])
            so_far_rad[i] = measured_rad[i] if fresh else yaw_rad[i]
            engaged_rad[i] = measured_rad[i] if fresh else held_rad[i]
    return so_far_rad, engaged_rad


@kernel
def turn_towards(yaw_rad: Array, desired_rad: Array, rate_max_rad_s: float, dt_s: float) -> Array:
    """Turn from `yaw_rad` (n,) to `desired_rad` (n,) the short way round, no faster than the rate."""
    turned_rad, most_rad = np.empty_like(yaw_rad), rate_max_rad_s * dt_s
    for i in range(len(yaw_rad)):
        step_rad = (desired_rad[i] - yaw_rad[i] + np.pi) % (2.0 * np.pi) - np.pi
        later_rad = yaw_rad[i] + min(max(step_rad, -most_rad), most_rad)
        turned_rad[i] = (later_rad + np.pi) % (2.0 * np.pi) - np.pi
    return turned_rad
