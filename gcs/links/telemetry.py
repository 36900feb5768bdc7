"""Telemetry of one vehicle from its frames: arrival times, and mode and arming from HEARTBEAT."""

import asyncio
from collections import Counter
from math import inf, nan
from typing import Final

from gcs.links.address_book import SILENT_AFTER_S
from gcs.links.battery_packs import BatteryPacks
from gcs.mavlink.framing import (
    ATTITUDE,
    BATTERY_STATUS,
    EXTENDED_SYS_STATE,
    GLOBAL_POSITION_INT,
    GPS_RAW_INT,
    HEARTBEAT,
    LOCAL_POSITION_NED,
    ODOMETRY,
    STATUSTEXT,
    SYS_STATUS,
    SYSTEM_TIME,
    Accuracy,
    Frame,
    Motion,
    TextChunk,
    battery_percent,
    boot_time_ms,
    fix_type,
    gps_accuracy,
    heartbeat,
    landed,
    motion,
    prearm_ok,
    reset_counter,
    status_text,
    total_percent,
    unhealthy_sensors,
    unix_time_s,
)
from gcs.model.state import Landed, Mode, StatusText

_AUTOPILOT_COMPONENT = 1
_TEXT_CHUNKS_MAX = 8
_TEXTS_KEPT: Final = 6
_ROW: Final = (0,)  # of the one vehicle in `BatteryPacks`
_CLOCKS: Final = frozenset({ATTITUDE, LOCAL_POSITION_NED})
"""Not requested, but sent by an autopilot that has just restarted, seconds before its first position."""

_REORDERED_MS: Final = 1000
"""A boot clock that goes back by less comes from a late datagram."""


