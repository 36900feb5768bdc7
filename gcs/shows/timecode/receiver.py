"""Receives timecode: MIDI over RTP or UDP, from a MIDI port, or sound with linear timecode out of a pipe."""

import asyncio
import logging
import os
import secrets
import stat
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol, TypeAlias, cast

import numpy as np

from gcs.config.sections import TimecodeSettings
from gcs.model.errors import LinkError
from gcs.shows.timecode.ltc import LinearTimecode
from gcs.shows.timecode.midi import MidiTimecode
from gcs.shows.timecode.rtp_midi import Session
from gcs.shows.timecode.smpte import Reading

log = logging.getLogger(__name__)

RETRY_S: Final = 2.0

DATAGRAM_MAX: Final = 1500
DATAGRAMS_PER_S: Final = 1000
"""What is longer or more is dropped unread: timecode needs 120 a second, of a few bytes."""

CHUNK_BYTES: Final = 4096
MIDI_BYTES_PER_S: Final = 20_000
"""Likewise of a MIDI port; a cable carries 3,125."""

SOUND_AHEAD: Final = 2.0
"""Sound that comes faster than it was played, times this, is dropped: it has no use as a clock."""

SAMPLE_BYTES: Final = 2
_FULL_SCALE: Final = 32768.0


class Sink(Protocol):
    """Takes what a source sends."""

    def take(self, reading: Reading) -> None:
        """Take a reading."""

    def count(self, garbage: int, dropped: int) -> None:
        """Note how many messages made no sense, and how many were dropped unread, since the source opened."""

    def failed(self, why: str) -> None:
        """Note why nothing can be received."""


Decode: TypeAlias = Callable[[bytes], list[Reading]]


@dataclass(slots=True)
class Limit:
    """Lets so much pass in a second of the loop's clock."""

    per_s: float
    dropped: int = 0
    _second: int = 0
    _passed: float = field(default=0.0)

    def passes(self, size: float, now_s: float) -> bool:
        """Whether this much may pass now."""
        if int(now_s) != self._second:
            self._second, self._passed = int(now_s), 0.0
        self._passed += size
        if self._passed <= self.per_s:
            return True
        self.dropped += 1
        return False


async def keep_receiving(settings: TimecodeSettings, sink: Sink) -> None:
    """Receive without end; a source that fails is opened again."""
    known = ""
    while True:
        try:
            if settings.scheme == "rtp-midi":
                await _receive_rtp(*settings.address, sink)
            elif settings.scheme == "udp-midi":
                await _receive_udp(*settings.address, sink)
            else:
                await _receive_file(settings, sink)
        except (OSError, LinkError) as error:
            why = str(error)
        if why != known:
            log.warning("timecode_interrupted", extra={"source": settings.source, "cause": why})
        known = why
        sink.failed(why)
        await asyncio.sleep(RETRY_S)


class _Datagrams(asyncio.DatagramProtocol):
    """Gives each datagram to a function, which returns the answer to it."""

    def __init__(self, receive: Callable[[bytes], bytes], failed: asyncio.Future[None]) -> None:
        self.limit = Limit(DATAGRAMS_PER_S)
        self._receive, self._failed = receive, failed
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.DatagramTransport", transport)  # asyncio's own is not one by class

    def connection_lost(self, exc: Exception | None) -> None:
        if not self._failed.done():
            self._failed.set_exception(exc or LinkError("the port was closed"))

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        now_s = asyncio.get_running_loop().time()
        if not self.limit.passes(1.0, now_s) or len(data) > DATAGRAM_MAX:
            return
        answer = self._receive(data)
        if answer and self._transport is not None:
            self._transport.sendto(answer, addr)


async def _receive_udp(host: str, port: int, sink: Sink) -> None:
    """MIDI messages as they are, in datagrams."""
    loop, midi = asyncio.get_running_loop(), MidiTimecode()
    failed = loop.create_future()

    def receive(data: bytes) -> bytes:
        for reading in midi.take(data):
            sink.take(reading)
        sink.count(midi.garbage, protocol.limit.dropped)
        return b""

    protocol = _Datagrams(receive, failed)
    transport, _ = await loop.create_datagram_endpoint(lambda: protocol, local_addr=(host, port))
    try:
        await failed
    finally:
        transport.close()


async def _receive_rtp(host: str, port: int, sink: Sink) -> None:
    """A session of which somebody else is the initiator: its commands at `port`, MIDI at the one after it."""
    loop, midi, session = asyncio.get_running_loop(), MidiTimecode(), Session(secrets.randbits(32))
    failed = loop.create_future()

    def receive(data: bytes) -> bytes:
        found, answer = session.take(data, loop.time())
        for reading in midi.take(found):
            sink.take(reading)
        sink.count(midi.garbage + session.refused, control.limit.dropped + datas.limit.dropped)
        return answer

    control, datas = _Datagrams(receive, failed), _Datagrams(receive, failed)
    commands, _ = await loop.create_datagram_endpoint(lambda: control, local_addr=(host, port))
    try:
        messages, _ = await loop.create_datagram_endpoint(lambda: datas, local_addr=(host, port + 1))
        try:
            await failed
        finally:
            messages.close()
    finally:
        commands.close()


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


async def _receive_file(settings: TimecodeSettings, sink: Sink) -> None:
    """A MIDI port's device, or a pipe with sound."""
    loop, path = asyncio.get_running_loop(), Path(settings.path)
    reader: MidiTimecode | LinearTimecode
    decode: Decode
    if settings.scheme == "midi":
        reader = MidiTimecode()
        decode, limit = reader.take, Limit(MIDI_BYTES_PER_S)
    else:
        reader, decode = pcm_decoder(settings.sample_rate_hz)
        limit = Limit(SOUND_AHEAD * SAMPLE_BYTES * settings.sample_rate_hz)
    source = _opened(path)
    ended = loop.create_future()

    def readable() -> None:
        try:
            data = os.read(source, CHUNK_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            loop.remove_reader(source)
            ended.set_exception(error)
            return
        if not data:
            loop.remove_reader(source)
            ended.set_exception(LinkError(f"{path} has ended"))
        elif limit.passes(len(data), loop.time()):
            for reading in decode(data):
                sink.take(reading)
        sink.count(reader.garbage, limit.dropped)

    try:
        loop.add_reader(source, readable)
        await ended
    finally:
        with suppress(ValueError, OSError):
            loop.remove_reader(source)
        os.close(source)
