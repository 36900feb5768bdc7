"""Inputs that strangers can send to cost what they may cost, and name the sender of more."""

import asyncio
import random
import socket
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from math import ceil

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as dialect

from gcs.links.intake import FORWARDED, SAVED_S, TURN_S, Arrived, Bound, Intake, sound
from gcs.links.ntrip import Chunked
from gcs.links.reading import READS_MAX, Reader
from gcs.links.rtcm_stream import RtcmStream
from gcs.links.rtk import CORRECTIONS
from gcs.links.targets.cot import CotStream
from gcs.links.targets.gpsd import GpsdStream
from gcs.links.targets.mavlink import TELEMETRY, TargetReports
from gcs.links.targets.nmea import NmeaStream
from gcs.links.targets.receive import TARGETS
from gcs.mavlink.codec import split
from gcs.model.errors import LinkError
from gcs.shows.timecode import Chase
from gcs.shows.timecode.midi import MidiTimecode, quarter_frames
from gcs.shows.timecode.receiver import MIDI, READINGS_MAX, SAMPLE_BYTES, pcm_decoder
from gcs.shows.timecode.rtp_midi import MidiSession
from gcs.shows.timecode.smpte import Rate, label_at
from tests.support.rtcm import base_message, rtcm
from tests.support.target_bytes import cot, gga, rmc, sentence, tpv
from tests.support.target_fakes import aircraft, packed, position, source, vessel
from tests.support.timecode import rtp
from tests.support.work import lines_run

Take = Callable[[bytes], object]
STRANGER = ("192.0.2.9", 4711)
SAMPLES_PER_S = 48_000.0

QUARTERS = b"".join(
    b"".join(quarter_frames(label_at(2.0 * at / 30, Rate.FPS_30), Rate.FPS_30)) for at in range(90)
)
JUNK = {
    "preambles": b"\xd3\x03" * 15_000,
    "short-messages": b"\xd3\x00\x02\x00\x00\x00\x00\x00" * 4000,
    "random": random.Random(1).randbytes(30_000),
    "messages": rtcm(1077, 8) * 4000,
    "places": base_message() * 1000,
    "preambles-in-messages": b"".join(rtcm(kind, 8) for kind in (0xD30, 0xD3) * 2000),
}


def arrived(count: int, size: int = 10) -> list[Arrived]:
    return [Arrived(at.to_bytes(4, "big").ljust(size, b"."), STRANGER) for at in range(count)]


def test_what_is_over_the_bound_is_dropped_and_named() -> None:
    intake = Intake("rtk", Bound(1000.0, 40.0))
    assert intake.admit(arrived(5), 0.0) == arrived(5)
    assert intake.why_over(0.0) == ""
    assert intake.admit(arrived(100), 0.0) == arrived(100)[-5:], "10 messages in a quarter of a second"
    assert (intake.dropped, intake.dropped_bytes) == (95, 950)
    assert intake.why_over(1.0) == "more than 1 kB or 40 messages a second from 192.0.2.9:4711"
    assert intake.why_over(3.0) == ""
    assert len(intake.admit(arrived(100), 0.5)) == 10


def test_of_two_senders_one_is_named_while_it_sends_too_much() -> None:
    """Else the alarm's text would change in every tick; of one that follows, it does within a second."""
    intake, other = Intake("rtk", Bound(1000.0, 40.0)), ("192.0.2.7", 4711)
    for step in range(40):
        sender = STRANGER if step % 2 == 0 else other
        intake.admit([Arrived(b"x", sender)] * 100, step * TURN_S)
        assert intake.why_over(step * TURN_S).endswith("from 192.0.2.9:4711")
    for step in range(40, 62):
        intake.admit([Arrived(b"x", other)] * 100, step * TURN_S)
    assert intake.why_over(61 * TURN_S).endswith("from 192.0.2.7:4711")


def test_bytes_are_bounded_as_messages_are() -> None:
    intake = Intake("rtk", Bound(1000.0))
    assert len(intake.admit(arrived(100, 50), 0.0)) == 5
    assert intake.tail(b"abc" * 100, "/dev/ttyUSB0", 0.1) == (b"abc" * 100)[-100:]
    assert intake.why_over(0.1) == "more than 1 kB a second from /dev/ttyUSB0"
    passed = sum(len(intake.tail(bytes(500), "x", 1.0 + 0.05 * tick)) for tick in range(200))
    assert passed <= 1000.0 * (10.0 + SAVED_S)


