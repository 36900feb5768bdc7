"""Slots of more than 1,000 vehicles move in every second tick, whatever the clock shows."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.control import ControlSettings, Memory, Tasks, tick
from gcs.formation.orbit import Center
from gcs.model.plan import Formation, Orbit, Plan
from gcs.model.state import FleetState, Traits

BEGAN_S = 80_000.0  # on the clock of a machine that has run for a day
RADIUS_M, CENTER_M = 100.0, np.array([0.0, 0.0, -120.0])


@pytest.mark.parametrize(("count", "moves"), [(1000, 6), (1001, 3)])
def test_slots_of_large_fleets_move_in_every_second_tick(count: int, moves: int) -> None:
    direction = np.random.default_rng(1).normal(size=(count, 3))
    place_m = CENTER_M + RADIUS_M * direction / np.linalg.norm(direction, axis=1)[:, None]
    still, ids = np.zeros(count), tuple(f"d{row}" for row in range(count))
    memory = replace(Memory.fresh(count, BEGAN_S), center=Center.at_rest(CENTER_M), radius_m=RADIUS_M)
    about = Plan(Formation(RADIUS_M, 120.0), Orbit(0.0, 1.0)), Traits.alike(count)
    moved = 0
    for time_s in BEGAN_S + np.array([0.1003, 0.2, 0.2999, 0.4004, 0.5, 0.6001, 0.7]):
        fleet = FleetState(
            float(time_s), ids, place_m.copy(), np.zeros((count, 3)), still.copy(), still.copy()
        )
        before = memory
        tasks = Tasks.of_formation(count, center_moves=False)
        memory = tick(fleet, tasks, *about, memory, ControlSettings()).memory
        moved += before.number > 0 and not np.array_equal(memory.place, before.place)
    assert moved == moves
