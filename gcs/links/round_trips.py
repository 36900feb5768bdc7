"""Requests for each vehicle's clock (TIMESYNC): the time to its answer is the link's round trip."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.mavlink.codec import Records, records
from gcs.mavlink.framing import TIMESYNC
from gcs.mavlink.kernels import Whole
from gcs.model.state import Mask

ASKED_EVERY_S: Final = 1.0


@dataclass(eq=False)
class RoundTrips:
    """State of the requests to n vehicles. Rows as on the link.

    PX4 and ArduPilot answer at once, each with our time beside its own. An answer to an earlier request than
    the newest counts for nothing.
    """

    sent_ns: Whole  # (n,) our time in the newest request, written; 0: none, or it was answered
    broadcast: Callable[[int, Records, float], object]  # one message to each address, at a time
    _asked_s: float = -np.inf

    def watch(self, connected: Mask, now_s: float) -> None:
        """Ask all of the (n,) vehicles that are connected, when it is time."""
        if now_s - self._asked_s < ASKED_EVERY_S or not connected.any():
            return
        self._asked_s = now_s
        request = records(TIMESYNC, 1)
        request["ts1"] = self.sent_ns[connected] = round(now_s * 1e9)
        self.broadcast(TIMESYNC, request, now_s)
