"""Slots of fleets that are too large to sum the push of every pair in a tick."""

import numpy as np
import pytest

from gcs.formation.far_field import pushes_by_cells
from gcs.formation.repulsion import CELLS_FROM, NEAREST_FACTOR, sweep
from gcs.model.state import Array
from gcs.simulation.initial_states import grid_m, lattice

COUNT = CELLS_FROM + 400


def tangential(push: Array, direction: Array) -> Array:
    return np.asarray(push - (push * direction).sum(axis=1, keepdims=True) * direction)


def all_pairs(direction: Array, charge: Array) -> Array:
    """In double precision, a block of rows after the other."""
    push = np.empty_like(direction)
    for rows in np.array_split(np.arange(len(direction)), 20):
        offset = direction[rows, None] - direction[None]
        square = (offset**2).sum(axis=2)
        square[square == 0.0] = np.inf
        push[rows] = charge[rows, None] * (offset * (charge / square**1.5)[..., None]).sum(axis=1)
    return push


@pytest.mark.keeps("2400")
@pytest.mark.long
@pytest.mark.parametrize("count", [COUNT, 5000])
def test_pushes_by_cells_are_those_of_all_pairs(count: int) -> None:
    random = np.random.default_rng(1)
    direction = lattice(count) + random.normal(0.0, 0.1 / np.sqrt(count), (count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    charge = random.uniform(0.5, 2.0, count)
    exact = tangential(all_pairs(direction, charge), direction)
    error = tangential(pushes_by_cells(direction, charge), direction) - exact
    assert np.sqrt((error**2).sum() / (exact**2).sum()) < 0.07


def test_vehicles_without_a_direction_reach_no_other_memory() -> None:
    direction = lattice(COUNT)
    direction[7] = np.nan
    assert pushes_by_cells(direction, np.ones(COUNT)).shape == (COUNT, 3)


def test_slots_of_a_large_fleet_come_to_rest_evenly() -> None:
    start_m = grid_m(COUNT, 4.0, 5.0) - (0.0, 0.0, -75.0)
    direction = start_m / np.linalg.norm(start_m, axis=1, keepdims=True)
    direction += np.random.default_rng(1).normal(0.0, 0.01, (COUNT, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    change = np.zeros((COUNT, 3))
    for _ in range(30):  # 15 s of flight
        direction, change = sweep(direction, change, direction, np.ones(COUNT), 10, 0.0)
    nearest = min(
        np.partition(np.linalg.norm(direction - one, axis=1), 1)[1] for one in direction[:: COUNT // 200]
    )
    assert nearest > 0.85 * NEAREST_FACTOR / np.sqrt(COUNT)