def test_usual_corrections_and_timecode_are_below_the_bounds() -> None:
    rtk, midi = Intake("rtk", CORRECTIONS), Intake("timecode", MIDI)
    for tenth in range(100):
        assert rtk.tail(bytes(2800), "x", 0.1 * tenth) == bytes(2800), "four constellations at 10 Hz"
    for second in range(10):  # a second of RTP that arrives in two clumps
        for half in (0.0, 0.5):
            assert len(midi.admit(arrived(60, 30), second + half)) == 60


@pytest.mark.parametrize("junk", JUNK.values(), ids=list(JUNK))
def test_corrections_cost_the_same_whatever_they_contain(junk: bytes) -> None:
    """As much as may pass in a tick, in any cut: a bounded number of lines of Python, twice for two ticks."""
    tick = int(CORRECTIONS.bytes_per_s * TURN_S)

    def taken(size: int, piece: int) -> int:
        stream = RtcmStream()
        stream.take(junk[:4000])
        return lines_run(
            lambda: [stream.take(junk[at : at + piece]) for at in range(4000, 4000 + size, piece)]
        )

    assert taken(tick, tick) < 12 * tick
    assert taken(2 * tick, tick) < 2.5 * taken(tick, tick) + 500
    by_message = CORRECTIONS.messages_per_s * TURN_S
    assert taken(tick, round(tick / by_message)) < 30 * tick


def test_chunks_of_one_byte_cost_no_more_than_their_bytes() -> None:
    chunks = b"1\r\nx\r\n" * 10_000
    once, twice = (lines_run(partial(Chunked().take, chunks[:size])) for size in (30_000, 60_000))
    assert twice < 2.1 * once < 10 * len(chunks)


def of_corrections() -> Take:
    return RtcmStream().take


def of_midi() -> Take:
    """A line of readings that is long already, and all that arrive fit it."""
    midi, chase, now_s = MidiTimecode(), Chase(1.0, 5.0), 10.0
    for at, reading in enumerate(midi.take(QUARTERS)):
        chase.take(reading, now_s + at / 120)

    def take(data: bytes) -> None:
        for reading in midi.take(data)[-READINGS_MAX:]:
            chase.take(replace(reading, time_s=chase.time_s(now_s)), now_s)

    return take


def of_rtp() -> Take:
    return partial(MidiSession(1, partner=1234).take, now_s=0.0)


def of_sound() -> Take:
    return pcm_decoder(SAMPLES_PER_S)[1]


def of_a_station() -> Take:
    return split


def of_a_target(track: str = "") -> Take:
    return partial(TargetReports(source(track=track), 0.0).take, now_s=0.0)


def of_nmea() -> Take:
    return partial(NmeaStream().take, now_s=0.0)


def of_gpsd() -> Take:
    return partial(GpsdStream().take, now_s=0.0)


def of_tracks() -> Take:
    return partial(CotStream("BOAT").take, now_s=0.0)


