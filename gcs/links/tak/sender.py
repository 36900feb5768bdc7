"""Sends events to one group or server of TAK. Never waits: what cannot leave is dropped, and named."""

import asyncio
import logging
import socket
from collections.abc import Callable, Sequence
from functools import partial
from ipaddress import ip_address
from math import inf
from typing import Final
from urllib.parse import urlsplit

from gcs.links.byte_sources import RETRY_S, SILENT_S, in_words, secured
from gcs.links.intake import TURN_S
from gcs.links.reading import BUFFER_BYTES
from gcs.links.tak.settings import TakReceiver
from gcs.model.errors import LinkError

log = logging.getLogger(__name__)

NAMED_S: Final = 3.0
"""What went wrong over an open connection is named for so long."""

READ_BYTES: Final = 1 << 17
"""A server also sends what others report: so much in a turn is read, and dropped unread."""


class CotSender:
    """One receiver, whatever it does. Used on the event loop only.

    Attributes:
        sent: events that left.
        dropped: events that did not.
    """

    def __init__(self, settings: TakReceiver) -> None:
        parts = urlsplit(settings.at)
        self.at = settings.at
        self.sent = self.dropped = 0
        self._settings, self._scheme = settings, parts.scheme
        self._host, self._port = parts.hostname or "", parts.port or 0
        self._pass: Callable[[Sequence[bytes]], int] | None = None  # how many of these leave
        self._why, self._failed_s = "not connected yet", -inf

    def problem(self, now_s: float) -> str:
        """Why events do not leave, in words; empty: they do."""
        return self._why if self._pass is None or now_s - self._failed_s <= NAMED_S else ""

    def offer(self, events: Sequence[bytes], now_s: float) -> None:
        """Send what can leave without waiting, and drop the rest."""
        leave = 0 if self._pass is None else self._pass(events)
        self.sent += leave
        self.dropped += len(events) - leave
        if leave < len(events):
            self._failed_s = now_s

    async def keep_open(self) -> None:
        """Connect, and again whatever happens, without end."""
        logged = ""
        while True:
            try:
                await (self._open_udp() if self._scheme == "udp" else self._open_stream())
            except (OSError, UnicodeError, LinkError) as error:
                self._why = in_words(error)
            finally:
                self._pass = None
            if self._why != logged:
                log.warning("tak_interrupted", extra={"source": self.at, "cause": self._why})
            logged = self._why
            await asyncio.sleep(RETRY_S)

    async def _open_udp(self) -> None:
        """Raises: why nothing more can be sent."""
        loop = asyncio.get_running_loop()
        places = await loop.getaddrinfo(self._host, self._port, type=socket.SOCK_DGRAM)
        family, kind, _, _, place = places[0]
        with socket.socket(family, kind) as opened:
            opened.setblocking(False)
            if self._settings.interface and ip_address(place[0]).is_multicast:
                at = socket.inet_aton(self._settings.interface)
                opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, at)
            opened.connect(place)
            ended: asyncio.Future[None] = loop.create_future()
            self._pass = partial(self._send_datagrams, opened, ended)
            await ended

    def _send_datagrams(
        self, opened: socket.socket, ended: "asyncio.Future[None]", events: Sequence[bytes]
    ) -> int:
        leave = 0
        for event in events:
            try:
                opened.send(event)
            except (BlockingIOError, ConnectionRefusedError) as error:  # the next may leave
                full = isinstance(error, BlockingIOError)
                self._why = "this computer's network takes no more" if full else in_words(error)
            except OSError as error:
                if not ended.done():
                    ended.set_exception(error)
                return leave
            else:
                leave += 1
        return leave

    async def _open_stream(self) -> None:
        """Raises: why nothing more can be sent."""
        settings, tls = self._settings, self._scheme == "tls"
        async with asyncio.timeout(SILENT_S):
            reader, writer = await asyncio.open_connection(
                self._host,
                self._port,
                ssl=secured(settings.authority, settings.certificate) if tls else None,
                limit=READ_BYTES,
            )
        connected = writer.get_extra_info("socket")  # little waits in the kernel, and not for long
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(1000 * SILENT_S))
        self._pass = partial(self._write, writer.transport)
        try:
            while True:
                if not await reader.read(READ_BYTES):
                    raise LinkError("the server has ended the connection")
                await asyncio.sleep(TURN_S)
        finally:
            writer.transport.abort()

    def _write(self, transport: asyncio.WriteTransport, events: Sequence[bytes]) -> int:
        """All of them, or none while the last ones have not left: no event waits here."""
        if transport.is_closing():
            return 0
        if transport.get_write_buffer_size():
            self._why = "the server does not read what is sent"
            return 0
        transport.write(b"".join(events))
        return len(events)
