"""The way down of a vehicle that its autopilot lands where it is."""

import numpy as np
import pytest

from gcs.model.plan import Obstacle
from gcs.planning.way_down import POINTS, meets, nearest_m, nearest_to_paths_m, way_down

HERE_M = np.array([10.0, -4.0, -25.0])
STILL = np.zeros(2)


@pytest.mark.parametrize("speed_m_s", [0.0, 3.0, 40.0])
def test_it_ends_on_the_ground_where_wind_takes_it(speed_m_s: float) -> None:
    way = way_down(HERE_M, np.array([0.0, speed_m_s]), ground_z_m=-1.0)
    height_m = -way.place_m[:, 2]
    assert POINTS[0] <= len(way.place_m) <= POINTS[1]
    assert (height_m[0], height_m[-1]) == pytest.approx((25.0, 1.0))
    assert (np.diff(height_m) < 0.0).all()
    assert way.after_s[-1] == pytest.approx(14.0 / 1.5 + 10.0 / 0.5)
    assert way.end_m[:2] == pytest.approx((10.0, speed_m_s * way.after_s[-1] - 4.0))


def test_from_below_the_ground_it_stays_where_it_is() -> None:
    assert way_down(np.array([1.0, 2.0, 0.5]), STILL).end_m == pytest.approx((1.0, 2.0, 0.5))


def test_vehicles_that_drift_alike_keep_their_distance() -> None:
    drift_m_s = np.array([5.0, 0.0])
    way = way_down(HERE_M, drift_m_s)
    beside_m = HERE_M + np.array([[0.0, 7.0, 3.0], [60.0, 1.0, 25.0], [60.0, 1.0, 25.0], [np.nan] * 3])
    moves_m_s = np.array([[5.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3])
    apart_m = nearest_m(way, beside_m, moves_m_s)
    assert apart_m[:3] == pytest.approx((7.0, np.hypot(60.0, 1.0), 1.0), abs=0.3)
    assert np.isnan(apart_m[3])


@pytest.mark.parametrize("sinks_m_s", [0.7, 1.0, 1.5])
def test_one_ahead_that_lands_first_is_met_on_the_ground(sinks_m_s: float) -> None:
    """Both drift alike; the lower one had counted as always 10 m ahead, and was passed 2 m above it."""
    drift_m_s = np.array([4.0, 0.0])
    way = way_down(HERE_M, drift_m_s)
    ahead_m = HERE_M + np.array([[10.0, 0.0, 8.0]])
    assert nearest_m(way, ahead_m, np.array([[4.0, 0.0, sinks_m_s]]))[0] < 1.0
    assert nearest_m(way, ahead_m, np.array([[4.0, 0.0, 0.0]]))[0] == pytest.approx(10.0, abs=0.3)
    beside_m = ahead_m + np.array([0.0, 9.0, 0.0])
    assert nearest_m(way, beside_m, np.array([[4.0, 0.0, sinks_m_s]]))[0] == pytest.approx(9.0, abs=0.3)


@pytest.mark.parametrize("sinks_m_s", [0.0, 0.5])
def test_one_that_crosses_below_is_met_where_it_crosses(sinks_m_s: float) -> None:
    """Straight down the way has few points, seconds apart: one at 5 m/s passed 12 m beside all of them."""
    way = way_down(HERE_M, STILL)
    crosses_m = HERE_M + np.array([[-11.0, 1.0, 3.0], [-11.0, -9.0, 3.0], [-11.0, 1.0, 3.0]])
    moves_m_s = np.array([[5.0, 0.0, sinks_m_s], [5.0, 0.0, sinks_m_s], [-5.0, 0.0, sinks_m_s]])
    assert nearest_m(way, crosses_m, moves_m_s) == pytest.approx((1.0, 9.0, np.hypot(11.0, 1.0)))


def test_a_box_that_drives_through_below_it_is_met() -> None:
    way = way_down(HERE_M, STILL)
    car = Obstacle("car", -17.0, -4.0, 2.0, 1.0, 2.0, velocity_x_m_s=1.2, time_s=100.0)
    late = Obstacle("car", -17.0, -4.0, 2.0, 1.0, 2.0, velocity_x_m_s=9.0, time_s=100.0)
    beside = Obstacle("car", -17.0, -8.0, 2.0, 1.0, 2.0, velocity_x_m_s=1.2, time_s=100.0)
    tall = Obstacle("mast", -17.0, -4.0, 1.0, 1.0, 22.0, velocity_x_m_s=9.0, time_s=100.0)
    assert not meets(way, late, 100.0, 1.0)  # gone before it is low
    assert not meets(way, beside, 100.0, 1.0)
    assert meets(way, car, 100.0, 1.0)
    assert meets(way, tall, 100.0, 1.0)


def test_paths_of_lost_vehicles_are_met_along_their_length() -> None:
    way = way_down(HERE_M, STILL)
    across_m = np.array([[[-50.0, 2.0, -9.0], [50.0, 2.0, -9.0]], [[10.0, 0.0, 0.0], [10.0, 0.0, -30.0]]])
    assert nearest_to_paths_m(way, across_m) == pytest.approx((6.0, 4.0))


def test_a_box_that_comes_under_it_in_time_is_met() -> None:
    way = way_down(HERE_M, STILL)
    stands = Obstacle("hall", 40.0, -4.0, 5.0, 5.0, 8.0, time_s=100.0)
    comes = Obstacle("lorry", 40.0, -4.0, 5.0, 5.0, 8.0, velocity_x_m_s=-1.0, time_s=100.0)
    assert not meets(way, stands, 100.0, 1.0)
    assert meets(way, comes, 100.0, 1.0)
    assert meets(way_down(HERE_M, np.array([1.0, 0.0])), stands, 100.0, 1.0)
