"""MAVLink 2 frames to messages and back, one datagram at a time; invalid frames are skipped. Sans-I/O."""

from __future__ import annotations

from typing import Any, TypeAlias

from pymavlink.dialects.v20 import common

Message: TypeAlias = Any  # pymavlink has no types

MAGIC = 0xFD
HEADER_LENGTH = 10
CHECKSUM_LENGTH = 2
SIGNATURE_LENGTH = 13
SIGNED = 0x01
AUTOPILOT_COMPONENT = 1


class Codec:
    """Encodes for any vehicle, and decodes."""

    def __init__(self) -> None:
        self._mav = common.MAVLink(None, srcComponent=AUTOPILOT_COMPONENT)

    def encode(self, message: Message, system_id: int, sequence: int) -> bytes:
        """Pack one message into a MAVLink 2 frame."""
        self._mav.srcSystem, self._mav.seq = system_id, sequence
        return bytes(message.pack(self._mav))

    def decode(self, datagram: bytes) -> list[Message]:
        """Every valid MAVLink 2 frame in the datagram; the rest is skipped.

        No state is kept between datagrams, so a truncated frame cannot swallow the next one. MAVLink 1
        is not supported.
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
        if int.from_bytes(frame[7:10], "little") not in common.mavlink_map:
            return None
        try:
            return self._mav.decode(bytearray(frame))
        except common.MAVError:  # checksum or flag
            return None
