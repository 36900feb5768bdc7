"""The messages that vehicles send: one function each, for many vehicles at once. Fields as PX4 v1.16's.

Each function returns the fields by name: (m,) or (m, k) arrays, or one value for all; 0 is left out.
Left out of what a recorded PX4 sends: five messages outside the common dialect, OPEN_DRONE_ID_*,
SERVO_OUTPUT_RAW, VIBRATION, SCALED_PRESSURE, ESTIMATOR_STATUS and POSITION_TARGET_GLOBAL_INT. They would
report parts of a vehicle that a point mass does not have.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pymavlink.dialects.v20 import common

from gcs.sim.protocol.frames import Fields
from gcs.sim.protocol.snapshot import Snapshot as BaseSnapshot
from gcs.sim.vehicle.commander import can_arm
from gcs.sim.vehicle.dynamics import GRAVITY_M_S2, Array, Mask
from gcs.sim.vehicle.px4 import BASE_MODES, CUSTOM_MODES, Mode
from gcs.sim.vehicle.sensors import Batteries
from gcs.sim.vehicle.state import Numbers, Rows
from gcs.sim.vehicle.transitions import Transitions


@dataclass(frozen=True, eq=False)
class Snapshot(BaseSnapshot):
    """m vehicles with PX4."""

    transitions: Transitions
    batteries: Batteries
    fence_ids: Callable[[Rows], Numbers]  # of the stored fences; 0: none

    @property
    def can_arm(self) -> Mask:
        return can_arm(self.state, self.transitions.parameters, self.transitions.quirks)[self.rows]


QUADROTOR, PX4 = 2, 12
STANDBY, ACTIVE, CRITICAL, TERMINATED = 3, 4, 5, 8  # MAV_STATE; PX4 sends 0 where it could not be armed
SENSORS_PRESENT, SENSORS_ENABLED, SENSORS_HEALTHY = 0x300402F, 0x301402F, 0x320C83F
GPS_SENSOR, PREARM_CHECK = 0x20, 0x10000000
NO_FIX = 1  # GPS_FIX_TYPE; 0 is no receiver
ARMED, GUIDED = 128, 16
UNKNOWN_CELL_MV = 65535
THROTTLE_HOVER = 0.5
NAN = math.nan
DEGREES = np.array((1e7, 1e7, 1e3))  # and metres, as messages have them


def _diagonal(*values: float) -> list[float]:
    """The upper triangle of a 6 x 6 covariance of which only the diagonal is known."""
    return [values[row] if row == column else NAN for row in range(6) for column in range(row, 6)]


POSE_COVARIANCE = _diagonal(0.0403, 0.0404, 0.0769, 3.5e-4, 3.6e-4, 0.0155)
VELOCITY_COVARIANCE = _diagonal(0.0084, 0.0084, 0.0045, NAN, NAN, NAN)


def heartbeat(s: Snapshot) -> Fields:
    state, rows = s.state, s.rows
    mode, armed = state.mode[rows], state.armed[rows]
    base_mode = BASE_MODES[mode] | np.where(armed, ARMED, 0)
    unfed = (mode == Mode.OFFBOARD.number) & ~state.setpoint_seen[rows]
    base_mode[unfed] &= ~GUIDED  # nothing is controlled before the first setpoint: recorded as 1, later 17
    status = np.where(s.can_arm, STANDBY, 0)
    status[armed] = ACTIVE
    status[armed & (state.failsafe[rows] | state.intervenes[rows])] = CRITICAL
    status[state.terminated[rows]] = TERMINATED
    return {
        "type": QUADROTOR,
        "autopilot": PX4,
        "base_mode": base_mode,
        "custom_mode": CUSTOM_MODES[mode],
        "system_status": status,
        "mavlink_version": 3,
    }


def sys_status(s: Snapshot) -> Fields:
    """Sensors and battery; the prearm bit is set while arming would be allowed."""
    health = np.where(s.has_fix, SENSORS_HEALTHY, SENSORS_HEALTHY & ~GPS_SENSOR)
    health &= ~s.state.unhealthy_sensors[s.rows]
    return {
        "onboard_control_sensors_present": SENSORS_PRESENT,
        "onboard_control_sensors_enabled": SENSORS_ENABLED,
        "onboard_control_sensors_health": health | np.where(s.can_arm, PREARM_CHECK, 0),
        "load": 80,
        "voltage_battery": s.batteries.voltage_mv()[s.rows],
        "current_battery": -100,
        "battery_remaining": s.batteries.remaining_percent()[s.rows],
        "onboard_control_sensors_health_extended": 1,
    }


def extended_sys_state(s: Snapshot) -> Fields:
    return {"landed_state": s.transitions.landed_state()[s.rows]}


def battery_status(s: Snapshot) -> Fields:
    """The same battery as in SYS_STATUS; current and temperature are not measured, as recorded."""
    voltages_mv = np.full((len(s.rows), 10), UNKNOWN_CELL_MV)
    voltages_mv[:, 0] = s.batteries.voltage_mv()[s.rows]
    return {
        "battery_function": 1,
        "type": 1,
        "temperature": 32767,
        "voltages": voltages_mv,
        "current_battery": -100,
        "energy_consumed": -1,
        "battery_remaining": s.batteries.remaining_percent()[s.rows],
        "charge_state": s.batteries.charge_state()[s.rows],
    }


def attitude(s: Snapshot) -> Fields:
    """Roll and pitch follow from the acceleration; the rates are not modelled."""
    roll_rad, pitch_rad = s.tilt_rad
    return {"time_boot_ms": s.boot_ms, "roll": roll_rad, "pitch": pitch_rad, "yaw": s.yaw_rad}


def attitude_quaternion(s: Snapshot) -> Fields:
    return {"time_boot_ms": s.boot_ms} | _split(("q1", "q2", "q3", "q4"), _quaternion(*s.tilt_rad, s.yaw_rad))


def attitude_target(s: Snapshot) -> Fields:
    """The present attitude: its control loop is part of the response's lag."""
    q = _quaternion(*s.tilt_rad, s.yaw_rad)
    thrust = np.where(s.powered, THROTTLE_HOVER, 0.001)
    return {"time_boot_ms": s.boot_ms, "q": q, "thrust": thrust}


