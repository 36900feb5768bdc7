"""A `gcs.service.Service` without vehicles: its tables, plan and refusals are real, its motion is not.

As in the real service, a changed plan is in `plan.current` at once, and in the view with the next `tick`.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import sqrt
from pathlib import Path

import numpy as np
from prometheus_client import Histogram

from gcs.model.errors import InvalidError, RefusedError, UnknownError
from gcs.model.frames import ShowFrame
from gcs.model.interrupted_flight import InterruptedFlight, Offer
from gcs.model.lifecycle import AIRBORNE, Event, Phase, ShowEvent, ShowPhase, advance, advance_show
from gcs.model.plan import Formation, Obstacle, Orbit, Plan, Target, Yaw
from gcs.model.preflight_report import Check, Exclusion, PreflightReport, State, VehicleChecks
from gcs.model.state import Array, Landed, Mode
from gcs.recording.replay.playhead import Playhead
from gcs.service import (
    CALLER,
    ActiveFailsafe,
    Audit,
    CheckState,
    CommandRecord,
    FleetView,
    FlightEnvelope,
    Latest,
    NoAudit,
    Outcome,
    Playback,
    Replaying,
    ReplayMarks,
    ReportState,
    SelectedShow,
    ShowAction,
    TickView,
    VehicleAction,
)
from gcs.service.alarm_book import AlarmBook
from gcs.service.alarms import (
    Alarm,
    Condition,
)
from gcs.service.commands import CommandLog
from gcs.service.event_log import LogEvent, Severity
from gcs.service.vehicle_table import VehicleTable
from gcs.shows.library import ShowLibrary

FRAME = ShowFrame(latitude_deg=47.3977, longitude_deg=8.5456, altitude_amsl_m=488.0, heading_deg=90.0)
HEIGHT_MIN_M = 2.0
HISTOGRAMS = tuple(
    Histogram(f"gcs_tick_{what}_seconds", what, buckets=(0.01, 0.1), registry=None)
    for what in ("duration", "lateness")
)
for seconds in (0.005, 0.005, 0.01, 0.05, 0.1, 0.33):
    HISTOGRAMS[0].observe(seconds)
    HISTOGRAMS[1].observe(0.001)


EVENT = {
    VehicleAction.HOLD: Event.HOLD,
    VehicleAction.JOIN: Event.ENGAGE,
    VehicleAction.RETURN: Event.COME_HOME,
    VehicleAction.LAND: Event.DESCEND,
    VehicleAction.TAKE_CONTROL: Event.TAKE_CONTROL,
    VehicleAction.CONFIRM_DOWN: Event.CONFIRMED_DOWN,
}


class FakeRecord:
    """A real `gcs.service.Replaying` of a minute in which nothing happens."""

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._clock_s = clock_s
        self._head = Playhead(60.0, 1.0, clock_s())
        self.report_state = ReportState(CheckState.RUNNING)
        self.marks = ReplayMarks()
        self._skips_idle = True

    @property
    def playback(self) -> Playback:
        head = self._head
        position_s = head.position_s(self._clock_s())
        return Playback(
            "flight.mcap",
            1.7e9,
            head.duration_s,
            position_s,
            head.speed,
            head.paused,
            ended=False,
            skips_idle=self._skips_idle,
        )

    def change(
        self,
        *,
        paused: bool | None = None,
        speed: float | None = None,
        position_s: float | None = None,
        skips_idle: bool | None = None,
    ) -> Playback:
        self._skips_idle = self._skips_idle if skips_idle is None else skips_idle
        self._head.change(self._clock_s(), paused=paused, speed=speed, position_s=position_s)
        return self.playback

    def make_flight_report(self) -> ReportState:
        return self.report_state


class FakePlan:
    """A `gcs.service.PlanChanges`: refuses what the tests need refused."""

    def __init__(self, service: "FakeService") -> None:
        self._service = service
        self.current = Plan(Formation(radius_m=10.0, height_m=20.0))

    def set_formation(self, formation: Formation) -> None:
        count = len(self._service.phases)
        smallest_m = 3.0 * sqrt(count)
        if formation.radius_m < smallest_m:
            allowed = f"at least {smallest_m:.1f} m for {count} vehicles"
            raise InvalidError("radius_m", formation.radius_m, allowed)
        if formation.height_m - formation.radius_m < HEIGHT_MIN_M:
            allowed = f"at least {formation.radius_m + HEIGHT_MIN_M} m with this radius"
            raise InvalidError("height_m", formation.height_m, allowed)
        self.current = replace(self.current, formation=formation)

    def set_orbit(self, orbit: Orbit) -> None:
        self.current = replace(self.current, orbit=orbit)

    def set_target(self, target: Target) -> None:
        self.current = replace(self.current, target=replace(target, time_s=self._service.clock_s()))

    def set_yaw(self, yaw: Yaw) -> None:
        self.current = replace(self.current, yaw=yaw)

    def add_obstacle(self, obstacle: Obstacle) -> None:
        if any(box.id == obstacle.id for box in self.current.obstacles):
            raise RefusedError(
                f"there is an obstacle {obstacle.id!r} already: change it, or choose another id"
            )
        self._place(obstacle)

    def change_obstacle(self, obstacle: Obstacle) -> None:
        self._require(obstacle.id)
        self._place(obstacle)

    def remove_obstacle(self, obstacle_id: str) -> None:
        self._require(obstacle_id)
        left = tuple(box for box in self.current.obstacles if box.id != obstacle_id)
        self.current = replace(self.current, obstacles=left)

    def _require(self, obstacle_id: str) -> None:
        if all(box.id != obstacle_id for box in self.current.obstacles):
            raise UnknownError(f"there is no obstacle {obstacle_id!r}")

    def _place(self, box: Obstacle) -> None:
        for index, (name, phase) in enumerate(self._service.phases.items()):
            inside = abs(box.x_m) <= box.half_length_x_m and abs(box.y_m - 5.0 * index) <= box.half_length_y_m
            if phase in AIRBORNE and inside:
                raise RefusedError(f"obstacle {box.id!r} would stand on {name}, which is in the air")
        others = (known for known in self.current.obstacles if known.id != box.id)
        self.current = replace(self.current, obstacles=(*others, box))


class FakeService:
    """Vehicles d1, d2 ... on the ground, 5 m apart along y. Plays most roles of the port itself."""

    frame = FRAME

    def __init__(
        self, count: int = 3, clock_s: Callable[[], float] = time.monotonic, folder: Path | None = None
    ) -> None:
        self.clock_s = clock_s
        self.commands = self.recovery = self.player = self.preflight = self.alarms = self.events = self
        self.shows = ShowLibrary(folder)
        self.phases: dict[str, Phase] = {}
        self.ticks = 0
        self.control_alive = True
        self.audit: Audit = NoAudit()
        self.record: Replaying | None = None
        self._begin(count)
        self.view = Latest(self._look())

    @property
    def replaying(self) -> Replaying | None:
        return self.record

    def reset(self) -> None:
        """Restore the initial state."""
        self._begin(len(self.phases))
        self.tick()

    def _begin(self, count: int) -> None:
        self.phases = {f"d{index + 1}": Phase.STANDBY for index in range(count)}
        self.show = ShowPhase.IDLE
        self.selected: SelectedShow | None = None
        self.interrupted: InterruptedFlight | None = None
        self.start_unix_s: float | None = None
        self.failsafes: tuple[ActiveFailsafe, ...] = ()
        self.conditions: tuple[Condition, ...] = ()
        self.book = AlarmBook()
        self.plan = FakePlan(self)
        self.command_log = CommandLog()
        self.excluded: dict[str, Exclusion] = {}
        self.happened: tuple[LogEvent, ...] = ()
        self.battery = 0.9

    def tick(self) -> None:
        """Publish a new state."""
        self.ticks += 1
        self.book.look(self.conditions, self.clock_s(), time.time())
        self.view.set(self._look())

    def finish(self, command_id: str, outcome: Outcome = Outcome.DONE, reason: str = "") -> None:
        """Complete a command for every vehicle."""
        for name in self.command_log.get(command_id).outcomes:
            self.command_log.close(command_id, name, outcome, reason)

    def fly(self) -> None:
        """Set every vehicle to the formation and the show to running."""
        self.show = ShowPhase.RUNNING
        self.phases = dict.fromkeys(self.phases, Phase.FORMATION)
        self.tick()

    def command_show(
        self,
        action: ShowAction,
        vehicles: Sequence[str] | None = None,
        *,
        show_hash: str | None = None,
        at_unix_time_s: float | None = None,
    ) -> CommandRecord:
        for name in vehicles or ():
            self._require(name)
        if show_hash != (None if self.selected is None else self.selected.hash):
            raise RefusedError("that is not the hash of the show that is selected")
        if at_unix_time_s is not None and at_unix_time_s <= time.time():
            raise InvalidError("at_unix_time_s", at_unix_time_s, "ahead")
        event = ShowEvent(action.value) if at_unix_time_s is None else ShowEvent.SCHEDULE
        self.show = advance_show(self.show, event)
        self.start_unix_s = at_unix_time_s
        return self._accept(f"show {action}", vehicles or tuple(self.phases))

    def select(self, name: str, show_hash: str) -> SelectedShow:
        timeline = self.shows.cleared(name, show_hash)
        cues = tuple(one.cue.cue for one in timeline.played)
        self.selected = SelectedShow(
            name, show_hash, cues[0], cues, 0.0, timeline.duration_s, runs=False, target_is_live=False
        )
        return self.selected

    def deselect(self) -> None:
        self.selected = None

    def seek(self, cue: str) -> SelectedShow:
        if self.selected is None:
            raise RefusedError("no show is selected")
        if cue not in self.selected.cues:
            raise UnknownError(f"there is no cue {cue}")
        self.selected = replace(self.selected, cue=cue)
        return self.selected

    def report(self, vehicles: Sequence[str] | None = None) -> PreflightReport:
        for name in vehicles or ():
            self._require(name)
        if self.show is not ShowPhase.IDLE:
            raise RefusedError("preflight is for the ground")
        good = self.battery >= 0.25
        words = ("", "") if good else (f"battery at {self.battery:.0%}, at least 25% is needed", "charge it")
        state = State.PASS if good else State.FAIL
        check = Check("battery", state, self.battery, "of 1", "at least 25%", *words)
        out = {name: str(why) for name, why in self.excluded.items()}
        return PreflightReport(
            time.time(),
            None,
            None,
            (Check("vehicles", State.PASS, float("nan"), "vehicles", "all vehicles"),),
            tuple(VehicleChecks(name, name not in out, out.get(name, ""), (check,)) for name in self.phases),
            ("start pattern: there is none",),
        )

    def exclude(self, vehicle_id: str, reason: str) -> CommandRecord:
        self._require(vehicle_id)
        if self.show is not ShowPhase.IDLE:
            raise RefusedError("vehicles can be excluded or included only on the ground")
        self.excluded[vehicle_id] = Exclusion(CALLER.get(), reason, time.time())
        return self._accept("exclude", (vehicle_id,))

    def include(self, vehicle_id: str) -> CommandRecord:
        self._require(vehicle_id)
        if self.excluded.pop(vehicle_id, None) is None:
            raise RefusedError(f"{vehicle_id} was not taken out of the show")
        return self._accept("include", (vehicle_id,))

    def command_vehicle(self, vehicle_id: str, action: VehicleAction) -> CommandRecord:
        self._require(vehicle_id)
        self.phases[vehicle_id] = advance(self.phases[vehicle_id], EVENT[action])
        return self._accept(f"{action} {vehicle_id}", (vehicle_id,))

    def command_vehicles(self, action: VehicleAction, vehicles: Sequence[str] | None = None) -> CommandRecord:
        for name in vehicles or ():
            self._require(name)
        reached, left_out = [], {}
        for name in self.phases if vehicles is None else vehicles:
            try:
                self.phases[name] = advance(self.phases[name], EVENT[action])
            except RefusedError as error:
                left_out[name] = str(error)
            else:
                reached.append(name)
        if not reached:
            raise RefusedError(f"{action} reaches no vehicle")
        return self.command_log.open(f"{action} of several", reached, left_out)

    def kill(self, vehicle_ids: Sequence[str]) -> CommandRecord:
        for name in vehicle_ids:
            self._require(name)
            self.phases[name] = advance(self.phases[name], Event.KILL)
        command = self._accept("kill", vehicle_ids)
        self.finish(command.id)
        return self.command_log.get(command.id)

    def acknowledge(self, alarm_id: str) -> Alarm:
        return self.book.acknowledge(alarm_id, CALLER.get(), time.time())

    def acknowledge_all(self) -> Sequence[Alarm]:
        return self.book.acknowledge_all(CALLER.get(), time.time())

    def settle(self, offer: Offer) -> CommandRecord:
        if self.interrupted is None or offer not in self.interrupted.offers:
            raise RefusedError(f"{offer} is not offered")
        self.interrupted = None
        return self._accept(offer, tuple(self.phases))

    def newest(self) -> Sequence[LogEvent]:
        return self.happened

    def happen(self, text: str, vehicle: str | None = None) -> None:
        number = len(self.happened) + 1
        self.happened = (*self.happened, LogEvent(number, time.time(), Severity.INFO, text, vehicle))

    def _require(self, vehicle_id: str) -> None:
        if vehicle_id not in self.phases:
            raise UnknownError(f"there is no vehicle {vehicle_id!r}")

    def _accept(self, action: str, vehicles: Sequence[str]) -> CommandRecord:
        return self.command_log.open(action, vehicles, {})

    def _look(self) -> FleetView:
        now_s = self.clock_s()
        flying = self.show is ShowPhase.RUNNING
        return FleetView(
            time_s=now_s,
            unix_time_s=time.time(),
            show=self.show,
            reason="",
            rows=self._rows(),
            plan=self.plan.current,
            flight_envelope=FlightEnvelope(3.0, 100.0, 300.0, 2.0, 3.0, 0.3),
            center_m=(1.0, 2.0, -20.0) if flying else None,
            center_velocity_m_s=(0.5, 0.0, 0.0) if flying else None,
            radius_m=9.0 if flying else None,
            target_m=self.plan.current.target.position_m(now_s),
            minimum_separation_m=5.0 if flying else None,
            tick=TickView(
                rate_hz=20.0,
                count=self.ticks,
                missed=0,
                duration_p50_ms=float("nan"),
                duration_p99_ms=float("nan"),
                lateness_p99_ms=float("nan"),
                histograms=HISTOGRAMS,
            ),
            control_alive=self.control_alive,
            setpoints_sent=self.ticks * len(self.phases),
            interventions=7,
            selected=self.selected,
            interrupted=self.interrupted,
            playback=None if self.record is None else self.record.playback,
            start_unix_time_s=self.start_unix_s,
            countdown_s=None if self.start_unix_s is None else max(0.0, self.start_unix_s - time.time()),
            failsafes=self.failsafes,
            alarms=self.book.alarms,
        )

    def _rows(self) -> VehicleTable:
        names, phases = list(self.phases), list(self.phases.values())
        n = len(names)
        up = np.array([phase in AIRBORNE for phase in phases])
        formed = np.array([phase is Phase.FORMATION for phase in phases])
        received = [phase not in (Phase.OFFLINE, Phase.LOST) for phase in phases]
        unheard = ~np.array(received)
        limited_by = [""] * n
        if formed[0]:
            limited_by[0] = "separation from d9"

        def describe(value: float) -> Array:
            column = np.full(n, value)
            column[unheard] = np.nan
            return column

        place_m = np.stack([describe(0.0), 5.0 * np.arange(n), np.where(up, -20.0, 0.0)], axis=1)
        place_m[unheard] = np.nan
        return VehicleTable(
            ids=names,
            system_ids=[index + 1 for index in range(n)],
            links=["fake"] * n,
            phases=phases,
            reasons=[""] * n,
            modes=[Mode.OFFBOARD if phase is Phase.FORMATION else Mode.HOLD for phase in phases],
            armed=up.tolist(),
            landed=[Landed.IN_AIR if each else Landed.ON_GROUND for each in up],
            ready=received,
            position_m=place_m,
            velocity_m_s=np.stack([describe(0.1), describe(0.2), describe(0.3)], axis=1),
            setpoint_m_s=np.where(formed[:, None], [1.0, 0.0, -1.0], np.nan),
            yaw_rad=describe(0.0),
            latitude_deg=describe(47.3977),
            longitude_deg=describe(8.5456),
            altitude_amsl_m=describe(488.0),
            battery_remaining=np.full(n, 0.9),
            position_age_s=np.full(n, 0.05),
            uncertainty_m=np.full(n, 0.35),
            heartbeat_age_s=np.append(np.full(n - 1, np.inf), 0.4),
            link_quality=np.full(n, 0.75),
            fix_type=describe(3.0),
            limited_by=limited_by,
            colour=np.tile(np.array([[255, 128, 0]], np.uint8), (n, 1)),
            lit=formed,
            homes_m=[np.array([0.0, 5.0 * row, 0.0]) if up[row] else None for row in range(n)],
        )
