"""Sends corrections to all vehicles of a link: whole messages or none, within its budget, before lights."""

from collections import deque
from dataclasses import dataclass, field
from typing import Final

from gcs.links.budget import Budget
from gcs.links.sender import Outbox
from gcs.mavlink.codec import HEADER_LENGTH
from gcs.mavlink.framing import GPS_RTCM_DATA
from gcs.mavlink.rtcm import fragments

OLD_S: Final = 2.0
"""A correction that has waited for so long does not leave any more."""

WAITING_MAX: Final = 64


@dataclass(eq=False)
class CorrectionSender:
    """Corrections that wait for room on one link.

    Attributes:
        sent: messages that left for all vehicles.
        dropped: messages that became too old, or found too many before them.
    """

    outbox: Outbox
    budget: Budget
    sent: int = 0
    dropped: int = 0
    _waiting: deque[tuple[float, bytes]] = field(default_factory=deque)
    _sequence: int = 0

    def add(self, message: bytes, now_s: float) -> None:
        """Queue one RTCM message of at most `LONGEST_BYTES`."""
        self._waiting.append((now_s, message))
        if len(self._waiting) > WAITING_MAX:
            self._waiting.popleft()
            self.dropped += 1

    def send(self, now_s: float) -> None:
        """Send what waits and has room."""
        while self._waiting:
            taken_s, message = self._waiting[0]
            if now_s - taken_s > OLD_S:
                self.dropped += 1
            elif self.budget.left_bytes(now_s) > 0:
                self._send(message, now_s)
            else:
                return
            self._waiting.popleft()

    def _send(self, message: bytes, now_s: float) -> None:
        parts = fragments(message, self._sequence)
        self._sequence += 1
        copies = len(self.outbox.addresses.one_per_source())
        for at in range(len(parts)):
            self.outbox.broadcast(GPS_RTCM_DATA, parts[at : at + 1], now_s)
        self.budget.spend(copies * (len(message) + len(parts) * (HEADER_LENGTH + 2)))
        self.sent += 1
