"""Requests for message rates, to every vehicle when it connects, and again after a reboot.

One interval after the other, since the acknowledgement does not name the message; for all vehicles at once.
"""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from gcs.links.stream_rates import REQUESTING_COMPONENT
from gcs.mavlink.codec import Records, records
from gcs.mavlink.framing import COMMAND_LONG, GLOBAL_POSITION_INT, SET_MESSAGE_INTERVAL
from gcs.mavlink.kernels import Whole
from gcs.model.state import Mask

_ANSWER_S: Final = 0.5
_TRIES: Final = 4
_AUTOPILOT_COMPONENT: Final = 1
_ANY_COMPONENT: Final = 0

_CHECK_S: Final = 5.0
_RATE_SHARE: Final = 0.5
"""Positions may come at a rate that is off by this share before it is requested again."""

_RECHECKS: Final = 5


class Streams:
    """State of the requests to each of n vehicles. Rows as on the link."""

    def __init__(
        self, system_ids: Whole, rates_hz: Mapping[int, float], tell: Callable[[int, Records, Whole], object]
    ) -> None:
        """Nothing is requested yet.

        Args:
            system_ids: (n,) of the vehicles.
            rates_hz: by message id, 0 for not at all.
            tell: sends messages of one kind to rows, from `REQUESTING_COMPONENT`.
        """
        n = len(system_ids)
        self._message = np.array(list(rates_hz), np.int64)
        self._interval_us = np.array([1e6 / rate_hz if rate_hz else -1.0 for rate_hz in rates_hz.values()])
        self._position_hz = rates_hz.get(GLOBAL_POSITION_INT, 0.0)
        self._system_ids = system_ids
        self._tell = tell
        self._step = np.full(n, len(rates_hz), np.int64)  # the next interval to request; at the end: done
        self._tries = np.zeros(n, np.int64)
        self._asked_s = np.full(n, -np.inf)
        self._connected = np.zeros(n, np.bool_)
        self._connection_count = np.zeros(n, np.int64)
        self._rechecks = np.zeros(n, np.int64)
        self._checked_s = np.full(n, -np.inf)  # when positions were counted, -inf: not now
        self._count = np.zeros(n, np.int64)

    @property
    def settled(self) -> Mask:
        """(n,) whether all intervals have been requested from a vehicle."""
        return self._step >= len(self._message)

    def watch(self, connected: Mask, connection_count: Whole, positions: Whole, now_s: float) -> None:
        """Begin with vehicles that have connected, also again; send the requests that are due.

        Args:
            connected: (n,) recently received, and may be sent requests.
            connection_count: (n,) how often each connected, see `FleetTelemetry`.
            positions: (n,) total of positions received.
            now_s: the link's clock.
        """
        new = connection_count != self._connection_count
        self._connected, self._connection_count = connected.copy(), connection_count.copy()
        self._rechecks[new] = 0
        self._begin(new | self._off(positions, now_s))
        self._ask(np.flatnonzero(connected & ~self.settled & (now_s - self._asked_s >= _ANSWER_S)), now_s)

    def take_acks(self, rows: Whole, reported: Records) -> None:
        """Continue with the vehicles that answered: (k,) rows and COMMAND_ACKs, whatever the result."""
        is_ours = np.isin(reported["target_component"], (REQUESTING_COMPONENT, _ANY_COMPONENT))
        answered = np.unique(rows[is_ours & (reported["command"] == SET_MESSAGE_INTERVAL)])
        answered = answered[np.isfinite(self._asked_s[answered])]
        self._step[answered] += 1
        self._tries[answered] = 0
        self._asked_s[answered] = -np.inf

    def _begin(self, which: Mask) -> None:
        self._step[which], self._tries[which] = 0, 0
        self._asked_s[which] = -np.inf
        self._checked_s[which] = -np.inf

    def _ask(self, rows: Whole, now_s: float) -> None:
        """Request the next interval of each row; continue without an answer after some tries."""
        given_up = rows[self._tries[rows] >= _TRIES]
        self._step[given_up] += 1
        self._tries[given_up] = 0
        rows = rows[self._step[rows] < len(self._message)]
        if not len(rows):
            return
        step = self._step[rows]
        messages = records(COMMAND_LONG, len(rows))
        messages["target_system"] = self._system_ids[rows]
        messages["target_component"] = _AUTOPILOT_COMPONENT
        messages["command"] = SET_MESSAGE_INTERVAL
        messages["confirmation"] = self._tries[rows]
        messages["param1"], messages["param2"] = self._message[step], self._interval_us[step]
        self._tell(COMMAND_LONG, messages, rows)
        self._tries[rows] += 1
        self._asked_s[rows] = now_s

    def _off(self, positions: Whole, now_s: float) -> Mask:
        """(n,) vehicles with another rate of positions than requested: forgotten, or an answer mistaken."""
        ready = self._connected & self.settled
        counting = ready & np.isfinite(self._checked_s)
        over = counting & (now_s - self._checked_s >= _CHECK_S)
        span_s = np.where(over, now_s - self._checked_s, 1.0)
        rate_hz = (positions - self._count) / span_s
        wrong = np.abs(rate_hz - self._position_hz) > _RATE_SHARE * self._position_hz
        off: Mask = over & wrong & (self._rechecks < _RECHECKS) & (self._position_hz > 0.0)
        self._rechecks[off] += 1
        anew = over | (ready & ~counting)
        self._checked_s[anew] = now_s
        self._count[anew] = positions[anew]
        self._checked_s[~ready] = -np.inf
        return off
