"""Our own sockets: every byte to and from the vehicles passes here, and no setpoint without permission.

Receiving happens when the loop's thread calls `receive`, sending on whichever thread calls `send` (MAVSDK's
own, mostly).
"""

import logging
import selectors
import socket
import sys
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from struct import Struct
from threading import Lock
from time import time as wall_time_s
from types import MappingProxyType
from typing import Final, TypeAlias

from gcs.errors import LinkError
from gcs.links.deadman import Deadman
from gcs.links.heard import Heard
from gcs.links.killlatch import KillLatch
from gcs.links.mavlink_frames import PING, SETPOINT_MESSAGES, Frame, moves, split, target_system
from gcs.links.roster import TAKEN, Address, Roster, Verdict

log = logging.getLogger(__name__)

_DATAGRAM_MAX_BYTES: Final = 65535
_READS_PER_CALL: Final = 4096  # empties a socket after a stall, yet cannot be kept busy for ever
_RECEIVE_BUFFER_BYTES: Final = 4 << 20
_RECORD_LENGTH: Final = 4096
_STRANGERS_LOGGED_MAX: Final = 64
_SO_TIMESTAMPNS: Final = 35  # Linux; Python does not name it
_TIMESPEC: Final = Struct("@ll")


class Direction(StrEnum):
    """Seen from the ground."""

    SENT = "sent"
    RECEIVED = "received"


Observer: TypeAlias = Callable[[float, Direction, bytes, int], None]
"""Called with the time, the direction, one whole frame, and the system it is for or from (0: everybody).

On the loop's thread for received frames and on MAVSDK's for sent ones: quick, and safe on both.
"""


@dataclass(frozen=True, slots=True)
class Listen:
    """UDP ports to listen on: one per vehicle, or one for all behind a radio or router."""

    host: str
    first_port: int
    port_count: int = 1


@dataclass(slots=True)
class Counters:
    """What passed and what did not, since the wire was made. Frames, except where it says bytes."""

    received: int = 0
    sent: int = 0
    setpoints_sent: int = 0
    setpoints_dropped: int = 0  # by the deadman
    commands_dropped: int = 0  # ordered before a kill, and repeated behind it
    unroutable: int = 0  # for a system not heard yet
    send_errors: int = 0
    garbage_bytes: int = 0
    unknown_bytes: int = 0  # of messages that pymavlink does not know: not checked, so not taken
    strangers: int = 0
    duplicates: int = 0


