"""RTCM 3 corrections from a base: NTRIP, a serial port, TCP or UDP."""

import asyncio
import logging
import socket
import ssl
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing
from typing import Final
from urllib.parse import urlsplit

import serial

from gcs.links.features import RtkSettings
from gcs.links.intake import TURN_S, Bound, Intake
from gcs.links.ntrip import Chunked, Plain, ask_caster
from gcs.links.reading import BUFFER_BYTES, datagrams
from gcs.links.rtcm_stream import Place, RtcmStream
from gcs.model.errors import LinkError, quoted

log = logging.getLogger(__name__)

CORRECTIONS: Final = Bound(64_000, 1000)
"""RTCM 3: a base of four constellations sends 1 to 2 kB/s, at 10 Hz up to 28 kB/s."""

CHUNK_BYTES: Final = 8192
"""Most that is read of a serial port in a turn."""

SILENT_S: Final = 15.0
"""A connection without a byte for so long is opened again."""

RETRY_S: Final = 2.0
GARBAGE_BYTES: Final = 4096
"""A source that sends so much without one correct message is named."""

_WAITING_BYTES: Final = 1 << 16
_SERIAL_WAIT_S: Final = 0.2
_SHOWN_BYTES: Final = 40


async def keep_receiving(
    settings: RtkSettings,
    take: Callable[[bytes, Place | None, float], None],
    failed: Callable[[str], None],
    intake: Intake,
) -> None:
    """Receive without end: give each message to `take`, why there are none to `failed`."""
    logged, clock = "", asyncio.get_running_loop().time
    while True:
        stream, messages, useless_bytes, first = RtcmStream(), 0, 0, b""
        try:
            async with aclosing(_chunks(settings, intake)) as chunks:
                async for data in chunks:
                    first = first or data[:_SHOWN_BYTES]
                    useless_bytes += len(data)
                    for message in stream.take(data):
                        logged, useless_bytes, messages = "", 0, messages + 1
                        take(message, stream.base, clock())
                    if useless_bytes > GARBAGE_BYTES:
                        failed(f"more than {GARBAGE_BYTES} bytes without a message of RTCM 3")
            why = "the source has ended the connection"
            if first and not messages:
                why += f", and sent no RTCM 3: {quoted(first)}"
        except (OSError, EOFError, UnicodeError, LinkError) as error:  # UnicodeError: a host name
            why = str(error) or type(error).__name__
        if why != logged:
            log.warning("corrections_interrupted", extra={"source": settings.source, "cause": why})
        logged = why
        failed(why)
        await asyncio.sleep(RETRY_S)


def _chunks(settings: RtkSettings, intake: Intake) -> AsyncGenerator[bytes, None]:
    url = urlsplit(settings.source)
    if url.scheme == "serial":
        return _serial_chunks(*settings.device, intake)
    if url.scheme == "udp":
        return _udp_chunks(url.hostname or "", url.port or 0, intake)
    return _stream_chunks(settings, intake)


async def _serial_chunks(device: str, baud: int, intake: Intake) -> AsyncGenerator[bytes, None]:
    clock = asyncio.get_running_loop().time
    with serial.Serial(device, baud, timeout=_SERIAL_WAIT_S) as port:
        silent_s = 0.0
        while silent_s < SILENT_S:
            data: bytes = await asyncio.to_thread(port.read, max(1, min(port.in_waiting, CHUNK_BYTES)))
            silent_s = 0.0 if data else silent_s + _SERIAL_WAIT_S
            yield intake.tail(data, device, clock())
            await asyncio.sleep(TURN_S if data else 0.0)
    raise LinkError(f"{device}: nothing for {SILENT_S:g} s")


async def _udp_chunks(host: str, port: int, intake: Intake) -> AsyncGenerator[bytes, None]:
    async with aclosing(datagrams(host, port, intake)) as batches:
        async for batch in batches:
            yield b"".join(datagram.data for datagram in batch)


async def _stream_chunks(settings: RtkSettings, intake: Intake) -> AsyncGenerator[bytes, None]:
    url = urlsplit(settings.source)
    secure = ssl.create_default_context() if url.scheme == "ntrips" else None
    async with asyncio.timeout(SILENT_S):
        reader, writer = await asyncio.open_connection(
            url.hostname, url.port, ssl=secure, limit=_WAITING_BYTES
        )
    # what waits in the kernel is never older than some turns
    writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
    clock, place = asyncio.get_running_loop().time, f"{url.hostname}:{url.port}{url.path}"
    try:
        body: Plain | Chunked = Plain()
        if url.scheme != "tcp":
            async with asyncio.timeout(SILENT_S):
                body = await ask_caster(reader, writer, url.path, settings.login())
        while not body.ended:
            async with asyncio.timeout(SILENT_S):
                data = await reader.read(body.turn_bytes)
            if not data:
                return
            yield intake.tail(body.take(data), place, clock())
            await asyncio.sleep(TURN_S)
    finally:
        writer.close()
