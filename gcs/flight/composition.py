"""What each part of a flight is given: one function for each part, and all of them in their order."""

import asyncio
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from math import isnan

from gcs.control import warm_up as tick_warm_up
from gcs.estimation import fleet_state, link_health, positioning, wind
from gcs.estimation.targets import motion
from gcs.failsafe import triggers
from gcs.flight.commands.commander import Commander
from gcs.flight.commands.plan_editor import PlanEditor, RestoredPlan
from gcs.flight.commands.site_editor import SiteEditor, misfit_of, why_not_now
from gcs.flight.features.composition import features_of
from gcs.flight.features.laws.guard import LawGuard
from gcs.flight.features.targets import Targets
from gcs.flight.features.timecode import Timecode
from gcs.flight.features.wind import WindWatch
from gcs.flight.maneuvers.descent import Descent
from gcs.flight.maneuvers.landing_places import LandingPlaces
from gcs.flight.maneuvers.landings import Landings
from gcs.flight.maneuvers.maneuver_steps import Steps
from gcs.flight.maneuvers.maneuvers import Maneuvers
from gcs.flight.monitors.failsafe_monitor import FailsafeMonitor
from gcs.flight.monitors.in_place import InPlaceLandings
from gcs.flight.monitors.show_progress import ComeBack, ShowProgress
from gcs.flight.monitors.telemetry_monitor import TelemetryMonitor
from gcs.flight.preflight.go import CrewGo
from gcs.flight.preflight.parameter_reader import ParameterReader
from gcs.flight.preflight.preflight_gate import PreflightGate
from gcs.flight.shows.show_begin import ShowBegin
from gcs.flight.shows.show_player import ShowPlayer
from gcs.flight.state.flight import Flight
from gcs.flight.state.refusals import Refusals
from gcs.flight.state.ticker import TickClock
from gcs.model.interrupted_flight import Interruption
from gcs.planning import lost_space, silent_space
from gcs.planning.return_paths import planner
from gcs.service import ShowAction
from gcs.shows.library import ShowLibrary
from gcs.shows.service_rules import ServiceRules


def warm_up() -> None:
    """Compile or load all that a tick runs, before the first."""
    for load in (
        tick_warm_up,
        link_health.warm_up,
        triggers.warm_up,
        planner.warm_up,
        lost_space.warm_up,
        silent_space.warm_up,
        motion.warm_up,
        wind.warm_up,
        fleet_state.warm_up,
        positioning.warm_up,
    ):
        load()


class FlightParts:
    """The parts of one flight that use one another."""

    def __init__(
        self,
        flight: Flight,
        group: asyncio.TaskGroup,
        clock: TickClock,
        planning: Executor,
        unix_minus_loop_s: Callable[[], float],
        clock_problem: Callable[[], str],
        interruption: Interruption | None,
        law_wait_s: float | None = None,
    ) -> None:
        """Gives the flight its features as well.

        Args:
            flight: without features so far.
            group: for the tasks of maneuvers and requests.
            clock: of the ticks.
            planning: runs the planner of the return.
            unix_minus_loop_s: this computer's clock minus the loop's; NaN: it is not to be trusted.
            clock_problem: why it is not; empty: it is.
            interruption: the flight that was interrupted before this service began.
            law_wait_s: as of `LawProcess`.
        """
        targets = targets_of(flight, unix_minus_loop_s)
        self.guard = guard = LawGuard(
            flight.in_force,
            lambda: len(flight.vehicles) + flight.elsewhere.count,
            1.0 / flight.config.tick_rate_hz,
            law_wait_s,
        )
        self.go = go = CrewGo(
            flight.config.go,
            flight,
            lambda: targets.selected,
            asyncio.get_running_loop().time,
            {
                "site": lambda: flight.start_hashes((), None).get("site_hash", ""),
                "parameters elsewhere": lambda: flight.elsewhere.parameters_hash,
            },
        )
        self.site = site = site_editor_of(flight)
        watch = WindWatch(flight.config, flight.newest, flight.vehicles, go.wind_limits, lambda: go.wind)
        flight.outside_clock = Timecode(flight.config.timecode)
        flight.features = [*features_of(flight, targets, guard, unix_minus_loop_s, group), go, site, watch]
        self.refusals = refusals = refusals_of(flight)
        places = landing_places_of(flight)
        self.maneuvers = maneuvers = maneuvers_of(flight, group, places)
        reader = parameter_reader_of(flight, group)
        self.shows = library_of(flight)
        self.player = player = show_player_of(flight, refusals, self.shows, clock_problem)
        self.preflight = PreflightGate(flight, refusals, reader, player)
        self.plan = plan_editor_of(flight, player, maneuvers, targets)
        plans = RestoredPlan(flight.in_force, flight.show, flight.newest, flight.unix_s, player, targets)
        self.commands = commands = Commander(
            flight, refusals, places, maneuvers, player, self.preflight, planning, plans, go, interruption
        )
        guard.pause = partial(commands.execute_show_failsafe, ShowAction.PAUSE)
        self.telemetry_monitor = telemetry_monitor_of(flight, maneuvers, commands)
        self.failsafe_monitor = failsafe_monitor_of(flight, player, clock, commands, maneuvers, targets)
        self.in_place = InPlaceLandings(flight, maneuvers, commands)
        self.progress = show_progress_of(
            flight, maneuvers, commands, reader, self.failsafe_monitor, player, self.in_place
        )


