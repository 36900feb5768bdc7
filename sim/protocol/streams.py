"""What is sent when: the streams of each vehicle, and pending answers.

The rates are those recorded on PX4 v1.16's offboard link.
"""

import heapq
import math
from collections import deque
from collections.abc import Iterable, Mapping
from itertools import count
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from pymavlink.dialects.v20 import common

from gcs.sim.protocol.frames import Message
from gcs.sim.vehicle.state import Rows

RECORDED_HZ = MappingProxyType(
    {
        common.MAVLINK_MSG_ID_ATTITUDE: 98.9,
        common.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 49.4,
        common.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 49.4,
        common.MAVLINK_MSG_ID_HIGHRES_IMU: 49.4,
        common.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 29.7,
        common.MAVLINK_MSG_ID_ODOMETRY: 29.7,
        common.MAVLINK_MSG_ID_ALTITUDE: 9.89,
        common.MAVLINK_MSG_ID_ATTITUDE_TARGET: 9.84,
        common.MAVLINK_MSG_ID_DISTANCE_SENSOR: 9.89,
        common.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 9.84,
        common.MAVLINK_MSG_ID_TIMESYNC: 9.89,
        common.MAVLINK_MSG_ID_VFR_HUD: 9.89,
        common.MAVLINK_MSG_ID_GPS_RAW_INT: 7.91,
        common.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 4.94,
        common.MAVLINK_MSG_ID_SYS_STATUS: 4.94,
        common.MAVLINK_MSG_ID_HEARTBEAT: 0.99,
        common.MAVLINK_MSG_ID_MISSION_CURRENT: 0.98,
        common.MAVLINK_MSG_ID_PING: 0.99,
        common.MAVLINK_MSG_ID_SYSTEM_TIME: 0.99,
        common.MAVLINK_MSG_ID_BATTERY_STATUS: 0.49,
        common.MAVLINK_MSG_ID_HOME_POSITION: 0.49,
    }
)
FASTEST_S = 0.004  # PX4's MAVLink loop does not run faster
TIME_SLACK_S = 1e-6


def lean_hz(telemetry_hz: float) -> Mapping[int, float]:
    """Rates that a ground station of a large fleet requests: positions at telemetry_hz, the rest slowly."""
    return {
        common.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: telemetry_hz,
        common.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
        common.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
        common.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
        common.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0,
        common.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
        common.MAVLINK_MSG_ID_SYSTEM_TIME: 0.5,
        common.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    }


class Schedule:
    """The due times of a fleet's messages."""

    def __init__(
        self,
        count: int,
        rates_hz: Mapping[int, float],
        ids: Iterable[int] = tuple(RECORDED_HZ),
        *,
        together: bool = False,
    ) -> None:
        """Nothing is due before start.

        Args:
            count: of vehicles.
            rates_hz: of what each vehicle sends without a request.
            ids: of the messages that can be sent as streams.
            together: all vehicles have the phases of the one that starts first.
        """
        self.default_s = {message_id: 1.0 / rate_hz for message_id, rate_hz in rates_hz.items()}
        self._ids = tuple(ids)
        self._places = {message_id: place for place, message_id in enumerate(self._ids)}
        self._interval_s = np.full((len(self._ids), count), np.inf)
        self._due_s = np.full((len(self._ids), count), np.inf)
        self._next_s = math.inf  # none is due earlier
        self._together = together
        self._phases: dict[int, float] = {}

    def start(self, row: int, now_s: float, random: np.random.Generator) -> None:
        """Start a vehicle's streams as after booting, each at a random phase."""
        self._interval_s[:, row] = self._due_s[:, row] = np.inf
        for message_id, place in self._places.items():
            phase = random.random()
            if self._together:
                phase = self._phases.setdefault(message_id, phase)
            interval_s = self.default_s.get(message_id)
            if interval_s is not None:
                self._interval_s[place, row] = interval_s
                self._due_s[place, row] = now_s + interval_s * phase
        self._next_s = -math.inf

    def interval_s(self, row: int, message_id: int) -> float | None:
        interval_s = float(self._interval_s[self._places[message_id], row])
        return None if interval_s == np.inf else interval_s

    def set_interval(self, row: int, message_id: int, interval_s: float | None, now_s: float) -> None:
        place = self._places[message_id]
        self._interval_s[place, row] = np.inf if interval_s is None else max(interval_s, FASTEST_S)
        self._due_s[place, row] = np.inf if interval_s is None else now_s
        self._next_s = -math.inf

    def due(self, now_s: float) -> list[tuple[int, Rows]]:
        """Messages to send now, with their rows; missed ones are dropped, not sent later."""
        if self._next_s > now_s + TIME_SLACK_S:
            return []
        places, rows = np.nonzero(self._due_s <= now_s + TIME_SLACK_S)
        interval_s = self._interval_s[places, rows]
        next_s = self._due_s[places, rows] + interval_s
        self._due_s[places, rows] = np.where(next_s > now_s - interval_s, next_s, now_s + interval_s)
        self._next_s = float(self._due_s.min(initial=math.inf))
        starts = [0, *((places[1:] != places[:-1]).nonzero()[0] + 1).tolist()]
        ends = [*starts[1:], len(places)]
        return [
            (self._ids[places[start]], rows[start:end])
            for start, end in zip(starts, ends, strict=True)
            if start < end
        ]


Item: TypeAlias = Message | int
"""A message, or the id of a report that is composed when it is sent."""

BURST = 5  # parameters per call: in PX4 the list and the streams share the link


class Outbox:
    """A fleet's answers in the order in which they fall due."""

    def __init__(self) -> None:
        self._timed: list[tuple[float, int, int, Item]] = []
        self._order = count()  # keeps equal times in order; messages do not compare
        self.burst = BURST
        self.listed: dict[int, deque[str]] = {}  # parameters by row, sent `burst` at a time

    def post(self, row: int, item: Item, due_s: float) -> None:
        heapq.heappush(self._timed, (due_s, next(self._order), row, item))

    def forget(self, row: int) -> None:
        self._timed = [entry for entry in self._timed if entry[2] != row]
        heapq.heapify(self._timed)
        self.listed.pop(row, None)

    def take(self, now_s: float) -> list[tuple[int, Item]]:
        items = []
        while self._timed and self._timed[0][0] <= now_s:
            _, _, row, item = heapq.heappop(self._timed)
            items.append((row, item))
        return items

    def take_parameters(self) -> list[tuple[int, str]]:
        taken = [
            (row, names.popleft())
            for row, names in self.listed.items()
            for _ in range(min(self.burst, len(names)))
        ]
        if taken:
            self.listed = {row: names for row, names in self.listed.items() if names}
        return taken
