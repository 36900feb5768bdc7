"""What no setpoint may do, whatever is asked for."""

from dataclasses import replace
from math import radians

import numpy as np
from hypothesis import assume, event, given, settings
from hypothesis import strategies as st
from law_fleets import COUNTS, masks, obstacles, places, vectors, within

from gcs.control import ControlSettings, Memory, Task, Tasks, Tick, tick
from gcs.formation.obstacles import Ellipse
from gcs.frames import wrap_rad
from gcs.plan import Formation, Obstacle, Orbit, Plan, Target, Yaw, YawPolicy
from gcs.safety.constraints import NOBODY, Constraints
from gcs.safety.filter import Surroundings, cap, filter_velocities
from gcs.safety.projection import project, shrink
from gcs.safety.separation import Floor, keepout_constraints, separation_constraints
from gcs.safety.walls import obstacle_constraints
from gcs.state import Array, FleetState, Mask, Traits

CALM = settings(deadline=None, derandomize=True, max_examples=80)
CONTROL = ControlSettings()
SAFETY = CONTROL.safety
LIMITS = SAFETY.limits
TICK_S = 0.05
NO_PATHS = np.zeros((0, 2, 3))
OPEN = SAFETY.model_copy(
    update={
        "fence": SAFETY.fence.model_copy(
            update={"height_min_m": 0.5, "height_max_m": 1e4, "distance_max_m": 1e4}
        )
    }
)


def assert_within_limits(velocity: Array) -> None:
    assert np.isfinite(velocity).all()
    assert (np.hypot(velocity[:, 0], velocity[:, 1]) <= LIMITS.horizontal_m_s * (1 + 1e-9)).all()
    assert (-velocity[:, 2] <= LIMITS.up_m_s * (1 + 1e-9)).all()
    assert (velocity[:, 2] <= LIMITS.down_m_s * (1 + 1e-9)).all()


# the tick


@st.composite
def batches(draw: st.DrawFn) -> tuple[FleetState, Tasks, Plan]:
    """A fleet in any state, some of it unknown or old, with any tasks and any plan."""
    n = draw(COUNTS)
    position, velocity = draw(places(n)), draw(vectors(n, 8.0))
    yaw = np.array(draw(st.lists(within(-3.1, 3.1), min_size=n, max_size=n)))
    age = np.array(
        draw(st.lists(st.sampled_from([0.0, 0.02, 0.49, 0.51, 30.0, np.inf]), min_size=n, max_size=n))
    )
    for array in (position, velocity, yaw):
        array[draw(masks(n)) & draw(masks(n))] = np.nan
    task = np.array(draw(st.lists(st.sampled_from(Task), min_size=n, max_size=n)), dtype=np.int8)
    segments = draw(vectors(2, 40.0)).reshape(1, 2, 3) if draw(st.booleans()) else NO_PATHS
    tasks = Tasks(task, draw(places(n)), draw(masks(n)), draw(masks(n)), segments, draw(st.booleans()))
    plan = Plan(
        Formation(draw(within(5.0, 20.0)), 30.0),
        Orbit(draw(st.sampled_from([0.0, 15.0])), 2.0),
        Target(draw(within(-20.0, 20.0)), 3.0, 0.5, -0.5),
        tuple(draw(st.lists(obstacles(), max_size=1))),
        Yaw(draw(st.sampled_from(YawPolicy)), 1.0),
    )
    ids = tuple(f"d{i}" for i in range(n))
    return FleetState(100.0, ids, position, velocity, yaw, age), tasks, plan


def flown(fleet: FleetState, tasks: Tasks, plan: Plan, memory: Memory | None = None) -> Tick:
    before = Memory.fresh(len(fleet.ids), fleet.time_s - TICK_S) if memory is None else memory
    return tick(fleet, tasks, plan, Traits.alike(len(fleet.ids)), before, CONTROL)


@CALM
@given(batches())
def test_no_setpoint_breaks_a_limit(batch: tuple[FleetState, Tasks, Plan]) -> None:
    assert_within_limits(flown(*batch).setpoints.velocity_m_s)


