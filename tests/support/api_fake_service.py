"""A `gcs.service.Service` without vehicles: its tables, plan and refusals are real, its motion is not."""

import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import nan, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from gcs.areas.files.site_files import written
from gcs.areas.site import FlightSite
from gcs.areas.site_fence import fence_within
from gcs.flight.commands.site_editor import SiteEditor
from gcs.flight.state.feature import Instant
from gcs.formation.laws.registry import place_of
from gcs.model.errors import InvalidError, RefusedError, SiteError, UnknownError
from gcs.model.frames import ShowFrame
from gcs.model.interrupted_flight import InterruptedFlight, Offer
from gcs.model.lifecycle import AIRBORNE, Event, Phase, ShowEvent, ShowPhase, advance, advance_show
from gcs.model.plan import Formation, Obstacle, Orbit, Plan, Target, Yaw
from gcs.model.preflight_report import Check, Exclusion, PreflightReport, State, VehicleChecks
from gcs.model.state import Landed, Mode
from gcs.model.target_fix import TargetFix
from gcs.model.vehicle_columns import unknown
from gcs.preflight.causes import causes_of
from gcs.preflight.checklists import parse_checklists
from gcs.safety.walls import Fence
from gcs.service import (
    CALLER,
    Audit,
    BeginState,
    BeginView,
    CommandRecord,
    FleetView,
    FlightEnvelope,
    FlightMarks,
    Latest,
    NoAudit,
    Outcome,
    Replaying,
    SelectedShow,
    ShowAction,
    Stations,
    StationView,
    TickView,
    VehicleAction,
)
from gcs.service.alarm_book import AlarmBook
from gcs.service.alarms import Alarm, Condition
from gcs.service.commands import CommandLog
from gcs.service.event_log import LogEvent, Severity
from gcs.service.features import Features, LightsView
from gcs.service.go import GoView, ProposedStart, WeatherEntry
from gcs.service.histograms import TickHistogram
from gcs.service.vehicle_table import VehicleTable
from gcs.shows.library import ShowLibrary

FRAME = ShowFrame(latitude_deg=47.3977, longitude_deg=8.5456, altitude_amsl_m=488.0, heading_deg=90.0)
HEIGHT_MIN_M = 2.0
INSTANT = Instant(0.0, ShowPhase.IDLE, None)
HISTOGRAMS = tuple(
    TickHistogram(f"gcs_tick_{what}_seconds", what, (0.01, 0.1)) for what in ("duration", "lateness")
)
for seconds in (0.005, 0.005, 0.01, 0.05, 0.1, 0.33):
    HISTOGRAMS[0].observe(seconds)
    HISTOGRAMS[1].observe(0.001)

GO_HASH = "3f2a9c01b4de"

EVENT: dict[VehicleAction, Event] = dict(
    zip(
        (action for action in VehicleAction if action is not VehicleAction.FIND),
        (Event.HOLD, Event.ENGAGE, Event.COME_HOME, Event.DESCEND, Event.TAKE_CONTROL, Event.CONFIRMED_DOWN),
        strict=True,
    )
)
REPORTED = {"yaw_rad": 0.0, "latitude_deg": 47.3977, "longitude_deg": 8.5456, "altitude_amsl_m": 488.0}
MEASURED = {"battery_remaining": 0.9, "position_age_s": 0.05, "uncertainty_m": 0.35, "link_quality": 0.75}


def misfit(site: FlightSite, _path: Path) -> Sequence[str]:
    """Why a site does not lie here."""
    try:
        fence_within(site, FRAME, Fence())
    except SiteError as error:
        return error.problems
    return ()


