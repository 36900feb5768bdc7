"""MAVLink messages of a whole fleet as numpy records, to frames and back. No I/O.

Formats come from pymavlink's message classes, so that no offset is typed by hand, and every frame is byte for
byte pymavlink's (tests/properties/test_codec.py). A record has the fields of the message under its own
names, in the units of its definition.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pymavlink.dialects.v20 import development as dialect

from gcs.mavlink import kernels
from gcs.mavlink.framing import COMMAND_LONG, HEARTBEAT, MESSAGES, SET_POSITION_TARGET_LOCAL_NED, Frame
from gcs.mavlink.kernels import MAGIC_2, Bytes, Number, Whole
from gcs.model.jit import kernel
from gcs.model.state import Array, Mask

Records: TypeAlias = NDArray[np.void]

SYSTEM_ID: Final = 254
"""This station's system id: no vehicle may have it, for theirs end at 250. QGroundControl has 255."""

COMPONENT_ID: Final = 190

HEADER_LENGTH: Final = 12
"""Of a MAVLink 2 frame with its checksum, without the payload."""

_NUMPY: Final = {"b": "i1", "h": "i2", "i": "i4", "q": "i8", "B": "u1", "H": "u2", "I": "u4", "Q": "u8"} | {
    "f": "f4",
    "d": "f8",
    "c": "u1",  # text as bytes: numpy's own strings would lose zeros
}

VELOCITY_AND_YAW: Final = 0x9C7
"""Type mask: velocity and yaw count; the same as MAVSDK's."""

VELOCITY: Final = 0xDC7
"""Type mask: velocity counts; the yaw stays."""

AUTOPILOT_COMPONENT: Final = 1

ARM_DISARM: Final = int(dialect.MAV_CMD_COMPONENT_ARM_DISARM)
_KILL_MAGIC: Final = 21196.0  # param2: also in flight

FLOAT: Final = int(dialect.MAV_PARAM_TYPE_REAL32)
INT32: Final = int(dialect.MAV_PARAM_TYPE_INT32)


class Layout(NamedTuple):
    """Format of one message."""

    message_id: int
    dtype: np.dtype[np.void]
    crc_extra: int


class Frames(NamedTuple):
    """Encoded frames: row i is ``data[i, :length[i]]``."""

    data: Bytes  # (n, longest)
    length: Whole  # (n,)

    def cut(self, count: int) -> "tuple[Frames, Frames]":
        """The first `count`, and those after them."""
        return Frames(self.data[:count], self.length[:count]), Frames(self.data[count:], self.length[count:])


class Split(NamedTuple):
    """A datagram split into frames; every byte is in exactly one of the three."""

    frames: list[Frame]
    garbage_bytes: int
    unknown_bytes: int  # of frames that no CRC can check: the CRC extra byte of their message is unknown


class Found(NamedTuple):
    """Content of a batch of datagrams."""

    frames: Whole  # (k, FRAME_COLUMNS), see `kernels`
    garbage_bytes: int
    unknown_bytes: int


@cache
def layout(message_id: int) -> Layout:
    """Format of one message, extensions included."""
    message: Any = MESSAGES[message_id]
    codes = bytes(message.native_format).decode().lstrip("<")  # one letter a field, in the order of the frame
    fields = [
        (name, "<" + _NUMPY[code], (length,)) if length else (name, "<" + _NUMPY[code])
        for name, code, length in zip(message.ordered_fieldnames, codes, message.array_lengths, strict=True)
    ]
    return Layout(message_id, np.dtype(fields), int(message.crc_extra))


@cache
def _extras() -> NDArray[np.int16]:
    """By message id, the CRC extra byte; -1 where there is no such message."""
    extras = np.full(max(MESSAGES) + 1, -1, dtype=np.int16)
    for message_id, message in MESSAGES.items():
        extras[message_id] = message.crc_extra
    extras.setflags(write=False)
    return extras


def records(message_id: int, count: int) -> Records:
    return np.zeros(count, dtype=layout(message_id).dtype)


