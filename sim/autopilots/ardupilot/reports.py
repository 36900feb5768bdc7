"""The messages that ArduCopter sends: one function each, for many vehicles at once (habit 4).

Each function returns the fields by name: (m,) or (m, k) arrays, or one value for all; 0 is left out.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from pymavlink.dialects.v10 import ardupilotmega as old_dialect
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.sim.autopilots.ardupilot.failsafes import Transitions
from gcs.sim.autopilots.ardupilot.fence import CIRCLE, HEIGHT, POLYGON
from gcs.sim.autopilots.ardupilot.modes import BASE_MODES, NEEDS_POSITION, Submode
from gcs.sim.autopilots.ardupilot.power import Batteries
from gcs.sim.autopilots.ardupilot.response import Copters
from gcs.sim.autopilots.ardupilot.state import ArduState
from gcs.sim.protocol.frames import Fields
from gcs.sim.protocol.snapshot import Snapshot as BaseSnapshot
from gcs.sim.vehicle.commander import LandedState
from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.parameters import Columns
from gcs.sim.vehicle.versions import Version

FORMS: Mapping[int, Any] = MappingProxyType(dialect.mavlink_map)
OLD_FORMS: Mapping[int, Any] = MappingProxyType(old_dialect.mavlink_map)
QUADROTOR, ARDUPILOT, ARMED = 2, 3, 128
STANDBY, ACTIVE, CRITICAL = 3, 4, 5  # MAV_STATE
BOOTING_S = 2.7  # habit 1: state 4 until then
SENSORS, SENSORS_HEALTHY = 0x1361FC2F, 0x1371FC2F
LOGGING, POSITION_CONTROL = 0x1000000, 0x6000  # enabled while armed, and by the mode
PREARM, FENCE_SENSOR = 0x10000000, 0x100000
EKF_STARTING, EKF_BLIND, EKF_LOST, EKF_READY = 1024, 165, 39, 831  # habits 19, 55
BLIND_AFTER_S = 4.04
IGNORES_POSITION, IGNORES_VELOCITY, TAKES_BOTH, IGNORES_REST = 4039, 4088, 4032, 65528  # type_mask
MULTICOPTER = 3  # MAV_VTOL_STATE
HOVER_PWM, IDLE_PWM, OFF_PWM, HOVER_PERCENT = 1569, 1096, 1000, 39
STICKS_PWM = {"chan1_raw": 1500, "chan2_raw": 1500, "chan3_raw": 1000, "chan4_raw": 1500, "chan5_raw": 1800}
SWITCHES_PWM = {"chan6_raw": 1000, "chan7_raw": 1000, "chan8_raw": 1800}
UNKNOWN_CELL_MV = 65535
HEIGHT_BREACH, BOUNDARY_BREACH = 2, 3  # FENCE_BREACH
DEGREES, GLOBAL = np.array((1e7, 1e7, 1e3)), np.array((1e7, 1e7, 1.0))


@dataclass(frozen=True, eq=False)
class Snapshot(BaseSnapshot):
    """m vehicles with ArduCopter."""

    state: ArduState
    parameters: Columns
    transitions: Transitions
    batteries: Batteries
    bodies: Copters
    version: Version

    @property
    def has_position(self) -> Mask:
        """(m,): the EKF knows where the vehicle is."""
        return self.state.position_ok[self.rows]

    @property
    def from_home_m(self) -> Array:
        """(m, 3): the position relative to home, which moves with arming (habit 32)."""
        return np.nan_to_num(self.position_m - self.state.home_m[self.rows])

    def located(self, local_m: Array) -> Array:
        """(m, 3): latitude, longitude and altitude of places (m, 3), local NED."""
        offset_m = self.sensors.estimate_m[self.rows] - np.nan_to_num(self.position_m)
        return self.sensors.locate(local_m + offset_m)


def heartbeat(s: Snapshot) -> Fields:
    state, rows = s.state, s.rows
    on_ground = s.transitions.landed_state()[rows] == LandedState.ON_GROUND
    status = np.where(on_ground, STANDBY, ACTIVE)
    status[s.boot_ms < 1e3 * BOOTING_S] = ACTIVE
    status[state.any_failsafe[rows]] = CRITICAL
    return {
        "type": QUADROTOR,
        "autopilot": ARDUPILOT,
        "base_mode": BASE_MODES[state.mode[rows]] | np.where(state.armed[rows], ARMED, 0),
        "custom_mode": state.mode[rows],
        "system_status": status,
        "mavlink_version": 3,
    }


def sys_status(s: Snapshot) -> Fields:
    """Sensors and battery; the prearm bit is that of the present mode (habit 20).

    A fence without an action is there and not in use: recorded.
    """
    state, rows = s.state, s.rows
    fenced = np.where(s.parameters["FENCE_ENABLE"][rows] > 0, FENCE_SENSOR, 0)
    unused = np.where(NEEDS_POSITION[state.mode[rows]], 0, POSITION_CONTROL)
    disabled = unused | np.where(state.armed[rows], 0, LOGGING)
    guarded = np.where(s.parameters["FENCE_ACTION"][rows] > 0, fenced, 0)
    unhealthy = unused | state.unhealthy_sensors[rows] | np.where(state.prearm_ok[rows], 0, PREARM)
    unhealthy = unhealthy | np.where(state.breach[rows] > 0, FENCE_SENSOR, 0)
    return {
        "onboard_control_sensors_present": SENSORS | fenced,
        "onboard_control_sensors_enabled": SENSORS & ~disabled | guarded,
        "onboard_control_sensors_health": SENSORS_HEALTHY & ~unhealthy,
        "voltage_battery": np.rint(1e3 * s.batteries.voltage_v()[rows]),
        "current_battery": np.rint(1e2 * s.batteries.current_a()[rows]),
        "battery_remaining": s.batteries.remaining_percent()[rows],
    }


def battery_status(s: Snapshot) -> Fields:
    """The first voltage is the whole pack's (habit 52)."""
    voltages_mv = np.full((len(s.rows), 10), UNKNOWN_CELL_MV)
    voltage_v = s.batteries.voltage_v()[s.rows]
    voltages_mv[:, 0] = np.rint(1e3 * voltage_v)
    used_mah = s.batteries.used_mah()[s.rows]
    return {
        "temperature": 32767,
        "voltages": voltages_mv,
        "current_battery": np.rint(1e2 * s.batteries.current_a()[s.rows]),
        "current_consumed": np.rint(used_mah),
        "energy_consumed": np.rint(0.036 * used_mah * voltage_v),
        "battery_remaining": s.batteries.remaining_percent()[s.rows],
    }


