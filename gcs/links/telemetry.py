"""Telemetry of the vehicles of a link, in columns: read for all of them at once, message by message."""

import asyncio
import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs.links.autopilots import DEFAULT, Autopilot, title_of
from gcs.links.link_intake import newest_of_each
from gcs.links.status_texts import StatusTexts
from gcs.mavlink import framing
from gcs.mavlink.batteries import Packs
from gcs.mavlink.codec import frame
from gcs.mavlink.kernels import Bytes, Whole
from gcs.mavlink.reports import OTHER_MODE, TERMINATED_MODE, UNKNOWN_MODE, Columns, read_reports
from gcs.mavlink.sample_times import Clocks
from gcs.model.state import Array, Landed, Mask, Mode, StatusText, Telemetry, VehicleId

log = logging.getLogger(__name__)

Value = TypeVar("Value")
_LANDED: Final = tuple(Landed)


class _Reported(Generic[Value]):
    """A column as Python values: converted again only after a change, which is rare.

    Attributes:
        values: of the column noted last.
    """

    def __init__(self, values_of: Callable[[list[Any]], Iterable[Value]]) -> None:
        self.values: tuple[Value, ...] = ()
        self._values_of = values_of
        self._column = b""

    def note(self, column: NDArray[Any]) -> None:
        """Take (n,) numbers, always of one type."""
        now = column.tobytes()
        if now != self._column:
            self._column, self.values = now, tuple(self._values_of(column.tolist()))


_NOT_AN_AUTOPILOTS: Final = {
    UNKNOWN_MODE: Mode.UNKNOWN,
    OTHER_MODE: Mode.OTHER,
    TERMINATED_MODE: Mode.TERMINATED,
}


def mode_of(autopilot: Autopilot, custom_mode: int) -> Mode:
    return _NOT_AN_AUTOPILOTS.get(custom_mode) or autopilot.mode(custom_mode)


