"""MAVLink 2 frames: messages of one kind for many vehicles at once, and single ones by pymavlink. Sans-I/O.

Layouts and checksums are pymavlink's. Its encoder takes 4 us for a message; numpy takes 1 us.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega, common

from gcs.sim.vehicle.dynamics import Mask

Message: TypeAlias = Any  # pymavlink has no types
Bytes: TypeAlias = NDArray[np.uint8]
Fields: TypeAlias = Mapping[str, object]

MAGIC = 0xFD
OLD_MAGIC = b"\xfe"
HEADER_LENGTH = 10
CHECKSUM_LENGTH = 2
CHECKSUM_BEGINS = 0xFFFF  # of CRC-16/MCRF4XX
SIGNATURE_LENGTH = 13
SIGNED = 0x01
AUTOPILOT_COMPONENT = 1

LED_CONTROL_ID = 186

SETPOINT = common.MAVLink_set_position_target_local_ned_message
SETPOINT_PAYLOAD = 53
SETPOINT_FRAME = HEADER_LENGTH + SETPOINT_PAYLOAD + CHECKSUM_LENGTH
SETPOINT_BEGINS = bytes((MAGIC, SETPOINT_PAYLOAD, 0))  # no incompatible flag: not signed
SETPOINT_ID = SETPOINT.id.to_bytes(3, "little")


class Codec:
    """Encodes for any vehicle, and decodes."""

    def __init__(self) -> None:
        self._mav = common.MAVLink(None, srcComponent=AUTOPILOT_COMPONENT)
        self._led = ardupilotmega.MAVLink(None)  # LED_CONTROL is of this dialect

    def encode(self, message: Message, system_id: int, sequence: int) -> bytes:
        self._mav.srcSystem, self._mav.seq = system_id, sequence
        return bytes(message.pack(self._mav))

    def decode(self, datagram: bytes) -> list[Message]:
        """Every valid MAVLink 2 frame in the datagram; the rest is skipped.

        No state is kept between datagrams, so a truncated frame cannot swallow the next one, as with
        pymavlink's parser. MAVLink 1 is not supported.
        """
        messages = []
        start = datagram.find(MAGIC)
        while 0 <= start <= len(datagram) - HEADER_LENGTH - CHECKSUM_LENGTH:
            signature = SIGNATURE_LENGTH if datagram[start + 2] & SIGNED else 0
            end = start + HEADER_LENGTH + datagram[start + 1] + CHECKSUM_LENGTH + signature
            message = self._decode_frame(datagram[start:end]) if end <= len(datagram) else None
            if message is None:
                start = datagram.find(MAGIC, start + 1)
                continue
            messages.append(message)
            start = datagram.find(MAGIC, end)
        return messages

    def _decode_frame(self, frame: bytes) -> Message | None:
        # An id outside the dialect has no known checksum: it may be garbage that hides valid frames.
        message_id = int.from_bytes(frame[7:10], "little")
        if message_id not in common.mavlink_map and message_id != LED_CONTROL_ID:
            return None
        try:
            return (self._led if message_id == LED_CONTROL_ID else self._mav).decode(bytearray(frame))
        except (common.MAVError, ardupilotmega.MAVError):  # checksum or flag
            return None


@cache
def layout(form: Message) -> np.dtype[np.void]:
    """The payload of a kind of message in the frame as a record, untruncated; largest fields first."""
    codes = form.native_format.decode().lstrip("<")
    names = {"b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8"}
    names |= {"f": "<f4", "d": "<f8", "c": "S1"}
    fields = [
        (name, names[code], (length,)) if length > 1 else (name, names[code])
        for name, code, length in zip(form.ordered_fieldnames, codes, form.array_lengths, strict=True)
    ]
    return np.dtype(fields)


def pack(form: Message, fields: Fields, system_id: Bytes, sequence: Bytes) -> list[bytes]:
    """One frame for each vehicle.

    Args:
        form: pymavlink's class of the message.
        fields: name to (m,) or (m, k) array, or to one value for all; missing fields are 0.
        system_id: (m,), of the senders.
        sequence: (m,), the frames' numbers.

    Returns: m frames. Trailing zeros of the payload are left out, as MAVLink 2 does.
    """
    records = np.zeros(len(system_id), dtype=layout(form))
    for name, values in fields.items():
        records[name] = values
    data, size, kind = records.tobytes(), records.itemsize, form.id.to_bytes(3, "little")
    extra = bytes([form.crc_extra])
    packed = []
    for at, system, number in zip(
        range(0, len(data), size), system_id.tolist(), sequence.tolist(), strict=True
    ):
        payload = data[at : at + size].rstrip(b"\0") or b"\0"
        head = bytes((len(payload), 0, 0, number, system, AUTOPILOT_COMPONENT))
        checked = head + kind + payload
        checksum: int = common.mcrf4xx(checked + extra, CHECKSUM_BEGINS)
        packed.append(b"\xfd" + checked + checksum.to_bytes(CHECKSUM_LENGTH, "little"))
    return packed


def setpoints(raw: bytes) -> tuple[NDArray[np.void], Bytes, Mask] | None:
    """Read frames that are only whole, unsigned SET_POSITION_TARGET_LOCAL_NED, end to end.

    Returns: the payloads (m,), the senders' system and component ids (m, 2) and which checksums are right
    (m,); or None if there is anything else among them.
    """
    count, rest = divmod(len(raw), SETPOINT_FRAME)
    if rest or not count:
        return None
    frames = np.frombuffer(raw, dtype=np.uint8).reshape(count, SETPOINT_FRAME)
    extra, good = bytes([SETPOINT.crc_extra]), []
    for start in range(0, len(raw), SETPOINT_FRAME):
        end = start + SETPOINT_FRAME - CHECKSUM_LENGTH
        if raw[start : start + 3] != SETPOINT_BEGINS or raw[start + 7 : start + HEADER_LENGTH] != SETPOINT_ID:
            return None
        checksum = common.mcrf4xx(raw[start + 1 : end] + extra, CHECKSUM_BEGINS)  # without the magic byte
        good.append(checksum == raw[end] | raw[end + 1] << 8)
    body = np.ascontiguousarray(frames[:, HEADER_LENGTH:-CHECKSUM_LENGTH])
    return body.view(layout(SETPOINT)).reshape(count), frames[:, 5:7], np.array(good)


def record(message: Message) -> NDArray[np.void]:
    """(1,): the payload of a message that pymavlink has read."""
    form: Message = type(message)
    fields = np.zeros(1, dtype=layout(form))
    for name in fields.dtype.names or ():
        fields[name] = getattr(message, name)
    return fields


def as_version_1(frame: bytes, forms: Mapping[int, Message]) -> bytes | None:
    """The same message in a MAVLink 1 frame: no extensions, no cut zeros; None for an id above 255.

    Args:
        frame: MAVLink 2, unsigned.
        forms: pymavlink's classes of a MAVLink 1 dialect, by id.
    """
    message_id = int.from_bytes(frame[7:HEADER_LENGTH], "little")
    form = forms.get(message_id)
    if form is None:
        return None
    length = form.unpacker.size
    payload = frame[HEADER_LENGTH:-CHECKSUM_LENGTH].ljust(length, b"\0")[:length]
    checked = bytes((len(payload), *frame[4:7], message_id)) + payload
    checksum = common.mcrf4xx(checked + bytes([form.crc_extra]), CHECKSUM_BEGINS)
    return bytes(OLD_MAGIC + checked + checksum.to_bytes(CHECKSUM_LENGTH, "little"))
