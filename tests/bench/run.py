"""`make bench`: speed, each figure beside a named alternative measured in the same run.

The ratios are what to compare, as machines differ. Processor time on one core; the first calls, which may
compile, are not counted. With names as arguments only the rows that contain one of them are measured.
"""

import gc
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyrvo
from numpy.typing import NDArray

from gcs.control import ControlSettings, Memory, Tasks, tick, warm_up
from gcs.control.inputs import FormationState
from gcs.control.others import Others
from gcs.formation.article import ArticleParameters, repulsion_force
from gcs.formation.law import directions_from, goal_velocity
from gcs.formation.orbit import Center
from gcs.formation.repulsion import pushes
from gcs.model.frames import ShowFrame
from gcs.model.plan import MAX_OBSTACLES, Formation, Obstacle, Plan, Target
from gcs.model.state import Array, FleetState, Traits
from gcs.planning.lost_space import swept_segments_m
from gcs.safety.fenced_areas import CORNERS_MAX, FencedArea
from gcs.safety.filter import filter_velocities
from gcs.safety.surroundings import SafetySettings, Surroundings
from gcs.safety.walls import Fence
from gcs.sim.vehicle.dynamics import PointMasses, Response
from gcs.simulation.article import step_virtual
from gcs.simulation.article_forces import formation_force
from gcs.simulation.flight import prepared
from gcs.simulation.scenario import Scenario

WARM_UPS = 3
LONGEST_S = 6.0
"""Of one measurement; slow calls are repeated less often."""


@dataclass(frozen=True, slots=True)
class Timing:
    """How long one call takes."""

    p50_ms: float
    p99_ms: float


def timed(once: Callable[[], object], repeats: int = 400) -> Timing:
    """Processor time of one call, warmed up."""
    for _ in range(WARM_UPS):
        once()
    times_s: list[float] = []
    began_s = time.perf_counter()
    while len(times_s) < repeats and (len(times_s) < 3 or time.perf_counter() - began_s < LONGEST_S):
        call_s = time.process_time()
        once()
        times_s.append(time.process_time() - call_s)
    return Timing(float(np.median(times_s)) * 1e3, float(np.percentile(times_s, 99)) * 1e3)


def on_sphere(count: int, radius_m: float) -> FleetState:
    """A fleet spread nearly evenly over a sphere, with the shaking of a flight."""
    rng = np.random.default_rng(0)
    index = np.arange(count) + 0.5
    z, angle = 1.0 - 2.0 * index / count, np.pi * (3.0 - 5.0**0.5) * index
    ring = np.sqrt(1.0 - z * z)
    direction = np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
    position_m = radius_m * direction + (0.0, 0.0, -radius_m - 10.0) + rng.normal(0.0, 0.2, (count, 3))
    ids = tuple(f"d{i}" for i in range(count))
    velocity_m_s = rng.normal(0.0, 0.3, (count, 3))
    nothing = np.zeros(count)
    return FleetState(0.05, ids, position_m, velocity_m_s, nothing, nothing.copy())


def flying_on(
    count: int,
    radius_m: float,
    plan: Plan,
    lost: Sequence[int] = (),
    *,
    center_moves: bool = True,
    among: tuple[Others, FormationState] | None = None,
    areas: tuple[FencedArea, ...] = (),
    settings: ControlSettings | None = None,
) -> Callable[[], object]:
    """The whole tick of a formation whose vehicles fly what they are commanded, call after call.

    `lost` are rows of vehicles that hold where they are, without their station. `among` are the vehicles of
    other stations, the rest of one sphere, and the formation that another station computes. `areas` are those
    of the fence; `settings` replace all of it.
    """
    others, shared = among or (None, None)
    whole = count if others is None else count + len(others.ids)
    fleet = on_sphere(whole, radius_m)
    tasks = Tasks.of_formation(count, center_moves=center_moves)
    if lost:
        paths_m = [_held_m(fleet.position_m[row]) for row in lost]
        of = np.repeat(np.array(lost), [len(own_m) for own_m in paths_m])
        airborne = np.ones(count, dtype=bool)
        tasks.task[list(lost)], airborne[list(lost)] = 0, False
        tasks = replace(tasks, segments_m=np.concatenate(paths_m), segments_of=of, airborne=airborne)
    fence = Fence(height_max_m=4.0 * radius_m + 100.0, distance_max_m=4.0 * radius_m, areas=areas)
    traits, settings = Traits.alike(count), settings or ControlSettings(safety=SafetySettings(fence=fence))
    memory = [Memory.fresh(whole, 0.0)]
    rng = np.random.default_rng(1)
    shaking_m_s = [rng.normal(0.0, 0.1, (count, 3)) for _ in range(8)]
    shaken = [fleet.position_m[:count] + rng.normal(0.0, 0.1, (count, 3)) for _ in range(8)]
    ids, yaw_rad, age_s = fleet.ids[:count], fleet.yaw_rad[:count].copy(), fleet.age_s[:count].copy()

    def once() -> None:
        now_s = memory[0].time_s + 0.05
        place_m = shaken[round(now_s / 0.05) % len(shaken)].copy()
        flown_m_s = np.nan_to_num(memory[0].desired_m_s[:count])
        flown_m_s += shaking_m_s[round(now_s / 0.05) % len(shaking_m_s)]
        here = FleetState(now_s, ids, place_m, flown_m_s, yaw_rad, age_s)
        memory[0] = tick(here, tasks, plan, traits, memory[0], settings, None, others, shared).memory

    return once


