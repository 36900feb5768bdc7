"""What the vehicle says: one function per message, from one snapshot. Fields as PX4 v1.16 fills them.

Left out of what a recorded PX4 sends: five messages outside the common dialect, OPEN_DRONE_ID_*,
SERVO_OUTPUT_RAW, VIBRATION, SCALED_PRESSURE, ESTIMATOR_STATUS and POSITION_TARGET_GLOBAL_INT. They would
report parts of a vehicle that a point mass does not have.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import common

from sim.dynamics import GRAVITY_M_S2

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sim.battery import Battery
    from sim.commander import Commander
    from sim.mavlink import Message
    from sim.sensed import Sensed, Triple

QUADROTOR, PX4 = 2, 12
STANDBY, ACTIVE, CRITICAL = 3, 4, 5  # MAV_STATE; PX4 says 0 where it could not be armed
SENSORS_PRESENT, SENSORS_ENABLED, SENSORS_HEALTHY = 0x300402F, 0x301402F, 0x320C83F
GPS_SENSOR, PREARM_CHECK = 0x20, 0x10000000
UNKNOWN_CELL_MV = 65535
THROTTLE_HOVER = 0.5
NAN = math.nan
NO_ROTATION = (0.0, 0.0, 0.0, 0.0)


@dataclass(slots=True, frozen=True)
class Home:
    """Where the vehicle was armed, or first had a fix."""

    position_m: Triple  # local NED
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    yaw_rad: float
    boot_ms: int


@dataclass(slots=True, frozen=True)
class Snapshot:
    """Everything the messages are made from."""

    boot_ms: int
    unix_s: float
    sensed: Sensed | None  # None before the first position fix
    home: Home | None
    commander: Commander
    battery: Battery
    yaw_rad: float
    demanded_m_s: Triple
    ping: int

    @property
    def boot_us(self) -> int:
        """The boot clock in microseconds."""
        return self.boot_ms * 1000


def _tilt(snapshot: Snapshot) -> tuple[float, float]:
    """Roll and pitch (rad) that push a point mass the way it accelerates."""
    if snapshot.sensed is None or not snapshot.commander.powered:
        return 0.0, 0.0
    north_m_s2, east_m_s2, down_m_s2 = snapshot.sensed.acceleration_m_s2
    cos, sin = math.cos(snapshot.yaw_rad), math.sin(snapshot.yaw_rad)
    lift_m_s2 = max(GRAVITY_M_S2 - down_m_s2, 1.0)
    forward_m_s2, right_m_s2 = cos * north_m_s2 + sin * east_m_s2, cos * east_m_s2 - sin * north_m_s2
    return math.atan2(right_m_s2, lift_m_s2), -math.atan2(forward_m_s2, lift_m_s2)


def _quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float, float, float]:
    cr, sr = math.cos(roll_rad / 2), math.sin(roll_rad / 2)
    cp, sp = math.cos(pitch_rad / 2), math.sin(pitch_rad / 2)
    cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def _heading_deg(snapshot: Snapshot) -> float:
    return math.degrees(snapshot.yaw_rad) % 360.0


def heartbeat(snapshot: Snapshot) -> Message:
    """Mode, arming, state."""
    commander = snapshot.commander
    base_mode = commander.mode.base_mode | (128 if commander.armed else 0)
    if commander.mode.custom_mode == 6 << 16 and not commander.setpoint_seen:
        base_mode &= ~16  # nothing is controlled before the first setpoint: recorded as 1, later 17
    if commander.failsafe:
        status = CRITICAL
    elif commander.armed:
        status = ACTIVE
    else:
        status = STANDBY if commander.can_arm else 0
    return common.MAVLink_heartbeat_message(QUADROTOR, PX4, base_mode, commander.mode.custom_mode, status, 3)


def sys_status(snapshot: Snapshot) -> Message:
    """Sensors and battery; the prearm bit is set while arming would be allowed."""
    commander, battery = snapshot.commander, snapshot.battery
    health = SENSORS_HEALTHY if snapshot.sensed is not None else SENSORS_HEALTHY & ~GPS_SENSOR
    if commander.can_arm:
        health |= PREARM_CHECK
    volts_mv, left_percent = battery.voltage_mv, battery.remaining_percent
    sensors = (SENSORS_PRESENT, SENSORS_ENABLED, health)
    return common.MAVLink_sys_status_message(
        *sensors, 80, volts_mv, -100, left_percent, 0, 0, 0, 0, 0, 0, 0, 0, 1
    )


def extended_sys_state(snapshot: Snapshot) -> Message:
    """On the ground or not."""
    return common.MAVLink_extended_sys_state_message(0, int(snapshot.commander.landed_state))


def battery_status(snapshot: Snapshot) -> Message:
    """The same battery as in SYS_STATUS; current and temperature are not measured, as recorded."""
    battery = snapshot.battery
    voltages_mv = [battery.voltage_mv, *[UNKNOWN_CELL_MV] * 9]
    left_percent, state = battery.remaining_percent, battery.charge_state
    return common.MAVLink_battery_status_message(
        0, 1, 1, 32767, voltages_mv, -100, 0, -1, left_percent, 0, state, [0] * 4, 0, 0
    )


def attitude(snapshot: Snapshot) -> Message:
    """Roll and pitch follow from the acceleration; the rates are not modelled."""
    roll, pitch = _tilt(snapshot)
    return common.MAVLink_attitude_message(snapshot.boot_ms, roll, pitch, snapshot.yaw_rad, 0.0, 0.0, 0.0)


def attitude_quaternion(snapshot: Snapshot) -> Message:
    """The same attitude."""
    q = _quaternion(*_tilt(snapshot), snapshot.yaw_rad)
    return common.MAVLink_attitude_quaternion_message(snapshot.boot_ms, *q, 0.0, 0.0, 0.0, NO_ROTATION)


def attitude_target(snapshot: Snapshot) -> Message:
    """The attitude as it is: its loop is part of the response's lag."""
    q = _quaternion(*_tilt(snapshot), snapshot.yaw_rad)
    thrust = THROTTLE_HOVER if snapshot.commander.powered else 0.001
    return common.MAVLink_attitude_target_message(snapshot.boot_ms, 0, q, 0.0, 0.0, 0.0, thrust)


