"""Streams over UDP: frames that bridges of radios cut anywhere, put together by source address."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.links.endpoints.ports import Datagrams
from gcs.mavlink.codec import extras
from gcs.mavlink.kernels import LONGEST_FRAME, Bytes, Number, Whole, ends_with_a_frame, longest, whole_until
from gcs.model.jit import kernel
from gcs.model.state import Array

SOURCES_MAX: Final = 512
"""Sources of which the beginning of a frame is kept; a further one replaces the one silent longest."""

_NONE: Final = -1


@kernel
def _put_together(
    data: Bytes,
    start: Whole,
    length: Whole,
    source: Whole,
    time_s: Array,
    extra: NDArray[np.int16],
    kept: Bytes,
    kept_length: Whole,
    kept_source: Whole,
    kept_s: Array,
) -> None:
    """As `CutStreams.put_together`; `start`, `length` and what begins with `kept` are changed.

    Args:
        data: buffer with room for a frame before each datagram.
        start: (m,) of each datagram.
        length: (m,)
        source: (m,)
        time_s: (m,) of arrival.
        extra: as of `find_frames`.
        kept: (SOURCES_MAX, LONGEST_FRAME) beginnings of frames.
        kept_length: (SOURCES_MAX,) of each, 0: none.
        kept_source: (SOURCES_MAX,) the first ones are in use, up to _NONE.
        kept_s: (SOURCES_MAX,) arrival of their last bytes.
    """
    sums = np.empty(longest(length) + LONGEST_FRAME + 2, np.int64)
    begin: Number
    slot: Number
    for at in range(len(start)):
        begin, end = start[at], start[at] + length[at]
        slot = 0
        while slot < SOURCES_MAX and kept_source[slot] != source[at] and kept_source[slot] != _NONE:
            slot += 1
        is_known = slot < SOURCES_MAX and kept_source[slot] == source[at]
        ends_whole = ends_with_a_frame(data, begin, end, extra, sums)
        if ends_whole and not is_known:
            continue
        if is_known:
            begin -= kept_length[slot]
            for byte in range(kept_length[slot]):
                data[begin + byte] = kept[slot, byte]
        # a frame that seems to be missing bytes holds nothing back when others were sent whole behind it
        whole = end if ends_whole else whole_until(data, begin, end, extra, sums)
        start[at], length[at] = begin, whole - begin
        if whole == end and not is_known:
            continue
        if slot == SOURCES_MAX:
            slot = np.argmin(kept_s)
        kept_source[slot], kept_length[slot], kept_s[slot] = source[at], end - whole, time_s[at]
        for byte in range(end - whole):
            kept[slot, byte] = data[whole + byte]


class CutStreams:
    """Beginnings of frames, of which the rest has not arrived yet, by source address."""

    def __init__(self) -> None:
        self._kept: Bytes = np.zeros((SOURCES_MAX, LONGEST_FRAME), np.uint8)
        self._length: Whole = np.zeros(SOURCES_MAX, np.int64)
        self._source: Whole = np.full(SOURCES_MAX, _NONE, np.int64)
        self._time_s: Array = np.full(SOURCES_MAX, -np.inf)

    def put_together(self, arrived: Datagrams) -> None:
        """Put before each datagram what its source sent last of a frame that was not whole; keep its own end.

        Changes `start` and `length`. Datagrams of whole frames stay as they are. Every whole frame of a
        stream is found, however it was cut; what seems to be a frame and is not delays those behind it until
        its length has arrived, as on a serial port.
        """
        if arrived.headroom:
            kept = self._kept, self._length, self._source, self._time_s
            _put_together(*arrived[:5], extras(), *kept)
