"""Which streams are requested from the vehicles, and whether the vehicles send them. No I/O.

A vehicle gets requests when its first frame arrives, after a silence, and when its boot clock jumped back;
then again for streams with a wrong rate: an autopilot forgets them when it restarts, and does not report
that.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from gcs.links.address_book import SILENT_AFTER_S
from gcs.links.settings import StreamSettings
from gcs.links.telemetry import VehicleTelemetry
from gcs.mavlink.framing import (
    BATTERY_STATUS,
    EXTENDED_SYS_STATE,
    GLOBAL_POSITION_INT,
    GPS_RAW_INT,
    ODOMETRY,
    SYS_STATUS,
    SYSTEM_TIME,
)

_NOT_NEEDED: Final = frozenset({30, 31, 32, 36, 74, 83, 85, 87, 105, 111, 132, 141, 230, 241})
"""Frequent, and read by no part of the service: attitudes, local position, servos, HUD, targets, IMU, clocks,
range, altitude, the estimator, vibration.
"""

NOT_FOR_MAVSDK: Final = _NOT_NEEDED | {ODOMETRY}
"""Messages that MAVSDK does not receive. Of ODOMETRY the link itself reads the reset counter."""

REQUESTING_COMPONENT: Final = 191
"""Our component that requests streams. Not MAVSDK's: it would receive answers to requests it did not send."""

SETTLE_S: Final = 0.5  # MAVSDK sets a rate itself when it discovers a vehicle; ours come after
_WINDOW_S: Final = 4.0
_PAUSE_MAX_S: Final = 60.0
_FRAMES_MIN: Final = 4  # in a window; rarer streams are not checked


def desired(streams: StreamSettings) -> dict[int, float]:
    """Rate in Hz of every message that is requested; 0 ends the stream."""
    return {
        GLOBAL_POSITION_INT: streams.position_hz,
        EXTENDED_SYS_STATE: streams.state_hz,
        SYS_STATUS: min(streams.state_hz, 2.0),
        GPS_RAW_INT: min(streams.state_hz, 2.0),
        ODOMETRY: 1.0,
        BATTERY_STATUS: 0.5,
        SYSTEM_TIME: 1.0,
        **dict.fromkeys(sorted(_NOT_NEEDED), streams.others_hz),
    }


class _Request:
    """State of the requests to one vehicle."""

    def __init__(self) -> None:
        self.connection_count = 0
        self.all_due = False
        self.look_s = 0.0
        self.pause_s = _WINDOW_S
        self.began_s = 0.0
        self.counts: dict[int, int] = {}


class Rates:
    """Decides when to request which streams from which vehicle."""

    def __init__(self, desired: Mapping[int, float], system_ids: Iterable[int]) -> None:
        """`desired`: Hz of each message."""
        self._desired = dict(desired)
        self._asked = {system_id: _Request() for system_id in system_ids}

    def due(self, system_id: int, telemetry: VehicleTelemetry, now_s: float) -> Iterator[tuple[int, float]]:
        """The messages, with their rates, to request from this vehicle now: mostly none."""
        asked = self._asked[system_id]
        if now_s - telemetry.heartbeat_time_s > SILENT_AFTER_S:
            return
        if asked.connection_count != telemetry.connection_count:
            asked.connection_count, asked.pause_s = telemetry.connection_count, _WINDOW_S
            asked.all_due, asked.look_s = True, now_s + SETTLE_S
        elif now_s < asked.look_s:
            return
        elif asked.all_due:
            asked.all_due = False
            yield from self._desired.items()
            self._watch(asked, telemetry, now_s)
        else:
            wrong = [each for each in self._desired.items() if self._is_wrong(asked, telemetry, each, now_s)]
            asked.pause_s = min(2 * asked.pause_s, _PAUSE_MAX_S) if wrong else _WINDOW_S
            yield from wrong
            self._watch(asked, telemetry, now_s)

    def _watch(self, asked: _Request, telemetry: VehicleTelemetry, now_s: float) -> None:
        asked.look_s, asked.began_s = now_s + asked.pause_s, now_s
        asked.counts = {message_id: telemetry.counts[message_id] for message_id in self._desired}

    def _is_wrong(
        self, asked: _Request, telemetry: VehicleTelemetry, desired: tuple[int, float], now_s: float
    ) -> bool:
        message_id, rate_hz = desired
        window_s = now_s - asked.began_s
        came = telemetry.counts[message_id] - asked.counts[message_id]
        if rate_hz == 0:
            return came > _FRAMES_MIN
        expected = rate_hz * window_s
        return expected >= _FRAMES_MIN and not expected / 2 <= came <= expected * 2
