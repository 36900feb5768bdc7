"""Flies `gcs.control.tick` over fake dynamics in virtual time and judges the true positions."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gcs.control import ControlSettings, Memory, Task, Tasks, Tick, tick
from gcs.flight.commands.commander import STOPS_WITHIN_S
from gcs.formation.repulsion import energy, nearest_m
from gcs.model.plan import Formation, Plan
from gcs.model.state import Array, FleetState, Mask, Traits
from gcs.planning.return_paths.paths import is_above, may_hand_over
from gcs.safety.floor import minimum_separation
from gcs.sim.vehicle.dynamics import PointMasses, Response
from gcs.sim.vehicle.sensors import draw_errors, step_errors
from gcs.simulation.reference_shapes import best
from gcs.simulation.simulated_flight import HANDOVER_HEIGHT_M
from gcs.simulation.world import TOUCHDOWN_M_S

TICK_S = 0.05
STEP_S = 0.01
TAKEOFF_HEIGHT_M = 5.0
SETTINGS = ControlSettings()


def ground_grid_m(count: int, spacing_m: float = 4.0) -> Array:
    """(count, 3) pads, row by row, around the origin."""
    side = int(np.ceil(np.sqrt(count)))
    pads_m = np.array([(spacing_m * (i // side), spacing_m * (i % side), 0.0) for i in range(count)])
    pads_m[:, :2] -= pads_m[:, :2].mean(axis=0)
    return pads_m


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """One tick: the true state and the decisions of control."""

    time_s: float
    position_m: Array  # (n, 3) true
    airborne: Mask
    tick: Tick
    target_m: Array  # (2,)

    @property
    def center_m(self) -> Array:
        """(3,) commanded; NaN while no formation flies."""
        center = self.tick.memory.center
        return np.full(3, np.nan) if center is None else center.position_m


class Flight:
    """A fleet hovering 5 m above its pads, flown tick by tick."""

    def __init__(self, count: int, formation: Formation, *, noise_scale: float = 0.0, seed: int = 1) -> None:
        self.pads_m = ground_grid_m(count)
        self.plan = Plan(formation)
        self.time_s = 0.0
        self.bodies = PointMasses(self.pads_m - (0.0, 0.0, TAKEOFF_HEIGHT_M), STEP_S, Response())
        self.task = np.full(count, Task.FORMATION, dtype=np.int8)
        self.goal_m = np.full((count, 3), np.nan)
        self.airborne = np.ones(count, dtype=bool)
        self.descending = np.zeros(count, dtype=bool)
        self.handed_over = np.zeros(count, dtype=bool)
        self.age_s = np.full(count, 0.02)
        self.segments_m = np.zeros((0, 2, 3))
        self.center_moves = False
        self.formation_waits = False
        self.history: list[Sample] = []
        self._ids = tuple(f"d{i + 1}" for i in range(count))
        self._memory = Memory.fresh(count, 0.0)
        self._noise_scale = noise_scale
        self._random = np.random.default_rng(seed)
        self._error = draw_errors(count, noise_scale, self._random)

    @property
    def believed_m(self) -> Array:
        """(n, 3) positions as the vehicles estimate them."""
        believed: Array = self.bodies.position_m + self._error.position_m
        return believed

    @property
    def believed_m_s(self) -> Array:
        """(n, 3) velocities as the vehicles estimate them."""
        believed: Array = self.bodies.velocity_m_s + self._error.velocity_m_s
        return believed

    def run(self, seconds: float, each: Callable[[], None] = lambda: None) -> list[Sample]:
        """Fly on, calling `each` before every tick. Returns: the samples."""
        begun = len(self.history)
        for _ in range(round(seconds / TICK_S)):
            each()
            self._tick()
        return self.history[begun:]

    def _tick(self) -> None:
        fleet = FleetState(
            self.time_s,
            self._ids,
            self.believed_m,
            self.believed_m_s,
            np.full(len(self._ids), 0.3),
            self.age_s.copy(),
        )
        tasks = Tasks(
            self.task.copy(),
            self.goal_m.copy(),
            self.airborne.copy(),
            self.descending.copy(),
            self.segments_m.copy(),
            center_moves=self.center_moves,
            formation_waits=self.formation_waits,
        )
        decided = tick(
            fleet,
            tasks,
            self.plan,
            Traits.alike(len(self._ids), max(SETTINGS.safety.floor.uncertainty_m, 0.2 * self._noise_scale)),
            self._memory,
            SETTINGS,
        )
        self._memory = decided.memory
        target_m = np.array(self.plan.target.position_m(self.time_s))
        self.history.append(
            Sample(self.time_s, self.bodies.position_m, self.airborne.copy(), decided, target_m)
        )
        self._move(decided)
        self.time_s += TICK_S

    def _move(self, decided: Tick) -> None:
        """A vehicle without a setpoint hovers, descends in LAND, or stands on the ground."""
        command_m_s = np.zeros_like(self.bodies.position_m)
        command_m_s[self.handed_over, 2] = TOUCHDOWN_M_S
        rows = [self._ids.index(name) for name in decided.setpoints.ids]
        command_m_s[rows] = decided.setpoints.velocity_m_s
        for _ in range(round(TICK_S / STEP_S)):
            self.bodies.step(command_m_s, velocity_error_m_s=self._error.velocity_m_s)
        self._land()
        if self._noise_scale:
            self._error = step_errors(self._error, TICK_S, self._noise_scale, self._random)

    def _land(self) -> None:
        down = self.bodies.position_m[:, 2] >= self.pads_m[:, 2]
        if not down.any():
            return
        self.airborne = self.airborne & ~down
        self.task[down] = Task.NONE
        bodies, rows = self.bodies, down[:, None]
        bodies.position_m = bodies.position_m.copy()
        bodies.position_m[down, 2] = self.pads_m[down, 2]
        bodies.velocity_m_s = np.where(rows, 0.0, bodies.velocity_m_s)
        bodies.acceleration_m_s2 = np.where(rows, 0.0, bodies.acceleration_m_s2)
        bodies.integral_m_s2 = np.where(rows, 0.0, bodies.integral_m_s2)

    # what the maneuvers and the commander do

    def hold_in_place(self) -> None:
        """Pause: every vehicle stops where its velocity takes it."""
        self.formation_waits, self.center_moves = True, False
        self.task[:] = Task.GOAL
        self.goal_m = self.believed_m + STOPS_WITHIN_S * self.believed_m_s

    def resume(self) -> None:
        """Return every vehicle to the formation."""
        self.formation_waits = False
        self.task[:] = Task.FORMATION
        self.goal_m = np.full_like(self.goal_m, np.nan)

    def send_home(self) -> None:
        """Send every vehicle above its own pad, not below the height that it climbed to."""
        self.center_moves = False
        self.task[:] = Task.GOAL
        self.goal_m = self.pads_m.copy()
        self.goal_m[:, 2] = np.minimum(self.believed_m[:, 2], self.pads_m[:, 2] - TAKEOFF_HEIGHT_M)

    def come_down_where_home(self) -> None:
        """Descend above the pad; just above it use the autopilot's LAND."""
        here_m = self.believed_m
        flown = self.task == Task.GOAL
        arrived = flown & is_above(here_m, self.pads_m) & ~self.descending
        self.descending |= arrived
        self.goal_m[arrived] = self.pads_m[arrived]
        low = flown & self.descending & may_hand_over(here_m, self.pads_m, HANDOVER_HEIGHT_M)
        self.handed_over |= low
        self.task[low] = Task.NONE


