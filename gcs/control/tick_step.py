"""The tick: its parts in their order, and the state kept for the next tick."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from math import radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs.control.area_graphs import prepare_ways
from gcs.control.area_routes import lead_within
from gcs.control.center import Lead, move_center
from gcs.control.desired_velocity import desired_velocity
from gcs.control.goal_routes import follow_routes
from gcs.control.inputs import ControlSettings, FormationState, Task, Tasks, TickInputs
from gcs.control.law_step import LawRunner, Spread, slots_m, spread
from gcs.control.memory import AreaWays, GoalRoutes, Memory
from gcs.control.others import Others
from gcs.control.round_obstacles import round_obstacles, waiting_places, without_way
from gcs.control.round_obstacles import warm_up as obstacles_warm_up
from gcs.control.setpoint_shaping import ShapedSetpoints, shape_setpoints
from gcs.formation.law import begun_yaw, desired_yaw_rad, turn_towards
from gcs.formation.laws.registry import SHIPPED, law_of
from gcs.formation.neighbours import Sight
from gcs.formation.orbit import Center
from gcs.formation.response import limit_change
from gcs.formation.route import warm_up as routes_warm_up
from gcs.model.jit import kernel
from gcs.model.plan import Formation, Obstacle, Orbit, Plan
from gcs.model.state import Array, FleetState, Mask, Setpoints, Traits, VehicleId
from gcs.safety.answers import Answers, compared
from gcs.safety.authority import Authority, measured, yielding
from gcs.safety.fenced_areas import FencedArea
from gcs.safety.filter import filter_velocities
from gcs.safety.filter import prepare as safety_prepare
from gcs.safety.filter import warm_up as safety_warm_up
from gcs.safety.floor import Floor, minimum_separation
from gcs.safety.surroundings import SafetySettings, Surroundings
from gcs.safety.traffic import give_way, keep_right, turn_early
from gcs.safety.walls import Fence


@dataclass(frozen=True, eq=False)
class Tick:
    """Result of one tick. With other stations' vehicles, n counts these as well, after the station's own."""

    setpoints: Setpoints
    remember: Callable[[], Memory]
    limited_by: tuple[str, ...]  # (n,) why the filter limited a vehicle, "" when it did not
    position_m: Array  # (n, 3) as estimated
    airborne: Mask  # (n,)
    floor: Floor
    elsewhere: tuple[VehicleId, ...] = ()  # the last of these n: vehicles of other stations

    @cached_property
    def memory(self) -> Memory:
        """State for the next tick; the first read computes it, so send the setpoints before."""
        return self.remember()

    @cached_property
    def minimum_separation_m(self) -> float:
        """Smallest estimated separation of the pairs that count; computed on demand, never in the tick."""
        return minimum_separation(self.position_m, self.airborne, self.floor)[0]

    @cached_property
    def own_separation_m(self) -> float:
        """The same of those pairs of which one vehicle at least is the station's own."""
        own = len(self.position_m) - len(self.elsewhere)
        return minimum_separation(self.position_m, self.airborne, self.floor, own)[0]


@dataclass(frozen=True, slots=True, eq=False)
class Velocities:
    """The velocities of a tick, each made of the one above; (n, 3) of the own vehicles, show frame."""

    desired_m_s: Array  # by the law or towards a goal, past obstacles, by the rules of traffic
    reached_m_s: Array  # of this, as far as acceleration and the vehicle's authority allow
    allowed_m_s: Array  # what the safety filter leaves
    setpoint_m_s: Array  # with inner loop and lead: what is sent
    yields: Mask  # (n,) does not follow its setpoints, so that `reached_m_s` follows it


class Aims(NamedTuple):
    """Where the vehicles fly to, on the way to their slots and goals."""

    slot_m: Array  # (n, 3)
    aim_m: Array  # (n, 3) the next corner of the way, or the goal
    aiming: NDArray[np.intp]  # (k,) rows that do
    straight: Mask  # (n,) flies straight there: out of the way of a box that moves
    routes: GoalRoutes | None
    ways: AreaWays | None
    no_way_s: Array | None  # (n,) as of `Memory`
    waits_at_m: Array | None  # (n, 3) as of `Memory`


