"""The methods of others in `make race` do what their papers say, with the papers' ideal vehicles."""

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from gcs.model.state import Array
from tests.bench.race.methods import Barrier, Memoryless, Method, Rvo2, orca, voronoi_cells

pytestmark = pytest.mark.soak

DT_S, SPEED_M_S = 0.05, 2.0
FLOOR_M = 3.0
NONE = np.zeros((0, 7))
METHODS: Mapping[str, Callable[[], Method]] = {
    "orca": lambda: Memoryless(orca, FLOOR_M + 0.2),
    "rvo2": lambda: Rvo2(FLOOR_M + 0.2),
    "cells": lambda: Memoryless(voronoi_cells, FLOOR_M + 0.2),
    "barrier": lambda: Barrier(FLOOR_M + 0.2, DT_S),
}


def flown(
    method: Method, start_m: Array, goal_m: Array, seconds: float, boxes: Array = NONE
) -> tuple[Array, float]:
    """Where vehicles are that have their velocities at once, and the least distance of two on the way, m."""
    here_m, moves_m_s, least_m = start_m.copy(), np.zeros_like(start_m), np.inf
    for _ in range(round(seconds / DT_S)):
        moves_m_s = method.velocity_m_s(here_m, moves_m_s, goal_m, SPEED_M_S, boxes)
        here_m = here_m + DT_S * moves_m_s
        apart_m = np.linalg.norm(here_m[:, None] - here_m[None], axis=2) + 1e3 * np.eye(len(here_m))
        least_m = min(least_m, float(apart_m.min()))
    return here_m, least_m


@pytest.mark.parametrize("name", METHODS)
def test_two_that_meet_pass_and_arrive(name: str) -> None:
    start_m = np.array([[-20.0, 0.0, -30.0], [20.0, 0.3, -30.0]])
    here_m, least_m = flown(METHODS[name](), start_m, start_m[::-1].copy(), 50.0)
    assert np.linalg.norm(here_m - start_m[::-1], axis=1).max() < 1.0
    assert least_m > FLOOR_M


@pytest.mark.parametrize("name", METHODS)
def test_a_lone_vehicle_flies_straight(name: str) -> None:
    start_m, goal_m = np.array([[0.0, 0.0, -30.0]]), np.array([[10.0, 5.0, -32.0]])
    here_m, _ = flown(METHODS[name](), start_m, goal_m, 3.0)
    way_m, straight_m = (here_m - start_m)[0], (goal_m - start_m)[0]
    assert way_m / np.linalg.norm(way_m) == pytest.approx(straight_m / np.linalg.norm(straight_m))


@pytest.mark.parametrize("name", ["orca", "cells", "barrier"])
@pytest.mark.parametrize("moves_m_s", [0.0, 0.5])
def test_a_box_beside_the_way_is_kept_clear_of(name: str, moves_m_s: float) -> None:
    """It is 0.8 m from the straight way, or comes so near while the vehicle passes."""
    start_m, goal_m = np.array([[-20.0, 0.0, -30.0]]), np.array([[20.0, 0.0, -30.0]])
    boxes = np.array([[0.0, 5.8 + 10.0 * moves_m_s, 3.0, 5.0, 60.0, 0.0, -moves_m_s]])
    method, here_m, flown_m_s, passed, least_m = METHODS[name](), start_m, np.zeros((1, 3)), False, np.inf
    for _ in range(round(40.0 / DT_S)):
        flown_m_s = method.velocity_m_s(here_m, flown_m_s, goal_m, SPEED_M_S, boxes)
        here_m = here_m + DT_S * flown_m_s
        boxes[0, :2] += DT_S * boxes[0, 5:]
        beyond_m = np.abs(here_m[0, :2] - boxes[0, :2]) - boxes[0, 2:4]
        least_m = min(least_m, float(np.hypot(*np.maximum(beyond_m, 0.0))))
        passed = passed or here_m[0, 0] > 5.0
    assert passed
    assert least_m > 1.0
