"""The formation, and the paths that lost vehicles may take: slots leave them, old positions count no more."""

from dataclasses import replace

import numpy as np

from gcs.control import ControlSettings, Memory, Tasks, Tick, tick
from gcs.control.inputs import FormationState
from gcs.formation.orbit import Center
from gcs.model.plan import Formation, Orbit, Plan
from gcs.model.state import Array, FleetState, Traits
from gcs.planning.lost_space import swept_segments_m
from gcs.safety.lost_paths import from_path_m

SETTINGS = ControlSettings()
FLOOR = SETTINGS.safety.floor
RADIUS_M, HEIGHT_M = 12.0, 25.0


def sphere_m(count: int) -> Array:
    """(count, 3) positions on the sphere, spread along a spiral."""
    index = np.arange(count) + 0.5
    z, angle = 1.0 - 2.0 * index / count, np.pi * (3.0 - np.sqrt(5.0)) * index
    ring = np.sqrt(1.0 - z * z)
    direction = np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
    return RADIUS_M * direction - (0.0, 0.0, HEIGHT_M)


def flown(tasks: Tasks, position_m: Array, duration_s: float) -> tuple[Array, Tick]:
    """Positions of vehicles that follow every velocity at once, and the last tick."""
    n, dt_s = len(position_m), 0.05
    ids, plan, memory = tuple(map(str, range(n))), Plan(Formation(RADIUS_M, HEIGHT_M), Orbit(0.0, 2.0)), None
    velocity_m_s = np.zeros((n, 3))
    memory = Memory.fresh(n, 0.0)
    for step in range(1, 1 + round(duration_s / dt_s)):
        fleet = FleetState(step * dt_s, ids, position_m, velocity_m_s, np.zeros(n), np.zeros(n))
        decided = tick(fleet, tasks, plan, Traits.alike(n, FLOOR.uncertainty_m), memory, SETTINGS)
        memory = decided.memory
        velocity_m_s = np.nan_to_num(memory.desired_m_s)
        position_m = position_m + dt_s * velocity_m_s
    return position_m, decided


def test_slots_leave_the_paths_of_lost_vehicles() -> None:
    start_m = sphere_m(24)
    lost = np.zeros(24, dtype=bool)
    lost[[4, 17]] = True
    paths_m = [
        swept_segments_m(
            start_m[row], np.array([3.0, 0.0, 0.0]), start_m[row] * (1.0, 1.0, 0.0), "hold", 30.0
        )
        for row in np.flatnonzero(lost)
    ]
    segments_of = np.repeat(np.flatnonzero(lost), [len(own_m) for own_m in paths_m])
    tasks = Tasks.of_formation(24, center_moves=False)
    tasks = replace(tasks, segments_m=np.concatenate(paths_m), segments_of=segments_of, airborne=~lost)
    tasks.task[lost] = 0
    position_m, decided = flown(tasks, start_m, 30.0)
    assert decided.memory.center is not None
    slot_m = decided.memory.center.position_m + RADIUS_M * decided.memory.place[~lost]
    kept_m = FLOOR.kept_m(FLOOR.worst_reserve_m())[0]
    for place_m in slot_m:
        for segment_m in tasks.segments_m:
            assert from_path_m(place_m * FLOOR.scale, segment_m * FLOOR.scale, np.empty(3)) > kept_m
    assert np.linalg.norm(position_m[~lost] - slot_m, axis=1).max() < 2.0


def test_vehicle_flies_to_its_slot_beside_lost_ones() -> None:
    gap_m = FLOOR.kept_m(FLOOR.worst_reserve_m())[0] + 0.6  # slots are moved no farther out
    beside_m = np.array([[gap_m, RADIUS_M], [-gap_m, RADIUS_M], [0.0, RADIUS_M - gap_m]])
    columns_m = [[[x_m, y_m, z_m] for z_m in (-40.0, 0.0)] for x_m, y_m in beside_m.tolist()]
    tasks = replace(Tasks.of_formation(1, center_moves=False), segments_m=np.array(columns_m))
    center, place = Center.at_rest(np.array([0.0, 0.0, -HEIGHT_M])), np.array([[0.0, 1.0, 0.0]])
    shared, plan = FormationState(center, RADIUS_M, 0.0, {}, place), Plan(Formation(RADIUS_M, HEIGHT_M))
    position_m, velocity_m_s, memory = (
        np.array([[1.5, 22.0, -HEIGHT_M]]),
        np.zeros((1, 3)),
        Memory.fresh(1, 0.0),
    )
    for step in range(1, 400):
        fleet = FleetState(step * 0.05, ("a",), position_m, velocity_m_s, np.zeros(1), np.zeros(1))
        decided = tick(
            fleet, tasks, plan, Traits.alike(1, FLOOR.uncertainty_m), memory, SETTINGS, shared=shared
        )
        memory = decided.memory
        velocity_m_s = np.nan_to_num(memory.desired_m_s)
        position_m = position_m + 0.05 * velocity_m_s
    assert np.linalg.norm(position_m[0] - (center.position_m + RADIUS_M * place[0])) < 1.0


def test_estimate_of_a_silent_vehicle_pushes_no_other() -> None:
    position_m = np.array([[0.0, 0.0, -20.0], [4.0, 0.0, -20.0]])
    velocity_m_s = np.array([[-5.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    fleet = FleetState(0.05, ("a", "b"), position_m, velocity_m_s, np.zeros(2), np.array([1.0, 0.0]))
    far_m = np.array([[[-30.0, 0.0, -20.0], [-30.0, 0.0, 0.0]]])
    tasks = Tasks.of_formation(2, center_moves=False)
    tasks = replace(tasks, segments_m=far_m, segments_of=np.array([0]), silent_segments=1)
    plan = Plan(Formation(4.0, 20.0), Orbit(0.0, 2.0))
    decided = tick(fleet, tasks, plan, Traits.alike(2), Memory.fresh(2, 0.0), SETTINGS)
    assert decided.limited_by == ("", "")
