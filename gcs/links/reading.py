"""Reads sockets, pipes and devices that never block, so many times in a turn."""

import asyncio
import socket
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass
from ipaddress import ip_address
from math import inf
from typing import Final

from gcs.links.intake import TURN_S, Arrived, Intake
from gcs.model.errors import LinkError

READS_MAX: Final = 200
"""Most reads of one socket in a turn; what arrives meanwhile waits in the kernel, up to `BUFFER_BYTES`."""

BUFFER_BYTES: Final = 1 << 16
"""Receive buffer of such a socket: what waits there is never older than a few turns."""

DATAGRAM_BYTES: Final = 65535

IDLE_S: Final = 1.0
"""After so long without a datagram, an empty batch says so."""


@dataclass(slots=True)
class Turn:
    """Counts reads, of which each turn has so many."""

    _begin_s: float = -inf
    _left: int = 0

    def may_read(self, now_s: float) -> bool:
        """Whether one more read fits into this turn."""
        if now_s >= self._begin_s + TURN_S:
            self._begin_s, self._left = now_s, READS_MAX
        self._left -= 1
        return self._left >= 0

    @property
    def next_s(self) -> float:
        return self._begin_s + TURN_S


class Reader:
    """Reads a socket, pipe or device that never blocks, on the event loop: so many times in a turn.

    Attributes:
        ended: raises why nothing can be read any more.
    """

    def __init__(
        self, file: int, read: Callable[[], Arrived], take: Callable[[list[Arrived], float], None]
    ) -> None:
        """Begin to read.

        Args:
            file: descriptor.
            read: reads once; BlockingIOError: nothing waits; OSError, LinkError: it has ended.
            take: takes what was read at once, at a time of the loop's clock.
        """
        self._loop = asyncio.get_running_loop()
        self.ended: asyncio.Future[None] = self._loop.create_future()
        self._file, self._read, self._take = file, read, take
        self._turn = Turn()
        self._later: asyncio.TimerHandle | None = None
        self._loop.add_reader(file, self.readable)

    def readable(self) -> None:
        """Read what waits, and pause until the next turn when there is too much of it."""
        now_s = self._loop.time()
        arrived: list[Arrived] = []
        try:
            while self._turn.may_read(now_s):
                arrived.append(self._read())
        except BlockingIOError:
            pass
        except (OSError, LinkError) as error:
            self.close()
            if not self.ended.done():
                self.ended.set_exception(error)
        else:
            self._loop.remove_reader(self._file)
            self._later = self._loop.call_at(self._turn.next_s, self._resume)
        if arrived:
            self._take(arrived, now_s)

    def _resume(self) -> None:
        self._later = None
        self._loop.add_reader(self._file, self.readable)
        self.readable()

    def close(self) -> None:
        """Read no more; the descriptor stays open."""
        if self._later is not None:
            self._later.cancel()
        self._loop.remove_reader(self._file)


async def datagrams(
    host: str, port: int, intake: Intake, interface: str = ""
) -> AsyncGenerator[list[Arrived], None]:
    """Receive at a UDP address without end, and send nothing: what has arrived and may pass, in batches.

    An empty batch: nothing arrived for `IDLE_S`. A multicast group is joined at `interface`, an IP address;
    empty: any.

    Raises: OSError, UnicodeError where the address cannot be used.
    """
    waiting: asyncio.Queue[list[Arrived]] = asyncio.Queue(1)

    def take(arrived: list[Arrived], now_s: float) -> None:
        older = [] if waiting.empty() else waiting.get_nowait()
        waiting.put_nowait(older + intake.admit(arrived, now_s))

    loop = asyncio.get_running_loop()
    family, kind, _, _, place = (await loop.getaddrinfo(host, port, type=socket.SOCK_DGRAM))[0]
    with socket.socket(family, kind) as bound:
        bound.setblocking(False)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        if ip_address(place[0]).is_multicast:
            _join(bound, str(place[0]), interface)
        bound.bind(place)
        reader = Reader(bound.fileno(), lambda: Arrived(*bound.recvfrom(DATAGRAM_BYTES)), take)
        reader.ended.add_done_callback(lambda _: take([], loop.time()))
        try:
            while not reader.ended.done():
                try:
                    async with asyncio.timeout(IDLE_S):  # wait_for would miss a cancellation as data arrive
                        batch = await waiting.get()
                except TimeoutError:
                    batch = []
                yield batch
            await reader.ended
        finally:
            reader.close()


def _join(bound: socket.socket, group: str, interface: str) -> None:
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # other programs here may receive the group
    try:
        joined = socket.inet_aton(group) + socket.inet_aton(interface or "0.0.0.0")  # noqa: S104  where a route is
        bound.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, joined)
    except OSError as error:
        at, why = f" at {interface}" if interface else "", error.strerror or error
        raise LinkError(f"group {group} cannot be joined{at}: {why}") from None