def extended_sys_state(s: Snapshot) -> Fields:
    return {"vtol_state": MULTICOPTER, "landed_state": s.transitions.landed_state()[s.rows]}


def system_time(s: Snapshot) -> Fields:
    lost_s = (s.state.now_s - s.state.boot_s[s.rows]) * (1.0 - s.state.clock_rate[s.rows])  # simulated time
    unix_s = np.where(s.has_fix, s.unix_s + s.state.unix_ahead_s[s.rows] - lost_s, 0.0)  # known from GPS
    return {"time_unix_usec": np.rint(unix_s * 1e6), "time_boot_ms": s.boot_ms}


def timesync(s: Snapshot) -> Fields:
    return {"ts1": s.boot_us * 1000 + s.state.system_id[s.rows]}


def attitude(s: Snapshot) -> Fields:
    """Roll and pitch follow from the acceleration; the rates are not modelled."""
    roll_rad, pitch_rad = s.tilt_rad
    return {"time_boot_ms": s.boot_ms, "roll": roll_rad, "pitch": pitch_rad, "yaw": s.yaw_rad}


def global_position_int(s: Snapshot) -> Fields:
    """relative_alt is above home; before the EKF has the position the velocity is 0 (habit 19)."""
    velocity_m_s = np.where(s.has_position[:, np.newaxis], s.velocity_m_s, 0.0)
    fields = {
        "time_boot_ms": s.boot_ms,
        "relative_alt": np.rint(-1e3 * s.from_home_m[:, 2]),
        "hdg": s.heading_cdeg,
    }
    return (
        fields
        | _split(("lat", "lon", "alt"), np.rint(s.place * DEGREES))
        | _split(("vx", "vy", "vz"), np.rint(100.0 * velocity_m_s))
    )


