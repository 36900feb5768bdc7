"""MAVLink as bytes, without I/O: frames in datagrams, their target, and the few contents that are read.

Formats come from pymavlink's message classes, so that no offset is typed by hand. MAVLink 2 cuts trailing
zeros off a payload: a missing byte is 0. Layout of both versions:
https://mavlink.io/en/guide/serialization.html
"""

import re
import sys
from binascii import crc_hqx
from collections.abc import Iterable
from functools import cache
from struct import Struct, calcsize, unpack_from
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import development as dialect

from gcs.model.state import Mode

HEARTBEAT: Final = 0
SYS_STATUS: Final = 1
SYSTEM_TIME: Final = 2
PING: Final = 4
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

_TARGET_FIELDS: Final = ("target_system", "target")  # the latter in MANUAL_CONTROL only
_MAGIC_1: Final = 0xFE
_MAGIC_2: Final = 0xFD
_SIGNED: Final = 0x01
_SIGNATURE_LENGTH: Final = 13
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


class Split(NamedTuple):
    """A datagram split into frames; every byte is in exactly one of the three."""

    frames: list[Frame]
    garbage_bytes: int
    unknown_bytes: int  # of frames that may be right, but of messages whose CRC extra byte is unknown


class TextChunk(NamedTuple):
    """One STATUSTEXT; texts longer than 50 bytes share a `text_id` above 0 and count their chunks."""

    severity: int
    text: bytes
    text_id: int
    chunk: int
    last: bool


def _layouts() -> Iterable[tuple[int, int, int | None]]:
    """Per message: id, CRC extra byte, offset of target_system in the payload."""
    classes: dict[int, Any] = dialect.mavlink_map
    for message_id, message in classes.items():
        names: list[str] = message.ordered_fieldnames
        place = next((index for index, name in enumerate(names) if name in _TARGET_FIELDS), None)
        offset = None
        if place is not None:
            codes = bytes(message.native_format).decode().lstrip("<")  # one letter a field, in frame order
            before = zip(message.array_lengths[:place], codes[:place], strict=True)
            offset = calcsize("<" + "".join(f"{max(1, length)}{code}" for length, code in before))
        yield message_id, int(message.crc_extra), offset


_CRC_EXTRA: Final = MappingProxyType({message_id: extra for message_id, extra, _ in _layouts()})
_TARGET_OFFSET: Final = MappingProxyType(
    {message_id: offset for message_id, _, offset in _layouts() if offset is not None}
)
_MAGICS: Final = re.compile(rb"[\xfd\xfe]")
_MIRRORED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def checksum(data: bytes) -> int:
    """CRC-16/MCRF4XX, MAVLink's, at the speed of C.

    The standard library has only its mirror image: the same polynomial, most significant bit first.
    Mirroring every input byte and the result converts one to the other (0.3 us a frame, against 8 us for
    pymavlink's loop).
    """
    mirrored = crc_hqx(data.translate(_MIRRORED), 0xFFFF)
    return _MIRRORED[mirrored & 0xFF] << 8 | _MIRRORED[mirrored >> 8]


def _frame_at(data: bytes, start: int, *, checked: bool) -> Frame | None:
    """The frame that begins at `start`, or None when there is none, whole and with the right checksum."""
    room = len(data) - start
    if data[start] == _MAGIC_2 and room >= 12:
        if data[start + 2] & ~_SIGNED:
            return None  # unknown flags may change everything that follows
        length, header = data[start + 1], 10
        end = start + header + length + 2
        message_id = int.from_bytes(data[start + 7 : start + 10], "little")
        system_id, component_id = data[start + 5], data[start + 6]
        tail = _SIGNATURE_LENGTH if data[start + 2] & _SIGNED else 0
    elif data[start] == _MAGIC_1 and room >= 8:
        length, header = data[start + 1], 6
        end = start + header + length + 2
        message_id = data[start + 5]
        system_id, component_id = data[start + 3], data[start + 4]
        tail = 0
    else:
        return None
    if end + tail > len(data):
        return None
    extra = _CRC_EXTRA.get(message_id) if checked else None
    if extra is not None:
        expected = data[end - 2] | data[end - 1] << 8
        if checksum(data[start + 1 : end - 2] + bytes((extra,))) != expected:
            return None
    whole = start == 0 and end + tail == len(data)
    raw = data if whole else data[start : end + tail]
    return Frame(message_id, system_id, component_id, data[start + header : end - 2], raw)


def split(data: bytes, *, checked: bool = True, garbage_max_bytes: int = sys.maxsize) -> Split:
    """Split one datagram into frames. Never raises, whatever the bytes.

    Args:
        data: one datagram, or several frames end to end.
        checked: leave out frames with a wrong checksum, and messages unknown to pymavlink's development
            dialect (PX4 sends some: EVENT, LINK_NODE_STATUS), which cannot be checked. Unchecked is for
            frames that our own side made.
        garbage_max_bytes: the search ends after more garbage and unknown messages than this, since it takes
            time.
    """
    frames: list[Frame] = []
    start, garbage, unknown, unknown_end, end = 0, 0, 0, 0, len(data)
    while start < end and garbage + unknown <= garbage_max_bytes:
        if data[start] in (_MAGIC_1, _MAGIC_2):
            frame = _frame_at(data, start, checked=checked)
            if frame is not None:
                behind = start + len(frame.raw)
                if not checked or frame.message_id in _CRC_EXTRA:
                    frames.append(frame)
                    start = behind
                    continue
                if behind == end or data[behind] in (_MAGIC_1, _MAGIC_2):
                    unknown_end = behind
        # Continue at the next possible start, not at this one's end: the length itself may be wrong.
        found = _MAGICS.search(data, start + 1)
        next_start = end if found is None else found.start()
        of_unknown = max(0, min(unknown_end, next_start) - start)
        unknown += of_unknown
        garbage += next_start - start - of_unknown
        start = next_start
    return Split(frames, garbage + end - start, unknown)


def is_signed(frame: Frame) -> bool:
    """Whether the frame has a signature, right or wrong."""
    return frame.raw[0] == _MAGIC_2 and bool(frame.raw[2] & _SIGNED)


def crc_extra(message_id: int) -> int | None:
    """The CRC extra byte of a message; None when the message is unknown."""
    return _CRC_EXTRA.get(message_id)


def target_system(frame: Frame) -> int:
    """The target system of a frame; 0 is all systems, also when the message has no target."""
    offset = _TARGET_OFFSET.get(frame.message_id)
    if offset is None or offset >= len(frame.payload):
        return 0
    return frame.payload[offset]


@cache
def _layout(message_id: int) -> Struct:
    unpacker: Struct = dialect.mavlink_map[message_id].unpacker
    return unpacker


def moves(frame: Frame) -> bool:
    """Whether a frame of ours could make a vehicle move: a setpoint, a mode, or most commands."""
    if frame.message_id in SETPOINT_MESSAGES or frame.message_id == SET_MODE:
        return True
    if frame.message_id not in (COMMAND_INT, COMMAND_LONG):
        return False
    (command,) = unpack_from("<H", _padded(frame), 28)  # after seven parameters of 4 bytes, in both
    return command not in _REQUESTING_COMMANDS


def _padded(frame: Frame) -> bytes:
    """The payload with the zeros restored that MAVLink 2 cut off."""
    return frame.payload.ljust(_layout(frame.message_id).size, b"\0")


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
