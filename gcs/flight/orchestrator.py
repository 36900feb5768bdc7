"""Runs a flight: links, tick, and the roles of `gcs.service.Service`.

Everything here runs on one event loop. A link that fails is retried; a bug anywhere in the group ends it,
and with it all setpoints (the setpoint watchdog in the links ensures that).
"""

import asyncio
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from copy import copy
from functools import cache, partial
from math import nan
from typing import Protocol

from gcs.config.schema import Config
from gcs.control import Memory, Tick, prepare, tick
from gcs.flight.composition import FlightParts, warm_up
from gcs.flight.monitors.alarm_monitor import AlarmMonitor, Findings
from gcs.flight.monitors.snapshots import Estimating, fleet_view
from gcs.flight.state.elsewhere import Elsewhere
from gcs.flight.state.flight import Flight
from gcs.flight.state.ticker import TickClock, garbage_between_ticks, ticks
from gcs.links.batch_link import Link
from gcs.links.link_set import SetpointRouting, keep_open
from gcs.recording.sample import Sample
from gcs.recording.session import Record
from gcs.service import Audit, FleetView, Latest, NoAudit, Scheduling
from gcs.service.commands import CommandLog
from gcs.service.event_log import attached
from gcs.service.flight_marks import FlightLog


class Heart(Protocol):
    """Receives a sign of life from control with every tick."""

    @property
    def problem(self) -> str:
        """Why the receiver stopped listening, in words; empty while it listens, or if there never was one."""

    def beat(self) -> None:
        """Report a tick that came in time. Never waits, never raises."""


def _utc_off_s(
    unix_s: Callable[[], float], loop_s: Callable[[], float], clock_problem: Callable[[], str]
) -> float:
    """This computer's clock minus the loop's; NaN: it is not to be trusted."""
    return nan if clock_problem() else unix_s() - loop_s()


