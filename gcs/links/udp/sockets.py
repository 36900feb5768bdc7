"""UDP sockets for a whole fleet: datagrams in batches, with the kernel's times of arrival.

Where the platform has no calls for that (see `mmsg`), one datagram at a time, with the same interface.
"""

import logging
import selectors
import socket
import sys
from collections.abc import Callable, Sequence
from math import inf
from struct import Struct
from time import time as wall_time_s
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gcs.links import mmsg
from gcs.links.endpoints import Listen
from gcs.mavlink.kernels import Bytes, Whole
from gcs.model.errors import LinkError
from gcs.model.state import Array

log = logging.getLogger(__name__)

_ROOM: Final = 512
"""Datagrams that are read before they are processed."""

_LONGEST: Final = 2048
"""Bytes of a datagram that are read; an Ethernet frame carries 1500."""

_BATCH: Final = 256
_ROUNDS: Final = 16
"""Batches that a socket may fill in one turn, so that a flood cannot block the loop."""

_ERRORS: Final = 16
"""Errors of earlier sends that a socket may report in one turn."""

_BUFFER_BYTES: Final = 4 << 20
_TIMESPEC: Final = Struct("@ll")
_SO_RCVBUFFORCE: Final = 33  # Linux; beyond the system's limit, where permitted


class Datagrams(NamedTuple):
    """What arrived, in order of its arrival at each socket. Valid until the next read."""

    data: Bytes  # flat
    start: Whole  # (m,) of each in `data`
    length: Whole  # (m,)
    source: Whole  # (m,) source, see `source_of`
    time_s: Array  # (m,) of arrival, on our clock


def source_of(host: int, port: int, socket_index: int) -> int:
    """An address, and the socket of ours that it sends to, as one number."""
    return socket_index << 48 | host << 16 | port


def host_of(source: int) -> str:
    return socket.inet_ntoa((source >> 16 & 0xFFFFFFFF).to_bytes(4, "big"))


def port_of(source: int) -> int:
    return source & 0xFFFF


def socket_of(source: int) -> int:
    return source >> 48


class Ports(Protocol):
    """Where the datagrams of a link arrive and leave, in batches.

    Attributes:
        send_errors: datagrams that could not leave.
    """

    send_errors: int

    def open(self) -> None:
        """Open every port. Raises: LinkError naming the port."""

    def close(self) -> None:
        """Release the ports; what is sent afterwards is lost."""

    def receive(self, take: Callable[[Datagrams], None]) -> None:
        """Give everything that has arrived to `take`, in batches. Never blocks."""

    def send(
        self, data: Bytes, length: Whole, destination: Whole, *, until_s: float = inf
    ) -> NDArray[np.bool_]:
        """Send n datagrams. Never blocks, never raises.

        Args:
            data: (n, longest).
            length: (n,) bytes of each.
            destination: (n,) sources as received; negative: no address.
            until_s: on our clock; no datagram leaves later.

        Returns: (n,) whether each left.
        """


