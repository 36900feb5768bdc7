"""A recorded flight as a service: its states appear as if live, and only the playback can be commanded."""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from math import inf, isfinite
from pathlib import Path
from typing import Any, Final, NoReturn, Unpack

import numpy as np
from pydantic import TypeAdapter

from gcs import service
from gcs.model.errors import GcsError, InvalidError, RefusedError, UnknownError
from gcs.model.frames import ShowFrame
from gcs.model.plan import Plan
from gcs.model.state import Landed
from gcs.model.vehicle_columns import RECORDED, unknown
from gcs.recording import mcap_layout as layout
from gcs.recording.flight_report import EXIT_CODES
from gcs.recording.mcap_reader import About, FlightData, ReadSample, RecordedSample, Standard
from gcs.recording.replay.history import EventHistory, replay_alarm
from gcs.service import FleetView, Latest, Playback, PlaybackChange, ReportState
from gcs.service.alarms import ordered
from gcs.service.check_process import LOWER, answered
from gcs.service.event_log import LogEvent
from gcs.service.snapshots import ReportBody
from gcs.service.vehicle_table import VehicleTable

SPEED_MAX: Final = 100.0

REPEAT_S: Final = 0.5
"""Interval at which the state is published again, as a sign of life for viewers."""

LATE_S: Final = 0.1
"""States that are later than this are skipped: the playback is too fast to show every one."""

DUE_S: Final = 1e-3
"""The shortest wait: clocks are no finer."""

PASSED: Final = 100
"""After this many skipped states other tasks of the loop may run."""

REPORT: Final = TypeAdapter(ReportBody)

REPORT_WITHIN_S: Final = 1800.0

REPORT_MEMORY_MAX_BYTES: Final = 16 << 30
"""Limit of the address space: a long flight of a thousand vehicles is held in memory."""


class Playhead:
    """The position of a replay in its record; it moves at its speed unless paused. Times are the loop's."""

    def __init__(self, duration_s: float, speed: float, now_s: float) -> None:
        """Starts at the beginning, moving. Raises: InvalidError for an invalid speed."""
        _check_speed(speed)
        self.duration_s = duration_s
        self.speed = speed
        self.paused = False
        self.skips_idle = True
        self._at_s = 0.0  # position at `_since_s`
        self._since_s = now_s  # loop time

    def position_s(self, now_s: float) -> float:
        """Position since the first recorded state, in s."""
        moved_s = 0.0 if self.paused else (now_s - self._since_s) * self.speed
        return min(self._at_s + moved_s, self.duration_s)

    def left_s(self, position_s: float, now_s: float) -> float:
        """Time until that position at this speed; negative: it has passed, inf: never."""
        way_s = position_s - self.position_s(now_s)
        if way_s <= 0.0:
            return way_s / self.speed
        return inf if self.paused else way_s / self.speed

    def change(self, now_s: float, **given: Unpack[PlaybackChange]) -> None:
        """Change the playback from now on. Raises: InvalidError, RefusedError; then nothing has changed."""
        speed, position_s = given.get("speed", self.speed), given.get("position_s")
        _check_speed(speed)
        if position_s is not None and not (isfinite(position_s) and 0.0 <= position_s <= self.duration_s):
            raise InvalidError("position_s", position_s, f"from 0 to {self.duration_s:.2f}, its duration")
        here_s = self.position_s(now_s)
        if given.get("paused") is False and position_s is None and here_s >= self.duration_s:
            raise RefusedError("the record has ended: give position_s to play it again from there")
        self._at_s = here_s if position_s is None else position_s
        self._since_s = now_s
        self.speed, self.paused = speed, given.get("paused", self.paused)
        self.skips_idle = given.get("skips_idle", self.skips_idle)


def _check_speed(speed: float) -> None:
    if not 0.0 < speed <= SPEED_MAX:  # written so that NaN is refused
        raise InvalidError("speed", speed, f"above 0, at most {SPEED_MAX:g}")


class ReadOnly:
    """Refuses every call: stands for each role of `gcs.service.Service` that commands or changes."""

    def __init__(self, why: str) -> None:
        self._why = why

    def __getattr__(self, _name: str) -> Callable[..., NoReturn]:
        return self._refuse

    def _refuse(self, *_arguments: object, **_named: object) -> NoReturn:
        raise RefusedError(self._why)


class NoShows(ReadOnly):
    """A replay has no show files and accepts none. Implements `gcs.service.Shows`."""

    @property
    def rules(self) -> str:
        return "{}"

    @property
    def why_not_kept(self) -> str:
        return self._why

    async def list_shows(self) -> list[service.StoredShow]:
        return []

    def checked(self, name: str) -> NoReturn:
        raise UnknownError(f"{name} was never checked here: {self._why}")


class RecordedPlan(ReadOnly):
    """The plan that is shown now. Implements `gcs.service.PlanChanges`."""

    def __init__(self, why: str, view: Latest[FleetView]) -> None:
        super().__init__(why)
        self._view = view

    @property
    def current(self) -> Plan:
        return self._view.value.plan


