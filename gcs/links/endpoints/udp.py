"""UDP ports of a link: datagrams in batches, with the kernel's times of arrival."""

import logging
import selectors
import socket
from collections.abc import Callable, Iterable, Sequence
from math import inf
from time import time as wall_time_s
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.links.endpoints import mmsg
from gcs.links.endpoints.ports import Datagrams, Ports, host_number, source_of, why_closed
from gcs.links.settings import Listen, Place, UdpOut
from gcs.mavlink.kernels import LONGEST_FRAME, Bytes, Whole
from gcs.model.errors import LinkError

log = logging.getLogger(__name__)

_ROOM: Final = 2048
"""Most datagrams of one `receive`: as many as wait in the sockets, also in a flood, so that none gets old."""

_LONGEST: Final = 2048
"""Bytes of a datagram that are read; an Ethernet frame carries 1500."""

_BATCH: Final = 256
TURN_S: Final = 0.02
"""Time of one `receive`: a flood delays neither the loop nor other ports, and the rest waits for the next."""

_ANY: Final = -1
_BUFFER_BYTES: Final = 4 << 20
_SO_RCVBUFFORCE: Final = 33  # beyond the system's limit, where permitted


class UdpPorts(Ports):
    """UDP sockets, bound for any sender or with exactly one far end.

    Attributes:
        udp_count: number of UDP ports.
        problems: ports that were in use, where `replace_busy` allows another port.
        failures: the newest cause, by source, of a frame that could not be sent.
    """

    def __init__(
        self,
        name: str,
        places: Place | Sequence[Place],
        clock: Callable[[], float],
        *,
        replace_busy: bool = False,
    ) -> None:
        """Nothing is opened yet. Places without UDP are left to subclasses.

        `replace_busy` opens any free port instead of one in use.
        """
        self.problems: list[str] = []
        self.failures: dict[int, str] = {}
        self._name = name
        self._clock = clock
        self._replace_busy = replace_busy
        self._bound: list[tuple[str, int]] = []
        far: list[int] = []
        for each in places if isinstance(places, Sequence) else (places,):
            match each:
                case Listen(host, first, count):
                    self._bound += [(host, port) for port in range(first, first + count)]
                    far += [_ANY] * count
                case UdpOut(host, first, count):
                    for port in range(first, first + count):
                        far.append(source_of(host_number(host), port, len(self._bound)))
                        self._bound.append(("0.0.0.0", 0))  # noqa: S104  answers come to any address of ours
        self.udp_count = len(far)
        self._far: Whole = np.array(far, np.int64)
        self._filtered = bool((self._far != _ANY).any())
        self._sockets: tuple[socket.socket, ...] = ()
        self._selector: selectors.BaseSelector | None = None
        self._drained_s = np.zeros(0)
        self._room = mmsg.Batch(_ROOM, _LONGEST, LONGEST_FRAME)
        self._start = np.arange(_ROOM, dtype=np.int64) * self._room.data.shape[1] + LONGEST_FRAME
        self._index = np.zeros(_ROOM, np.int64)
        self._outbox = mmsg.Batch(1, 1)
        self._in_runs = False

    def open(self) -> None:
        opened: list[socket.socket] = []
        for host, port in self._bound:
            try:
                opened.append(_bound(host, port))
            except (OSError, OverflowError) as error:
                problem = f"{self._name}: UDP port {port} on {host}: {why_closed(error)}"
                if not self._replace_busy:
                    for other in opened:
                        other.close()
                    raise LinkError(problem) from error
                self.problems.append(problem)
                opened.append(_bound("0.0.0.0", 0))  # noqa: S104  answers come to any address of ours
        self._sockets = tuple(opened)
        self._in_runs = all(map(mmsg.sends_runs, opened))
        self._drained_s = np.full(len(opened), self._clock())
        self._selector = selectors.DefaultSelector()
        for index, opened_socket in enumerate(opened):
            self._selector.register(opened_socket, selectors.EVENT_READ, index)

    def standing(self) -> Iterable[int]:
        return self._far[self._far != _ANY].tolist() if self._filtered else ()

    def close(self) -> None:
        sockets, self._sockets = self._sockets, ()
        if self._selector is not None:
            self._selector.close()
            self._selector = None
        for open_socket in sockets:
            open_socket.close()

    def receive(self, take: Callable[[Datagrams], None]) -> None:
        """See `Ports.receive`. The sockets that are ready share room and time: none is left out."""
        if self._selector is None:
            return
        filled = 0
        now_s, wall_s = self._clock(), wall_time_s()
        ready: Sequence[int] = range(len(self._sockets))
        full: list[int] = []  # not read until they were empty
        if len(ready) > 1:  # a single one is read at once: one call less
            ready = [key.data for key, _ in self._selector.select(0)]
        for turn, index in enumerate(ready, 1):
            end, until_s = _ROOM * turn // len(ready), now_s + TURN_S * turn / len(ready)
            while True:
                most = min(_BATCH, end - filled)
                count = self._room.read(self._sockets[index].fileno(), filled, most) if most else 0
                self._index[filled : filled + count] = index
                filled += count
                if count < _BATCH or self._clock() > until_s:
                    break
            if count == most:
                full.append(index)
        if filled:
            take(self._datagrams(filled, now_s, wall_s))
        before_s, self._drained_s = self._drained_s, np.full(len(self._sockets), now_s)
        self._drained_s[full] = before_s[full]

    def send(
        self, data: Bytes, length: Whole, destination: Whole, *, until_s: float = inf
    ) -> NDArray[np.bool_]:
        left = np.zeros(len(destination), np.bool_)
        if not self._sockets or not len(destination):
            return left
        (n, longest), (rows, columns) = data.shape, self._outbox.data.shape
        if rows < n or columns < longest:
            self._outbox = mmsg.Batch(max(n, rows), max(longest, columns))
        changes = self._outbox.put(data, length, destination).tolist()
        # one call for each socket, not each change
        if len(changes) and len(changes) >= len(np.unique(destination >> 48)):
            order = np.argsort(destination >> 48, kind="stable")
            left[order] = self.send(data[order], length[order], destination[order], until_s=until_s)
            return left
        for first, end in zip([0, *changes], [*changes, n], strict=True):
            index = int(destination[first]) >> 48  # below 0: no address
            if 0 <= index < len(self._sockets):
                self._send_all(destination, self._sockets[index], first, end, left, until_s)
        return left

    def _send_all(
        self,
        destination: Whole,
        through: socket.socket,
        first: int,
        end: int,
        left: NDArray[np.bool_],
        until_s: float,
    ) -> None:
        # Check again right before every call: the process may have been suspended since the last check.
        while first < end and self._clock() <= until_s:
            try:
                send = self._outbox.send_runs if self._in_runs else self._outbox.send
                count = send(through.fileno(), first, end)
            except OSError as error:  # a full buffer, no route: it may come back
                if self._in_runs and error.errno in mmsg.REFUSALS:
                    self._in_runs = False  # not possible on this route: one by one from now on
                    continue
                self._note_failure(int(destination[first]), error)
                first += 1
                continue
            left[first : first + count] = True
            first += count

    def _note_failure(self, destination: int, error: OSError) -> None:
        if isinstance(error, BlockingIOError):  # slow: this frame is lost, later ones may leave
            self.no_room += 1
            return
        self.send_errors += 1  # no route, or the far end's port is closed: it may come back
        if destination not in self.failures:
            about = {"link": self._name, "address": str(self.address(destination)), "cause": str(error)}
            log.warning("send_failed", extra=about)
        self.failures[destination] = error.strerror or str(error)

    def _datagrams(self, count: int, now_s: float, wall_s: float) -> Datagrams:
        """Rows up to `count`, with times on our clock.

        The kernel stamps with the wall clock, which may be set meanwhile; but nothing read now can have
        arrived before the socket was last empty, which bounds the error.
        """
        room, index = self._room, self._index[:count]
        source, time_s = room.arrivals(index, now_s, wall_s, self._drained_s)
        length = np.minimum(room.length[:count], _LONGEST)
        start = self._start[:count].copy()  # whoever puts streams together changes it
        arrived = Datagrams(room.data.reshape(-1), start, length, source, time_s, LONGEST_FRAME)
        if not self._filtered:
            return arrived
        return arrived.of((self._far[index] == _ANY) | (self._far[index] == source))


def _bound(host: str, port: int) -> socket.socket:
    """A UDP socket that never blocks and reports when the kernel received each datagram."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        bound.setblocking(False)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
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
