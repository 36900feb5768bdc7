"""One tick: the law, then safety. Pure: the same for real vehicles, fake ones and a simulation."""

from dataclasses import dataclass, replace
from enum import IntEnum
from math import radians

import numpy as np
from numpy.typing import NDArray

from gcs.formation.law import (
    LawSettings,
    avoid_all,
    formation_velocity,
    goal_velocity,
    kick_directions,
    update_sides,
    wanted_center_velocity,
)
from gcs.formation.obstacles import Ellipse
from gcs.formation.orbit import CLEAR_OF_FENCE_M, Center, advance_center, held_within, target_reach_m
from gcs.formation.response import compensate, limit_change, scale_to_limits
from gcs.formation.yaw import turn_towards, wanted_yaw_rad
from gcs.plan import Plan
from gcs.safety.filter import SafetySettings, Surroundings, cap, filter_velocities
from gcs.safety.separation import minimum_separation
from gcs.settings import NotNegative, Positive, Settings
from gcs.state import Array, FleetState, Mask, Setpoints, Traits, VehicleId, freeze

LONGEST_STEP_S = 0.2
"""After a longer pause the commanded centre does not catch up: what was not flown is not flown."""


class Task(IntEnum):
    """What the tick does with a vehicle."""

    NONE = 0  # nothing is sent
    FORMATION = 1
    GOAL = 2  # to a point of its own, through the same filter


@dataclass(frozen=True, slots=True, eq=False)
class Tasks:
    """What every vehicle of the fleet is to do. Rows as in FleetState. Owns its arrays."""

    task: NDArray[np.int8]  # (n,) of Task
    goal_m: Array  # (n, 3), show frame; only rows of GOAL count
    airborne: Mask  # (n,) in the air, or possibly so: others keep away
    descending: Mask  # (n,) on its way to the ground
    segments_m: Array  # (m, 2, 3), paths that lost vehicles may take
    center_moves: bool = False  # False: the centre stays (assembling)
    formation_waits: bool = False  # paused: centre and radius are kept although nobody follows them

    def __post_init__(self) -> None:
        n = len(self.task)
        freeze(self.goal_m, (n, 3), "goal_m")
        freeze(self.segments_m, (len(self.segments_m), 2, 3), "segments_m")


class ControlSettings(Settings):
    """Law and safety, and how vehicles answer."""

    law: LawSettings = LawSettings()
    safety: SafetySettings = SafetySettings()
    loop_gain: NotNegative = 1.5
    vertical_loop_gain: NotNegative = 0.0  # PX4's vertical answer is fast; 1.5 swings at 1.4 Hz
    lead_s: NotNegative = 0.5
    acceleration_max_m_s2: Positive = 3.0  # of the wanted velocity
    radius_rate_m_s: Positive = 1.0
    yaw_rate_max_deg_s: Positive = 45.0
    telemetry_age_max_s: Positive = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """All that one tick hands to the next. Rows as in FleetState. Owns its arrays."""

    time_s: float
    center: Center | None  # None until a formation flies
    radius_m: float
    wanted_m_s: Array  # (n, 3) velocity after safety, NaN where nothing was commanded
    yaw_rad: Array  # (n,) commanded, NaN where nothing was
    held_yaw_rad: Array  # (n,) at engagement
    engaged_time_s: Array  # (n,) when it joined the formation, NaN outside
    sides: dict[str, float]

    @staticmethod
    def fresh(count: int, time_s: float) -> "Memory":
        """Nothing commanded yet."""
        nothing = np.full(count, np.nan)
        return Memory(time_s, None, 0.0, np.full((count, 3), np.nan), nothing, nothing, nothing, {})


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """What one tick decided."""

    setpoints: Setpoints
    memory: Memory
    restrained_by: tuple[str, ...]  # (n,) why the filter held a vehicle back, "" when it did not
    minimum_separation_m: float  # as believed, of the pairs that count


def seeds_of(ids: tuple[VehicleId, ...]) -> Array:
    """A number for each id, the same in every run and for every order of the fleet."""
    return np.array([int.from_bytes(name.encode(), "big") % 2**31 for name in ids], dtype=np.float64)