def local_position_ned(s: Snapshot) -> Fields:
    return (
        {"time_boot_ms": s.boot_ms}
        | _split(("x", "y", "z"), s.from_home_m)
        | _split(("vx", "vy", "vz"), s.velocity_m_s)
    )


def gps_raw_int(s: Snapshot) -> Fields:
    """The receiver's own position: it has no part in the estimator's errors, nor in a barometer's scale."""
    received = s.sensors.locate(s.sensors.received_m[s.rows])
    course_deg = np.degrees(np.arctan2(s.velocity_m_s[:, 1], s.velocity_m_s[:, 0]))
    state, rows = s.state, s.rows
    disabled = s.parameters["SIM_GPS_DISABLE"][rows] > 0
    return _split(("lat", "lon", "alt"), np.rint(received * DEGREES)) | {
        "time_usec": s.boot_us,
        "fix_type": np.where(disabled, 1, state.fix_type[rows]),
        "eph": np.rint(100.0 * state.hdop[rows]),
        "epv": np.rint(100.0 * state.vdop[rows]),
        "vel": np.minimum(np.rint(s.ground_speed_m_s * 100.0), 65534),
        "cog": np.rint(course_deg * 100.0) % 36000,
        "satellites_visible": np.where(disabled, 0, 10),
        "h_acc": np.rint(1e3 * state.horizontal_accuracy_m[rows]),
        "v_acc": np.rint(1e3 * state.vertical_accuracy_m[rows]),
        "vel_acc": 40,
    }


def home_position(s: Snapshot) -> Fields:
    """Always at its own (0, 0, 0), level (habit 34)."""
    state, rows = s.state, s.rows
    places = np.rint(state.home_place[rows] * DEGREES)
    level = np.tile((1.0, 0.0, 0.0, 0.0), (len(rows), 1))
    names = ("latitude", "longitude", "altitude")
    return _split(names, places) | {"q": level, "time_usec": s.boot_us}


def gps_global_origin(s: Snapshot) -> Fields:
    """Where the EKF started: home moves, this does not (habit 34)."""
    place = s.located(np.zeros((len(s.rows), 3)))
    return _split(("latitude", "longitude", "altitude"), np.rint(place * DEGREES)) | {"time_usec": s.boot_us}


def ekf_status_report(s: Snapshot) -> Fields:
    """Instead of ESTIMATOR_STATUS; the variances are those of a recorded one at rest."""
    state, rows = s.state, s.rows
    flags = np.where(s.boot_ms < 1e3 * BLIND_AFTER_S, EKF_STARTING, EKF_BLIND)
    flags[(state.now_s >= state.ready_at_s[rows])] = EKF_LOST
    flags[s.has_position] = EKF_READY
    return {
        "flags": flags,
        "velocity_variance": 0.0095,
        "pos_horiz_variance": 0.0037,
        "pos_vert_variance": 0.0005,
        "compass_variance": 0.021,
    }


def vfr_hud(s: Snapshot) -> Fields:
    return {
        "airspeed": s.ground_speed_m_s,
        "groundspeed": s.ground_speed_m_s,
        "heading": np.floor(np.degrees(s.yaw_rad) % 360.0) % 360,
        "throttle": np.where(s.powered, HOVER_PERCENT, 0),
        "alt": s.place[:, 2],
        "climb": -s.velocity_m_s[:, 2],
    }


def position_target_local_ned(s: Snapshot) -> Fields:
    """What GUIDED follows: the ramp of the velocity, or the place relative to home (habit 38)."""
    state, rows = s.state, s.rows
    sub = state.submode[rows]
    by_velocity = sub == Submode.VELOCITY
    here_m = np.where((sub >= Submode.POSITION)[:, np.newaxis], state.goal_m[rows], s.bodies.target_m[rows])
    place_m = np.where(by_velocity[:, np.newaxis], 0.0, np.nan_to_num(here_m - state.home_m[rows]))
    velocity_m_s = np.where(by_velocity[:, np.newaxis], s.bodies.desired_m_s[rows], 0.0)
    mask = np.where(by_velocity, IGNORES_POSITION, IGNORES_VELOCITY)
    mask[sub == Submode.TAKEOFF] = TAKES_BOTH
    return (
        {"time_boot_ms": s.boot_ms, "coordinate_frame": 1, "type_mask": mask}
        | _split(("x", "y", "z"), place_m)
        | _split(("vx", "vy", "vz"), velocity_m_s)
    )


