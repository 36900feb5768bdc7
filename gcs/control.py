"""One tick: the law, then safety. Pure: the same for real vehicles, fake ones and a simulation."""

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cache
from math import radians

import numpy as np
from numpy.typing import NDArray

from gcs.formation.law import (
    LawSettings,
    begun,
    directions_from,
    goal_velocity,
    kicks,
    place_velocity,
    wanted_center_velocity,
)
from gcs.formation.neighbours import Sight, sighted_velocity
from gcs.formation.obstacles import Ellipse
from gcs.formation.orbit import (
    CLEAR_OF_FENCE_M,
    Center,
    advance_center,
    held_within,
    next_pace,
    target_reach_m,
)
from gcs.formation.repulsion import sweep, sweeps_for
from gcs.formation.response import (
    compensate,
    correct_trim,
    limit_change,
    scale_to_limits,
    shrink_relative,
)
from gcs.formation.steering import avoid_all, steer_center, way_ahead
from gcs.formation.steering import warm_up as steering_warm_up
from gcs.formation.yaw import turn_towards, wanted_yaw_rad
from gcs.plan import Formation, Plan
from gcs.safety.filter import SafetySettings, Surroundings, cap, filter_velocities
from gcs.safety.kernels import warm_up as safety_warm_up
from gcs.safety.separation import minimum_separation
from gcs.safety.traffic import keep_right
from gcs.settings import NotNegative, Positive, Settings
from gcs.state import Array, FleetState, Mask, Setpoints, Traits, freeze

LONGEST_STEP_S = 0.2
"""After a longer pause the commanded centre does not catch up: what was not flown is not flown."""

PRESSED = 0.65
"""Share of the speed limit from which a vehicle's setpoint has little left to give."""

