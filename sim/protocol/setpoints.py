"""SET_POSITION_TARGET_LOCAL_NED of many vehicles at once, as columns, and as PX4 takes it."""

import numpy as np
from numpy.typing import NDArray

from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.state import Rows, State

LOCAL_NED, BODY_NED = 1, 8  # MAV_FRAME
IGNORE_YAW, IGNORE_YAW_RATE = 0x400, 0x800
AXES = 9  # of position, velocity and acceleration: the lowest bits of the mask, in the order of the payload
FIRST_AXIS_AT = 4


def store_setpoints(state: State, rows: Rows, messages: NDArray[np.void]) -> Rows:
    """Store SET_POSITION_TARGET_LOCAL_NED (m,), one for each of these rows (m,), as PX4 does.

    Of several for one vehicle the last counts. A frame other than local or body NED is refused without a
    report. A body frame is turned by the vehicle's yaw; PX4 does not support a position in it, so that is
    dropped. Infinity is treated as NaN.

    Returns: the rows with a setpoint that commands nothing (item 10): they are unchanged.
    """
    frame = messages["coordinate_frame"]
    supported = (frame == LOCAL_NED) | (frame == BODY_NED)
    if not supported.all():
        rows, messages, frame = rows[supported], messages[supported], frame[supported]
    messages_si = axes_given(messages)
    position_m, velocity_m_s, acceleration_m_s2 = messages_si
    mask = messages["type_mask"]
    yaw_rad: Array = np.where(mask & IGNORE_YAW, np.nan, finite(messages["yaw"]))
    body = frame == BODY_NED
    if body.any():
        heading_rad = state.yaw_rad[rows[body]]
        position_m[body] = np.nan
        velocity_m_s[body] = turned(velocity_m_s[body], heading_rad)
        acceleration_m_s2[body] = turned(acceleration_m_s2[body], heading_rad)
        yaw_rad[body] += heading_rad
    given: Mask = ~np.isnan(messages_si)
    says: Mask = np.any(given, axis=(0, 2))
    pairs: Mask = np.equal(given[:, :, 0], given[:, :, 1])  # north and east come together
    flyable: Mask = np.all(pairs, axis=0) & np.all(np.any(given, axis=0), axis=1)
    received = rows if says.all() else rows[says]
    state.setpoint_s[received] = state.now_s
    state.setpoint_seen[received] = True
    state.setpoint_position_m[received] = position_m[says]
    state.setpoint_velocity_m_s[received] = velocity_m_s[says]
    state.setpoint_flyable[received] = flyable[says]
    state.setpoint_yaw_rad[received] = yaw_rad[says]
    rate_rad_s = np.where(mask & IGNORE_YAW_RATE, np.nan, finite(messages["yaw_rate"]))
    state.setpoint_yaw_rate_rad_s[received] = rate_rad_s[says]
    return rows[~says]


def axes_given(messages: NDArray[np.void]) -> Array:
    """(3, m, 3): positions, velocities and accelerations, NaN where an axis is ignored or not a number."""
    raw = messages.view(np.uint8).reshape(len(messages), messages.itemsize)[
        :, FIRST_AXIS_AT : FIRST_AXIS_AT + 4 * AXES
    ]
    values = finite(np.ascontiguousarray(raw).view("<f4"))
    ignored = messages["type_mask"][:, np.newaxis] >> np.arange(AXES, dtype=np.uint16) & 1
    values[ignored != 0] = np.nan
    return np.ascontiguousarray(values.reshape(-1, 3, 3).transpose(1, 0, 2))


def finite(values: NDArray[np.float32]) -> Array:
    values_64 = values.astype(np.float64)
    values_64[~np.isfinite(values_64)] = np.nan
    return values_64


def turned(vector: Array, yaw_rad: Array) -> Array:
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    forward, right, down = vector.T
    return np.stack([cos * forward - sin * right, sin * forward + cos * right, down], axis=1)
