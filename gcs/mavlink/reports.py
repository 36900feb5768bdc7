"""What autopilots report of themselves, read from bytes into columns of the fleet in one compiled loop.

A thousand vehicles send ten messages a second each. Read message by message in the order of arrival, a batch
costs the time of its bytes; with a numpy expression for each field it cost thirty times that.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import development as dialect

from gcs.mavlink import framing
from gcs.mavlink.batteries import BESIDE_PROPULSION, PACKS, Packs, forget_packs, note_percent
from gcs.mavlink.codec import AUTOPILOT_COMPONENT, layout
from gcs.mavlink.kernels import (
    BEGIN,
    COMPONENT,
    FRAME_COLUMNS,
    LENGTH,
    MAGIC_2,
    MESSAGE,
    PAYLOAD,
    Bytes,
    Number,
    Whole,
)
from gcs.mavlink.sample_times import (
    DATED,
    KIND_OF,
    LATE,
    ODOMETRY,
    RESTARTED,
    UNJUDGED,
    Clocks,
    judged,
    note_answer,
    note_position,
)
from gcs.model.jit import kernel, kernel_within
from gcs.model.state import FIX_3D, Array, Landed, Mask

UNKNOWN_MODE, OTHER_MODE, TERMINATED_MODE = -1, -2, -3
"""Custom modes that no autopilot sends: none received yet, one that is not the autopilot's own, and whatever
mode it is in while it is armed and has stopped its motors.
"""

SILENT_AFTER_S: Final = 3.0
"""A system without frames for this long counts as gone: nothing is sent to it, and its address may change. A
heartbeat after a longer pause is a new connection.
"""

_ARMED: Final = int(dialect.MAV_MODE_FLAG_SAFETY_ARMED)
_CUSTOM: Final = int(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
_NO_AUTOPILOT: Final = int(dialect.MAV_AUTOPILOT_INVALID)
_HEADING_MAX_CDEG: Final = 36000  # above: unknown
_LANDED_STATES: Final = len(Landed)
_CRITICAL, _EMERGENCY = framing.FAILSAFE_STATES
_TERMINATED: Final = int(dialect.MAV_STATE_FLIGHT_TERMINATION)
_IN_USE: Final = framing.SENSORS | framing.GEOFENCE
_AHRS, _PREARM = framing.AHRS, framing.PREARM_CHECK
_UNKNOWN_DILUTION: Final = framing.UNKNOWN_DILUTION
_HORIZONTAL_M, _VERTICAL_M = framing.METRES_PER_DILUTION
_UNIX_KNOWN_S: Final = framing.UNIX_KNOWN_S

_BEAT, _STATUS, _TIME = framing.HEARTBEAT, framing.SYS_STATUS, framing.SYSTEM_TIME
_GPS, _GLOBAL, _BATTERY = framing.GPS_RAW_INT, framing.GLOBAL_POSITION_INT, framing.BATTERY_STATUS
_EXTENDED, _ODOMETRY, _TEXT = framing.EXTENDED_SYS_STATE, framing.ODOMETRY, framing.STATUSTEXT
_ESTIMATOR: Final = framing.EKF_STATUS_REPORT
_ATTITUDE: Final = framing.ATTITUDE
_VERSION: Final = framing.AUTOPILOT_VERSION
_SYNC: Final = framing.TIMESYNC


def _at(message_id: int, field: str) -> int:
    """Offset of a field in the payload."""
    fields = layout(message_id).dtype.fields
    if fields is None:
        raise ValueError(f"message {message_id} has no fields")
    return int(fields[field][1])


_BEAT_MODE, _BEAT_AUTOPILOT = _at(_BEAT, "custom_mode"), _at(_BEAT, "autopilot")
_BEAT_BASE, _BEAT_STATE = _at(_BEAT, "base_mode"), _at(_BEAT, "system_status")
_CLOCK_AT: Final = np.array([_at(message, "time_boot_ms") for message in DATED])
_ODOMETRY_TIME: Final = _at(_ODOMETRY, "time_usec")
_GLOBAL_HEADING: Final = _at(_GLOBAL, "hdg")
_GLOBAL_LAT, _GLOBAL_LON, _GLOBAL_ALT = _at(_GLOBAL, "lat"), _at(_GLOBAL, "lon"), _at(_GLOBAL, "alt")
_GLOBAL_VX, _GLOBAL_VY, _GLOBAL_VZ = _at(_GLOBAL, "vx"), _at(_GLOBAL, "vy"), _at(_GLOBAL, "vz")
_STATUS_ENABLED = _at(_STATUS, "onboard_control_sensors_enabled")
_STATUS_HEALTH = _at(_STATUS, "onboard_control_sensors_health")
_STATUS_PERCENT = _at(_STATUS, "battery_remaining")
_BATTERY_PERCENT, _BATTERY_PACK = _at(_BATTERY, "battery_remaining"), _at(_BATTERY, "id")
_BATTERY_FUNCTION: Final = _at(_BATTERY, "battery_function")
_GPS_FIX, _GPS_EPH, _GPS_EPV = _at(_GPS, "fix_type"), _at(_GPS, "eph"), _at(_GPS, "epv")
_GPS_H_ACC, _GPS_V_ACC, _GPS_ALT = _at(_GPS, "h_acc"), _at(_GPS, "v_acc"), _at(_GPS, "alt")
_TIME_UNIX: Final = _at(_TIME, "time_unix_usec")
_ATTITUDE_AT: Final = np.array([_at(_ATTITUDE, axis) for axis in ("roll", "pitch", "yaw")])
_EXTENDED_LANDED: Final = _at(_EXTENDED, "landed_state")
_ODOMETRY_RESETS: Final = _at(_ODOMETRY, "reset_counter")
_ESTIMATOR_FLAGS: Final = _at(_ESTIMATOR, "flags")
_VERSION_SOFTWARE: Final = _at(_VERSION, "flight_sw_version")
_SYNC_THEIRS, _SYNC_OURS = _at(_SYNC, "tc1"), _at(_SYNC, "ts1")


class Columns(NamedTuple):
    """Newest values of n vehicles, written in place."""

    life_time_s: Array  # (n,) arrival of any message, -inf before; as of the next two
    heartbeat_time_s: Array
    position_time_s: Array
    armed: Mask
    in_failsafe: Mask
    prearm_ok: Mask  # the autopilot's own pre-arm checks pass
    autopilot: Whole  # MAV_AUTOPILOT, -1: none
    custom_mode: Whole
    landed: Whole
    connection_count: Whole  # at first, after a restart, after a silence
    reboot_count: Whole
    position_resets: Whole
    reset_counter: Whole  # -1: none
    unhealthy_sensors: Whole  # -1: not reported
    estimator_flags: Whole  # of EKF_STATUS_REPORT, -1: not reported
    version: Whole  # flight_sw_version, 0: not reported
    version_time_s: Array  # its arrival, -inf before
    fix_type: Array
    clock_base_s: Array
    accuracy_m: Array  # (n, 2) horizontal, vertical; inf without a fix
    gnss_altitude_m: Array  # AMSL; NaN without a fix
    place: Array  # (n, 3) degrees, degrees, m AMSL
    velocity_ned_m_s: Array  # (n, 3)
    yaw_deg: Array
    attitude_rad: Array  # (n, 3) roll, pitch, yaw
    attitude_time_s: Array  # (n,) its arrival, -inf before
    changes: Whole  # (1,) of values that seldom change: modes, states, counters, first positions

    @staticmethod
    def unknown(n: int) -> "Columns":
        """Nothing received."""
        return Columns(
            life_time_s=np.full(n, -np.inf),
            heartbeat_time_s=np.full(n, -np.inf),
            position_time_s=np.full(n, -np.inf),
            armed=np.zeros(n, np.bool_),
            in_failsafe=np.zeros(n, np.bool_),
            prearm_ok=np.zeros(n, np.bool_),
            autopilot=np.full(n, -1, np.int64),
            custom_mode=np.full(n, UNKNOWN_MODE, np.int64),
            landed=np.zeros(n, np.int64),
            connection_count=np.zeros(n, np.int64),
            reboot_count=np.zeros(n, np.int64),
            position_resets=np.zeros(n, np.int64),
            reset_counter=np.full(n, -1, np.int64),
            unhealthy_sensors=np.full(n, -1, np.int64),
            estimator_flags=np.full(n, -1, np.int64),
            version=np.zeros(n, np.int64),
            version_time_s=np.full(n, -np.inf),
            fix_type=np.full(n, np.nan),
            clock_base_s=np.full(n, np.nan),
            accuracy_m=np.full((n, 2), np.nan),
            gnss_altitude_m=np.full(n, np.nan),
            place=np.full((n, 3), np.nan),
            velocity_ned_m_s=np.full((n, 3), np.nan),
            yaw_deg=np.full(n, np.nan),
            attitude_rad=np.full((n, 3), np.nan),
            attitude_time_s=np.full(n, -np.inf),
            changes=np.zeros(1, np.int64),
        )


@kernel_within
def _unsigned(data: Bytes, place: Number, end: Number, size: int) -> np.int64:
    """Little-endian field at `place`; bytes from `end` on were zeros and have been left out."""
    value = np.int64(0)
    for at in range(min(size, end - place)):
        value |= np.int64(data[place + at]) << (8 * at)
    return value


@kernel_within
def _signed(data: Bytes, place: Number, end: Number, size: int) -> np.int64:
    value = _unsigned(data, place, end, size)
    half = np.int64(1) << (8 * size - 1)
    return value - 2 * half if value >= half else value


@kernel_within
def _set(column: NDArray[Any], row: Number, value: Number | bool, changes: Whole) -> None:
    """Set a value that seldom changes."""
    if column[row] != value:
        column[row] = value
        changes[0] += 1


@kernel
def _note_restart(row: Number, into: Columns) -> None:
    """Forget what was known of the time before a restart: it may be wrong."""
    into.reboot_count[row] += 1
    into.connection_count[row] += 1
    into.reset_counter[row] = -1
    into.prearm_ok[row] = False
    into.estimator_flags[row] = -1
    into.changes[0] += 1


@kernel_within
def _note_heartbeat(
    data: Bytes, start: Number, end: Number, row: Number, time_s: float, into: Columns
) -> None:
    """The heartbeat of an autopilot."""
    base = _unsigned(data, start + _BEAT_BASE, end, 1)
    state = _unsigned(data, start + _BEAT_STATE, end, 1)
    mode = _unsigned(data, start + _BEAT_MODE, end, 4)
    is_new = not time_s - into.heartbeat_time_s[row] <= SILENT_AFTER_S
    into.connection_count[row] += is_new
    into.changes[0] += is_new
    into.heartbeat_time_s[row] = time_s
    armed = base & _ARMED != 0
    _set(into.autopilot, row, _unsigned(data, start + _BEAT_AUTOPILOT, end, 1), into.changes)
    _set(into.armed, row, armed, into.changes)
    _set(into.in_failsafe, row, armed and state in (_CRITICAL, _EMERGENCY), into.changes)
    if not base & _CUSTOM:
        mode = np.int64(OTHER_MODE)
    if armed and state == _TERMINATED:
        mode = np.int64(TERMINATED_MODE)
    _set(into.custom_mode, row, mode, into.changes)


@kernel_within
def _note_position(
    data: Bytes, start: Number, end: Number, row: Number, time_s: float, into: Columns
) -> None:
    into.changes[0] += np.isnan(into.place[row, 0])
    into.position_time_s[row] = time_s
    into.place[row, 0] = _signed(data, start + _GLOBAL_LAT, end, 4) * 1e-7
    into.place[row, 1] = _signed(data, start + _GLOBAL_LON, end, 4) * 1e-7
    into.place[row, 2] = _signed(data, start + _GLOBAL_ALT, end, 4) * 1e-3
    into.velocity_ned_m_s[row, 0] = _signed(data, start + _GLOBAL_VX, end, 2) * 0.01
    into.velocity_ned_m_s[row, 1] = _signed(data, start + _GLOBAL_VY, end, 2) * 0.01
    into.velocity_ned_m_s[row, 2] = _signed(data, start + _GLOBAL_VZ, end, 2) * 0.01
    heading_cdeg = _unsigned(data, start + _GLOBAL_HEADING, end, 2)
    into.yaw_deg[row] = heading_cdeg * 0.01 if heading_cdeg <= _HEADING_MAX_CDEG else np.nan


@kernel_within
def _single(bits: np.int64) -> float:
    """The number of single precision that has these 32 bits; NaN for one that is not finite."""
    exponent, fraction = bits >> 23 & 0xFF, bits & 0x7FFFFF
    size = fraction * 2.0**-149 if exponent == 0 else (fraction + 0x800000) * 2.0 ** (exponent - 150)
    signed = -size if bits >> 31 else size
    return np.nan if exponent == 0xFF else signed


@kernel_within
def _note_attitude(
    data: Bytes, start: Number, end: Number, row: Number, time_s: float, into: Columns
) -> None:
    into.attitude_time_s[row] = time_s
    for axis in range(3):
        into.attitude_rad[row, axis] = _single(_unsigned(data, start + _ATTITUDE_AT[axis], end, 4))


@kernel_within
def _note_fix(data: Bytes, start: Number, end: Number, row: Number, into: Columns) -> None:
    fix_type = _unsigned(data, start + _GPS_FIX, end, 1)
    into.fix_type[row] = fix_type
    altitude_m = _signed(data, start + _GPS_ALT, end, 4) * 1e-3
    into.gnss_altitude_m[row] = altitude_m if fix_type >= FIX_3D else np.nan
    dilutions = (_unsigned(data, start + _GPS_EPH, end, 2), _unsigned(data, start + _GPS_EPV, end, 2))
    reported = (_unsigned(data, start + _GPS_H_ACC, end, 4), _unsigned(data, start + _GPS_V_ACC, end, 4))
    metres = (_HORIZONTAL_M, _VERTICAL_M)
    for axis in range(2):
        if fix_type < FIX_3D:
            into.accuracy_m[row, axis] = np.inf
        elif reported[axis] != 0:
            into.accuracy_m[row, axis] = reported[axis] / 1000
        elif dilutions[axis] != _UNKNOWN_DILUTION:
            into.accuracy_m[row, axis] = dilutions[axis] / 100 * metres[axis]
        else:
            into.accuracy_m[row, axis] = np.nan


@kernel_within
def _note_sensors(data: Bytes, start: Number, end: Number, row: Number, into: Columns) -> None:
    enabled = _unsigned(data, start + _STATUS_ENABLED, end, 4)
    health = _unsigned(data, start + _STATUS_HEALTH, end, 4)
    _set(into.prearm_ok, row, health & _PREARM != 0, into.changes)
    into.unhealthy_sensors[row] = (enabled & _IN_USE | _AHRS) & ~health


@kernel_within
def _note_resets(data: Bytes, start: Number, end: Number, row: Number, into: Columns) -> None:
    counter = _unsigned(data, start + _ODOMETRY_RESETS, end, 1)
    is_reset = 0 <= into.reset_counter[row] != counter
    into.position_resets[row] += is_reset
    into.changes[0] += is_reset
    into.reset_counter[row] = counter


@kernel_within
def _clock_ms(data: Bytes, start: Number, end: Number, kind: Number) -> np.int64:
    """The autopilot's clock in a message, of 32 bits; -1: it has none."""
    if kind == ODOMETRY:
        since_us = _unsigned(data, start + _ODOMETRY_TIME, end, 8)
        dated = 0 < since_us < _UNIX_KNOWN_S * 1_000_000  # else unknown, or another clock
        return since_us // 1000 & 0xFFFFFFFF if dated else np.int64(-1)
    if kind == UNJUDGED or kind > ODOMETRY:
        return np.int64(-1)
    return _unsigned(data, start + _CLOCK_AT[kind], end, 4)


