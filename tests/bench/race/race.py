"""`make race`: the same scenarios with published methods and with ours; the table and plot of docs/race.md.

`python -m tests.bench.race.race swap-random` flies these scenarios alone, and prints the table.
"""

import argparse
import re
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from gcs.control import Task, Tasks
from gcs.model.state import Array, FleetState, Mask, Setpoints
from gcs.simulation import scenario as scenarios
from gcs.simulation.decide import Decided
from gcs.simulation.flight import GoalRun
from gcs.simulation.metrics import metrics
from gcs.simulation.scenario import GoalFlight, Scenario
from tests.bench.race.methods import Barrier, Memoryless, Method, Rvo2, Straight, orca, voronoi_cells

PAGE: Final = Path(__file__).parents[3] / "docs" / "race.md"
PLOT: Final = PAGE.with_suffix(".png")
TABLE: Final = re.compile(r"(<!-- race -->\n).*?(<!-- end -->)", re.DOTALL)
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
FLAT: Final = {"crossing", "head-on"}
MODELS: Final = ("ideal", "fitted", "cascade")
"""Vehicles that have their velocity at once; PX4 as recorded; PX4's own cascade with its default gains."""
LIMIT_S: Final = 300.0
"""Three times the straight line of the longest."""


@dataclass(frozen=True, slots=True)
class Heat:
    """One flight of the race."""

    scenario: str
    vehicles: int
    model: str
    method: str
    seed: int = 1


