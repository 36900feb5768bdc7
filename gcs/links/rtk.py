"""RTCM 3 corrections from a base: NTRIP, a serial port, TCP or UDP. Needs the extra `rtk`.

NTRIP is spoken in its first revision, which every caster understands: a GET request as of HTTP/1.0.
"""

import asyncio
import logging
import ssl
from base64 import b64encode
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing
from dataclasses import dataclass
from math import hypot
from typing import Final
from urllib.parse import urlsplit

import serial
from pyrtcm import (
    RTCMMessageError,
    RTCMParseError,
    RTCMReader,
    RTCMTypeError,
    calc_crc24q,
    ecef2llh,
)

from gcs.links.settings import RtkSettings
from gcs.model.errors import LinkError

log = logging.getLogger(__name__)

CHUNK_BYTES: Final = 4096
SILENT_S: Final = 15.0
"""A connection without a byte for so long is opened again."""

RETRY_S: Final = 2.0
_SERIAL_WAIT_S: Final = 0.2
_HEADERS_MAX: Final = 64
_PREAMBLE: Final = 0xD3
_HEAD, _CRC = 3, 3
_ON_EARTH_M: Final = 6e6
"""A base that does not know its place reports the middle of the Earth."""

_STATIONS: Final = frozenset({1005, 1006})
"""Messages with the place of the base."""

Place = tuple[float, float, float]
"""Latitude and longitude in degrees, height above the ellipsoid in m."""


@dataclass(slots=True)
class RtcmStream:
    """Cuts whole, correct RTCM 3 messages out of bytes.

    Attributes:
        garbage_bytes: bytes that belong to no correct message.
        base: the place that the base reports; None: not yet.
    """

    garbage_bytes: int = 0
    base: Place | None = None
    _waiting: bytes = b""

    def take(self, data: bytes) -> list[bytes]:
        """The messages that `data` completes; at most one that is not complete is kept. Never raises."""
        found: list[bytes] = []
        waiting, at = self._waiting + data, 0
        while True:
            begin = waiting.find(_PREAMBLE, at)
            self.garbage_bytes += (len(waiting) if begin < 0 else begin) - at
            if begin < 0:
                self._waiting = b""
                return found
            at = begin
            if len(waiting) - at < _HEAD:
                break
            size = int.from_bytes(waiting[at + 1 : at + 3], "big")
            end = at + _HEAD + size + _CRC
            reserved = size >> 10 != 0
            if not reserved and len(waiting) < end:
                break
            if reserved or size < 2 or calc_crc24q(waiting[at:end]):
                self.garbage_bytes += 1
                at += 1
                continue
            found.append(waiting[at:end])
            self._note_base(waiting[at:end])
            at = end
        self._waiting = waiting[at:]
        return found

    def _note_base(self, message: bytes) -> None:
        if int.from_bytes(message[3:5], "big") >> 4 not in _STATIONS:
            return
        try:
            parsed = RTCMReader.parse(message)
        except (RTCMMessageError, RTCMParseError, RTCMTypeError):  # too short, with a right checksum
            return
        ecef_m = float(parsed.DF025), float(parsed.DF026), float(parsed.DF027)
        if hypot(*ecef_m) > _ON_EARTH_M:
            latitude_deg, longitude_deg, height_m = ecef2llh(*ecef_m)
            self.base = float(latitude_deg), float(longitude_deg), float(height_m)


async def keep_receiving(
    settings: RtkSettings, take: Callable[[bytes, Place | None], None], failed: Callable[[str], None]
) -> None:
    """Receive without end: give each message to `take`, and why a connection ended to `failed`."""
    known = ""
    while True:
        stream = RtcmStream()
        try:
            async with aclosing(_chunks(settings)) as chunks:
                async for data in chunks:
                    for message in stream.take(data):
                        known = ""
                        take(message, stream.base)
            why = "the source has ended the connection"
        except (OSError, EOFError, UnicodeError, LinkError) as error:  # UnicodeError: a host name
            why = str(error) or type(error).__name__
        if why != known:
            log.warning("corrections_interrupted", extra={"source": settings.source, "cause": why})
        known = why
        failed(why)
        await asyncio.sleep(RETRY_S)


def _chunks(settings: RtkSettings) -> AsyncGenerator[bytes, None]:
    url = urlsplit(settings.source)
    if url.scheme == "serial":
        return _serial_chunks(*settings.device)
    if url.scheme == "udp":
        return _udp_chunks(url.hostname or "", url.port or 0)
    return _stream_chunks(settings)


async def _serial_chunks(device: str, baud: int) -> AsyncGenerator[bytes, None]:
    with serial.Serial(device, baud, timeout=_SERIAL_WAIT_S) as port:
        silent_s = 0.0
        while silent_s < SILENT_S:
            data: bytes = await asyncio.to_thread(port.read, max(1, min(port.in_waiting, CHUNK_BYTES)))
            silent_s = 0.0 if data else silent_s + _SERIAL_WAIT_S
            yield data
    raise LinkError(f"{device}: nothing for {SILENT_S:g} s")


class _Queue(asyncio.DatagramProtocol):
    def __init__(self) -> None:
        self.arrived: asyncio.Queue[bytes] = asyncio.Queue(64)

    def datagram_received(self, data: bytes, addr: object) -> None:  # noqa: ARG002 (asyncio names it)
        if not self.arrived.full():
            self.arrived.put_nowait(data)


async def _udp_chunks(host: str, port: int) -> AsyncGenerator[bytes, None]:
    loop = asyncio.get_running_loop()
    transport, queue = await loop.create_datagram_endpoint(_Queue, local_addr=(host, port))
    try:
        while True:
            yield await queue.arrived.get()
    finally:
        transport.close()


async def _stream_chunks(settings: RtkSettings) -> AsyncGenerator[bytes, None]:
    url = urlsplit(settings.source)
    secure = ssl.create_default_context() if url.scheme == "ntrips" else None
    async with asyncio.timeout(SILENT_S):
        reader, writer = await asyncio.open_connection(url.hostname, url.port, ssl=secure, limit=1 << 16)
    try:
        if url.scheme != "tcp":
            async with asyncio.timeout(SILENT_S):
                await _ask_caster(reader, writer, url.path, settings)
        while True:
            async with asyncio.timeout(SILENT_S):
                data = await reader.read(CHUNK_BYTES)
            if not data:
                return
            yield data
    finally:
        writer.close()


async def _ask_caster(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, path: str, settings: RtkSettings
) -> None:
    """Ask for a mount point. Raises: LinkError with the caster's answer."""
    lines = [f"GET {path} HTTP/1.0", "User-Agent: NTRIP formation-gcs", "Accept: */*"]
    if settings.user:
        word = b64encode(f"{settings.user}:{settings.password()}".encode()).decode()
        lines.append(f"Authorization: Basic {word}")
    writer.write("\r\n".join([*lines, "", ""]).encode())
    answer = (await _line(reader)).strip()
    if answer.startswith("SOURCETABLE"):
        raise LinkError(f"the caster has no mount point {path}")
    if " 200" not in answer:
        raise LinkError(f"the caster answers {answer[:80]!r}")
    if not answer.startswith("ICY"):  # an HTTP answer has headers; of ICY the data begins at once
        for _ in range(_HEADERS_MAX):
            if not (await _line(reader)).strip():
                return
        raise LinkError("the caster's answer has no end")


async def _line(reader: asyncio.StreamReader) -> str:
    try:
        return (await reader.readuntil(b"\n")).decode("latin-1")
    except asyncio.LimitOverrunError as error:
        raise LinkError("the caster answers with a line that is too long") from error
