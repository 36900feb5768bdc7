"""Receives timecode: MIDI over RTP or UDP, from a MIDI port, or sound with linear timecode out of a pipe."""

import asyncio
import logging
import os
import secrets
import socket
import stat
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Final, Protocol, TypeAlias

import numpy as np

from gcs.links.features import TimecodeSettings
from gcs.links.intake import Arrived, Bound, Intake, sound
from gcs.links.reading import BUFFER_BYTES, Reader
from gcs.model.errors import LinkError
from gcs.shows.timecode.ltc import LinearTimecode
from gcs.shows.timecode.midi import MidiTimecode
from gcs.shows.timecode.rtp_midi import MidiSession
from gcs.shows.timecode.smpte import Reading

log = logging.getLogger(__name__)

MIDI: Final = Bound(10_000, 1000)
"""Timecode is 120 messages a second of 2 bytes, of about 30 over RTP; a cable carries 3,125 bytes."""

RETRY_S: Final = 2.0

DATAGRAM_BYTES: Final = 1500
"""What is longer is cut: timecode needs a few bytes."""

READINGS_MAX: Final = 120
"""Of those that arrive at once: a second of timecode."""

CHUNK_BYTES: Final = 4096
SAMPLE_BYTES: Final = 2
_FULL_SCALE: Final = 32768.0


class Sink(Protocol):
    """Takes what a source sends."""

    def take(self, reading: Reading, now_s: float) -> None:
        """Take a reading."""

    def count(self, garbage: int) -> None:
        """Note how many messages made no sense since the source opened."""

    def failed(self, why: str) -> None:
        """Note why nothing can be received."""


Decode: TypeAlias = Callable[[bytes], list[Reading]]


def bound_of(settings: TimecodeSettings | None) -> Bound:
    """What may be parsed of a source in a second."""
    if settings is None or settings.scheme != "ltc":
        return MIDI
    return sound(settings.sample_rate_hz, SAMPLE_BYTES)


async def keep_receiving(settings: TimecodeSettings, sink: Sink, intake: Intake) -> None:
    """Receive without end; a source that fails is opened again."""
    logged = ""
    while True:
        try:
            if settings.scheme == "rtp-midi":
                await _receive_rtp(*settings.address, sink, intake)
            elif settings.scheme == "udp-midi":
                await _receive_udp(*settings.address, sink, intake)
            else:
                await _receive_file(settings, sink, intake)
        except (OSError, LinkError) as error:
            why = str(error)
        if why != logged:
            log.warning("timecode_interrupted", extra={"source": settings.source, "cause": why})
        logged = why
        sink.failed(why)
        await asyncio.sleep(RETRY_S)


def _give(sink: Sink, readings: Sequence[Reading]) -> None:
    """Give readings that arrived at once to the sink: the newest, if there are too many."""
    now_s = asyncio.get_running_loop().time()
    for reading in readings[-READINGS_MAX:]:
        sink.take(reading, now_s)


async def _receive_udp(host: str, port: int, sink: Sink, intake: Intake) -> None:
    """MIDI messages as they are, in datagrams."""
    midi = MidiTimecode()

    def take(arrived: list[Arrived], now_s: float) -> None:
        admitted = intake.admit(arrived, now_s)
        _give(sink, [reading for data, _ in admitted for reading in midi.take(data)])
        sink.count(midi.garbage)

    with _bound(host, port) as port_of_data:
        await _read([_reader(port_of_data, take)])


async def _receive_rtp(host: str, port: int, sink: Sink, intake: Intake) -> None:
    """A session of which somebody else is the initiator: its commands at `port`, MIDI at the one after it."""
    midi, session = MidiTimecode(), MidiSession(secrets.randbits(32))

    def take(through: socket.socket, arrived: list[Arrived], now_s: float) -> None:
        readings: list[Reading] = []
        for data, sender in intake.admit(arrived, now_s):
            midi_bytes, answer = session.take(data, now_s)
            readings += midi.take(midi_bytes)
            if answer:
                with suppress(OSError):  # no room, no route: the other side asks again
                    through.sendto(answer, sender)
        _give(sink, readings)
        sink.count(midi.garbage + session.refused)

    with _bound(host, port) as commands, _bound(host, port + 1) as messages:
        await _read([_reader(end, partial(take, end)) for end in (commands, messages)])


def _bound(host: str, port: int) -> socket.socket:
    """A UDP socket that never blocks. Raises: OSError."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        bound.setblocking(False)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        bound.bind((host, port))
    except OSError:
        bound.close()
        raise
    return bound


def _reader(bound: socket.socket, take: Callable[[list[Arrived], float], None]) -> Reader:
    return Reader(bound.fileno(), lambda: Arrived(*bound.recvfrom(DATAGRAM_BYTES)), take)


async def _read(readers: Sequence[Reader]) -> None:
    """Read until one of them ends. Raises: OSError, LinkError with why."""
    try:
        await asyncio.gather(*(reader.ended for reader in readers))
    finally:
        for reader in readers:
            reader.close()


def pcm_decoder(sample_rate_hz: float) -> tuple[LinearTimecode, Decode]:
    """Decode sound of one channel, 16 bits, little endian; an odd byte waits for the next."""
    linear, rest = LinearTimecode(sample_rate_hz), b""

    def decode(data: bytes) -> list[Reading]:
        nonlocal rest
        data = rest + data
        whole = len(data) - len(data) % SAMPLE_BYTES
        rest = data[whole:]
        return linear.take(np.frombuffer(data[:whole], "<i2") / _FULL_SCALE)

    return linear, decode


def _opened(path: Path) -> int:
    """Open a pipe or a device; neither waits. Raises: OSError, LinkError."""
    mode = path.stat().st_mode
    if not (stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)):
        raise LinkError(f"{path}: a pipe or a device is needed, as a file is no clock")
    # a pipe that is also open for writing has no end when its writer goes
    access = os.O_RDWR if stat.S_ISFIFO(mode) else os.O_RDONLY
    return os.open(path, access | os.O_NONBLOCK | os.O_CLOEXEC)


async def _receive_file(settings: TimecodeSettings, sink: Sink, intake: Intake) -> None:
    """A MIDI port's device, or a pipe with sound."""
    path = Path(settings.path)
    reader: MidiTimecode | LinearTimecode
    decode: Decode
    if settings.scheme == "midi":
        reader = MidiTimecode()
        decode = reader.take
    else:
        reader, decode = pcm_decoder(settings.sample_rate_hz)
    source = _opened(path)

    def read() -> Arrived:
        data = os.read(source, CHUNK_BYTES)
        if not data:
            raise LinkError(f"{path} has ended")
        return Arrived(data, settings.path)

    def take(arrived: list[Arrived], now_s: float) -> None:
        admitted = intake.admit(arrived, now_s)
        _give(sink, [reading for data, _ in admitted for reading in decode(data)])
        sink.count(reader.garbage)

    try:
        await _read([Reader(source, read, take)])
    finally:
        os.close(source)