RACE: Final = tuple(
    Heat(scenario, vehicles, model, method)
    for scenario, vehicles, models in (
        ("swap-212", 212, MODELS),
        ("swap-212-delayed", 212, ("fitted",)),
        ("swap-812", 812, ("fitted",)),
        ("swap-random", 50, MODELS),
        ("swap-random", 100, ("fitted",)),
        ("swap-random", 200, ("fitted",)),
        ("swap-random-delayed", 50, ("fitted",)),
        ("swap-lost", 50, ("fitted",)),
        ("crossing", 32, ("fitted",)),
        ("head-on", 16, ("fitted",)),
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


class MethodRun(GoalRun):
    """A flight to goals in which a method of others decides instead of our law and filter."""

    def __init__(self, scenario: Scenario, flight: GoalFlight, heat: Heat) -> None:
        super().__init__(scenario, flight, heat.vehicles, heat.seed)
        floor = self.floor
        floor_m = floor.horizontal_m if heat.scenario in FLAT else max(floor.horizontal_m, floor.vertical_m)
        self._method = METHODS[heat.method](floor_m + SPARE_M, self.world.tick_s)

    def _decide(self, fleet: FleetState, tasks: Tasks, *_: object) -> Decided:
        rows = np.flatnonzero(tasks.task == Task.GOAL)
        speed_m_s = self.settings.law.speed_m_s
        state = fleet.position_m[rows], fleet.velocity_m_s[rows], self.goal_m[rows]
        began_s = time.thread_time()
        velocity_m_s = self._method.velocity_m_s(*state, speed_m_s)
        took_s = time.thread_time() - began_s
        names = tuple(fleet.ids[row] for row in rows)
        setpoints = Setpoints(fleet.time_s, names, velocity_m_s, np.zeros(len(rows)))
        return Decided(setpoints, self.memory, ("",) * len(fleet.ids), (took_s,))


def flown(heat: Heat) -> dict[str, Any]:
    """Fly one heat. Returns: what the table shows of it."""
    scenario = scenarios.load(scenarios.find(heat.scenario)).in_world_of(heat.seed)
    vehicle = "fitted" if heat.model == "ideal" else heat.model
    world = scenario.world.model_copy(update={"vehicle": vehicle})
    limit_s = min(LIMIT_S, scenario.duration_s)
    scenario = scenario.model_copy(update={"world": world, "worlds": (), "duration_s": limit_s})
    flight = scenario.flight
    assert isinstance(flight, GoalFlight)
    run = (
        GoalRun(scenario, flight, heat.vehicles, heat.seed)
        if heat.method == OURS
        else MethodRun(scenario, flight, heat)
    )
    if heat.model == "ideal":
        run.world.bodies = Points(run.world.position_m, run.world.step_s)
    record = run.fly()
    figures, path_m, rows = metrics(record), record.path_m, record.expected
    way_m, straight_m = np.diff(path_m, axis=0), np.linalg.norm(record.goal_m - record.start_m, axis=1)
    there = np.linalg.norm(path_m - record.goal_m, axis=2) < flight.arrived_m
    took_s = np.where(there.any(axis=0), there.argmax(axis=0) * run.world.tick_s, np.inf)
    ratio = (took_s * run.settings.law.speed_m_s / straight_m)[rows]
    return {
        "closest_m": figures.separation.minimum_m,
        "violations": figures.separation.violations,
        "floor_m": record.floor_m,
        "arrived": int(np.isfinite(ratio).sum()),
        "expected": int(rows.sum()),
        "median": float(np.median(ratio)),
        "worst": float(ratio.max()),
        "way": float(np.median((np.linalg.norm(way_m, axis=2).sum(axis=0) / straight_m)[rows])),
        "tick_ms": 1e3 * float(np.median(record.tick_s)),
        "p99_ms": 1e3 * float(np.quantile(record.tick_s, 0.99)),
    }


COLUMNS: Final = (
    "scenario",
    "N",
    "vehicle",
    "method",
    "closest, m",
    "pairs",
    "arrived",
    "median",
    "worst",
    "way",
    "tick, ms",
)


def row(heat: Heat, of: Mapping[str, Any]) -> str:
    """A line of the table."""
    cells = [heat.scenario, str(heat.vehicles), heat.model, heat.method]
    cells += [f"{of['closest_m']:.2f}", str(of["violations"]), f"{of['arrived']}/{of['expected']}"]
    cells += ["never" if not np.isfinite(of[key]) else f"{of[key]:.2f}" for key in ("median", "worst")]
    cells += [f"{of['way']:.2f}", f"{of['tick_ms']:.2f} / {of['p99_ms']:.2f}"]
    return f"| {' | '.join(cells)} |"


def table(results: Mapping[Heat, Mapping[str, Any]]) -> str:
    ruler = ["---" if name in {"scenario", "vehicle", "method"} else "---:" for name in COLUMNS]
    lines = [f"| {' | '.join(cells)} |" for cells in (COLUMNS, ruler)]
    return "\n".join([*lines, *(row(heat, of) for heat, of in results.items())])


LATEST, FARTHEST = 2.2, 2.0
"""What is later or farther apart is drawn at the edge."""


def plot(results: Mapping[Heat, Mapping[str, Any]], file: Path) -> None:
    """Draw the closest pair against the median time of arrival, of vehicles that are no ideal ones."""
    page = Figure(figsize=(9.0, 5.0), layout="constrained")
    axes = page.add_subplot()
    colours = dict(zip((OURS, *METHODS), mpl.colormaps["tab10"].colors, strict=False))  # type: ignore[attr-defined]
    for heat, of in results.items():
        if heat.model == "ideal":
            continue
        place = min(of["median"], LATEST), min(of["closest_m"] / of["floor_m"], FARTHEST)
        marker = "o" if of["arrived"] == of["expected"] else "x"
        axes.scatter(*place, color=colours[heat.method], marker=marker, s=40, alpha=0.8)
    for method, colour in colours.items():
        axes.scatter([], [], color=colour, label=method)
    axes.axhline(1.0, color="0.3", linestyle="--", linewidth=0.8)
    axes.set(
        xlabel="median time of arrival over the straight way (at the edge: later; x: not all arrived)",
        ylabel="closest pair over the floor",
        title="Each point is one flight; below the line two came nearer than they may",
    )
    axes.legend(fontsize=8)
    page.savefig(file, dpi=110)


def main(names: list[str], methods: list[str]) -> None:
    heats = [heat for heat in RACE if heat.scenario in (names or [heat.scenario])]
    heats = [heat for heat in heats if heat.method in (methods or [heat.method])]
    results = {}
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        for heat, of in zip(heats, pool.map(flown, heats), strict=True):
            results[heat] = of
            print(row(heat, of), flush=True)
    if not names and not methods:
        PAGE.write_text(
            TABLE.sub(partial(_filled, table(results)), PAGE.read_text(encoding="utf-8")), encoding="utf-8"
        )
        plot(results, PLOT)


def _filled(text: str, found: re.Match[str]) -> str:
    return f"{found[1]}\n{text}\n\n{found[2]}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="*")
    parser.add_argument("--method", action="append", default=[], choices=(OURS, *METHODS))
    asked = parser.parse_args()
    main(asked.scenario, asked.method)