@CALM
@given(batches())
def test_a_vehicle_without_a_task_or_without_fresh_known_telemetry_is_not_commanded(
    batch: tuple[FleetState, Tasks, Plan],
) -> None:
    fleet, tasks, _ = batch
    known = np.isfinite(np.column_stack([fleet.position_m, fleet.velocity_m_s])).all(axis=1)
    may = (tasks.task != Task.NONE) & known & (fleet.age_s <= CONTROL.telemetry_age_max_s)
    may &= np.isfinite(fleet.yaw_rad)
    listed = [name for name, allowed in zip(fleet.ids, may, strict=True) if allowed]
    assert list(flown(*batch).setpoints.ids) == listed


@CALM
@given(batches())
def test_yaw_begins_where_the_vehicle_looks_and_turns_no_faster_than_its_rate(
    batch: tuple[FleetState, Tasks, Plan],
) -> None:
    fleet = batch[0]
    setpoints = flown(*batch).setpoints
    rows = [fleet.ids.index(name) for name in setpoints.ids]
    turned = np.abs(wrap_rad(setpoints.yaw_rad - fleet.yaw_rad[rows]))
    assert (turned <= radians(CONTROL.yaw_rate_max_deg_s) * TICK_S + 1e-9).all()
    assert np.isfinite(setpoints.yaw_rad).all()


@CALM
@given(batches())
def test_the_wanted_velocity_of_a_tick_follows_from_the_one_before_without_a_jump(
    batch: tuple[FleetState, Tasks, Plan],
) -> None:
    fleet, tasks, plan = batch
    free = replace(plan, obstacles=())
    alone = Tasks(
        tasks.task, tasks.goal_m, np.zeros(len(fleet.ids), bool), np.ones(len(fleet.ids), bool), NO_PATHS
    )
    memory = flown(fleet, alone, free).memory
    later = replace_time(fleet, fleet.time_s + TICK_S)
    after = flown(later, alone, free, memory).memory
    both = np.isfinite(memory.wanted_m_s).all(axis=1) & np.isfinite(after.wanted_m_s).all(axis=1)
    inside = both & (np.abs(fleet.position_m[:, 2] + 30.0) < 20.0)  # the fence does not speak up
    change = np.linalg.norm(after.wanted_m_s - memory.wanted_m_s, axis=1)
    assert (change[inside] <= CONTROL.acceleration_max_m_s2 * TICK_S * (1 + 1e-9)).all()


def replace_time(fleet: FleetState, time_s: float) -> FleetState:
    return FleetState(time_s, fleet.ids, fleet.position_m, fleet.velocity_m_s, fleet.yaw_rad, fleet.age_s)


@CALM
@given(batches(), st.permutations(range(6)))
def test_the_order_of_the_fleet_does_not_matter(
    batch: tuple[FleetState, Tasks, Plan], permutation: list[int]
) -> None:
    fleet, tasks, plan = batch
    order = [row for row in permutation if row < len(fleet.ids)]
    shuffled = FleetState(
        fleet.time_s,
        tuple(fleet.ids[row] for row in order),
        fleet.position_m[order],
        fleet.velocity_m_s[order],
        fleet.yaw_rad[order],
        fleet.age_s[order],
    )
    their_tasks = Tasks(
        tasks.task[order],
        tasks.goal_m[order],
        tasks.airborne[order],
        tasks.descending[order],
        tasks.segments_m,
        tasks.center_moves,
    )
    here, there = flown(fleet, tasks, plan).setpoints, flown(shuffled, their_tasks, plan).setpoints
    by_name = dict(zip(there.ids, there.yaw_rad, strict=True))
    assert set(here.ids) == set(there.ids)
    assert all(by_name[name] == yaw for name, yaw in zip(here.ids, here.yaw_rad, strict=True))


# the filter


@st.composite
def legal_fleets(draw: st.DrawFn) -> tuple[Array, Array]:
    """Positions no pair of which is inside the floor, and wanted velocities of any size."""
    n = draw(st.integers(2, 6))
    position = draw(vectors(n, 8.0)) - (0.0, 0.0, 30.0)
    assume(closest(position) >= SAFETY.floor.horizontal_m)
    return position, draw(vectors(n, 12.0))


def closest(position: Array) -> float:
    first, second = np.triu_indices(len(position), 1)
    scaled = (position[first] - position[second]) * SAFETY.floor.scale
    return float(np.linalg.norm(scaled, axis=1).min(initial=np.inf))


