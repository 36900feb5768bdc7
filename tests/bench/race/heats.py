"""The flights of the race, and how each is flown: scenarios beside this module, or those that are shipped."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from gcs.control import Task, Tasks
from gcs.model.response import FleetResponse, Response
from gcs.model.state import Array, FleetState, Mask, Setpoints
from gcs.simulation import scenario as scenarios
from gcs.simulation.decide import Decided
from gcs.simulation.flight import GoalRun
from gcs.simulation.metrics import metrics
from gcs.simulation.scenario import GoalFlight, Scenario
from tests.bench.race.crazyflies import Crazyflies, crazyflow_version
from tests.bench.race.methods import Barrier, Memoryless, Method, Rvo2, Straight, orca, voronoi_cells

OURS: Final = "ours"
METHODS: Final[Mapping[str, Callable[[float, float], Method]]] = {
    "ORCA": lambda apart_m, _: Memoryless(orca, apart_m),
    "buffered Voronoi": lambda apart_m, _: Memoryless(voronoi_cells, apart_m),
    "CBF-QP": Barrier,
    "straight": lambda *_: Straight(),
    "RVO2 (pyrvo)": lambda apart_m, _: Rvo2(apart_m),
}
"""By the least distance of two, m, and the time of a tick, s."""
SPARE_M: Final = 0.2
"""Beyond the floor, as RVO2-3D's example has it."""
FLAT: Final = {"crossing", "head-on", "corridor"}
"""Scenarios in which all keep one height: the library of ORCA's authors flies them as well."""
IDEAL: Final = "ideal"
"""Vehicles that have their velocity at once."""
BOTH: Final = "fitted", "cascade"
"""PX4 as recorded; PX4's own cascade with its default gains."""
CRAZYFLOW: Final = "crazyflow"
"""Crazyflies, by a model that is not ours."""
AT_ONCE: Final = Response(loop_share=0.0, lead_share=0.0, trim_share=0.0)
"""The profile, for our law and filter, of vehicles that soon have the velocity that is asked for."""
LIMIT_S: Final = 300.0
"""Three times the straight line of the longest."""
SLOW_HZ: Final = 10.0
"""Rate of the ticks of `MANY` vehicles or more, by all methods; RVO2-3D's own example has 8."""
MANY: Final = 500
LOOKS: Final = 20
"""Ticks between two looks at the processor time."""
STOPPED_S: Final = 60.0
"""Processor time after which a flight is stopped."""


@dataclass(frozen=True, slots=True)
class Heat:
    """One flight of the race."""

    scenario: str
    vehicles: int
    model: str
    method: str
    seed: int = 1

    def can_be_flown(self) -> bool:
        return self.model != CRAZYFLOW or bool(crazyflow_version())

    def load(self) -> Scenario:
        """The scenario as this heat flies it."""
        file = Path(__file__).with_name(f"{self.scenario}.yaml")
        path = file if file.is_file() else scenarios.find(self.scenario)
        scenario = scenarios.load(path).in_world_of(self.seed)
        vehicle = self.model if self.model in BOTH else "fitted"
        world = scenario.world.model_copy(update={"vehicle": vehicle})
        if self.vehicles >= MANY:
            world = world.model_copy(update={"tick_rate_hz": SLOW_HZ})
        limit_s = min(LIMIT_S, scenario.duration_s)
        return scenario.model_copy(update={"world": world, "worlds": (), "duration_s": limit_s})


RACE: Final = tuple(
    Heat(scenario, vehicles, model, method)
    for scenario, vehicles, models in (
        ("swap-212", 212, (IDEAL, *BOTH, CRAZYFLOW)),
        ("swap-212-delayed", 212, ("fitted",)),
        ("swap-812", 812, ("fitted",)),
        ("swap-random", 50, (IDEAL, *BOTH, CRAZYFLOW)),
        ("swap-random", 100, ("fitted",)),
        ("swap-random", 200, ("fitted",)),
        ("swap-random-delayed", 50, ("fitted",)),
        ("goals-late", 50, BOTH),
        ("goals-uncertain", 50, BOTH),
        ("swap-lost", 50, BOTH),
        ("crossing", 32, ("fitted",)),
        ("head-on", 16, ("fitted",)),
        ("corridor", 16, BOTH),
        ("goals-boxes", 50, BOTH),
    )
    for model in models
    for method in (OURS, *METHODS)
    if method != "RVO2 (pyrvo)" or scenario in FLAT
)