class FakePlan:
    """A `gcs.service.PlanChanges` for these vehicles."""

    def __init__(self, phases: dict[str, Phase]) -> None:
        self._phases = phases
        self.current = Plan(Formation(radius_m=10.0, height_m=20.0))
        self.reported: list[TargetFix] = []

    def set_formation(self, formation: Formation, fields: Sequence[str] = ()) -> None:
        place_of(formation.law)
        least_m, count = 3.0 * sqrt(len(self._phases)), len(self._phases)
        if formation.radius_m < least_m:
            raise InvalidError(
                "radius_m", formation.radius_m, f"at least {least_m:.1f} m for {count} vehicles"
            )
        if formation.height_m < formation.radius_m + HEIGHT_MIN_M:
            allowed = f"at least {formation.radius_m + HEIGHT_MIN_M} m with this radius"
            raise InvalidError("height_m", formation.height_m, allowed)
        self.current = replace(self.current, formation=formation)

    def set_orbit(self, orbit: Orbit, fields: Sequence[str] = ()) -> None:
        self.current = replace(self.current, orbit=orbit)

    def set_target(self, target: Target) -> None:
        self.current = replace(self.current, target=replace(target, time_s=time.monotonic()))

    def select_target(self, name: str) -> None:
        if name not in {"", "boat", "walker"}:
            raise UnknownError(f"there is no target {name!r}")

    def hold_target(self) -> None:
        self.set_target(Target(self.current.target.x_m, self.current.target.y_m))

    def report_target(self, name: str, fix: TargetFix) -> None:
        if name != "boat":
            raise UnknownError(f"there is no target {name!r}")
        self.reported.append(fix)

    def set_yaw(self, yaw: Yaw, fields: Sequence[str] = ()) -> None:
        self.current = replace(self.current, yaw=yaw)

    def add_obstacle(self, obstacle: Obstacle) -> None:
        if any(box.id == obstacle.id for box in self.current.obstacles):
            raise RefusedError(f"there is an obstacle {obstacle.id!r} already")
        self.current = replace(self.current, obstacles=(*self.current.obstacles, obstacle))

    def change_obstacle(self, obstacle: Obstacle) -> None:
        self.remove_obstacle(obstacle.id)
        self.add_obstacle(obstacle)

    def remove_obstacle(self, obstacle_id: str) -> None:
        left = tuple(box for box in self.current.obstacles if box.id != obstacle_id)
        if len(left) == len(self.current.obstacles):
            raise UnknownError(f"there is no obstacle {obstacle_id!r}")
        self.current = replace(self.current, obstacles=left)


