"""Paths of a collective return of the whole formation, which one station plans for all; as bytes."""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.model.errors import LinkError
from gcs.model.state import Array
from gcs.stations.messages import VERSION

RETURN: Final = 5
"""Kind of the message."""

STEP_M: Final = 0.01
STEPS_MAX: Final = 6000
"""Points of a path: 20 minutes."""

TOGETHER: Final = 16
"""Vehicles of one message."""

_HEAD: Final = struct.Struct("<BBIHHH")


@dataclass(frozen=True, slots=True, eq=False)
class ReturnMessage:
    """Paths of some of one station's vehicles, as in `ReturnPaths`. Owns its arrays."""

    number: int  # of the return: a later one replaces it
    rows: NDArray[np.intp]  # (m,) of the receiving station
    drawn_m: Array  # (m, t, 3)
    path_m: Array  # (m, t, 3)
    pad_m: Array  # (m, 3) landing positions
    over_s: Array  # (m,)
    down_s: Array  # (m,)
    planned: NDArray[np.bool_]  # (m,) has a path without conflicts
    parts: int = 1  # messages of this return for this station

    def encode(self) -> bytes:
        m, t = self.drawn_m.shape[:2]
        both = np.concatenate([self.drawn_m, self.path_m], axis=2)  # (m, t, 6)
        steps = np.round(both / STEP_M).astype("<i4")
        changes = np.diff(steps, axis=1, prepend=np.zeros((m, 1, 6), "<i4"))
        packed = zlib.compress(changes.transpose(2, 0, 1).astype("<i4").tobytes(), 6)
        columns = [
            self.rows.astype("<u2"),
            self.pad_m.astype("<f4"),
            self.over_s.astype("<f4"),
            self.down_s.astype("<f4"),
            self.planned.astype("u1"),
        ]
        head = _HEAD.pack(VERSION, RETURN, self.number, m, t, self.parts)
        return head + b"".join(each.tobytes() for each in columns) + packed

    @staticmethod
    def decode(payload: bytes) -> "ReturnMessage":
        """Raises: LinkError for bytes that are no such message of this version."""
        if len(payload) < _HEAD.size:
            raise LinkError(f"a return of {len(payload)} bytes is too short")
        version, kind, number, m, t, parts = _HEAD.unpack_from(payload)
        if (version, kind) != (VERSION, RETURN) or not (1 <= m <= TOGETHER and 1 <= t <= STEPS_MAX):
            raise LinkError("a return of another version, or too large")
        at = _HEAD.size
        columns = []
        for form, width in (("<u2", 1), ("<f4", 3), ("<f4", 1), ("<f4", 1), ("u1", 1)):
            size = m * width * np.dtype(form).itemsize
            if len(payload) < at + size:
                raise LinkError("a return that is cut off")
            columns.append(np.frombuffer(payload, form, m * width, at))
            at += size
        whole = zlib.decompressobj()
        try:
            unpacked = whole.decompress(payload[at:], m * t * 24)
        except zlib.error:
            raise LinkError("a return with damaged paths") from None
        if len(unpacked) != m * t * 24 or not whole.eof:
            raise LinkError("a return with paths of another length")
        changes = np.frombuffer(unpacked, "<i4").reshape(6, m, t).transpose(1, 2, 0)
        both: Array = STEP_M * np.cumsum(changes, axis=1, dtype=np.float64)
        rows, pad_m, over_s, down_s, planned = columns
        if not all(np.isfinite(each).all() for each in (pad_m, over_s, down_s)):
            raise LinkError("a return with a number that is not possible")
        return ReturnMessage(
            number,
            rows.astype(np.intp),
            both[..., :3].copy(),
            both[..., 3:].copy(),
            pad_m.reshape(-1, 3).astype(np.float64),
            over_s.astype(np.float64),
            down_s.astype(np.float64),
            planned > 0,
            parts,
        )


def in_parts(whole: ReturnMessage) -> Iterator[ReturnMessage]:
    """The same in messages of at most TOGETHER vehicles."""
    cuts = range(0, len(whole.rows), TOGETHER)
    for begin in cuts:
        part = slice(begin, begin + TOGETHER)
        yield ReturnMessage(
            whole.number,
            whole.rows[part],
            whole.drawn_m[part],
            whole.path_m[part],
            whole.pad_m[part],
            whole.over_s[part],
            whole.down_s[part],
            whole.planned[part],
            len(cuts),
        )
