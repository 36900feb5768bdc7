"""Runs one source of a target without end. What its kind receives is one row of `RECEIVERS`."""

import asyncio
import ssl
from collections.abc import Awaitable, Callable
from functools import partial
from math import inf
from typing import Any, Final, Protocol, TypeAlias
from urllib.parse import urlsplit

from gcs.links.byte_sources import (
    SILENT_S,
    Body,
    ByteSource,
    Chunks,
    Feed,
    Plain,
    keep_reading,
    plainly,
    secured,
    serial_chunks,
    stream_chunks,
    udp_chunks,
)
from gcs.links.intake import Bound, Intake
from gcs.links.settings import serial_port
from gcs.links.tak.settings import OwnTracks
from gcs.links.targets import mavlink, path
from gcs.links.targets.cot import CotStream, CotTraffic
from gcs.links.targets.gpsd import WATCH, GpsdStream
from gcs.links.targets.nmea import NmeaStream
from gcs.links.targets.settings import (
    CotSource,
    CotTracks,
    GpsdSource,
    MavlinkTracks,
    NmeaSource,
    RestSource,
    TargetSource,
    TrafficSource,
)
from gcs.links.targets.traffic import TrafficReports
from gcs.model.target_fix import TargetFix

TARGETS: Final = Bound(128_000, 1000)
"""A receiver sends up to 15 kB/s at 10 Hz, a server of TAK about 1 kB of each track every second."""

FIXES_MAX, TRACKS_MAX = 20, 200
"""Of those that arrive at once, the newest: of one target, and of all traffic."""


ECHO: Final = Bound(1000, 1)
"""For each own track: what is sent to TAK may come back once a second, and must not displace others."""


def intake_of(name: str, source: TargetSource | TrafficSource, own: OwnTracks) -> Intake:
    """What bounds a source of that target, or of traffic."""
    bound = mavlink.TELEMETRY if source.kind == "mavlink" else TARGETS
    if source.kind == "cot":
        bound = Bound(*(most + own.number * each for most, each in zip(TARGETS, ECHO, strict=True)))
    return Intake(f"{name} {source.kind}", bound)


PATIENCE_S: Final = 2.0
"""What is wrong is named when there was no fix for so long: beside fixes it concerns other reports."""

Take: TypeAlias = Callable[[TargetFix], None]
Failed: TypeAlias = Callable[[str], None]


async def keep_receiving(
    source: TargetSource, own: OwnTracks, take: Take, failed: Failed, intake: Intake
) -> None:
    """Receive without end, whatever arrives: give each fix to `take`, and why there are none to `failed`.

    A reason is given once; empty ends it: there are fixes again. Tracks that are `own` are no targets.
    """
    if isinstance(source, CotSource):
        begin = partial(CotStream, source.track, source.geoid_m, own.uid)
        await _keep_cot(source, begin, _Reports(take, failed), intake)
    else:
        await RECEIVERS[source.kind](source, take, failed, intake)


class TargetStream(Protocol):
    """Fixes of one connection."""

    messages: int
    """Correct messages so far."""
    why: str
    """Why the newest bytes brought no fix; empty: not known, or they did."""

    def take(self, data: bytes, now_s: float) -> list[TargetFix]:
        """The fixes that these bytes complete. Never raises."""


