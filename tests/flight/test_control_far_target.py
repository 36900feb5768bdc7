"""A target that goes on for ever: the formation follows it no farther than it may, and keeps its shape."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.formation.orbit import CLEAR_OF_FENCE_M
from gcs.model.plan import Formation, Orbit, Target
from tests.support.control_flight import SETTINGS, TICK_S, Flight, Sample, closest_m_and_violations, shape

ORBIT = Orbit(radius_m=15.0, speed_m_s=2.5)
FENCE_M = SETTINGS.safety.fence.distance_max_m


pytestmark = pytest.mark.soak


@pytest.fixture(scope="module", params=[(4.0, 0.0), (2.4, -3.2), (-3.9, 0.8)])
def followed(request: pytest.FixtureRequest) -> list[Sample]:
    """Eight, assembled; the target leaves at about 4 m/s, and two minutes pass."""
    flight = Flight(8, Formation(10.0, 20.0))
    flight.run(20.0)
    velocity_x_m_s, velocity_y_m_s = request.param
    target = Target(20.0, 10.0, velocity_x_m_s, velocity_y_m_s, flight.time_s)
    flight.plan = replace(flight.plan, orbit=ORBIT, target=target)
    flight.center_moves = True
    return flight.run(120.0)


def test_a_target_that_leaves_brings_no_vehicle_near_the_fence(followed: list[Sample]) -> None:
    distance_m = np.array([np.hypot(*sample.position_m[:, :2].T) for sample in followed])
    assert float(np.hypot(*followed[-1].target_m)) > 400.0
    assert distance_m.max() < FENCE_M
    assert distance_m.max() > FENCE_M - 40.0  # it was followed as far as possible


def test_centre_stays_within_its_reach(followed: list[Sample]) -> None:
    center_m = np.array([sample.center_m for sample in followed])
    assert np.hypot(center_m[:, 0], center_m[:, 1]).max() < FENCE_M - 10.0 - CLEAR_OF_FENCE_M / 2 + 0.2


def test_shape_holds_although_the_target_left(followed: list[Sample]) -> None:
    for begin in range(0, len(followed), 400):
        energy_ratio, nearest_ratio, radius_error_m = shape(followed[begin : begin + 400])
        assert energy_ratio < 1.01
        assert nearest_ratio > 0.9
        assert radius_error_m < 0.5


def test_formation_circles_the_nearest_point_to_the_target(followed: list[Sample]) -> None:
    center_m = np.array([sample.center_m for sample in followed[-400:]])
    speed_m_s = np.hypot(*(np.diff(center_m[:, :2], axis=0) / TICK_S).T)
    assert speed_m_s.mean() == pytest.approx(ORBIT.speed_m_s, abs=0.3)
    target_m = followed[-1].target_m
    rim_m = target_m / np.hypot(*target_m) * (FENCE_M - 10.0 - ORBIT.radius_m - CLEAR_OF_FENCE_M)
    assert np.hypot(*(center_m[-1, :2] - rim_m)) == pytest.approx(ORBIT.radius_m, abs=1.5)


def test_floor_holds_at_the_fence(followed: list[Sample]) -> None:
    assert closest_m_and_violations(followed)[1] == 0
