"""UDP, listening or sending first, with the kernel's times of arrival."""

import errno
import socket
import sys
from collections.abc import Iterator
from selectors import EVENT_READ, BaseSelector
from struct import Struct
from time import time as wall_time_s
from typing import Final

from gcs.links.address_book import Address
from gcs.links.endpoints.endpoint import Arrival
from gcs.links.mmsg import Batch
from gcs.mavlink.framing import split
from gcs.model.errors import LinkError

_DATAGRAM_MAX_BYTES: Final = 65535
_READS_PER_CALL: Final = 4096  # empties a socket after a stall; a flood cannot block the loop
_GARBAGE_MAX_BYTES: Final = 2048  # of a datagram; costs at most 2 us a byte
_RECEIVE_BUFFER_BYTES: Final = 4 << 20
_SO_TIMESTAMPNS: Final = 35  # Linux; Python does not name it
_TIMESPEC: Final = Struct("@ll")


class Udp:
    """One UDP socket: bound, for any sender, or with exactly one far end."""

    def __init__(
        self,
        name: str,
        index: int,
        *,
        bound: tuple[str, int] | None = None,
        far: tuple[str, int] | None = None,
    ) -> None:
        """Give `bound` to listen there, or `far` to send there first. `name` is the link's, for errors."""
        self._name = name
        self._index = index
        self._bound = bound
        self._far = far
        self._standing = () if far is None else (Address(*far, index),)
        self._socket: socket.socket | None = None
        self._selector: BaseSelector | None = None
        self._drained_s = 0.0

    @property
    def standing(self) -> tuple[Address, ...]:
        """The far end, if it has one."""
        return self._standing

    def open(self, selector: BaseSelector, now_s: float) -> None:
        """Bind. Raises: LinkError naming the port."""
        host, port = self._bound or ("0.0.0.0", 0)  # noqa: S104  answers come to any of our addresses
        try:
            self._socket = _bound(host, port)
        except (OSError, OverflowError) as error:
            raise LinkError(f"{self._name}: UDP port {port} on {host}: {error}") from error
        self._drained_s = now_s
        selector.register(self._socket, EVENT_READ, self._read)
        self._selector = selector

    def close(self) -> None:
        """Release the port."""
        gone, self._socket = self._socket, None
        if gone is not None:
            if self._selector is not None:
                self._selector.unregister(gone)
            gone.close()

    def tend(self, now_s: float) -> None:
        """Nothing to do."""

    def gone(self) -> tuple[Address, ...]:
        """None: UDP has no connections."""
        return ()

    def send(self, data: bytes, address: Address, *, perishable: bool) -> None:  # noqa: ARG002
        """Send one datagram. Raises: OSError; after an ICMP error this may be that of an earlier datagram."""
        opened = self._socket
        if opened is None:
            raise OSError(errno.ENOTCONN, "closed")
        opened.sendto(data, (address.host, address.port))

    def send_batch(self, batch: Batch, first: int, end: int) -> int:
        """Send rows `first` to `end` - 1 of a batch, in order. Returns: number of rows sent.

        Raises: OSError when the first of them could not be sent.
        """
        opened = self._socket
        if opened is None:
            raise OSError(errno.ENOTCONN, "closed")
        return batch.send(opened.fileno(), first, end)

    def _read(self, now_s: float) -> Iterator[Arrival]:
        """Read until the socket is empty."""
        wall_s = wall_time_s()
        oldest_s = self._drained_s
        for _ in range(_READS_PER_CALL):
            if self._socket is None:
                return
            try:
                data, ancillary, _, sender = self._socket.recvmsg(_DATAGRAM_MAX_BYTES, 64)
            except BlockingIOError:
                self._drained_s = now_s
                return
            except OSError:  # an ICMP error of an earlier send, reported here; the socket still works
                continue
            if self._far is not None and sender != self._far:
                continue
            parts = split(data, garbage_max_bytes=_GARBAGE_MAX_BYTES)
            time_s = _arrival_s(ancillary, now_s, wall_s, oldest_s)
            yield Arrival(Address(sender[0], sender[1], self._index), parts, time_s)


def _bound(host: str, port: int) -> socket.socket:
    """A UDP socket that never blocks and, on Linux, reports when the kernel received each datagram."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        bound.setblocking(False)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        if sys.platform == "linux":
            bound.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        bound.bind((host, port))
    except (OSError, OverflowError):
        bound.close()
        raise
    return bound


def _arrival_s(
    ancillary: list[tuple[int, int, bytes]], now_s: float, wall_s: float, oldest_s: float
) -> float:
    """Time of a datagram's arrival on our clock; after a stall of the loop this is not the present.

    The kernel stamps with the wall clock, which may be set meanwhile; but nothing read now can have arrived
    before the socket was last empty, which bounds the error.
    """
    for level, kind, value in ancillary:
        if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS and len(value) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(value)
            age_s = wall_s - (seconds + nanoseconds * 1e-9)
            arrival_s: float = min(now_s, max(oldest_s, now_s - age_s))
            return arrival_s
    return now_s
