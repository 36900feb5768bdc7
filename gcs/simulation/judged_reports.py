"""What a simulated flight does about positions that it does not believe, or that jumped: as `gcs.flight`."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs.control import Task, Tasks
from gcs.estimation.positioning import Positioning
from gcs.flight.monitors.accuracy_alarms import WIDE_JUMP_M
from gcs.model.state import Array, FleetState, Mask, Setpoints, Traits
from gcs.simulation.loss import SeenReports, ServiceFailsafes, Unbelieved
from gcs.simulation.reporting import ReportingWorld


class JudgedReports:
    """The positions of the n vehicles of one flight."""

    def __init__(
        self, world: ReportingWorld, space: Unbelieved, failsafes: ServiceFailsafes, usual_m: Array
    ) -> None:
        """`space` that the vehicles close; `usual_m` (n,) their uncertainty while no position jumps."""
        n = len(usual_m)
        self._world, self._space, self._failsafes, self._usual_m = world, space, failsafes, usual_m
        self._positioning = Positioning()
        self._frozen_until_s, self._stands_m = np.full(n, -np.inf), np.full((n, 3), np.nan)
        self._before_m = world.position_m.copy()

    def widened(self, traits: Traits, deviations: float) -> Traits:
        """The traits, with what jumps add to the uncertainty of positions."""
        table = self._world.table
        jumps = self._world.time_s - table.reset_time_s, table.jumped_m
        return replace(
            traits,
            uncertainty_m=self._positioning.after_jumps_m(self._usual_m, *jumps, deviations),
        )

    def with_standing(self, tasks: Tasks, fleet: FleetState) -> Tasks:
        """The tasks of vehicles in formation; one with a position that jumped a moment ago stands."""
        formed = tasks.task == Task.FORMATION
        jumped = formed & (self._world.table.reset_time_s == fleet.time_s)
        self._frozen_until_s[jumped] = fleet.time_s + self._positioning.freeze_s
        self._stands_m[jumped] = fleet.position_m[jumped]
        stands = formed & (fleet.time_s < self._frozen_until_s)
        if not stands.any():
            return tasks
        task, goal_m = tasks.task.copy(), tasks.goal_m.copy()
        task[stands], goal_m[stands] = Task.GOAL, self._stands_m[stands]
        return replace(tasks, task=task, goal_m=goal_m)

    def judged(self, fleet: FleetState, age_max_s: float) -> SeenReports:
        """What the failsafes see of them."""
        world = self._world
        late_s, silence_s = fleet.time_s - world.position_time_s, self._space.silence_s
        unbelieved = np.isinf(fleet.age_s) & (late_s <= age_max_s)
        return SeenReports(unbelieved, world.table.doubts, world.table.reset_time_s, late_s > silence_s)

    def hold(self, rows: Mask, task: NDArray[np.int8]) -> None:
        """Have the autopilots of these vehicles (n,) hold them; `task` (n,) is written."""
        self._world.fly_alone(rows, "hold")
        self._space.stopped |= rows
        task[rows] = Task.NONE

    def land(self, rows: Mask, task: NDArray[np.int8], fleet: FleetState) -> Mask:
        """Have the autopilots land those of these (n,) that are not believed. Returns: (n,) the others."""
        blind = rows & np.isinf(fleet.age_s)
        self._world.fly_alone(blind, "land")
        self._space.lands |= blind
        self._space.stopped |= blind
        task[blind] = Task.NONE
        led: Mask = rows & ~blind
        self._world.autopilots.end(led)
        return led

    def note(self, now_s: float, task: NDArray[np.int8], setpoints: Setpoints) -> None:
        """Note which vehicles are named, and how far those that lie have flown. After each tick."""
        world, table = self._world, self._world.table
        lately = now_s - table.reset_time_s < self._positioning.reset_margin_s
        named = self._failsafes.bad_position | (lately & (table.jumped_m >= WIDE_JUMP_M))
        here_m = world.position_m
        way_m = np.linalg.norm(here_m - self._before_m, axis=1)
        self._before_m = here_m.copy()
        steered = (task == Task.FORMATION) & np.isfinite(world.of_all(setpoints)[:, 0])
        world.liars.note(now_s, named & world.in_air, steered, way_m)
