"""RTCM 3 corrections from a base: NTRIP, a serial port, TCP or UDP."""

import asyncio
import ssl
from collections.abc import Callable
from functools import partial
from typing import Final
from urllib.parse import urlsplit

from gcs.links.byte_sources import (
    Body,
    ByteSource,
    Chunks,
    Feed,
    keep_reading,
    plainly,
    serial_chunks,
    stream_chunks,
    udp_chunks,
)
from gcs.links.features import RtkSettings
from gcs.links.intake import Bound, Intake
from gcs.links.ntrip import ask_caster
from gcs.links.rtcm_stream import Place, RtcmStream

CORRECTIONS: Final = Bound(64_000, 1000)
"""RTCM 3: a base of four constellations sends 1 to 2 kB/s, at 10 Hz up to 28 kB/s."""


async def keep_receiving(
    settings: RtkSettings,
    take: Callable[[bytes, Place | None, float], None],
    failed: Callable[[str], None],
    intake: Intake,
) -> None:
    """Receive without end: give each message to `take`, why there are none to `failed`."""
    clock = asyncio.get_running_loop().time

    def begin() -> Feed:
        stream = RtcmStream()

        def feed(data: bytes) -> int:
            messages = stream.take(data)
            for message in messages:
                take(message, stream.base, clock())
            return len(messages)

        return feed

    opened = partial(_chunks, settings, intake)
    await keep_reading(
        ByteSource(settings.source, "RTCM 3", "corrections_interrupted", opened, begin), failed
    )


def _chunks(settings: RtkSettings, intake: Intake) -> Chunks:
    url = urlsplit(settings.source)
    if url.scheme == "serial":
        return serial_chunks(settings.device, intake)
    host, port = url.hostname or "", url.port or 0
    if url.scheme == "udp":
        return udp_chunks(host, port, intake)

    async def ask(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> Body:
        return await ask_caster(reader, writer, url.path, settings.login())

    secure = ssl.create_default_context if url.scheme == "ntrips" else None
    return stream_chunks(host, port, intake, secure=secure, ask=plainly if url.scheme == "tcp" else ask)
