from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from gcs.mavlink.codec import extras, split, target_system
from gcs.mavlink.framing import moves
from gcs.mavlink.kernels import whole_until

PACKER = dialect.MAVLink(None, srcSystem=7, srcComponent=1)
FRAMES = [
    bytes(message.pack(PACKER, force_mavlink1=version_1))
    for version_1 in (False, True)
    for message in (
        dialect.MAVLink_heartbeat_message(2, 12, 0x81, 6 << 16, 4, 3),
        dialect.MAVLink_statustext_message(4, b"Preflight Fail: something"),
        dialect.MAVLink_sys_status_message(0, 0, 1 << 28, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_global_position_int_message(0, 1, 2, 3, 4, 5, 6, 7, 8),
        dialect.MAVLink_command_long_message(5, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0),
    )
]


def end_of_frames(data: bytes) -> int:
    """Number of bytes of a stream to search for frames; the rest, at most one frame, waits for more bytes."""
    sums = np.empty(len(data) + 2, np.int64)
    return int(whole_until(np.frombuffer(bytearray(data), np.uint8), 0, len(data), extras(), sums))


@st.composite
def mutated(draw: st.DrawFn) -> bytes:
    """Frames end to end, then bytes changed, cut out and put in."""
    data = bytearray(b"".join(draw(st.lists(st.sampled_from(FRAMES), max_size=4))))
    for _ in range(draw(st.integers(0, 4))):
        place = draw(st.integers(0, len(data)))
        data[place : place + draw(st.integers(0, 3))] = draw(st.binary(max_size=3))
    return bytes(data)


@given(st.one_of(mutated(), st.binary(max_size=600)))
@settings(max_examples=300)
def test_any_input_is_frames_or_garbage_and_never_an_exception(data: bytes) -> None:
    frames, garbage_bytes, unknown_bytes = split(data)
    assert sum(len(frame.raw) for frame in frames) + garbage_bytes + unknown_bytes == len(data)
    for frame in frames:
        assert 0 <= target_system(frame) <= 255
        moves(frame)


@given(mutated(), st.sampled_from(FRAMES))
@settings(max_examples=300)
def test_whole_frame_after_garbage_is_found(data: bytes, whole: bytes) -> None:
    assert split(data + whole).frames[-1].raw == whole


@given(st.lists(st.sampled_from(FRAMES), max_size=6))
def test_frames_round_trip(parts: list[bytes]) -> None:
    frames, *rest = split(b"".join(parts))
    assert ([frame.raw for frame in frames], rest) == (parts, [0, 0])


@given(st.lists(st.one_of(st.sampled_from(FRAMES), st.binary(max_size=40)), max_size=8), st.data())
@settings(max_examples=300)
def test_stream_split_anywhere_gives_the_same_frames(parts: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(parts) + bytes(300)  # so that nothing at the end could still be a frame
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    frames, rest = [], b""
    for start, end in pairwise((0, *cuts, len(stream))):
        arrived = rest + stream[start:end]
        whole = end_of_frames(arrived)
        frames += split(arrived[:whole]).frames
        rest = arrived[whole:]
        assert len(rest) <= 280 + 13
    assert frames == split(stream).frames