def around(
    position: Array,
    *,
    commanded: Mask | None = None,
    segments: Array = NO_PATHS,
    ellipses: dict[str, Ellipse] | None = None,
) -> Surroundings:
    n = len(position)
    return Surroundings(
        position,
        np.zeros((n, 3)),
        np.ones(n, dtype=bool) if commanded is None else commanded,
        np.ones(n, dtype=bool),
        np.zeros(n, dtype=bool),
        segments,
        ellipses or {},
        [f"d{i}" for i in range(n)],
        np.zeros(n),
        np.full(n, np.inf),
    )


@CALM
@given(legal_fleets())
def test_the_filter_never_brings_a_legal_pair_below_the_floor_in_one_step(
    fleet: tuple[Array, Array],
) -> None:
    position, wanted = fleet
    allowed, _ = filter_velocities(wanted, around(position), SAFETY)
    assert closest(position + TICK_S * allowed) >= SAFETY.floor.horizontal_m - 1e-3


@CALM
@given(legal_fleets())
def test_whoever_keeps_floor_and_margin_keeps_them_for_the_whole_reaction_time(
    fleet: tuple[Array, Array],
) -> None:
    position, wanted = fleet
    apart_m = SAFETY.floor.horizontal_m + SAFETY.floor.margin_m
    assume(closest(position) >= apart_m)
    allowed, _ = filter_velocities(wanted, around(position), SAFETY)
    for later_s in np.linspace(0.0, SAFETY.braking.reaction_s, 6):
        assert closest(position + later_s * allowed) >= apart_m - 2e-3


@CALM
@given(
    legal_fleets(), masks(6), vectors(6, 5.0), st.permutations(range(6)), within(-3.0, 3.0), vectors(1, 50.0)
)
def test_the_filter_does_the_same_wherever_whichever_way_round_and_in_whatever_order(
    fleet: tuple[Array, Array], mask: Mask, moving: Array, permutation: list[int], turn: float, away: Array
) -> None:
    position, wanted = fleet
    assume(closest(position) >= SAFETY.floor.horizontal_m + SAFETY.floor.margin_m)  # a solution exists
    n = len(position)
    here = replace(around(position, commanded=mask[:n]), velocity_m_s=moving[:n])
    order = np.array([row for row in permutation if row < n])
    turned = np.array(
        [[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]]
    )
    there = replace(
        around((position[order] + away * (1.0, 1.0, 0.0)) @ turned.T, commanded=here.commanded[order]),
        velocity_m_s=moving[order] @ turned.T,
    )
    allowed, _ = filter_velocities(wanted, here, OPEN)
    again, _ = filter_velocities(wanted[order] @ turned.T, there, OPEN)
    event(f"restrained: {not np.allclose(allowed, cap(wanted, LIMITS))}")
    assert np.allclose(again, allowed[order] @ turned.T, atol=0.05)


@CALM
@given(legal_fleets(), masks(6))
def test_the_filter_keeps_the_limits_and_moves_nobody_it_does_not_command(
    fleet: tuple[Array, Array], mask: Mask
) -> None:
    position, wanted = fleet
    commanded = mask[: len(position)]
    allowed, reasons = filter_velocities(wanted, around(position, commanded=commanded), SAFETY)
    assert_within_limits(allowed)
    assert not allowed[~commanded].any()
    assert not any(reason for reason, ours in zip(reasons, commanded, strict=True) if not ours)


@CALM
@given(legal_fleets())
def test_velocities_that_break_nothing_come_back_unchanged(fleet: tuple[Array, Array]) -> None:
    position, wanted = fleet
    allowed, _ = filter_velocities(wanted, around(position), SAFETY)
    again, reasons = filter_velocities(allowed, around(position), SAFETY)
    assume(closest(position) >= SAFETY.floor.horizontal_m + SAFETY.floor.margin_m)
    assert np.allclose(again, allowed, atol=5e-3)
    assert not any(reasons)


def gap_to_box_m(position: Array, obstacle: Obstacle, time_s: float) -> Array:
    """(n,) shortest way to the box grown by 2 m beside and 3 m above; 0 inside."""
    beside = np.abs(position[:, :2] - obstacle.position_m(time_s)) - (
        obstacle.half_length_x_m + 2.0,
        obstacle.half_length_y_m + 2.0,
    )
    above = -position[:, 2] - obstacle.height_m - 3.0
    gap: Array = np.linalg.norm(np.maximum(np.column_stack([beside, above]), 0.0), axis=1)
    return gap