def ping(snapshot: Snapshot) -> Message:
    """PX4 asks everyone for an echo once a second."""
    return common.MAVLink_ping_message(snapshot.boot_us, snapshot.ping, 0, 0)


def system_time(snapshot: Snapshot) -> Message:
    """Wall and boot clock."""
    return common.MAVLink_system_time_message(int(snapshot.unix_s * 1e6), snapshot.boot_ms)


def timesync(snapshot: Snapshot) -> Message:
    """A request for the other side's clock."""
    return common.MAVLink_timesync_message(0, snapshot.boot_us * 1000)


def mission_current(_snapshot: Snapshot) -> Message:
    """No mission."""
    return common.MAVLink_mission_current_message(0, 65535, 0, 0)


def position_target_local_ned(snapshot: Snapshot) -> Message:
    """The velocity that the flown mode demands; positions are not given."""
    return common.MAVLink_position_target_local_ned_message(
        snapshot.boot_ms, 1, 0, NAN, NAN, NAN, *snapshot.demanded_m_s, 0.0, 0.0, 0.0, snapshot.yaw_rad, 0.0
    )


def highres_imu(snapshot: Snapshot) -> Message:
    """Specific force (turned by yaw only); standard air; the recorded place's magnetic field."""
    north_m_s2, east_m_s2, down_m_s2 = (0.0, 0.0, 0.0)
    if snapshot.sensed is not None and snapshot.commander.powered:
        north_m_s2, east_m_s2, down_m_s2 = snapshot.sensed.acceleration_m_s2
    cos, sin = math.cos(snapshot.yaw_rad), math.sin(snapshot.yaw_rad)
    altitude_m = snapshot.sensed.altitude_amsl_m if snapshot.sensed is not None else 0.0
    pressure_pa = 101325.0 * (1.0 - 2.25577e-5 * altitude_m) ** 5.25588  # recorded in Pa, not hPa
    return common.MAVLink_highres_imu_message(
        snapshot.boot_us,
        cos * north_m_s2 + sin * east_m_s2,
        cos * east_m_s2 - sin * north_m_s2,
        down_m_s2 - GRAVITY_M_S2,
        *(0.0, 0.0, 0.0),
        *(0.2137 * cos, -0.2137 * sin, 0.4234),
        *(pressure_pa, 0.0, altitude_m, 15.0, 511),
    )


