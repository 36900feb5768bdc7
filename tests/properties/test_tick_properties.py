"""What no tick may do, whatever is desired."""

from dataclasses import replace
from math import radians

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gcs.control import ControlSettings, Memory, Task, Tasks, Tick, tick
from gcs.model.frames import wrap_rad
from gcs.model.plan import Formation, Orbit, Plan, Target, Yaw, YawPolicy
from gcs.model.state import FleetState, Traits
from tests.support.law_fleets import COUNTS, masks, obstacles, places, vectors, within
from tests.support.safety_fleets import (
    CALM,
    NO_PATHS,
    TICK_S,
    assert_within_limits,
)

CONTROL = ControlSettings()


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
def test_without_task_or_fresh_telemetry_no_command(
    batch: tuple[FleetState, Tasks, Plan],
) -> None:
    fleet, tasks, _ = batch
    known = np.isfinite(np.column_stack([fleet.position_m, fleet.velocity_m_s])).all(axis=1)
    may = (
        ~np.isin(tasks.task, (Task.NONE, Task.ELSEWHERE))
        & known
        & (fleet.age_s <= CONTROL.telemetry_age_max_s)
    )
    may &= np.isfinite(fleet.yaw_rad)
    listed = [name for name, allowed in zip(fleet.ids, may, strict=True) if allowed]
    assert list(flown(*batch).setpoints.ids) == listed


@CALM
@given(within(-40.0, 40.0), within(0.0, 1.9), within(-2.0, 2.0), st.booleans())
def test_no_vehicle_lands_on_the_place_of_another(
    off_m: float, height_m: float, beside_m: float, descends: bool
) -> None:
    """Others may push a descending vehicle aside; on the ground it would take the place of another."""
    place_m = np.array([[off_m, 0.0, -height_m], [90.0, 0.0, -40.0]])
    fleet = FleetState(100.0, ("d0", "d1"), place_m, np.zeros((2, 3)), np.zeros(2), np.zeros(2))
    task, goal_m = np.full(2, Task.GOAL, dtype=np.int8), np.array([[0.0, 0.0, 0.0], [off_m, beside_m, 0.0]])
    tasks = Tasks(task, goal_m, np.ones(2, np.bool_), np.array([descends, False]), NO_PATHS, False)
    down_m_s = flown(fleet, tasks, Plan(Formation(10.0, 30.0))).setpoints.velocity_m_s[0, 2]
    if not descends or abs(off_m) > 2.31:
        assert down_m_s <= 0.0
    elif abs(off_m) < 2.0 and height_m > 0.5:
        assert down_m_s > 0.0


@CALM
@given(batches())
def test_yaw_starts_at_the_heading_and_keeps_its_rate(
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
def test_desired_velocity_continues_without_a_jump(
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
    both = np.isfinite(memory.desired_m_s).all(axis=1) & np.isfinite(after.desired_m_s).all(axis=1)
    inside = both & (np.abs(fleet.position_m[:, 2] + 30.0) < 20.0)  # the fence does not speak up
    change = np.linalg.norm(after.desired_m_s - memory.desired_m_s, axis=1)
    assert (change[inside] <= CONTROL.acceleration_max_m_s2 * TICK_S * (1 + 1e-9)).all()


def replace_time(fleet: FleetState, time_s: float) -> FleetState:
    return FleetState(time_s, fleet.ids, fleet.position_m, fleet.velocity_m_s, fleet.yaw_rad, fleet.age_s)


@CALM
@given(batches(), st.permutations(range(6)))
def test_vehicle_order_does_not_matter(batch: tuple[FleetState, Tasks, Plan], permutation: list[int]) -> None:
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
    assert set(here.ids) == set(there.ids)
    rows = [there.ids.index(name) for name in here.ids]
    assert (there.yaw_rad[rows] == here.yaw_rad).all()
    np.testing.assert_allclose(there.velocity_m_s[rows], here.velocity_m_s, rtol=0.0, atol=1e-6)