@CALM
@given(obstacles(), places(4), vectors(4, 12.0), vectors(1, 2.0))
def test_no_filtered_step_leads_into_an_obstacle_even_one_that_moves(
    obstacle: Obstacle, position: Array, wanted: Array, moves: Array
) -> None:
    obstacle = replace(obstacle, velocity_x_m_s=moves[0, 0], velocity_y_m_s=moves[0, 1])
    ellipse = Ellipse.around(obstacle, margin_m=2.0, headroom_m=3.0)
    fence = SAFETY.fence.model_copy(update={"height_min_m": 0.5, "height_max_m": 1e3, "distance_max_m": 1e3})
    floor = Floor(horizontal_m=1e-3, vertical_m=1e-3, margin_m=0.0, uncertainty_m=0.0)
    lenient = SAFETY.model_copy(update={"fence": fence, "floor": floor})
    outside = gap_to_box_m(position, obstacle, 0.0) > 0.0
    assume(closest(position) >= 0.01)
    allowed, _ = filter_velocities(wanted, around(position, ellipses={"b": ellipse}), lenient)
    later = position + TICK_S * allowed
    event(f"beside: {outside.any()}, inside: {(~outside).any()}")
    clear = gap_to_box_m(position, obstacle, 0.0) > 2e-3
    assert (gap_to_box_m(later, obstacle, TICK_S)[clear] > 0.0).all()
    assert (allowed[~outside, 2] <= 2e-3).all()


@CALM
@given(places(3), vectors(3, 12.0), vectors(2, 40.0))
def test_no_filtered_step_leads_onto_the_path_of_a_lost_vehicle(
    position: Array, wanted: Array, ends: Array
) -> None:
    segment = (ends * (1.0, 1.0, 0.0) - [(0.0, 0.0, 40.0), (0.0, 0.0, 0.0)]).reshape(1, 2, 3)
    floor = SAFETY.floor.model_copy(update={"pad_height_m": 0.0})
    lenient = SAFETY.model_copy(update={"floor": floor})
    assume(closest(position) >= floor.horizontal_m + floor.margin_m)
    far = scaled_to_segment(position, segment[0]) >= floor.horizontal_m + floor.margin_m
    assume(far.all())
    allowed, _ = filter_velocities(wanted, around(position, segments=segment), lenient)
    later = scaled_to_segment(position + TICK_S * allowed, segment[0])
    assert (later >= floor.horizontal_m + floor.margin_m - 2e-3).all()


def scaled_to_segment(position: Array, segment: Array) -> Array:
    """Distances to many points of the segment, in the floor's metric."""
    shares = np.linspace(0.0, 1.0, 801)[:, None]
    points = (segment[0] + shares * (segment[1] - segment[0])) * SAFETY.floor.scale
    distance: Array = np.linalg.norm((position * SAFETY.floor.scale)[:, None] - points[None], axis=2).min(
        axis=1
    )
    return distance


FASTEST_M_S = float(np.hypot(LIMITS.horizontal_m_s, max(LIMITS.up_m_s, LIMITS.down_m_s)))


def filtered(wanted: Array, here: Surroundings, fastest_m_s: float) -> tuple[Array, int]:
    """As `filter_velocities`, and of how many constraints."""
    pairs = separation_constraints(
        here.position_m,
        here.velocity_m_s,
        here.commanded,
        here.airborne,
        floor=SAFETY.floor,
        braking=SAFETY.braking,
        uncertainty_m=here.uncertainty_m,
        course_m_s=np.zeros((len(wanted), 3)),
        spare_m_s=np.full(len(wanted), fastest_m_s),
    )
    separation = Constraints(pairs.first, pairs.second, pairs.normal, pairs.bound_m_s, ("pair",) * len(pairs))
    keepout = keepout_constraints(
        here.position_m,
        here.commanded,
        here.segments_m,
        floor=SAFETY.floor,
        braking=SAFETY.braking,
        uncertainty_m=here.uncertainty_m,
        fastest_m_s=fastest_m_s,
    )
    walls = obstacle_constraints(
        here.position_m, here.commanded, here.ellipses, SAFETY.braking, fastest_m_s=fastest_m_s
    )
    constraints = Constraints.joined(separation, keepout, walls)
    asked = cap(np.where(here.commanded[:, None], wanted, 0.0), LIMITS)
    return shrink(cap(project(asked, constraints), LIMITS), constraints), len(constraints)