class NoCommands:
    """Commands are in the audit beside the flight data. Implements `gcs.service.CommandRecords`."""

    def get(self, command_id: str) -> NoReturn:
        raise UnknownError(
            f"there is no command {command_id}: this is a replay; past commands are in the audit"
        )

    def newest(self) -> Sequence[service.CommandRecord]:
        return ()


class ReportTask:
    """Runs the report once. Used on the event loop."""

    def __init__(self, files: Sequence[Path]) -> None:
        """Flight data, and files of true positions if there are any."""
        self._files = tuple(files)
        self._found = ReportState(service.CheckState.RUNNING)
        self._task: asyncio.Task[None] | None = None

    def state(self) -> ReportState:
        if self._task is None:
            self._task = asyncio.create_task(self._judge(), name="report")
        return self._found

    async def _judge(self) -> None:
        try:
            arguments = ("report", *map(str, self._files), "--json")
            report = await answered(
                arguments,
                REPORT_WITHIN_S,
                LOWER,
                codes=tuple(EXIT_CODES.values()),
                memory_max_bytes=REPORT_MEMORY_MAX_BYTES,
            )
            self._found = ReportState(service.CheckState.DONE, report=REPORT.validate_python(report))
        except TimeoutError:
            self._found = ReportState(service.CheckState.FAILED, f"not done within {REPORT_WITHIN_S:g} s")
        except (GcsError, OSError, ValueError) as error:
            self._found = ReportState(service.CheckState.FAILED, str(error))

    async def close(self) -> None:
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)


