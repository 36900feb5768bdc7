"""Bytes that all look like the beginning of a frame: nothing behind them is missed, and they cost little."""

import time

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gcs.mavlink import codec
from gcs.mavlink.kernels import _checksum_within, checksum
from tests.properties.test_links_frames import FRAMES

COSTS_AT_MOST = 60
"""Times as much as frames: 15 are measured, and 200 where each place is summed up on its own."""


@given(st.binary(min_size=1, max_size=600), st.integers(0, 255), st.data())
def test_a_checksum_from_two_sums_is_the_same(data: bytes, extra: int, draw: st.DataObject) -> None:
    array = np.frombuffer(bytearray(b"before" + data), np.uint8)
    begin, end = 6, len(array)
    start = draw.draw(st.integers(begin, end - 1))
    last = draw.draw(st.integers(start, min(end, start + 264)))
    sums = np.empty(len(data) + 2, np.int64)
    for allowed in (0, 10_000):
        sums[0] = allowed
        for _ in range(2):
            found = _checksum_within(array, begin, end, start, last, extra, sums)
            assert found == checksum(array, start, last, extra)


def test_frames_behind_many_beginnings_are_found() -> None:
    for beginning in (b"\xfe", b"\xfd", b"\xfe\xff", b"\xfd\xff\x00", b"\xfe\x02\x00"):
        flood = beginning * 500
        assert [frame.raw for frame in codec.split(flood + b"".join(FRAMES) + flood).frames] == FRAMES


def test_beginnings_cost_little_more_than_frames() -> None:
    frames = b"".join(FRAMES * 20)[:4000]

    def cost_s(data: bytes) -> float:
        array, start, length = (
            np.frombuffer(bytearray(data), np.uint8),
            np.zeros(1, np.int64),
            np.array([4000]),
        )
        took_s = []
        for _ in range(30):
            began_s = time.perf_counter()
            codec.find(array, start, length)
            took_s.append(time.perf_counter() - began_s)
        return min(took_s)

    assert max(cost_s(bytes((magic,)) * 4000) for magic in (0xFD, 0xFE)) < COSTS_AT_MOST * cost_s(frames)
