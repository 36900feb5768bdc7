"""Settings, tasks and inputs of one tick."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from gcs.control.landing_beside import Ground, landing_beside
from gcs.formation.laws.settings import FlownLawSettings
from gcs.formation.obstacles import Ellipse
from gcs.formation.orbit import Center
from gcs.model.jit import kernel
from gcs.model.plan import Obstacle, Plan, Target
from gcs.model.response import FleetResponse
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import Array, FleetState, Mask, Traits, freeze
from gcs.safety.constraints import stopping_speed_m_s
from gcs.safety.near_traffic import NearTraffic
from gcs.safety.surroundings import SafetySettings
from gcs.safety.target_clearance import clear_height_m, kept_clear_m


class Task(IntEnum):
    """What the tick does with a vehicle."""

    NONE = 0  # no setpoint is sent
    FORMATION = 1
    GOAL = 2  # to a goal of its own, through the same filter
    ELSEWHERE = 3  # in formation, and flown by another station: no setpoint is sent
    DRAWN = 4  # along its trajectory of a drawn show, through the same filter


@dataclass(frozen=True, slots=True, eq=False)
class DrawnGoals:
    """Where a drawn show has each vehicle now, show frame. Rows as in FleetState; NaN: it leads not."""

    position_m: Array  # (n, 3)
    velocity_m_s: Array  # (n, 3)
    acceleration_m_s2: Array  # (n, 3)
    yaw_rad: Array | None = None  # (n,) from the show's x axis; NaN, and None: as the plan has it

    def __post_init__(self) -> None:
        """Raises: ShapeError when the parts have different shapes."""
        for name in ("position_m", "velocity_m_s", "acceleration_m_s2"):
            freeze(getattr(self, name), (len(self.position_m), 3), name)
        if self.yaw_rad is not None:
            freeze(self.yaw_rad, (len(self.position_m),), "yaw_rad")


@dataclass(frozen=True, slots=True, eq=False)
class Tasks:
    """What every vehicle of the fleet has to do. Rows as in FleetState. Owns its arrays."""

    task: NDArray[np.int8]  # (n,) of Task
    goal_m: Array  # (n,) possibly in the air: other vehicles keep away
    airborne: Mask  # (n,) in the air, or possibly so: others keep away
    descending: Mask  # (n,) descending to land
    segments_m: Array  # (m, 2, 3), paths that lost vehicles may take
    center_moves: bool = False  # False: the centre stays (assembling)
    formation_waits: bool = False  # paused: centre and radius are kept although no vehicle follows them
    follows_planned_path: Mask | None = (
        None  # (n,) follows a path planned for the whole fleet: no rules of the road
    )
    segments_of: NDArray[np.intp] | None = None  # (m,) row of each path's lost vehicle; None: not known
    drift: tuple[Array, Array] | None = None  # (n, 3) expected positions and velocities of vehicles that fell
    # silent a few seconds ago (`gcs.planning.lost_space.expected_drift`), else NaN; None: of none
    silent_segments: int = 0  # the last of `segments_m` are of vehicles that are silent, and not lost yet
    drawn: DrawnGoals | None = None  # of the vehicles with the task DRAWN; None: no drawn show leads
    near_traffic: NearTraffic | None = None  # traffic that all keep clear of; None: there is none
    kept_clear: tuple[Target, ...] = ()  # targets with a clearance, beside the plan's

    def __post_init__(self) -> None:
        n = len(self.task)
        freeze(self.goal_m, (n, 3), "goal_m")
        freeze(self.segments_m, (len(self.segments_m), 2, 3), "segments_m")

    @staticmethod
    def of_formation(count: int, *, center_moves: bool) -> "Tasks":
        """All `count` vehicles are airborne and in formation, and none was lost."""
        none = np.zeros(count, dtype=np.bool_)
        return Tasks(
            np.full(count, Task.FORMATION, dtype=np.int8),
            np.full((count, 3), np.nan),
            np.ones(count, dtype=np.bool_),
            none,
            np.zeros((0, 2, 3)),
            center_moves=center_moves,
            follows_planned_path=none,
        )

    @property
    def slow_traffic(self) -> tuple[Obstacle, ...]:
        """What is flown round as obstacles are."""
        return () if self.near_traffic is None else self.near_traffic.boxes

    def led_by(self, goals: DrawnGoals, *, moves: bool) -> "Tasks":
        """Have a drawn show lead the vehicles in formation: along their trajectories if it `moves`.

        Else each flies to its goal by the rules of the road. A vehicle without a goal stops where it is.
        """
        formed = self.task == Task.FORMATION
        led = formed & np.isfinite(goals.position_m[:, 0])
        task, goal_m = self.task.copy(), self.goal_m.copy()
        task[formed] = Task.DRAWN
        if not moves:
            task[led], goal_m[led] = Task.GOAL, goals.position_m[led]
        return replace(self, task=task, goal_m=goal_m, drawn=goals)


@dataclass(frozen=True, slots=True, eq=False)
class FormationState:
    """The formation as the leading station computes it, at the time of a tick. Owns its arrays."""

    center: Center | None
    radius_m: float
    spin_rad_s: float
    sides: dict[str, float]  # on which each obstacle is passed, by obstacle id
    place: Array  # (n, 3) slots, rows as in the tick's FleetState, NaN: not known
    led_m_s: Array | None = None  # (n, 3) by a law that one station computes for all, relative to the
    # centre; NaN: not known, and None: nothing is


class ControlSettings(Settings):
    """Settings of law, safety filter and inner loop."""

    law: FlownLawSettings = FlownLawSettings()
    """Rates and limits of the law."""
    safety: SafetySettings = SafetySettings()
    """The safety filter, the last step before a setpoint leaves."""
    loop_gain: NotNegative = 1.5
    """Gain on the velocity error sideways: the setpoint is v + g (v - v_measured)."""
    vertical_loop_gain: NotNegative = 0.0
    """Gain on the velocity error up and down; PX4 responds fast there: 1.5 oscillates at 1.4 Hz."""
    lead_s: NotNegative = 0.5
    """So much of the centre's acceleration is added, in s: vehicles respond late."""
    trim_rate_per_s: NotNegative = 1.0
    """Rate at which a lasting error sideways (wind, drag) is learned, in 1/s."""
    vertical_trim_rate_per_s: NotNegative = 0.5
    """Rate at which a lasting error up and down is learned, in 1/s."""
    trim_max_m_s: NotNegative = 4.0
    """Most that is learned, in m/s."""
    response_s: Positive = 0.4
    """Time constant of a vehicle's response within the inner loop, in s."""
    acceleration_max_m_s2: Positive = 3.0
    """Greatest change of the desired velocity, in m/s^2."""
    radius_rate_m_s: Positive = 1.0
    """How fast the sphere grows or shrinks to a new radius, in m/s."""
    yaw_rate_max_deg_s: Positive = 45.0
    """How fast a vehicle turns to its heading, in degrees a second."""
    telemetry_age_max_s: Positive = 0.5
    """A vehicle whose position is older gets no setpoint, in s."""