class Packets:
    """UDP sockets on consecutive ports. See `Ports`."""

    def __init__(
        self,
        name: str,
        listen: Listen | Sequence[Listen],
        clock: Callable[[], float],
        *,
        batched: bool = mmsg.available(),
    ) -> None:
        """Nothing is opened yet. `batched` False: as on a platform without batches."""
        self.send_errors = 0
        self._name = name
        self._places = tuple(
            (each.host, port)
            for each in ((listen,) if isinstance(listen, Listen) else listen)
            for port in range(each.first_port, each.first_port + each.port_count)
        )
        self._clock = clock
        self._batched = batched
        self._sockets: tuple[socket.socket, ...] = ()
        self._selector: selectors.BaseSelector | None = None
        self._drained_s = np.zeros(0)
        self._room = mmsg.Batch(_ROOM, _LONGEST)
        self._start = np.arange(_ROOM, dtype=np.int64) * _LONGEST
        self._index = np.zeros(_ROOM, np.int64)
        self._outbox = mmsg.Batch(1, 1)
        self._send_failed = False
        self._in_runs = False

    def open(self) -> None:
        """Bind every port. Raises: LinkError naming the port."""
        opened: list[socket.socket] = []
        for host, port in self._places:
            try:
                opened.append(_bound(host, port))
            except (OSError, OverflowError) as error:
                for other in opened:
                    other.close()
                raise LinkError(f"{self._name}: UDP port {port} on {host}: {error}") from error
        self._sockets = tuple(opened)
        self._in_runs = self._batched and all(map(mmsg.sends_runs, opened))
        self._drained_s = np.full(len(opened), self._clock())
        self._selector = selectors.DefaultSelector()
        for index, opened_socket in enumerate(opened):
            self._selector.register(opened_socket, selectors.EVENT_READ, index)

    def close(self) -> None:
        """See `Ports.close`."""
        sockets, self._sockets = self._sockets, ()
        if self._selector is not None:
            self._selector.close()
            self._selector = None
        for open_socket in sockets:
            open_socket.close()

    def receive(self, take: Callable[[Datagrams], None]) -> None:
        """See `Ports.receive`."""
        if self._selector is None:
            return
        filled = 0
        now_s, wall_s = self._clock(), wall_time_s()
        empty = np.ones(len(self._sockets), np.bool_)
        for key, _ in self._selector.select(0):
            index: int = key.data
            empty[index] = False
            for _ in range(_ROUNDS):
                if _ROOM - filled < _BATCH:
                    take(self._datagrams(filled, now_s, wall_s))
                    filled = 0
                count = self._read(index, filled, _BATCH)
                self._index[filled : filled + count] = index
                filled += count
                if count < _BATCH:
                    empty[index] = True
                    break
        if filled:
            take(self._datagrams(filled, now_s, wall_s))
        self._drained_s[empty] = now_s

    def send(
        self, data: Bytes, length: Whole, destination: Whole, *, until_s: float = inf
    ) -> NDArray[np.bool_]:
        """See `Ports.send`."""
        left = np.zeros(len(destination), np.bool_)
        if not self._sockets or not len(destination):
            return left
        index = np.where(destination < 0, -1, destination >> 48)
        changes = np.flatnonzero(np.diff(index)) + 1
        if len(changes) >= len(np.unique(index)):  # one call for each socket, not for each change of socket
            order = np.argsort(index, kind="stable")
            left[order] = self.send(data[order], length[order], destination[order], until_s=until_s)
            return left
        outbox = self._filled(data, length, destination)
        for first, end in zip([0, *changes.tolist()], [*changes.tolist(), len(index)], strict=True):
            if 0 <= index[first] < len(self._sockets):
                self._send_all(outbox, self._sockets[int(index[first])], first, end, left, until_s)
        return left

    def _filled(self, data: Bytes, length: Whole, destination: Whole) -> mmsg.Batch:
        """The outbox filled with these datagrams, enlarged if necessary."""
        n, longest = data.shape
        if self._outbox.data.shape[0] < n or self._outbox.data.shape[1] < longest:
            rows, columns = self._outbox.data.shape
            self._outbox = mmsg.Batch(max(n, rows), max(longest, columns))
        outbox = self._outbox
        outbox.data[:n, :longest] = data
        outbox.length[:n] = length
        outbox.host[:n] = destination >> 16 & 0xFFFFFFFF
        outbox.port[:n] = destination & 0xFFFF
        return outbox

    def _send_all(
        self,
        outbox: mmsg.Batch,
        through: socket.socket,
        first: int,
        end: int,
        left: NDArray[np.bool_],
        until_s: float,
    ) -> None:
        # Check again right before every call: the process may have been suspended since the last check.
        while first < end and self._clock() <= until_s:
            try:
                count = self._send_some(outbox, through, first, end)
            except OSError as error:  # a full buffer, no route: it may come back
                if self._in_runs and error.errno in mmsg.REFUSALS:
                    self._in_runs = False  # not possible on this route: one by one from now on
                    continue
                self.send_errors += 1
                if not self._send_failed:
                    self._send_failed = True
                    log.warning("send_failed", extra={"link": self._name, "cause": str(error)})
                first += 1
                continue
            left[first : first + count] = True
            first += count

    def _send_some(self, outbox: mmsg.Batch, through: socket.socket, first: int, end: int) -> int:
        """Number of these rows that were sent. Raises: OSError when the first could not be."""
        if not self._batched:
            return _send_one(through, outbox, first)
        send = outbox.send_runs if self._in_runs else outbox.send
        return send(through.fileno(), first, end)

    def _read(self, index: int, first: int, most: int) -> int:
        """Read up to `most` datagrams of a socket. Returns: number."""
        source = self._sockets[index]
        for _ in range(_ERRORS):
            try:
                if self._batched:
                    return self._room.receive(source.fileno(), first, most)
                return _receive_some(source, self._room, first, most)
            except BlockingIOError:
                return 0
            except OSError:  # an error of an earlier send, reported here; the socket still works
                continue
        return 0

    def _datagrams(self, count: int, now_s: float, wall_s: float) -> Datagrams:
        """Rows up to `count`, with times on our clock.

        The kernel stamps with the wall clock, which may be set meanwhile; but nothing read now can have
        arrived before the socket was last empty, which bounds the error.
        """
        room, index = self._room, self._index[:count]
        source = index << 48 | room.host[:count].astype(np.int64) << 16 | room.port[:count]
        stamped_s = now_s - (wall_s - room.time_s[:count])
        bounded_s = np.minimum(np.maximum(stamped_s, self._drained_s[index]), now_s)
        time_s = np.where(np.isnan(stamped_s), now_s, bounded_s)
        length = np.minimum(room.length[:count], _LONGEST)
        return Datagrams(room.data.reshape(-1), self._start[:count], length, source, time_s)


def _receive_some(source: socket.socket, room: mmsg.Batch, first: int, most: int) -> int:
    """One by one, as long as there are any."""
    for row in range(first, first + most):
        try:
            count, ancillary, _, sender = source.recvmsg_into([room.data[row]], 64)
        except BlockingIOError:
            return row - first
        room.length[row] = count
        room.host[row] = int.from_bytes(socket.inet_aton(sender[0]), "big")
        room.port[row] = sender[1]
        room.time_s[row] = np.nan
        for level, kind, value in ancillary:
            if (level, kind) == (socket.SOL_SOCKET, mmsg.SO_TIMESTAMPNS) and len(value) == _TIMESPEC.size:
                seconds, nanoseconds = _TIMESPEC.unpack(value)
                room.time_s[row] = seconds + nanoseconds * 1e-9
    return most


def _send_one(through: socket.socket, outbox: mmsg.Batch, row: int) -> int:
    host = socket.inet_ntoa(int(outbox.host[row]).to_bytes(4, "big"))
    through.sendto(outbox.data[row, : outbox.length[row]].tobytes(), (host, int(outbox.port[row])))
    return 1


def _bound(host: str, port: int) -> socket.socket:
    """A UDP socket that never blocks and, on Linux, reports when the kernel received each datagram."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        bound.setblocking(False)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
        if sys.platform == "linux":
            bound.setsockopt(socket.SOL_SOCKET, mmsg.SO_TIMESTAMPNS, 1)
            try:
                bound.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _BUFFER_BYTES)
            except PermissionError:
                log.debug("receive_buffer_limited", extra={"port": port})
        bound.bind((host, port))
    except (OSError, OverflowError):
        bound.close()
        raise
    return bound