STANDING_M_S = 0.5
"""A centre slower than this waits for nobody."""


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
    sight: Sight | None = None  # (n) what each drone's own law sees; None: everything

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
    trim_rate_per_s: NotNegative = 1.0
    vertical_trim_rate_per_s: NotNegative = 0.5
    trim_max_m_s: NotNegative = 4.0
    response_s: Positive = 0.4  # time constant of a vehicle's answer within the inner loop
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
    place: Array  # (n, 3) unit vectors from the centre to where each is led, NaN outside the formation
    change: Array  # (n, 3) of the places in the last sweep
    trim_m_s: Array  # (n, 3) what setpoints are off by, against wind, drag and the vehicle's own answer
    expected_m_s: Array  # (n, 3) velocity beside the centre's that each should have, NaN: not commanded
    pace: float  # share of the orbit's speed that the vehicles can keep up with
    sides: dict[str, float]

    @staticmethod
    def fresh(count: int, time_s: float) -> "Memory":
        """Nothing commanded yet."""
        nothing, nowhere, still = np.full(count, np.nan), np.full((count, 3), np.nan), np.zeros((count, 3))
        return Memory(
            time_s=time_s,
            center=None,
            radius_m=0.0,
            wanted_m_s=nowhere,
            yaw_rad=nothing,
            held_yaw_rad=nothing,
            engaged_time_s=nothing,
            place=nowhere,
            change=still,
            trim_m_s=still,
            expected_m_s=nowhere,
            pace=1.0,
            sides={},
        )


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """What one tick decided."""

    setpoints: Setpoints
    memory: Memory
    restrained_by: tuple[str, ...]  # (n,) why the filter held a vehicle back, "" when it did not
    minimum_separation_m: float  # as believed, of the pairs that count


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
    ellipses = ellipses_of(plan, settings, fleet.time_s)

    memory = _move_center(fleet, formed, tasks, plan, ellipses, memory, settings, dt_s)
    memory, own_m_s = _spread(fleet, formed, tasks, traits, memory, settings)
    wanted_m_s = _law(fleet, formed, commanded, tasks, ellipses, own_m_s, memory, settings)
    wanted_m_s = keep_right(
        wanted_m_s,
        fleet.position_m,
        fleet.velocity_m_s,
        tasks.goal_m,
        to_goal=commanded & (tasks.task == Task.GOAL) & ~tasks.descending,
        commanded=commanded,
        airborne=tasks.airborne,
        flatness=settings.safety.floor.horizontal_m / settings.safety.floor.vertical_m,
        settings=settings.safety.traffic,
    )
    wanted_m_s = limit_change(
        wanted_m_s, memory.wanted_m_s, fleet.velocity_m_s, settings.acceleration_max_m_s2, dt_s
    )
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

    setpoint_m_s, memory = _answer(
        allowed_m_s, fleet, formed, commanded, tasks, traits, memory, settings, dt_s
    )
    yaw_rad, held_rad = _yaw(fleet, commanded, plan, memory, settings, dt_s)
    rows = np.flatnonzero(commanded & np.isfinite(yaw_rad))
    ids = fleet.ids if len(rows) == len(fleet.ids) else tuple(fleet.ids[row] for row in rows.tolist())
    separation_m, _ = minimum_separation(fleet.position_m, tasks.airborne, settings.safety.floor)
    return Tick(
        Setpoints(fleet.time_s, ids, setpoint_m_s[rows], yaw_rad[rows]),
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


def _answer(
    allowed_m_s: Array,
    fleet: FleetState,
    formed: Mask,
    commanded: Mask,
    tasks: Tasks,
    traits: Traits,
    memory: Memory,
    settings: ControlSettings,
    dt_s: float,
) -> tuple[Array, Memory]:
    """(n, 3) setpoints that make the vehicles have the allowed velocities, and what their answer teaches."""
    lead_m_s2, base_m_s = np.zeros_like(allowed_m_s), np.zeros_like(allowed_m_s)
    believing = tasks.sight is not None and tasks.sight.belief is not None
    if memory.center is not None and not believing:  # nobody tells its neighbours of accelerations
        lead_m_s2[formed] = memory.center.acceleration_m_s2
        base_m_s[formed] = memory.center.velocity_m_s
    wished_m_s = memory.trim_m_s + compensate(
        allowed_m_s,
        fleet.velocity_m_s,
        lead_m_s2,
        settings.loop_gain,
        settings.vertical_loop_gain,
        settings.lead_s,
    )
    limits = settings.safety.limits
    setpoint_m_s = cap(wished_m_s, limits, traits.speed_max_m_s)
    trim_m_s, expected_m_s = correct_trim(
        memory.trim_m_s,
        memory.expected_m_s,
        allowed_m_s,
        fleet.velocity_m_s,
        base_m_s,
        commanded,
        wished_m_s,
        setpoint_m_s,
        dt_s,
        settings.response_s,
        settings.trim_rate_per_s,
        settings.vertical_trim_rate_per_s,
        settings.trim_max_m_s,
    )
    pace = 1.0
    if memory.center is not None:
        most_m_s = np.minimum(limits.horizontal_m_s, traits.speed_max_m_s)
        pressed = formed & (np.hypot(wished_m_s[:, 0], wished_m_s[:, 1]) > PRESSED * most_m_s)
        lack_m_s = (base_m_s + expected_m_s - fleet.velocity_m_s)[pressed]
        pace = next_pace(memory.pace, _behind_m_s(lack_m_s, memory.center), dt_s)
    return setpoint_m_s, replace(memory, trim_m_s=trim_m_s, expected_m_s=expected_m_s, pace=pace)


def _behind_m_s(lack_m_s: Array, center: Center) -> float:
    """The largest lack of velocity (m, 3) along the centre's way; 0 while it stands."""
    speed_m_s = float(np.linalg.norm(center.velocity_m_s))
    if speed_m_s < STANDING_M_S or not len(lack_m_s):
        return 0.0
    return max(0.0, float((lack_m_s @ center.velocity_m_s).max()) / speed_m_s)


def ellipses_of(plan: Plan, settings: ControlSettings, time_s: float) -> dict[str, Ellipse]:
    """The plan's obstacles, where they are at `time_s`, as ellipses with the law's margins."""
    margin_m, headroom_m = settings.law.avoidance.margin_m, settings.law.avoidance.headroom_m
    return {
        box.id: Ellipse.around(box, margin_m=margin_m, headroom_m=headroom_m, time_s=time_s)
        for box in plan.obstacles
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
    wanted_m_s = wanted_center_velocity(
        ahead, plan, fleet.time_s + dt_s, law, reach_m=reach_m, pace=memory.pace
    )
    if not tasks.center_moves:
        wanted_m_s[:2] = 0.0
    around_m_s, sides = steer_center(
        center.position_m,
        wanted_m_s,
        fleet.position_m[formed],
        ellipses,
        memory.sides,
        law.avoidance,
        radius_m=radius_m,
        way=way_ahead(center.position_m, plan, fleet.time_s, moves=tasks.center_moves, reach_m=reach_m),
    )
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


def _spread(
    fleet: FleetState, formed: Mask, tasks: Tasks, traits: Traits, memory: Memory, settings: ControlSettings
) -> tuple[Memory, Array]:
    """Move the places on; the (m, 3) velocities that lead the m in formation to theirs."""
    center, law, limits = memory.center, settings.law, settings.safety.limits
    rows = np.flatnonzero(formed)
    place, change = np.full_like(memory.place, np.nan), np.zeros_like(memory.change)
    if center is None or len(rows) == 0:
        return replace(memory, place=place, change=change), np.zeros((0, 3))
    position_m = fleet.position_m[rows]
    direction, distance_m = directions_from(position_m, center.position_m)
    if tasks.sight is not None:
        own_m_s = sighted_velocity(
            position_m,
            kicks(direction, fleet.ids, rows),
            fleet.time_s - memory.engaged_time_s[rows],
            tasks.sight.only(formed),
            center,
            radius_m=memory.radius_m,
            settings=law,
        )
        return replace(memory, place=place, change=change), own_m_s
    places, changes = memory.place[rows], memory.change[rows]
    joining = np.flatnonzero(np.isnan(places[:, 0]))
    if len(joining):
        places[joining] = begun(direction[joining], fleet.ids, rows[joining], law)
        changes[joining] = 0.0
    places, changes = sweep(
        places, changes, direction, traits.charge[rows], sweeps_for(len(rows), law.sweeps), law.pull
    )
    place[rows], change[rows] = places, changes
    own_m_s = shrink_relative(
        center.velocity_m_s,
        place_velocity(direction, distance_m, places, memory.radius_m, law.place_rate_per_s, law.speed_m_s),
        limits.horizontal_m_s,
        limits.up_m_s,
        limits.down_m_s,
        traits.speed_max_m_s[rows],
    )
    return replace(memory, place=place, change=change), own_m_s


def _law(
    fleet: FleetState,
    formed: Mask,
    commanded: Mask,
    tasks: Tasks,
    ellipses: dict[str, Ellipse],
    own_m_s: Array,
    memory: Memory,
    settings: ControlSettings,
) -> Array:
    """(n, 3) velocities that law and goals want, obstacles avoided, within the speed limits."""
    law = settings.law
    wanted_m_s = np.zeros((len(fleet.ids), 3))
    sliding_m_s = np.zeros(len(fleet.ids))
    center = memory.center
    if center is not None and formed.any():
        wanted_m_s[formed] = own_m_s
        sliding_m_s[formed] = np.hypot(center.velocity_m_s[0], center.velocity_m_s[1])
    to_goal = commanded & (tasks.task == Task.GOAL)
    if to_goal.any():
        wanted_m_s[to_goal] = goal_velocity(fleet.position_m[to_goal], tasks.goal_m[to_goal], settings=law)
        sliding_m_s[to_goal] = 0.5 * np.hypot(wanted_m_s[to_goal, 0], wanted_m_s[to_goal, 1])
    limits = settings.safety.limits
    for rows, sides in ((formed, memory.sides), (to_goal, {})):
        if ellipses and rows.any():
            wanted_m_s[rows] = avoid_all(
                fleet.position_m[rows], wanted_m_s[rows], ellipses, sides, sliding_m_s[rows], law.avoidance
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


@cache
def warm_up() -> None:
    """Compile or load every kernel that a tick uses, so that nothing is compiled in the air."""
    safety_warm_up()
    steering_warm_up()
    n = 3
    place_m = np.array([[0.0, 0.0, -20.0], [4.0, 0.0, -20.0], [0.0, 4.0, -20.0]])
    fleet = FleetState(0.05, ("a", "b", "c"), place_m, np.zeros((n, 3)), np.zeros(n), np.zeros(n))
    tasks = Tasks(
        np.full(n, Task.FORMATION, dtype=np.int8),
        np.full((n, 3), np.nan),
        np.ones(n, dtype=bool),
        np.zeros(n, dtype=bool),
        np.zeros((0, 2, 3)),
        center_moves=True,
    )
    plan = Plan(Formation(10.0, 20.0))
    tick(fleet, tasks, plan, Traits.alike(n), Memory.fresh(n, 0.0), ControlSettings())
