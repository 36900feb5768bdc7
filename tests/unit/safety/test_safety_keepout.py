"""What lost vehicles may sweep is kept clear."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support.safety_world import BOX, BRAKING, filtered, surroundings


def test_column_below_a_lost_vehicle_is_clear_at_every_height() -> None:
    column = np.array([[[0.0, 0.0, -30.0], [0.0, 0.0, 0.0]]])
    for height_m in (29.0, 15.0, 4.0):
        position = np.array([[-5.0, 0.0, -height_m]])  # 2 m to floor and margin
        allowed = filtered(np.array([[6.0, 0.0, 0.0]]), surroundings(position, segments=column))
        assert allowed[0, 0] == pytest.approx(float(BRAKING.speed_m_s(np.array([2.0]))[0]), abs=2e-3)


def test_beside_its_end_the_distance_to_the_end_counts() -> None:
    # 10 m above the top of the column: 4.5 m of them are floor and margin, 1.4 m/s down is allowed
    column = np.array([[[0.0, 0.0, -30.0], [0.0, 0.0, 0.0]]])
    allowed = filtered(
        np.array([[0.0, 0.0, 1.4]]), surroundings(np.array([[0.0, 0.0, -40.0]]), segments=column)
    )
    assert allowed[0, 2] == pytest.approx(1.4)


def test_vehicle_exactly_on_the_path_is_sent_off_it() -> None:
    column = np.array([[[0.0, 0.0, -30.0], [0.0, 0.0, 0.0]]])
    allowed = filtered(np.zeros((1, 3)), surroundings(np.array([[0.0, 0.0, -10.0]]), segments=column))
    assert np.hypot(*allowed[0, :2]) == pytest.approx(1.5, abs=2e-3)


def test_a_box_that_comes_on_counts_before_a_lost_path() -> None:
    """A vehicle between both is driven onto the path that a lost one may take, not left before the box."""
    column = np.array([[[8.0, 0.0, -30.0], [8.0, 0.0, 0.0]]])
    between = np.array([[5.0, 0.0, -10.0]])  # at the wall of the box, and at floor and margin of the path
    for comes_m_s, expected_m_s in ((0.5, 0.5), (0.0, 0.0)):
        box = replace(BOX, velocity_x_m_s=comes_m_s)
        around = surroundings(between, segments=column, ellipses={"box": box})
        allowed = filtered(np.zeros((1, 3)), around)
        assert allowed[0] == pytest.approx((expected_m_s, 0.0, 0.0), abs=0.02)
