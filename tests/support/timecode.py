"""Makes timecode as its sources do: MIDI messages with their times, sound, sessions over RTP."""

import struct
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from math import nan
from typing import NamedTuple

import numpy as np

from gcs.model.state import Array
from gcs.service.features import TimecodeView
from gcs.shows.timecode import ltc
from gcs.shows.timecode.midi import PIECES, SYSEX, SYSEX_END, quarter_frames
from gcs.shows.timecode.smpte import Label, Rate, label_at

NAMED = tuple(rate for rate in Rate if rate is rate.nominal)
"""Rates that a label names; 23.976 and 29.97 have the labels of 24 and 30."""


def frame_bits(label: Label, rate: Rate) -> list[int]:
    """The 80 bits of a frame, without user bits."""
    bits = ltc.SYNC << ltc.BITS - 16 | (rate is Rate.FPS_29_97_DROP) << 10
    places = ((48, 56), (32, 40), (16, 24), (0, 8))
    values = label.hours, label.minutes, label.seconds, label.frames
    for value, (units, tens) in zip(values, places, strict=True):
        bits |= value % 10 << units | value // 10 << tens
    return [bits >> at & 1 for at in range(ltc.BITS)]


def full_frame(label: Label, rate: Rate) -> bytes:
    """The message that says where a source stands."""
    hours = label.hours | rate.midi << 5
    return bytes((SYSEX, 0x7F, 0x7F, 1, 1, hours, label.minutes, label.seconds, label.frames, SYSEX_END))


class Sent(NamedTuple):
    """One message and when it leaves, in s since the timecode began to run."""

    at_s: float
    message: bytes


def running(start: Label, rate: Rate, speed: float = 1.0) -> Iterator[Sent]:
    """The quarter frames of a timecode that runs from `start`, which has an even number of frames, on."""
    quarter_s = 0.25 / rate.per_s
    begin_s = start.time_s(rate)
    for number in count():
        label = label_at(begin_s + (2 * number + 0.5) / rate.per_s, rate)
        for piece, message in enumerate(quarter_frames(label, rate)):
            yield Sent((PIECES * number + piece) * quarter_s / speed, message)


def sound(
    start: Label,
    rate: Rate,
    seconds: float,
    sample_rate_hz: float,
    *,
    speed: float = 1.0,
    level: float = 0.5,
    noise: float = 0.0,
    seed: int = 1,
) -> Array:
    """(k,) samples of linear timecode from `start` on."""
    begin_s, halves, sign = start.time_s(rate), [], 1.0
    for number in range(int(seconds * rate.per_s * speed) + 1):
        for bit in frame_bits(label_at(begin_s + (number + 0.5) / rate.per_s, rate), rate):
            sign = -sign
            halves.append(sign)
            sign = -sign if bit else sign
            halves.append(sign)
    per_s = 2 * 80 * rate.per_s * speed
    at = (np.arange(int(seconds * sample_rate_hz)) * per_s / sample_rate_hz).astype(int)
    samples = level * np.array(halves)[at]
    return np.asarray(samples + noise * np.random.default_rng(seed).standard_normal(len(samples)))


def pcm(samples: Array) -> bytes:
    """16 bits, little endian."""
    return (np.clip(samples, -1.0, 1.0) * 32767.0).astype("<i2").tobytes()


def late(jitter_s: float, seed: int) -> Callable[[], float]:
    """Delays of messages on their way: mostly short, some long, about `jitter_s` in the mean."""
    rng = np.random.default_rng(seed)
    return lambda: float(rng.gamma(2.0, jitter_s / 2.0))


INVITATION = b"\xff\xffIN" + struct.pack(">III", 2, 77, 1234) + b"desk\0"
END = b"\xff\xffBY" + struct.pack(">III", 2, 77, 1234)
SYNC = b"\xff\xffCK" + struct.pack(">IB3xQQQ", 1234, 0, 111, 0, 0)


def rtp(messages: Sequence[bytes], sequence: int = 1, sender: int = 1234) -> bytes:
    """A packet with these MIDI messages."""
    commands = bytearray()
    for number, message in enumerate(messages):
        if number:
            commands += b"\x00"  # the time since the one before
        commands += message
    size = len(commands)
    head = bytes((size,)) if size < 16 else struct.pack(">H", 0x8000 | size)
    return struct.pack(">BBHII", 0x80, 0x61, sequence, 0, sender) + head + bytes(commands)


VIEW = TimecodeView(
    source="udp-midi://127.0.0.1:5006",
    followed=True,
    state="running",
    label="01:00:02:12",
    frame_rate="25",
    age_s=nan,
    behind_s=0.012,
    slope=1.0,
    tempo=1.001,
    problem="",
    readings=80,
    garbage=1,
    dropped=0,
)
"""A timecode that a show follows, as the service reports it."""
