"""Our frames are pymavlink's, byte for byte, and what pymavlink reads out of one, we read too."""

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as dialect

from gcs.links.endpoints.ports import Datagrams, source_of
from gcs.links.native.link import NativeLink
from gcs.links.settings import Listen
from gcs.mavlink import codec
from gcs.mavlink.kernels import COMPONENT, MESSAGE, SYSTEM
from gcs.model.frames import ShowFrame

SENT = (
    0,
    20,
    21,
    23,
    76,
    84,
)  # HEARTBEAT, PARAM_REQUEST_READ and _LIST, PARAM_SET, COMMAND_LONG, the setpoint
READ = (0, 1, 22, 24, 33, 77, 147, 230, 245, 253)  # ESTIMATOR_STATUS is 230; the others are in `received`

FRAMES = st.sampled_from([*SENT, *READ])


def values(code: str, length: int) -> st.SearchStrategy[Any]:
    """Of one field; zeros often, since MAVLink 2 cuts them off at the end."""
    if code == "c":
        return st.one_of(st.just(b""), st.binary(max_size=length))
    one: st.SearchStrategy[Any]
    if code in "fd":
        one = st.floats(width=32, allow_nan=False)
    else:
        bits = {"b": 8, "h": 16, "i": 32, "q": 64}[code.lower()]
        low, high = (0, 2**bits - 1) if code.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        one = st.integers(low, high)
    one = st.one_of(st.just(0), one)
    return st.lists(one, min_size=length, max_size=length) if length else one


@st.composite
def messages(draw: st.DrawFn, message_ids: st.SearchStrategy[int]) -> Any:
    """A pymavlink message with anything in it."""
    kind: Any = dialect.mavlink_map[draw(message_ids)]
    codes = bytes(kind.native_format).decode().lstrip("<")
    fields = {
        name: draw(values(code, length))
        for name, code, length in zip(kind.ordered_fieldnames, codes, kind.array_lengths, strict=True)
    }
    return kind(**fields)


def packed(
    message: Any, *, sequence: int, system_id: int, component_id: int, version_1: bool = False
) -> bytes:
    packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
    packer.seq = sequence
    return bytes(message.pack(packer, force_mavlink1=version_1))


def record(message: Any) -> codec.Records:
    """The same message as ours."""
    ours = codec.records(type(message).id, 1)  # STATUSTEXT has a field of that name
    for name in message.ordered_fieldnames:
        value = getattr(message, f"_{name}_raw", None) or getattr(message, name)
        field = ours.dtype[name]
        ours[name] = codec_text(value, field) if isinstance(value, bytes | str) else value
    return ours


def codec_text(value: bytes | str, field: "np.dtype[Any]") -> Any:
    data = value.encode() if isinstance(value, str) else value
    return np.frombuffer(data.ljust(field.shape[0], b"\0"), np.uint8)


def arrived(data: bytes) -> Datagrams:
    """One datagram."""
    n = np.zeros(1, np.int64)
    source = n + source_of(0x7F000001, 5000, 0)
    return Datagrams(np.frombuffer(data, np.uint8).copy(), n, n + len(data), source, np.ones(1))


@given(messages(st.sampled_from(SENT)), st.integers(0, 255), st.integers(1, 255), st.integers(0, 255))
@settings(max_examples=300, deadline=None)
def test_every_frame_equals_pymavlinks_byte_for_byte(
    message: Any, sequence: int, system_id: int, component_id: int
) -> None:
    theirs = packed(message, sequence=sequence, system_id=system_id, component_id=component_id)
    number = np.array([sequence], np.uint8)
    ours = codec.encode(
        type(message).id, record(message), number, system_id=system_id, component_id=component_id
    )
    assert ours.data[0, : ours.length[0]].tobytes() == theirs


@given(messages(st.sampled_from(READ)), st.booleans())
@settings(max_examples=300, deadline=None)
def test_frames_decode_as_in_pymavlink(message: Any, version_1: bool) -> None:
    message_id: int = type(message).id  # STATUSTEXT has a field of that name
    data = packed(message, sequence=3, system_id=7, component_id=1, version_1=version_1)
    theirs: Any = dialect.MAVLink(None).decode(bytearray(data))
    datagram = arrived(data)
    frames, *wasted = codec.find(datagram.data, datagram.start, datagram.length)
    assert wasted == [0, 0]
    assert frames[0, [MESSAGE, SYSTEM, COMPONENT]].tolist() == [message_id, 7, 1]
    (ours,) = codec.decode(message_id, datagram.data, frames)
    for name in theirs.ordered_fieldnames:
        value = getattr(theirs, name)
        if isinstance(value, str):
            if value.isascii():  # pymavlink reads nothing else; ours is UTF-8
                assert codec.text(ours[name]) == value.split("\0")[0]
        else:
            assert np.array_equal(ours[name], np.array(value, ours[name].dtype), equal_nan=True), name


@st.composite
def mutated(draw: st.DrawFn) -> bytes:
    """Frames end to end, then bytes changed, cut out and put in."""
    parts = draw(st.lists(messages(FRAMES), max_size=4))
    data = bytearray(b"".join(packed(part, sequence=1, system_id=2, component_id=1) for part in parts))
    for _ in range(draw(st.integers(0, 4))):
        place = draw(st.integers(0, len(data)))
        data[place : place + draw(st.integers(0, 3))] = draw(st.binary(max_size=3))
    return bytes(data)


LINK = NativeLink("fuzz", {"a": 2, "b": 3}, Listen("127.0.0.1", 1), ShowFrame(47.4, 8.5, 500.0))


@given(st.lists(st.one_of(mutated(), st.binary(max_size=300)), min_size=1, max_size=4))
@settings(max_examples=300, deadline=None)
def test_no_input_makes_the_link_fail(parts: list[bytes]) -> None:
    for part in parts:
        LINK._inbox.take(arrived(part))
    assert LINK.snapshot().ids == ("a", "b")
