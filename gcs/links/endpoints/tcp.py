"""TCP: a server to which vehicles or routers connect, and a client that reconnects.

A broken connection may show only when the kernel gives up: after `_GIVE_UP_S`. Data that it had accepted by
then is lost with it; data delivered late within that time cannot be called back.
"""

import errno
import logging
import os
import selectors
import socket
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from fcntl import ioctl
from struct import Struct
from typing import Final

from gcs.links.address_book import Address
from gcs.links.endpoints.endpoint import Arrival
from gcs.links.endpoints.stream import Stream
from gcs.model.errors import LinkError

log = logging.getLogger(__name__)

_CONNECT_S: Final = 5.0
_GIVE_UP_S: Final = 1.0
_CONNECTIONS_MAX: Final = 256
_SEND_BUFFER_BYTES: Final = 1 << 16
_SIOCOUTQNSD: Final = 0x894B  # Linux: bytes that have not left yet
_INT: Final = Struct("@i")
_ASSUMED_BYTES_PER_S: Final = 100_000


class SocketChannel:
    """A connected socket. A `Channel`."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected
        connected.setblocking(False)
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in (
            ("TCP_KEEPIDLE", 2),
            ("TCP_KEEPINTVL", 1),
            ("TCP_KEEPCNT", 3),
            ("TCP_USER_TIMEOUT", round(_GIVE_UP_S * 1000)),
        ):
            if hasattr(socket, option):
                connected.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)

    def fileno(self) -> int:
        """For the selector."""
        return self._socket.fileno()

    def read(self, size: int) -> bytes:
        """Read what has arrived. Raises: OSError."""
        return self._socket.recv(size)

    def write(self, data: bytes) -> int:
        """Number of bytes accepted. Raises: OSError."""
        return self._socket.send(data)

    def delay_s(self) -> float:
        """Delay of the bytes that have not left yet; 0 where the platform does not report them."""
        try:
            (waiting_bytes,) = _INT.unpack(ioctl(self._socket.fileno(), _SIOCOUTQNSD, bytes(_INT.size)))
        except OSError:  # not Linux
            return 0.0
        delay_s: float = waiting_bytes / _ASSUMED_BYTES_PER_S
        return delay_s

    def close(self) -> None:
        """Reset instead of finishing: data still waiting is too old for the next connection."""
        with suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, Struct("@ii").pack(1, 0))
        self._socket.close()


class TcpDial:
    """Connects without waiting. A `Dial`."""

    def __init__(self, host: str, port: int) -> None:
        """Nothing is opened yet."""
        self._at = (host, port)
        self._pending: socket.socket | None = None
        self._began_s = 0.0

    def __call__(self, now_s: float) -> SocketChannel | None:
        """Begin, or check whether it is connected by now. Raises: OSError when that failed."""
        if self._pending is None:
            self._pending = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
            self._pending.setblocking(False)
            self._began_s = now_s
            cause = self._pending.connect_ex(self._at)
        else:
            cause = self._pending.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if cause not in (0, errno.EINPROGRESS):
            self.cancel()
            raise OSError(cause, os.strerror(cause))
        try:
            self._pending.getpeername()
        except OSError:
            if now_s - self._began_s > _CONNECT_S:
                self.cancel()
                raise TimeoutError(f"no answer within {_CONNECT_S:g} s") from None
            return None
        if self._pending.getpeername() == self._pending.getsockname():  # TCP connected to itself
            self.cancel()
            raise ConnectionRefusedError("nothing listens")
        connected, self._pending = self._pending, None
        return SocketChannel(connected)

    def cancel(self) -> None:
        """Abandon the attempt."""
        if self._pending is not None:
            self._pending.close()
            self._pending = None


class TcpServer:
    """A listening port and all connections to it."""

    def __init__(self, name: str, index: int, host: str, port: int) -> None:
        """`name` is the link's, for errors and logs."""
        self._name = name
        self._index = index
        self._at = (host, port)
        self._listening: socket.socket | None = None
        self._selector: selectors.BaseSelector | None = None
        self._streams: dict[Address, Stream] = {}
        self._gone: list[Address] = []

    @property
    def standing(self) -> tuple[Address, ...]:
        """All connections: a vehicle may wait for the first frame."""
        return tuple(self._streams.copy())

    def open(self, selector: selectors.BaseSelector, now_s: float) -> None:  # noqa: ARG002
        """Listen. Raises: LinkError naming the port."""
        listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            listening.setblocking(False)
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.bind(self._at)
            listening.listen()
        except (OSError, OverflowError) as error:
            listening.close()
            raise LinkError(f"{self._name}: TCP port {self._at[1]} on {self._at[0]}: {error}") from error
        self._listening, self._selector = listening, selector
        selector.register(listening, selectors.EVENT_READ, self._accept)

    def close(self) -> None:
        """Release the port and end every connection."""
        for stream in tuple(self._streams.values()):
            self._end(stream, "closed", level=logging.INFO)
        listening, self._listening = self._listening, None
        if listening is not None:
            if self._selector is not None:
                self._selector.unregister(listening)
            listening.close()

    def tend(self, now_s: float) -> None:
        """Continue frames sent in part."""
        for stream in tuple(self._streams.values()):
            stream.looked(now_s)
            try:
                stream.flush()
            except OSError as error:
                self._end(stream, str(error))

    def gone(self) -> tuple[Address, ...]:
        """Connections that have ended."""
        gone, self._gone = tuple(self._gone), []
        return gone

    def send(self, data: bytes, address: Address, *, perishable: bool) -> None:
        """Send one frame. Raises: OSError."""
        stream = self._streams.get(address)
        if stream is None:
            raise ConnectionError("not connected")
        stream.send(data, perishable=perishable)

    def _accept(self, now_s: float) -> Iterable[Arrival]:
        if self._listening is None or self._selector is None:
            return ()
        with suppress(OSError):  # ended again, or no file descriptor is left: the client tries again
            connected, (host, port) = self._listening.accept()
            if len(self._streams) >= _CONNECTIONS_MAX:
                connected.close()
                return ()
            address = Address(host, port, self._index)
            stream = Stream(SocketChannel(connected), address, now_s)
            self._selector.register(stream, selectors.EVENT_READ, self._reader(stream))
            self._streams[address] = stream
            log.info("connected", extra={"link": self._name, "address": str(address)})
        return ()

    def _reader(self, stream: Stream) -> Callable[[float], Iterator[Arrival]]:
        def read(now_s: float) -> Iterator[Arrival]:
            try:
                yield from stream.read(now_s)
            except OSError as error:
                self._end(stream, str(error))

        return read

    def _end(self, stream: Stream, cause: str, level: int = logging.WARNING) -> None:
        if self._streams.pop(stream.address, None) is None:
            return  # ended already
        if self._selector is not None:
            self._selector.unregister(stream)
        stream.close()
        self._gone.append(stream.address)
        about = {"link": self._name, "address": str(stream.address), "cause": cause}
        log.log(level, "connection_lost", extra=about)
