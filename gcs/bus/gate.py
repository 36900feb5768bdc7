"""Stands before Zenoh where stations connect with TLS: what hosts without a key can cost there is bounded.

Zenoh accepts connections without a bound, and after each handshake that fails it waits for 100 ms with all
that came later (its issue 2685): 8 s of bad handshakes kept a station out for ten minutes. The gate listens
in its place, and passes bytes on to Zenoh on loopback, which still decides which station to believe:

- A connection is passed on once it has sent a whole ClientHello. Without one within `HELD_S` it is closed.
- Few handshakes of each station's host at a time are with Zenoh, and of all other hosts together two, by
  turns. A handshake counts until Zenoh has closed it, or for `SETTLED_S`: then it has succeeded.
- Few connections of a host wait. A further one takes the place of the oldest.

It is a thread of the station, and not a process: the other stations would take the connections that its end
closes for the end of the station, which flies on.
"""

import logging
import random
import select
import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from typing import Final, TypeAlias

from gcs.bus.settings import Endpoint
from gcs.links.intake import TURN_S, Arrived, Bound, Intake

log = logging.getLogger(__name__)

HELD_S: Final = 2.0
"""As long as a station tries to open a connection."""

SETTLED_S: Final = 3.0
"""Zenoh ends a handshake after `HANDSHAKE_MS` of `gcs.bus.zenoh_config`."""

CLOSING_S: Final = 2.0
"""Of a connection of which one end is closed."""

AT_ONCE: Final = 2
"""Handshakes of a station, or of all hosts without one, that are with Zenoh."""

WAITING: Final = 8
"""Connections of a station, or of another host, that wait."""

STRANGERS_WAITING: Final = 64
"""Connections of all hosts without a station that wait."""

ACCEPTED: Final = 64
"""Connections in a turn; further ones wait in the kernel."""

PIECE: Final = 1 << 16
"""Bytes of a read, and how many may wait for one side."""

PASSED: Final = 4 * PIECE
"""Bytes from a connection in a turn: four times what the largest station sends."""

HELLO_MAX: Final = 4096

FAILED: Final = Bound(float("inf"), 10.0)
"""Connections of which no handshake succeeds: hosts with more are named."""

_RECORD: Final = struct.Struct(">BBBHBBH")  # of TLS: type, version, length; then the message: type, length
_ABORT: Final = struct.pack("ii", 1, 0)

Host: TypeAlias = str | bytes
"""An address; of IPv6 its network of 64 bits."""


def host_of(address: str) -> Host:
    """What counts as one host with this address."""
    if ":" in address:
        return socket.inet_pton(socket.AF_INET6, address.partition("%")[0])[:8]
    return address


def is_hello(data: bytes | bytearray) -> bool | None:
    """Whether these bytes are a ClientHello in one record; None: more of them are needed."""
    if len(data) < _RECORD.size:
        return None if b"\x16\x03".startswith(data[:2]) else False
    kind, major, _, length, message, high, low = _RECORD.unpack_from(data)
    if (kind, major, message) != (22, 3, 1) or (high << 16 | low) + 4 != length or length > HELLO_MAX:
        return False
    return True if len(data) >= length + 5 else None


class Failures(Intake):
    """Names the host of too many connections that come to nothing."""

    def why_over(self, now_s: float) -> str:
        over = Intake.why_over(self, now_s)
        limit = f"{FAILED.messages_per_s:g} failed handshakes a second"
        return f"more than {limit} from {self._sender[0]}" if over else ""


class _Side:
    """One of the two sockets of a connection."""

    def __init__(self, sock: socket.socket) -> None:
        self.socket = sock
        self.waiting = bytearray()  # for it
        self.ended = False  # it sends nothing more
        self.is_shut = False  # nothing more is sent to it
        self.mask = -1  # of epoll; -1: it is not registered


class _Connection:
    """Of another station, or of a stranger."""

    def __init__(self, outer: socket.socket, address: str, now_s: float) -> None:
        self.outer = _Side(outer)
        self.inner: _Side | None = None  # to Zenoh, once it is passed on
        self.address, self.host = address, host_of(address)
        self.since_s = now_s  # it waits, or is passed on
        self.closing_s: float | None = None  # since then one side has ended
        self.hello = bytearray()
        self.is_whole = False  # that hello
        self.passed = 0  # bytes from outside in this turn


