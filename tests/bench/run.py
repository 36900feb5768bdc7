"""`make bench`: speed, each figure beside a named alternative measured in the same run.

Times are medians over many repeats on one core; the ratios are what to compare, as machines differ.
"""

import time
from collections.abc import Callable

import numpy as np

from gcs.control import ControlSettings, Memory, Task, Tasks, tick
from gcs.formation.article import ArticleParameters, formation_force
from gcs.frames import ShowFrame
from gcs.plan import Formation, Plan
from gcs.state import FleetState, Traits
from sim.dynamics import PointMasses, Response, step

REPEATS = 200


def median_ms(once: Callable[[], object]) -> float:
    """Median time of one call, warmed up."""
    once()
    times_s = []
    for _ in range(REPEATS):
        began_s = time.perf_counter()
        once()
        times_s.append(time.perf_counter() - began_s)
    return float(np.median(times_s)) * 1e3


def on_sphere(count: int, radius_m: float) -> FleetState:
    """A fleet spread at random over a sphere that is large enough."""
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    position_m = radius_m * direction + (0.0, 0.0, -radius_m - 10.0)
    ids = tuple(f"d{i}" for i in range(count))
    nothing = np.zeros(count)
    return FleetState(0.05, ids, position_m, np.zeros((count, 3)), nothing, nothing.copy())


def control_tick(count: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """One tick, and beside it the article's law as printed (numpy broadcasting, no safety)."""
    radius_m = 4.0 * count**0.5
    fleet = on_sphere(count, radius_m)
    airborne = np.ones(count, dtype=bool)
    tasks = Tasks(
        np.full(count, Task.FORMATION, dtype=np.int8),
        np.full((count, 3), np.nan),
        airborne,
        ~airborne,
        np.zeros((0, 2, 3)),
    )
    plan = Plan(Formation(radius_m, radius_m + 10.0))
    memory, traits, settings = Memory.fresh(count, 0.0), Traits.alike(count), ControlSettings()
    center_m, printed = np.array([0.0, 0.0, -radius_m - 10.0]), ArticleParameters(radius_m=radius_m)
    return (
        lambda: tick(fleet, tasks, plan, traits, memory, settings),
        lambda: formation_force(fleet.position_m, center_m, traits.charge, printed),
    )


def simulation_step(count: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """One step of the point masses for the whole fleet, and the same vehicle by vehicle."""
    state, response = PointMasses.at(np.zeros((count, 3))), Response()
    one, command = PointMasses.at(np.zeros((1, 3))), np.ones((count, 3))
    return (
        lambda: step(state, command, 0.01, response),
        lambda: [step(one, command[:1], 0.01, response) for _ in range(count)],
    )


def geodesy(count: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """Telemetry to the show frame for the whole fleet, and vehicle by vehicle."""
    frame = ShowFrame(47.4, 8.5, 488.0, 30.0)
    places = np.full(count, 47.401), np.full(count, 8.501), np.full(count, 500.0)
    one = tuple(place[:1] for place in places)
    return (
        lambda: frame.position_m(*places),
        lambda: [frame.position_m(one[0], one[1], one[2]) for _ in range(count)],
    )


def main() -> None:
    """Print the table."""
    rows = [
        *(
            (f"tick, {n} vehicles", "the article's law as printed, no safety", control_tick(n))
            for n in (8, 20, 50)
        ),
        ("point masses, 100 vehicles", "one vehicle at a time", simulation_step(100)),
        ("geodesy, 100 vehicles", "one vehicle at a time", geodesy(100)),
    ]
    print(f"{'what':<28}{'ms':>9}   {'alternative':<42}{'ms':>9}{'ratio':>9}")
    for what, alternative, (ours, other) in rows:
        ours_ms, other_ms = median_ms(ours), median_ms(other)
        print(f"{what:<28}{ours_ms:>9.3f}   {alternative:<42}{other_ms:>9.3f}{ours_ms / other_ms:>9.2f}")


if __name__ == "__main__":
    main()