SECONDS = b"".join(gga(f"1200{at:02d}") + rmc(f"1200{at:02d}") for at in range(60))
TRACKS = b"".join(cot(f"U{at}", f"C{at}") for at in range(100))
SOUND = sound(SAMPLES_PER_S, SAMPLE_BYTES)
PING = bytes(dialect.MAVLink_ping_message(0, 0, 1, 1).pack(dialect.MAVLink(None, srcSystem=255)))
FLOODS = {
    **{f"rtk-{name}": (CORRECTIONS, junk[:1000], of_corrections) for name, junk in JUNK.items()},
    "midi": (MIDI, QUARTERS, of_midi),
    "midi-by-the-message": (MIDI, QUARTERS[:2], of_midi),
    "midi-junk": (MIDI, JUNK["random"][:1000], of_midi),
    "rtp": (MIDI, rtp([QUARTERS[:200]]), of_rtp),
    "rtp-without-end": (MIDI, rtp([b"\xf8" * 900]), of_rtp),
    "sound-fastest": (SOUND, b"\xff\x7f\x01\x80" * 1024, of_sound),
    "sound-of-ones": (SOUND, (b"\xff\x7f" * 6 + b"\x01\x80" * 6) * 170, of_sound),
    "sound-noise": (SOUND, JUNK["random"][:4096], of_sound),
    "station": (FORWARDED, PING * 60, of_a_station),
    "station-junk": (FORWARDED, b"\xfd\xfe" * 500, of_a_station),
    "target": (TELEMETRY, packed(position()), of_a_target),
    "target-in-large-datagrams": (TELEMETRY, packed(position()) * 30, of_a_target),
    "target-aircraft": (TELEMETRY, packed(vessel(), aircraft()) * 10, partial(of_a_target, "4CA1B2")),
    "target-pings": (TELEMETRY, PING * 60, of_a_target),
    "target-junk": (TELEMETRY, b"\xfd\xfe" * 500, of_a_target),
    "nmea": (TARGETS, SECONDS[:1400], of_nmea),
    "nmea-shortest": (TARGETS, sentence("GPVTG,,T,,M,,N,,K") * 60, of_nmea),
    "nmea-junk": (TARGETS, b"$GPGGA,12345678*" * 90, of_nmea),
    "nmea-random": (TARGETS, JUNK["random"][:1400], of_nmea),
    "gpsd": (TARGETS, tpv() * 5, of_gpsd),
    "gpsd-lines": (TARGETS, b'{"class":"TPV"}\n' * 90, of_gpsd),
    "gpsd-empty": (TARGETS, b"\n" * 1400, of_gpsd),
    "cot": (TARGETS, TRACKS[:1400], of_tracks),
    "cot-elements": (TARGETS, cot(detail="<a/>" * 300), of_tracks),
    "cot-shortest": (
        TARGETS,
        b"<event type='a-f-S'><point lat='1' lon='1'/><!-- --></event>" * 20,
        of_tracks,
    ),
    "cot-tags": (TARGETS, b"<event " * 200, of_tracks),
    "cot-ends": (TARGETS, b"</event>" * 170, of_tracks),
}


@pytest.mark.alternates(0)
@pytest.mark.parametrize(("bound", "piece", "made"), FLOODS.values(), ids=list(FLOODS))
def test_ten_times_the_bound_is_little_work_in_every_tick(
    bound: Bound, piece: bytes, made: Callable[[], Take]
) -> None:
    """Ten times the bytes, or the messages, for two seconds: lines of Python in each tick, and the name.

    A core runs 60,000 such lines in a few milliseconds; the first tick has what was saved up.
    """
    intake, take = Intake("input", bound), made()
    take(piece)  # compiles
    count = min(bound.bytes_per_s / len(piece), bound.messages_per_s) * 10 * TURN_S
    flood = [Arrived(piece, STRANGER)] * ceil(count)
    took = [0] * 40

    for tick in range(len(took)):
        now_s = TURN_S * tick
        admitted = b"".join(data for data, _ in intake.admit(flood, now_s))
        took[tick] = lines_run(partial(take, admitted))
    assert max(took) < 60_000
    assert sum(took) / len(took) < 20_000
    assert intake.dropped >= 0.7 * len(flood) * len(took)
    assert intake.why_over(now_s).endswith("a second from 192.0.2.9:4711")


def test_ten_times_the_reads_are_spread_over_ten_turns() -> None:
    taken: list[tuple[int, float]] = []

    async def main() -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        done = asyncio.Event()
        with closing(ours), closing(theirs):
            waiting = iter(arrived(10 * READS_MAX))

            def read() -> Arrived:
                if (one := next(waiting, None)) is None:
                    done.set()
                    raise BlockingIOError
                return one

            reader = Reader(ours.fileno(), read, lambda found, now_s: taken.append((len(found), now_s)))
            theirs.send(b"x")
            await done.wait()
            reader.close()

    asyncio.run(main())
    counts, times_s = zip(*taken, strict=True)
    assert counts == (READS_MAX,) * 10
    assert min(np.diff(times_s)) >= 0.99 * TURN_S


def test_an_input_that_ends_says_why() -> None:
    async def main() -> None:
        ours, theirs = socket.socketpair()
        with closing(ours), closing(theirs):

            def read() -> Arrived:
                raise LinkError("it has ended")

            reader = Reader(ours.fileno(), read, lambda *_: None)
            theirs.send(b"x")
            with pytest.raises(LinkError, match="it has ended"):
                await reader.ended

    asyncio.run(main())