def tick(
    fleet: FleetState, tasks: Tasks, plan: Plan, traits: Traits, memory: Memory, settings: ControlSettings
) -> Tick:
    """Compute every commanded vehicle's setpoint for the instant `fleet.time_s`.

    Args:
        fleet: n vehicles.
        tasks: what each is to do.
        plan: formation, orbit, target, obstacles, yaw.
        traits: what distinguishes them.
        memory: of the tick before.
        settings: gains and limits.

    Returns: setpoints for those vehicles only that have a task and fresh telemetry.
    """
    dt_s = float(np.clip(fleet.time_s - memory.time_s, 1e-3, LONGEST_STEP_S))
    usable = np.isfinite(fleet.position_m).all(axis=1) & np.isfinite(fleet.velocity_m_s).all(axis=1)
    commanded = (tasks.task != Task.NONE) & usable & (fleet.age_s <= settings.telemetry_age_max_s)
    formed = commanded & (tasks.task == Task.FORMATION)
    ellipses = ellipses_of(plan, settings)

    memory = _move_center(fleet, formed, tasks, plan, ellipses, memory, settings, dt_s)
    wanted_m_s = _law(fleet, formed, commanded, tasks, ellipses, traits, memory, settings)
    before_m_s = np.where(np.isfinite(memory.wanted_m_s), memory.wanted_m_s, fleet.velocity_m_s)
    wanted_m_s = limit_change(wanted_m_s, before_m_s, settings.acceleration_max_m_s2, dt_s)
    surroundings = Surroundings(
        fleet.position_m,
        fleet.velocity_m_s,
        commanded,
        tasks.airborne,
        tasks.descending,
        tasks.segments_m,
        ellipses,
        fleet.ids,
        traits.uncertainty_m,
        traits.speed_max_m_s,
    )
    allowed_m_s, restrained_by = filter_velocities(wanted_m_s, surroundings, settings.safety)

    lead_m_s2 = np.zeros_like(allowed_m_s)
    if memory.center is not None:
        lead_m_s2[formed] = memory.center.acceleration_m_s2
    setpoint_m_s = compensate(
        allowed_m_s,
        fleet.velocity_m_s,
        lead_m_s2,
        gain=settings.loop_gain,
        vertical_gain=settings.vertical_loop_gain,
        lead_s=settings.lead_s,
    )
    setpoint_m_s = cap(setpoint_m_s, settings.safety.limits, traits.speed_max_m_s)
    yaw_rad, held_rad = _yaw(fleet, commanded, plan, memory, settings, dt_s)
    rows = np.flatnonzero(commanded & np.isfinite(yaw_rad))
    separation_m, _ = minimum_separation(fleet.position_m, tasks.airborne, settings.safety.floor)
    return Tick(
        Setpoints(fleet.time_s, tuple(fleet.ids[row] for row in rows), setpoint_m_s[rows], yaw_rad[rows]),
        replace(
            memory,
            time_s=fleet.time_s,
            wanted_m_s=np.where(commanded[:, None], allowed_m_s, np.nan),
            yaw_rad=yaw_rad,
            held_yaw_rad=held_rad,
        ),
        restrained_by,
        separation_m,
    )


def ellipses_of(plan: Plan, settings: ControlSettings) -> dict[str, Ellipse]:
    """The plan's obstacles as ellipses with the law's margins."""
    avoidance = settings.law.avoidance
    return {
        obstacle.id: Ellipse.around(obstacle, margin_m=avoidance.margin_m, headroom_m=avoidance.headroom_m)
        for obstacle in plan.obstacles
    }


