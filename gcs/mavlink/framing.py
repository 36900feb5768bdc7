"""One MAVLink frame, without I/O: its message, and the few contents that are read.

MAVLink 2 cuts trailing zeros off a payload: a missing byte is 0.
"""

from struct import unpack_from
from types import MappingProxyType
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import development as dialect

from gcs.mavlink.kernels import MAGIC_2, SIGNED
from gcs.model.state import Mode

HEARTBEAT: Final = 0
SYS_STATUS: Final = 1
SYSTEM_TIME: Final = 2
SET_MODE: Final = 11
GPS_RAW_INT: Final = 24
ATTITUDE: Final = 30
LOCAL_POSITION_NED: Final = 32
GLOBAL_POSITION_INT: Final = 33
COMMAND_INT: Final = 75
COMMAND_LONG: Final = 76
COMMAND_ACK: Final = 77
RADIO_STATUS: Final = 109
SET_POSITION_TARGET_LOCAL_NED: Final = 84
BATTERY_STATUS: Final = 147
EXTENDED_SYS_STATE: Final = 245
STATUSTEXT: Final = 253
ODOMETRY: Final = 331

SETPOINT_MESSAGES: Final = frozenset({69, 70, 82, SET_POSITION_TARGET_LOCAL_NED, 86, 139})
"""Messages that move a vehicle while they are repeated: MANUAL_CONTROL, RC_CHANNELS_OVERRIDE,
SET_ATTITUDE_TARGET, SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT, SET_ACTUATOR_CONTROL_TARGET.
"""

SET_MESSAGE_INTERVAL: Final = 511
_REQUESTING_COMMANDS: Final = frozenset({SET_MESSAGE_INTERVAL, 512, 520})
"""With REQUEST_MESSAGE and REQUEST_AUTOPILOT_CAPABILITIES: commands that move nothing."""

PREARM_CHECK: Final = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
AHRS: Final = 0x200000  # the estimator; PX4 reports only its health
SENSORS: Final = 0x2F
"""Gyroscope, accelerometer, magnetometer, barometer, GPS: healthy, or not enabled."""

UNIX_KNOWN_S: Final = 1_234_567_890
"""PX4 trusts its clock from this time on, and reports 0 before."""
_ARMED: Final = 0x80
_BASE_MODE_AT: Final = 6  # in HEARTBEAT
PARAM_VALUE: Final = 22
FAILSAFE_STATES: Final = (5, 6)
"""MAV_STATE_CRITICAL and _EMERGENCY: PX4 reports these while its own failsafe acts, never under a pilot."""
FIX_3D: Final = 3
UNKNOWN_DILUTION: Final = 0xFFFF
METRES_PER_DILUTION: Final = (1.3, 1.6)
"""For receivers that report no accuracy (eph and epv are dilutions times 100): as PX4's recorded 0.9 m and
1.78 m go with its 0.70 and 1.10.
"""

_PX4_MODES: Final = MappingProxyType(
    {
        (3, 0): Mode.POSITION,
        (4, 1): Mode.READY,
        (4, 2): Mode.TAKEOFF,
        (4, 3): Mode.HOLD,
        (4, 5): Mode.RETURN,
        (4, 6): Mode.LAND,
        (6, 0): Mode.OFFBOARD,
    }
)


class Frame(NamedTuple):
    """One MAVLink frame; `raw` is all of it, signature included."""

    message_id: int
    system_id: int
    component_id: int
    payload: bytes
    raw: bytes


class TextChunk(NamedTuple):
    """One STATUSTEXT; texts longer than 50 bytes share a `text_id` above 0 and count their chunks."""

    severity: int
    text: bytes
    text_id: int
    chunk: int
    last: bool


def is_signed(frame: Frame) -> bool:
    """Whether the frame has a signature, right or wrong."""
    return frame.raw[0] == MAGIC_2 and bool(frame.raw[2] & SIGNED)


def moves(frame: Frame) -> bool:
    """Whether a frame of ours could make a vehicle move: a setpoint, a mode, or most commands."""
    if frame.message_id in SETPOINT_MESSAGES or frame.message_id == SET_MODE:
        return True
    if frame.message_id not in (COMMAND_INT, COMMAND_LONG):
        return False
    (command,) = unpack_from("<H", _padded(frame), 28)  # after seven parameters of 4 bytes, in both
    return command not in _REQUESTING_COMMANDS


def _padded(frame: Frame) -> bytes:
    return frame.payload.ljust(dialect.mavlink_map[frame.message_id].unpacker.size, b"\0")


def is_armed(frame: Frame) -> bool:
    return len(frame.payload) > _BASE_MODE_AT and bool(frame.payload[_BASE_MODE_AT] & _ARMED)


def px4_mode(custom_mode: int) -> Mode:
    """PX4's custom_mode, main mode << 16 | sub mode << 24, as a Mode; OTHER for modes never commanded."""
    return _PX4_MODES.get((custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF), Mode.OTHER)


def status_text(frame: Frame) -> TextChunk:
    """Read a STATUSTEXT; the text is usually UTF-8, not always, and may be cut within a character."""
    severity, text, text_id, chunk = unpack_from("<B50sHB", _padded(frame))
    shown = text.split(b"\0", 1)[0]
    return TextChunk(severity, shown, text_id, chunk, last=text_id == 0 or len(shown) < len(text))