class FakeService:
    """Vehicles d1, d2 ... on the ground, 5 m apart along y. Plays most roles of the port itself."""

    frame = FRAME

    def __init__(self, count: int = 3, folder: Path | None = None, station_names: Sequence[str] = ()) -> None:
        """`station_names`: each flies as many vehicles; the first is the one that answers, and leads."""
        self.commands = self.recovery = self.player = self.preflight = self.alarms = self.events = self
        self.go = self
        self.shows, self._folder = ShowLibrary(folder), folder
        self.site = SiteEditor(None, None, FRAME, misfit, self._why_site_stays)
        self.phases = dict.fromkeys((f"d{row}" for row in range(1, count + 1)), Phase.STANDBY)
        self.stations: Stations | None = None
        self.station_names: tuple[str, ...] = ()
        self.ticks, self.control_alive = 0, True
        self.audit: Audit = NoAudit()
        self.replaying: Replaying | None = None
        self._begin()
        self.join_site(station_names)
        self.view = Latest(self._look())

    def keep_site(self, site: FlightSite) -> Path:
        """Have a site, and its file in the folder."""
        if self._folder is None:
            raise ValueError("a service with a folder is needed")
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / "field.geojson"
        path.write_bytes(written(site, path))
        self.site = SiteEditor(path, site, FRAME, misfit, self._why_site_stays)
        return path

    def _why_site_stays(self) -> str:
        return "" if self.show is ShowPhase.IDLE else f"the site is changed on the ground, it is {self.show}"

    def join_site(self, names: Sequence[str]) -> None:
        """Become the first of these stations."""
        self.station_names, self.stations = tuple(names), self if names else None
        self.lead, self.term = names[0] if names else "", 1

    def reset(self) -> None:
        """Restore the initial state."""
        self.phases |= dict.fromkeys(self.phases, Phase.STANDBY)
        self._begin()
        self.tick()

    def _begin(self) -> None:
        self.show, self.battery = ShowPhase.IDLE, 0.9
        self.failing: dict[str, tuple[Check, ...]] = {}  # besides the battery
        self.stands_still, self.start_refused = False, ""
        self.silent_s: dict[str, float] = {}  # of stations that are not received
        self.selected: SelectedShow | None = None
        self.interrupted: InterruptedFlight | None = None
        self.start_unix_s: float | None = None
        self.features = Features(lights=LightsView("led-control", sent=120, dropped=30))
        self.checklists = parse_checklists("pads: [each vehicle on its pad, no person near]", "lists")
        self.weather: WeatherEntry | None = None
        self.conditions: tuple[Condition, ...] = ()
        self.happened: tuple[LogEvent, ...] = ()
        self.marks = FlightMarks()
        self.excluded: dict[str, Exclusion] = {}
        self.book, self.plan, self.command_log = AlarmBook(), FakePlan(self.phases), CommandLog()

    def propose(self, by: str, until_unix_s: float = 9e9) -> None:
        """Have a start proposed by a token."""
        proposal = ProposedStart("o1", by, GO_HASH, until_unix_s, len(self.phases), None)
        self.features = replace(self.features, go=self._go(proposal))
        self.tick()

    def call_off(self, why: str) -> None:
        """The proposal is over."""
        self.features = replace(self.features, go=replace(self._go(), ended=why))
        self.tick()

    def _go(self, proposal: ProposedStart | None = None) -> GoView:
        missing = tuple(check.problem for check in self.checklists.checks() if not check.passes)
        lists = self.checklists.view()
        return GoView(True, 60.0, proposal, "", {"show": "1"}, lists, self.weather, missing)

    def confirm_start(self, go_hash: str) -> CommandRecord:
        proposal = None if self.features.go is None else self.features.go.proposal
        if proposal is None or proposal.by == CALLER.get() or go_hash != proposal.hash:
            raise RefusedError("no start is proposed that this confirms")
        return self.command_log.open("confirm", [], {})

    def sign(self, role: str, items: Sequence[int]) -> GoView:
        self.checklists.sign(role, items, CALLER.get(), time.time())
        return self._noted()

    def reopen(self, role: str, items: Sequence[int]) -> GoView:
        self.checklists.reopen(role, items)
        return self._noted()

    def enter_weather(self, entry: WeatherEntry) -> GoView:
        self.weather = replace(entry, by=CALLER.get(), unix_time_s=time.time())
        return self._noted()

    def _noted(self) -> GoView:
        self.features = replace(self.features, go=self._go())
        return self._go()

    def tick(self) -> None:
        """Publish a new state."""
        if self.stands_still:
            return
        self.ticks += 1
        self.book.look(self.conditions, time.monotonic(), time.time())
        view = self._look()
        self.view.promise(lambda: view)

    def finish(self, command_id: str, outcome: Outcome = Outcome.DONE, reason: str = "") -> None:
        """Complete a command for every vehicle."""
        for name in self.command_log.get(command_id).outcomes:
            self.command_log.close(command_id, name, outcome, reason)

    def fly(self) -> None:
        """Set every vehicle to the formation and the show to running."""
        self.show = ShowPhase.RUNNING
        self.phases |= dict.fromkeys(self.phases, Phase.FORMATION)
        self.tick()

    def command_show(
        self,
        action: ShowAction,
        vehicles: Sequence[str] | None = None,
        *,
        show_hash: str | None = None,
        at_unix_time_s: float | None = None,
    ) -> CommandRecord:
        names = self._known(vehicles)
        if show_hash != (None if self.selected is None else self.selected.hash):
            raise RefusedError("that is not the hash of the show that is selected")
        if at_unix_time_s is not None and at_unix_time_s <= time.time():
            raise InvalidError("at_unix_time_s", at_unix_time_s, "ahead")
        event = ShowEvent(action.value) if at_unix_time_s is None else ShowEvent.SCHEDULE
        self.show, self.start_unix_s = advance_show(self.show, event), at_unix_time_s
        return self.command_log.open(f"show {action}", names, {})

    def command_vehicle(self, vehicle_id: str, action: VehicleAction) -> CommandRecord:
        if action is VehicleAction.FIND:
            return self.command_log.done(action, self._known([vehicle_id]))
        return self._advance(f"{action} {vehicle_id}", self._known([vehicle_id]), EVENT[action])

    def command_vehicles(self, action: VehicleAction, vehicles: Sequence[str] | None = None) -> CommandRecord:
        left_out = {}
        for name in self._known(vehicles):
            try:
                advance(self.phases[name], EVENT[action])
            except RefusedError as error:
                left_out[name] = str(error)
        reached = [name for name in self._known(vehicles) if name not in left_out]
        if not reached:
            raise RefusedError(f"{action} reaches no vehicle")
        return self._advance(f"{action} of several", reached, EVENT[action], left_out)

    def kill(self, vehicle_ids: Sequence[str]) -> CommandRecord:
        command = self._advance("kill", self._known(vehicle_ids), Event.KILL)
        self.finish(command.id)
        return self.command_log.get(command.id)

    def _advance(
        self, action: str, names: Iterable[str], event: Event, left_out: dict[str, str] | None = None
    ) -> CommandRecord:
        self.phases |= {name: advance(self.phases[name], event) for name in names}
        return self.command_log.open(action, names, left_out or {})

    def settle(self, offer: Offer) -> CommandRecord:
        if self.interrupted is None or offer not in self.interrupted.offers:
            raise RefusedError(f"{offer} is not offered")
        self.interrupted = None
        return self.command_log.open(offer, self.phases, {})

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

    def begin_at(self, at_unix_time_s: float) -> SelectedShow:
        if self.selected is None:
            raise RefusedError("no show is selected")
        in_s = at_unix_time_s - time.time()
        if in_s <= 0.0:
            raise InvalidError("at_unix_time_s", at_unix_time_s, "ahead")
        begin = BeginView(BeginState.ARMED, at_unix_time_s, in_s)
        self.selected = replace(self.selected, begin=begin)
        return self.selected

    def cancel_begin(self) -> SelectedShow:
        if self.selected is None or self.selected.begin is None:
            raise RefusedError("no time to begin was given")
        self.selected = replace(self.selected, begin=None)
        return self.selected

    def follow_external_clock(self, follow: bool) -> None:
        timecode = self.features.timecode
        if timecode is None:
            raise RefusedError("no timecode is configured")
        self.features = replace(self.features, timecode=replace(timecode, followed=follow))

    def report(self, vehicles: Sequence[str] | None = None) -> PreflightReport:
        self._known(vehicles)
        self._on_the_ground("preflight is for the ground")
        problem = f"battery at {self.battery:.0%}, at least 25% is needed"
        state, words = (State.PASS, ()) if self.battery >= 0.25 else (State.FAIL, (problem, "charge it"))
        check = Check("battery", state, self.battery, "of 1", "at least 25%", *words)
        fleet = Check("vehicles", State.PASS, nan, "vehicles", "all vehicles")
        out = {name: str(why) for name, why in self.excluded.items()}
        own = [
            VehicleChecks(
                name, name not in out, out.get(name, ""), (check, *self.failing.get(name, ())), "px4"
            )
            for name in self.phases
        ]
        left = ("start pattern: there is none",)
        failed = {one.id: one.failed for one in own if one.flies}
        causes = causes_of(failed, lambda _out: [], lambda _check, _out: None, 40)
        return PreflightReport(time.time(), None, None, (fleet,), tuple(own), left, causes)

    def exclude(self, vehicle_id: str, reason: str) -> CommandRecord:
        names = self._known([vehicle_id])
        self._on_the_ground("vehicles can be excluded or included only on the ground")
        self.excluded[vehicle_id] = Exclusion(CALLER.get(), reason, time.time())
        return self.command_log.open("exclude", names, {})

    def include(self, vehicle_id: str) -> CommandRecord:
        names = self._known([vehicle_id])
        if self.excluded.pop(vehicle_id, None) is None:
            raise RefusedError(f"{vehicle_id} was not taken out of the show")
        return self.command_log.open("include", names, {})

    def take_lead(self) -> Sequence[StationView]:
        if self.lead != self.station_names[0]:
            self.lead, self.term = self.station_names[0], self.term + 1
            self.happen(f"the lead was taken by {CALLER.get()}")
        return self._stations()

    def take_over(self, station: str) -> CommandRecord:
        if station not in self.silent_s:
            raise RefusedError(f"station {station} is not lost: stop it there first")
        return self.command_log.open("take-over", list(self.phases), {})

    def _stations(self) -> tuple[StationView, ...]:
        owners = self._owners()
        return tuple(
            StationView(
                name,
                own=name == self.station_names[0],
                leads=name == self.lead,
                received=name not in self.silent_s,
                silent_s=self.silent_s.get(name, 0.04),
                show=self.show,
                vehicles=owners.count(name),
                delay_s=0.002 * number,
                term=self.term,
            )
            for number, name in enumerate(self.station_names)
        )

    def _owners(self) -> list[str]:
        n, k = len(self.phases), len(self.station_names)
        return [self.station_names[row * k // n] for row in range(n)] if k else []

    def acknowledge(self, alarm_id: str) -> Alarm:
        return self.book.acknowledge(alarm_id, CALLER.get(), time.time())

    def acknowledge_all(self) -> Sequence[Alarm]:
        open_ids = [alarm.id for alarm in self.book.alarms if alarm.acknowledged_by is None]
        return [self.acknowledge(alarm_id) for alarm_id in open_ids]

    def newest(self) -> Sequence[LogEvent]:
        return self.happened

    def happen(self, text: str, vehicle: str | None = None) -> None:
        event = LogEvent(len(self.happened) + 1, time.time(), Severity.INFO, text, vehicle)
        self.happened = (*self.happened, event)

    def _known(self, names: Sequence[str] | None) -> list[str]:
        for name in names or ():
            if name not in self.phases:
                raise UnknownError(f"there is no vehicle {name!r}")
        return list(names or self.phases)

    def _on_the_ground(self, otherwise: str) -> None:
        if self.show is not ShowPhase.IDLE:
            raise RefusedError(otherwise)

    def _look(self) -> FleetView:
        flying, now_s, plan = self.show is ShowPhase.RUNNING, time.monotonic(), self.plan.current
        return FleetView(
            now_s,
            time.time(),
            self.show,
            "",
            self._rows(),
            plan,
            FlightEnvelope(3.0, 100.0, 300.0, 2.0, 3.0, 0.3),
            (1.0, 2.0, -20.0) if flying else None,
            (0.5, 0.0, 0.0) if flying else None,
            9.0 if flying else None,
            plan.target.position_m(now_s),
            5.0 if flying else None,
            TickView(20.0, self.ticks, 0, nan, nan, nan),
            self.control_alive,
            self.ticks * len(self.phases),
            7,
            self.start_refused,
            late_samples=4,
            selected=self.selected,
            interrupted=self.interrupted,
            playback=None if self.replaying is None else self.replaying.playback,
            start_unix_time_s=self.start_unix_s,
            countdown_s=None if self.start_unix_s is None else max(0.0, self.start_unix_s - time.time()),
            alarms=self.book.alarms,
            histograms=HISTOGRAMS,
            stations=self._stations(),
            features=replace(self.features, site=self.site.view(INSTANT)),
        )

    def _rows(self) -> VehicleTable:
        phases, n = list(self.phases.values()), len(self.phases)
        up = np.array([phase in AIRBORNE for phase in phases])
        formed = np.array([phase is Phase.FORMATION for phase in phases])
        received = [phase not in (Phase.OFFLINE, Phase.LOST) for phase in phases]
        known = np.where(received, 1.0, np.nan)
        place_m = np.stack([np.zeros(n), 5.0 * np.arange(n), np.where(up, -20.0, 0.0)], axis=1)
        columns: dict[str, Any] = {**unknown(n), "fix_type": 3.0 * known}
        columns["heartbeat_age_s"] = np.append(np.full(n - 1, np.inf), 0.4)
        columns |= {name: value * known for name, value in REPORTED.items()}
        columns |= {name: np.full(n, value) for name, value in MEASURED.items()}
        return VehicleTable(
            ids=list(self.phases),
            system_ids=range(1, n + 1),
            links=["fake"] * n,
            autopilots=["px4"] * n,
            phases=phases,
            reasons=[""] * n,
            modes=[Mode.OFFBOARD if each else Mode.HOLD for each in formed],
            armed=up.tolist(),
            landed=[Landed.IN_AIR if each else Landed.ON_GROUND for each in up],
            ready=received,
            position_m=place_m * known[:, None],
            velocity_m_s=np.array([0.1, 0.2, 0.3]) * known[:, None],
            setpoint_m_s=np.where(formed[:, None], [1.0, 0.0, -1.0], np.nan),
            limited_by=["separation from d9" if row == 0 and formed[0] else "" for row in range(n)],
            colour=np.tile(np.array([[255, 128, 0]], np.uint8), (n, 1)),
            lit=formed,
            homes_m=[np.array([0.0, 5.0 * row, 0.0]) if up[row] else None for row in range(n)],
            stations=self._owners(),
            **columns,
        )
