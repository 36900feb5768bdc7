"""When each message is due. The rates are those recorded on PX4 v1.16's offboard link."""

from __future__ import annotations

import heapq
from types import MappingProxyType
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import common

if TYPE_CHECKING:
    import numpy as np

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


class Streams:
    """The due times of one vehicle's messages."""

    def __init__(self, now_s: float, random: np.random.Generator) -> None:
        """Start every recorded stream, each at a phase of its own."""
        self._interval_s = {message_id: 1.0 / rate_hz for message_id, rate_hz in RECORDED_HZ.items()}
        self._due = [
            (now_s + interval_s * random.random(), key) for key, interval_s in self._interval_s.items()
        ]
        heapq.heapify(self._due)

    def interval_s(self, message_id: int) -> float | None:
        """The interval of a stream, or None while it is not sent."""
        return self._interval_s.get(message_id)

    def set_interval(self, message_id: int, interval_s: float | None, now_s: float) -> None:
        """Send at that interval from now on; None stops the stream."""
        self._due = [entry for entry in self._due if entry[1] != message_id]
        self._interval_s.pop(message_id, None)
        if interval_s is not None:
            self._interval_s[message_id] = max(interval_s, FASTEST_S)
            self._due.append((now_s, message_id))
        heapq.heapify(self._due)

    def due(self, now_s: float) -> list[int]:
        """The messages to send now; what was missed is dropped, not made up."""
        ids = []
        while self._due and self._due[0][0] <= now_s + TIME_SLACK_S:
            due_s, message_id = self._due[0]
            interval_s = self._interval_s[message_id]
            next_s = due_s + interval_s
            heapq.heapreplace(
                self._due, (next_s if next_s > now_s - interval_s else now_s + interval_s, message_id)
            )
            ids.append(message_id)
        return ids