STEPS_MOST = 128
"""Most places along the ways of all boxes that are looked at: landing places are chosen between two ticks."""

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
    to_goal: Mask  # (n,) commanded and on the way to a goal of its own
    rows: NDArray[np.intp]  # (m,) of the vehicles in formation
    goers: NDArray[np.intp]  # (k,) of those on the way to a goal
    sphere: NDArray[np.intp]  # (s,) on the sphere that the law needs: `rows`, and those of other stations
    descending: Mask  # (n,) descending to land, above its place or where it lands instead
    low: Mask  # (n,) off its place beside others on the ground: it may stay below the least height
    ellipses: dict[str, Ellipse]  # the plan's obstacles, and slow traffic, at this time
    own: slice  # the rows that this station flies; after them come those of other stations
    pace: float = 1.0  # share of the orbit's speed with which other stations' vehicles keep up

    @property
    def columns(self) -> dict[str, Ellipse]:
        """The columns in which lost vehicles stay or descend; the formation flies round them."""
        floor, tasks, uncertainty_m = (
            self.settings.safety.floor,
            self.tasks,
            np.array(self.traits.uncertainty_m),
        )
        own_m = float(np.max(uncertainty_m, where=self.commanded, initial=0.0))
        lost_m = np.full(len(tasks.segments_m), uncertainty_m.max(initial=0.0))
        if tasks.segments_of is not None:
            lost_m = uncertainty_m[tasks.segments_of]
        upright = (tasks.segments_m[:, 0, :2] == tasks.segments_m[:, 1, :2]).all(axis=1)
        upright[len(upright) - tasks.silent_segments :] = False
        columns_m, ellipses = tasks.segments_m[upright], {}
        reserves_m = floor.reserve_m(own_m, lost_m[upright]).tolist()
        tops_m = columns_m[:, :, 2].min(axis=1).tolist()
        for (x_m, y_m), reserve_m, z_m in zip(columns_m[:, 0, :2].tolist(), reserves_m, tops_m, strict=True):
            wide_m, tall_m = floor.kept_m(reserve_m)
            ellipses[f"lost at {x_m:.1f}, {y_m:.1f}"] = Ellipse(
                x_m, y_m, wide_m, wide_m, tall_m - z_m, beside_slots=True
            )
        return ellipses

    def center_height_m(self, sphere_m: float) -> float:
        """Height at which the centre of a sphere of this radius is to fly: above its target, clear of it.

        No higher than the fence lets the sphere: the filter then keeps the clearance without the law.
        """
        plan, fence, planned_m = self.plan, self.settings.safety.fence, self.plan.formation.height_m
        later_m = plan.target.climb_m_s / self.settings.law.goal_rate_per_s  # it lags by so much
        asked_m = least_m = planned_m + plan.target.height_m + later_m
        if plan.target.clearance_m:
            worst_m = np.array([self.traits.uncertainty_m[self.sphere].max(initial=0.0)])
            kept_m = kept_clear_m(plan.target, self.settings.safety.floor, worst_m)[:, 0]
            least_m = later_m + clear_height_m(plan.target, plan.orbit.radius_m, sphere_m, kept_m)
        most_m = max(fence.height_max_m - sphere_m, planned_m)
        lowest_m = min(fence.height_min_m + sphere_m, planned_m)
        return max(min(max(asked_m, least_m), most_m), lowest_m)

    @property
    def stops(self) -> FleetResponse:
        """(n,) How the vehicles stop, if their setpoints may end in any tick.

        What drawn vehicles do without setpoints is predicted before the show (`gcs.simulation.control_loss`).
        """
        drawn = None if self.tasks.drawn is None else self.tasks.task == Task.DRAWN
        return self.traits.response.without_setpoints(self.settings.safety.braking.reaction_s, drawn)

    @property
    def acceleration_max_m_s2(self) -> Array:
        """(n,) of each vehicle's desired velocity: no more than its autopilot follows."""
        own_m_s2 = self.traits.response.acceleration_m_s2
        return np.minimum(self.settings.acceleration_max_m_s2, own_m_s2)

    def approach_to_m_s(self, rows: NDArray[np.intp], here_m: Array, there_m: Array) -> Array:
        """`approach_max_m_s` from (k, 3) to places (k, 3)."""
        if not np.count_nonzero(np.isfinite(self.traits.response.acceleration_m_s2)):
            return np.full(len(rows), np.inf)
        return self.approach_max_m_s(rows, np.linalg.norm(there_m - here_m, axis=1))

    def approach_max_m_s(self, rows: NDArray[np.intp], distance_m: Array) -> Array:
        """Greatest speeds (k,) towards places that the vehicles of `rows` (k,) can still stop at.

        The law is proportional near the place: an autopilot that limits its acceleration would swing round
        it. For the other vehicles there is no limit.

        Args:
            rows: (k,).
            distance_m: (k,) from the places.
        """
        fastest_m_s = np.full(len(rows), np.inf)
        bounded = np.isfinite(self.traits.response.acceleration_m_s2[rows])
        if np.count_nonzero(bounded):
            response = self.traits.response.rows(rows)
            delay_s, braking = self.settings.safety.link_delay_s, self.settings.safety.braking
            each = braking.over_link(delay_s).of_each(len(rows), response.over_link(delay_s))
            fastest_m_s[bounded] = stopping_speed_m_s(distance_m, each)[bounded]
        return fastest_m_s

    @property
    def drawn_rows(self) -> NDArray[np.intp]:
        """(d,) rows of the vehicles on trajectories of a drawn show."""
        if self.tasks.drawn is None:
            return np.zeros(0, dtype=np.intp)
        return np.flatnonzero(self.commanded & (self.tasks.task == Task.DRAWN))

    def of_formed(self, values: Array) -> Array:
        """A copy of the rows in formation: (m,) or (m, 3) of (n,) or (n, 3)."""
        return values.copy() if len(self.rows) == len(self.formed) else values[self.rows]

    def of_sphere(self, values: Array) -> Array:
        """A copy of the rows on the sphere: (s,) or (s, 3) of (n,) or (n, 3)."""
        return values.copy() if len(self.sphere) == len(self.formed) else values[self.sphere]

    def ours(self, on_sphere: Array) -> Array:
        """(m, 3) rows in formation of the (s, 3) on the sphere."""
        return on_sphere if len(self.rows) == len(self.sphere) else on_sphere[self.formed[self.sphere]]

    def of_own(self, fleet: FleetState, tasks: Tasks, traits: Traits) -> "TickInputs":
        """The same of the rows that this station flies, with state, tasks and traits of these."""
        own = self.own
        return replace(
            self,
            fleet=fleet,
            tasks=tasks,
            traits=traits,
            position_m=self.position_m[own],
            velocity_m_s=self.velocity_m_s[own],
            commanded=self.commanded[own],
            formed=self.formed[own],
            to_goal=self.to_goal[own],
            sphere=self.rows,
            descending=self.descending[own],
            low=self.low[own],
        )

    def for_all(self, formed: Array, others: float) -> Array:
        """(n, 3) with `formed` (m, 3) in the rows in formation, and `others` in all other rows."""
        return _spread_over(len(self.formed), self.rows, formed, others)

    def for_sphere(self, on_sphere: Array, others: float) -> Array:
        """(n, 3) with `on_sphere` (s, 3) in the rows on the sphere, and `others` in all other rows."""
        return _spread_over(len(self.formed), self.sphere, on_sphere, others)

    @staticmethod
    def of(
        fleet: FleetState,
        tasks: Tasks,
        plan: Plan,
        traits: Traits,
        settings: ControlSettings,
        *,
        before_s: float,
        own: int,
        follows: bool = False,
        pace: float = 1.0,
    ) -> "TickInputs":
        """Inputs at `fleet.time_s`, when the previous tick was at `before_s`.

        The first `own` rows are those of this station, which `follows` where another lays all the slots.
        """
        position_m, velocity_m_s = np.array(fleet.position_m), np.array(fleet.velocity_m_s)
        task, age_s = np.array(tasks.task), np.array(fleet.age_s)
        roles = _roles(task, position_m, velocity_m_s, age_s, settings.telemetry_age_max_s)
        if follows:
            roles = (*roles[:-1], roles[3])
        ellipses = ellipses_of(plan, settings, fleet.time_s, tasks.slow_traffic)
        descending, low = tasks.descending, np.zeros(len(task), np.bool_)
        if np.count_nonzero(descending):
            targets = (plan.target, *tasks.kept_clear)
            about = tasks.segments_m, ellipses, targets, fleet.time_s
            ground = Ground(position_m, tasks.goal_m, traits.uncertainty_m, *about)
            landing = landing_beside(ground, descending, settings.safety)
            descending, low = landing.descending, landing.low
            if landing.goal_m is not tasks.goal_m:
                tasks = replace(tasks, goal_m=landing.goal_m)
        return TickInputs(
            fleet,
            tasks,
            plan,
            traits,
            settings,
            min(max(fleet.time_s - before_s, 1e-3), LONGEST_STEP_S),
            position_m,
            velocity_m_s,
            *roles,
            descending,
            low,
            ellipses,
            slice(own),
            pace,
        )