def encode(
    message_id: int,
    messages: Records,
    sequence: Bytes,
    *,
    system_id: int | Bytes = SYSTEM_ID,
    component_id: int = COMPONENT_ID,
) -> Frames:
    """Frames of n messages.

    Args:
        message_id: of all messages.
        messages: (n,) as `records` makes them.
        sequence: (n,) sequence number of each frame.
        system_id: of the sender, or of each (n,).
        component_id: of the sender.
    """
    size, n = messages.dtype.itemsize, len(messages)
    payloads = messages.view(np.uint8).reshape(n, size)
    frames, lengths = np.empty((n, size + HEADER_LENGTH), np.uint8), np.empty(n, np.int64)
    extra = layout(message_id).crc_extra
    systems = np.full(n, system_id, np.uint8)
    kernels.put_frames(payloads, message_id, extra, sequence, systems, component_id, frames, lengths)
    return Frames(frames, lengths)


def find(data: Bytes, starts: Whole, lengths: Whole) -> Found:
    """Find every frame in datagrams that is whole, known and has the right checksum.

    Args:
        data: buffer that contains them, flat.
        starts: (m,) of each.
        lengths: (m,) in bytes.
    """
    return Found(*kernels.find_frames(data, starts, lengths, _extras()))


def split(data: bytes) -> Split:
    """Split one datagram as `find` does. Never raises, whatever the bytes."""
    datagram = np.frombuffer(bytearray(data), np.uint8)
    found = find(datagram, np.zeros(1, np.int64), np.array([len(data)]))
    frames = [frame(datagram, each) for each in found.frames.tolist()]
    return Split(frames, found.garbage_bytes, found.unknown_bytes)


@cache
def _target_offset(message_id: int) -> int | None:
    """Offset of the target system in a payload; None for a message without one."""
    dtype = layout(message_id).dtype
    name = next((each for each in ("target_system", "target") if each in (dtype.names or ())), None)
    return None if dtype.fields is None or name is None else dtype.fields[name][1]


def target_system(received: Frame) -> int:
    """The target system of a frame; 0 is all systems, also when the message has no target."""
    offset = _target_offset(received.message_id)
    return 0 if offset is None or offset >= len(received.payload) else received.payload[offset]


def end_of_frames(data: bytes) -> int:
    """Number of bytes of a stream to search for frames; the rest, at most one frame, waits for more bytes."""
    return int(kernels.whole_until(np.frombuffer(bytearray(data), np.uint8), _extras()))


def frame(data: Bytes, found: Sequence[int]) -> Frame:
    payload = data[found[kernels.PAYLOAD] : found[kernels.PAYLOAD] + found[kernels.LENGTH]].tobytes()
    raw = data[found[kernels.BEGIN] : found[kernels.END]].tobytes()
    return Frame(found[kernels.MESSAGE], found[kernels.SYSTEM], found[kernels.COMPONENT], payload, raw)


def joined(raws: Sequence[bytes]) -> Frames:
    length = np.array([len(raw) for raw in raws], np.int64)
    data = np.zeros((len(raws), length.max(initial=0)), np.uint8)
    for at, raw in enumerate(raws):
        data[at, : len(raw)] = np.frombuffer(raw, np.uint8)
    return Frames(data, length)


def decode(message_id: int, data: Bytes, frames: Whole) -> Records:
    """Messages from (k, FRAME_COLUMNS) frames of one kind, as `find` found them in `data`."""
    dtype = layout(message_id).dtype
    payloads = np.empty((len(frames), dtype.itemsize), np.uint8)
    starts, lengths = frames[:, kernels.PAYLOAD], frames[:, kernels.LENGTH]
    kernels.cut_out(data, np.ascontiguousarray(starts), np.ascontiguousarray(lengths), payloads)
    return payloads.view(dtype)[:, 0]


def text(field: Bytes) -> str:
    """A field of characters (length,) up to its first zero."""
    return field.tobytes().split(b"\0", 1)[0].decode(errors="replace")


def text_field(value: str, length: int) -> Bytes:
    """A field of characters (length,), padded with zeros."""
    return np.frombuffer(value.encode()[:length].ljust(length, b"\0"), np.uint8)


def addressed(message_id: int, system_ids: Whole, **fields: ArrayLike) -> Records:
    """Messages to the autopilots of (n,) systems; `fields` by their own names, (n,) or one value for all."""
    messages = records(message_id, len(system_ids))
    for name, values in {"target_component": AUTOPILOT_COMPONENT, **fields}.items():
        messages[name] = values
    messages["target_system"] = system_ids
    return messages


