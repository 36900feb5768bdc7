"""Gains and limits of the tick are those of each vehicle's autopilot."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.control import ControlSettings, Memory, Task, Tasks, tick
from gcs.control.tick_step import Tick
from gcs.formation.orbit import Center
from gcs.model.plan import Formation, Plan
from gcs.model.response import FleetResponse, Response
from gcs.model.state import Array, FleetState, Traits

RAMPED = Response(acceleration_m_s2=2.0, swings_s=0.45, loop_share=0.0, lead_share=0.0, trim_share=0.0)
PLAN = Plan(Formation(10.0, 20.0))
TICK_S = 0.05
PLACE_M = np.array([[0.0, -30.0, -20.0], [0.0, 30.0, -20.0]])


def to_goals(
    vehicles: list[Response], goal_m: Array, memory: Memory, *, time_s: float = TICK_S, velocity: Array
) -> Tick:
    n = len(vehicles)
    none, ids = np.zeros(n, np.bool_), tuple(f"d{row}" for row in range(n))
    fleet = FleetState(time_s, ids, PLACE_M[:n].copy(), velocity, np.zeros(n), np.zeros(n))
    task = np.full(n, Task.GOAL, np.int8)
    tasks = Tasks(task, goal_m.copy(), ~none, none, np.zeros((0, 2, 3)))
    traits = replace(Traits.alike(n), response=FleetResponse.of(vehicles))
    return tick(fleet, tasks, PLAN, traits, memory, ControlSettings())


def long_flown(vehicles: list[Response], goal_m: Array, seconds: float) -> tuple[Array, Memory]:
    """Setpoints and memory of vehicles that fly at 1 m/s whatever they are commanded, without moving."""
    n = len(vehicles)
    memory, sent = Memory.fresh(n, 0.0), np.zeros((n, 3))
    velocity = np.tile([1.0, 0.0, 0.0], (n, 1))
    for index in range(1, round(seconds / TICK_S) + 1):
        result = to_goals(vehicles, goal_m, memory, time_s=TICK_S * index, velocity=velocity.copy())
        memory, sent = result.memory, result.setpoints.velocity_m_s
    return np.array(sent), memory


FAR_M = PLACE_M + np.array([100.0, 0.0, 0.0])


def test_only_a_vehicle_that_needs_it_is_asked_for_more() -> None:
    sent, memory = long_flown([Response(), RAMPED], FAR_M, 1.0)
    assert sent[0, 0] > memory.desired_m_s[0, 0] + 0.5
    assert sent[1] == pytest.approx(memory.desired_m_s[1])
    assert memory.trim_m_s[0, 0] > 0.0
    assert (memory.trim_m_s[1] == 0.0).all()


def test_velocity_changes_no_faster_than_each_autopilot_flies() -> None:
    first = to_goals([Response(), RAMPED], FAR_M, Memory.fresh(2, 0.0), velocity=np.zeros((2, 3)))
    reached = first.memory.desired_m_s[:, 0]
    assert reached == pytest.approx([ControlSettings().acceleration_max_m_s2 * TICK_S, 2.0 * TICK_S])


def test_a_ramp_slows_down_where_it_can_still_stop_at_its_goal() -> None:
    goal_m = PLACE_M + np.array([4.0, 0.0, 0.0])
    settings = ControlSettings()
    memory = Memory.fresh(2, 0.0)
    for index in range(1, 61):  # they fly what is allowed, and are carried back all the time
        velocity = np.nan_to_num(memory.desired_m_s)
        memory = to_goals(
            [Response(), RAMPED], goal_m, memory, time_s=TICK_S * index, velocity=velocity
        ).memory
    proportional_m_s = min(settings.law.speed_m_s, 4.0 * settings.law.goal_rate_per_s)
    stops_m_s = float(settings.safety.braking.speed_m_s(np.array([4.0]))[0])
    assert memory.desired_m_s[0, 0] == pytest.approx(proportional_m_s, abs=1e-3)
    assert memory.desired_m_s[1, 0] == pytest.approx(stops_m_s, abs=1e-3)
    assert stops_m_s < proportional_m_s


@pytest.mark.parametrize("law", ["article", "neighbours"])
def test_a_ramp_slows_down_where_it_can_still_stop_at_the_sphere(law: str) -> None:
    """A law of forces leads to no slot: its velocity says how far away the place is."""
    center_m, n = np.array([0.0, 0.0, -20.0]), 2
    place_m = center_m + np.array([[14.0, 0.0, 0.0], [-14.0, 0.0, 0.0]])
    plan = replace(PLAN, formation=replace(PLAN.formation, law=law))
    traits = replace(Traits.alike(n), response=FleetResponse.of([Response(), RAMPED]))
    memory = replace(Memory.fresh(n, 0.0), center=Center.at_rest(center_m), radius_m=10.0)
    tasks, settings = Tasks.of_formation(n, center_moves=False), ControlSettings()
    for index in range(1, 401):  # they fly what is allowed, and are carried back all the time
        fleet = FleetState(
            TICK_S * index,
            ("d1", "d2"),
            place_m.copy(),
            np.nan_to_num(memory.desired_m_s),
            np.zeros(n),
            np.zeros(n),
        )
        memory = tick(fleet, tasks, plan, traits, memory, settings).memory
    inward_m_s = -memory.desired_m_s[:, 0] * np.sign(place_m[:, 0])
    away_m = inward_m_s[0] / settings.law.article.sphere_rate_per_s
    stops_m_s = float(settings.safety.braking.speed_m_s(np.array([away_m]))[0])
    assert inward_m_s[0] > stops_m_s + 0.5
    assert inward_m_s[1] == pytest.approx(stops_m_s, abs=0.02)