@CALM
@given(
    vectors(5, 250.0),
    vectors(5, 12.0),
    masks(5),
    vectors(2, 250.0),
    st.lists(obstacles(), min_size=1, max_size=5),
)
def test_what_the_filter_leaves_out_as_too_far_away_changes_nothing(
    spread: Array, wanted: Array, commanded: Mask, ends: Array, boxes: list[Obstacle]
) -> None:
    position = spread * (1.0, 1.0, 0.1) - (0.0, 0.0, 30.0)
    ellipses = {
        str(index): Ellipse.around(box, margin_m=2.0, headroom_m=3.0) for index, box in enumerate(boxes)
    }
    here = around(position, commanded=commanded, segments=ends.reshape(1, 2, 3), ellipses=ellipses)
    kept, many = filtered(wanted, here, 1e3)
    cut, few = filtered(wanted, here, FASTEST_M_S)
    event(f"left out: {'some' if few < many else 'none'}")
    assert np.allclose(cut, kept, atol=2e-3)


@CALM
@given(places(4), vectors(4, 12.0), obstacles())
def test_what_is_left_out_as_too_far_away_no_velocity_within_the_limits_could_break(
    position: Array, wanted: Array, obstacle: Obstacle
) -> None:
    ellipses = {"b": Ellipse.around(obstacle, margin_m=2.0, headroom_m=3.0)}
    everybody = np.ones(4, dtype=bool)
    every = obstacle_constraints(position, everybody, ellipses, SAFETY.braking)
    kept = obstacle_constraints(position, everybody, ellipses, SAFETY.braking, fastest_m_s=2.0)
    left_out = every.bound_m_s < -2.0 * 2.0
    assert len(kept) >= len(every) - left_out.sum()
    slow = cap(wanted, LIMITS) * (2.0 / FASTEST_M_S)
    assert (every.slack_m_s(slow)[left_out] > 0.0).all()


# its parts


@st.composite
def half_spaces(draw: st.DrawFn) -> tuple[Array, Constraints]:
    """Velocities of four vehicles and up to eight constraints over them, those that rest satisfies."""
    k = draw(st.integers(1, 8))
    raw = draw(vectors(k, 1.0))
    assume(np.linalg.norm(raw, axis=1).min() > 0.1)
    first = np.array(draw(st.lists(st.integers(0, 3), min_size=k, max_size=k)))
    step = np.array(draw(st.lists(st.integers(0, 3), min_size=k, max_size=k)))
    second = np.where(step == 0, NOBODY, (first + step) % 4)
    bound = -np.array(draw(st.lists(within(0.0, 3.0), min_size=k, max_size=k)))
    normal = raw / np.linalg.norm(raw, axis=1, keepdims=True)
    return draw(vectors(4, 8.0)), Constraints(first, second, normal, bound, ("c",) * k)


@CALM
@given(half_spaces())
def test_shrinking_only_shortens_and_ends_with_everything_kept(drawn: tuple[Array, Constraints]) -> None:
    velocity, constraints = drawn
    shrunk = shrink(velocity, constraints)
    before, after = np.linalg.norm(velocity, axis=1), np.linalg.norm(shrunk, axis=1)
    assert (after <= before + 1e-12).all()
    assert np.allclose(np.cross(shrunk, velocity), 0.0, atol=1e-9)
    assert ((shrunk * velocity).sum(axis=1) >= 0.0).all()
    assert (constraints.slack_m_s(shrunk) >= -1.1e-3).all()


@CALM
@given(half_spaces(), vectors(4, 1.0))
def test_no_legal_velocity_is_nearer_to_the_wanted_one_than_the_projection(
    drawn: tuple[Array, Constraints], other: Array
) -> None:
    wanted, constraints = drawn
    projected = project(wanted, constraints)
    legal = shrink(projected + other, constraints)  # any legal point near it
    assume((constraints.slack_m_s(legal) >= 0.0).all())
    assert np.linalg.norm(projected - wanted) <= np.linalg.norm(legal - wanted) + 0.05


@CALM
@given(vectors(5, 1e6), masks(5))
def test_whatever_is_not_finite_becomes_rest_and_the_rest_is_within_limits(wanted: Array, bad: Mask) -> None:
    spoiled = wanted.copy()
    spoiled[bad, 1] = np.nan
    capped = cap(spoiled, LIMITS)
    assert_within_limits(capped)
    assert not capped[bad].any()
    assert np.allclose(np.cross(capped[~bad], wanted[~bad]) / 1e6, 0.0, atol=1e-6)