def tick(
    fleet: FleetState,
    tasks: Tasks,
    plan: Plan,
    traits: Traits,
    memory: Memory,
    settings: ControlSettings,
    sight: Sight | None = None,
    others: Others | None = None,
    shared: FormationState | None = None,
    runner: LawRunner | None = None,
    proposed_m_s: Array | None = None,
) -> Tick:
    """Compute every commanded vehicle's setpoint for the instant `fleet.time_s`.

    Args:
        fleet: n vehicles, with what each has to do (`tasks`) and in what they differ (`traits`).
        tasks: of these n.
        plan: formation, orbit, target, obstacles, yaw.
        traits: of these n.
        memory: of the previous tick, or fresh; of n + k rows where there are `others`.
        settings: gains and limits.
        sight: what vehicles received from each other, for a law that takes it; None: all that is in range.
        others: k vehicles that are flown elsewhere.
        shared: the formation as another flight computes it; None: this one computes it.
        runner: computes the plan's law; None: it runs here.
        proposed_m_s: (n, 3) velocities instead of those of law and goals; NaN, and None: these.
    """
    now, mine, memory = _inputs(fleet, tasks, plan, traits, memory, settings, others, shared)
    authority = _authority(mine, memory)
    if np.count_nonzero(authority.slow):
        now, mine = (replace(each, traits=authority.limit(each.traits)) for each in (now, mine))
    lead = move_center(now, memory, shared)
    places = spread(now, lead, memory, sight, shared, runner)
    aims = _aims(now, memory, lead, places)
    desired_m_s, knows_center = _desired(now, lead, places, aims), places.answer.knows_center
    if proposed_m_s is not None:
        desired_m_s = np.where(np.isnan(proposed_m_s), desired_m_s, proposed_m_s)
        knows_center = False
    reached_m_s, yields = _reached(mine, memory, authority, desired_m_s)
    allowed_m_s, limited_by = _allowed(now, authority, aims.routes, reached_m_s, others)
    shaped = shape_setpoints(mine, allowed_m_s, lead.center, memory, knows_center=knows_center, yields=yields)
    sent = Velocities(desired_m_s, reached_m_s, allowed_m_s, shaped.setpoint_m_s, yields)
    yaw = _yaw(mine, memory)
    remember = partial(_remember, mine, memory, authority, lead, places, aims, sent, shaped, yaw)
    return _made(now, mine, sent, yaw, limited_by, remember)


def _inputs(
    fleet: FleetState,
    tasks: Tasks,
    plan: Plan,
    traits: Traits,
    memory: Memory,
    settings: ControlSettings,
    others: Others | None,
    shared: FormationState | None,
) -> tuple[TickInputs, TickInputs, Memory]:
    """Inputs of all vehicles and of the own ones, and the memory with rows for all."""
    own, count = (fleet, tasks, traits), len(fleet.ids)
    memory, pace = memory.of_own(count), 1.0
    if others is not None:
        pace = others.pace
        fleet, tasks, traits, memory = others.joined(fleet, tasks, traits, memory)
    follows = shared is not None and law_of(plan.formation.law).stations == "led"
    before_s = memory.time_s
    now = TickInputs.of(
        fleet, tasks, plan, traits, settings, before_s=before_s, own=count, follows=follows, pace=pace
    )
    return now, now if others is None else now.of_own(*own), memory


def _aims(now: TickInputs, memory: Memory, lead: Lead, places: Spread) -> Aims:
    slot_m = slots_m(now, lead, places)
    aim_m, aiming, routes = follow_routes(now, memory.routes, slot_m)
    aim_m, aiming, ways = lead_within(now, memory.ways, aim_m, aiming, slot_m)
    no_way_s = without_way(now, memory.no_way_s)
    aim_m, aiming, straight = round_obstacles(now, aim_m, aiming, slot_m, lead, no_way_s)
    waits_at_m = waiting_places(now, no_way_s, straight, memory.waits_at_m)
    if waits_at_m is not None:  # they would fly to and fro before the obstacles
        aim_m = np.where(np.isnan(waits_at_m), aim_m, waits_at_m)
    return Aims(slot_m, aim_m, aiming, straight, routes, ways, no_way_s, waits_at_m)


def _desired(now: TickInputs, lead: Lead, places: Spread, aims: Aims) -> Array:
    desired_m_s = desired_velocity(now, lead, places, *aims[:4])
    return _in_traffic(now, aims.aim_m, desired_m_s)[now.own]


