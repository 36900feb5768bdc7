"""Telemetry of the vehicles of a link, in columns: read for all of them at once, message by message."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import development as dialect

from gcs.links.address_book import SILENT_AFTER_S
from gcs.mavlink import framing
from gcs.mavlink.codec import AUTOPILOT_COMPONENT, Records, decode, frame
from gcs.mavlink.framing import TextChunk
from gcs.mavlink.kernels import COMPONENT, MESSAGE, Bytes, Whole
from gcs.model.state import Array, Landed, Mask, Mode, StatusText, Telemetry, VehicleId

Value = TypeVar("Value")
_ARMED: Final = int(dialect.MAV_MODE_FLAG_SAFETY_ARMED)
_CUSTOM: Final = int(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
_PX4: Final = int(dialect.MAV_AUTOPILOT_PX4)
_HEADING_MAX_CDEG: Final = 36000  # above: unknown
_REBOOTED_MS: Final = 1000
"""A boot clock that goes back by more than this has restarted; by less, datagrams are out of order."""

_UNKNOWN, _OTHER = -1, -2
"""Custom modes that no autopilot sends: none received yet, and one that is not PX4's."""

_LANDED: Final = tuple(Landed)

_TEXT_CHUNKS_MAX: Final = 8
_TEXTS_KEPT: Final = 6

_PACKS: Final = 256
_NO_PERCENT: Final = 127
"""In int8, above every percentage, so that the minimum ignores it."""


class _Reported(Generic[Value]):
    """A column as Python values: converted again only after a change, which is rare."""

    def __init__(self, value_of: Callable[[Any], Value]) -> None:
        self._value_of = value_of
        self._column = b""
        self._values: tuple[Value, ...] = ()

    def of(self, column: NDArray[Any]) -> tuple[Value, ...]:
        """(n,) numbers, always of one type."""
        now = column.tobytes()
        if now != self._column:
            self._column, self._values = now, tuple(map(self._value_of, column.tolist()))
        return self._values


@lru_cache(256)
def mode_of(custom_mode: int) -> Mode:
    return Mode.UNKNOWN if custom_mode == _UNKNOWN else framing.px4_mode(custom_mode)


class BatteryPacks:
    """The newest percentage of every pack, and of each vehicle the least of them.

    PX4 sends one BATTERY_STATUS for each pack, and a SYS_STATUS that reports its emptiest pack. A vehicle
    with a full and an empty pack is in danger, thus the least counts, whichever message arrived last. A
    pack that reports an unknown percentage (-1) is left out until it reports one again. A pack that stops
    reporting keeps its last percentage until the autopilot restarts: a connection that broke in flight has
    not charged it.

    Attributes:
        remaining: (n,) 0 to 1; NaN where no pack reports.
    """

    def __init__(self, count: int) -> None:
        self.remaining: Array = np.full(count, np.nan)
        self._percent = np.full((count, _PACKS + 1), _NO_PERCENT, np.int8)  # last column: SYS_STATUS

    def take(self, rows: Whole, percent: NDArray[np.int8], packs: NDArray[np.uint8] | int = _PACKS) -> None:
        """Read messages: (k,) rows, percentages in order of arrival, and pack ids; none: of SYS_STATUS."""
        self._percent[rows, packs] = np.where(percent >= 0, np.minimum(percent, 100), _NO_PERCENT)
        least = self._percent[rows].min(axis=1)
        self.remaining[rows] = np.where(least == _NO_PERCENT, np.nan, least / 100.0)

    def forget(self, rows: Whole) -> None:
        """The autopilots of (k,) rows have restarted: their packs may have been replaced."""
        self._percent[rows] = _NO_PERCENT
        self.remaining[rows] = np.nan


class StatusTexts:
    """The newest status texts of one vehicle. Texts longer than 50 bytes arrive in chunks.

    Attributes:
        text, text_time_s: the newest text, and its arrival.
        texts: the newest few, the oldest first.
    """

    def __init__(self) -> None:
        self.text = ""
        self.text_time_s = -np.inf
        self.texts: tuple[StatusText, ...] = ()
        self._chunks: list[TextChunk] = []

    def take(self, chunk: TextChunk, time_s: float) -> None:
        """Read one STATUSTEXT; a text with a missing chunk is shown with the chunks received."""
        follows = self._chunks and chunk.text_id == self._chunks[0].text_id and chunk.text_id != 0
        self._chunks = [*self._chunks, chunk][-_TEXT_CHUNKS_MAX:] if follows else [chunk]
        self.text = b"".join(part.text for part in self._chunks).decode(errors="replace").strip()
        self.text_time_s = time_s
        earlier = self.texts[:-1] if follows else self.texts
        self.texts = (*earlier, StatusText(time_s, chunk.severity, self.text))[-_TEXTS_KEPT:]
        if chunk.last:
            self._chunks = []


