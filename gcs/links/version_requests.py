"""Requests for AUTOPILOT_VERSION, to every vehicle when it connects and after a reboot: a few, then none."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.mavlink import framing
from gcs.mavlink.codec import Records, addressed
from gcs.mavlink.kernels import Whole
from gcs.model.state import Array, Mask

_ANSWER_S: Final = 1.0
_TRIES: Final = 6


@dataclass(eq=False)
class VersionRequests:
    """State of the requests to each of n vehicles. Rows as on the link."""

    system_ids: Whole  # (n,) of the vehicles
    send: Callable[[int, Records, Whole], object]  # as of `StreamRequests`

    def __post_init__(self) -> None:
        n = len(self.system_ids)
        self._connection_count = np.zeros(n, np.int64)
        self._since_s = np.full(n, np.inf)  # of the newest connection
        self._tries = np.zeros(n, np.int64)
        self._requested_s = np.full(n, -np.inf)
        self._due: Mask = np.zeros(n, np.bool_)

    def watch(self, connected: Mask, connection_count: Whole, version_time_s: Array, now_s: float) -> None:
        """Send the requests that are due. Every second one is the command of autopilots before 2020.

        Args:
            connected: (n,) recently received, and may be sent requests.
            connection_count: (n,) how often each connected, see `FleetTelemetry`.
            version_time_s: (n,) arrival of each version.
            now_s: the link's clock.
        """
        new = connection_count != self._connection_count
        if np.count_nonzero(new):
            self._connection_count = connection_count.copy()
            self._due |= new
            self._since_s[new], self._tries[new], self._requested_s[new] = now_s, 0, -np.inf
        if not np.count_nonzero(self._due):
            return
        self._due &= (version_time_s < self._since_s) & (self._tries < _TRIES)
        rows = np.flatnonzero(self._due & connected & (now_s - self._requested_s >= _ANSWER_S))
        if not len(rows):
            return
        again = self._tries[rows] % 2 == 1
        messages = addressed(
            framing.COMMAND_LONG,
            self.system_ids[rows],
            command=np.where(again, framing.REQUEST_AUTOPILOT_CAPABILITIES, framing.REQUEST_MESSAGE),
            confirmation=0,
            param1=np.where(again, 1, framing.AUTOPILOT_VERSION),
        )
        self.send(framing.COMMAND_LONG, messages, rows)
        self._tries[rows] += 1
        self._requested_s[rows] = now_s
