"""Requests for each vehicle's clock (TIMESYNC): the time to its answer is the link's round trip."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gcs.links.telemetry import FleetTelemetry
from gcs.mavlink.codec import Records, records
from gcs.mavlink.framing import TIMESYNC
from gcs.model.state import Mask

ASKED_EVERY_S, AGAIN_S = 1.0, 0.25
"""And sooner while positions are late by their clock, or are due: answers show whether the link is late."""

LATE_S, DUE_S, GONE_S = 0.3, 0.6, 3.0
"""While positions are later, or due for longer, requests leave sooner; after the last no more than usual."""


@dataclass(eq=False)
class RoundTrips:
    """State of the requests to n vehicles. Rows as on the link. PX4 and ArduPilot answer at once."""

    telemetry: FleetTelemetry  # `asked_ns` is written
    broadcast: Callable[[int, Records, float], object]  # one message to each address, at a time
    _asked_s: float = -np.inf

    def watch(self, connected: Mask, now_s: float) -> None:
        """Ask all of the (n,) vehicles that are connected, when it is time."""
        due_s, asked_ns = now_s - self.telemetry.position_time_s, self.telemetry.asked_ns
        doubtful = (self.telemetry.clock_late_s > LATE_S) | ((due_s > DUE_S) & (due_s < GONE_S))
        every_s = AGAIN_S if doubtful[connected].any() else ASKED_EVERY_S
        if now_s - self._asked_s < every_s or not connected.any():
            return
        self._asked_s = now_s
        request = records(TIMESYNC, 1)
        request["ts1"] = now_ns = round(now_s * 1e9)
        asked_ns[connected, :-1] = asked_ns[connected, 1:]
        asked_ns[connected, -1] = now_ns
        self.broadcast(TIMESYNC, request, now_s)