class Points:
    """Vehicles that have the velocity that is asked for at once."""

    def __init__(self, start_m: Array, step_s: float) -> None:
        self.position_m, self.velocity_m_s, self._step_s = np.array(start_m), np.zeros_like(start_m), step_s

    def step(self, command_m_s: Array, wind_m_s: Array, error_m_s: Array) -> Array:
        self.velocity_m_s = np.array(command_m_s)
        self.position_m = self.position_m + self._step_s * self.velocity_m_s
        return self.position_m

    def rest(self, rows: Mask, place_m: Array) -> None:
        self.position_m[rows], self.velocity_m_s[rows] = place_m[rows], 0.0


class RacedRun(GoalRun):
    """A flight to goals that is stopped when it has taken too long: by our law and filter."""

    def __init__(self, heat: Heat) -> None:
        scenario = heat.load()
        flight = scenario.flight
        assert isinstance(flight, GoalFlight)
        super().__init__(scenario, flight, heat.vehicles, heat.seed)
        if heat.model not in BOTH:
            response = FleetResponse.of([AT_ONCE] * heat.vehicles)
            self.traits = replace(self.traits, response=response)
        if heat.model == IDEAL:
            self.world.bodies = Points(self.world.position_m, self.world.step_s)
        elif heat.model == CRAZYFLOW:
            self.world.bodies = Crazyflies(self.world.position_m, self.world.step_s)
        self.began_s = time.process_time()
        self.stopped = False

    def finished(self) -> bool:
        if len(self.record.time_s) % LOOKS == 0:
            self.stopped = time.process_time() - self.began_s > STOPPED_S
        return self.stopped or super().finished()


class MethodRun(RacedRun):
    """A flight to goals in which a method of others decides instead of our law and filter."""

    def __init__(self, heat: Heat) -> None:
        super().__init__(heat)
        floor = self.floor
        floor_m = floor.horizontal_m if heat.scenario in FLAT else max(floor.horizontal_m, floor.vertical_m)
        self._method = METHODS[heat.method](floor_m + SPARE_M, self.world.tick_s)

    def _decide(self, fleet: FleetState, tasks: Tasks, *_: object) -> Decided:
        rows = np.flatnonzero(tasks.task == Task.GOAL)
        speed_m_s = self.settings.law.speed_m_s
        state = fleet.position_m[rows], fleet.velocity_m_s[rows], self.goal_m[rows]
        boxes = np.array(
            [
                (
                    *box.position_m(self.time_s),
                    box.half_length_x_m,
                    box.half_length_y_m,
                    box.height_m,
                    box.velocity_x_m_s,
                    box.velocity_y_m_s,
                )
                for box in self.plan.obstacles
            ]
        ).reshape(-1, 7)
        began_s = time.thread_time()
        velocity_m_s = self._method.velocity_m_s(*state, speed_m_s, boxes)
        took_s = time.thread_time() - began_s
        names = tuple(fleet.ids[row] for row in rows)
        setpoints = Setpoints(fleet.time_s, names, velocity_m_s, np.zeros(len(rows)))
        return Decided(setpoints, self.memory, ("",) * len(fleet.ids), (took_s,))


def flown(heat: Heat) -> dict[str, Any]:
    """Fly one heat. Returns: what the table shows of it."""
    run = RacedRun(heat) if heat.method == OURS else MethodRun(heat)
    record = run.fly()
    figures, path_m, rows = metrics(record), record.path_m, record.expected
    way_m, straight_m = np.diff(path_m, axis=0), np.linalg.norm(record.goal_m - record.start_m, axis=1)
    there = np.linalg.norm(path_m - record.goal_m, axis=2) < run.flight.arrived_m
    took_s = np.where(there.any(axis=0), there.argmax(axis=0) * run.world.tick_s, np.inf)
    ratio = (took_s * run.settings.law.speed_m_s / straight_m)[rows]
    boxes = figures.obstacles
    return {
        "closest_m": figures.separation.minimum_m,
        "violations": figures.separation.violations,
        "penetrations": None if boxes is None else boxes.penetrations,
        "floor_m": record.floor_m,
        "arrived": int(np.isfinite(ratio).sum()),
        "expected": int(rows.sum()),
        "stopped_s": run.time_s if run.stopped else None,
        "median": float(np.median(ratio)),
        "worst": float(ratio.max()),
        "way": float(np.median((np.linalg.norm(way_m, axis=2).sum(axis=0) / straight_m)[rows])),
        "tick_ms": 1e3 * float(np.median(record.tick_s)),
        "p99_ms": 1e3 * float(np.quantile(record.tick_s, 0.99)),
        "took_s": time.process_time() - run.began_s,
    }