def global_position_int(snapshot: Snapshot, sensed: Sensed, home: Home) -> Message:
    """Position in the world; hdg in centidegrees."""
    above_home_m = home.position_m[2] - sensed.position_m[2]
    cm_s = [round(100.0 * v) for v in sensed.velocity_m_s]
    place = (
        round(sensed.latitude_deg * 1e7),
        round(sensed.longitude_deg * 1e7),
        round(sensed.altitude_amsl_m * 1e3),
    )
    heading_cdeg = round(_heading_deg(snapshot) * 100.0) % 36000
    return common.MAVLink_global_position_int_message(
        snapshot.boot_ms, *place, round(above_home_m * 1e3), *cm_s, heading_cdeg
    )


def local_position_ned(snapshot: Snapshot, sensed: Sensed, _home: Home) -> Message:
    """Position from the vehicle's own origin."""
    return common.MAVLink_local_position_ned_message(
        snapshot.boot_ms, *sensed.position_m, *sensed.velocity_m_s
    )


def odometry(snapshot: Snapshot, sensed: Sensed, _home: Home) -> Message:
    """The same, with the variances of a recorded one."""
    q = _quaternion(*_tilt(snapshot), snapshot.yaw_rad)
    place_variance, turn_variance = (
        _diagonal(0.0403, 0.0404, 0.0769, 3.5e-4, 3.6e-4, 0.0155),
        _diagonal(0.0084, 0.0084, 0.0045, NAN, NAN, NAN),
    )
    return common.MAVLink_odometry_message(
        snapshot.boot_us,
        *(1, 1),
        *sensed.position_m,
        q,
        *sensed.velocity_m_s,
        *(0.0, 0.0, 0.0),
        place_variance,
        turn_variance,
        *(0, 8, 0),
    )


def _diagonal(*values: float) -> list[float]:
    """The upper triangle of a 6 x 6 covariance of which only the diagonal is known."""
    return [values[row] if row == column else NAN for row in range(6) for column in range(row, 6)]


def altitude(snapshot: Snapshot, sensed: Sensed, home: Home) -> Message:
    """Heights over everything."""
    local_m = -sensed.position_m[2]
    above_home_m = home.position_m[2] - sensed.position_m[2]
    amsl_m = sensed.altitude_amsl_m
    terrain_m = local_m - sensed.height_m
    return common.MAVLink_altitude_message(
        snapshot.boot_us, amsl_m, amsl_m, local_m, above_home_m, terrain_m, sensed.height_m
    )


def distance_sensor(snapshot: Snapshot, sensed: Sensed, _home: Home) -> Message:
    """A rangefinder that looks down, in centimetres."""
    height_cm = min(max(round(sensed.height_m * 100.0), 0), 65535)
    return common.MAVLink_distance_sensor_message(
        snapshot.boot_ms, 0, 10000, height_cm, 0, 0, 25, 0, 0.0, 0.0, NO_ROTATION, 0
    )


def vfr_hud(snapshot: Snapshot, sensed: Sensed, _home: Home) -> Message:
    """Speeds and heading; no airspeed sensor."""
    throttle = round(100 * THROTTLE_HOVER) if snapshot.commander.powered else 0
    heading_deg = int(_heading_deg(snapshot)) % 360
    return common.MAVLink_vfr_hud_message(
        0.0, sensed.ground_speed_m_s, heading_deg, throttle, sensed.altitude_amsl_m, -sensed.velocity_m_s[2]
    )