def _reached(
    mine: TickInputs, memory: Memory, authority: Authority, desired_m_s: Array
) -> tuple[Array, Mask]:
    """What acceleration limit and authority leave of the desired velocities, and which vehicles yield."""
    possible_m_s = limit_change(
        desired_m_s, memory.desired_m_s, mine.velocity_m_s, mine.acceleration_max_m_s2, mine.dt_s
    )
    least = mine.settings.safety.authority
    return yielding(possible_m_s, mine.velocity_m_s, authority.lack_m_s, least.lack_m_s, least.reserve_m_s)


def _allowed(
    now: TickInputs,
    authority: Authority,
    routes: GoalRoutes | None,
    reached_m_s: Array,
    others: Others | None,
) -> tuple[Array, tuple[str, ...]]:
    """What the safety filter leaves to the own vehicles, and what limited each of all."""
    all_m_s, shared_m_s = (reached_m_s, None) if others is None else others.velocities(reached_m_s)
    around = _surroundings(now, authority, routes, shared_m_s)
    allowed_m_s, limited_by = filter_velocities(all_m_s, around, now.settings.safety)
    return allowed_m_s[now.own], limited_by


def _remember(
    mine: TickInputs,
    memory: Memory,
    authority: Authority,
    lead: Lead,
    places: Spread,
    aims: Aims,
    sent: Velocities,
    shaped: ShapedSetpoints,
    yaw: tuple[Array, Array],
) -> Memory:
    """State for the next tick."""
    law_state = places.answer.next_state()
    commanded_m_s, unfiltered_m_s, asked_m_s, setpoint_m_s = _of_commanded(
        mine.commanded,
        sent.allowed_m_s,
        sent.reached_m_s,
        sent.desired_m_s,
        sent.yields,
        sent.setpoint_m_s,
        memory.trim_m_s,
    )
    trim_m_s, expected_m_s, pace = shaped.learn()
    return Memory(
        time_s=mine.fleet.time_s,
        center=lead.center,
        radius_m=lead.radius_m,
        desired_m_s=commanded_m_s,
        unfiltered_m_s=unfiltered_m_s,
        asked_m_s=asked_m_s,
        setpoint_m_s=setpoint_m_s,
        yaw_rad=yaw[0],
        held_yaw_rad=yaw[1],
        engaged_time_s=lead.engaged_time_s,
        law=mine.plan.formation.law,
        law_state=law_state,
        led_m_s=places.led_m_s,
        trim_m_s=trim_m_s,
        expected_m_s=expected_m_s,
        pace=pace,
        sides=lead.sides,
        authority=authority,
        answers=_answers(mine, memory, authority),
        number=memory.number + 1,
        spin_rad_s=places.spin_rad_s,
        detour=lead.detour,
        routes=aims.routes,
        ways=aims.ways,
        no_way_s=aims.no_way_s,
        waits_at_m=aims.waits_at_m,
    )


def _made(
    now: TickInputs,
    mine: TickInputs,
    sent: Velocities,
    yaw: tuple[Array, Array],
    limited_by: tuple[str, ...],
    remember: Callable[[], Memory],
) -> Tick:
    setpoints = _setpoints(mine, sent.setpoint_m_s, yaw[0])
    floor, elsewhere = now.settings.safety.floor, now.fleet.ids[len(mine.fleet.ids) :]
    return Tick(setpoints, remember, limited_by, now.fleet.position_m, now.tasks.airborne, floor, elsewhere)


def _answers(now: TickInputs, memory: Memory, authority: Authority) -> Answers:
    return compared(
        memory.answers,
        memory.desired_m_s,
        now.velocity_m_s,
        now.commanded & ~now.fleet.doubtful,
        authority.lack_m_s,
        now.traits.response,
        dt_s=now.dt_s,
        link_delay_s=now.settings.safety.link_delay_s,
    )


