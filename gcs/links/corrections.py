"""Sends corrections to all vehicles of a link: whole messages or none, within its budget.

Source: https://mavlink.io/en/messages/common.html#GPS_RTCM_DATA. Bit 0 of the flags says that it is cut,
bits 1 and 2 number its fragments, bits 3 to 7 number the messages. A receiver knows one as whole when it has
all four fragments, or all before the first one that is not full.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gcs.links.send_budget import Budget
from gcs.links.sender import Outbox
from gcs.mavlink.codec import HEADER_LENGTH, Records, records

GPS_RTCM_DATA: Final = 233
FRAGMENT_BYTES: Final = 180
FRAGMENTS_MAX: Final = 4
LONGEST_BYTES: Final = FRAGMENT_BYTES * FRAGMENTS_MAX
"""RTCM allows 1029 bytes. What is longer than this cannot be sent as one message."""

SEQUENCES: Final = 32

OLD_S: Final = 2.0
"""A correction that has waited for so long does not leave any more."""

WAITING_MAX: Final = 64

AT_ONCE_MAX: Final = 16
"""Messages that leave in a tick: a base of four constellations has 12 in an epoch."""


def fragments(message: bytes, sequence: int) -> Records:
    """GPS_RTCM_DATA of one RTCM message, in the order in which they are to leave.

    Raises: ValueError for a message that is not 1 to `LONGEST_BYTES` bytes long.
    """
    if not 1 <= len(message) <= LONGEST_BYTES:
        raise ValueError(f"an RTCM message of {len(message)} bytes: 1 to {LONGEST_BYTES}")
    fragmented = len(message) > FRAGMENT_BYTES
    count = min(len(message) // FRAGMENT_BYTES + 1, FRAGMENTS_MAX) if fragmented else 1
    made = records(GPS_RTCM_DATA, count)
    for at in range(count):
        part = np.frombuffer(message[at * FRAGMENT_BYTES : (at + 1) * FRAGMENT_BYTES], np.uint8)
        made["flags"][at] = int(fragmented) | at << 1 | sequence % SEQUENCES << 3
        made["len"][at] = len(part)
        made["data"][at, : len(part)] = part
    return made


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

    @property
    def waits(self) -> bool:
        """Whether there is something to send."""
        return bool(self._waiting)

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