class Orchestrator:
    """Flies the fleet of one configuration. Implements `gcs.service.Service`."""

    def __init__(
        self,
        config: Config,
        links: Sequence[Link],
        record: Record | None = None,
        *,
        unix_s: Callable[[], float] = time.time,
        clock_problem: Callable[[], str] = lambda: "",
        heart: Heart | None = None,
        planning: Executor | None = None,
        problems: Sequence[str] = (),
        law_wait_s: float | None = None,
    ) -> None:
        """Sends nothing before `run`; must be created on the running event loop.

        Args:
            config: checked.
            links: one for each link of the configuration, with its vehicles.
            record: receives commands, events and every tick; its creator opens and closes it.
            unix_s: the wall clock, in s since 1970.
            clock_problem: why that clock is not to be trusted; empty: it is.
            heart: receives a beat for every tick that came in time, and for no other.
            planning: executor for the return planner; None: a thread of its own, ended with `run`.
            problems: notices for the operator for as long as this service runs.
            law_wait_s: for a law of another package, in true time; None: its budget. More in virtual time.
        """
        warm_up()
        prepare(config.control.safety)
        loop = asyncio.get_running_loop()
        self._config = config
        self.command_log = CommandLog(None if record is None else record.audit)
        self.flight = flight = Flight(config, links, loop.time(), book=self.command_log, unix_s=unix_s)
        self._record = record
        self._heart = heart
        self._planning = planning or ThreadPoolExecutor(1, thread_name_prefix="ways")
        self._standing = tuple(problems)
        self._clock = TickClock(config.tick_rate_hz)
        self._routing = SetpointRouting(links)
        self._failed_links: dict[str, str] = {}
        self._interventions = 0
        self._group = asyncio.TaskGroup()  # the control group, entered by `run`
        self._estimating = Estimating(
            flight.newest, flight.vehicles, flight.show, flight.in_force, config, flight.slow_from_m
        )
        if record is not None:
            configured = flight.vehicles.keys()
            flight.excluded |= {name: out for name, out in record.excluded.items() if name in configured}
        self.frame = config.frame
        self.replaying = None
        self.stations = None
        self.audit: Audit = NoAudit() if record is None else record.audit
        self.events = FlightLog()
        self.alarms = AlarmMonitor(flight)

        parts = FlightParts(
            flight,
            self._group,
            self._clock,
            self._planning,
            partial(_utc_off_s, unix_s, loop.time, clock_problem),
            clock_problem,
            None if record is None else record.found,
            law_wait_s,
        )
        self._guard = parts.guard
        self.refusals, self.maneuvers, self.shows = parts.refusals, parts.maneuvers, parts.shows
        self.site = parts.site
        self.player, self.preflight, self.plan = parts.player, parts.preflight, parts.plan
        self.go = parts.go
        self.commands, self.recovery = parts.commands, parts.commands.recovery
        self._telemetry_monitor = parts.telemetry_monitor
        self._failsafe_monitor, self._progress = parts.failsafe_monitor, parts.progress
        self._in_place = parts.in_place
        first = self._decide()
        self.view = Latest(self._promised_view(first)())

    def join(self, elsewhere: Elsewhere) -> None:
        """Have vehicles that are flown elsewhere take part, before `run`."""
        flight = self.flight
        flight.elsewhere = elsewhere
        flight.newest.memory = Memory.fresh(
            len(flight.vehicles) + elsewhere.count, flight.newest.state.time_s
        )
        self.recovery.review()
        first = self._decide()
        self.view.promise(partial(elsewhere.hooks.whole, self._promised_view(first), first))

    async def run(self) -> None:
        try:
            with attached(self.events), garbage_between_ticks() as collect:
                async with self._group as group:
                    self.recovery.log_found()
                    if self._record is not None and self._record.lost_begin is not None:
                        self.player.begin.log_lost(self._record.lost_begin)
                    for link in self.flight.links:
                        group.create_task(keep_open(link, self._failed_links), name=f"link/{link.name}")
                    group.create_task(self._control(collect), name="control")
        finally:
            self.commands.close()
            self._guard.close()
            self._planning.shutdown(wait=False, cancel_futures=True)
            await self.shows.close()

    def granted(self, scheduling: Scheduling) -> None:
        """Note what the machine grants this process, for displays."""
        self._clock.scheduling = scheduling

    async def _control(self, collect_garbage: Callable[[float], None]) -> None:
        loop = asyncio.get_running_loop()
        begin = self.player.begin
        async for now_s, due_s, missed in ticks(
            1.0 / self._config.tick_rate_hz, lambda: begin.due_s(loop.time())
        ):
            began_s = loop.time()
            result = self._tick(now_s)
            self._clock.note(began_s, loop.time() - began_s, began_s - due_s, missed)
            if self._heart is not None and self._control_alive:
                self._heart.beat()
            self._estimating.refresh(len(self.maneuvers.waiting), self.commands.home_left_s)
            own, hooks = self._promised_view(result), self.flight.elsewhere.hooks
            if self._record is not None:
                own = cache(own)
            self.view.promise(partial(hooks.whole, own, result))
            if self._record is not None:
                run = self.flight.show.run
                parts = {} if run is None else run.parts
                sample = Sample(own(), parts, self.flight.limits_now, elsewhere=hooks.recorded())
                self._record.note(sample, self.flight.links)
            self.flight.wake()
            collect_garbage(now_s)

    def _tick(self, now_s: float) -> Tick:
        """Run one tick without waiting for any vehicle: read telemetry, compute, send."""
        flight, hooks = self.flight, self.flight.elsewhere.hooks
        flight.receive(now_s)
        hooks.before(now_s)
        flight.note_setpoints()
        gap_s = self._clock.gap_before(now_s)
        if gap_s > self._config.setpoint_timeout_s:
            self.recovery.stalls.stalled(gap_s)  # control may have been lost
            self._telemetry_monitor.resume()
        self._telemetry_monitor.look()
        self.player.lead()
        instant = flight.instant
        for feature in flight.features:
            feature.lead(instant)
        result = self._decide()
        if hooks.may_send:
            self._routing.send(result.setpoints)
        # The rest can wait for the next tick: setpoints cannot.
        flight.newest.memory = result.memory
        flight.note_links()
        self._interventions += len(result.limited_by) - result.limited_by.count("")
        hooks.sent(result, all_up=self.maneuvers.all_up)
        if hooks.may_send:
            for feature in flight.features:
                feature.send()
        self._progress.advance()
        hooks.after()
        if self.alarms.is_due(now_s):
            self.alarms.look(result, self._findings())
        return result

    def _findings(self) -> Findings:
        links = self.flight.links
        recorded = () if self._record is None else self._record.problems
        return Findings(
            failsafes=self._failsafe_monitor.active,
            landings=tuple(self._in_place.conditions()),
            obstacles_wait=self.player.waits,
            not_recorded=(*recorded, *(problem for link in links for problem in link.problems)),
            failed_links=self._failed_links,
            interrupted=self.recovery.view(),
            return_problem=self.commands.return_problem,
            clock_doubt=self.player.begin.why_doubtful,
            not_ready=self.commands.starting.why_not_ready,
            supervisor="" if self._heart is None else self._heart.problem,
            notes=self._standing,
        )

    def _decide(self) -> Tick:
        flight = self.flight
        now = (
            flight.newest.state,
            flight.tasks(),
            flight.in_force.plan,
            flight.traits_now,
            flight.newest.memory,
            flight.control_now,
        )
        elsewhere = flight.elsewhere
        return tick(*now, None, elsewhere.others, elsewhere.shared(), runner=self._guard.runner)

    @property
    def _control_alive(self) -> bool:
        return self._clock.gap_s <= self._config.setpoint_timeout_s

    def _promised_view(self, result: Tick) -> Callable[[], FleetView]:
        """Return a function that builds the view of this tick: expensive for large fleets, rarely needed."""
        countdown = self.commands.starting.countdown
        return partial(
            fleet_view,
            copy(self.flight),  # what commands change later does not belong to this tick
            result,
            timing=self._clock.summary(),
            histograms=self._clock.histograms,
            control_alive=self._control_alive,
            interventions=self._interventions,
            estimates=self._estimating.newest,
            unix_time_s=self.flight.unix_s(),
            start_refused=self.commands.outlook.why_not,
            start_unix_s=None if countdown is None else countdown.at_unix_s,
            failsafes=self._failsafe_monitor.active,
            interrupted=self.recovery.view(),
            alarms=self.alarms.alarms,
        )
