"""Sends corrections to all vehicles of a link: whole messages or none, within its budget."""

from collections import deque
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gcs.links.budget import Budget
from gcs.links.sender import Outbox
from gcs.mavlink.codec import HEADER_LENGTH, Records
from gcs.mavlink.rtcm import GPS_RTCM_DATA, fragments

OLD_S: Final = 2.0
"""A correction that has waited for so long does not leave any more."""

WAITING_MAX: Final = 64

AT_ONCE_MAX: Final = 16
"""Messages that leave in a tick: a base of four constellations has 12 in an epoch."""


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
        copies, parts = 0, list[Records]()
        while self._waiting and len(parts) < AT_ONCE_MAX:
            taken_s, message = self._waiting[0]
            if now_s - taken_s > OLD_S:
                self.dropped += 1
            elif self.budget.left_bytes(now_s) > 0:
                copies = copies or len(self.outbox.addresses.one_per_source())
                parts.append(fragments(message, self._sequence))
                self._sequence += 1
                self.budget.spend(copies * (len(message) + len(parts[-1]) * (HEADER_LENGTH + 2)))
            else:
                break
            self._waiting.popleft()
        if parts:
            self.outbox.broadcast(GPS_RTCM_DATA, np.concatenate(parts), now_s)
            self.sent += len(parts)