def _in_traffic(now: TickInputs, aim_m: Array, desired_m_s: Array) -> Array:
    """(n, 3) desired velocities; vehicles on the way to a goal turn early, keep right, and give way."""
    if len(now.goers) == 0:
        return desired_m_s
    safety, goal_m = now.settings.safety, now.tasks.goal_m
    under_way = now.to_goal & ~now.descending
    if now.tasks.follows_planned_path is not None:
        under_way &= ~now.tasks.follows_planned_path
        if not under_way.any():
            return desired_m_s
    flatness, traffic = safety.floor.horizontal_m / safety.floor.vertical_m, safety.traffic
    early_m_s = turn_early(
        desired_m_s, now.position_m, aim_m, to_goal=under_way, flatness=flatness, settings=traffic
    )
    kept_m_s = keep_right(
        early_m_s,
        now.position_m,
        now.velocity_m_s,
        aim_m,
        to_goal=under_way,
        commanded=now.commanded,
        airborne=now.tasks.airborne,
        flatness=flatness,
        settings=traffic,
    )
    return give_way(kept_m_s, now.position_m, goal_m, to_goal=under_way, flatness=flatness, settings=traffic)


def _authority(now: TickInputs, memory: Memory) -> Authority:
    """What the vehicles' answers to the setpoints so far tell."""
    safety = now.settings.safety
    return measured(
        memory.authority,
        memory.desired_m_s,
        now.velocity_m_s,
        now.commanded & ~now.fleet.doubtful,
        np.minimum(now.traits.speed_max_m_s, safety.limits.horizontal_m_s),
        response=now.traits.response,
        dt_s=now.dt_s,
        link_delay_s=safety.link_delay_s,
        settings=safety.authority,
    )


@kernel
def _of_commanded(
    commanded: Mask,
    allowed_m_s: Array,
    reached_m_s: Array,
    desired_m_s: Array,
    yields: Mask,
    sent_m_s: Array,
    trim_m_s: Array,
) -> tuple[Array, Array, Array, Array]:
    """(n, 3) velocities as `desired_m_s`, `unfiltered_m_s`, `asked_m_s` and `setpoint_m_s` of Memory."""
    commanded_m_s, asked_m_s = np.full_like(allowed_m_s, np.nan), np.full_like(allowed_m_s, np.nan)
    unfiltered_m_s, setpoint_m_s = np.full_like(allowed_m_s, np.nan), np.full_like(allowed_m_s, np.nan)
    for i in range(len(commanded)):
        for axis in range(3):
            if commanded[i]:
                commanded_m_s[i, axis], unfiltered_m_s[i, axis] = allowed_m_s[i, axis], reached_m_s[i, axis]
                asked_m_s[i, axis] = desired_m_s[i, axis] if yields[i] else allowed_m_s[i, axis]
                setpoint_m_s[i, axis] = sent_m_s[i, axis] - trim_m_s[i, axis]
    return commanded_m_s, unfiltered_m_s, asked_m_s, setpoint_m_s


def _surroundings(
    now: TickInputs, authority: Authority, routes: GoalRoutes | None, shared_m_s: Array | None
) -> Surroundings:
    safety, lack_m_s = now.settings.safety, authority.lack_m_s
    others = len(now.commanded) - len(lack_m_s)
    if others:
        lack_m_s = np.concatenate([lack_m_s, np.zeros((others, 3))])
    wander_m = authority.wander_m(safety.authority, others)
    wander_m[now.descending] = 0.0
    position_m, velocity_m_s, airborne = now.position_m, now.velocity_m_s, now.tasks.airborne
    if now.tasks.segments_of is not None:
        position_m = position_m.copy()
        position_m[now.tasks.segments_of] = np.nan  # their paths are closed; where they are is not known
    if now.tasks.drift is not None:
        drifts = np.asarray(np.isfinite(now.tasks.drift[0]).all(axis=1))
        position_m = np.where(drifts[:, None], now.tasks.drift[0], position_m)
        velocity_m_s = np.where(drifts[:, None], now.tasks.drift[1], velocity_m_s)
        airborne = airborne | drifts
    return Surroundings(
        position_m,
        velocity_m_s,
        now.commanded,
        airborne,
        now.descending,
        now.tasks.segments_m,
        now.ellipses,
        now.fleet.ids,
        now.traits.uncertainty_m,
        now.traits.speed_max_m_s,
        lack_m_s,
        wander_m,
        now.tasks.segments_of,
        now.tasks.drift,
        None if routes is None else routes.passage,
        now.stops,
        None if now.tasks.drawn is None else now.tasks.task == Task.DRAWN,
        now.tasks.near_traffic,
        shared_m_s,
        (now.plan.target, *now.tasks.kept_clear),
        now.fleet.time_s,
        now.to_goal & ~now.descending,
        now.low,
    )


