"""What each part of a flight is given: one function for each part, from the lowest to the highest."""

import asyncio
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from math import isnan

from gcs.flight.commands.commander import Commander
from gcs.flight.commands.plan_editor import PlanEditor, RestoredPlan
from gcs.flight.maneuvers.descent import Descent
from gcs.flight.maneuvers.landing_places import LandingPlaces
from gcs.flight.maneuvers.landings import Landings
from gcs.flight.maneuvers.maneuver_steps import Steps
from gcs.flight.maneuvers.maneuvers import Maneuvers
from gcs.flight.monitors.failsafe_monitor import FailsafeMonitor
from gcs.flight.monitors.telemetry_monitor import TelemetryMonitor
from gcs.flight.preflight.parameter_reader import ParameterReader
from gcs.flight.preflight.preflight_gate import PreflightGate
from gcs.flight.show_progress import ComeBack, ShowProgress
from gcs.flight.shows.show_begin import ShowBegin
from gcs.flight.shows.show_player import ShowPlayer
from gcs.flight.state.flight import Flight
from gcs.flight.state.refusals import Refusals
from gcs.flight.state.targets import Targets
from gcs.flight.state.ticker import TickClock
from gcs.model.interrupted_flight import Interruption
from gcs.shows.library import ShowLibrary
from gcs.shows.service_rules import ServiceRules


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


def plan_editor_of(
    flight: Flight,
    player: ShowPlayer,
    maneuvers: Maneuvers,
    targets: Targets,
    loop_s: Callable[[], float],
) -> PlanEditor:
    return PlanEditor(
        flight.in_force,
        flight.show,
        flight.vehicles,
        flight.excluded,
        flight.in_formation_m,
        player,
        maneuvers,
        targets,
        loop_s,
    )


def commander_of(
    flight: Flight,
    refusals: Refusals,
    places: LandingPlaces,
    maneuvers: Maneuvers,
    preflight: PreflightGate,
    player: ShowPlayer,
    targets: Targets,
    planning: Executor,
    interruption: Interruption | None,
) -> Commander:
    """`planning` runs the planner of the return; `interruption`: the flight before this service began."""
    plans = RestoredPlan(flight.in_force, flight.show, flight.newest, flight.unix_s, player, targets)
    return Commander(flight, refusals, places, maneuvers, player, preflight, planning, plans, interruption)


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
    )
