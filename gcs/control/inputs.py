"""What one tick is given, and what follows from that alone."""

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
"""After a longer pause the commanded centre does not catch up: what was not flown is not flown."""


@dataclass(frozen=True, slots=True, eq=False)
class TickInputs:
    """One tick's question. Rows as in FleetState."""

    fleet: FleetState
    tasks: Tasks
    plan: Plan
    traits: Traits
    settings: ControlSettings
    dt_s: float  # since the tick before
    position_m: Array  # (n, 3) and
    velocity_m_s: Array  # (n, 3) the fleet's, not frozen: frozen arrays are another type to the kernels
    commanded: Mask  # (n,) has a task and fresh telemetry
    formed: Mask  # (n,) of these in formation
    rows: NDArray[np.intp]  # (m,) of those in formation
    to_goal: Mask  # (n,) of the commanded on the way to a point of its own
    ellipses: dict[str, Ellipse]  # the plan's obstacles, where they are now

    def of_formed(self, values: Array) -> Array:
        """A copy of the rows of those in formation, (m,) or (m, 3) of (n,) or (n, 3)."""
        return values.copy() if len(self.rows) == len(self.formed) else values[self.rows]

    def for_all(self, formed: Array, others: float) -> Array:
        """(n, 3) with (m, 3) in the rows of those in formation and one number everywhere else."""
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
        """At `fleet.time_s`, when the last tick was at `before_s`."""
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
    """(n,) who is commanded, of these who is in formation, and who goes to a point of its own.

    Args:
        task: (n,) of Task.
        position_m: (n, 3), not finite where it is not known.
        velocity_m_s: (n, 3), likewise.
        age_s: (n,) of what is known.
        age_max_s: older telemetry commands nobody.
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
    """The plan's obstacles, where they are at `time_s`, as ellipses with the law's margins."""
    margin_m, headroom_m = settings.law.avoidance.margin_m, settings.law.avoidance.headroom_m
    return {
        box.id: Ellipse.around(box, margin_m=margin_m, headroom_m=headroom_m, time_s=time_s)
        for box in plan.obstacles
    }