def position_target_global_int(s: Snapshot) -> Fields:
    """The place that GUIDED or a return flies to."""
    place = s.located(s.state.goal_m[s.rows]) * GLOBAL
    names = ("lat_int", "lon_int", "alt")
    return _split(names, place) | {"time_boot_ms": s.boot_ms, "type_mask": IGNORES_REST}


def servo_output_raw(s: Snapshot) -> Fields:
    """1000 as soon as the motors are stopped (habit 56)."""
    pwm = np.where(s.state.armed[s.rows], np.where(s.powered, HOVER_PWM, IDLE_PWM), OFF_PWM)
    return {"time_usec": s.boot_us} | {f"servo{motor}_raw": pwm for motor in range(1, 5)}


def rc_channels(s: Snapshot) -> Fields:
    return {"time_boot_ms": s.boot_ms, "chancount": 16} | STICKS_PWM | SWITCHES_PWM


def vibration(s: Snapshot) -> Fields:
    shakes = np.where(s.powered, 0.16, 0.002)
    return {"time_usec": s.boot_us} | {f"vibration_{axis}": shakes for axis in "xyz"}


def scaled_imu3(s: Snapshot) -> Fields:
    """The third unit is a compass only."""
    north, east = 236.0 * np.cos(s.yaw_rad), -236.0 * np.sin(s.yaw_rad)
    return {"time_boot_ms": s.boot_ms, "xmag": np.rint(north), "ymag": np.rint(east), "zmag": 393}


def fence_status(s: Snapshot) -> Fields:
    state, rows = s.state, s.rows
    breach = state.breach[rows]
    breached_s = np.where(np.isfinite(state.breach_s[rows]), state.breach_s[rows] - state.boot_s[rows], 0.0)
    return {
        "breach_status": breach > 0,
        "breach_count": state.breach_count[rows],
        "breach_type": np.where(
            breach & (CIRCLE | POLYGON), BOUNDARY_BREACH, np.where(breach & HEIGHT, HEIGHT_BREACH, 0)
        ),
        "breach_time": np.rint(1e3 * breached_s),
        "breach_mitigation": 1,
    }


def autopilot_version(s: Snapshot) -> Fields:
    """The git hash is text, the recorded one, and there is no uid in SITL (habit 7)."""
    return {
        "capabilities": 64495,
        "flight_sw_version": s.version.flight_sw_version,
        "flight_custom_version": np.tile(np.frombuffer(b"01bdf537", np.uint8), (len(s.rows), 1)),
    }


def wind(_s: Snapshot) -> Fields:
    return {}


def _by_id(*makers: Callable[[Snapshot], Fields]) -> dict[int, Callable[[Snapshot], Fields]]:
    return {getattr(dialect, f"MAVLINK_MSG_ID_{make.__name__.upper()}"): make for make in makers}


ALL: Mapping[int, Callable[[Snapshot], Fields]] = MappingProxyType(
    _by_id(
        *(heartbeat, sys_status, battery_status, extended_sys_state, system_time, timesync, attitude),
        *(global_position_int, local_position_ned, gps_raw_int, home_position, gps_global_origin),
        *(ekf_status_report, vfr_hud, position_target_local_ned, position_target_global_int),
        *(servo_output_raw, rc_channels, vibration, scaled_imu3, fence_status, autopilot_version, wind),
    )
)
"""What it can send, by id."""

SILENT = frozenset({27, 29, 35, 42, 62, 116, 125, 133, 136, 150, 152, 163, 164, 165, 178})
"""What the recorded one also knows, of parts that are not here: requests are accepted and bring nothing.
Another id is unknown: "No ap_message for mavlink id"."""


def _split(names: tuple[str, ...], columns: Array) -> dict[str, Array]:
    return {name: columns[:, place] for place, name in enumerate(names)}
