"""SET_POSITION_TARGET_LOCAL_NED of many vehicles at once, as columns, and as PX4 takes it."""

import numpy as np
from numpy.typing import NDArray

from gcs.sim.protocol.frames import SETPOINT_PAYLOAD
from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.state import Rows, State

LOCAL_NED, BODY_NED = 1, 8  # MAV_FRAME
IGNORE_YAW, IGNORE_YAW_RATE = 0x400, 0x800
AS_NUMBERS = np.dtype(
    {"names": ["numbers"], "formats": [("<f4", (11,))], "offsets": [4], "itemsize": SETPOINT_PAYLOAD}
)
"""The payload: nine axes of position, velocity and acceleration, yaw and yaw rate."""

IGNORE_BIT = np.array([1 << bit for bit in (*range(9), 10, 11)], dtype=np.uint16)
"""In the mask; with it each of the numbers is ignored."""


def store_setpoints(state: State, rows: Rows, messages: NDArray[np.void]) -> Rows:
    """Store SET_POSITION_TARGET_LOCAL_NED (m,), one for each of these rows (m,), as PX4 does.

    Of several for one vehicle the last counts. A frame other than local or body NED is refused without a
    report. A body frame is turned by the vehicle's yaw; PX4 does not support a position in it, so that is
    dropped. Infinity is treated as NaN.

    Returns: the rows with a setpoint that commands nothing (item 10): they are unchanged.
    """
    frame = messages["coordinate_frame"]
    supported = (frame == LOCAL_NED) | (frame == BODY_NED)
    if np.count_nonzero(supported) < len(rows):
        rows, messages, frame = rows[supported], messages[supported], frame[supported]
    numbers = numbers_given(messages)
    messages_si = numbers[:, :9].reshape(-1, 3, 3)  # a copy
    position_m, velocity_m_s, acceleration_m_s2 = messages_si[:, 0], messages_si[:, 1], messages_si[:, 2]
    yaw_rad, rate_rad_s = numbers[:, 9], numbers[:, 10]
    body = frame == BODY_NED
    if np.count_nonzero(body):
        heading_rad = state.yaw_rad[rows[body]]
        position_m[body] = np.nan
        velocity_m_s[body] = turned(velocity_m_s[body], heading_rad)
        acceleration_m_s2[body] = turned(acceleration_m_s2[body], heading_rad)
        yaw_rad[body] += heading_rad
    given: Mask = ~np.isnan(messages_si)
    axes: Mask = given[:, 0] | given[:, 1] | given[:, 2]
    says: Mask = np.asarray(axes.any(axis=1))
    pairs: Mask = given[:, :, 0] == given[:, :, 1]  # north and east come together
    flyable: Mask = np.asarray(pairs.all(axis=1) & axes.all(axis=1))
    silent = rows[~says]
    if len(silent):
        rows, position_m, velocity_m_s = rows[says], position_m[says], velocity_m_s[says]
        flyable, yaw_rad, rate_rad_s = flyable[says], yaw_rad[says], rate_rad_s[says]
    state.setpoint_s[rows] = state.now_s
    state.setpoint_seen[rows] = True
    state.setpoint_position_m[rows] = position_m
    state.setpoint_velocity_m_s[rows] = velocity_m_s
    state.setpoint_flyable[rows] = flyable
    state.setpoint_yaw_rad[rows] = yaw_rad
    state.setpoint_yaw_rate_rad_s[rows] = rate_rad_s
    return silent


def numbers_given(messages: NDArray[np.void]) -> Array:
    """(m, 11): axes, yaw and yaw rate, NaN where one is ignored or not a number."""
    numbers: Array = messages.view(AS_NUMBERS)["numbers"].astype(np.float64)
    ignored = messages["type_mask"][:, np.newaxis] & IGNORE_BIT != 0
    numbers[ignored | ~np.isfinite(numbers)] = np.nan
    return numbers


def finite(values: NDArray[np.float32]) -> Array:
    values_64 = values.astype(np.float64)
    values_64[~np.isfinite(values_64)] = np.nan
    return values_64


def turned(vector: Array, yaw_rad: Array) -> Array:
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    forward, right, down = vector.T
    return np.stack([cos * forward - sin * right, sin * forward + cos * right, down], axis=1)