def _boot_ms(time_s: float) -> int:
    """Time of our clock as the field `time_boot_ms`."""
    return int(time_s * 1e3) & 0xFFFFFFFF


def setpoint_messages(
    system_ids: Whole, velocity_ned_m_s: Array, yaw_rad: Array, *, time_s: float
) -> Records:
    """Setpoints: (n, 3) velocities; (n,) yaw, clockwise from north, in [-pi, pi); `time_s` of our clock."""
    one = records(SET_POSITION_TARGET_LOCAL_NED, 1)
    one["time_boot_ms"], one["target_component"] = _boot_ms(time_s), AUTOPILOT_COMPONENT
    one["coordinate_frame"], one["type_mask"] = dialect.MAV_FRAME_LOCAL_NED, VELOCITY_AND_YAW
    messages = one.repeat(len(system_ids))
    messages["target_system"], messages["yaw"] = system_ids, yaw_rad
    for name, velocity_m_s in zip(("vx", "vy", "vz"), velocity_ned_m_s.T, strict=True):
        messages[name] = velocity_m_s
    return messages


def setpoint_frames(
    system_ids: Whole,
    velocity_ned_m_s: Array,
    yaw_rad: Array,
    sequence: Bytes,
    *,
    time_s: float,
    system_id: int = SYSTEM_ID,
    component_id: int = COMPONENT_ID,
) -> Frames:
    """As `encode` of `setpoint_messages`, in one compiled loop."""
    one, n = _setpoint_at_rest(), len(system_ids)
    frames, lengths = np.empty((n, _LONG), np.uint8), np.empty(n, np.int64)
    numbers = _boot_ms(time_s), system_id, component_id
    _put_setpoints(one, system_ids, velocity_ned_m_s, yaw_rad, sequence, *numbers, frames, lengths)
    return Frames(frames, lengths)


@cache
def _setpoint_at_rest() -> Bytes:
    """The payload of a setpoint, all its bytes; what differs between setpoints is 0."""
    no_vehicle = np.zeros(1, np.int64)
    return setpoint_messages(no_vehicle, np.zeros((1, 3)), np.zeros(1), time_s=0.0).view(np.uint8)


def heartbeats(count: int) -> Records:
    messages = records(HEARTBEAT, count)
    messages["type"], messages["autopilot"] = dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID
    messages["system_status"], messages["mavlink_version"] = dialect.MAV_STATE_ACTIVE, 3
    return messages


def kill_message(system_id: int) -> Records:
    """COMMAND_LONG that stops the motors at once, also in flight."""
    return addressed(COMMAND_LONG, np.array([system_id]), command=ARM_DISARM, param2=_KILL_MAGIC)


SETPOINT_FRAME: Final = np.dtype(
    [
        ("magic", "u1"),
        ("length", "u1"),
        ("incompatible", "u1"),  # flags; 1: signed
        ("before_id", "V4"),
        ("message_id", "u1", 3),
        ("message", layout(SET_POSITION_TARGET_LOCAL_NED).dtype),
        ("checksum", "<u2"),
    ]
)
"""A MAVLink 2 frame with a SET_POSITION_TARGET_LOCAL_NED; its last byte is never 0 and so never cut off."""

NO_ROW: Final = -1
_LONG: Final = SETPOINT_FRAME.itemsize
_PAYLOAD_LONG: Final = SETPOINT_FRAME.itemsize - HEADER_LENGTH
_SETPOINT: Final = int(SET_POSITION_TARGET_LOCAL_NED)
_EXTRA: Final = layout(SET_POSITION_TARGET_LOCAL_NED).crc_extra


def _begin_of(field: str) -> int:
    frame = np.zeros(1, SETPOINT_FRAME)
    return frame["message"][field].ctypes.data - frame.ctypes.data


_TARGET_AT: Final = _begin_of("target_system")
_VELOCITY_AT: Final = _begin_of("vx")
_YAW_AT: Final = _begin_of("yaw")
_PAYLOAD_AT: Final = _begin_of("time_boot_ms")


