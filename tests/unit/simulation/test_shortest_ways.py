"""The shortest ways past boxes that flown ways are compared with."""

from math import hypot

import numpy as np
import pytest

from gcs.model.plan import Obstacle
from gcs.safety.surroundings import Limits
from gcs.simulation.home_worlds import SHAPES, home_world
from gcs.simulation.shortest_ways import shortest_paths_m, shortest_ways_s

LIMITS = Limits(up_m_s=2.0, down_m_s=1.0)
START_M, GOAL_M = np.array([[0.0, 0.0, -20.0]]), np.array([[40.0, 0.0, 0.0]])
WALL = Obstacle("wall", 20.0, 0.0, 1.0, 10.0, 60.0)


def way_s(*boxes: Obstacle, highest_m: float = 100.0) -> float:
    return float(shortest_ways_s(boxes, START_M, GOAL_M, 2.0, (4.0, LIMITS), highest_m)[0])


def test_way_without_a_box_in_it_is_level_and_then_down() -> None:
    beside, moving = Obstacle("a", 0.0, 60.0, 5.0, 5.0, 60.0), Obstacle("b", 20.0, 0.0, 5.0, 5.0, 60.0, 1.0)
    assert way_s() == way_s(moving) == pytest.approx(40.0 / 4.0 + 20.0)
    assert way_s(beside) == pytest.approx(40.0 / 4.0 + 20.0, abs=0.5)


def test_way_leads_round_the_end_of_a_wall() -> None:
    round_m = 2.0 * hypot(17.0, 12.0) + 6.0
    (level_m,) = shortest_paths_m([WALL], START_M[:, :2], GOAL_M[:, :2], 2.0)
    assert level_m == pytest.approx(round_m, rel=0.06)
    assert way_s(WALL) == pytest.approx(round_m / 4.0 + 20.0, rel=0.06)


def test_way_out_of_a_ring_leads_over_it_or_nowhere() -> None:
    ring, _ = home_world(np.random.default_rng(1), "closed", 10.0, 5.0)
    over_s = (62.0 - 20.0) / 2.0 + 40.0 / 4.0 + 62.0
    goal_m = np.array([[40.0, 0.0, 0.0]])
    ways_s = [
        float(shortest_ways_s(ring, START_M, goal_m, 2.0, (4.0, LIMITS), highest_m)[0])
        for highest_m in (100.0, 45.0)
    ]
    assert ways_s == [pytest.approx(over_s), np.inf]


@pytest.mark.parametrize("shape", SHAPES)
def test_boxes_are_clear_of_the_formation_and_of_the_pads(shape: str) -> None:
    for seed in range(30):
        boxes, pads_m = home_world(np.random.default_rng(seed), shape, 10.0, 14.0)
        for box in boxes:
            half_m = np.array([box.half_length_x_m, box.half_length_y_m])
            for place_m, apart_m in ((np.zeros(2), 10.0 + 4.0), (pads_m, 14.0 + 5.0)):
                off_m = np.maximum(np.abs(place_m - (box.x_m, box.y_m)) - half_m, 0.0)
                assert hypot(*off_m) >= apart_m