class Gate:
    """The listening socket at a station's endpoint, and the thread behind it."""

    def __init__(self, here: Endpoint, others: Mapping[str, Endpoint]) -> None:
        """Listens from now on. Resolves names: not for the event loop.

        Args:
            here: the station's own endpoint.
            others: endpoints of the other stations, by name.

        Raises: OSError when it cannot listen.
        """
        self.failures = Failures("bus", FAILED)
        self._stations = Counter(host for endpoint in others.values() for host in _hosts(endpoint))
        family, _, _, _, address = socket.getaddrinfo(here.host, here.port, type=socket.SOCK_STREAM)[0]
        self._listener = socket.create_server(address, family=family, backlog=128)
        self._listener.setblocking(False)
        self._wake, self._woken = socket.socketpair()
        self._epoll = select.epoll()
        for readable in (self._listener, self._woken):
            self._epoll.register(readable, select.EPOLLIN)
        self._sides: dict[int, tuple[_Connection, _Side]] = {}  # by file descriptor, of those registered
        self._waiting: dict[_Connection, None] = {}  # oldest first
        self._passed_on: dict[_Connection, None] = {}
        self._accepted, self._turn_s = 0, 0.0
        self._inner = ("", 0)
        self._thread = threading.Thread(target=self._run, name="bus-gate", daemon=True)

    def start(self, inner: tuple[str, int]) -> None:
        """Pass connections on to Zenoh, which listens there by now."""
        self._inner = inner
        self._thread.start()

    def close(self) -> None:
        """Close all connections. Waits for the thread."""
        self._wake.send(b"x")
        if self._thread.ident is not None:
            self._thread.join()
        for connection in (*self._waiting, *self._passed_on):
            self._drop(connection)
        self._epoll.close()
        for opened in (self._listener, self._wake, self._woken):
            opened.close()

    def _run(self) -> None:
        while True:
            events = self._epoll.poll(TURN_S if self._is_timed else None)
            now_s = time.monotonic()
            for handle, mask in events:
                if handle == self._woken.fileno():
                    return
                if handle == self._listener.fileno():
                    self._accept(now_s)
                elif (side := self._sides.get(handle)) is not None:
                    self._serve(*side, mask, now_s)
            if now_s - self._turn_s >= TURN_S:
                self._begin_turn(now_s)
            if any(connection.is_whole for connection in self._waiting):
                self._pass_on_what_waits(now_s)

    @property
    def _is_timed(self) -> bool:
        """Whether something is to be done when nothing arrives."""
        late_s = self._turn_s - SETTLED_S
        timed = (
            connection.since_s > late_s or connection.closing_s or connection.passed
            for connection in self._passed_on
        )
        return bool(self._waiting or self._accepted or any(timed))

    def _begin_turn(self, now_s: float) -> None:
        self._turn_s = now_s
        if self._accepted >= ACCEPTED:
            self._epoll.modify(self._listener, select.EPOLLIN)
        self._accepted = 0
        for connection in [waiting for waiting in self._waiting if now_s - waiting.since_s > HELD_S]:
            self._fail(connection, now_s)
        for connection in list(self._passed_on):
            connection.passed = 0
            if connection.closing_s is not None and now_s - connection.closing_s > CLOSING_S:
                self._drop(connection)
            else:
                self._watch(connection)

    # connections that wait

    def _accept(self, now_s: float) -> None:
        while self._accepted < ACCEPTED:
            try:
                outer, address = self._listener.accept()
            except BlockingIOError:
                return
            except OSError as error:  # too many files, or it was reset meanwhile
                log.warning("bus_accepts_none", extra={"cause": str(error)})
                break
            self._accepted += 1
            outer.setblocking(False)
            connection = _Connection(outer, address[0], now_s)
            self._waiting[connection] = None
            self._register(connection, connection.outer, select.EPOLLIN)
            self._make_room(connection.host, now_s)
        self._accepted = ACCEPTED
        self._epoll.modify(self._listener, 0)

    def _make_room(self, host: Host, now_s: float) -> None:
        """Close the oldest connection that waits, of this host or of all strangers, if there are too many."""
        stations = self._stations[host]
        of_host = [connection for connection in self._waiting if connection.host == host]
        if len(of_host) > WAITING * max(1, stations):
            self._fail(of_host[0], now_s)
        elif not stations:
            strangers = [connection for connection in self._waiting if connection.host not in self._stations]
            if len(strangers) > STRANGERS_WAITING:
                self._fail(strangers[0], now_s)

    def _read_hello(self, connection: _Connection, now_s: float) -> None:
        try:
            data = connection.outer.socket.recv(HELLO_MAX + 5)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        connection.hello += data
        is_valid = is_hello(connection.hello) if data else False
        if is_valid is False:
            self._fail(connection, now_s)
        elif is_valid:
            connection.is_whole = True
            self._register(connection, connection.outer, 0)  # what follows waits in the kernel

    def _pass_on_what_waits(self, now_s: float) -> None:
        """Pass on as many as Zenoh may have to decide about, those of all hosts in turn."""
        first: dict[Host, _Connection] = {}
        for connection in self._waiting:
            if connection.is_whole:
                first.setdefault(connection.host, connection)
        busy = Counter(
            connection.host for connection in self._passed_on if now_s - connection.since_s < SETTLED_S
        )
        room = AT_ONCE - sum(count for host, count in busy.items() if host not in self._stations)
        for host in random.sample(list(first), len(first)):
            if host in self._stations:
                passes = busy[host] < AT_ONCE * self._stations[host]
            else:
                passes, room = room > 0, room - 1
            if passes:
                self._pass_on(first[host], now_s)

    def _pass_on(self, connection: _Connection, now_s: float) -> None:
        del self._waiting[connection]
        self._passed_on[connection] = None
        inner = socket.socket()
        for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):  # what waits here is old when it arrives
            inner.setsockopt(socket.SOL_SOCKET, option, 2 * PIECE)
        for side in (inner, connection.outer.socket):
            side.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        inner.setblocking(False)
        inner.connect_ex(self._inner)
        connection.inner, connection.since_s = _Side(inner), now_s
        connection.inner.waiting = connection.hello
        self._watch(connection)

    def _fail(self, connection: _Connection, now_s: float) -> None:
        self.failures.admit([Arrived(b"", (connection.address, 0))], now_s)
        self._drop(connection)

    # connections that are passed on

    def _serve(self, connection: _Connection, side: _Side, mask: int, now_s: float) -> None:
        inner, outer = connection.inner, connection.outer
        if inner is None:
            self._read_hello(connection, now_s)
            return
        if mask & select.EPOLLOUT:
            _send(side)
        if mask & ~select.EPOLLOUT:
            other = inner if side is outer else outer
            size = _read(side, other)
            connection.passed += size if side is outer else 0
        for one, other in ((outer, inner), (inner, outer)):
            if one.ended and not other.waiting and not other.is_shut:
                other.is_shut = True
                with suppress(OSError):
                    other.socket.shutdown(socket.SHUT_WR)
        if inner.ended and not outer.waiting:
            if now_s - connection.since_s < SETTLED_S:
                self._fail(connection, now_s)
            else:
                self._drop(connection)
            return
        if (inner.ended or outer.ended) and connection.closing_s is None:
            connection.closing_s = now_s
        self._watch(connection)

    def _watch(self, connection: _Connection) -> None:
        """Register for what can be read and sent now."""
        inner, outer = connection.inner, connection.outer
        if inner is None:
            return
        for side, other in ((outer, inner), (inner, outer)):
            may_read = not side.ended and len(other.waiting) < PIECE
            if side is outer:
                may_read = may_read and connection.passed < PASSED
            mask = select.EPOLLIN * may_read | select.EPOLLOUT * bool(side.waiting)
            self._register(connection, side, -1 if side.ended and not mask else mask)

    def _register(self, connection: _Connection, side: _Side, mask: int) -> None:
        """Wait for these events of a socket; -1: for none."""
        before, side.mask, handle = side.mask, mask, side.socket.fileno()
        if mask == before:
            return
        if mask < 0:
            self._epoll.unregister(handle)
            del self._sides[handle]
        elif before < 0:
            self._epoll.register(handle, mask)
            self._sides[handle] = connection, side
        else:
            self._epoll.modify(handle, mask)

    def _drop(self, connection: _Connection) -> None:
        for side in (connection.outer, connection.inner):
            if side is not None:
                self._register(connection, side, -1)
                if connection.inner is None:
                    side.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _ABORT)
                side.socket.close()
        self._waiting.pop(connection, None)
        self._passed_on.pop(connection, None)


def _hosts(endpoint: Endpoint) -> set[Host]:
    """All that an endpoint's name stands for now; a name that is not known stands for none."""
    with suppress(OSError):
        resolved = socket.getaddrinfo(endpoint.host, endpoint.port, type=socket.SOCK_STREAM)
        return {host_of(str(address[0])) for *_, address in resolved}
    return set()


def _read(side: _Side, other: _Side) -> int:
    """Pass on what has arrived at one side. Returns: its bytes."""
    try:
        data = side.socket.recv(PIECE)
    except BlockingIOError:
        return 0
    except OSError:
        data = b""
    side.ended = not data
    if not other.is_shut:
        other.waiting += data
        _send(other)
    return len(data)


def _send(side: _Side) -> None:
    try:
        del side.waiting[: side.socket.send(side.waiting)]
    except BlockingIOError:
        pass
    except OSError:  # reset: a read says so as well
        side.waiting.clear()
        side.ended = side.is_shut = True