def control_tick(count: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """The whole tick, law and safety, flying on; beside it the article's law as printed, in numpy."""
    radius_m = max(10.0, 1.4 * count**0.5)
    fleet = on_sphere(count, radius_m)
    center_m, printed = np.array([0.0, 0.0, -radius_m - 10.0]), ArticleParameters(radius_m=radius_m)

    def other() -> None:
        for rows in np.array_split(np.arange(count), max(1, count // 1000)):  # as much as memory holds
            broadcast_force(fleet.position_m, rows, center_m, printed)

    return flying_on(count, radius_m, Plan(Formation(radius_m, radius_m + 10.0))), other


def shut_in_tick(count: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """The whole tick inside a ring of 16 boxes with 16 more outside, target beyond; beside it no boxes."""
    radius_m = max(10.0, 1.4 * count**0.5)
    ring_m, rng = 2.0 * radius_m + 15.0, np.random.default_rng(2)
    boxes = []
    for k, turn_rad in enumerate(2.0 * np.pi * np.arange(MAX_OBSTACLES) / (MAX_OBSTACLES / 2)):
        low = k >= MAX_OBSTACLES / 2
        x_m, y_m = (2.0 if low else 1.0) * ring_m * np.array([np.cos(turn_rad), np.sin(turn_rad)])
        half_m = rng.uniform(2.0, 8.0, 2) if low else np.full(2, 0.25 * ring_m)
        height_m = rng.uniform(radius_m + 5.0, radius_m + 40.0) if low else 1e3
        drive_m_s = rng.uniform(-1.0, 1.0, 2) if low else np.zeros(2)
        boxes.append(
            Obstacle(f"box {k}", x_m, y_m, half_m[0], half_m[1], height_m, drive_m_s[0], drive_m_s[1])
        )
    plan = Plan(Formation(radius_m, radius_m + 10.0), target=Target(3.0 * ring_m, 5.0))
    shut_in = replace(plan, obstacles=tuple(boxes))
    return flying_on(count, radius_m, shut_in), flying_on(count, radius_m, plan)


def lost_tick(count: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """The whole tick with a quarter of the vehicles lost, as of one station of four; beside it with none."""
    radius_m = max(10.0, 1.4 * count**0.5)
    plan, lost = Plan(Formation(radius_m, radius_m + 10.0)), range(0, count, 4)
    some, none = (flying_on(count, radius_m, plan, each, center_moves=False) for each in (lost, ()))
    return some, none


def fenced_tick(count: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """The whole tick within one area of 64 corners and beside three more; beside it without areas."""
    radius_m = max(10.0, 1.4 * count**0.5)
    plan = Plan(Formation(radius_m, radius_m + 10.0))
    turn_rad = 2.0 * np.pi * np.arange(CORNERS_MAX) / CORNERS_MAX
    ring = np.stack([np.cos(turn_rad), np.sin(turn_rad)], axis=1)
    beside_m = [(radius_m + 9.0) * np.array(side) for side in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0))]
    rings_m = [(radius_m + 20.0) * ring, *(side_m + 5.0 * ring for side_m in beside_m)]
    areas = tuple(
        FencedArea(corners_m=tuple((x_m, y_m) for x_m, y_m in ring_m.tolist()), inside=at == 0)
        for at, ring_m in enumerate(rings_m)
    )
    return flying_on(count, radius_m, plan, areas=areas), flying_on(count, radius_m, plan)


def station_tick(count: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """The whole tick of a station that follows, with a quarter of the vehicles; beside it those alone."""
    radius_m = max(10.0, 1.4 * count**0.5)
    fleet, own = on_sphere(count, radius_m), count // 4
    plan, elsewhere = Plan(Formation(radius_m, radius_m + 10.0)), count - own
    center = Center(np.array([0.0, 0.0, -radius_m - 10.0]), np.zeros(3), np.zeros(3))
    place = directions_from(fleet.position_m, center.position_m)[0]
    shared = FormationState(center, radius_m, 0.0, {}, place)
    everyone = np.ones(elsewhere, dtype=np.bool_)
    theirs = Others(
        fleet.ids[own:],
        fleet.position_m[own:].copy(),
        fleet.velocity_m_s[own:].copy(),
        fleet.velocity_m_s[own:].copy(),
        fleet.velocity_m_s[own:].copy(),
        np.zeros(elsewhere),
        np.ones(elsewhere),
        everyone,
        everyone,
        ~everyone,
        np.zeros((0, 2, 3)),
        np.zeros(0, np.intp),
    )
    return flying_on(own, radius_m, plan, among=(theirs, shared)), flying_on(own, radius_m, plan)


def _held_m(position_m: Array) -> Array:
    """(k, 2, 3) paths of a lost vehicle that holds, and lands when its battery is low."""
    return swept_segments_m(position_m, np.zeros(3), position_m * (1.0, 1.0, 0.0), "hold", 30.0)


def broadcast_force(
    position_m: Array, rows: NDArray[np.intp], center_m: Array, printed: ArticleParameters
) -> Array:
    """The article's combined law for some rows, by numpy broadcasting over all pairs."""
    own_m = position_m[rows]
    offset_m = own_m[:, None] - position_m[None]
    distance_m = np.sqrt((offset_m**2).sum(axis=2))
    distance_m[np.arange(len(rows)), rows] = np.inf
    repulsion: Array = printed.repulsion_gain * (offset_m / distance_m[:, :, None] ** 3).sum(axis=1)
    from_center_m = own_m - center_m
    excess_m2 = (from_center_m**2).sum(axis=1, keepdims=True) - printed.radius_m**2
    pull: Array = printed.sphere_gain * from_center_m * excess_m2
    return repulsion - pull


def sphere_pushes(count: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """The repulsion of one sweep of the slots; beside it the article's, over all pairs."""
    direction, _ = directions_from(on_sphere(count, 100.0).position_m, np.array([0.0, 0.0, -110.0]))
    charge = np.ones(count)
    return lambda: pushes(direction, charge), lambda: repulsion_force(direction, charge, gain=1.0)


def flat_filter(count: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """The filter on a flat ring whose drones all want to the other side; beside it pyrvo (2D)."""
    radius_m = 6.0 * count / (2.0 * np.pi)
    angle = 2.0 * np.pi * np.arange(count) / count
    position_m = 0.35 * radius_m * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    position_m[:, 2] = -20.0
    goal_m = position_m * (-1.0, -1.0, 1.0)
    settings = ControlSettings()
    limits_m_s = settings.safety.limits.each_m_s
    desired_m_s = goal_velocity(position_m, goal_m, settings=settings.law, limits_m_s=limits_m_s)
    everyone = np.ones(count, dtype=bool)
    names = [f"d{i}" for i in range(count)]
    here = Surroundings(
        position_m,
        desired_m_s,
        everyone,
        everyone,
        ~everyone,
        np.zeros((0, 2, 3)),
        {},
        names,
        np.zeros(count),
        np.full(count, np.inf),
        np.zeros((count, 3)),
        np.zeros(count),
    )
    simulator = pyrvo.RVOSimulator()
    simulator.set_time_step(1e-9)  # so that it stays where it is
    simulator.set_agent_defaults(20.0, 10, 5.0, 5.0, settings.safety.floor.horizontal_m / 2.0, 4.0)
    for row in range(count):
        agent = simulator.add_agent(tuple(position_m[row, :2].tolist()))
        simulator.set_agent_velocity(agent, tuple(desired_m_s[row, :2].tolist()))
        simulator.set_agent_pref_velocity(agent, tuple(desired_m_s[row, :2].tolist()))
    return lambda: filter_velocities(desired_m_s, here, settings.safety), simulator.do_step


def simulated_assembly(
    count: int, seconds: float = 30.0
) -> tuple[Callable[[], object], Callable[[], object]]:
    """Assembly in virtual time; beside it as many seconds of the article's own law and dynamics."""
    scenario = Scenario.load("assembly").with_(duration_s=seconds)
    printed, center_m = ArticleParameters(radius_m=14.0), np.array([0.0, 0.0, -24.0])
    start_m = on_sphere(count, 14.0).position_m

    def other() -> None:
        place_m, velocity_m_s = start_m, np.zeros_like(start_m)
        for _ in range(round(seconds * 20)):
            force_n = formation_force(place_m, center_m, np.ones(count), printed)
            place_m, velocity_m_s = step_virtual(place_m, velocity_m_s, force_n, 0.05, printed)

    return lambda: prepared(scenario, count, 1).fly(), other


def simulation_step(count: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """One step of the point masses for the whole fleet, and the same vehicle by vehicle."""
    fleet, one = (PointMasses(np.zeros((n, 3)), 0.01, Response()) for n in (count, 1))
    command = np.ones((count, 3))

    def each() -> None:
        for _ in range(count):
            one.step(command[:1])

    return lambda: fleet.step(command), each


def geodesy(count: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """Telemetry to the show frame for the whole fleet, and vehicle by vehicle."""
    frame = ShowFrame(47.4, 8.5, 488.0, 30.0)
    places = np.full(count, 47.401), np.full(count, 8.501), np.full(count, 500.0)
    one = tuple(place[:1] for place in places)
    return (
        lambda: frame.position_m(*places),
        lambda: [frame.position_m(one[0], one[1], one[2]) for _ in range(count)],
    )


SIMULATED_S = 30.0
ROWS: tuple[tuple[str, str, Callable[[int], tuple[Callable[[], object], Callable[[], object]]], int], ...] = (
    *(
        ("tick, law + safety", "the article's law as printed, numpy, no safety", control_tick, count)
        for count in (8, 100, 1_000, 10_000)
    ),
    *(("tick, 32 boxes, no way", "the tick without boxes", shut_in_tick, count) for count in (8, 1_000)),
    *(("tick, a quarter lost", "the tick with none lost", lost_tick, count) for count in (100, 1_200)),
    *(("tick, 256 corners", "the tick without areas", fenced_tick, count) for count in (50, 200, 1_000)),
    ("tick, 3/4 elsewhere", "the tick of a quarter alone", station_tick, 1_200),
    *(("pushes of a sweep", "article, all pairs", sphere_pushes, count) for count in (1_000, 10_000)),
    *(("filter, flat ring", "pyrvo (ORCA, 2D only)", flat_filter, count) for count in (20, 100)),
    ("assembly, 30 s", "the article's law and dynamics, 20 Hz, numpy", simulated_assembly, 100),
    ("point masses, a step", "one vehicle at a time", simulation_step, 100),
    ("geodesy", "one vehicle at a time", geodesy, 100),
)


def main(desired: list[str]) -> None:
    """Print the table. As in the service, kernels are loaded before, and the collector skips all modules."""
    warm_up()
    gc.freeze()
    print(f"{'what':<22}{'N':>7}{'p50 ms':>10}{'p99 ms':>10}   {'alternative':<48}{'p50 ms':>10}{'ratio':>9}")
    ticks: dict[int, Timing] = {}
    for what, alternative, make, count in ROWS:
        if desired and not any(name in what for name in desired):
            continue
        ours, other = (timed(call) for call in make(count))
        figures = f"{ours.p50_ms:>10.3f}{ours.p99_ms:>10.3f}   {alternative:<48}{other.p50_ms:>10.3f}"
        print(f"{what:<22}{count:>7}{figures}{ours.p50_ms / other.p50_ms:>9.2f}", flush=True)
        if what == "tick, law + safety":
            ticks[count] = ours
        if what.startswith("assembly"):
            print(f"{'':<22}{'':>7}{SIMULATED_S / ours.p50_ms * 1e3:>10.0f} x real time")
    if {1_000, 10_000} <= ticks.keys():
        few, many = ticks[1_000], ticks[10_000]
        p50, p99 = np.log10(many.p50_ms / few.p50_ms), np.log10(many.p99_ms / few.p99_ms)
        print(
            f"from 1,000 to 10,000 vehicles the tick grows as N^{p50:.2f}, its p99 as N^{p99:.2f};", end=" "
        )
        print("10,000 fly at 5 Hz")


if __name__ == "__main__":
    main(sys.argv[1:])
