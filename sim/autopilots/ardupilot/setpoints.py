"""SET_POSITION_TARGET_LOCAL_NED as ArduCopter takes it in GUIDED (habits 36 to 41)."""

import numpy as np
from numpy.typing import NDArray

from gcs.sim.autopilots.ardupilot.modes import Mode, Submode
from gcs.sim.autopilots.ardupilot.state import ArduState
from gcs.sim.protocol.setpoints import IGNORE_YAW, IGNORE_YAW_RATE, finite, turned
from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.state import Rows

LOCAL_NED, LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED = 1, 7, 8, 9  # MAV_FRAME
POSITION_BITS, VELOCITY_BITS, ACCELERATION_BITS = 0x7, 0x38, 0x1C0
"""Of the mask. A position or velocity with one ignored axis is not given; an acceleration is not taken."""


def store_setpoints(state: ArduState, rows: Rows, messages: NDArray[np.void], position_m: Array) -> None:
    """Store messages (m,), one for each of these rows (m,). Nothing is ever acknowledged or refused.

    Of several for one vehicle the last counts. A velocity cancels a take-off (habit 27). A position counts
    from the EKF's origin, its height from home, whatever LOCAL_POSITION_NED counts from (habit 33). NaN ends
    the process of a vehicle in the air (habit 41).

    Args:
        state: of the fleet.
        rows: (m,).
        messages: (m,).
        position_m: (n, 3), of all vehicles, local NED.
    """
    frame, mask = messages["coordinate_frame"], messages["type_mask"]
    body = (frame == BODY_NED) | (frame == BODY_OFFSET_NED)
    taken = (state.mode[rows] == Mode.GUIDED) & state.armed[rows]
    taken &= body | (frame == LOCAL_NED) | (frame == LOCAL_OFFSET_NED)
    taken &= (mask & ACCELERATION_BITS) == ACCELERATION_BITS
    has_velocity, has_position = taken & (mask & VELOCITY_BITS == 0), taken & (mask & POSITION_BITS == 0)
    velocity_m_s = np.column_stack([messages[name] for name in ("vx", "vy", "vz")]).astype(np.float64)
    place_m = np.column_stack([messages[name] for name in ("x", "y", "z")]).astype(np.float64)
    broken = has_velocity & ~np.isfinite(velocity_m_s).all(axis=1)
    broken |= has_position & ~np.isfinite(place_m).all(axis=1)
    state.dead[rows[broken & state.powered[rows]]] = True
    has_velocity, has_position = has_velocity & ~broken, has_position & ~broken
    heading_rad = state.yaw_rad[rows]
    velocity_m_s[body] = turned(velocity_m_s[body], heading_rad[body])
    place_m[body] = turned(place_m[body], heading_rad[body])
    yaw_rad: Array = np.where(mask & IGNORE_YAW, np.nan, finite(messages["yaw"]))
    yaw_rad[body] += heading_rad[body]
    rate_rad_s = np.where(mask & IGNORE_YAW_RATE, np.nan, finite(messages["yaw_rate"]))
    _follow(state, rows, has_velocity, velocity_m_s)
    relative = frame != LOCAL_NED
    place_m[:, 2] += state.home_m[rows, 2]
    place_m[relative] += position_m[rows[relative]] - (0.0, 0.0, 1.0) * state.home_m[rows[relative]]
    chosen = rows[has_position]
    state.goal_m[chosen] = place_m[has_position]
    state.submode[rows[has_position & ~has_velocity]] = Submode.POSITION
    moving = rows[has_velocity]
    state.setpoint_yaw_rad[moving] = yaw_rad[has_velocity]
    state.setpoint_yaw_rate_rad_s[moving] = rate_rad_s[has_velocity]
    turning = rows[has_velocity & ~(np.isnan(yaw_rad) & np.isnan(rate_rad_s))]
    state.goal_yaw_rad[turning] = np.nan


def _follow(state: ArduState, rows: Rows, chosen: Mask, velocity_m_s: Array) -> None:
    moving = rows[chosen]
    state.setpoint_s[moving] = state.now_s
    state.setpoint_seen[moving] = True
    state.setpoint_velocity_m_s[moving] = velocity_m_s[chosen]
    state.submode[moving] = Submode.VELOCITY
    state.lift_at_s[moving] = np.inf