class FleetTelemetry:
    """Newest values of n vehicles, rows as on the link. Arrays are updated row by row as frames arrive.

    Attributes:
        heartbeat_time_s, position_time_s, life_time_s: (n,) of arrival, -inf before; the last of any message.
        armed, in_failsafe: (n,) from the autopilot's heartbeat only.
        landed: (n,) of `Landed`.
        prearm_ok: (n,) the autopilot's own pre-arm checks pass.
        connection_count: (n,) how often it connected: at first, after a restart, after a silence.
        reboot_count: (n,) how often the boot clock has jumped back.
        custom_mode: (n,) of the newest heartbeat.
        texts: of each vehicle.
        waiting: events of rows whose next heartbeat is awaited.
        position_resets: (n,) how often the estimator's reset counter has changed.
    """

    def __init__(self, ids: Sequence[VehicleId]) -> None:
        n = len(ids)
        self.heartbeat_time_s, self.position_time_s = np.full(n, -np.inf), np.full(n, -np.inf)
        self.life_time_s, self.in_failsafe = np.full(n, -np.inf), np.zeros(n, np.bool_)
        self.armed, self.prearm_ok = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
        self.connection_count = np.zeros(n, np.int64)
        self.reboot_count, self.position_resets = np.zeros(n, np.int64), np.zeros(n, np.int64)
        self.landed = np.zeros(n, np.int64)
        self._ids = tuple(ids)
        self.custom_mode = np.full(n, _UNKNOWN, np.int64)  # custom_mode
        self._boot_ms = np.full(n, -1, np.int64)
        self._reset_counter = np.full(n, -1, np.int64)
        self._accuracy_m = np.full((n, 2), np.nan)  # horizontal, vertical
        self._fix_type, self._clock_base_s = np.full(n, np.nan), np.full(n, np.nan)
        self._unhealthy_sensors = np.full(n, -1, np.int64)
        self._place = np.full((n, 3), np.nan)  # degrees, degrees, m AMSL
        self._velocity_m_s = np.full((n, 3), np.nan)
        self._yaw_deg = np.full(n, np.nan)
        self._batteries = BatteryPacks(n)
        self.texts = tuple(StatusTexts() for _ in ids)
        self._texts_reported: tuple[tuple[StatusText, ...], ...] = ((),) * n
        self.waiting: dict[int, asyncio.Event] = {}
        self._armed_reported, self._ready_reported = _Reported(bool), _Reported(bool)
        self._failsafe_reported = _Reported(bool)
        self._reboot_count_reported, self._resets_reported = _Reported(int), _Reported(int)
        self._modes_reported, self._landed_reported = _Reported(mode_of), _Reported(_LANDED.__getitem__)
        self._readers: MappingProxyType[int, Callable[[Whole, Records, Array], None]] = MappingProxyType(
            {
                framing.GLOBAL_POSITION_INT: self._take_positions,
                framing.ATTITUDE: self._take_clocks,
                framing.LOCAL_POSITION_NED: self._take_clocks,
                framing.HEARTBEAT: self._take_heartbeats,
                framing.SYS_STATUS: self._take_status,
                framing.EXTENDED_SYS_STATE: self._take_landed,
                framing.BATTERY_STATUS: lambda rows, reported, _time_s: self._batteries.take(
                    rows, reported["battery_remaining"], reported["id"]
                ),
                framing.GPS_RAW_INT: self._take_accuracies,
                framing.SYSTEM_TIME: self._take_times,
                framing.ODOMETRY: self._take_reset_counters,
            }
        )

    def take(self, data: Bytes, frames: Whole, rows: Whole, time_s: Array) -> None:
        """Read checked frames of our vehicles.

        Args:
            data: buffer that contains them.
            frames: (k, FRAME_COLUMNS) in order of arrival.
            rows: (k,) vehicle of each.
            time_s: (k,) of arrival.
        """
        autopilots = frames[:, COMPONENT] == AUTOPILOT_COMPONENT
        self.life_time_s[rows[autopilots]] = time_s[autopilots]  # in order of arrival: the newest stays
        message = np.where(autopilots, frames[:, MESSAGE], -1)
        present = set(message.tolist())
        for message_id in self._readers:
            if message_id in present:
                mine = np.flatnonzero(message == message_id)
                self._readers[message_id](rows[mine], decode(message_id, data, frames[mine]), time_s[mine])
        if framing.STATUSTEXT in present:
            for at in np.flatnonzero(message == framing.STATUSTEXT).tolist():
                text = framing.status_text(frame(data, frames[at].tolist()))
                self.texts[rows[at]].take(text, float(time_s[at]))
            self._texts_reported = tuple(each.texts for each in self.texts)

    def telemetry(self, *, may_be_ready: Mask | bool = True, discovered: Mask | None = None) -> Telemetry:
        """A copy of all values.

        Args:
            may_be_ready: (n,) vehicles that count as ready if they report it.
            discovered: (n,) vehicles with a position in the result; None: all.
        """
        undiscovered = np.zeros(len(self._ids), np.bool_) if discovered is None else ~discovered
        complete = np.isfinite(self.heartbeat_time_s) & np.isfinite(self._place[:, 0])
        ready = self.prearm_ok & complete & may_be_ready
        return Telemetry(
            ids=self._ids,
            position_time_s=np.where(undiscovered, -np.inf, self.position_time_s),
            heartbeat_time_s=self.heartbeat_time_s.copy(),
            life_time_s=self.life_time_s.copy(),
            latitude_deg=np.where(undiscovered, np.nan, self._place[:, 0]),
            longitude_deg=np.where(undiscovered, np.nan, self._place[:, 1]),
            altitude_amsl_m=np.where(undiscovered, np.nan, self._place[:, 2]),
            velocity_ned_m_s=np.where(undiscovered[:, None], np.nan, self._velocity_m_s),
            yaw_deg=np.where(undiscovered, np.nan, self._yaw_deg),
            battery_remaining=self._batteries.remaining.copy(),
            armed=self._armed_reported.of(self.armed),
            mode=self._modes_reported.of(self.custom_mode),
            in_failsafe=self._failsafe_reported.of(self.in_failsafe),
            landed=self._landed_reported.of(self.landed),
            ready=self._ready_reported.of(ready),
            horizontal_accuracy_m=self._accuracy_m[:, 0].copy(),
            vertical_accuracy_m=self._accuracy_m[:, 1].copy(),
            reboot_count=self._reboot_count_reported.of(self.reboot_count),
            position_resets=self._resets_reported.of(self.position_resets),
            fix_type=self._fix_type.copy(),
            unhealthy_sensors=self._unhealthy_sensors.copy(),
            clock_base_s=self._clock_base_s.copy(),
            texts=self._texts_reported,
        )

    def _take_clocks(self, rows: Whole, reported: Records, _time_s: Array) -> None:
        """From messages not requested, but sent by an autopilot that has just restarted."""
        boot_ms = reported["time_boot_ms"].astype(np.int64)
        again = np.unique(rows[boot_ms < self._boot_ms[rows] - _REBOOTED_MS])
        self.reboot_count[again] += 1
        self.connection_count[again] += 1
        self._reset_counter[again] = -1  # of the time before the restart
        self.prearm_ok[again] = False
        if len(again):
            self._batteries.forget(again)
        restarted = np.isin(rows, again)
        self._boot_ms[rows[restarted]] = boot_ms[restarted]
        np.maximum.at(self._boot_ms, rows[~restarted], boot_ms[~restarted])  # late datagrams change nothing

    def _take_positions(self, rows: Whole, reported: Records, time_s: Array) -> None:
        self._take_clocks(rows, reported, time_s)
        self.position_time_s[rows] = time_s
        self._place[rows, 0] = reported["lat"] * 1e-7
        self._place[rows, 1] = reported["lon"] * 1e-7
        self._place[rows, 2] = reported["alt"] * 1e-3
        for axis, name in enumerate(("vx", "vy", "vz")):
            self._velocity_m_s[rows, axis] = reported[name] * 0.01
        known = reported["hdg"] <= _HEADING_MAX_CDEG
        self._yaw_deg[rows] = np.where(known, reported["hdg"] * 0.01, np.nan)

    def _take_heartbeats(self, rows: Whole, reported: Records, time_s: Array) -> None:
        autopilots = reported["autopilot"] == _PX4
        rows, reported, time_s = rows[autopilots], reported[autopilots], time_s[autopilots]
        base: NDArray[np.int64] = reported["base_mode"].astype(np.int64)
        returned = np.unique(rows[~(time_s - self.heartbeat_time_s[rows] <= SILENT_AFTER_S)])
        self.connection_count[returned] += 1
        self.heartbeat_time_s[rows] = time_s
        self.armed[rows] = (base & _ARMED) != 0
        self.in_failsafe[rows] = self.armed[rows] & np.isin(
            reported["system_status"], framing.FAILSAFE_STATES
        )
        self.custom_mode[rows] = np.where(base & _CUSTOM, reported["custom_mode"].astype(np.int64), _OTHER)
        if self.waiting:
            for row in rows.tolist():
                event = self.waiting.pop(row, None)
                if event is not None:
                    event.set()

    def _take_status(self, rows: Whole, reported: Records, _time_s: Array) -> None:
        health = reported["onboard_control_sensors_health"].astype(np.int64)
        enabled = reported["onboard_control_sensors_enabled"].astype(np.int64)
        self.prearm_ok[rows] = (health & framing.PREARM_CHECK) != 0
        self._unhealthy_sensors[rows] = (enabled & framing.SENSORS | framing.AHRS) & ~health
        self._batteries.take(rows, reported["battery_remaining"])

    def _take_accuracies(self, rows: Whole, reported: Records, _time_s: Array) -> None:
        self._fix_type[rows] = reported["fix_type"]
        fixed = reported["fix_type"] >= framing.FIX_3D
        fields = (("eph", "h_acc"), ("epv", "v_acc"))
        for column, ((dilution, accuracy_field), metres) in enumerate(
            zip(fields, framing.METRES_PER_DILUTION, strict=True)
        ):
            known = reported[dilution] != framing.UNKNOWN_DILUTION
            by_dilution_m = np.where(known, reported[dilution] / 100 * metres, np.nan)
            accuracy_m = np.where(
                reported[accuracy_field] != 0, reported[accuracy_field] / 1000, by_dilution_m
            )
            self._accuracy_m[rows, column] = np.where(fixed, accuracy_m, np.inf)

    def _take_times(self, rows: Whole, reported: Records, time_s: Array) -> None:
        unix_s = reported["time_unix_usec"] * 1e-6
        self._clock_base_s[rows] = np.where(unix_s >= framing.UNIX_KNOWN_S, unix_s, np.nan) - time_s

    def _take_reset_counters(self, rows: Whole, reported: Records, _time_s: Array) -> None:
        for row, counted in zip(rows.tolist(), reported["reset_counter"].tolist(), strict=True):
            self.position_resets[row] += 0 <= self._reset_counter[row] != counted
            self._reset_counter[row] = counted

    def _take_landed(self, rows: Whole, reported: Records, _time_s: Array) -> None:
        landed = reported["landed_state"]
        self.landed[rows] = np.where(landed < len(_LANDED), landed, Landed.UNKNOWN)


@dataclass(frozen=True, slots=True)
class VehicleReport:
    """One vehicle's view of `FleetTelemetry`: its state from its own frames, always the newest."""

    fleet: FleetTelemetry
    row: int

    @property
    def heartbeat_time_s(self) -> float:
        """Arrival of its newest heartbeat, -inf before the first."""
        return float(self.fleet.heartbeat_time_s[self.row])

    @property
    def armed(self) -> bool:
        return bool(self.fleet.armed[self.row])

    @property
    def mode(self) -> Mode:
        return mode_of(int(self.fleet.custom_mode[self.row]))

    @property
    def landed(self) -> Landed:
        return _LANDED[int(self.fleet.landed[self.row])]

    @property
    def text(self) -> tuple[str, float]:
        """Its newest status text, and that text's arrival."""
        texts = self.fleet.texts[self.row]
        return texts.text, texts.text_time_s

    def next_heartbeat(self) -> asyncio.Event:
        """Event that fires at its next heartbeat; afterwards it is another one."""
        return self.fleet.waiting.setdefault(self.row, asyncio.Event())
