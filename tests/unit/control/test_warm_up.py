"""After the warm-up nothing is compiled any more: a compiler in the air would stop the setpoints."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import pytest

from gcs.control import ControlSettings, Memory, Task, Tasks, prepare, tick, warm_up
from gcs.formation.orbit import Center
from gcs.model.plan import Formation, Obstacle, Orbit, Plan, Target, Yaw, YawPolicy
from gcs.model.state import Array, FleetState, Traits
from gcs.safety.fenced_areas import FencedArea
from gcs.safety.filter import filter_velocities
from gcs.safety.surroundings import SafetySettings, Surroundings
from gcs.safety.walls import Fence
from tests.support.kernels import signatures

ROAD = np.array([[[30.0, 0.0, -20.0], [30.0, 0.0, 0.0]]])
TOWERS = (
    Obstacle("a", x_m=12.0, y_m=4.0, half_length_x_m=2.0, half_length_y_m=2.0, height_m=40.0),
    Obstacle("b", 20.0, -4.0, 2.0, 2.0, 40.0, velocity_x_m_s=0.5, time_s=0.0),
)


def crowd(count: int, seed: int) -> tuple[Array, Array]:
    """(count, 3) places not far from each other, and velocities."""
    random = np.random.default_rng(seed)
    position_m = random.uniform(-1.0, 1.0, (count, 3)) * 1.6 * count ** (1.0 / 3.0) - (0.0, 0.0, 25.0)
    return position_m, random.normal(0.0, 1.5, (count, 3))


def tasks_of(count: int, *, segments_m: Array) -> Tasks:
    """Most in formation, some to goals, one that is not commanded, one on its way down."""
    task = np.full(count, Task.FORMATION, dtype=np.int8)
    task[count // 2 :] = Task.GOAL
    task[-1] = Task.NONE
    descending = np.zeros(count, dtype=bool)
    descending[-2] = True
    goal_m = crowd(count, 5)[0]
    airborne = np.ones(count, dtype=bool)
    return Tasks(task, goal_m, airborne, descending, segments_m, center_moves=True)


def fly(count: int, *, towers: tuple[Obstacle, ...], yaw: YawPolicy, delay_s: float) -> None:
    """Half a second of everything that a tick can be asked to do."""
    settings = ControlSettings()
    settings = settings.model_copy(
        update={"safety": settings.safety.model_copy(update={"link_delay_s": delay_s})}
    )
    plan = Plan(Formation(10.0, 25.0), Orbit(15.0, 2.0), Target(5.0, 5.0, 0.5, 0.0), towers, Yaw(yaw, 1.0))
    center = Center(np.array([0.0, 0.0, -25.0]), np.array([2.0, 0.0, 0.0]), np.zeros(3))
    memory = replace(Memory.fresh(count, 0.0), center=center, radius_m=10.0)
    for index in range(1, 11):
        position_m, velocity_m_s = crowd(count, index)
        if index == 5:
            position_m[0] = np.nan
        none, ids = np.zeros(count), tuple(f"d{i}" for i in range(count))
        fleet = FleetState(0.05 * index, ids, position_m, velocity_m_s, none, none.copy())
        tasks = tasks_of(count, segments_m=ROAD if index % 2 else np.zeros((0, 2, 3)))
        if index == 6:
            tasks = replace(tasks, goal_m=20.0 * tasks.goal_m)  # far enough to turn early
        if index > 7:
            tasks = replace(tasks, task=np.full(count, Task.FORMATION, dtype=np.int8))
        memory = tick(fleet, tasks, plan, Traits.alike(count, 0.1), memory, settings).memory


def two_head_on(count: int = 100) -> None:
    """The filter leads two of many far off what they want: it looks at what is in their way there."""
    position_m, desired_m_s = np.zeros((count, 3)), np.zeros((count, 3))
    position_m[:] = (0.0, 0.0, -20.0)
    position_m[1:, 0] = 2.6 + 30.0 * np.arange(count - 1)
    desired_m_s[0, 0], desired_m_s[1, 0] = 2.0, -2.0
    everyone = np.ones(count, dtype=bool)
    ids = tuple(f"d{i}" for i in range(count))
    here = Surroundings(
        position_m,
        desired_m_s,
        everyone,
        everyone,
        ~everyone,
        ROAD[:0],
        {},
        ids,
        np.zeros(count),
        np.ones(count),
        np.zeros((count, 3)),
        np.zeros(count),
    )
    filter_velocities(desired_m_s, here, SafetySettings(fence=Fence(distance_max_m=1e4)))


def prepared_site() -> SafetySettings:
    """Within a U, with goals that are not seen; the ground about it is controlled."""
    ring = (-40.0, -40.0), (40.0, -40.0), (40.0, 40.0), (8.0, 40.0), (8.0, -8.0), (-8.0, -8.0), (-8.0, 40.0)
    area = FencedArea(corners_m=(*ring, (-40.0, 40.0)))
    wide = FencedArea(corners_m=((-80.0, -80.0), (80.0, -80.0), (80.0, 80.0), (-80.0, 80.0)))
    safety = SafetySettings(fence=Fence(areas=(area,), controlled_ground=wide))
    prepare(safety)
    return safety


def fly_round_a_corner(safety: SafetySettings) -> bool:
    """One tick; whether the vehicle is led round the corner."""
    place_m, goal_m = np.array([[-20.0, 20.0, -20.0]]), np.array([[20.0, 20.0, -20.0]])
    zero, still_m_s = np.zeros(1), np.zeros((1, 3))
    fleet = FleetState(0.05, ("a",), place_m, still_m_s, zero, zero.copy())
    tasks = replace(Tasks.of_formation(1, center_moves=True), goal_m=goal_m)
    tasks.task[:] = Task.GOAL
    plan, settings = Plan(Formation(10.0, 25.0), Orbit(15.0, 2.0)), ControlSettings(safety=safety)
    ways = tick(fleet, tasks, plan, Traits.alike(1, 0.1), Memory.fresh(1, 0.0), settings).memory.ways
    return ways is not None and bool(np.isfinite(ways.corner_m).all())


def wait_for_a_target(safety: SafetySettings) -> bool:
    """One tick of a formation whose target is in the gap of the U; whether the centre keeps off its wall."""
    place_m, zero = np.array([[-12.0, 20.0, -20.0]]), np.zeros(1)
    fleet = FleetState(0.05, ("a",), place_m, np.zeros((1, 3)), zero, zero.copy())
    center = Center(place_m[0].copy(), np.array([1.0, 0.0, 0.0]), np.zeros(3))
    memory = replace(Memory.fresh(1, 0.0), center=center, radius_m=3.0)
    plan, tasks = (
        Plan(Formation(3.0, 20.0), target=Target(0.0, 20.0)),
        Tasks.of_formation(1, center_moves=True),
    )
    settings = ControlSettings(safety=safety)
    after = tick(fleet, tasks, plan, Traits.alike(1, 0.1), memory, settings).memory.center
    return after is not None and bool(after.velocity_m_s[0] < 1.0)


def compiled_in_the_air() -> list[str]:
    """The kernels that were compiled or loaded, or for other types, only after the warm-up."""
    warm_up()
    site = prepared_site()
    before = signatures()
    if not fly_round_a_corner(site):
        return ["no way was looked up"]
    if not wait_for_a_target(site):
        return ["the centre goes on to a target that is outside"]
    for count in (8, 260):
        fly(count, towers=(), yaw=YawPolicy.HELD, delay_s=0.0)
        fly(count, towers=TOWERS, yaw=YawPolicy.TARGET, delay_s=0.2)
        fly(count, towers=TOWERS, yaw=YawPolicy.FIXED, delay_s=0.0)
    two_head_on()
    return [name for name, many in signatures().items() if many != before.get(name, 0)]


@pytest.mark.long
def test_nothing_is_compiled_in_the_air() -> None:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as fresh:  # other tests compile other types
        assert fresh.submit(compiled_in_the_air).result() == []
