"""MAVLink messages of a whole fleet as numpy records, to frames and back. No I/O.

Formats come from pymavlink's message classes, so that no offset is typed by hand, and every frame is byte for
byte pymavlink's (tests/properties/test_codec.py). A record has the fields of the message under its own
names, in the units of its definition.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pymavlink.dialects.v20 import development as dialect

from gcs.mavlink import kernels
from gcs.mavlink.framing import COMMAND_LONG, HEARTBEAT, MESSAGES, Frame
from gcs.mavlink.kernels import Bytes, Whole

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


def offset(message_id: int, field: str) -> int:
    """Place of a field in the payload."""
    fields: Mapping[str, Any] = layout(message_id).dtype.fields or {}
    return int(fields[field][1])


@cache
def extras() -> NDArray[np.int16]:
    """By message id, the CRC extra byte; -1 where there is no such message."""
    of_messages = np.full(max(MESSAGES) + 1, -1, dtype=np.int16)
    for message_id, message in MESSAGES.items():
        of_messages[message_id] = message.crc_extra
    of_messages.setflags(write=False)
    return of_messages


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
    return Found(*kernels.find_frames(data, starts, lengths, extras()))


def split(data: bytes) -> Split:
    """Split one datagram as `find` does. Never raises, whatever the bytes."""
    datagram = np.frombuffer(bytearray(data), np.uint8)
    checked = find(datagram, np.zeros(1, np.int64), np.array([len(data)]))
    frames = [frame(datagram, each) for each in checked.frames.tolist()]
    return Split(frames, checked.garbage_bytes, checked.unknown_bytes)


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


def frame(data: Bytes, columns: Sequence[int]) -> Frame:
    payload = data[columns[kernels.PAYLOAD] : columns[kernels.PAYLOAD] + columns[kernels.LENGTH]].tobytes()
    raw = data[columns[kernels.BEGIN] : columns[kernels.END]].tobytes()
    return Frame(columns[kernels.MESSAGE], columns[kernels.SYSTEM], columns[kernels.COMPONENT], payload, raw)


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


def answers(acks: Records, system_id: int, component_id: int) -> NDArray[np.bool_]:
    """(k,) which COMMAND_ACKs may answer a command of this component; 0 where they name no receiver."""
    to = acks["target_system"], acks["target_component"]
    ours: NDArray[np.bool_] = np.isin(to[0], (system_id, 0)) & np.isin(to[1], (component_id, 0))
    return ours


def heartbeats(count: int) -> Records:
    messages = records(HEARTBEAT, count)
    messages["type"], messages["autopilot"] = dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID
    messages["system_status"], messages["mavlink_version"] = dialect.MAV_STATE_ACTIVE, 3
    return messages


def kill_message(system_id: int) -> Records:
    """COMMAND_LONG that stops the motors at once, also in flight."""
    return addressed(COMMAND_LONG, np.array([system_id]), command=ARM_DISARM, param2=_KILL_MAGIC)


def warm_up() -> None:
    """Compile, or load, the kernels of this module, with the types used in flight."""
    sent = encode(0, records(0, 1), np.zeros(1, np.uint8))
    data, starts = sent.data.reshape(-1), np.zeros(1, np.int64)
    decode(0, data, find(data, starts, sent.length).frames)