@kernel
def read_reports(  # noqa: C901, PLR0912, PLR0915  (within one function, no message counts references to the columns)
    data: Bytes, frames: Whole, rows: Whole, time_s: Array, into: Columns, clocks: Clocks, packs: Packs
) -> tuple[Whole, Whole]:
    """Read checked frames in order of arrival. Never fails, whatever they contain.

    Args:
        data: buffer that contains them.
        frames: (k, FRAME_COLUMNS), see `gcs.mavlink.kernels`.
        rows: (k,) vehicle of each.
        time_s: (k,) of arrival.
        into: written, as the next two.
        clocks: when samples were sent.
        packs: the batteries.

    Returns: (b,) places of the heartbeats of autopilots, and (t,) of their status texts.
    """
    beats, texts = np.empty(len(frames), np.int64), np.empty(len(frames), np.int64)
    beat_count, text_count = 0, 0
    for k in range(len(frames)):
        if frames[k, COMPONENT] != AUTOPILOT_COMPONENT:
            continue
        row, message, start = rows[k], frames[k, MESSAGE], frames[k, PAYLOAD]
        end = start + frames[k, LENGTH]
        kind = KIND_OF[message] if message < len(KIND_OF) else UNJUDGED
        number = data[frames[k, BEGIN] + (4 if data[frames[k, BEGIN]] == MAGIC_2 else 2)]
        clock_ms = _clock_ms(data, start, end, kind)
        verdict = judged(row, kind, clock_ms, np.int64(number), time_s[k], into.life_time_s[row], clocks)
        if verdict == LATE:
            continue
        if verdict == RESTARTED:
            _note_restart(row, into)
            forget_packs(row, packs)
        into.life_time_s[row] = time_s[k]
        if message == _GLOBAL:
            _note_position(data, start, end, row, time_s[k], into)
            note_position(row, time_s[k], clocks)
        elif message == _ATTITUDE:
            _note_attitude(data, start, end, row, time_s[k], into)
        elif message == _BEAT:
            if _unsigned(data, start + _BEAT_AUTOPILOT, end, 1) != _NO_AUTOPILOT:
                beats[beat_count] = k
                beat_count += 1
                _note_heartbeat(data, start, end, row, time_s[k], into)
        elif message == _TEXT:
            texts[text_count] = k
            text_count += 1
        elif message == _STATUS:
            _note_sensors(data, start, end, row, into)
            percent = _signed(data, start + _STATUS_PERCENT, end, 1)
            note_percent(row, PACKS, percent, time_s[k], into.armed[row], packs)
        elif message == _BATTERY:
            pack = _unsigned(data, start + _BATTERY_PACK, end, 1)
            percent = _signed(data, start + _BATTERY_PERCENT, end, 1)
            if _unsigned(data, start + _BATTERY_FUNCTION, end, 1) in BESIDE_PROPULSION:
                percent = np.int64(-1)
            note_percent(row, pack, percent, time_s[k], into.armed[row], packs)
        elif message == _EXTENDED:
            landed = _unsigned(data, start + _EXTENDED_LANDED, end, 1)
            _set(into.landed, row, landed if landed < _LANDED_STATES else np.int64(0), into.changes)
        elif message == _GPS:
            _note_fix(data, start, end, row, into)
        elif message == _TIME:
            unix_s = _unsigned(data, start + _TIME_UNIX, end, 8) * 1e-6
            into.clock_base_s[row] = (unix_s if unix_s >= _UNIX_KNOWN_S else np.nan) - time_s[k]
        elif message == _ODOMETRY:
            _note_resets(data, start, end, row, into)
        elif message == _ESTIMATOR:
            flags = _unsigned(data, start + _ESTIMATOR_FLAGS, end, 2)
            _set(into.estimator_flags, row, flags, into.changes)
        elif message == _VERSION:
            into.version_time_s[row] = time_s[k]
            _set(into.version, row, _unsigned(data, start + _VERSION_SOFTWARE, end, 4), into.changes)
        elif message == _SYNC and _unsigned(data, start + _SYNC_THEIRS, end, 8) != 0:  # no request of its own
            note_answer(row, _unsigned(data, start + _SYNC_OURS, end, 8), time_s[k], clocks)
    return beats[:beat_count], texts[:text_count]


def warm_up() -> None:
    """Compile or load the kernels."""
    nothing = np.zeros((0, FRAME_COLUMNS), np.int64)
    nowhere = np.zeros(1, np.uint8), nothing, nothing[:, 0].copy(), np.zeros(0)
    read_reports(*nowhere, Columns.unknown(1), Clocks.unknown(1), Packs.unknown(1))
