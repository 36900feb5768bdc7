"""Corrections: RTCM messages out of bytes, cut into fragments, put together by the fake, within a budget."""

import random

import numpy as np
import pytest
from pymavlink.dialects.v20 import common
from pyrtcm import calc_crc24q

from gcs.links.address_book import Addresses
from gcs.links.corrections import AT_ONCE_MAX, LONGEST_BYTES, OLD_S, WAITING_MAX, CorrectionSender, fragments
from gcs.links.features import RtkSettings
from gcs.links.link import Counters
from gcs.links.rtcm_stream import RtcmStream
from gcs.links.send_budget import Budget
from gcs.links.sender import Outbox
from gcs.mavlink.codec import encode
from gcs.sim.protocol.equipment import Reassembly
from tests.support.kept_ports import KeptPorts
from tests.support.rtcm import BASE, base_message, rtcm


@pytest.mark.parametrize("size", [8, 179, 180, 181, 359, 360, 361, 540, 719, 720])
def test_message_of_any_length_is_whole_at_the_vehicle(size: int) -> None:
    message, fake, wholes = rtcm(1077, size), Reassembly(), []
    parts = fragments(message, 5)
    frames = encode(233, parts, np.zeros(len(parts), np.uint8))
    parser = common.MAVLink(None)
    for at in range(len(parts)):
        sent = parser.decode(bytearray(frames.data[at, : frames.length[at]].tobytes()))
        assert (sent.flags & 1, sent.flags >> 1 & 3, sent.flags >> 3) == (size > 180, at, 5)
        wholes.append(fake.take(sent.flags, bytes(sent.data[: sent.len])))
    assert wholes == [None] * (len(parts) - 1) + [message]


def test_message_longer_than_four_fragments_is_refused() -> None:
    for size in (0, LONGEST_BYTES + 1):
        with pytest.raises(ValueError, match="1 to 720"):
            fragments(bytes(size), 0)


def test_lost_fragment_spoils_its_own_message_only() -> None:
    fake = Reassembly()
    first, second = fragments(rtcm(1077, 400), 1), fragments(rtcm(1087, 300), 2)
    arrived = [first[0], first[2], *second]
    wholes = [fake.take(int(one["flags"]), one["data"][: one["len"]].tobytes()) for one in arrived]
    assert wholes == [None, None, None, rtcm(1087, 300)]


def test_messages_are_found_in_any_cut_of_the_bytes() -> None:
    messages = [base_message(), *(rtcm(1077, size) for size in (30, 200, 700)), rtcm(1230, 12)]
    data = b"\xd3junk\r\n".join(messages)
    for seed in range(50):
        stream, found, at, draw = RtcmStream(), [], 0, random.Random(seed)
        while at < len(data):
            step = draw.randint(1, 400)
            found += stream.take(data[at : at + step])
            at += step
        assert found == messages
    assert stream.base == pytest.approx(BASE, abs=1e-3)
    assert stream.base is not None
    assert stream.base[:2] == pytest.approx(BASE[:2], abs=1e-7)


def test_damaged_and_random_bytes_give_no_message() -> None:
    draw = random.Random(7)
    message = bytearray(rtcm(1077, 200))
    message[50] ^= 0x10
    stream = RtcmStream()
    assert stream.take(bytes(message)) == []
    for _ in range(100):
        assert all(not calc_crc24q(each) for each in stream.take(draw.randbytes(1000)))
    assert len(stream._waiting) <= 1029
    assert stream.garbage_bytes > 90_000


@pytest.mark.parametrize("kind", [1005, 1006])
def test_place_of_the_base_that_makes_no_sense_is_ignored(kind: int) -> None:
    for size in range(8, 40):  # right checksums, wrong lengths
        stream, message = RtcmStream(), rtcm(kind, size)
        assert stream.take(message) == [message]
    head = b"\xd3\0\x13" + (kind << 4).to_bytes(2, "big") + bytes(17)  # at the middle of the Earth
    stream = RtcmStream()
    assert len(stream.take(head + calc_crc24q(head).to_bytes(3, "big"))) == 1
    assert stream.base is None


def sender(bytes_per_s: float) -> tuple[CorrectionSender, KeptPorts]:
    ports, ids = KeptPorts(), np.arange(1, 11)
    addresses = Addresses("bench", ids.tolist(), ports.address, Counters(), lambda: 0.0)
    addresses.source[:] = np.arange(10) + 1
    return CorrectionSender(Outbox(ports, addresses, Counters(), ids), Budget(bytes_per_s)), ports


def test_every_address_gets_every_fragment() -> None:
    corrections, ports = sender(1e6)
    corrections.add(rtcm(1077, 400), 1.0)
    corrections.send(1.0)
    assert len(ports.left) == 3 * 10
    assert (corrections.sent, corrections.dropped) == (1, 0)


def test_small_messages_leave_a_few_at_a_time_and_in_order() -> None:
    """A source that sends hundreds a second costs no more: what is waiting leaves at once, or is dropped."""
    corrections, ports = sender(1e6)
    for at in range(100):
        corrections.add(rtcm(1077, 10 + at), 1.0)
    corrections.send(1.0)
    assert len(ports.left) == AT_ONCE_MAX * 10
    assert (corrections.sent, corrections.dropped) == (AT_ONCE_MAX, 100 - WAITING_MAX)
    for turn in range(1, 10):
        corrections.send(1.0 + 0.05 * turn)
    assert corrections.sent == WAITING_MAX
    for address in range(10):  # each message to all, then the next one
        frames = [common.MAVLink(None).parse_char(raw) for raw in ports.left[address::10]]
        assert [frame.get_seq() for frame in frames] == list(range(WAITING_MAX))
        assert [frame.len for frame in frames] == list(range(110 - WAITING_MAX, 110))


def test_without_room_whole_messages_are_dropped() -> None:
    """10 vehicles need 12 kB/s; with 6 kB/s half of the messages leave, and each of those to all of them."""
    corrections, ports = sender(6000.0)
    for tick in range(400):
        now_s = 0.05 * tick
        if tick % 10 == 0:
            corrections.add(rtcm(1077, 500), now_s)
        corrections.send(now_s)
    assert len(ports.left) == corrections.sent * 3 * 10
    assert corrections.dropped > 5
    assert corrections.sent * 5400 <= 6000 * (20 + OLD_S)
    assert corrections.sent > 15


@pytest.mark.parametrize(
    "source", ["http://a:1/b", "ntrip://a/b", "ntrip://a:2101", "tcp://a:0", "serial://x"]
)
def test_wrong_source_is_refused_with_what_is_needed(source: str) -> None:
    with pytest.raises(ValueError, match="is needed"):
        RtkSettings(source=source)