class FleetTelemetry:
    """Newest values of n vehicles, rows as on the link. Arrays are updated row by row as frames arrive.

    A sample older than the newest of its kind changes nothing: see `gcs.mavlink.sample_times`.

    PX4 sends one BATTERY_STATUS for each pack, and a SYS_STATUS that reports its emptiest pack. A vehicle
    with a full and an empty pack is in danger, thus the least counts, whichever message arrived last. Packs
    that feed payload or avionics alone do not count: none of them brings a vehicle down. A pack that reports
    an unknown percentage (-1) is left out until it reports one again. A pack that stops reporting keeps its
    last percentage while the vehicle is armed: a connection that broke in flight has not charged it. On the
    ground it may have been taken out, and is forgotten after FORGOTTEN_AFTER_S.

    Attributes:
        heartbeat_time_s, position_time_s, life_time_s: (n,) of arrival, -inf before; the last of any message.
        armed, in_failsafe: (n,) from the autopilot's heartbeat only.
        landed: (n,) of `Landed`.
        prearm_ok: (n,) the autopilot's own pre-arm checks pass.
        connection_count: (n,) how often it connected: at first, after a restart, after a silence.
        reboot_count: (n,) how often the boot clock has begun anew.
        custom_mode: (n,) of the newest heartbeat.
        autopilots: (n,) profiles as configured.
        texts: of each vehicle.
        waiting: events of rows whose next heartbeat is awaited.
        position_resets: (n,) how often the estimator's reset counter has changed.
        version_time_s: (n,) arrival of its newest version, -inf before.
        asked_ns: (n, REQUESTS) TIMESYNC.ts1 of our requests without an answer, set by the sender.
        clock_late_s: (n,) how late each newest position is by its clock alone.
    """

    def __init__(self, ids: Sequence[VehicleId], autopilots: Sequence[Autopilot] | None = None) -> None:
        """`autopilots` (n,) as configured; None: the default of all."""
        n = len(ids)
        self._ids = tuple(ids)
        self.autopilots = (DEFAULT,) * n if autopilots is None else tuple(autopilots)
        self._configured = np.array([each.number for each in self.autopilots], np.int64)
        self._kinds = tuple(
            (kind, self._configured == kind.number)
            for kind in {each.name: each for each in self.autopilots}.values()
        )
        self._columns = columns = Columns.unknown(n)
        self._clocks, self._packs = Clocks.unknown(n), Packs.unknown(n)
        self.heartbeat_time_s, self.position_time_s = columns.heartbeat_time_s, columns.position_time_s
        self.life_time_s, self.in_failsafe = columns.life_time_s, columns.in_failsafe
        self.armed, self.prearm_ok = columns.armed, columns.prearm_ok
        self.connection_count, self.reboot_count = columns.connection_count, columns.reboot_count
        self.landed, self.custom_mode = columns.landed, columns.custom_mode
        self.position_resets, self.version_time_s = columns.position_resets, columns.version_time_s
        self.asked_ns, self.clock_late_s = self._clocks.asked_ns, self._clocks.clock_late_s
        self.texts = tuple(StatusTexts() for _ in ids)
        self._texts_reported: tuple[tuple[StatusText, ...], ...] = ((),) * n
        self.waiting: dict[int, asyncio.Event] = {}
        self._armed_reported, self._ready_reported = _Reported[bool](list), _Reported[bool](list)
        self._failsafe_reported, self._version_reported = _Reported[bool](list), _Reported[int](list)
        self._reboot_count_reported, self._resets_reported = _Reported[int](list), _Reported[int](list)
        self._modes_reported = _Reported(self._modes_of)
        self._landed_reported = _Reported(lambda states: map(_LANDED.__getitem__, states))
        self._changes = -1  # of the columns, when the next two and the columns of Python values were made
        self._foreign: Mask = np.zeros(n, np.bool_)
        self._ready: Mask = np.zeros(n, np.bool_)
        self._passes: Mask = np.zeros(n, np.bool_)  # its own checks before arming

    def _modes_of(self, custom_modes: list[int]) -> Iterable[Mode]:
        return map(mode_of, self.autopilots, custom_modes)

    @property
    def is_foreign(self) -> Mask:
        """(n,) vehicles with another autopilot than configured: what they report cannot be understood."""
        self._look()
        return self._foreign

    def foreign(self, row: int) -> str:
        """Why this vehicle is one of `is_foreign`, in words; empty: it is not."""
        if not self.is_foreign[row]:
            return ""
        meant, reported = self.autopilots[row], title_of(int(self._columns.autopilot[row]))
        return f"it reports {reported}, and is configured as {meant.title} (autopilot: {meant.name})"

    def _look(self) -> None:
        """Make what follows from columns that seldom change, if they did."""
        now = self._columns
        changes = int(now.changes[0])
        if changes == self._changes:
            return
        self._changes = changes
        reported = now.autopilot
        self._foreign = (reported >= 0) & (reported != self._configured)
        ready = self.prearm_ok & ~self._foreign
        for kind, rows in self._kinds:
            ready[rows] &= kind.ready(self.custom_mode[rows], now.estimator_flags[rows])
        if (over := np.flatnonzero(ready & ~self._passes).tolist()) and any(self._texts_reported):
            for row in over:
                self.texts[row].forget(self.autopilots[row].complains[0])
            self._texts_reported = tuple(each.texts for each in self.texts)
        self._passes = ready
        self._ready = ready & np.isfinite(self.heartbeat_time_s) & np.isfinite(now.place[:, 0])
        self._armed_reported.note(self.armed)
        self._modes_reported.note(np.where(self._foreign, OTHER_MODE, self.custom_mode))
        self._failsafe_reported.note(self.in_failsafe)
        self._landed_reported.note(self.landed)
        self._reboot_count_reported.note(self.reboot_count)
        self._resets_reported.note(self.position_resets)
        self._version_reported.note(np.where(self._foreign, 0, now.version))

    def take(self, data: Bytes, frames: Whole, rows: Whole, time_s: Array) -> None:
        """Read checked frames of our vehicles.

        Args:
            data: buffer that contains them.
            frames: (k, FRAME_COLUMNS) in order of arrival.
            rows: (k,) vehicle of each.
            time_s: (k,) of arrival.
        """
        beats, texts = read_reports(data, frames, rows, time_s, self._columns, self._clocks, self._packs)
        if (forgotten := self._packs.forgotten).max(initial=-1) >= 0:
            self._report_forgotten(forgotten)
        if self.waiting:
            for row in rows[beats].tolist():
                event = self.waiting.pop(row, None)
                if event is not None:
                    event.set()
        if len(texts):
            for at in texts[newest_of_each(rows[texts])].tolist():
                text = framing.status_text(frame(data, frames[at].tolist()))
                self.texts[rows[at]].take(text, float(time_s[at]))
            self._texts_reported = tuple(each.texts for each in self.texts)

    @property
    def late_samples(self) -> int:
        """How many were dropped since the link was created: older than the newest of their kind."""
        return int(self._clocks.late.sum())

    def _report_forgotten(self, pack: Whole) -> None:
        """Log the (n,) packs that count no more, though they were the emptiest; -1: none."""
        for row in np.flatnonzero(pack >= 0).tolist():
            log.warning("battery_forgotten", extra={"vehicle": self._ids[row], "pack": int(pack[row])})
        pack[:] = -1

    def telemetry(self, *, may_be_ready: Mask | bool = True, discovered: Mask | None = None) -> Telemetry:
        """A copy of all values.

        Args:
            may_be_ready: (n,) vehicles that count as ready if they report it.
            discovered: (n,) vehicles with a position in the result; None: all.
        """
        self._look()
        self._ready_reported.note(self._ready & may_be_ready)
        now = self._columns
        undiscovered = None if discovered is None else ~discovered
        return Telemetry(
            ids=self._ids,
            position_time_s=_without(undiscovered, self.position_time_s, -np.inf),
            heartbeat_time_s=self.heartbeat_time_s.copy(),
            life_time_s=self.life_time_s.copy(),
            latitude_deg=_without(undiscovered, now.place[:, 0]),
            longitude_deg=_without(undiscovered, now.place[:, 1]),
            altitude_amsl_m=_without(undiscovered, now.place[:, 2]),
            velocity_ned_m_s=_without(undiscovered, now.velocity_ned_m_s),
            yaw_deg=_without(undiscovered, now.yaw_deg),
            attitude_rad=now.attitude_rad.copy(),
            attitude_time_s=now.attitude_time_s.copy(),
            battery_remaining=self._packs.remaining.copy(),
            armed=self._armed_reported.values,
            mode=self._modes_reported.values,
            in_failsafe=self._failsafe_reported.values,
            landed=self._landed_reported.values,
            ready=self._ready_reported.values,
            horizontal_accuracy_m=now.accuracy_m[:, 0].copy(),
            vertical_accuracy_m=now.accuracy_m[:, 1].copy(),
            gnss_altitude_amsl_m=now.gnss_altitude_m.copy(),
            reboot_count=self._reboot_count_reported.values,
            position_resets=self._resets_reported.values,
            fix_type=now.fix_type.copy(),
            unhealthy_sensors=now.unhealthy_sensors.copy(),
            clock_base_s=now.clock_base_s.copy(),
            round_trip_s=self._clocks.round_trip_s.copy(),
            position_clock_s=self._clocks.position_clock_s(),
            position_late_s=self._clocks.late_s.copy(),
            texts=self._texts_reported,
            version=self._version_reported.values,
        )


def _without(rows: Mask | None, values: Array, instead: float = np.nan) -> Array:
    """A copy of the values (n, ...), with another in these rows; None: in none."""
    values = values.copy()
    if rows is not None:
        values[rows] = instead
    return values


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
    def autopilot(self) -> Autopilot:
        return self.fleet.autopilots[self.row]

    @property
    def mode(self) -> Mode:
        custom_mode = OTHER_MODE if self.fleet.is_foreign[self.row] else self.fleet.custom_mode[self.row]
        return mode_of(self.autopilot, int(custom_mode))

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