@kernel
def _put_setpoints(
    one: Bytes,
    system_ids: Whole,
    velocity_ned_m_s: Array,
    yaw_rad: Array,
    sequence: Bytes,
    boot_ms: int,
    system_id: int,
    component_id: int,
    frames: Bytes,
    lengths: Whole,
) -> None:
    """As `setpoint_frames`; `one` is the payload of a setpoint at rest, the last two are written."""
    n = len(system_ids)
    payloads, values = np.empty((n, len(one)), np.uint8), np.empty(4, np.float32)
    bits, systems = values.view(np.uint8), np.full(n, system_id, np.uint8)
    for row in range(n):
        for axis in range(3):
            values[axis] = velocity_ned_m_s[row, axis]
        values[3] = yaw_rad[row]
        for at in range(len(one)):
            payloads[row, at] = one[at]
        for at in range(4):
            payloads[row, at] = boot_ms >> 8 * at & 0xFF  # the payload begins with it
        for at in range(12):
            payloads[row, _VELOCITY_AT - _PAYLOAD_AT + at] = bits[at]
        for at in range(4):
            payloads[row, _YAW_AT - _PAYLOAD_AT + at] = bits[12 + at]
        payloads[row, _TARGET_AT - _PAYLOAD_AT] = system_ids[row]
    kernels.put_frames(payloads, _SETPOINT, _EXTRA, sequence, systems, component_id, frames, lengths)


@kernel
def are_setpoints(data: Bytes, length: Whole, count: Number) -> Mask:
    """(count,) whether each of the first `count` datagrams is one unsigned velocity setpoint, whole.

    Args:
        data: (room, longest) bytes of each.
        length: (room,) of each.
        count: number of datagrams.
    """
    are = np.zeros(count, np.bool_)
    for at in range(count):
        message = data[at]
        number = np.int64(message[7]) | np.int64(message[8]) << 8 | np.int64(message[9]) << 16
        whole = length[at] == _LONG and message[0] == MAGIC_2 and message[1] == _PAYLOAD_LONG
        are[at] = whole and message[2] == 0 and number == _SETPOINT
    return are


@kernel
def awaited_setpoints(
    data: Bytes, setpoints: Mask, row_of: Whole, awaited: Mask, velocity: NDArray[np.uint32]
) -> tuple[Whole, Whole]:
    """The setpoints with the awaited velocity; of several equal ones for one vehicle the last.

    Args:
        data: (room, longest) bytes of each datagram.
        setpoints: (k,) which of the first k are setpoints.
        row_of: (256,) the row of each system id, NO_ROW without one.
        awaited: (n,) rows whose setpoint is to leave.
        velocity: (n, 3) awaited velocities, as bits of single-precision numbers.

    Returns: (m,) their places in `data`, and (m,) their rows, all different.
    """
    place = np.full(len(awaited), -1, np.int64)
    rows, found = np.empty(len(awaited), np.int64), 0
    for at in range(len(setpoints)):
        if not setpoints[at]:
            continue
        message = data[at]
        row = row_of[message[_TARGET_AT]]
        if row == NO_ROW or not awaited[row]:
            continue
        same = True
        for axis in range(3):
            bits = np.uint32(0)
            for byte in range(4):
                bits |= np.uint32(message[_VELOCITY_AT + 4 * axis + byte]) << np.uint32(8 * byte)
            same = same and bits == velocity[row, axis]
        if not same:
            continue
        if place[row] < 0:
            rows[found] = row
            found += 1
        place[row] = at
    return place[rows[:found]], rows[:found]


def warm_up() -> None:
    """Compile, or load, the kernels of this module, with the types used in flight."""
    sent = encode(0, records(0, 1), np.zeros(1, np.uint8))
    setpoint_frames(np.ones(1, np.int64), np.zeros((1, 3)), np.zeros(1), np.zeros(1, np.uint8), time_s=0.0)
    data, starts = sent.data.reshape(-1), np.zeros(1, np.int64)
    decode(0, data, find(data, starts, sent.length).frames)
    end_of_frames(data.tobytes())
    data, length, row_of = np.zeros((1, _LONG), np.uint8), np.zeros(1, np.int64), np.zeros(256, np.int64)
    found = are_setpoints(data, length, 1)
    awaited_setpoints(data, found, row_of, np.zeros(1, np.bool_), np.zeros((1, 3), np.uint32))
