from typing import Any

import pytest
from pymavlink.dialects.v20 import common as dialect

from gcs.mavlink.codec import split
from gcs.mavlink.framing import Frame, Judgement, Signer
from gcs.mavlink.signing_time import TIME_MAX, UNITS_PER_S, signing_time

KEY = bytes(range(32))
NOW = signing_time(1_790_000_000.0)


def a_signer(key: bytes = KEY, link_id: int = 7, now: int = NOW) -> Signer:
    return Signer(key, link_id, start=0, clock=lambda: now)


def a_packer(system_id: int = 3, *, signs: bool = True, key: bytes = KEY, time: int = NOW) -> Any:
    packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
    packer.signing.secret_key = key
    packer.signing.sign_outgoing = signs
    packer.signing.link_id = 7
    packer.signing.timestamp = time
    return packer


def messages() -> list[Any]:
    return [
        dialect.MAVLink_heartbeat_message(2, 12, 0x81, 6 << 16, 4, 3),
        dialect.MAVLink_command_long_message(5, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_statustext_message(4, b"text"),
    ]


def frame(data: bytes) -> Frame:
    (only,), *_ = split(data)
    return only


@pytest.mark.parametrize("message", messages(), ids=lambda message: message.get_type())
def test_a_signed_frame_is_byte_equal_to_pymavlinks(message: Any) -> None:
    plain, theirs = a_packer(signs=False), a_packer()
    raw = bytes(message.pack(plain))
    assert a_signer().sign(raw) == bytes(message.pack(theirs))


def test_pymavlink_accepts_our_signatures() -> None:
    signer, receiver = a_signer(), a_packer(255)
    data = b"".join(signer.sign(bytes(message.pack(a_packer(signs=False)))) or b"" for message in messages())
    taken = receiver.parse_buffer(data)
    assert [message.get_signed() for message in taken] == [True] * 3


def test_pymavlink_signatures_are_accepted_once() -> None:
    signer, sender = a_signer(), a_packer()
    sent = [bytes(message.pack(sender)) for message in messages()]
    assert [signer.judge(frame(raw)) for raw in sent] == [Judgement.GOOD] * 3
    assert [signer.judge(frame(raw)) for raw in sent] == [Judgement.REPLAYED] * 3


def test_missing_or_wrong_signature_is_rejected() -> None:
    signer = a_signer()
    beat = messages()[0]
    assert signer.judge(frame(bytes(beat.pack(a_packer(signs=False))))) is Judgement.UNSIGNED
    assert signer.judge(frame(bytes(beat.pack(a_packer(), force_mavlink1=True)))) is Judgement.UNSIGNED
    assert signer.judge(frame(bytes(beat.pack(a_packer(key=bytes(32)))))) is Judgement.WRONG
    good = bytes(beat.pack(a_packer()))
    assert signer.judge(frame(good[:-8] + bytes((good[-8] ^ 1,)) + good[-7:])) is Judgement.WRONG
    assert signer.judge(frame(good)) is Judgement.GOOD


def test_forged_frame_with_a_future_time_locks_nothing_out() -> None:
    """pymavlink records a frame's time before it compares the signature (decision 0033)."""
    signer, good = a_signer(), a_packer()
    forger = a_packer(key=bytes(32), time=NOW + 3600 * UNITS_PER_S)
    first, later = (bytes(messages()[0].pack(good)) for _ in range(2))
    assert signer.judge(frame(first)) is Judgement.GOOD
    assert signer.judge(frame(bytes(messages()[0].pack(forger)))) is Judgement.WRONG
    assert signer.judge(frame(later)) is Judgement.GOOD


def test_new_signing_sender_may_be_at_most_a_minute_late() -> None:
    for late_s, judged in ((59, Judgement.GOOD), (61, Judgement.REPLAYED)):
        signer = a_signer()
        signer.begin(NOW)
        beat = messages()[0].pack(a_packer(time=NOW - late_s * UNITS_PER_S))
        assert signer.judge(frame(bytes(beat))) is judged


def test_senders_differ_by_system_component_and_link() -> None:
    signer = a_signer()
    beat = messages()[0]
    for system_id in (3, 4):
        assert signer.judge(frame(bytes(beat.pack(a_packer(system_id))))) is Judgement.GOOD
    other_link = a_packer()
    other_link.signing.link_id = 8
    assert signer.judge(frame(bytes(beat.pack(other_link)))) is Judgement.GOOD


def times_of(signed: list[bytes]) -> list[int]:
    return [int.from_bytes(raw[-12:-6], "little") for raw in signed]


def test_time_never_goes_back_though_the_clock_does() -> None:
    clock = iter([NOW, NOW - 5_000_000, NOW - 5_000_000, NOW + 3])
    signer = Signer(KEY, 0, start=0, clock=lambda: next(clock))
    raw = bytes(messages()[0].pack(a_packer(signs=False)))
    assert times_of([signer.sign(raw) or b"" for _ in range(4)]) == [NOW, NOW + 1, NOW + 2, NOW + 3]


def test_vehicle_with_its_clock_ahead_still_accepts_our_frames() -> None:
    signer = a_signer()
    ahead = NOW + 3600 * UNITS_PER_S
    signer.judge(frame(bytes(messages()[0].pack(a_packer(time=ahead)))))
    (signed,) = times_of([signer.sign(bytes(messages()[0].pack(a_packer(signs=False)))) or b""])
    assert signed == ahead + 1


def test_old_frame_becomes_one_that_can_be_signed() -> None:
    receiver = a_packer(255)
    for message in messages():
        old = bytes(message.pack(a_packer(signs=False), force_mavlink1=True))
        (taken,) = receiver.parse_buffer(a_signer(now=NOW + message.get_msgId()).sign(old))
        assert (taken.get_signed(), taken.to_dict()) == (True, message.to_dict())


def test_signed_frame_stays_and_unsignable_is_reported() -> None:
    signed = bytes(messages()[0].pack(a_packer()))
    assert a_signer().sign(signed) == signed
    unknown = b"\xfd\x01\x00\x00\x00\x01\x01\xff\xff\x7f\x00\x00\x00"
    assert a_signer().sign(unknown) is None


@pytest.mark.parametrize(("unix_s", "time"), [(0.0, 0), (1_420_070_401.0, 100_000), (1e12, TIME_MAX)])
def test_the_time_of_signatures_counts_from_2015(unix_s: float, time: int) -> None:
    assert signing_time(unix_s) == time
