"""The control group: links, tick, commands. Implements `gcs.service.Service`.

Everything here runs on one event loop. A link that fails is retried; a bug anywhere in the group ends it,
and with it all setpoints (the setpoint watchdog in the links ensures that).
"""

import asyncio
import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from typing import Protocol

import numpy as np

from gcs.config.schema import Config
from gcs.control import Tick, tick, warm_up
from gcs.flight.alarm_monitor import AlarmMonitor, Findings
from gcs.flight.alternatives import instead
from gcs.flight.command_log import CommandLog
from gcs.flight.commander import Commander
from gcs.flight.estimate_inputs import Estimating
from gcs.flight.fleet import Fleet
from gcs.flight.maneuvers import Maneuvers
from gcs.flight.parameter_reader import ParameterReader
from gcs.flight.plan_editor import PlanEditor
from gcs.flight.record_sample import record_sample
from gcs.flight.show_player import ShowPlayer
from gcs.flight.snapshots import fleet_view
from gcs.flight.ticker import TickClock, ticks
from gcs.flight.vehicle import Vehicle
from gcs.links import Link
from gcs.links.routing import SetpointRouting
from gcs.links.supervision import keep_open
from gcs.model.errors import RefusedError
from gcs.model.frames import ShowFrame
from gcs.model.interrupted_flight import Offer
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Formation, Obstacle, Orbit, Target, Yaw
from gcs.model.preflight_report import PreflightReport
from gcs.model.state import VehicleId
from gcs.planning.return_paths import warm_up as warm_up_paths
from gcs.recording.session import Record
from gcs.service import (
    Audit,
    CommandRecord,
    FleetView,
    Latest,
    NoAudit,
    SelectedShow,
    ShowAction,
    VehicleAction,
)
from gcs.service.alarms import Alarm
from gcs.service.event_log import EventLog, LogEvent, received
from gcs.shows.library import ShowLibrary

log = logging.getLogger(__name__)

BEFORE_ASSEMBLING = frozenset({ShowPhase.COUNTDOWN, ShowPhase.PREFLIGHT, ShowPhase.ARMING})


class Heart(Protocol):
    """Receives a sign of life from control with every tick."""

    @property
    def problem(self) -> str:
        """Why the receiver stopped listening, in words; empty while it listens, or if there never was one."""
        ...

    def beat(self) -> None:
        """Report a tick that came in time. Never waits, never raises."""
        ...


