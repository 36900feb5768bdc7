"""A formation whose vehicles several stations fly: each computes its own among the others'."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.control import ControlSettings, Memory, Task, Tasks, tick
from gcs.control.inputs import FormationState
from gcs.control.others import Others
from gcs.formation.repulsion import energy
from gcs.model.plan import Formation, Orbit, Plan
from gcs.model.state import Array, FleetState, Traits
from gcs.simulation.reference_shapes import best

COUNT, OURS, RADIUS_M = 24, 10, 15.0
PLAN = Plan(Formation(RADIUS_M, 30.0), Orbit(20.0, 1.0))
SETTINGS = ControlSettings()
IDS = tuple(f"d{row}" for row in range(COUNT))
CENTER_M = np.array([0.0, 0.0, -30.0])


def state(ids: tuple[str, ...], position_m: Array, time_s: float) -> FleetState:
    n = len(ids)
    return FleetState(time_s, ids, position_m.copy(), np.zeros((n, 3)), np.zeros(n), np.zeros(n))


def others_of(ids: tuple[str, ...], position_m: Array, *, formed: bool = True) -> Others:
    k = len(ids)
    flying = np.ones(k, np.bool_)
    return Others(
        ids,
        position_m.copy(),
        np.zeros((k, 3)),
        np.full((k, 3), np.nan),
        np.full((k, 3), np.nan),
        np.full(k, 0.05),
        np.ones(k),
        flying,
        flying & formed,
        ~flying,
        np.zeros((0, 2, 3)),
        np.zeros(0, np.intp),
    )


def on_sphere() -> Array:
    return CENTER_M + RADIUS_M * best(COUNT)


def test_only_own_vehicles_get_setpoints() -> None:
    position_m = on_sphere()
    tasks, traits = Tasks.of_formation(OURS, center_moves=True), Traits.alike(OURS)
    ours, others = state(IDS[:OURS], position_m[:OURS], 0.05), others_of(IDS[OURS:], position_m[OURS:])
    result = tick(ours, tasks, PLAN, traits, Memory.fresh(COUNT, 0.0), SETTINGS, others=others)
    assert result.setpoints.ids == IDS[:OURS]
    assert np.isnan(result.memory.desired_m_s[OURS:]).all()
    assert np.isfinite(result.memory.place).all()  # the sphere is shared by all of them


def test_shape_of_all_is_the_best_for_all() -> None:
    """The slots of 24 vehicles settle in the best shape for 24, of which this station flies 10."""
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(COUNT, 3))
    position_m = CENTER_M + RADIUS_M * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    memory, traits = Memory.fresh(COUNT, 0.0), Traits.alike(OURS)
    tasks = Tasks.of_formation(OURS, center_moves=False)
    for step in range(1, 400):
        ours = state(IDS[:OURS], position_m[:OURS], 0.05 * step)
        others = others_of(IDS[OURS:], position_m[OURS:])
        memory = tick(ours, tasks, PLAN, traits, memory, SETTINGS, others=others).memory
        position_m = CENTER_M + RADIUS_M * np.where(np.isnan(memory.place), 0.0, memory.place)
    assert energy(memory.place) <= 1.002 * energy(best(COUNT))


@pytest.mark.parametrize("task", [Task.FORMATION, Task.NONE])
def test_follower_has_the_slots_of_the_lead(task: Task) -> None:
    """Its vehicles fly to theirs; those of others are kept for the time when this station leads."""
    position_m = on_sphere()
    rng = np.random.default_rng(2)
    place = rng.normal(size=(COUNT, 3))
    place /= np.linalg.norm(place, axis=1, keepdims=True)
    memory = Memory.fresh(COUNT, 0.0)
    lead = tick(
        state(IDS, position_m, 0.05),
        Tasks.of_formation(COUNT, center_moves=True),
        PLAN,
        Traits.alike(COUNT),
        memory,
        SETTINGS,
    ).memory
    assert lead.center is not None
    shared = FormationState(lead.center, 12.0, 0.0, {}, place)
    result = tick(
        state(IDS[:OURS], position_m[:OURS], 0.05),
        replace(Tasks.of_formation(OURS, center_moves=True), task=np.full(OURS, task, np.int8)),
        PLAN,
        Traits.alike(OURS),
        memory,
        SETTINGS,
        others=others_of(IDS[OURS:], position_m[OURS:]),
        shared=shared,
    )
    assert result.memory.place == pytest.approx(place)
    assert result.memory.radius_m == 12.0
    assert result.memory.center is lead.center


def test_own_vehicle_stops_before_one_of_another_station() -> None:
    """A vehicle on its way to a goal does not fly through one that another station holds there."""
    here_m, there_m = np.array([[0.0, 0.0, -20.0]]), np.array([[30.0, 0.0, -20.0]])
    memory, traits, speed_m_s = Memory.fresh(2, 0.0), Traits.alike(1), np.zeros((1, 3))
    tasks = replace(
        Tasks.of_formation(1, center_moves=False),
        task=np.array([Task.GOAL], np.int8),
        goal_m=there_m.copy(),
    )
    others = others_of(("x",), there_m, formed=False)
    closest_m = np.inf
    for step in range(1, 500):
        fleet = FleetState(0.05 * step, ("a",), here_m.copy(), speed_m_s.copy(), np.zeros(1), np.zeros(1))
        result = tick(fleet, tasks, PLAN, traits, memory, SETTINGS, others=others)
        memory, speed_m_s = result.memory, np.array(result.memory.desired_m_s[:1])
        here_m = here_m + 0.05 * speed_m_s
        closest_m = min(closest_m, float(np.linalg.norm(here_m - there_m)))
    assert SETTINGS.safety.floor.horizontal_m <= closest_m < 5.0