def ping(s: Snapshot) -> Fields:
    """PX4 asks all systems for an echo once a second."""
    s.state.pings[s.rows] += 1
    return {"time_usec": s.boot_us, "seq": s.state.pings[s.rows]}


def system_time(s: Snapshot) -> Fields:
    unix_s = np.where(s.has_fix, s.unix_s + s.state.unix_ahead_s[s.rows], 0.0)  # known from GPS
    return {"time_unix_usec": np.rint(unix_s * 1e6), "time_boot_ms": s.boot_ms}


def timesync(s: Snapshot) -> Fields:
    return {"ts1": s.boot_us * 1000}


class MissionCurrent(common.MAVLink_mission_current_message):  # type: ignore[misc]
    """MISSION_CURRENT with the identities of PX4 from 1.15 on, which pymavlink does not know."""

    native_format = bytearray(b"<HHBBIII")
    ordered_fieldnames = (
        *common.MAVLink_mission_current_message.ordered_fieldnames,
        *("mission_id", "fence_id", "rally_points_id"),
    )
    array_lengths = (0,) * 7


def mission_current(s: Snapshot) -> Fields:
    identities = s.fence_ids(s.rows)
    fields: dict[str, object] = {"total": 65535}
    return fields | {"fence_id": identities} if identities.any() else fields


def position_target_local_ned(s: Snapshot) -> Fields:
    """The velocity that the flown mode demands; positions are not given."""
    fields = {
        "time_boot_ms": s.boot_ms,
        "coordinate_frame": 1,
        "x": NAN,
        "y": NAN,
        "z": NAN,
        "yaw": s.yaw_rad,
    }
    demanded_m_s = np.where(s.state.armed[s.rows, np.newaxis], s.state.demanded_m_s[s.rows], NAN)
    return fields | _split(("vx", "vy", "vz"), demanded_m_s)


def highres_imu(s: Snapshot) -> Fields:
    """Specific force (turned by yaw only), standard air, the recorded place's magnetic field."""
    forward_m_s2, right_m_s2, down_m_s2 = s.body_acceleration_m_s2
    altitude_m = np.where(s.has_fix, np.nan_to_num(s.place[:, 2]), 0.0)
    pressure_pa = 101325.0 * (1.0 - 2.25577e-5 * altitude_m) ** 5.25588  # recorded in Pa, not hPa
    return {
        "time_usec": s.boot_us,
        "xacc": forward_m_s2,
        "yacc": right_m_s2,
        "zacc": down_m_s2 - GRAVITY_M_S2,
        "xmag": 0.2137 * np.cos(s.yaw_rad),
        "ymag": -0.2137 * np.sin(s.yaw_rad),
        "zmag": 0.4234,
        "abs_pressure": pressure_pa,
        "pressure_alt": altitude_m,
        "temperature": 15.0,
        "fields_updated": 511,
    }


def global_position_int(s: Snapshot) -> Fields:
    above_home_m = s.state.home_m[s.rows, 2] - s.position_m[:, 2]
    fields = {"time_boot_ms": s.boot_ms, "relative_alt": np.rint(above_home_m * 1e3), "hdg": s.heading_cdeg}
    return (
        fields
        | _split(("lat", "lon", "alt"), np.rint(s.place * DEGREES))
        | _split(("vx", "vy", "vz"), np.rint(100.0 * s.velocity_m_s))
    )


def local_position_ned(s: Snapshot) -> Fields:
    return (
        {"time_boot_ms": s.boot_ms}
        | _split(("x", "y", "z"), s.position_m)
        | _split(("vx", "vy", "vz"), s.velocity_m_s)
    )