def closest_m_and_violations(history: list[Sample]) -> tuple[float, int]:
    """By the true positions of all ticks: smallest distance of pairs that count, pairs inside the floor."""
    seen = [
        minimum_separation(sample.position_m, sample.airborne, SETTINGS.safety.floor) for sample in history
    ]
    return min(distance_m for distance_m, _ in seen), sum(inside for _, inside in seen)


def shape(history: list[Sample]) -> tuple[float, float, float]:
    """Energy and nearest ratio of the mean positions about the centre; largest mean radius error in m."""
    offset_m = np.array([sample.position_m - sample.center_m for sample in history])
    radius_m = np.array([sample.tick.memory.radius_m for sample in history])
    error_m = np.abs(np.linalg.norm(offset_m, axis=2) - radius_m[:, None]).mean(axis=0).max()
    mean_m = offset_m.mean(axis=0)
    direction = mean_m / np.linalg.norm(mean_m, axis=1, keepdims=True)
    ideal = best(len(direction))
    return (
        energy(direction) / energy(ideal),
        nearest_m(direction) / nearest_m(ideal),
        float(error_m),
    )


def largest_setpoint_change_m_s(history: list[Sample]) -> float:
    """Largest change from one tick to the next, of vehicles commanded in both, in m/s."""
    worst_m_s = 0.0
    for before, after in pairwise(history):
        old = dict(zip(before.tick.setpoints.ids, before.tick.setpoints.velocity_m_s, strict=True))
        new = dict(zip(after.tick.setpoints.ids, after.tick.setpoints.velocity_m_s, strict=True))
        for name in old.keys() & new.keys():
            worst_m_s = max(worst_m_s, float(np.linalg.norm(new[name] - old[name])))
    return worst_m_s