def _spread_over(count: int, rows: NDArray[np.intp], values: Array, others: float) -> Array:
    """(count, 3) with `values` in `rows`, and `others` in all other rows."""
    if len(rows) == count:
        return values
    all_rows = np.full((count, 3), others)
    all_rows[rows] = values
    return all_rows


@kernel
def _roles(
    task: NDArray[np.int8], position_m: Array, velocity_m_s: Array, age_s: Array, age_max_s: float
) -> tuple[Mask, Mask, Mask, NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """(n,) masks: commanded; in formation; to a goal of its own; the rows of the latter two; `sphere`.

    Args:
        task: (n,) of Task.
        position_m: (n, 3), not finite where unknown.
        velocity_m_s: (n, 3), not finite where unknown.
        age_s: (n,) of the telemetry.
        age_max_s: a vehicle with older telemetry is not commanded.
    """
    n = len(task)
    commanded, formed, to_goal = np.zeros(n, np.bool_), np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    on_sphere = np.zeros(n, np.bool_)
    for i in range(n):
        fresh = task[i] != Task.NONE and age_s[i] <= age_max_s
        for axis in range(3):
            fresh = fresh and np.isfinite(position_m[i, axis]) and np.isfinite(velocity_m_s[i, axis])
        commanded[i] = fresh and task[i] != Task.ELSEWHERE
        formed[i] = fresh and task[i] == Task.FORMATION
        to_goal[i] = fresh and task[i] == Task.GOAL
        on_sphere[i] = formed[i] or (fresh and task[i] == Task.ELSEWHERE)
    return (
        commanded,
        formed,
        to_goal,
        np.flatnonzero(formed),
        np.flatnonzero(to_goal),
        np.flatnonzero(on_sphere),
    )


def ellipses_of(
    plan: Plan, settings: ControlSettings, time_s: float, more: tuple[Obstacle, ...] = ()
) -> dict[str, Ellipse]:
    """The plan's obstacles at `time_s`, and `more`, as ellipses with the law's margins."""
    margin_m, headroom_m = settings.law.avoidance.margin_m, settings.law.avoidance.headroom_m
    return {
        box.id: Ellipse.around(box, margin_m=margin_m, headroom_m=headroom_m, time_s=time_s)
        for box in (*plan.obstacles, *more)
    }


def ellipses_until(
    plan: Plan, settings: ControlSettings, time_s: float, until_s: float, more: tuple[Obstacle, ...] = ()
) -> dict[str, Ellipse]:
    """As `ellipses_of`, and those of boxes that move once more along their ways until `until_s`.

    Next to each other by half their narrow axis. Where there would be more than `STEPS_MOST` they are farther
    apart, and larger, so that they still cover the ways.
    """
    ellipses, ahead_s = ellipses_of(plan, settings, time_s, more), until_s - time_s
    moving = {name: each for name, each in ellipses.items() if each.velocity_x_m_s or each.velocity_y_m_s}
    ways = [float(ahead_s * np.hypot(*each.velocity_m_s) / min(each.semi_m)) for each in moving.values()]
    steps = [int(np.ceil(2.0 * way)) for way in ways]
    fewer = min(1.0, STEPS_MOST / max(sum(steps), 1))
    for (name, each), desired in zip(moving.items(), steps, strict=True):
        count, larger = max(int(fewer * desired), 1) if desired else 0, 1.0
        if count < desired:  # two of them meet at the width of the box
            half_step = 0.5 * ahead_s / count * each.velocity_m_s / each.semi_m
            larger = float(np.sqrt(1.0 + half_step @ half_step))
        for later_s in np.linspace(0.0, ahead_s, count + 1)[0 if larger > 1.0 else 1 :].tolist():
            x_m, y_m = each.x_m + later_s * each.velocity_x_m_s, each.y_m + later_s * each.velocity_y_m_s
            semi_x_m, semi_y_m = larger * each.semi_x_m, larger * each.semi_y_m
            later = replace(each, x_m=x_m, y_m=y_m, semi_x_m=semi_x_m, semi_y_m=semi_y_m)
            ellipses[f"{name} in {later_s:.1f} s"] = later
    return ellipses
