"""The interface of a link's ports: datagrams in batches, and their addresses as numbers."""

import errno
import socket
from collections.abc import Callable, Iterable, Sequence
from math import inf
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gcs.links.link import Address
from gcs.mavlink.kernels import Bytes, Whole
from gcs.model.state import Array, Mask


class Datagrams(NamedTuple):
    """What arrived, in order of its arrival at each port. Valid until the next read."""

    data: Bytes  # flat
    start: Whole  # (m,) of each in `data`
    length: Whole  # (m,)
    source: Whole  # (m,) source, see `source_of`
    time_s: Array  # (m,) of arrival, on our clock
    headroom: int = 0  # bytes before each that may be overwritten; 0: the frames are whole

    def of(self, these: Mask) -> "Datagrams":
        """Some of them: (m,)."""
        start, length, source = self.start[these], self.length[these], self.source[these]
        return Datagrams(self.data, start, length, source, self.time_s[these], self.headroom)


def source_of(host: int, port: int, socket_index: int) -> int:
    """An IPv4 address, and the port of ours that it sends to, as one number."""
    return socket_index << 48 | host << 16 | port


def socket_of(source: int) -> int:
    return source >> 48


def host_number(host: str) -> int:
    return int.from_bytes(socket.inet_aton(host), "big")


def why_closed(error: Exception) -> str:
    """Why a port cannot be opened, in words."""
    in_use = isinstance(error, OSError) and error.errno == errno.EADDRINUSE
    return "another program has it" if in_use else str(error)


class Ports(Protocol):
    """Where the frames of a link arrive and leave.

    Attributes:
        send_errors: frames that could not leave.
        no_room: frames that found no room: a slow serial port or connection.
    """

    send_errors: int = 0
    no_room: int = 0

    def open(self) -> None:
        """Open every port. Raises: LinkError naming the port."""

    def close(self) -> None:
        """Release the ports; what is sent afterwards is lost."""

    def receive(self, take: Callable[[Datagrams], None]) -> None:
        """Give what has arrived to `take`, for a limited time. Never blocks."""

    def send(
        self, data: Bytes, length: Whole, destination: Whole, *, until_s: float = inf
    ) -> NDArray[np.bool_]:
        """Send n frames, each whole or not at all. Never blocks, never raises.

        Args:
            data: (n, longest).
            length: (n,) bytes of each.
            destination: (n,) sources as received; negative: no address.
            until_s: on our clock; no frame leaves later, and none with such a time waits behind others.

        Returns: (n,) whether each left.
        """

    def standing(self) -> Iterable[int]:
        """Sources that can be sent to before they send anything."""
        return ()

    def gone(self) -> Sequence[int]:
        """Sources whose connection has ended since the last call."""
        return ()

    def address(self, source: int) -> Address:
        """The source, for texts and records."""
        host = socket.inet_ntoa((source >> 16 & 0xFFFFFFFF).to_bytes(4, "big"))
        return Address(host, source & 0xFFFF, socket_of(source))
