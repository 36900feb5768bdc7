"""Forwarding to further ground stations: they receive the vehicles' frames, and may answer where configured.

Only UDP, which never waits: what a slow or dead station does not accept is lost to that station only.
"""

import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, InitVar, dataclass
from typing import Final

import numpy as np

from gcs.links.command_protocol import KillLatch
from gcs.links.intake import FORWARDED, Arrived, Intake
from gcs.links.link import Counters, FrameDirection
from gcs.links.reading import Turn
from gcs.links.sender import Outbox
from gcs.links.settings import Forward
from gcs.links.signing import SignatureFilter
from gcs.mavlink.codec import split, target_system
from gcs.mavlink.framing import SETPOINT_MESSAGES, Frame, moves
from gcs.model.errors import LinkError

_DATAGRAM_BYTES: Final = 1400
_LONGEST_BYTES: Final = 4096
_SETUP_SIGNING: Final = 256
_NEVER: Final = SETPOINT_MESSAGES | {_SETUP_SIGNING}


class Forwarder:
    """One further station. Used on the loop's thread only."""

    def __init__(self, to: Forward, counters: Counters) -> None:
        self._far = to.address
        self._read_only = to.read_only
        self._counters = counters
        self._socket: socket.socket | None = None
        self._waiting: list[bytes] = []
        self._waiting_bytes = 0
        self._turn = Turn()
        self._intake = Intake(f"forward {self._far[0]}:{self._far[1]}", FORWARDED)
        counters.intakes.append(self._intake)

    def open(self) -> None:
        """Raises: LinkError when no socket can be opened."""
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            made.setblocking(False)
            made.bind(("0.0.0.0", 0))  # noqa: S104  reachable on any address
        except OSError as error:
            made.close()
            raise LinkError(f"forward to {self._far[0]}:{self._far[1]}: {error}") from error
        self._socket = made

    def close(self) -> None:
        gone, self._socket = self._socket, None
        if gone is not None:
            gone.close()

    def offer(self, raw: bytes) -> None:
        """Queue a frame; several share a datagram."""
        if self._waiting_bytes + len(raw) > _DATAGRAM_BYTES:
            self.flush()
        self._waiting.append(raw)
        self._waiting_bytes += len(raw)

    def flush(self) -> None:
        waiting, self._waiting, self._waiting_bytes = self._waiting, [], 0
        if self._socket is None or not waiting:
            return
        try:
            self._socket.sendto(b"".join(waiting), self._far)
        except OSError:  # the station is absent or slow
            self._counters.not_forwarded += len(waiting)
        else:
            self._counters.forwarded += len(waiting)

    def read(self, now_s: float) -> Iterator[Frame]:
        """Frames that this station sent; none from other senders, and none if it is read-only."""
        if self._socket is None or self._read_only:
            return
        arrived = []
        while self._turn.may_read(now_s):
            try:
                data, sender = self._socket.recvfrom(_LONGEST_BYTES)
            except BlockingIOError:
                break
            except OSError:  # an ICMP error of an earlier send
                continue
            if sender == self._far:
                arrived.append(Arrived(data, sender))
        for data, _ in self._intake.admit(arrived, now_s):
            yield from split(data).frames


@dataclass(eq=False)
class Forwarding:
    """All further stations of a link: offers them accepted frames, and judges what they send."""

    stations: InitVar[Sequence[Forward]]  # where they are
    counters: Counters  # the link's
    _: KW_ONLY
    rows: Mapping[int, int]  # row on the link by system id
    station_id: int  # our own system id
    latch: KillLatch  # drops what moves a killed vehicle
    outbox: Outbox  # sends what may pass
    signatures: SignatureFilter | None  # judges their frames; None: they need no signature
    clock: Callable[[], float]  # the link's

    def __post_init__(self, stations: Sequence[Forward]) -> None:
        self._forwarders = tuple(Forwarder(each, self.counters) for each in stations)

    def open(self) -> None:
        """Raises: LinkError when no socket can be opened."""
        for forwarder in self._forwarders:
            forwarder.open()

    def close(self) -> None:
        for forwarder in self._forwarders:
            forwarder.close()

    def offer(self, _time_s: float, _direction: FrameDirection, raw: bytes, _system_id: int) -> None:
        """Queue an accepted frame. An `Observer` of received frames."""
        for forwarder in self._forwarders:
            forwarder.offer(raw)

    def exchange(self) -> None:
        """Send the queued frames; pass what the stations sent on to vehicles, where that is allowed."""
        now_s = self.clock()
        for forwarder in self._forwarders:
            forwarder.flush()
            for frame in forwarder.read(now_s):
                if self._passes(frame):
                    self.counters.taken_from_others += 1
                else:
                    self.counters.refused_from_others += 1

    def _passes(self, frame: Frame) -> bool:
        """Whether a frame from another station went to the vehicle that it targets.

        Never setpoints, manual control or a key: only this station flies the vehicles of a link. Never a
        frame for all systems, since a heartbeat of the other station would hide from the vehicles that ours
        has ended. Never in the name of a vehicle or of this station.
        """
        target, rows = target_system(frame), self.rows
        if self.signatures is not None and not self.signatures.is_signed(frame):
            return False
        if frame.system_id in rows or frame.system_id in (0, self.station_id):
            return False
        if frame.message_id in _NEVER or target not in rows:
            return False
        if self.latch.is_shut(target) and moves(frame):
            self.counters.commands_dropped += 1
            return False
        return bool(self.outbox.send_raw([frame.raw], np.array([rows[target]]), self.clock())[0])