class _Reports:
    """Gives fixes, and why there are none: each reason once."""

    def __init__(self, take: Take, failed: Failed, most: int = FIXES_MAX) -> None:
        self._take, self._failed, self._most = take, failed, most
        self._clock = asyncio.get_running_loop().time
        self._reason = self._why = ""
        self._fixed_s = self._begin_s = -inf

    def failed(self, why: str) -> None:
        if why != self._reason:
            self._reason = why
            self._failed(why)

    def begin(self, stream: TargetStream) -> Feed:
        """Begin a connection. Returns: what takes its bytes."""
        self._why, self._begin_s = "", self._clock()
        return partial(self._feed, stream)

    def _feed(self, stream: TargetStream, data: bytes) -> int:
        before, now_s = stream.messages, self._clock()
        fixes = stream.take(data, now_s)
        count = stream.messages - before or int(bool(stream.why))
        if fixes:
            self._fixed_s, self._why = now_s, ""
            self.failed("")
            for fix in fixes[-self._most :]:
                self._take(fix)
            return count
        self._why = stream.why or self._why
        if count and now_s - max(self._fixed_s, self._begin_s) >= SILENT_S:
            self.failed(self._why or f"no fix for {SILENT_S:g} s")
        elif self._why and now_s - self._fixed_s >= PATIENCE_S:
            self.failed(self._why)
        return count


async def _keep_nmea(source: NmeaSource, take: Take, failed: Failed, intake: Intake) -> None:
    speaks = "NMEA 0183 (GGA, GNS, RMC)"
    await _keep(source.at, speaks, partial(_opened, source.at, intake), NmeaStream, _Reports(take, failed))


async def _keep_gpsd(source: GpsdSource, take: Take, failed: Failed, intake: Intake) -> None:
    opened = partial(_opened, source.at, intake, ask=_watch)
    await _keep(source.at, "gpsd", opened, partial(GpsdStream, source.device), _Reports(take, failed))


async def _keep_cot(
    source: CotTracks, begin: Callable[[], TargetStream], reports: _Reports, intake: Intake
) -> None:
    secure = partial(secured, source.authority, source.certificate)
    opened = partial(_opened, source.at, intake, secure=secure, interface=source.interface)
    await _keep(source.at, "Cursor on Target", opened, begin, reports)


async def _keep_nothing(_: RestSource, __: Take, ___: Failed, ____: Intake) -> None:
    """The API receives it."""


RECEIVERS: Final[dict[str, Callable[[Any, Take, Failed, Intake], Awaitable[None]]]] = {
    "nmea": _keep_nmea,
    "gpsd": _keep_gpsd,
    "mavlink": mavlink.keep_receiving,
    "path": path.keep_receiving,
    "rest": _keep_nothing,
}
"""What receives a source, by its kind; Cursor on Target has two streams, see `keep_receiving`."""


async def keep_receiving_tracks(
    source: TrafficSource,
    own_systems: frozenset[int],
    own: OwnTracks,
    take: Take,
    failed: Failed,
    intake: Intake,
) -> None:
    """As `keep_receiving`, of all tracks that a source reports, without this show's own."""
    if isinstance(source, MavlinkTracks):
        begin = partial(TrafficReports, source.at, own_systems)
        await mavlink.keep_listening(source.at, begin, take, failed, intake)
    else:
        stream = partial(CotTraffic, source.geoid_m, own.uid)
        await _keep_cot(source, stream, _Reports(take, failed, TRACKS_MAX), intake)


async def _keep(
    name: str,
    speaks: str,
    opened: Callable[[], Chunks],
    begin: Callable[[], TargetStream],
    reports: _Reports,
) -> None:
    source = ByteSource(name, speaks, "target_interrupted", opened, lambda: reports.begin(begin()))
    await keep_reading(source, reports.failed)


def _opened(
    url: str,
    intake: Intake,
    *,
    ask: Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[Body]] = plainly,
    secure: Callable[[], ssl.SSLContext] | None = None,
    interface: str = "",
) -> Chunks:
    parts = urlsplit(url)
    if parts.scheme == "serial":
        return serial_chunks(serial_port(url), intake)
    host, port = parts.hostname or "", parts.port or 0
    if parts.scheme == "udp":
        return udp_chunks(host, port, intake, interface)
    return stream_chunks(host, port, intake, secure=secure if parts.scheme == "tls" else None, ask=ask)


async def _watch(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> Body:
    writer.write(WATCH)
    await writer.drain()
    return Plain()
