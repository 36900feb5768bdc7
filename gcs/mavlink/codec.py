"""MAVLink messages of a whole fleet as numpy records, to frames and back. No I/O.

Formats come from pymavlink's message classes, so that no offset is typed by hand, and every frame is byte for
byte pymavlink's (tests/properties/test_codec.py). A record has the fields of the message under its own
names, in the units of its definition.
"""

from functools import cache
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import development as dialect

from gcs.mavlink.kernels import (
    FRAME_COLUMNS,
    LENGTH,
    PAYLOAD,
    SHORTEST_FRAME,
    Bytes,
    Whole,
    cut_out,
    find_frames,
    put_frames,
)

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


class Layout(NamedTuple):
    """Format of one message."""

    message_id: int
    dtype: np.dtype[np.void]
    crc_extra: int


class Frames(NamedTuple):
    """Encoded frames: row i is ``data[i, :length[i]]``."""

    data: Bytes  # (n, longest)
    length: Whole  # (n,)


class Found(NamedTuple):
    """Content of a batch of datagrams."""

    frames: Whole  # (k, FRAME_COLUMNS), see `kernels`
    garbage_bytes: int
    unknown_bytes: int


@cache
def layout(message_id: int) -> Layout:
    """Format of one message of pymavlink's development dialect, extensions included."""
    message: Any = dialect.mavlink_map[message_id]
    codes = bytes(message.native_format).decode().lstrip("<")  # one letter a field, in the order of the frame
    fields = [
        (name, "<" + _NUMPY[code], (length,)) if length else (name, "<" + _NUMPY[code])
        for name, code, length in zip(message.ordered_fieldnames, codes, message.array_lengths, strict=True)
    ]
    return Layout(message_id, np.dtype(fields), int(message.crc_extra))


@cache
def _extras() -> NDArray[np.int16]:
    """By message id, the CRC extra byte; -1 where there is no such message."""
    known: dict[int, Any] = dialect.mavlink_map
    extras = np.full(max(known) + 1, -1, dtype=np.int16)
    for message_id, message in known.items():
        extras[message_id] = message.crc_extra
    extras.setflags(write=False)
    return extras


def records(message_id: int, count: int) -> Records:
    """`count` messages of one kind, all zeros."""
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
    put_frames(payloads, message_id, extra, sequence, systems, component_id, frames, lengths)
    return Frames(frames, lengths)


def find(data: Bytes, starts: Whole, lengths: Whole) -> Found:
    """Find every frame in datagrams that is whole, known and has the right checksum.

    Args:
        data: buffer that contains them, flat.
        starts: (m,) of each.
        lengths: (m,) in bytes.
    """
    frames = np.empty((int(lengths.sum()) // SHORTEST_FRAME + 1, FRAME_COLUMNS), np.int64)
    count, garbage, unknown = find_frames(data, starts, lengths, _extras(), frames)
    return Found(frames[:count], garbage, unknown)


def decode(message_id: int, data: Bytes, frames: Whole) -> Records:
    """Messages from (k, FRAME_COLUMNS) frames of one kind, as `find` found them in `data`."""
    dtype = layout(message_id).dtype
    payloads = np.empty((len(frames), dtype.itemsize), np.uint8)
    starts, lengths = np.ascontiguousarray(frames[:, PAYLOAD]), np.ascontiguousarray(frames[:, LENGTH])
    cut_out(data, starts, lengths, payloads)
    return payloads.view(dtype)[:, 0]


def text(field: Bytes) -> str:
    """A field of characters (length,) up to its first zero."""
    return field.tobytes().split(b"\0", 1)[0].decode(errors="replace")


def text_field(value: str, length: int) -> Bytes:
    """A field of characters (length,), padded with zeros."""
    return np.frombuffer(value.encode()[:length].ljust(length, b"\0"), np.uint8)


def warm_up() -> None:
    """Compile, or load, the kernels of this module, with the types used in flight."""
    sent = encode(0, records(0, 1), np.zeros(1, np.uint8))
    data, starts = sent.data.reshape(-1), np.zeros(1, np.int64)
    decode(0, data, find(data, starts, sent.length).frames)
