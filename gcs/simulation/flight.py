"""Flies a scenario in virtual time: a formation, vehicles to goals of their own, a show, or the article."""

from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np

from gcs.control import Task
from gcs.model.errors import InvalidError, quoted
from gcs.model.plan import Formation, Plan
from gcs.model.state import Mask
from gcs.shows import find, load
from gcs.simulation import initial_states as layout
from gcs.simulation.article import ArticleRun
from gcs.simulation.decide import Divide
from gcs.simulation.drawn_traffic import loaded_traffic
from gcs.simulation.formation_run import FormationRun
from gcs.simulation.metrics import FlightMetrics, metrics
from gcs.simulation.random_sites import drawn_site, places_m
from gcs.simulation.record import FlightDetails
from gcs.simulation.rehearsal import Rehearsal
from gcs.simulation.result import FlightResult
from gcs.simulation.scenario import (
    VEHICLES_MAX,
    FormationFlight,
    GoalFlight,
    Scenario,
    ShowFlight,
)
from gcs.simulation.show_runs import show_metrics
from gcs.simulation.simulated_flight import SimulatedFlight

SEED_MAX: Final = 2**63 - 1

LINGER_S = 5.0
"""Duration of a flight to goals after the last arrival."""


class GoalRun(SimulatedFlight):
    """A flight of every vehicle to a goal of its own."""

    def __init__(
        self, scenario: Scenario, flight: GoalFlight, count: int, seed: int, divide: Divide | None = None
    ) -> None:
        self.flight = flight
        self._random = np.random.default_rng([seed, 1])
        if flight.site is None:
            start_m, goal_m = layout.goals_m(flight, count, self._random)
        else:
            drawn = drawn_site(scenario, flight.site, self._random)
            scenario, out = drawn.scenario, round(flight.site.outside_share * count)
            start_m = places_m(drawn, flight.site, count, flight.spacing_m, self._random, out)
            goal_m = places_m(drawn, flight.site, count, flight.spacing_m, self._random)
        middle_m = start_m.mean(axis=0)
        plan = Plan(Formation(10.0, float(-middle_m[2])), obstacles=layout.obstacles_of(flight.boxes))
        super().__init__(scenario, start_m, goal_m, plan, seed, divide)
        self.task[:] = Task.GOAL
        self._since_s = np.inf

    @property
    def steered(self) -> Mask:
        own = (self.goal_m == self.record.goal_m).all(axis=1)  # a failsafe gives another
        return np.asarray((self.task == Task.GOAL) & own)

    def lost_now(self) -> None:
        kept_m = self.floor.widest_m(self.traits.uncertainty_m) + self.flight.arrived_m
        clear = self.losses.apart_m(self.record.goal_m, self.floor) > kept_m
        self.record.expected = ~self.losses.known & clear

    def finished(self) -> bool:
        expected = self.record.expected
        away_m = np.linalg.norm(self.world.position_m - self.record.goal_m, axis=1)[expected].max(initial=0.0)
        self._since_s = min(self._since_s, self.time_s) if away_m < self.flight.arrived_m else np.inf
        return self.time_s - self._since_s > LINGER_S


def whole_number(name: str, value: object, least: int, most: int) -> int:
    """The argument of that name as an integer. Raises: InvalidError when it is none, or beyond the bounds."""
    shown: object = quoted(value)
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        if least <= value <= most and value == int(value):
            return int(value)
        shown = value
    raise InvalidError(name, shown, f"a whole number, at least {least}, at most {most}")


def require_scenario(value: object) -> None:
    """Raises: InvalidError for anything else, such as its name."""
    if not isinstance(value, Scenario):
        raise InvalidError("scenario", quoted(value), 'a Scenario, such as Scenario.load("assembly")')


def _require_function(name: str, value: object, such_as: str) -> None:
    if not (value is None or callable(value)):
        raise InvalidError(name, quoted(value), f"a function, such as {such_as}, or None")


Prepared: TypeAlias = SimulatedFlight | ArticleRun


def prepared(
    scenario: Scenario, vehicles: int | None = None, seed: int = 1, divide: Divide | None = None
) -> Prepared:
    """A flight that can be flown once, by `fly`; arguments and errors as of the function `fly`."""
    require_scenario(scenario)
    vehicles = scenario.judged.vehicles[0] if vehicles is None else vehicles
    vehicles = whole_number("vehicles", vehicles, 1, VEHICLES_MAX)
    seed = whole_number("seed", seed, 0, SEED_MAX)
    _require_function("divide", divide, "gcs.site.simulated.SimulatedStations")
    scenario = scenario.in_world_of(seed)
    flight = scenario.flight
    if isinstance(flight, FormationFlight):
        return FormationRun(scenario, flight, vehicles, seed, divide)
    if isinstance(flight, GoalFlight):
        return GoalRun(scenario, flight, vehicles, seed, divide)
    if isinstance(flight, ShowFlight):
        made = None if flight.traffic is None else loaded_traffic(flight.traffic, vehicles, seed)
        return Rehearsal(made or load(find(flight.show)), scenario.world, seed, flight)
    return ArticleRun(scenario, flight, vehicles, seed)


def measured(scenario: Scenario, flight: Prepared) -> FlightMetrics:
    """The figures of a flight of the scenario that was flown."""
    return show_metrics(scenario, flight) if isinstance(flight, Rehearsal) else metrics(flight.record)


def fly(
    scenario: Scenario,
    vehicles: int | None = None,
    seed: int = 1,
    *,
    on_progress: Callable[[float], None] | None = None,
    divide: Divide | None = None,
) -> FlightResult:
    """Fly a scenario once, in virtual time, with the code of real flights.

    Args:
        scenario: what is flown, in which world.
        vehicles: their number; None: the first with which the scenario is judged. A show has its own.
        seed: of everything random, and of which of the scenario's `worlds` it is.
        on_progress: called after every tick with the share that is flown, from 0 to 1.
        divide: for a scenario whose vehicles several stations divide: `gcs.site.simulated.SimulatedStations`.

    Raises:
        InvalidError: an argument of another kind, no such number of vehicles, or no such seed.
        ConfigError: the start positions, goals or the radius are impossible.
    """
    _require_function("on_progress", on_progress, "print")
    flight = prepared(scenario, vehicles, seed, divide)
    flight.record.details = FlightDetails()
    flight.fly(on_progress)
    return FlightResult.of(flight.record, measured(scenario, flight))
