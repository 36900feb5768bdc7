"""Requests for message rates, to every vehicle when it connects, after a reboot, and where a rate is wrong.

One interval after the other, since the acknowledgement does not name the message; for all vehicles at once.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass
from typing import Final

import numpy as np

from gcs.links.settings import StreamSettings
from gcs.mavlink import framing
from gcs.mavlink.codec import AUTOPILOT_COMPONENT, SYSTEM_ID, Records, addressed, answers
from gcs.mavlink.framing import COMMAND_ACK, PARAM_VALUE
from gcs.mavlink.kernels import COMPONENT, MESSAGE, Whole
from gcs.model.jit import kernel
from gcs.model.state import Mask

_NOT_NEEDED: Final = frozenset({31, 32, 36, 74, 83, 85, 87, 105, 111, 132, 141, 230, 241})
"""Frequent, and read by no part of the service: quaternions, local position, servos, HUD, targets, IMU,
clocks, range, altitude, the estimator, vibration.
"""

NOT_FOR_MAVSDK: Final = _NOT_NEEDED | {framing.ODOMETRY, framing.ATTITUDE}
"""Messages that MAVSDK does not receive. Attitudes, and ODOMETRY's counter of resets, the link reads."""

REQUESTING_COMPONENT: Final = 191
"""Our component that requests streams. Not MAVSDK's: it would receive answers to requests it did not send."""

SETTLE_S: Final = 0.5  # MAVSDK sets a rate itself when it discovers a vehicle; ours come after

_ANSWER_S: Final = 0.5
_TRIES: Final = 4
_WINDOW_S: Final = 4.0
"""Time in which received messages are counted, before the rates are checked."""

_PAUSE_MAX_S: Final = 60.0
_MESSAGES_MIN: Final = 4  # in a window; rarer streams are not checked


def desired_rates(streams: StreamSettings) -> dict[int, float]:
    """Rate in Hz of every message that is requested; 0 ends the stream."""
    return {
        framing.GLOBAL_POSITION_INT: streams.position_hz,
        framing.ATTITUDE: max(streams.attitude_hz, streams.others_hz),
        framing.EXTENDED_SYS_STATE: streams.state_hz,
        framing.SYS_STATUS: min(streams.state_hz, 2.0),
        framing.GPS_RAW_INT: min(streams.state_hz, 2.0),
        framing.ODOMETRY: 1.0,
        framing.BATTERY_STATUS: 0.5,
        framing.SYSTEM_TIME: 1.0,
        **dict.fromkeys(sorted(_NOT_NEEDED), streams.others_hz),
    }


_NO_COLUMN: Final = -1


@kernel
def count_messages(rows: Whole, frames: Whole, column_of: Whole, counts: Whole) -> tuple[Whole, Whole]:
    """Count the autopilots' messages by row and column in `counts` (n, c).

    Args:
        rows: (k,) vehicle of each.
        frames: (k, FRAME_COLUMNS).
        column_of: column by message id, _NO_COLUMN: not counted.
        counts: written.

    Returns: (a,) places of their COMMAND_ACKs, and (v,) of their PARAM_VALUEs.
    """
    acks, values = np.empty(len(rows), np.int64), np.empty(len(rows), np.int64)
    ack_count, value_count = 0, 0
    for k in range(len(rows)):
        message = frames[k, MESSAGE]
        if frames[k, COMPONENT] != AUTOPILOT_COMPONENT:
            continue
        if message < len(column_of) and column_of[message] != _NO_COLUMN:
            counts[rows[k], column_of[message]] += 1
        if message == COMMAND_ACK:
            acks[ack_count] = k
            ack_count += 1
        elif message == PARAM_VALUE:
            values[value_count] = k
            value_count += 1
    return acks[:ack_count], values[:value_count]