class Replay:
    """Implements `gcs.service.Service` and `gcs.service.Replaying` for a recorded flight.

    Must be created on the running event loop.
    """

    def __init__(self, data: FlightData, speed: float, truths: Sequence[Path] = ()) -> None:
        """`truths` are files of true positions, for the flight report.

        Raises: GcsError when the record has no tick, or its configuration no show frame; InvalidError.
        """
        self._data = data
        try:
            self.frame = ShowFrame(**data.about.config["show_frame"])
        except (KeyError, TypeError, GcsError) as error:
            raise GcsError(f"{data.path}: its configuration has no show frame: {error}") from None
        self._standard = Standard.of(data.about.config, str(data.path))
        first, last_s = next(data.samples(), None), data.last_s()
        if first is None or last_s is None:
            raise GcsError(f"{data.path}: there is no flight in it. {data.cut}".strip())
        self._began_s = first.unix_s
        self._stations = _stations(data.about)
        self._event_history = EventHistory.of(data.path, data.about.session)
        self._report_task = ReportTask((data.path, *truths))
        self.make_flight_report = self._report_task.state
        self._head = Playhead(last_s - first.unix_s, speed, self._now_s())
        self.marks = self._event_history.marks(self._began_s, self._head.duration_s)
        self._sought = False  # another position is requested
        self._changed = asyncio.Event()
        self._ended = False
        self._moment, self._shown_s = first, self._now_s()
        self.events = self.replaying = self  # its own events, and its own controls
        self.view = Latest(self._state(first, self._shown_s, ended=False))
        refusal = f"this is a replay of {data.path}: nothing can be commanded or changed"
        self.audit: service.Audit = service.NoAudit()
        self.plan: Any = RecordedPlan(refusal, self.view)
        self.shows: Any = NoShows(f"this is a replay of {data.path}: it keeps no shows")
        self.command_log = NoCommands()
        self.commands: Any = ReadOnly(refusal)
        self.recovery = self.player = self.preflight = self.alarms = self.go = self.site = self.commands
        self.stations: service.Stations | None = None

    async def run(self) -> None:
        """Show every state in its time, then the last one, until cancelled."""
        try:
            while True:
                await self._play()
                self._ended = not self._sought
                while not self._sought:
                    self._show(self._moment)
                    await self._wait(REPEAT_S)
        finally:
            await self._report_task.close()

    async def _play(self) -> None:
        """Play from the playhead to the end of the record, or until another position is requested."""
        self._sought = self._ended = False
        first, passed = True, 0
        for sample in self._data.samples(self._began_s + self._head.position_s(self._now_s())):
            if not first and self._left_s(sample) < -LATE_S:
                self._moment, passed = sample, passed + 1
                if passed % PASSED == 0:
                    await asyncio.sleep(0)
            else:
                while not (first or self._sought) and (left_s := self._left_s(sample)) > DUE_S:
                    await self._wait(min(left_s, REPEAT_S))
                    if self._now_s() - self._shown_s >= REPEAT_S:
                        self._show(self._moment)
                if not self._sought:
                    self._show(sample)
            first = False
            self._skip(sample)
            if self._sought:
                return

    def _skip(self, sample: ReadSample) -> None:
        """Skip time in which no vehicle flies; not while paused."""
        if not self._head.skips_idle or self._head.paused or self._sought:
            return
        at_s = sample.unix_s - self._began_s
        for span in self.marks.idle:
            if span.from_s <= at_s < span.until_s:
                self._head.change(self._now_s(), position_s=span.until_s)
                self._sought = True

    def _left_s(self, sample: ReadSample) -> float:
        return self._head.left_s(sample.unix_s - self._began_s, self._now_s())

    async def _wait(self, most_s: float) -> None:
        """Wait until the playback is changed, at most `most_s`."""
        self._changed.clear()
        with suppress(TimeoutError):
            async with asyncio.timeout(most_s):
                await self._changed.wait()

    def _show(self, sample: ReadSample) -> None:
        self._moment, self._shown_s = sample, self._now_s()
        self.view.promise(partial(self._state, sample, self._shown_s, ended=self._ended))

    def _now_s(self) -> float:
        return asyncio.get_running_loop().time()

    @property
    def playback(self) -> Playback:
        position_s = self._moment.unix_s - self._began_s
        if self._sought:
            position_s = self._head.position_s(self._now_s())
        return self._playback(position_s, ended=self._ended and not self._sought)

    def _playback(self, position_s: float, *, ended: bool) -> Playback:
        head = self._head
        record = str(self._data.path), self._began_s, head.duration_s
        return Playback(*record, position_s, head.speed, head.paused, ended, head.skips_idle)

    def change(self, **given: Unpack[PlaybackChange]) -> Playback:
        self._head.change(self._now_s(), **given)
        self._sought = self._sought or "position_s" in given
        self._changed.set()
        if not self._sought:
            self._show(self._moment)
        return self.playback

    def newest(self) -> Sequence[LogEvent]:
        return self._event_history.until(self._moment.unix_s)

    def _state(self, sample: ReadSample, now_s: float, *, ended: bool) -> FleetView:
        flown = self._data.decoded(sample)
        tick, status = flown.tick, flown.status
        start_unix_s, replay = status.start_unix_time_s, (self._data.path, self._began_s)
        return FleetView(
            time_s=now_s,
            unix_time_s=flown.unix_s,
            show=status.show,
            reason=status.reason,
            rows=self._rows(flown),
            plan=status.plan.moved(now_s - tick.time_s),
            flight_envelope=service.FlightEnvelope.of(self._standard.under(status.limits).safety),
            playback=self._playback(flown.unix_s - self._began_s, ended=ended),
            center_m=tick.center_m,
            center_velocity_m_s=tick.center_velocity_m_s,
            radius_m=tick.radius_m,
            target_m=tick.target_m,
            minimum_separation_m=tick.minimum_separation_m,
            tick=tick.timing,
            control_alive=tick.control_alive,
            setpoints_sent=tick.setpoints_sent,
            interventions=0,
            alarms=ordered([*status.alarms, replay_alarm(*replay, ended=ended, cut=self._data.cut)]),
            selected=status.selected,
            features=flown.features,
            start_unix_time_s=start_unix_s,
            countdown_s=None if start_unix_s is None else max(0.0, start_unix_s - flown.unix_s),
        )

    def _rows(self, flown: RecordedSample) -> VehicleTable:
        about, table, n = self._data.about, flown.vehicles, len(flown.vehicles)
        position_m = layout.vectors(table, layout.POSITION).astype(np.float64)
        latitude_deg, longitude_deg, altitude_m = self.frame.geodetic(position_m)
        colour, lit = layout.colours(table)
        limited_by = flown.tick.limited_by
        numbers = {
            **unknown(n),
            **{name: table[recorded].astype(np.float64) for name, recorded in RECORDED.items()},
            "latitude_deg": latitude_deg,
            "longitude_deg": longitude_deg,
            "altitude_amsl_m": altitude_m,
        }
        return VehicleTable(
            ids=about.ids,
            system_ids=about.system_ids,
            links=about.links,
            autopilots=about.autopilots,
            phases=[about.phases[number] for number in table["phase"].tolist()],
            reasons=flown.status.reasons,
            modes=[about.modes[number] for number in table["mode"].tolist()],
            armed=table["armed"].astype(np.bool_).tolist(),
            landed=[Landed(number) for number in table["landed"].tolist()],
            ready=table["ready"].astype(np.bool_).tolist(),
            position_m=position_m,
            velocity_m_s=layout.vectors(table, layout.VELOCITY).astype(np.float64),
            setpoint_m_s=layout.vectors(table, layout.SETPOINT).astype(np.float64),
            **numbers,
            limited_by=[limited_by.get(name, "") for name in about.ids],
            colour=colour,
            lit=lit,
            homes_m=[self._event_history.home_m(name, flown.unix_s) for name in about.ids],
            stations=self._stations,
        )


def _stations(about: About) -> tuple[str, ...]:
    """The station that flew each vehicle, by the recorded configuration of the site; empty: there was one."""
    station_of = {
        link: str(station["name"])
        for station in about.config.get("stations") or ()
        for link in station["links"]
    }
    return tuple(station_of.get(link, "") for link in about.links) if station_of else ()