def _yaw(now: TickInputs, memory: Memory) -> tuple[Array, Array]:
    """Commanded yaw and yaw at engagement, (n,) each; NaN where not commanded."""
    measured_rad = np.array(now.fleet.yaw_rad)
    so_far_rad, held_rad = begun_yaw(now.commanded, memory.yaw_rad, memory.held_yaw_rad, measured_rad)
    target_m = np.array(now.plan.target.position_m(now.fleet.time_s))
    desired_rad = desired_yaw_rad(now.plan.yaw, held_rad, now.position_m, target_m)
    if now.tasks.drawn is not None and now.tasks.drawn.yaw_rad is not None:
        drawn = now.drawn_rows
        drawn_rad = now.tasks.drawn.yaw_rad[drawn]
        desired_rad[drawn] = np.where(np.isfinite(drawn_rad), drawn_rad, desired_rad[drawn])
    rate_rad_s = radians(now.settings.yaw_rate_max_deg_s)
    return turn_towards(so_far_rad, desired_rad, rate_rad_s, now.dt_s), held_rad


def _setpoints(now: TickInputs, setpoint_m_s: Array, yaw_rad: Array) -> Setpoints:
    """Setpoints of the rows of (n, 3) that are commanded and have a yaw."""
    ids, time_s = now.fleet.ids, now.fleet.time_s
    rows = (now.commanded & np.isfinite(yaw_rad)).nonzero()[0]
    if len(rows) == len(ids):
        return Setpoints(time_s, ids, setpoint_m_s.copy(), yaw_rad.copy())  # frozen
    ids = tuple(ids[row] for row in rows.tolist())
    return Setpoints(time_s, ids, setpoint_m_s[rows], yaw_rad[rows])


def prepare(safety: SafetySettings) -> None:
    """Make the tables and graphs of a site, so that none is made in flight: that takes up to seconds."""
    safety_prepare(safety)
    prepare_ways(safety)


@cache
def warm_up() -> None:
    """Compile or load every kernel that a tick uses, so that nothing is compiled in flight."""
    safety_warm_up()
    routes_warm_up()
    obstacles_warm_up()
    n, tower = 5, Obstacle("tower", 10.0, 0.0, 5.0, 5.0, 30.0)
    place_m = np.array(
        [[0.0, 0.0, -20.0], [4.0, 0.0, -20.0], [0.0, 4.0, -20.0], [8.0, 8.0, -9.0], [9.0, 0.0, -9.0]]
    )
    fleet = FleetState(0.05, tuple("abcde"), place_m, np.zeros((n, 3)), np.zeros(n), np.zeros(n))
    tasks = replace(Tasks.of_formation(n, center_moves=True), goal_m=place_m[::-1].copy())
    tasks.task[3:] = Task.GOAL
    plan, traits, settings = Plan(Formation(10.0, 20.0), Orbit(15.0, 2.0)), Traits.alike(n), ControlSettings()
    under_way = Center(np.array([0.0, 0.0, -20.0]), np.array([2.0, 0.0, 0.0]), np.zeros(3))
    memory = replace(Memory.fresh(n, 0.0), center=under_way, radius_m=10.0)

    def finish(first: Tick) -> Memory:
        return first.memory  # the first read moves the slots on

    for obstacles in ((), (tower,)):
        finish(tick(fleet, tasks, replace(plan, obstacles=obstacles), traits, memory, settings))
    lost_m = np.array([[[6.0, 4.0, -20.0], [6.0, 4.0, 0.0]]])  # between a vehicle and its goal
    for obstacles in ((), (tower,)):
        among = replace(plan, obstacles=obstacles)
        finish(tick(fleet, replace(tasks, segments_m=lost_m), among, traits, memory, settings))
    between = FencedArea(corners_m=((5.0, -9.0), (7.0, -9.0), (7.0, 5.0), (5.0, 5.0)), inside=False)
    site = SafetySettings(fence=Fence(areas=(between,)))
    prepare(site)
    finish(tick(fleet, tasks, plan, traits, memory, ControlSettings(safety=site)))
    for law in SHIPPED:
        other = replace(plan, formation=replace(plan.formation, law=law))
        finish(tick(fleet, tasks, other, traits, memory, settings))
