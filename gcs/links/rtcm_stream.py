"""Finds RTCM 3 messages in bytes that are not trusted. Pure.

The cost depends on how many bytes arrive, not on what they are: CRC-24Q is linear, so that one pass over the
bytes gives the checksum of every stretch of them, however many places look like the beginning of a message.
Source: RTCM 10403.3, "Transport Layer", and its messages 1005 and 1006.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import pymap3d
from numpy.typing import NDArray

PREAMBLE: Final = 0xD3
HEAD, CRC = 3, 3
LONGEST_BYTES: Final = HEAD + 1023 + CRC
_SHORTEST_PAYLOAD: Final = 2
"""The number of the message."""

PIECE_BYTES: Final = 4096
_POLYNOMIAL: Final = 0x1864CFB

_STATIONS: Final = {1005: 19, 1006: 21}
"""Messages with the place of the base, and the bytes of their payload."""

_TENTH_MM: Final = 1e-4
_COORDINATE_BITS: Final = 38
_ON_EARTH_M: Final = 6e6
"""A base that does not know its place reports the middle of the Earth."""

Place = tuple[float, float, float]
"""Latitude and longitude in degrees, height above the ellipsoid in m."""


def _weights(bits: int) -> NDArray[np.int32]:
    """(bits,) x to the power of 0, -1, -2 ... modulo the polynomial of the checksum."""
    weights, weight = [], 1
    for _ in range(bits):
        weights.append(weight)
        weight = (weight ^ (_POLYNOMIAL if weight & 1 else 0)) >> 1
    return np.array(weights, np.int32)


_WEIGHTS: Final = _weights(8 * (LONGEST_BYTES + PIECE_BYTES))


def _sums(data: NDArray[np.uint8]) -> NDArray[np.int32]:
    """(k + 1,) Weighted sums of the bits before each of k bytes, and of all.

    Bytes that end with their checksum are a multiple of its polynomial: their bits sum up to 0, so that the
    sums before and after them are equal.
    """
    terms = _WEIGHTS[: 8 * len(data)] * np.unpackbits(data)
    return np.concatenate([np.zeros(1, np.int32), np.bitwise_xor.accumulate(terms)[7::8]])


@dataclass(slots=True)
class RtcmStream:
    """Cuts whole, correct RTCM 3 messages out of bytes.

    Attributes:
        garbage_bytes: bytes that belong to no correct message.
        base: the place that the base reports; None: not yet.
    """

    garbage_bytes: int = 0
    base: Place | None = None
    _waiting: bytes = b""
    _station: bytes = b""  # the newest message with the place

    def take(self, data: bytes) -> list[bytes]:
        """The messages that `data` completes; at most one that is not complete is kept. Never raises."""
        pieces = (data[at : at + PIECE_BYTES] for at in range(0, len(data), PIECE_BYTES))
        return [message for piece in pieces for message in self._take(piece)]

    def _take(self, piece: bytes) -> list[bytes]:
        waiting = self._waiting + piece
        messages, at, kept = [], 0, len(waiting)
        for begin, end, complete in _candidates(waiting):
            if begin < at:  # within a message that was correct
                continue
            if not complete:
                kept = begin
                break
            self.garbage_bytes += begin - at
            at = end
            messages.append(waiting[begin:end])
        self._note_base(messages)
        kept = max(kept, at)
        self.garbage_bytes += kept - at
        self._waiting = waiting[kept:]
        return messages

    def _note_base(self, messages: list[bytes]) -> None:
        """Note the newest place among these messages, if it is another one than before."""
        newest = next(
            (message for message in reversed(messages) if _number(message) in _STATIONS), self._station
        )
        if newest != self._station:
            self._station, self.base = newest, _place(newest) or self.base


def _candidates(waiting: bytes) -> list[tuple[int, int, bool]]:
    """Begin and end of what is a correct message, and of what may become one, with False."""
    data = np.frombuffer(waiting, np.uint8)
    begin = np.flatnonzero(data == PREAMBLE)
    if not len(begin):
        return []
    padded = np.concatenate([data, np.zeros(HEAD, np.uint8)])
    size = padded[begin + 1].astype(np.int64) << 8 | padded[begin + 2]
    end = begin + HEAD + size + CRC
    possible = (size <= LONGEST_BYTES - HEAD - CRC) & (size >= _SHORTEST_PAYLOAD) | (begin + HEAD > len(data))
    complete = possible & (end <= len(data)) & (begin + HEAD <= len(data))
    correct = np.zeros(len(begin), np.bool_)
    if complete.any():
        sums = _sums(data)
        correct[complete] = sums[begin[complete]] == sums[end[complete]]
    counts = correct | possible & ~complete
    return list(zip(begin[counts].tolist(), end[counts].tolist(), complete[counts].tolist(), strict=True))


def _number(message: bytes) -> int:
    return int.from_bytes(message[HEAD : HEAD + 2], "big") >> 4


def _place(message: bytes) -> Place | None:
    """The place that a correct message of a station reports; None: it makes no sense."""
    if len(message) != HEAD + _STATIONS[_number(message)] + CRC:
        return None
    bits = int.from_bytes(message[HEAD : HEAD + 19], "big")  # from 152 bits down
    x_m, y_m, z_m = (_TENTH_MM * _signed(bits >> low & (1 << _COORDINATE_BITS) - 1) for low in (80, 40, 0))
    if x_m * x_m + y_m * y_m + z_m * z_m <= _ON_EARTH_M**2:
        return None
    latitude_deg, longitude_deg, height_m = pymap3d.ecef2geodetic(x_m, y_m, z_m)
    return float(latitude_deg), float(longitude_deg), float(height_m)


def _signed(value: int) -> int:
    return value - (1 << _COORDINATE_BITS) if value >> _COORDINATE_BITS - 1 else value