class VehicleTelemetry:
    """Newest values of one vehicle, and their arrival. Written and read on the loop's thread.

    Attributes:
        time_s: arrival of any frame; `heartbeat_time_s` and `position_time_s` of their own, -inf before.
        motion: of the newest position.
        life_time_s: arrival of any frame of the autopilot: every one is a sign of life.
        armed, mode, in_failsafe: from the autopilot's heartbeat only.
        prearm_ok: the autopilot's own pre-arm checks pass, from SYS_STATUS.
        unhealthy_sensors: sensors enabled and unhealthy, from SYS_STATUS; -1 before.
        accuracy, fix_type: of the newest GPS_RAW_INT.
        clock_base_s: its own clock (Unix time) less ours, as its SYSTEM_TIME arrived; NaN where not known.
        landed: from the newest EXTENDED_SYS_STATE.
        reboot_count: how often the boot clock has jumped back: a reboot, or a simulator that was paused.
        position_resets: how often the estimator's reset counter (ODOMETRY) has changed.
        text, text_time_s: the newest status text, and its arrival.
        texts: the newest few, the oldest first.
        connection_count: how often it connected: at first, after a restart, after a silence. It may have
            forgotten its streams.
        counts: number of messages of each kind from the autopilot.
        news: fires at the next heartbeat, and is then replaced.
    """

    def __init__(self) -> None:
        self.time_s = -inf
        self.life_time_s = -inf
        self.heartbeat_time_s = -inf
        self.position_time_s = -inf
        self.motion = Motion(nan, nan, nan, nan, nan, nan, nan)
        self.armed = False
        self.mode = Mode.UNKNOWN
        self.in_failsafe = False
        self.prearm_ok = False
        self.unhealthy_sensors = -1
        self.accuracy = Accuracy(nan, nan)
        self.fix_type = nan
        self.clock_base_s = nan
        self.landed = Landed.UNKNOWN
        self._batteries = BatteryPacks(1)
        self.reboot_count = 0
        self.position_resets = 0
        self.text = ""
        self.text_time_s = -inf
        self.texts: tuple[StatusText, ...] = ()
        self.connection_count = 0
        self.counts: Counter[int] = Counter()
        self.news = asyncio.Event()
        self._boot_time_ms = 0
        self._chunks: list[TextChunk] = []
        self._reset_counter: int | None = None

    @property
    def battery_remaining(self) -> float:
        """Least of its packs, 0 to 1; NaN where none reports. See `BatteryPacks`."""
        return float(self._batteries.remaining[0])

    def take(self, frame: Frame, time_s: float) -> None:
        """Read one checked frame of this vehicle. Frames of its other components count as arrivals only."""
        self.time_s = time_s
        if frame.component_id != _AUTOPILOT_COMPONENT:
            return
        self.life_time_s = time_s
        message_id = frame.message_id
        self.counts[message_id] += 1
        if message_id == GLOBAL_POSITION_INT:
            self.position_time_s, self.motion = time_s, motion(frame)
            self._take_boot_clock(boot_time_ms(frame))
        elif message_id == HEARTBEAT:
            self._take_heartbeat(frame, time_s)
        elif message_id in _CLOCKS:
            self._take_boot_clock(boot_time_ms(frame))
        else:
            self._take_rarely(frame, time_s)

    def _take_rarely(self, frame: Frame, time_s: float) -> None:
        """Read messages that come once or twice a second, or on an event."""
        message_id = frame.message_id
        if message_id == SYS_STATUS:
            self.prearm_ok, self.unhealthy_sensors = prearm_ok(frame), unhealthy_sensors(frame)
            self._batteries.take_totals(_ROW, [total_percent(frame)])
        elif message_id == EXTENDED_SYS_STATE:
            self.landed = landed(frame)
        elif message_id == BATTERY_STATUS:
            battery_id, percent = battery_percent(frame)
            self._batteries.take_packs(_ROW, [battery_id], [percent])
        elif message_id == GPS_RAW_INT:
            self.accuracy, self.fix_type = gps_accuracy(frame), float(fix_type(frame))
        elif message_id == SYSTEM_TIME:
            self.clock_base_s = unix_time_s(frame) - time_s
        elif message_id == ODOMETRY:
            counted, self._reset_counter = self._reset_counter, reset_counter(frame)
            self.position_resets += counted is not None and counted != self._reset_counter
        elif message_id == STATUSTEXT:
            self._take_text(status_text(frame), time_s)

    def _take_boot_clock(self, now_ms: int) -> None:
        """Not used as an anchor for times: it drifts against the wall clock, and restarts unannounced."""
        if now_ms < self._boot_time_ms - _REORDERED_MS:
            self.reboot_count += 1
            self.connection_count += 1
            self._reset_counter = None  # of the time before the restart
            self.prearm_ok = False
            self._batteries.forget(_ROW)
            self._boot_time_ms = now_ms
        self._boot_time_ms = max(self._boot_time_ms, now_ms)

    def _take_heartbeat(self, frame: Frame, time_s: float) -> None:
        reported = heartbeat(frame)
        if not reported.autopilot:
            return
        self.connection_count += not time_s - self.heartbeat_time_s <= SILENT_AFTER_S
        self.heartbeat_time_s = time_s
        self.armed, self.mode, self.in_failsafe = reported.armed, reported.mode, reported.in_failsafe
        fired, self.news = self.news, asyncio.Event()
        fired.set()

    def _take_text(self, chunk: TextChunk, time_s: float) -> None:
        """Assemble long texts; one with a missing chunk is shown with the chunks received."""
        follows = self._chunks and chunk.text_id == self._chunks[0].text_id and chunk.text_id != 0
        self._chunks = [*self._chunks, chunk][-_TEXT_CHUNKS_MAX:] if follows else [chunk]
        self.text = b"".join(part.text for part in self._chunks).decode(errors="replace").strip()
        self.text_time_s = time_s
        earlier = self.texts[:-1] if follows else self.texts
        self.texts = (*earlier, StatusText(time_s, chunk.severity, self.text))[-_TEXTS_KEPT:]
        if chunk.last:
            self._chunks = []
