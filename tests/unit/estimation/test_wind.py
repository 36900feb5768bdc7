"""The wind as the tilt of vehicles shows it: motions that are given, and what their thrust must then be."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gcs.estimation.wind import (
    DRAG_MIN_PER_S,
    EVERY_S,
    GRAVITY_M_S2,
    KNOWN_M_S,
    UNKNOWN_AFTER_S,
    WindEstimate,
    WindEstimator,
)
from gcs.model.state import Array

NOISE_RAD, OFF_RAD = np.radians(0.3), np.radians(0.4)
"""Of attitudes: of each sample, and of each frame. ArduPilot's simulator has 0.1 and 0.3 degrees."""


class Motion(NamedTuple):
    """An orbit of all vehicles, each at its own place of it; a radius of 0: they hover."""

    speed_m_s: float = 3.0
    radius_m: float = 30.0
    heave_m_s: float = 0.0  # it sinks and climbs at this

    def at(self, time_s: float, count: int) -> tuple[Array, Array]:
        """(n, 3) velocities and accelerations, NED."""
        if not self.radius_m:
            return np.zeros((count, 3)), np.zeros((count, 3))
        rate = self.speed_m_s / self.radius_m
        angle = rate * time_s + 0.3 * np.arange(count)
        sine, cosine = np.sin(angle), np.cos(angle)
        down = np.full(count, self.heave_m_s)
        velocity_m_s = [-self.speed_m_s * sine, self.speed_m_s * cosine, down * np.sin(0.8 * time_s)]
        turn_m_s2 = -rate * self.speed_m_s
        acceleration_m_s2 = [turn_m_s2 * cosine, turn_m_s2 * sine, 0.8 * down * np.cos(0.8 * time_s)]
        return np.stack(velocity_m_s, axis=1), np.stack(acceleration_m_s2, axis=1)


HOVER = Motion(radius_m=0.0)


def attitudes(thrust_m_s2: Array, yaw_rad: Array) -> Array:
    """(n, 3) roll, pitch and yaw of bodies whose thrust by their mass is this (n, 3), NED."""
    ahead = np.cos(yaw_rad) * thrust_m_s2[:, 0] + np.sin(yaw_rad) * thrust_m_s2[:, 1]
    right = np.cos(yaw_rad) * thrust_m_s2[:, 1] - np.sin(yaw_rad) * thrust_m_s2[:, 0]
    pitch_rad = np.arctan2(-ahead, -thrust_m_s2[:, 2])
    roll_rad = np.arctan2(right * np.cos(pitch_rad), -thrust_m_s2[:, 2])
    return np.stack([roll_rad, pitch_rad, yaw_rad], axis=1)


class Flight:
    """Vehicles that keep their motion in a wind, whatever thrust that takes, and what is measured of it."""

    def __init__(
        self,
        count: int,
        motion: Motion = Motion(),  # noqa: B008 (immutable)
        *,
        drag_per_s: float = 0.4,
        square_per_m: float = 0.0,
        given_per_s: float | None = None,
        seed: int = 0,
    ) -> None:
        self.random, self.count, self.motion = np.random.default_rng(seed), count, motion
        self.drag_per_s, self.square_per_m = drag_per_s, square_per_m
        self.estimator = WindEstimator(count, given_per_s)
        self.yaw_rad = self.random.uniform(-np.pi, np.pi, count)
        self.off_rad = self.random.normal(0.0, OFF_RAD, (count, 2))
        self.time_s = 0.0
        self.flies = np.ones(count, np.bool_)

    def sample(self, wind_m_s: tuple[float, float]) -> tuple[Array, Array]:
        """(n, 3) attitudes and velocities as they are reported now."""
        velocity_m_s, thrust_m_s2 = self.motion.at(self.time_s, self.count)
        air_m_s = velocity_m_s - np.array([*wind_m_s, 0.0])
        speed_m_s = np.linalg.norm(air_m_s, axis=1, keepdims=True)
        thrust_m_s2 += (self.drag_per_s + self.square_per_m * speed_m_s) * air_m_s * (1.0, 1.0, 0.0)
        attitude_rad = attitudes(thrust_m_s2 - (0.0, 0.0, GRAVITY_M_S2), self.yaw_rad)
        attitude_rad += self.random.normal(0.0, NOISE_RAD, attitude_rad.shape)
        attitude_rad[:, :2] += self.off_rad
        return attitude_rad, velocity_m_s + self.random.normal(0.0, 0.05, velocity_m_s.shape)

    def fly(self, seconds: float, wind_m_s: tuple[float, float]) -> WindEstimate:
        for _ in range(round(seconds / EVERY_S)):
            attitude_rad, velocity_m_s = self.sample(wind_m_s)
            ages_s = np.full(self.count, 0.1)
            self.estimator.take(self.time_s, attitude_rad, ages_s, velocity_m_s, self.flies)
            self.estimator.look(self.time_s)
            self.time_s += EVERY_S
        return self.estimator.newest


