"""Inputs of one tick, and what follows from them alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.control.settings import ControlSettings
from gcs.control.tasks import Task, Tasks
from gcs.formation.obstacles import Ellipse
from gcs.model.jit import kernel
from gcs.model.plan import Plan
from gcs.model.state import Array, FleetState, Mask, Traits

LONGEST_STEP_S = 0.2
"""Longest step of the commanded centre. After a longer pause the centre does not catch up."""


@dataclass(frozen=True, slots=True, eq=False)
class TickInputs:
    """Inputs of one tick. Rows as in FleetState."""

    fleet: FleetState
    tasks: Tasks
    plan: Plan
    traits: Traits
    settings: ControlSettings
    dt_s: float  # since the previous tick
    position_m: Array  # (n, 3)
    velocity_m_s: Array  # (n, 3); both writable copies, because kernels compile frozen arrays as another type
    commanded: Mask  # (n,) has a task and fresh telemetry
    formed: Mask  # (n,) commanded and in formation
    rows: NDArray[np.intp]  # (m,) of the vehicles in formation
    to_goal: Mask  # (n,) commanded and on the way to a goal of its own
    ellipses: dict[str, Ellipse]  # the plan's obstacles at this time

    def of_formed(self, values: Array) -> Array:
        """A copy of the rows in formation: (m,) or (m, 3) of (n,) or (n, 3)."""
        return values.copy() if len(self.rows) == len(self.formed) else values[self.rows]

    def for_all(self, formed: Array, others: float) -> Array:
        """(n, 3) with `formed` (m, 3) in the rows in formation, and `others` in all other rows."""
        if len(self.rows) == len(self.formed):
            return formed
        everybody = np.full((len(self.formed), 3), others)
        everybody[self.rows] = formed
        return everybody

    @staticmethod
    def of(
        fleet: FleetState,
        tasks: Tasks,
        plan: Plan,
        traits: Traits,
        settings: ControlSettings,
        *,
        before_s: float,
    ) -> "TickInputs":
        """Inputs at `fleet.time_s`, when the previous tick was at `before_s`."""
        position_m, velocity_m_s = np.array(fleet.position_m), np.array(fleet.velocity_m_s)
        task, age_s = np.array(tasks.task), np.array(fleet.age_s)
        commanded, formed, to_goal = _roles(
            task, position_m, velocity_m_s, age_s, settings.telemetry_age_max_s
        )
        return TickInputs(
            fleet,
            tasks,
            plan,
            traits,
            settings,
            min(max(fleet.time_s - before_s, 1e-3), LONGEST_STEP_S),
            position_m,
            velocity_m_s,
            commanded,
            formed,
            np.flatnonzero(formed),
            to_goal,
            ellipses_of(plan, settings, fleet.time_s),
        )


@kernel
def _roles(
    task: NDArray[np.int8], position_m: Array, velocity_m_s: Array, age_s: Array, age_max_s: float
) -> tuple[Mask, Mask, Mask]:
    """(n,) masks: commanded; commanded in formation; commanded to a goal of its own.

    Args:
        task: (n,) of Task.
        position_m: (n, 3), not finite where unknown.
        velocity_m_s: (n, 3), not finite where unknown.
        age_s: (n,) of the telemetry.
        age_max_s: a vehicle with older telemetry is not commanded.
    """
    n = len(task)
    commanded, formed, to_goal = np.zeros(n, np.bool_), np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    for i in range(n):
        fresh = task[i] != Task.NONE and age_s[i] <= age_max_s
        for axis in range(3):
            fresh = fresh and np.isfinite(position_m[i, axis]) and np.isfinite(velocity_m_s[i, axis])
        commanded[i] = fresh
        formed[i] = fresh and task[i] == Task.FORMATION
        to_goal[i] = fresh and task[i] == Task.GOAL
    return commanded, formed, to_goal


def ellipses_of(plan: Plan, settings: ControlSettings, time_s: float) -> dict[str, Ellipse]:
    """The plan's obstacles at `time_s`, as ellipses with the law's margins."""
    margin_m, headroom_m = settings.law.avoidance.margin_m, settings.law.avoidance.headroom_m
    return {
        box.id: Ellipse.around(box, margin_m=margin_m, headroom_m=headroom_m, time_s=time_s)
        for box in plan.obstacles
    }
