"""One MAVLink frame, without I/O: its message, the few contents that are read, and its signature.

MAVLink 2 cuts trailing zeros off a payload: a missing byte is 0. Signatures:
https://mavlink.io/en/guide/message_signing.html.
"""

import hmac
from collections.abc import Callable, Mapping
from enum import Enum, auto
from hashlib import sha256
from struct import unpack_from
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega, development

from gcs.mavlink.kernels import MAGIC_1, MAGIC_2, SIGNATURE_LENGTH, SIGNED
from gcs.mavlink.signing_time import TIME_MAX, UNITS_PER_S

MESSAGES: Final[Mapping[int, Any]] = MappingProxyType(
    {**ardupilotmega.mavlink_map, **development.mavlink_map}
)
"""pymavlink's class of every message that is read, by message id."""

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
TIMESYNC: Final = 111
RADIO_STATUS: Final = 109
RADIO: Final = 166
"""These two are a telemetry radio's own, under whatever number it sends them."""
SET_POSITION_TARGET_LOCAL_NED: Final = 84
BATTERY_STATUS: Final = 147
AUTOPILOT_VERSION: Final = 148
EKF_STATUS_REPORT: Final = 193
EXTENDED_SYS_STATE: Final = 245
NAMED_VALUE_FLOAT: Final = 251
STATUSTEXT: Final = 253
ODOMETRY: Final = 331

SETPOINT_MESSAGES: Final = frozenset({69, 70, 82, SET_POSITION_TARGET_LOCAL_NED, 86, 139})
"""Messages that move a vehicle while they are repeated: MANUAL_CONTROL, RC_CHANNELS_OVERRIDE,
SET_ATTITUDE_TARGET, SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT, SET_ACTUATOR_CONTROL_TARGET.
"""

SET_MESSAGE_INTERVAL: Final = 511
REQUEST_MESSAGE: Final = 512
REQUEST_AUTOPILOT_CAPABILITIES: Final = 520
_REQUESTING_COMMANDS: Final = frozenset(
    {SET_MESSAGE_INTERVAL, REQUEST_MESSAGE, REQUEST_AUTOPILOT_CAPABILITIES}
)
"""Commands that move nothing."""

PREARM_CHECK: Final = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
AHRS: Final = 0x200000  # the estimator; PX4 reports only its health
GEOFENCE: Final = 0x100000
"""The autopilot's own fence: unhealthy while it is breached."""
SENSORS: Final = 0x2F
"""Gyroscope, accelerometer, magnetometer, barometer, GPS: healthy, or not enabled."""

UNIX_KNOWN_S: Final = 1_234_567_890
"""PX4 trusts its clock from this time on, and reports 0 before."""
NO_AUTOPILOT: Final = int(development.MAV_AUTOPILOT_INVALID)
"""In the heartbeats of all components but autopilots."""

_ARMED: Final = 0x80
_BASE_MODE_AT: Final = 6  # in HEARTBEAT
PARAM_VALUE: Final = 22
FAILSAFE_STATES: Final = (5, 6)
"""MAV_STATE_CRITICAL and _EMERGENCY: autopilots report these while a failsafe of their own acts."""
UNKNOWN_DILUTION: Final = 0xFFFF
METRES_PER_DILUTION: Final = (1.3, 1.6)
"""For receivers that report no accuracy (eph and epv are dilutions times 100): as PX4's recorded 0.9 m and
1.78 m go with its 0.70 and 1.10.
"""


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
    return frame.payload.ljust(MESSAGES[frame.message_id].unpacker.size, b"\0")


def is_armed(frame: Frame) -> bool:
    return len(frame.payload) > _BASE_MODE_AT and bool(frame.payload[_BASE_MODE_AT] & _ARMED)


def status_text(frame: Frame) -> TextChunk:
    """Read a STATUSTEXT; the text is usually UTF-8, not always, and may be cut within a character."""
    severity, text, text_id, chunk = unpack_from("<B50sHB", _padded(frame))
    shown = text.split(b"\0", 1)[0]
    return TextChunk(severity, shown, text_id, chunk, last=text_id == 0 or len(shown) < len(text))