def gps_raw_int(snapshot: Snapshot, sensed: Sensed, _home: Home) -> Message:
    """The receiver's fix; here the same place that the estimator believes in."""
    north_m_s, east_m_s, _ = sensed.velocity_m_s
    course_cdeg = round(math.degrees(math.atan2(east_m_s, north_m_s)) * 100.0) % 36000
    altitude_mm = round(sensed.altitude_amsl_m * 1e3)
    place = (round(sensed.latitude_deg * 1e7), round(sensed.longitude_deg * 1e7), altitude_mm)
    speed_cm_s = min(round(sensed.ground_speed_m_s * 100.0), 65534)
    return common.MAVLink_gps_raw_int_message(
        snapshot.boot_us, 3, *place, 70, 110, speed_cm_s, course_cdeg, 10, altitude_mm, 900, 1780, 400, 0, 0
    )


def home_position(_snapshot: Snapshot, _sensed: Sensed, home: Home) -> Message:
    """Where RTL leads."""
    place = (
        round(home.latitude_deg * 1e7),
        round(home.longitude_deg * 1e7),
        round(home.altitude_amsl_m * 1e3),
    )
    q = _quaternion(0.0, 0.0, home.yaw_rad)
    return common.MAVLink_home_position_message(
        *place, *home.position_m, q, 0.0, 0.0, 0.0, home.boot_ms * 1000
    )


ALWAYS: Mapping[int, Callable[[Snapshot], Message]] = MappingProxyType(
    {
        common.MAVLINK_MSG_ID_HEARTBEAT: heartbeat,
        common.MAVLINK_MSG_ID_SYS_STATUS: sys_status,
        common.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: extended_sys_state,
        common.MAVLINK_MSG_ID_BATTERY_STATUS: battery_status,
        common.MAVLINK_MSG_ID_ATTITUDE: attitude,
        common.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: attitude_quaternion,
        common.MAVLINK_MSG_ID_ATTITUDE_TARGET: attitude_target,
        common.MAVLINK_MSG_ID_PING: ping,
        common.MAVLINK_MSG_ID_SYSTEM_TIME: system_time,
        common.MAVLINK_MSG_ID_TIMESYNC: timesync,
        common.MAVLINK_MSG_ID_MISSION_CURRENT: mission_current,
        common.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: position_target_local_ned,
        common.MAVLINK_MSG_ID_HIGHRES_IMU: highres_imu,
    }
)
WITH_A_FIX: Mapping[int, Callable[[Snapshot, Sensed, Home], Message]] = MappingProxyType(
    {
        common.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position_int,
        common.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position_ned,
        common.MAVLINK_MSG_ID_ODOMETRY: odometry,
        common.MAVLINK_MSG_ID_ALTITUDE: altitude,
        common.MAVLINK_MSG_ID_DISTANCE_SENSOR: distance_sensor,
        common.MAVLINK_MSG_ID_VFR_HUD: vfr_hud,
        common.MAVLINK_MSG_ID_GPS_RAW_INT: gps_raw_int,
        common.MAVLINK_MSG_ID_HOME_POSITION: home_position,
    }
)


def exists(message_id: int) -> bool:
    """Whether this vehicle can send that message as a stream."""
    return message_id in ALWAYS or message_id in WITH_A_FIX


def report(message_id: int, snapshot: Snapshot) -> Message | None:
    """The message, or None where it does not exist or needs a fix that is not there yet."""
    if message_id in ALWAYS:
        return ALWAYS[message_id](snapshot)
    if message_id in WITH_A_FIX and snapshot.sensed is not None and snapshot.home is not None:
        return WITH_A_FIX[message_id](snapshot, snapshot.sensed, snapshot.home)
    return None