class Orchestrator:
    """Flies the fleet of one configuration. Implements `gcs.service.Service`."""

    def __init__(
        self,
        config: Config,
        links: Sequence[Link],
        record: Record | None = None,
        *,
        unix_s: Callable[[], float] = time.time,
        heart: Heart | None = None,
        planning: Executor | None = None,
        problems: Sequence[str] = (),
    ) -> None:
        """Sends nothing before `run`; must be created on the running event loop.

        Args:
            config: checked.
            links: one for each link of the configuration, with its vehicles.
            record: receives commands, events and every tick; its creator opens and closes it.
            unix_s: the wall clock, in s since 1970.
            heart: receives a beat for every tick that came in time, and for no other.
            planning: executor for the return planner; None: a thread of its own, ended with `run`.
            problems: notices for the operator for as long as this service runs.
        """
        warm_up()
        warm_up_paths()
        now_s = asyncio.get_running_loop().time()
        self._config = config
        self._flight = Fleet(config, links, now_s)
        self._record = record
        self._found = None if record is None else record.found
        if record is not None:
            known = self._flight.vehicles.keys()
            self._flight.excluded |= {name: out for name, out in record.excluded.items() if name in known}
        self._audit: Audit = NoAudit() if record is None else record.audit
        self._book = CommandLog(None if record is None else record.audit)
        self._unix_s = unix_s
        self._heart = heart
        self._planning = planning or ThreadPoolExecutor(1, thread_name_prefix="ways")
        self.shows = ShowLibrary(None if config.shows is None else config.shows.folder)
        self._show_player = ShowPlayer(self._flight, self.shows)
        self._plan_editor = PlanEditor(
            self._flight, self._show_player, self._taking_part, asyncio.get_running_loop().time
        )
        self._clock = TickClock(config.tick_rate_hz)
        self._interventions = 0
        self._standing = tuple(problems)
        self._event_log = EventLog()
        self._commander: Commander | None = None
        self._routing = SetpointRouting(links)
        self._failed_links: dict[str, str] = {}
        self._alarms = AlarmMonitor(self._flight, unix_s, self._book.newest)
        self._estimating = Estimating(self._flight)
        self._view = Latest(self._promised_view(self._decide())())

    # loop

    async def run(self) -> None:
        """Fly until cancelled."""
        listening = ExitStack()
        listening.enter_context(received(self._event_log))
        try:
            async with asyncio.TaskGroup() as group:
                maneuvers = Maneuvers(group, self._flight, self._config.operation)
                parameter_reader = ParameterReader(group, self._flight)
                self._commander = Commander(
                    self._flight,
                    maneuvers,
                    self._book,
                    parameter_reader,
                    self._show_player,
                    self._unix_s,
                    self._clock,
                    self._planning,
                    self._found,
                )
                for link in self._flight.links:
                    group.create_task(keep_open(link, self._failed_links), name=f"link/{link.name}")
                group.create_task(self._control(self._commander), name="control")
        finally:
            listening.close()
            if self._commander is not None:
                self._commander.close()
            self._planning.shutdown(wait=False, cancel_futures=True)
            await self.shows.close()

    async def _control(self, commander: Commander) -> None:
        loop = asyncio.get_running_loop()
        async for now_s, due_s, missed in ticks(1.0 / self._config.tick_rate_hz):
            began_s = loop.time()
            result = self._tick(now_s, commander)
            self._clock.note(began_s, loop.time() - began_s, began_s - due_s, missed)
            if self._heart is not None and self._control_alive:
                self._heart.beat()
            self._estimating.refresh(len(commander.waiting), commander.home_left_s)
            self._view.promise(self._promised_view(result))
            self._note(result)
            self._flight.wake()

    def _tick(self, now_s: float, commander: Commander) -> Tick:
        """Run one tick without waiting for any vehicle: read telemetry, compute, send."""
        flight = self._flight
        flight.hear(now_s)
        gap_s = self._clock.gap_before(now_s)
        if gap_s > self._config.setpoint_timeout_s:
            commander.stalled(gap_s)
        commander.watch()
        self._show_player.lead()
        result = self._decide()
        flight.memory = result.memory
        flight.setpoint_gaps.note(~np.isnan(result.memory.desired_m_s[:, 0]), now_s)
        for link, share in zip(flight.links, self._routing.of(result.setpoints), strict=True):
            link.send(share)
        # The rest can wait for the next tick: setpoints cannot.
        self._interventions += sum(reason != "" for reason in result.limited_by)
        commander.advance()
        if self._alarms.is_due(now_s):
            self._alarms.look(result, self._findings(commander))
        return result

    def _findings(self, commander: Commander) -> Findings:
        """Conditions for the alarms that are found outside the flight state."""
        links = self._flight.links
        recorded = () if self._record is None else self._record.problems
        return Findings(
            failsafes=commander.failsafes,
            obstacles_wait=self._show_player.waits,
            not_recorded=(*recorded, *(problem for link in links for problem in link.problems)),
            failed_links=self._failed_links,
            interrupted=commander.recovery.view(),
            return_problem=commander.return_problem,
            supervisor="" if self._heart is None else self._heart.problem,
            notes=self._standing,
        )

    def _decide(self) -> Tick:
        flight = self._flight
        control = flight.control_now
        return tick(flight.fleet, flight.tasks(), flight.plan, flight.traits, flight.memory, control)

    @property
    def _control_alive(self) -> bool:
        return self._clock.gap_s <= self._config.setpoint_timeout_s

    @property
    def _start_unix_s(self) -> float | None:
        """Time of a scheduled start, in s since 1970; None: there is none."""
        countdown = None if self._commander is None else self._commander.countdown
        return None if countdown is None else countdown.at_unix_s

    def _note(self, result: Tick) -> None:
        """Pass this tick to the record."""
        if self._record is not None:
            sample = record_sample(
                self._flight,
                result,
                timing=self._clock.summary(),
                control_alive=self._control_alive,
                alarms=self._alarms.alarms,
                unix_time_s=self._unix_s(),
                start_unix_time_s=self._start_unix_s,
            )
            self._record.note(sample, self._flight.links)

    def _promised_view(self, result: Tick) -> Callable[[], FleetView]:
        """Return a function that builds the view of this tick: expensive for large fleets, rarely needed."""
        flight = self._flight
        return partial(
            fleet_view,
            flight,
            fleet=flight.fleet,
            tick=result,
            telemetry=flight.telemetry.parts,
            known=flight.known,
            traits=flight.traits,
            show=flight.show,
            reason=flight.reason,
            plan=flight.plan,
            safety=flight.control.safety,
            timing=self._clock.summary(),
            control_alive=self._control_alive,
            interventions=self._interventions,
            link_quality=flight.link_quality.share,
            setpoints_sent=sum(link.setpoints_sent for link in flight.links),
            estimates=self._estimating.newest,
            unix_time_s=self._unix_s(),
            show_run=flight.show_run,
            start_unix_s=self._start_unix_s,
            failsafes=() if self._commander is None else self._commander.failsafes,
            interrupted=None if self._commander is None else self._commander.recovery.view(),
            alarms=self._alarms.alarms,
        )

    # service port

    @property
    def view(self) -> Latest[FleetView]:
        """Newest state, set once a tick."""
        return self._view

    @property
    def frame(self) -> ShowFrame:
        """Position and heading of the show's origin."""
        return self._config.frame

    @property
    def audit(self) -> Audit:
        """The audit record: notes calls, and delays an answer until they are stored."""
        return self._audit

    @property
    def replaying(self) -> None:
        """None: this service is no replay."""
        return None

    def command_record(self, command_id: str) -> CommandRecord:
        """Return an accepted command. Raises: UnknownError."""
        return self._book.get(command_id)

    def commands(self) -> Sequence[CommandRecord]:
        """The newest commands, newest first."""
        return self._book.newest()

    def events(self) -> Sequence[LogEvent]:
        """The newest events, newest last."""
        return self._event_log.newest()

    def command_show(
        self,
        action: ShowAction,
        vehicles: Sequence[VehicleId] | None = None,
        *,
        show_hash: str | None = None,
        at_unix_time_s: float | None = None,
    ) -> CommandRecord:
        """Execute a fleet-wide command."""
        with instead(self._flight):
            return self._running().command_show(
                action, vehicles, show_hash=show_hash, at_unix_time_s=at_unix_time_s
            )

    def select_show(self, name: str, show_hash: str) -> SelectedShow:
        """Select a checked show to fly next."""
        with instead(self._flight):
            self._need_no_countdown()
            return self._show_player.select(name, show_hash)

    def deselect_show(self) -> None:
        """Select no show: the panels decide the plan."""
        with instead(self._flight):
            self._need_no_countdown()
            self._show_player.deselect()

    def seek_show(self, cue: str) -> SelectedShow:
        """Start the selected show at a cue."""
        with instead(self._flight):
            self._need_no_countdown()
            return self._show_player.seek(cue)

    def _need_no_countdown(self) -> None:
        if self._running().countdown is not None:
            raise RefusedError("a start is being counted down: stop cancels it")

    def command_vehicle(self, vehicle_id: VehicleId, action: VehicleAction) -> CommandRecord:
        """Execute a command to one vehicle."""
        with instead(self._flight, vehicle_id):
            return self._running().command_vehicle(vehicle_id, action)

    def command_vehicles(
        self, action: VehicleAction, vehicles: Sequence[VehicleId] | None = None
    ) -> CommandRecord:
        """Execute a command to several vehicles."""
        with instead(self._flight):
            return self._running().command_vehicles(action, vehicles)

    def preflight(self, vehicles: Sequence[VehicleId] | None = None) -> PreflightReport:
        """Report what a start would find."""
        with instead(self._flight):
            return self._running().preflight(vehicles)

    def exclude(self, vehicle_id: VehicleId, reason: str) -> CommandRecord:
        """Take a vehicle out of the show."""
        with instead(self._flight):
            return self._running().exclude(vehicle_id, reason)

    def include(self, vehicle_id: VehicleId) -> CommandRecord:
        """Include an excluded vehicle again."""
        with instead(self._flight):
            return self._running().include(vehicle_id)

    def kill(self, vehicle_ids: Sequence[VehicleId]) -> CommandRecord:
        """Stop the motors of these vehicles immediately."""
        with instead(self._flight):
            return self._running().kill(vehicle_ids)

    def acknowledge_alarm(self, alarm_id: str) -> Alarm:
        """Mark an alarm as acknowledged by the caller. Raises: UnknownError."""
        return self._alarms.acknowledge(alarm_id)

    def acknowledge_alarms(self) -> Sequence[Alarm]:
        return self._alarms.acknowledge_all()

    def settle(self, offer: Offer) -> CommandRecord:
        """Continue an interrupted flight, or return its vehicles."""
        with instead(self._flight):
            return self._running().recovery.settle(offer)

    def _running(self) -> Commander:
        if self._commander is None:
            raise RefusedError("the service does not run yet")
        return self._commander

    def set_formation(self, formation: Formation) -> None:
        """Change radius and height; a refusal names values that are accepted."""
        self._plan_editor.set_formation(formation)

    def set_orbit(self, orbit: Orbit) -> None:
        """Change how the centre circles the target."""
        self._plan_editor.set_orbit(orbit)

    def set_target(self, target: Target) -> None:
        """Set the target's position and velocity."""
        self._plan_editor.set_target(target)

    def set_yaw(self, yaw: Yaw) -> None:
        """Change the vehicles' heading."""
        self._plan_editor.set_yaw(yaw)

    def add_obstacle(self, obstacle: Obstacle) -> None:
        """Add a box-shaped obstacle."""
        self._plan_editor.add_obstacle(obstacle)

    def change_obstacle(self, obstacle: Obstacle) -> None:
        """Replace the obstacle of the same id."""
        self._plan_editor.change_obstacle(obstacle)

    def remove_obstacle(self, obstacle_id: str) -> None:
        """Remove an obstacle."""
        self._plan_editor.remove_obstacle(obstacle_id)

    def _taking_part(self) -> list[Vehicle]:
        """Vehicles in the air, or about to take off."""
        waiting = [] if self._commander is None else self._commander.waiting
        return [*self._flight.airborne, *waiting]
