"""MIDI over RTP (RFC 6295), with sessions as macOS and rtpMIDI make them. Bytes only.

Source of the session's commands: Apple, "MIDI Network Driver Protocol". The other side invites.
"""

import struct
from dataclasses import dataclass
from typing import Final

SIGNATURE: Final = b"\xff\xff"
VERSION: Final = 2
NAME: Final = b"gcs\0"
UNITS_PER_S: Final = 10_000
"""Clocks of a session count tenths of a millisecond."""

_SESSION: Final = struct.Struct(">2s2sIII")  # signature, command, version, token, sender
_SYNC: Final = struct.Struct(">2s2sIB3xQQQ")
_HEADER: Final = struct.Struct(">BBHII")  # of RTP
_RTP_VERSION, _PAYLOAD = 2, 0x61
_DELTA_MAX: Final = 4
_DATA_BYTES: Final = {0x8: 2, 0x9: 2, 0xA: 2, 0xB: 2, 0xC: 1, 0xD: 1, 0xE: 2}
_SYSTEM_BYTES: Final = {0xF1: 1, 0xF2: 2, 0xF3: 1}


@dataclass(slots=True)
class MidiSession:
    """Our side of one session; the newest invitation counts.

    Attributes:
        ssrc: our number in the session.
        partner: number of the one that invited us; None: none has.
        refused: datagrams that were not understood, or not the partner's.
    """

    ssrc: int
    partner: int | None = None
    refused: int = 0

    def take(self, data: bytes, now_s: float) -> tuple[bytes, bytes]:
        """Return MIDI bytes of a datagram, and the answer to it; either may be empty. Never raises."""
        if data.startswith(SIGNATURE):
            return b"", self._command(data, now_s)
        return self._midi(data), b""

    def _command(self, data: bytes, now_s: float) -> bytes:
        word = data[2:4]
        if word in {b"IN", b"BY"} and len(data) >= _SESSION.size:
            _, _, version, token, sender = _SESSION.unpack_from(data)
            if version == VERSION and word == b"IN":
                self.partner = sender
                return _SESSION.pack(SIGNATURE, b"OK", VERSION, token, self.ssrc) + NAME
            if version == VERSION and sender == self.partner:
                self.partner = None
                return b""
        elif word == b"CK" and len(data) >= _SYNC.size:
            _, _, sender, count, first, _, _ = _SYNC.unpack_from(data)
            if sender == self.partner:
                ours = int(now_s * UNITS_PER_S)
                return b"" if count else _SYNC.pack(SIGNATURE, word, self.ssrc, 1, first, ours, 0)
        self.refused += 1
        return b""

    def _midi(self, data: bytes) -> bytes:
        if len(data) > _HEADER.size:
            flags, payload, _, _, sender = _HEADER.unpack_from(data)
            plain = flags == _RTP_VERSION << 6  # no padding, no extension, no further sources
            if plain and payload & 0x7F == _PAYLOAD and sender == self.partner:
                commands = _commands(data[_HEADER.size :])
                if commands is not None:
                    return commands
        self.refused += 1
        return b""


def _commands(payload: bytes) -> bytes | None:
    """MIDI bytes of the list of commands, without times; None: the list is broken. The journal is ignored."""
    long, has_delta = payload[0] & 0x80, payload[0] & 0x20
    size, at = payload[0] & 0x0F, 1
    if long:
        if len(payload) < 2:
            return None
        size, at = size << 8 | payload[1], 2
    data = payload[at : at + size]
    if len(data) < size:
        return None
    midi, at, status = bytearray(), 0, 0
    while at < len(data):
        if midi or has_delta:
            at = _after_delta(data, at)
        if at >= len(data):
            break  # a time without a command ends a list
        if data[at] & 0x80:
            status, at = data[at], at + 1
        length = _data_bytes(status, data, at)
        if length is None or at + length > len(data):
            return None
        midi.append(status)
        midi += data[at : at + length]
        at += length
    return bytes(midi)


def _after_delta(data: bytes, at: int) -> int:
    for place in range(at, min(at + _DELTA_MAX, len(data))):
        if not data[place] & 0x80:
            return place + 1
    return min(at + _DELTA_MAX, len(data))


def _data_bytes(status: int, data: bytes, at: int) -> int | None:
    """Number of bytes after the status byte; None: there was none."""
    if status in {0xF0, 0xF7}:  # up to and with the byte that ends it, or this part of it
        ends = [place for word in (b"\xf7", b"\xf0", b"\xf4") if (place := data.find(word, at)) >= 0]
        return min(ends) + 1 - at if ends else len(data) - at
    if status >= 0xF0:
        return _SYSTEM_BYTES.get(status, 0)
    return _DATA_BYTES.get(status >> 4)
