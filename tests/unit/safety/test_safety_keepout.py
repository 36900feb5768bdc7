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


def test_a_box_drives_it_onto_a_lost_path_no_faster_than_itself() -> None:
    """Its goal lies beyond the path: it flew there with 4 m/s, through where the lost vehicle may be."""
    column = np.array([[[8.0, 0.0, -30.0], [8.0, 0.0, 0.0]]])
    box = {"box": replace(BOX, velocity_x_m_s=0.5)}
    around = surroundings(np.array([[5.0, 0.0, -10.0]]), segments=column, ellipses=box)
    assert filtered(np.array([[4.0, 0.0, 0.0]]), around)[0] == pytest.approx((0.5, 0.0, 0.0), abs=0.02)


@pytest.mark.parametrize("count", [2, 3])
def test_those_in_the_way_of_a_pressed_one_give_way(count: int) -> None:
    """A row of vehicles between a box that comes and a path: the path held the last, and so all of them."""
    place_m = np.array([[5.0 + 3.0 * k, 0.0, -10.0] for k in range(count)])
    path_m = 5.0 + 3.0 * count
    column = np.array([[[path_m, 0.0, -30.0], [path_m, 0.0, 0.0]]])
    box = {"box": replace(BOX, velocity_x_m_s=0.5)}
    allowed = filtered(np.zeros((count, 3)), surroundings(place_m, segments=column, ellipses=box))
    assert allowed == pytest.approx(np.tile((0.5, 0.0, 0.0), (count, 1)), abs=0.02)


@pytest.mark.parametrize("moves_m_s", [(-0.3, 0.0), (0.0, 0.3)])
def test_a_box_that_passes_drives_none_onto_a_lost_path(moves_m_s: tuple[float, float]) -> None:
    """The vehicle is 0.3 m within the box's margin, as it may be within that of a box that stands."""
    column = np.array([[[7.7, 0.0, -30.0], [7.7, 0.0, 0.0]]])
    box = {"box": replace(BOX, velocity_x_m_s=moves_m_s[0], velocity_y_m_s=moves_m_s[1])}
    around = surroundings(np.array([[4.7, 0.0, -10.0]]), segments=column, ellipses=box)
    assert filtered(np.zeros((1, 3)), around)[0] == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
