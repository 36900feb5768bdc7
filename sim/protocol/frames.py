"""MAVLink 2 frames of one message for many vehicles at once, in numpy; byte-equal to pymavlink's.

The checksum (X.25) is affine over bits: it is the exclusive or of one table entry per byte and a constant
that depends on the length only.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common

from gcs.sim.protocol.mavlink import AUTOPILOT_COMPONENT, CHECKSUM_LENGTH, HEADER_LENGTH, MAGIC

if TYPE_CHECKING:
    from collections.abc import Mapping

    from gcs.sim.protocol.mavlink import Message
    from gcs.sim.vehicle.dynamics import Mask
    from gcs.sim.vehicle.state import Rows

Bytes: TypeAlias = NDArray[np.uint8]
Words: TypeAlias = NDArray[np.uint16]
Fields: TypeAlias = "Mapping[str, object]"

CHECKED_HEADER = HEADER_LENGTH - 1  # the checksum excludes the magic byte
LONGEST = CHECKED_HEADER + 255 + 1
SETPOINT = common.MAVLink_set_position_target_local_ned_message
SETPOINT_PAYLOAD = 53
SETPOINT_FRAME = HEADER_LENGTH + SETPOINT_PAYLOAD + CHECKSUM_LENGTH


@cache
def layout(message_id: int) -> np.dtype[np.void]:
    """The payload in the frame as a record, untruncated; little endian, largest fields first."""
    form = common.mavlink_map[message_id]
    codes = form.native_format.decode().lstrip("<")
    names = {"b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8"}
    names |= {"f": "<f4", "d": "<f8", "c": "S1"}
    fields = [
        (name, names[code], (length,)) if length > 1 else (name, names[code])
        for name, code, length in zip(form.ordered_fieldnames, codes, form.array_lengths, strict=True)
    ]
    return np.dtype(fields)


def pack(message_id: int, fields: Fields, system_id: Bytes, sequence: Bytes) -> list[bytes]:
    """One frame for each vehicle.

    Args:
        message_id: of the common dialect.
        fields: name to (m,) or (m, k) array, or to one value for all; missing fields are 0.
        system_id: (m,), of the senders.
        sequence: (m,), the frames' numbers.

    Returns: m frames. Trailing zeros of the payload are left out, as MAVLink 2 does.
    """
    form, head, extra = _whole(message_id)
    records = np.zeros(len(system_id), dtype=form)
    for name, values in fields.items():
        records[name] = values
    raw = records.view(np.uint8).reshape(-1, form.itemsize)
    lengths = _lengths(raw[:, HEADER_LENGTH:-CHECKSUM_LENGTH])
    raw[:, :HEADER_LENGTH] = head
    raw[:, 1] = lengths
    raw[:, 4] = sequence
    raw[:, 5] = system_id
    kinds = set(lengths.tolist())
    if len(kinds) == 1:
        return _sealed(raw, kinds.pop(), extra)
    frames = [b""] * len(raw)
    for length in kinds:
        rows = np.flatnonzero(lengths == length)
        for row, frame in zip(rows, _sealed(raw[rows], length, extra), strict=True):
            frames[row] = frame
    return frames


def checksums(checked: Bytes, extra: int) -> Words:
    """(m, k) bytes, k the same for all, and the message's extra byte: (m,) X.25 checksums."""
    following, constant = _checking(checked.shape[1], extra)
    folded: Words = np.bitwise_xor.reduce(_table()[following, checked], axis=1)
    return folded ^ constant


def setpoints(raw: bytes) -> tuple[NDArray[np.void], Bytes, Mask] | None:
    """Read frames that are only whole, unsigned SET_POSITION_TARGET_LOCAL_NED, end to end.

    Returns: the payloads (m,), the senders' system and component ids (m, 2) and which checksums are right
    (m,); or None if there is anything else among them.
    """
    count, rest = divmod(len(raw), SETPOINT_FRAME)
    if rest or not count:
        return None
    frames = np.frombuffer(raw, dtype=np.uint8).reshape(count, SETPOINT_FRAME)
    heads = (MAGIC, SETPOINT_PAYLOAD, 0, *SETPOINT.id.to_bytes(3, "little"))
    if (frames[:, (0, 1, 2, 7, 8, 9)] != np.array(heads, dtype=np.uint8)).any():
        return None
    body = np.ascontiguousarray(frames[:, HEADER_LENGTH:-CHECKSUM_LENGTH])
    sums = checksums(frames[:, 1:-CHECKSUM_LENGTH], SETPOINT.crc_extra)
    reported = frames[:, -2].astype(np.uint16) | frames[:, -1].astype(np.uint16) << 8
    return body.view(layout(SETPOINT.id)).reshape(count), frames[:, 5:7], sums == reported


def record(message: Message) -> NDArray[np.void]:
    """(1,): the payload of a message that pymavlink has read."""
    fields = np.zeros(1, dtype=layout(message.get_msgId()))
    for name in fields.dtype.names or ():
        fields[name] = getattr(message, name)
    return fields


def _lengths(payload: Bytes) -> Rows:
    """(m,): number of bytes without trailing zeros; at least 1."""
    used = payload[:, ::-1] != 0
    return np.where(used.any(axis=1), payload.shape[1] - used.argmax(axis=1), 1)


def _sealed(raw: Bytes, length: int, extra: int) -> list[bytes]:
    """Cut to that payload length and add the checksums, in place."""
    end, size = HEADER_LENGTH + length, HEADER_LENGTH + length + CHECKSUM_LENGTH
    raw[:, end:size] = checksums(raw[:, 1:end], extra).astype("<u2")[:, np.newaxis].view(np.uint8)
    data = raw[:, :size].tobytes()
    return [data[start : start + size] for start in range(0, len(data), size)]


@cache
def _whole(message_id: int) -> tuple[np.dtype[np.void], Bytes, int]:
    """A frame as a record, the common header of a message, and the message's extra byte."""
    payload = layout(message_id)
    fields = [(name, payload.fields[name][0]) for name in payload.names or () if payload.fields]
    form = np.dtype([("head", np.uint8, (HEADER_LENGTH,)), *fields, ("sum", np.uint8, (CHECKSUM_LENGTH,))])
    kind = message_id.to_bytes(3, "little")
    head = np.array((MAGIC, 0, 0, 0, 0, 0, AUTOPILOT_COMPONENT, *kind), dtype=np.uint8)
    return form, head, common.mavlink_map[message_id].crc_extra


@cache
def _checking(length: int, extra: int) -> tuple[Rows, np.uint16]:
    """For `length` bytes and an extra one: how many follow each, and the constant for the length."""
    return length - np.arange(length), np.uint16(int(_table()[0, extra]) ^ _empty(length + 1))


@cache
def _table() -> Words:
    """(LONGEST, 256): contribution of a byte to the checksum, by the number of bytes that follow it."""
    single = [_fed(byte, 0) for byte in range(256)]
    table = np.zeros((LONGEST, 256), dtype=np.uint16)
    table[0] = single
    for following in range(1, LONGEST):
        before = table[following - 1]
        table[following] = before >> 8 ^ table[0][before & 255]
    return table


@cache
def _empty(count: int) -> int:
    """The checksum of count zero bytes."""
    value = 0xFFFF
    for _ in range(count):
        value = _fed(0, value)
    return value


def _fed(byte: int, value: int) -> int:
    """X.25 after one more byte."""
    mixed = (byte ^ value) & 0xFF
    mixed ^= mixed << 4 & 0xFF
    return value >> 8 ^ mixed << 8 ^ mixed << 3 ^ mixed >> 4
