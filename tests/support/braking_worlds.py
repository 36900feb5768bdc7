"""Random worlds in which vehicles of both autopilots are sent against the fence, walls and the floor."""

from dataclasses import dataclass

import numpy as np

from gcs.control import ControlSettings, Memory, Task, Tasks, tick
from gcs.model.plan import Formation, Obstacle, Plan
from gcs.model.state import Array, Traits
from gcs.safety.surroundings import Limits, SafetySettings
from gcs.safety.walls import Fence, nearest_way_out
from gcs.simulation.autopilots import responses
from gcs.simulation.scenario import Wind, World
from gcs.simulation.world import TrueWorld

VEHICLES = 6
LEG_S, LEGS = 9.0, 2
"""Each vehicle is sent to so many places beyond what it must not pass, for so long each."""

FENCE = Fence(height_min_m=4.0, height_max_m=34.0, distance_max_m=40.0)
BEYOND_M = 30.0


@dataclass(frozen=True, slots=True)
class Passed:
    """How far a true position was at worst beyond each wall, m; negative: never beyond."""

    low: float
    high: float
    far: float
    inside_box: float

    @property
    def worst_m(self) -> float:
        return max(self.low, self.high, self.far, self.inside_box)


def flown(seed: int, autopilots: tuple[str, ...] = ("px4", "ardupilot")) -> Passed:
    """Fly one world: its ramp, delay, drag, speeds and box are drawn from the seed."""
    random = np.random.default_rng(seed)
    delay_s = float(random.choice([0.0, 0.05, 0.1, 0.2]))
    world = World(
        autopilots=autopilots,
        ramp_m_s2=float(random.choice([1.0, 2.5, 5.0])),
        upright_ramp_m_s2=float(random.choice([2.5, 3.5])),
        drag_per_s=float(random.uniform(0.2, 1.0)),
        telemetry_delay_s=delay_s,
        setpoint_delay_s=delay_s,
        loss=float(random.choice([0.0, 0.1])),
        wind=Wind(mean_x_m_s=float(random.uniform(-3.0, 3.0))),
    )
    limits = Limits(horizontal_m_s=float(random.uniform(4.0, 8.0)), up_m_s=2.5, down_m_s=1.5)
    safety = SafetySettings(limits=limits, fence=FENCE, link_delay_s=delay_s)
    settings = ControlSettings(safety=safety)
    settings = settings.model_copy(
        update={"law": settings.law.model_copy(update={"speed_m_s": limits.horizontal_m_s})}
    )
    box = _box(random)
    plan = Plan(Formation(10.0, 20.0), obstacles=(box,))
    start_m = _start_m(random)
    true = TrueWorld(start_m, world, seed)
    traits = Traits(
        np.ones(VEHICLES),
        np.full(VEHICLES, np.inf),
        np.full(VEHICLES, 0.05),
        responses(world, VEHICLES),
    )
    memory, seen_m = Memory.fresh(VEHICLES, 0.0), []
    for _ in range(LEGS):
        goal_m = _beyond_m(random, box)
        for _ in range(round(LEG_S / true.tick_s)):
            result = tick(true.receive(), _to(goal_m), plan, traits, memory, settings)
            memory = result.memory
            true.send(result.setpoints)
            seen_m.extend(true.advance())
    return _passed(np.concatenate(seen_m), box)


def _to(goal_m: Array) -> Tasks:
    none = np.zeros(VEHICLES, dtype=np.bool_)
    task = np.full(VEHICLES, Task.GOAL, dtype=np.int8)
    return Tasks(task, goal_m.copy(), ~none, none, np.zeros((0, 2, 3)))


def _box(random: np.random.Generator) -> Obstacle:
    turn_rad, away_m = random.uniform(-np.pi, np.pi), random.uniform(18.0, 25.0)
    half_m = random.uniform(2.0, 4.0, 2)
    x_m, y_m = away_m * np.cos(turn_rad), away_m * np.sin(turn_rad)
    return Obstacle("tower", float(x_m), float(y_m), float(half_m[0]), float(half_m[1]), 60.0)


def _start_m(random: np.random.Generator) -> Array:
    """(n, 3) a ring about the middle, 8 m across: clear of every box."""
    turn_rad = 2.0 * np.pi * np.arange(VEHICLES) / VEHICLES
    height_m = random.uniform(14.0, 24.0, VEHICLES)
    return np.column_stack([5.0 * np.cos(turn_rad), 5.0 * np.sin(turn_rad), -height_m])


def _beyond_m(random: np.random.Generator, box: Obstacle) -> Array:
    """(n, 3) places outside the fence, below its least height, above its greatest, or within the box."""
    turn_rad = random.uniform(-np.pi, np.pi, VEHICLES)
    away_m = FENCE.distance_max_m + random.uniform(5.0, BEYOND_M, VEHICLES)
    goal_m = np.column_stack([away_m * np.cos(turn_rad), away_m * np.sin(turn_rad), np.full(VEHICLES, -18.0)])
    kind = random.integers(0, 4, VEHICLES)
    goal_m[kind == 1, :2] *= 0.4
    goal_m[kind == 1, 2] = BEYOND_M
    goal_m[kind == 2, :2] *= 0.4
    goal_m[kind == 2, 2] = -FENCE.height_max_m - BEYOND_M
    goal_m[kind == 3, :2] = (box.x_m, box.y_m)
    return goal_m


def _passed(position_m: Array, box: Obstacle) -> Passed:
    height_m, away_m = -position_m[:, 2], np.hypot(position_m[:, 0], position_m[:, 1])
    _, outside_m = nearest_way_out(
        np.ascontiguousarray(position_m),
        np.array([[box.x_m, box.y_m]]),
        np.array([[box.half_length_x_m, box.half_length_y_m]]),
        np.array([box.height_m]),
    )
    return Passed(
        float(FENCE.height_min_m - height_m.min()),
        float(height_m.max() - FENCE.height_max_m),
        float(away_m.max() - FENCE.distance_max_m),
        float(-outside_m.min()),
    )