_STREAM_LATE_UNITS: Final = 60 * UNITS_PER_S
"""The first signature of a sender may be this much behind the newest time known, as the standard says."""

_STREAMS_MAX: Final = 4096
_HASH_BYTES: Final = 6


class Judgement(Enum):
    """Result of checking a frame's signature."""

    GOOD = auto()
    UNSIGNED = auto()
    WRONG = auto()
    REPLAYED = auto()


class Signer:
    """Signs sent frames, each later than the last; judges received ones, each later than its sender's last.

    One thread at a time for `sign`, one for `judge`; both may run at once, for each writes a time of its own.
    """

    def __init__(self, key: bytes, link_id: int, *, start: int, clock: Callable[[], int]) -> None:
        """No signature will be older than `start`. `clock` gives the present time, as `signing_time` does."""
        self._key = key
        self._link_id = link_id
        self._clock = clock
        self._sent_time = start
        self._received_time = 0
        self._streams: dict[tuple[int, int, int], int] = {}

    def begin(self, start: int) -> None:
        """Sign nothing older than `start` from now on. Before `sign` is called, or between two calls."""
        self._sent_time = max(self._sent_time, start)

    @property
    def time(self) -> int:
        """The newest time used or received; the next signature is newer."""
        return max(self._sent_time, self._received_time)

    def sign(self, raw: bytes) -> bytes | None:
        """One whole frame, signed; unchanged if it was signed, None when its CRC extra byte is unknown.

        MAVLink 1 has no signatures: such a frame becomes MAVLink 2.
        """
        if raw[0] == MAGIC_1:
            raw = _as_version_2(raw)
        if raw[2] & SIGNED:
            return raw
        message = MESSAGES.get(int.from_bytes(raw[7:10], "little"))
        if message is None:
            return None
        body = bytes((*raw[1:2], raw[2] | SIGNED, *raw[3:10])) + raw[10:-2]
        checksum: int = development.x25crc(body + bytes((message.crc_extra,))).crc
        # our clock may be behind the vehicles': our signatures must not look old to them
        self._sent_time = min(TIME_MAX, max(self._sent_time + 1, self._received_time + 1, self._clock()))
        stamp = bytes((self._link_id,)) + self._sent_time.to_bytes(6, "little")
        signed = bytes((MAGIC_2,)) + body + checksum.to_bytes(2, "little") + stamp
        return signed + sha256(self._key + signed).digest()[:_HASH_BYTES]

    def judge(self, frame: Frame) -> Judgement:
        """Whether a frame with the right checksum comes from a holder of the key, for the first time."""
        if not is_signed(frame):
            return Judgement.UNSIGNED
        raw = frame.raw
        expected = sha256(self._key + raw[:-_HASH_BYTES]).digest()[:_HASH_BYTES]
        if not hmac.compare_digest(expected, raw[-_HASH_BYTES:]):
            return Judgement.WRONG
        stamp = raw[-SIGNATURE_LENGTH:-_HASH_BYTES]
        time = int.from_bytes(stamp[1:], "little")
        stream = (frame.system_id, frame.component_id, stamp[0])
        last = self._streams.get(stream)
        if last is None:
            if len(self._streams) >= _STREAMS_MAX or time + _STREAM_LATE_UNITS < self.time:
                return Judgement.REPLAYED
        elif time <= last:
            return Judgement.REPLAYED
        self._streams[stream] = time
        self._received_time = max(self._received_time, time)
        return Judgement.GOOD


def _as_version_2(raw: bytes) -> bytes:
    """The same message as MAVLink 2; its checksum is not yet valid."""
    payload = raw[6:-2].rstrip(b"\0") or raw[6:-2][:1]
    return bytes((MAGIC_2, len(payload), 0, 0, *raw[2:5], raw[5], 0, 0)) + payload + b"\0\0"