def off_m_s(estimate: WindEstimate, wind_m_s: tuple[float, float]) -> float:
    return float(np.hypot(estimate.north_m_s - wind_m_s[0], estimate.east_m_s - wind_m_s[1]))


def test_attitudes_of_these_tests_point_their_thrust() -> None:
    thrust_m_s2 = np.random.default_rng(1).normal(0.0, 4.0, (20, 3)) - (0.0, 0.0, 12.0)
    turned = attitudes(thrust_m_s2, np.linspace(-3.0, 3.0, 20))
    points = Rotation.from_euler("ZYX", turned[:, ::-1]).apply([0.0, 0.0, -1.0])
    np.testing.assert_allclose(
        points, thrust_m_s2 / np.linalg.norm(thrust_m_s2, axis=1, keepdims=True), atol=1e-9
    )


@pytest.mark.parametrize("drag_per_s", [0.25, 0.65, 1.0])
@pytest.mark.parametrize("speed_m_s", [0.0, 3.0, 6.0, 9.0])
@pytest.mark.parametrize("count", [1, 4, 20])
def test_an_orbit_shows_the_wind_and_the_drag(count: int, speed_m_s: float, drag_per_s: float) -> None:
    wind_m_s = speed_m_s * np.cos(2.0), speed_m_s * np.sin(2.0)
    flight = Flight(count, drag_per_s=drag_per_s)
    estimate = flight.fly(60.0, wind_m_s)
    assert off_m_s(estimate, wind_m_s) <= 1.5
    assert off_m_s(estimate, wind_m_s) <= 3.0 * estimate.deviation_m_s + 0.2
    assert estimate.is_known
    assert estimate.vehicles == count
    assert estimate.drag_per_s == pytest.approx(drag_per_s, rel=0.15)


def test_a_wind_is_named_by_where_it_comes_from() -> None:
    estimate = Flight(4).fly(60.0, (0.0, -6.0))  # the air moves west
    assert estimate.from_deg == pytest.approx(90.0, abs=8.0)
    assert estimate.speed_m_s == pytest.approx(6.0, abs=0.8)


@pytest.mark.parametrize("count", [1, 20])
def test_a_step_of_wind_is_noticed_within_15_s(count: int) -> None:
    flight = Flight(count)
    assert flight.fly(40.0, (3.0, 0.0)).with_gusts_m_s < 8.0
    assert flight.fly(15.0, (9.0, 0.0)).with_gusts_m_s > 8.0
    assert off_m_s(flight.fly(15.0, (9.0, 0.0)), (9.0, 0.0)) <= 1.5


@pytest.mark.soak
def test_calm_seems_to_have_no_wind_for_an_hour() -> None:
    flight = Flight(3, drag_per_s=0.25)
    flight.fly(30.0, (0.0, 0.0))
    assert max(flight.fly(10.0, (0.0, 0.0)).with_gusts_m_s for _ in range(357)) < 3.0


@pytest.mark.parametrize("speed_m_s", [5.0, 8.0, 11.0])
def test_drag_with_the_square_of_the_speed_hides_no_wind(speed_m_s: float) -> None:
    flight = Flight(4, drag_per_s=DRAG_MIN_PER_S, square_per_m=0.04)
    assert flight.fly(90.0, (speed_m_s, 0.0)).speed_m_s == pytest.approx(speed_m_s, rel=0.12)


def test_a_hovering_fleet_needs_a_drag_for_its_wind() -> None:
    unknown = Flight(4, HOVER).fly(60.0, (6.0, 0.0))
    assert not unknown.is_known
    assert np.isnan(unknown.with_gusts_m_s)
    assert unknown.at_least_m_s < 6.0
    given = Flight(4, HOVER, given_per_s=0.38).fly(60.0, (6.0, 0.0))
    assert given.is_known
    assert off_m_s(given, (6.0, 0.0)) <= 1.0


def test_a_hovering_fleet_uses_the_drag_of_its_last_flight() -> None:
    flight = Flight(4)
    flight.fly(60.0, (2.0, 0.0))
    flight.motion = HOVER
    estimate = flight.fly(600.0, (0.0, 7.0))
    assert estimate.is_known
    assert off_m_s(estimate, (0.0, 7.0)) <= 1.0


