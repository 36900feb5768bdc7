"""Timecode as bytes and sound: MIDI, MIDI over RTP, linear; what is broken or hostile does no harm."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.model.errors import InvalidError
from gcs.shows.timecode import Rate
from gcs.shows.timecode.ltc import LinearTimecode
from gcs.shows.timecode.midi import MidiTimecode, quarter_frames
from gcs.shows.timecode.receiver import pcm_decoder
from gcs.shows.timecode.rtp_midi import MidiSession
from gcs.shows.timecode.smpte import Label, label_at, parse_label
from tests.support.timecode import END, INVITATION, NAMED, SYNC, full_frame, pcm, rtp, running, sound

START = Label(1, 0, 59, 10)
SAMPLES_PER_S = 48_000.0


@pytest.mark.parametrize("rate", Rate)
@given(number=st.integers(0, 24 * 3600 * 24 - 1))
def test_every_frame_of_a_day_has_a_label_and_its_time(rate: Rate, number: int) -> None:
    label = label_at((number + 0.5) / rate.per_s, rate)
    assert label.exists(rate)
    assert label.time_s(rate) == pytest.approx(number / rate.per_s, abs=1e-6)


def test_drop_frame_keeps_the_time_of_day() -> None:
    """Every minute but each tenth leaves out two labels: an hour of labels lasts an hour, within 4 ms."""
    drop = Rate.FPS_29_97_DROP
    assert Label(1, 0, 0, 0).time_s(drop) == pytest.approx(3600.0, abs=0.004)
    assert not Label(0, 1, 0, 0).exists(drop)
    assert Label(0, 10, 0, 0).exists(drop)
    before = Label(0, 0, 59, 29).time_s(drop)
    assert Label(0, 1, 0, 2).time_s(drop) - before == pytest.approx(1001 / 30_000)


@pytest.mark.parametrize("text", ["", "1", "25:00:00:00", "00:60:00:00", "00:00:00:30", "aa:00:00:00"])
def test_labels_that_do_not_exist_are_refused(text: str) -> None:
    with pytest.raises(InvalidError):
        parse_label(text)


@pytest.mark.parametrize("rate", NAMED)
def test_quarter_frames_say_where_the_timecode_is_now(rate: Rate) -> None:
    """A label takes two frames to arrive; from then on each message counts at once."""
    midi, errors = MidiTimecode(), []
    for number, sent in zip(range(200), running(START, rate), strict=False):
        for reading in midi.take(sent.message):
            errors.append(reading.time_s - START.time_s(rate) - sent.at_s)
            assert (number, reading.rate) >= (8, rate) if rate is Rate.FPS_24 else number >= 8
    assert len(errors) == 192
    assert np.abs(errors).max() < 1e-6
    assert midi.garbage == 0


def test_other_messages_between_and_inside_do_not_disturb() -> None:
    """Real-time bytes may come between any two bytes; notes and system messages are passed over."""
    midi, readings = MidiTimecode(), 0
    for _, sent in zip(range(64), running(START, Rate.FPS_25), strict=False):
        inside = sent.message[:1] + b"\xf8\xfe" + sent.message[1:]
        data = b"\x90\x3c\x40\x3d\x40" + inside + b"\xf0\x01\x02\xf7"
        readings += len(midi.take(data))
    assert readings == 56


def test_full_frame_says_where_the_source_stands() -> None:
    (reading,) = MidiTimecode().take(full_frame(START, Rate.FPS_29_97_DROP))
    assert not reading.runs
    assert reading.time_s == START.time_s(Rate.FPS_29_97_DROP)


def test_a_lost_quarter_frame_makes_the_label_wait_for_the_next() -> None:
    midi = MidiTimecode()
    messages = [message for _ in range(3) for message in quarter_frames(START, Rate.FPS_25)]
    del messages[11]
    found = [len(midi.take(message)) for message in messages]
    assert found == [0] * 8 + [1] * 3 + [0] * 12
    assert midi.garbage == 1


@pytest.mark.parametrize("rate", NAMED)
@pytest.mark.parametrize("speed", [0.9985, 1.0, 1.02])
def test_linear_timecode_is_read_to_a_tenth_of_a_millisecond(rate: Rate, speed: float) -> None:
    samples = sound(START, rate, 3.0, SAMPLES_PER_S, speed=speed, noise=0.03)
    linear, errors = LinearTimecode(SAMPLES_PER_S), []
    for at in range(0, len(samples), 441):
        part = samples[at : at + 441]
        for reading in linear.take(part):
            true_s = START.time_s(rate) + ((at + len(part)) / SAMPLES_PER_S - reading.age_s) * speed
            errors.append(reading.time_s - true_s)
            assert reading.rate is rate
    assert len(errors) >= 3.0 * rate.per_s * speed - 4
    assert np.abs(errors).max() < 1e-4


@pytest.mark.parametrize("rate", [Rate.FPS_23_976, Rate.FPS_29_97])
def test_linear_timecode_of_film_and_video_is_measured(rate: Rate) -> None:
    """After a second of sound its frames are seen to be longer by 1001/1000."""
    linear = LinearTimecode(SAMPLES_PER_S)
    readings = linear.take(sound(START, rate, 3.0, SAMPLES_PER_S, noise=0.03))
    assert {one.rate for one in readings[26:]} == {rate}
    begin_s, newest = START.time_s(rate), readings[-1]
    assert newest.time_s - begin_s == pytest.approx(3.0 - newest.age_s, abs=1e-4)


@pytest.mark.parametrize("level", [0.03, 1.0])
def test_quiet_and_loud_sound_is_read_and_a_new_level_too(level: float) -> None:
    linear = LinearTimecode(SAMPLES_PER_S)
    parts = [sound(START, Rate.FPS_25, 1.0, SAMPLES_PER_S, level=each) for each in (0.3, level)]
    found = sum(len(linear.take(part)) for whole in parts for part in np.array_split(whole, 100))
    assert found >= 30


def test_sound_without_timecode_says_nothing() -> None:
    linear, rng = LinearTimecode(SAMPLES_PER_S), np.random.default_rng(1)
    assert not linear.take(np.zeros(48_000))
    assert not linear.take(np.full(1000, np.nan))
    for _ in range(10):
        assert not linear.take(rng.standard_normal(4800))
    assert not linear.take(np.sin(np.arange(48_000) * 0.3))


def test_pcm_in_odd_pieces_is_the_same_sound() -> None:
    _, decode = pcm_decoder(SAMPLES_PER_S)
    data = pcm(sound(START, Rate.FPS_25, 1.0, SAMPLES_PER_S))
    found = sum(len(decode(data[at : at + 999])) for at in range(0, len(data), 999))
    assert found >= 22


def test_a_session_is_accepted_kept_in_time_and_ended() -> None:
    session = MidiSession(99)
    midi, answer = session.take(INVITATION, 1.0)
    assert (midi, answer[:4], struct.unpack(">III", answer[4:16])) == (b"", b"\xff\xffOK", (2, 77, 99))
    _, answer = session.take(SYNC, 2.0)
    assert struct.unpack(">4sIB3xQQQ", answer) == (b"\xff\xffCK", 99, 1, 111, 20_000, 0)
    message = quarter_frames(START, Rate.FPS_25)[0]
    assert session.take(rtp([message]), 3.0) == (message, b"")
    many = quarter_frames(START, Rate.FPS_25)
    assert session.take(rtp(many), 3.0)[0] == b"".join(many)
    assert session.take(rtp([full_frame(START, Rate.FPS_24)]), 3.0)[0] == full_frame(START, Rate.FPS_24)
    assert session.take(rtp([message], sender=5), 3.0) == (b"", b"")
    session.take(END, 4.0)
    assert session.take(rtp([message]), 5.0) == (b"", b"")
    assert session.refused == 2


@given(st.binary(max_size=1500), st.integers(1, 7))
def test_no_bytes_do_harm(data: bytes, cut: int) -> None:
    """No exception, and nothing that grows: whatever arrives, in whatever pieces."""
    midi, session, (_, decode) = MidiTimecode(), MidiSession(1), pcm_decoder(8000.0)
    session.take(INVITATION, 0.0)
    for at in range(0, len(data), max(1, len(data) // cut)):
        part = data[at : at + len(data) // cut + 1]
        readings = [*midi.take(part), *midi.take(session.take(part, 0.0)[0]), *decode(part)]
        readings += midi.take(session.take(rtp([part]), 0.0)[0]) if part else []
        assert all(0.0 <= reading.time_s <= 24 * 3600 + 1 for reading in readings)
        session.partner = 1234


def test_a_flood_of_one_message_without_end_is_not_kept() -> None:
    midi = MidiTimecode()
    midi.take(b"\xf0" + b"\x7f" * 1_000_000)
    assert len(midi._data) < 100
