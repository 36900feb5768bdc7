"""Streams over UDP that were cut anywhere: every whole frame of every sender is read."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gcs.links.endpoints.cut_streams import SOURCES_MAX, CutStreams
from gcs.links.endpoints.ports import Datagrams
from gcs.mavlink import codec
from gcs.mavlink.kernels import LONGEST_FRAME
from tests.properties.test_links_frames import FRAMES

Sent = tuple[int, bytes]


def read(streams: CutStreams, sent: Sequence[Sent], time_s: float = 0.0) -> list[list[Sent]]:
    """What is read of each datagram, when all of these arrive at once: senders and frames."""
    length = np.array([len(data) for _, data in sent])
    start = np.cumsum(length + LONGEST_FRAME) - length
    data = np.frombuffer(bytearray(b"".join(bytes(LONGEST_FRAME) + each for _, each in sent)), np.uint8)
    source = np.array([sender for sender, _ in sent])
    arrived = Datagrams(data, start, length, source, np.full(len(sent), time_s), LONGEST_FRAME)
    streams.put_together(arrived)
    frames: list[list[Sent]] = [[] for _ in sent]
    for found in codec.find(data, arrived.start, arrived.length).frames.tolist():
        frames[found[0]].append((int(source[found[0]]), codec.frame(data, found).raw))
    return frames


def joined(parts: Sequence[Sequence[Sent]]) -> list[Sent]:
    return [one for part in parts for one in part]


def whole(stream: bytes) -> list[bytes]:
    return [frame.raw for frame in codec.split(stream).frames]


NOISE = st.one_of(st.binary(max_size=40), st.sampled_from([b"\xfe", b"\xfd\x09\x00", b"\xfe\xff" * 20]))
STREAM = st.lists(st.one_of(st.sampled_from(FRAMES), NOISE), max_size=8).map(b"".join)


@st.composite
def cut(draw: st.DrawFn, sender: int) -> list[Sent]:
    stream = draw(STREAM) + bytes(LONGEST_FRAME)  # so that nothing at the end could still be a frame
    cuts = sorted(draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    return [(sender, stream[start:end]) for start, end in pairwise((0, *cuts, len(stream)))]


@given(st.tuples(cut(1), cut(2), cut(3)), st.data())
def test_any_cut_of_several_streams_gives_all_their_frames(
    streams: Sequence[list[Sent]], data: st.DataObject
) -> None:
    order = data.draw(st.permutations([sender for sender, pieces in enumerate(streams) for _ in pieces]))
    waiting = [iter(pieces) for pieces in streams]
    sent = [next(waiting[sender]) for sender in order]
    reads = sorted(data.draw(st.lists(st.integers(0, len(sent)), max_size=4)))
    kept, frames = CutStreams(), list[Sent]()
    for first, end in pairwise((0, *reads, len(sent))):
        if first < end:
            frames += joined(read(kept, sent[first:end]))
    for sender, pieces in enumerate(streams, 1):
        stream = b"".join(piece for _, piece in pieces)
        assert [raw for source, raw in frames if source == sender] == whole(stream)


@given(st.lists(st.sampled_from(FRAMES), min_size=1, max_size=40), st.integers(1, 1400))
def test_frames_cut_in_equal_pieces_arrive_with_their_last_byte(parts: list[bytes], size: int) -> None:
    stream, kept, received = b"".join(parts), CutStreams(), b""
    for at in range(0, len(stream), size):
        received += b"".join(raw for _, raw in joined(read(kept, [(1, stream[at : at + size])])))
        ends = [end for end in np.cumsum([len(part) for part in parts]).tolist() if end <= at + size]
        assert received == stream[: ends[-1] if ends else 0]


@given(st.lists(st.lists(st.sampled_from(FRAMES), min_size=1, max_size=3), min_size=1, max_size=6), NOISE)
def test_noise_holds_back_no_datagram_of_whole_frames(datagrams: list[list[bytes]], noise: bytes) -> None:
    kept = CutStreams()
    read(kept, [(1, noise)])
    for frames in datagrams:
        assert [raw for _, raw in joined(read(kept, [(1, b"".join(frames))]))] == frames


def test_beginnings_of_many_senders_are_kept_up_to_a_bound() -> None:
    """The sender that is silent longest is forgotten first; the frame of any other is put together."""
    kept, frame = CutStreams(), FRAMES[0]
    senders = range(1, SOURCES_MAX + 11)
    for sender in senders:
        read(kept, [(sender, frame[:7])], float(sender))
    rest = joined(read(kept, [(sender, frame[7:]) for sender in reversed(senders)], 1e4))
    assert {sender for sender, _ in rest} == set(senders[10:])
