"""MAVLink 2 signatures, without I/O: https://mavlink.io/en/guide/message_signing.html."""

import hmac
from collections.abc import Callable
from enum import Enum, auto
from hashlib import sha256
from typing import Final

from pymavlink.dialects.v20 import development as dialect

from gcs.mavlink.framing import Frame, is_signed
from gcs.mavlink.kernels import MAGIC_1, MAGIC_2, SIGNATURE_LENGTH, SIGNED

KEY_BYTES: Final = 32
EPOCH_S: Final = 1_420_070_400  # 2015-01-01 in Unix time; a signature's time counts 10 us from here
UNITS_PER_S: Final = 100_000
TIME_MAX: Final = (1 << 48) - 1

_STREAM_LATE_UNITS: Final = 60 * UNITS_PER_S
"""The first signature of a sender may be this much behind the newest time known, as the standard says."""

_STREAMS_MAX: Final = 4096
_HASH_BYTES: Final = 6


def signing_time(unix_s: float) -> int:
    return min(TIME_MAX, max(0, round((unix_s - EPOCH_S) * UNITS_PER_S)))


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
        message = dialect.mavlink_map.get(int.from_bytes(raw[7:10], "little"))
        if message is None:
            return None
        body = bytes((*raw[1:2], raw[2] | SIGNED, *raw[3:10])) + raw[10:-2]
        checksum: int = dialect.x25crc(body + bytes((message.crc_extra,))).crc
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
