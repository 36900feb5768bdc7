"""The control group: links, tick, orders. Implements `gcs.service.Service`.

Everything here runs on one event loop. A link that fails is retried; a bug anywhere in the group ends it,
and with it all setpoints (the deadman in the links sees to that).
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
    """Who is told that control lives."""

    @property
    def problem(self) -> str:
        """Why nobody listens any more, in words; empty while somebody does, or nobody ever did."""
        ...

    def beat(self) -> None:
        """A tick came in time. Never waits, never raises."""
        ...


class Orchestrator:
    """Flies the fleet of one configuration. A `gcs.service.Service`."""

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
        """Nothing moves before `run`; must be made on the running event loop.

        Args:
            config: checked.
            links: one for each of the configuration's, with its vehicles.
            record: where orders, events and every tick are noted; opened and closed by whoever made it.
            unix_s: the clock that people read, in s since 1970.
            heart: is told of every tick that came in time, and of no other.
            planning: where ways home are found; None: in a thread of its own, ended with `run`.
            problems: what an operator should know as long as this service runs.
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

    # the loop

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
        """Hear, decide, send: one tick, without waiting for any vehicle."""
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
        # What follows can wait for the next tick: setpoints cannot.
        self._interventions += sum(reason != "" for reason in result.limited_by)
        commander.advance()
        if self._alarms.is_due(now_s):
            self._alarms.look(result, self._findings(commander))
        return result

    def _findings(self, commander: Commander) -> Findings:
        """What the alarms are made of, beside the flight's own state."""
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
        """Of a start that is ordered for a clock time."""
        countdown = None if self._commander is None else self._commander.countdown
        return None if countdown is None else countdown.at_unix_s

    def _note(self, result: Tick) -> None:
        """Leave this tick to the record."""
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
        """Puts the view of this tick together: for a thousand vehicles that is work, and seldom looked at."""
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

    # the service

    @property
    def view(self) -> Latest[FleetView]:
        """Newest state, set once a tick."""
        return self._view

    @property
    def frame(self) -> ShowFrame:
        """Where the show's origin lies."""
        return self._config.frame

    @property
    def audit(self) -> Audit:
        """Where calls are noted, and what an answer waits for."""
        return self._audit

    @property
    def replaying(self) -> None:
        """This is no replay."""
        return None

    def command_record(self, command_id: str) -> CommandRecord:
        """An accepted order. Raises: UnknownError."""
        return self._book.get(command_id)

    def commands(self) -> Sequence[CommandRecord]:
        """The last orders, the newest first."""
        return self._book.newest()

    def events(self) -> Sequence[LogEvent]:
        """What happened last, the newest last."""
        return self._event_log.newest()

    def command_show(
        self,
        action: ShowAction,
        vehicles: Sequence[VehicleId] | None = None,
        *,
        show_hash: str | None = None,
        at_unix_time_s: float | None = None,
    ) -> CommandRecord:
        """Order the whole show."""
        with instead(self._flight):
            return self._running().command_show(
                action, vehicles, show_hash=show_hash, at_unix_time_s=at_unix_time_s
            )

    def select_show(self, name: str, show_hash: str) -> SelectedShow:
        """Have a checked show fly next."""
        with instead(self._flight):
            self._need_no_countdown()
            return self._show_player.select(name, show_hash)

    def deselect_show(self) -> None:
        """Fly what is told instead."""
        with instead(self._flight):
            self._need_no_countdown()
            self._show_player.deselect()

    def seek_show(self, cue: str) -> SelectedShow:
        """Have the selected show begin at a cue."""
        with instead(self._flight):
            self._need_no_countdown()
            return self._show_player.seek(cue)

    def _need_no_countdown(self) -> None:
        if self._running().countdown is not None:
            raise RefusedError("a start is being counted down: stop cancels it")

    def command_vehicle(self, vehicle_id: VehicleId, action: VehicleAction) -> CommandRecord:
        """Order one vehicle."""
        with instead(self._flight, vehicle_id):
            return self._running().command_vehicle(vehicle_id, action)

    def command_vehicles(
        self, action: VehicleAction, vehicles: Sequence[VehicleId] | None = None
    ) -> CommandRecord:
        """Order several vehicles at once."""
        with instead(self._flight):
            return self._running().command_vehicles(action, vehicles)

    def preflight(self, vehicles: Sequence[VehicleId] | None = None) -> PreflightReport:
        """What a start would find."""
        with instead(self._flight):
            return self._running().preflight(vehicles)

    def exclude(self, vehicle_id: VehicleId, reason: str) -> CommandRecord:
        """Take a vehicle out of the show."""
        with instead(self._flight):
            return self._running().exclude(vehicle_id, reason)

    def include(self, vehicle_id: VehicleId) -> CommandRecord:
        """Take it into the show again."""
        with instead(self._flight):
            return self._running().include(vehicle_id)

    def kill(self, vehicle_ids: Sequence[VehicleId]) -> CommandRecord:
        """Motors off, now."""
        with instead(self._flight):
            return self._running().kill(vehicle_ids)

    def acknowledge_alarm(self, alarm_id: str) -> Alarm:
        """Note that whoever calls has seen an alarm. Raises: UnknownError."""
        return self._alarms.acknowledge(alarm_id)

    def acknowledge_alarms(self) -> Sequence[Alarm]:
        """Acknowledge all alarms."""
        return self._alarms.acknowledge_all()

    def settle(self, offer: Offer) -> CommandRecord:
        """Go on with a flight that was cut off, or bring it home."""
        with instead(self._flight):
            return self._running().recovery.settle(offer)

    def _running(self) -> Commander:
        if self._commander is None:
            raise RefusedError("the service does not run yet")
        return self._commander

    def set_formation(self, formation: Formation) -> None:
        """Change radius and height; refused with what would work."""
        self._plan_editor.set_formation(formation)

    def set_orbit(self, orbit: Orbit) -> None:
        """Change how the centre circles the target."""
        self._plan_editor.set_orbit(orbit)

    def set_target(self, target: Target) -> None:
        """Tell where the target is now and how it moves."""
        self._plan_editor.set_target(target)

    def set_yaw(self, yaw: Yaw) -> None:
        """Change where the vehicles look."""
        self._plan_editor.set_yaw(yaw)

    def add_obstacle(self, obstacle: Obstacle) -> None:
        """Add a box."""
        self._plan_editor.add_obstacle(obstacle)

    def change_obstacle(self, obstacle: Obstacle) -> None:
        """Replace the box of the same id."""
        self._plan_editor.change_obstacle(obstacle)

    def remove_obstacle(self, obstacle_id: str) -> None:
        """Forget a box."""
        self._plan_editor.remove_obstacle(obstacle_id)

    def _taking_part(self) -> list[Vehicle]:
        """In the air, or about to be."""
        waiting = [] if self._commander is None else self._commander.waiting
        return [*self._flight.airborne, *waiting]