def odometry(s: Snapshot) -> Fields:
    """The same position, with the variances of a recorded one."""
    return {
        "time_usec": s.boot_us,
        "frame_id": 1,
        "child_frame_id": 1,
        "q": _quaternion(*s.tilt_rad, s.yaw_rad),
        **_split(("x", "y", "z"), s.position_m),
        **_split(("vx", "vy", "vz"), s.velocity_m_s),
        "pose_covariance": POSE_COVARIANCE,
        "velocity_covariance": VELOCITY_COVARIANCE,
        "reset_counter": s.state.reset_counter[s.rows],
        "estimator_type": 8,
    }


def altitude(s: Snapshot) -> Fields:
    local_m = -s.position_m[:, 2]
    amsl_m, height_m = s.place[:, 2], s.sensors.height_m[s.rows]
    return {
        "time_usec": s.boot_us,
        "altitude_monotonic": amsl_m,
        "altitude_amsl": amsl_m,
        "altitude_local": local_m,
        "altitude_relative": s.state.home_m[s.rows, 2] + local_m,
        "altitude_terrain": local_m - height_m,
        "bottom_clearance": height_m,
    }


def distance_sensor(s: Snapshot) -> Fields:
    """A rangefinder that looks down, in centimetres."""
    height_cm = np.clip(np.rint(s.sensors.height_m[s.rows] * 100.0), 0, 65535)
    return {
        "time_boot_ms": s.boot_ms,
        "max_distance": 10000,
        "current_distance": height_cm,
        "orientation": 25,
    }


def vfr_hud(s: Snapshot) -> Fields:
    return {
        "groundspeed": s.ground_speed_m_s,
        "heading": np.floor(np.degrees(s.yaw_rad) % 360.0) % 360,
        "throttle": np.where(s.powered, round(100 * THROTTLE_HOVER), 0),
        "alt": s.place[:, 2],
        "climb": -s.velocity_m_s[:, 2],
    }


def gps_raw_int(s: Snapshot) -> Fields:
    """The receiver's own position: it has no part in the estimator's errors, nor in a barometer's scale."""
    received = s.sensors.locate(s.sensors.received_m[s.rows])
    course_deg = np.degrees(np.arctan2(s.velocity_m_s[:, 1], s.velocity_m_s[:, 0]))
    state, rows = s.state, s.rows
    place = _split(("lat", "lon", "alt"), np.rint(received * DEGREES))
    return place | {
        "time_usec": s.boot_us,
        "fix_type": state.fix_type[rows],
        "eph": np.rint(100.0 * state.hdop[rows]),
        "epv": np.rint(100.0 * state.vdop[rows]),
        "vel": np.minimum(np.rint(s.ground_speed_m_s * 100.0), 65534),
        "cog": np.rint(course_deg * 100.0) % 36000,
        "satellites_visible": np.where(state.fix_type[rows] > NO_FIX, 10, 0),
        "alt_ellipsoid": place["alt"],
        "h_acc": np.rint(1e3 * state.horizontal_accuracy_m[rows]),
        "v_acc": np.rint(1e3 * state.vertical_accuracy_m[rows]),
        "vel_acc": 400,
    }


def home_position(s: Snapshot) -> Fields:
    state, rows = s.state, s.rows
    level = np.zeros(len(rows))
    places = np.rint(state.home_place[rows] * DEGREES)
    return {
        **_split(("latitude", "longitude", "altitude"), places),
        **_split(("x", "y", "z"), state.home_m[rows]),
        "q": _quaternion(level, level, state.home_yaw_rad[rows]),
        "time_usec": state.home_boot_ms[rows] * 1000,
    }


def _by_id(*makers: Callable[[Snapshot], Fields]) -> dict[int, Callable[[Snapshot], Fields]]:
    return {getattr(common, f"MAVLINK_MSG_ID_{make.__name__.upper()}"): make for make in makers}


ALWAYS = _by_id(
    *(heartbeat, sys_status, extended_sys_state, battery_status, attitude, attitude_quaternion),
    *(attitude_target, ping, system_time, timesync, mission_current, position_target_local_ned, highres_imu),
)
ALL = ALWAYS | _by_id(
    *(global_position_int, local_position_ned, odometry, altitude, distance_sensor, vfr_hud),
    *(gps_raw_int, home_position),
)


def _split(names: tuple[str, ...], columns: Array) -> dict[str, Array]:
    return {name: columns[:, place] for place, name in enumerate(names)}


def _quaternion(roll_rad: Array, pitch_rad: Array, yaw_rad: Array) -> Array:
    """(m, 4), w first."""
    cr, sr = np.cos(roll_rad / 2), np.sin(roll_rad / 2)
    cp, sp = np.cos(pitch_rad / 2), np.sin(pitch_rad / 2)
    cy, sy = np.cos(yaw_rad / 2), np.sin(yaw_rad / 2)
    parts = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    return np.stack(parts, axis=1)