def _move_center(
    fleet: FleetState,
    formed: Mask,
    tasks: Tasks,
    plan: Plan,
    ellipses: dict[str, Ellipse],
    memory: Memory,
    settings: ControlSettings,
    dt_s: float,
) -> Memory:
    """Begin, move or drop the formation's centre and radius; note who joined and who left."""
    engaged_s = np.where(formed, memory.engaged_time_s, np.nan)
    engaged_s = np.where(formed & ~np.isfinite(engaged_s), fleet.time_s, engaged_s)
    law = settings.law
    center, radius_m = memory.center, memory.radius_m
    if not formed.any():
        expected = tasks.formation_waits or bool((tasks.task == Task.FORMATION).any())
        if center is None or not expected:  # one tick without telemetry does not end a formation
            return replace(memory, center=None, engaged_time_s=engaged_s, sides={})
        stopped = advance_center(center, np.zeros(3), dt_s, law.center_acceleration_max_m_s2)
        return replace(memory, center=stopped)
    if center is None:
        above_m = fleet.position_m[formed].mean(axis=0)
        center = Center.at_rest(np.array([above_m[0], above_m[1], -plan.formation.height_m]))
        radius_m = plan.formation.radius_m
    ahead = replace(center, position_m=center.position_m + dt_s * center.velocity_m_s)  # where the step ends
    sphere_m, fence_m = max(radius_m, plan.formation.radius_m), settings.safety.fence.distance_max_m
    reach_m = target_reach_m(fence_m, plan.orbit.radius_m, sphere_m)
    wanted_m_s = wanted_center_velocity(ahead, plan, fleet.time_s + dt_s, law, reach_m=reach_m)
    if not tasks.center_moves:
        wanted_m_s[:2] = 0.0
    sides = update_sides(memory.sides, ellipses, fleet.position_m[formed], center, wanted_m_s, law)
    speed_m_s = np.linalg.norm(wanted_m_s[None, :2], axis=1)
    around_m_s = avoid_all(center.position_m[None], wanted_m_s[None], ellipses, sides, speed_m_s, law)[0]
    level_m_s = held_within(
        around_m_s[:2],
        ahead.position_m[:2],
        fence_m - sphere_m - CLEAR_OF_FENCE_M / 2,  # the orbit's own farthest point is farther in
        law.center_acceleration_max_m_s2 / 2,
    )
    held_m_s = np.append(level_m_s, around_m_s[2])
    moved = advance_center(center, held_m_s, dt_s, law.center_acceleration_max_m_s2)
    change_m = np.clip(
        plan.formation.radius_m - radius_m, -settings.radius_rate_m_s * dt_s, settings.radius_rate_m_s * dt_s
    )
    return replace(
        memory, center=moved, radius_m=radius_m + float(change_m), engaged_time_s=engaged_s, sides=sides
    )


def _law(
    fleet: FleetState,
    formed: Mask,
    commanded: Mask,
    tasks: Tasks,
    ellipses: dict[str, Ellipse],
    traits: Traits,
    memory: Memory,
    settings: ControlSettings,
) -> Array:
    """(n, 3) velocities that law and goals want, obstacles avoided, within the speed limits."""
    law = settings.law
    wanted_m_s = np.zeros((len(fleet.ids), 3))
    sliding_m_s = np.zeros(len(fleet.ids))
    center = memory.center
    if center is not None and formed.any():
        wanted_m_s[formed] = formation_velocity(
            fleet.position_m[formed],
            traits.charge[formed],
            kick_directions(seeds_of(fleet.ids))[formed],
            fleet.time_s - memory.engaged_time_s[formed],
            center,
            radius_m=memory.radius_m,
            settings=law,
        )
        sliding_m_s[formed] = np.hypot(center.velocity_m_s[0], center.velocity_m_s[1])
    to_goal = commanded & (tasks.task == Task.GOAL)
    if to_goal.any():
        wanted_m_s[to_goal] = goal_velocity(fleet.position_m[to_goal], tasks.goal_m[to_goal], settings=law)
        sliding_m_s[to_goal] = 0.5 * np.hypot(wanted_m_s[to_goal, 0], wanted_m_s[to_goal, 1])
    limits = settings.safety.limits
    for rows, sides in ((formed, memory.sides), (to_goal, {})):
        if rows.any():
            wanted_m_s[rows] = avoid_all(
                fleet.position_m[rows], wanted_m_s[rows], ellipses, sides, sliding_m_s[rows], law
            )
    return scale_to_limits(
        wanted_m_s,
        horizontal_max_m_s=limits.horizontal_m_s,
        up_max_m_s=limits.up_m_s,
        down_max_m_s=limits.down_m_s,
    )


def _yaw(
    fleet: FleetState, commanded: Mask, plan: Plan, memory: Memory, settings: ControlSettings, dt_s: float
) -> tuple[Array, Array]:
    """Commanded yaw and yaw at engagement, (n,) each; NaN where nothing is commanded."""
    fresh = commanded & ~np.isfinite(memory.yaw_rad)
    before_rad = np.where(fresh, fleet.yaw_rad, memory.yaw_rad)
    held_rad = np.where(fresh, fleet.yaw_rad, memory.held_yaw_rad)
    target_m = np.array(plan.target.position_m(fleet.time_s))
    wanted_rad = wanted_yaw_rad(plan.yaw, held_rad, fleet.position_m, target_m)
    yaw_rad = turn_towards(before_rad, wanted_rad, radians(settings.yaw_rate_max_deg_s), dt_s)
    return np.where(commanded, yaw_rad, np.nan), np.where(commanded, held_rad, np.nan)