def targets_of(flight: Flight, unix_minus_loop_s: Callable[[], float]) -> Targets:
    return Targets(
        flight.config.targets,
        flight.config.frame,
        flight.newest,
        flight.in_force,
        unix_minus_loop_s,
        lambda: flight.elsewhere.shows.leads,
        flight.config.own_tracks,
    )


def refusals_of(flight: Flight) -> Refusals:
    return Refusals(flight.newest, flight.vehicles, flight.config.operation, flight.inputs)


def landing_places_of(flight: Flight) -> LandingPlaces:
    return LandingPlaces(
        flight.newest,
        flight.in_force,
        flight.vehicles,
        flight.config.operation,
        flight.uncontrolled.last_m,
        flight.closed,
        lambda: flight.elsewhere,
        flight.once,
    )


def maneuvers_of(flight: Flight, group: asyncio.TaskGroup, places: LandingPlaces) -> Maneuvers:
    newest, slow_from_m = flight.newest, flight.slow_from_m
    steps = Steps(newest, flight.ticked, flight.execute)
    descent = partial(Descent, newest, flight.in_force, flight.config, flight.link_delay, slow_from_m)
    return Maneuvers(
        group,
        steps,
        Landings(newest, steps, places, descent, flight.may_descend, flight.closing),
        newest,
        flight.vehicles,
        flight.show,
        flight.config.operation,
        flight.climb_ended,
        flight.once,
        lambda: flight.elsewhere.all_up,
    )


def parameter_reader_of(flight: Flight, group: asyncio.TaskGroup) -> ParameterReader:
    return ParameterReader(
        group,
        flight.newest,
        flight.vehicles,
        flight.config,
        flight.link_of,
        flight.parameters,
        flight.changed_parameters,
        flight.note_parameters,
    )


def site_editor_of(flight: Flight) -> SiteEditor:
    config = flight.config
    why_not = partial(why_not_now, flight.show, flight.vehicles, alone=lambda: flight.elsewhere.count == 0)
    return SiteEditor(config.site, config.flight_site, config.frame, partial(misfit_of, config), why_not)


def library_of(flight: Flight) -> ShowLibrary:
    shows, rules = flight.config.shows, ServiceRules.of(flight.config.control, flight.config.operation)
    return ShowLibrary(None if shows is None else shows.folder, rules)


def show_player_of(
    flight: Flight, refusals: Refusals, library: ShowLibrary, clock_problem: Callable[[], str]
) -> ShowPlayer:
    """`clock_problem`: why this computer's clock is not to be trusted; empty: it is."""
    newest, vehicles, show = flight.newest, flight.vehicles, flight.show
    begin = ShowBegin(
        newest,
        vehicles,
        show,
        flight.outside_clock,
        flight.unix_s,
        clock_problem,
        flight.assembled,
        lambda: flight.elsewhere,
    )
    return ShowPlayer(
        newest,
        flight.in_force,
        show,
        vehicles,
        flight.config,
        lambda: flight.elsewhere,
        begin,
        refusals,
        library,
    )


def plan_editor_of(flight: Flight, player: ShowPlayer, maneuvers: Maneuvers, targets: Targets) -> PlanEditor:
    return PlanEditor(
        flight.in_force,
        flight.show,
        flight.vehicles,
        flight.excluded,
        flight.in_formation_m,
        player,
        maneuvers,
        targets,
        asyncio.get_running_loop().time,
    )


def telemetry_monitor_of(flight: Flight, maneuvers: Maneuvers, commands: Commander) -> TelemetryMonitor:
    return TelemetryMonitor(
        flight.newest,
        flight.vehicles,
        flight.links,
        flight.config,
        flight.table,
        flight.note_seen,
        lambda: flight.elsewhere.owned,
        flight.inputs,
        maneuvers,
        ComeBack(flight.show, maneuvers, commands).fly,
    )


def failsafe_monitor_of(
    flight: Flight,
    player: ShowPlayer,
    clock: TickClock,
    commands: Commander,
    maneuvers: Maneuvers,
    targets: Targets,
) -> FailsafeMonitor:
    failsafes = flight.config.failsafes
    counts_selected = failsafes.target_stale.action not in ("ignore", "hold-target")

    def target_age_s() -> float:
        """Of a target that was set, else how long the selected one is silent; NaN: neither is old."""
        age_s = player.target_age_s
        return targets.silent_s if counts_selected and isnan(age_s) else age_s

    return FailsafeMonitor(
        flight.newest,
        flight.vehicles,
        flight.show,
        flight.in_force,
        failsafes,
        flight.table,
        flight.link_delay,
        flight.link_quality,
        flight.unix_s,
        player,
        clock,
        commands,
        maneuvers.running,
        target_age_s,
    )


def show_progress_of(
    flight: Flight,
    maneuvers: Maneuvers,
    commands: Commander,
    reader: ParameterReader,
    failsafes: FailsafeMonitor,
    player: ShowPlayer,
    in_place: InPlaceLandings,
) -> ShowProgress:
    return ShowProgress(
        flight.newest,
        flight.vehicles,
        flight.show,
        flight.assembled,
        lambda: flight.elsewhere,
        maneuvers,
        commands,
        reader,
        failsafes,
        player.begin,
        in_place,
    )
