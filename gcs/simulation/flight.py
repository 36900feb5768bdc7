"""Flies a scenario in virtual time: a formation, or vehicles to goals of their own."""

from collections.abc import Callable

import numpy as np

from gcs.control import Task
from gcs.model.errors import ConfigError
from gcs.model.plan import Formation, Plan
from gcs.simulation import initial_states as layout
from gcs.simulation.article import fly_article
from gcs.simulation.decide import Divide
from gcs.simulation.formation_run import FormationRun
from gcs.simulation.record import FlightRecord
from gcs.simulation.scenario import (
    FormationFlight,
    GoalFlight,
    Scenario,
    ShowFlight,
)
from gcs.simulation.simulated_flight import SimulatedFlight

LINGER_S = 5.0
"""Duration of a flight to goals after the last arrival."""


class GoalRun(SimulatedFlight):
    """A flight of every vehicle to a goal of its own."""

    def __init__(
        self, scenario: Scenario, flight: GoalFlight, count: int, seed: int, divide: Divide | None = None
    ) -> None:
        self.flight = flight
        self._random = np.random.default_rng([seed, 1])
        start_m, goal_m = layout.goals_m(flight, count, self._random)
        middle_m = start_m.mean(axis=0)
        plan = Plan(Formation(10.0, float(-middle_m[2])))
        super().__init__(scenario, start_m, goal_m, plan, seed, divide)
        self.task[:] = Task.GOAL
        self._since_s = np.inf

    def lost_now(self) -> None:
        kept_m = self.floor.widest_m(self.traits.uncertainty_m) + self.flight.arrived_m
        clear = self.losses.apart_m(self.record.goal_m, self.floor) > kept_m
        self.record.expected = ~self.losses.known & clear

    def finished(self) -> bool:
        expected = self.record.expected
        away_m = np.linalg.norm(self.world.position_m - self.record.goal_m, axis=1)[expected].max(initial=0.0)
        self._since_s = min(self._since_s, self.time_s) if away_m < self.flight.arrived_m else np.inf
        return self.time_s - self._since_s > LINGER_S


def fly(
    scenario: Scenario,
    count: int,
    seed: int,
    on_progress: Callable[[float], None] | None = None,
    divide: Divide | None = None,
) -> FlightRecord:
    """Fly a scenario once; `on_progress` as of `SimulatedFlight.fly`; `divide` makes several flights.

    Raises: ConfigError when its start positions or goals are impossible.
    """
    scenario = scenario.in_world_of(seed)
    if isinstance(scenario.flight, FormationFlight):
        return FormationRun(scenario, scenario.flight, count, seed, divide).fly(on_progress)
    if isinstance(scenario.flight, GoalFlight):
        return GoalRun(scenario, scenario.flight, count, seed, divide).fly(on_progress)
    if isinstance(scenario.flight, ShowFlight):
        raise ConfigError(f"{scenario.name}: it flies a show: gcs show plot draws one")
    return fly_article(scenario, scenario.flight, count, seed)
