"""Bytes without end, of a UDP port, a connection over TCP or TLS, or a serial port that is opened again."""

import asyncio
import logging
import socket
import ssl
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import aclosing
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol, TypeAlias

import serial

from gcs.links.intake import TURN_S, Intake
from gcs.links.reading import BUFFER_BYTES, datagrams
from gcs.links.settings import SerialPort
from gcs.model.errors import LinkError, quoted

log = logging.getLogger(__name__)

CHUNK_BYTES: Final = 8192
"""Most that is read of a serial port in a turn."""

SILENT_S: Final = 15.0
"""A connection without a byte for so long is opened again; a UDP port is named."""

RETRY_S: Final = 2.0
GARBAGE_BYTES: Final = 4096
"""A source that sends so much without one correct message is named."""

_WAITING_BYTES: Final = 1 << 16
_SERIAL_WAIT_S: Final = 0.2
_SHOWN_BYTES: Final = 40
_SILENT: Final = f"nothing for {SILENT_S:g} s"

Chunks: TypeAlias = AsyncGenerator[bytes, None]
"""What arrives, as admitted; empty: nothing has arrived for a while."""

Feed: TypeAlias = Callable[[bytes], int]
"""Takes what arrives; how many correct messages it completes, 0 for what makes no sense."""


class Body(Protocol):
    """Takes the data out of what a connection brings."""

    @property
    def ended(self) -> bool:
        """Whether nothing can follow."""

    @property
    def turn_bytes(self) -> int:
        """Most to read in a turn; flow control holds back the sender of more."""

    def take(self, data: bytes) -> bytes:
        """The data in these bytes. Raises: LinkError."""


class Plain:
    """Bytes that are all data."""

    ended = False
    turn_bytes = 1 << 17

    def take(self, data: bytes) -> bytes:
        return data


Ask: TypeAlias = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[Body]]
"""Asks the other side of a connection for data."""


@dataclass(frozen=True, slots=True)
class ByteSource:
    """What bytes are read of, and what they should be.

    Attributes:
        name: for the log.
        speaks: the protocol, for texts.
        interrupted: the log's event when nothing can be read.
        open: opens it. The generator raises OSError, EOFError, UnicodeError (a host name) or LinkError.
        begin: what takes the bytes of one connection.
    """

    name: str
    speaks: str
    interrupted: str
    open: Callable[[], Chunks]
    begin: Callable[[], Feed]


async def keep_reading(source: ByteSource, failed: Callable[[str], None]) -> None:
    """Read without end, and open again what has ended; `failed` takes why no messages arrive."""
    logged = ""
    while True:
        connection = _ByteConnection(source, failed)
        try:
            async with aclosing(source.open()) as chunks:
                async for data in chunks:
                    logged = "" if connection.take(data) else logged
            why = connection.why_ended()
        except (OSError, EOFError, UnicodeError, LinkError) as error:
            why = in_words(error)
        if why != logged:
            log.warning(source.interrupted, extra={"source": source.name, "cause": why})
        logged = why
        failed(why)
        await asyncio.sleep(RETRY_S)


class _ByteConnection:
    """One connection, and whether it brings what it should."""

    def __init__(self, source: ByteSource, failed: Callable[[str], None]) -> None:
        self._source, self._failed = source, failed
        self._feed, self._clock = source.begin(), asyncio.get_running_loop().time
        self._first, self._messages, self._useless_bytes, self._arrived_s = b"", 0, 0, self._clock()

    def take(self, data: bytes) -> int:
        """How many messages these bytes complete."""
        if not data:
            if self._clock() - self._arrived_s >= SILENT_S:
                self._failed(_SILENT)
            return 0
        self._arrived_s = self._clock()
        self._first = self._first or data[:_SHOWN_BYTES]
        count = self._feed(data)
        self._messages += count
        self._useless_bytes = 0 if count else self._useless_bytes + len(data)
        if self._useless_bytes > GARBAGE_BYTES:
            self._failed(f"more than {GARBAGE_BYTES} bytes without a message of {self._source.speaks}")
        return count

    def why_ended(self) -> str:
        why = "the source has ended the connection"
        if not self._first:
            return f"{why}, and sent nothing"
        return why if self._messages else f"{why}, and sent no {self._source.speaks}: {quoted(self._first)}"


def in_words(error: Exception) -> str:
    """Why a connection failed."""
    match error:
        case ConnectionRefusedError():
            return "connection refused"
        case ssl.SSLCertVerificationError():
            return f"refused: certificate: {getattr(error, 'verify_message', '') or error}"
        case ssl.SSLError():
            return f"refused: {(getattr(error, 'reason', '') or str(error)).replace('_', ' ').lower()}"
        case TimeoutError():
            return f"no answer for {SILENT_S:g} s"
        case _:
            return str(error) or type(error).__name__


async def serial_chunks(place: SerialPort, intake: Intake) -> Chunks:
    """What a serial port receives."""
    clock = asyncio.get_running_loop().time
    with serial.Serial(place.device, place.baud, timeout=_SERIAL_WAIT_S) as port:
        silent_s = 0.0
        while silent_s < SILENT_S:
            data: bytes = await asyncio.to_thread(port.read, max(1, min(port.in_waiting, CHUNK_BYTES)))
            silent_s = 0.0 if data else silent_s + _SERIAL_WAIT_S
            yield intake.tail(data, place.device, clock())
            await asyncio.sleep(TURN_S if data else 0.0)
    raise LinkError(f"{place.device}: {_SILENT}")


async def udp_chunks(host: str, port: int, intake: Intake, interface: str = "") -> Chunks:
    """What a UDP port receives. A multicast group is joined at `interface`, an IP address; empty: any."""
    async with aclosing(datagrams(host, port, intake, interface)) as batches:
        async for batch in batches:
            yield b"".join(datagram.data for datagram in batch)


async def plainly(_: asyncio.StreamReader, __: asyncio.StreamWriter) -> Body:
    """The data come unasked."""
    return Plain()


def secured(authority: Path | None, certificate: Path | None) -> ssl.SSLContext:
    """Of a client; None: the computer's authorities, no certificate of its own. Raises: LinkError."""
    try:
        context = ssl.create_default_context(cafile=authority)
        if certificate is not None:
            context.load_cert_chain(certificate, password="")  # or a key with one asks the terminal
    except OSError as error:
        files = " and ".join(str(path) for path in (authority, certificate) if path)
        raise LinkError(f"certificates of {files} cannot be read: {error.strerror or error}") from None
    return context


async def stream_chunks(
    host: str,
    port: int,
    intake: Intake,
    *,
    secure: Callable[[], ssl.SSLContext] | None = None,
    ask: Ask = plainly,
) -> Chunks:
    """What a server sends over TCP; with `secure` over TLS."""
    async with asyncio.timeout(SILENT_S):
        reader, writer = await asyncio.open_connection(
            host, port, ssl=secure() if secure else None, limit=_WAITING_BYTES
        )
    # what waits in the kernel is never older than some turns
    writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
    clock, place = asyncio.get_running_loop().time, f"{host}:{port}"
    try:
        async with asyncio.timeout(SILENT_S):
            body = await ask(reader, writer)
        while not body.ended:
            try:
                async with asyncio.timeout(SILENT_S):
                    data = await reader.read(body.turn_bytes)
            except TimeoutError:
                raise LinkError(_SILENT) from None
            if not data:
                return
            yield intake.tail(body.take(data), place, clock())
            await asyncio.sleep(TURN_S)
    finally:
        writer.transport.abort()  # nothing is left to send, and a peer that is silent delays no close