class Wire:
    """UDP sockets, routing by system id, arrival times, the deadman, and a record of what left.

    Attributes:
        heard: per configured system id, what the wire itself read.
        counters: totals, for metrics.
        observers: whoever wants to see every frame; replace the tuple, do not mutate it.
    """

    def __init__(
        self,
        *,
        name: str,
        system_ids: Iterable[int],
        listen: Listen,
        deadman: Deadman,
        latch: KillLatch,
        clock: Callable[[], float],
        deliver: Callable[[Frame], None],
    ) -> None:
        """Nothing is opened yet. `deliver` gets every accepted frame, on the thread that receives."""
        self.heard: Mapping[int, Heard] = MappingProxyType({system_id: Heard() for system_id in system_ids})
        self.counters = Counters()
        self.observers: tuple[Observer, ...] = ()
        self._name = name
        self._listen = listen
        self._deadman = deadman
        self._latch = latch
        self._clock = clock
        self._deliver = deliver
        self._roster = Roster(self.heard)
        self._sockets: tuple[socket.socket, ...] = ()
        self._selector: selectors.BaseSelector | None = None
        self._drained_s: list[float] = []
        self._sent_s: dict[int, deque[float]] = {
            system_id: deque(maxlen=_RECORD_LENGTH) for system_id in self.heard
        }
        self._lock = Lock()
        self._strangers: set[tuple[int, str]] = set()
        self._send_failed = False

    def open(self) -> None:
        """Bind every port. Raises: LinkError naming the port."""
        opened: list[socket.socket] = []
        for port in range(self._listen.first_port, self._listen.first_port + self._listen.port_count):
            try:
                opened.append(_bound(self._listen.host, port))
            except (OSError, OverflowError) as error:
                for other in opened:
                    other.close()
                raise LinkError(f"{self._name}: UDP port {port} on {self._listen.host}: {error}") from error
        self._sockets = tuple(opened)
        self._drained_s = [self._clock()] * len(opened)
        self._selector = selectors.DefaultSelector()
        for index, opened_socket in enumerate(opened):
            self._selector.register(opened_socket, selectors.EVENT_READ, index)

    def close(self) -> None:
        """Release the ports; frames sent afterwards go nowhere."""
        sockets, self._sockets = self._sockets, ()
        if self._selector is not None:
            self._selector.close()
            self._selector = None
        for open_socket in sockets:
            open_socket.close()

    def receive(self) -> None:
        """Take in everything that has arrived. Never blocks.

        To be called every few milliseconds. Waking the loop for every datagram would cost more, and nothing
        is lost by waiting, since the kernel notes the times of arrival.
        """
        if self._selector is not None:
            for key, _ in self._selector.select(0):
                self._read(key.data)

    def send(self, data: bytes) -> None:
        """Send MAVSDK's frames, each to its own target only, unless deadman or latch forbid. Never raises."""
        for frame in split(data, checked=False).frames:
            target = target_system(frame)
            if frame.message_id == PING and target == 0:
                continue  # one to everybody for every vehicle known grows with the square of the fleet
            if self._latch.is_shut(target) and moves(frame):
                with self._lock:
                    self.counters.commands_dropped += 1
            elif frame.message_id in SETPOINT_MESSAGES:
                self._send_setpoint(frame, target)
            else:
                self._send_frame(frame, target)

    def send_kill(self, data: bytes) -> None:
        """Send a kill command, which no latch holds back. Never raises."""
        for frame in split(data).frames:
            self._send_frame(frame, target_system(frame))

    def conflicts(self) -> dict[int, str]:
        """System ids heard lately from two addresses, both named in the text."""
        return self._roster.conflicts(self._clock())

    def address(self, system_id: int) -> Address | None:
        """Where this system spoke from last; None before it was heard."""
        return self._roster.address(system_id)

    def setpoint_times_s(self, system_id: int) -> tuple[float, ...]:
        """When the latest setpoints to this system left, oldest first; bounded."""
        return tuple(self._sent_s[system_id])

    def _send_setpoint(self, frame: Frame, target: int) -> None:
        if not self._deadman.allows(target, self._clock()):
            with self._lock:
                self.counters.setpoints_dropped += 1
        elif self._send_frame(frame, target):
            record = self._sent_s.get(target)
            if record is not None:
                record.append(self._clock())  # after the call: never earlier than the truth
            with self._lock:
                self.counters.setpoints_sent += 1

    def _send_frame(self, frame: Frame, target: int) -> bool:
        """Whether it left to at least one address."""
        if target == 0:
            addresses = self._roster.everybody
        else:
            address = self._roster.address(target)
            addresses = () if address is None else (address,)
        left = 0
        for address in addresses:
            left += self._send_to(frame.raw, address)
        with self._lock:
            self.counters.sent += left
            self.counters.unroutable += not addresses
        if left:
            now_s = self._clock()
            for observer in self.observers:
                observer(now_s, Direction.SENT, frame.raw, target)
        return left > 0

    def _send_to(self, data: bytes, address: Address) -> bool:
        sockets = self._sockets
        if address.socket_index >= len(sockets):
            return False  # closed meanwhile
        try:
            sockets[address.socket_index].sendto(data, (address.host, address.port))
        except OSError as error:  # a full buffer, no route, or the peer's port is closed: it may come back
            with self._lock:
                self.counters.send_errors += 1
                is_first, self._send_failed = not self._send_failed, True
            if is_first:
                log.warning(
                    "send_failed", extra={"link": self._name, "address": str(address), "cause": str(error)}
                )
            return False
        return True

    def _read(self, index: int) -> None:
        """Empty one socket."""
        source = self._sockets[index]
        now_s, wall_s = self._clock(), wall_time_s()
        oldest_s = self._drained_s[index]
        for _ in range(_READS_PER_CALL):
            try:
                data, ancillary, _, sender = source.recvmsg(_DATAGRAM_MAX_BYTES, 64)
            except BlockingIOError:
                self._drained_s[index] = now_s
                return
            except OSError:  # an ICMP error of an earlier send, reported here; the socket is still good
                continue
            time_s = _arrival_s(ancillary, now_s, wall_s, oldest_s)
            self._receive(data, Address(sender[0], sender[1], index), time_s)

    def _receive(self, data: bytes, address: Address, time_s: float) -> None:
        frames, garbage_bytes, unknown_bytes = split(data)
        self.counters.garbage_bytes += garbage_bytes
        self.counters.unknown_bytes += unknown_bytes
        for frame in frames:
            system_id = frame.system_id
            verdict = self._roster.hear(system_id, address, time_s)
            if verdict is not Verdict.KNOWN:
                self._note(verdict, frame, address)
            if verdict not in TAKEN:
                continue
            self.counters.received += 1
            self.heard[system_id].take(frame, time_s)
            self._deliver(frame)
            for observer in self.observers:
                observer(time_s, Direction.RECEIVED, frame.raw, system_id)

    def _note(self, verdict: Verdict, frame: Frame, address: Address) -> None:
        """Count what was not taken, and log every change once."""
        about = {"link": self._name, "system_id": frame.system_id, "address": str(address)}
        if verdict is Verdict.FIRST:
            log.info("vehicle_heard", extra=about)
        elif verdict is Verdict.MOVED:
            log.warning("vehicle_moved", extra=about)
        elif verdict is Verdict.STRANGER:
            self.counters.strangers += 1
            stranger = (frame.system_id, address.host)
            if stranger not in self._strangers and len(self._strangers) < _STRANGERS_LOGGED_MAX:
                self._strangers.add(stranger)
                log.info("stranger_ignored", extra=about)
        else:
            self.counters.duplicates += 1
            if verdict is Verdict.NEW_DUPLICATE:
                cause = self._roster.conflicts(self._clock()).get(frame.system_id, "")
                log.error("duplicate_system_id", extra=about | {"cause": cause})


def _bound(host: str, port: int) -> socket.socket:
    """A UDP socket that never blocks and, on Linux, says when the kernel received each datagram."""
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
    """When a datagram really arrived, on our clock: after a stall of the loop that is not "now".

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