def test_one_wrong_attitude_of_four_changes_little() -> None:
    flight = Flight(4)
    flight.off_rad[2] = 0.2, -0.2
    assert off_m_s(flight.fly(60.0, (5.0, 0.0)), (5.0, 0.0)) <= 1.0


def test_two_that_contradict_each_other_know_no_wind() -> None:
    flight = Flight(2)
    flight.off_rad[1] = 0.2, -0.2
    assert not flight.fly(60.0, (5.0, 0.0)).is_known


def test_vehicles_that_sink_climb_and_turn_show_the_same_wind() -> None:
    flight = Flight(4, Motion(heave_m_s=2.0))
    flight.fly(30.0, (5.0, 0.0))
    flight.yaw_rad = flight.yaw_rad + 2.0
    assert off_m_s(flight.fly(30.0, (5.0, 0.0)), (5.0, 0.0)) <= 0.7


BAD = (np.nan, np.inf, -np.inf, 1e300, -1e300)


@pytest.mark.parametrize("value", BAD)
def test_what_is_no_number_is_left_out(value: float) -> None:
    flight = Flight(4)
    flight.fly(30.0, (5.0, 0.0))
    for column in range(3):
        for of in range(2):
            samples = flight.sample((5.0, 0.0))
            samples[of][0, column] = value
            flight.estimator.take(flight.time_s, samples[0], np.zeros(4), samples[1], flight.flies)
            flight.estimator.look(flight.time_s)
            flight.time_s += EVERY_S
    estimate = flight.fly(10.0, (5.0, 0.0))
    assert off_m_s(estimate, (5.0, 0.0)) <= 1.5
    assert estimate.vehicles == 4


def test_old_attitudes_and_jumps_do_not_count() -> None:
    flight = Flight(2)
    flight.fly(60.0, (5.0, 0.0))
    attitude_rad, velocity_m_s = flight.sample((5.0, 0.0))
    flight.estimator.take(flight.time_s, attitude_rad, np.array([0.0, 1.5]), velocity_m_s, flight.flies)
    assert flight.estimator.look(flight.time_s).vehicles == 1
    flight.time_s += EVERY_S
    jumped_m_s = velocity_m_s + np.array([20.0, 0.0, 0.0])
    flight.estimator.take(flight.time_s, attitude_rad, np.zeros(2), jumped_m_s, flight.flies)
    assert off_m_s(flight.estimator.look(flight.time_s), (5.0, 0.0)) <= 1.0


def test_the_wind_is_not_known_after_a_landing_or_a_pause() -> None:
    flight = Flight(4)
    assert flight.fly(60.0, (5.0, 0.0)).is_known
    flight.flies[:] = False
    assert not flight.fly(UNKNOWN_AFTER_S + 1.0, (5.0, 0.0)).is_known
    flight.flies[:] = True
    flight.fly(60.0, (5.0, 0.0))
    flight.time_s += 30.0  # the station stood still
    assert not flight.fly(EVERY_S, (5.0, 0.0)).is_known
    assert flight.fly(20.0, (5.0, 0.0)).is_known


def test_an_estimator_of_no_vehicles_knows_nothing() -> None:
    assert not Flight(0).fly(2.0, (5.0, 0.0)).is_known
    assert WindEstimate().at_least_m_s == 0.0


@pytest.mark.parametrize("count", range(1, 12))
def test_the_median_is_that_of_numpy(count: int) -> None:
    """Vehicles that hover with another wind each: their median is the first estimate."""
    random = np.random.default_rng(count)
    winds_m_s = random.normal(0.0, 2.0, (count, 2))
    thrust_m_s2 = np.concatenate([-0.3 * winds_m_s, np.full((count, 1), -GRAVITY_M_S2)], axis=1)
    attitude_rad, still = attitudes(thrust_m_s2, np.zeros(count)), np.zeros((count, 3))
    estimator = WindEstimator(count, 0.3)
    for step in range(100):
        now_s = step * EVERY_S
        estimator.take(now_s, attitude_rad, np.zeros(count), still, np.ones(count, np.bool_))
        estimate = estimator.look(now_s)
    median_m_s = np.median(winds_m_s, axis=0)
    assert (estimate.north_m_s, estimate.east_m_s) == pytest.approx(tuple(median_m_s), abs=1e-6)
    if count == 1:
        assert estimate.deviation_m_s < KNOWN_M_S