@dataclass(eq=False)
class StreamRequests:
    """State of the requests to each of n vehicles. Rows as on the link, columns: messages of `rates_hz`."""

    system_ids: Whole  # (n,) of the vehicles
    rates_hz: InitVar[Sequence[Mapping[int, float]]]  # (n,) by message id, 0 for not at all
    # sends messages of one kind to rows, from `REQUESTING_COMPONENT`
    send: Callable[[int, Records, Whole], object]
    station_id: int = SYSTEM_ID  # our own system id

    def __post_init__(self, rates_hz: Sequence[Mapping[int, float]]) -> None:
        messages = list(dict.fromkeys(message for each in rates_hz for message in each))
        n, kinds = len(self.system_ids), len(messages)
        self._message = np.array(messages, np.int64)
        self._column_of = np.full(self._message.max(initial=0) + 1, _NO_COLUMN)
        self._column_of[self._message] = np.arange(kinds)
        rates = [[each.get(message, np.nan) for message in messages] for each in rates_hz]
        self._rate_hz = np.array(rates).reshape(n, kinds)  # NaN: not requested of this vehicle
        self._interval_us = np.where(self._rate_hz > 0, 1e6 / np.maximum(self._rate_hz, 1e-9), -1.0)
        self._due: Mask = np.zeros((n, kinds), np.bool_)  # intervals still to be requested
        self._tries = np.zeros(n, np.int64)
        self._requested_s = np.full(n, -np.inf)
        self._connection_count = np.zeros(n, np.int64)
        self._counts = np.zeros((n, kinds), np.int64)  # messages received
        self._counts_before = np.zeros((n, kinds), np.int64)  # as the window began
        self._window_s = np.full(n, np.nan)  # when the window began, NaN: none has
        self._pause_s = np.full(n, _WINDOW_S)
        self._connections = b"", b""  # as of the last `watch`
        self._look_s = -np.inf  # nothing is to be done before, while these are the same

    @property
    def settled(self) -> Mask:
        """(n,) whether all intervals have been requested from a vehicle."""
        settled: Mask = np.logical_not(self._due.any(axis=1))
        return settled

    def count(self, rows: Whole, frames: Whole) -> tuple[Whole, Whole]:
        """See `count_messages`."""
        return count_messages(rows, frames, self._column_of, self._counts)

    def watch(self, connected: Mask, connection_count: Whole, now_s: float) -> None:
        """Begin with vehicles that have connected, also again; send the requests that are due.

        Args:
            connected: (n,) recently received, and may be sent requests.
            connection_count: (n,) how often each connected, see `FleetTelemetry`.
            now_s: the link's clock.
        """
        connections = connection_count.tobytes(), connected.tobytes()
        if connections == self._connections and now_s < self._look_s:
            return
        self._connections = connections
        new = connection_count != self._connection_count
        if new.any():
            self._connection_count = connection_count.copy()
            self._due[new], self._pause_s[new] = np.isfinite(self._rate_hz[new]), _WINDOW_S
            self._tries[new], self._requested_s[new] = 0, -np.inf
        self._check_rates(connected, now_s)
        if self._due.any():
            due = connected & ~self.settled & (now_s - self._requested_s >= _ANSWER_S)
            self._request(np.flatnonzero(due), now_s)
        over_s = np.nanmin(self._window_s + self._pause_s, initial=np.inf)
        self._look_s = -np.inf if self._due.any() else float(over_s)

    def take_acks(self, rows: Whole, reported: Records) -> None:
        """Continue with the vehicles that answered: (k,) rows and COMMAND_ACKs, whatever the result."""
        is_ours = answers(reported, self.station_id, REQUESTING_COMPONENT)
        answered = np.unique(rows[is_ours & (reported["command"] == framing.SET_MESSAGE_INTERVAL)])
        self._go_on(answered[np.isfinite(self._requested_s[answered])])

    def _go_on(self, rows: Whole) -> None:
        if len(rows):
            self._due[rows, self._due[rows].argmax(axis=1)] = False
            self._tries[rows] = 0
            self._requested_s[rows] = -np.inf

    def _request(self, rows: Whole, now_s: float) -> None:
        """Request the next interval of each row; continue without an answer after some tries."""
        self._go_on(rows[self._tries[rows] >= _TRIES])
        rows = rows[self._due[rows].any(axis=1)]
        if not len(rows):
            return
        column = self._due[rows].argmax(axis=1)
        messages = addressed(
            framing.COMMAND_LONG,
            self.system_ids[rows],
            command=framing.SET_MESSAGE_INTERVAL,
            confirmation=self._tries[rows],
            param1=self._message[column],
            param2=self._interval_us[rows, column],
        )
        self.send(framing.COMMAND_LONG, messages, rows)
        self._tries[rows] += 1
        self._requested_s[rows] = now_s

    def _check_rates(self, connected: Mask, now_s: float) -> None:
        """Request streams again that come at a wrong rate: forgotten, or an answer mistaken."""
        ready = connected & self.settled
        over = ready & (now_s - self._window_s >= self._pause_s)
        rows = np.flatnonzero(over)
        if len(rows):
            expected = self._rate_hz[rows] * (now_s - self._window_s[rows, None])
            received = self._counts[rows] - self._counts_before[rows]
            checked = expected >= _MESSAGES_MIN
            off = checked & ((received < expected / 2) | (received > expected * 2))
            off |= (self._rate_hz[rows] == 0) & (received > _MESSAGES_MIN)
            self._due[rows] = off
            longer_s = np.minimum(2 * self._pause_s[rows], _PAUSE_MAX_S)
            self._pause_s[rows] = np.where(off.any(axis=1), longer_s, _WINDOW_S)
        begin = (ready & np.isnan(self._window_s)) | over
        self._window_s[begin], self._counts_before[begin] = now_s, self._counts[begin]
        self._window_s[~ready] = np.nan
