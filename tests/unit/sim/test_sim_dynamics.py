"""The point masses respond to velocity setpoints as PX4 does; test_vehicles fits the recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.sim.vehicle.dynamics import PointMasses, Response

if TYPE_CHECKING:
    from gcs.sim.vehicle.dynamics import Array

PX4 = Response()
DT_S = 0.01


def at(
    position_m: Array, velocity_m_s: Array | None = None, dt_s: float = DT_S, response: Response = PX4
) -> PointMasses:
    return PointMasses(position_m, dt_s, response, velocity_m_s)


def fly(
    command: tuple[float, float, float], duration_s: float, dt_s: float = DT_S, response: Response = PX4
) -> Array:
    """(steps, 3): velocities from rest."""
    state = at(np.zeros((1, 3)), dt_s=dt_s, response=response)
    velocities = []
    for _ in range(round(duration_s / dt_s)):
        state.step(np.array([command]))
        velocities.append(state.velocity_m_s[0])
    return np.array(velocities)


def test_the_milestones_of_the_recorded_five_metre_step_are_met() -> None:
    north = fly((5.0, 0.0, 0.0), 8.0)[:, 0]
    times_s = [(int(np.argmax(north >= share * 5.0)) + 1) * DT_S for share in (0.1, 0.5, 0.63)]
    assert times_s == pytest.approx([0.23, 0.66, 1.0], abs=0.1)
    assert north[-1] == pytest.approx(4.36, abs=0.15)
    assert north.max() <= 5.0


def test_two_m_s_upward_reach_63_percent_in_a_third_second() -> None:
    climb = -fly((0.0, 0.0, -2.0), 2.0)[:, 2]
    assert (int(np.argmax(climb >= 1.26)) + 1) * DT_S == pytest.approx(0.34, abs=0.03)
    assert climb.max() < 2.1


def test_nothing_happens_before_the_delay_is_over() -> None:
    north = fly((5.0, 0.0, 0.0), 0.2)[:, 0]
    assert not north[:10].any()
    assert north[10] > 0.0


@pytest.mark.parametrize("dt_s", [0.004, 0.02])
def test_response_hardly_depends_on_the_step_size(dt_s: float) -> None:
    coarse, fine = fly((3.0, -4.0, -1.0), 4.0, dt_s), fly((3.0, -4.0, -1.0), 4.0, 0.001)
    every = round(dt_s / 0.001)
    assert np.abs(coarse - fine[every - 1 :: every]).max() < 0.08


def test_a_long_step_is_several_short_ones() -> None:
    short, long = at(np.zeros((1, 3)), dt_s=0.05 / 3), at(np.zeros((1, 3)), dt_s=0.05)
    for _ in range(20):
        for _ in range(3):
            short.step(np.array([[5.0, 0.0, -2.0]]))
        long.step(np.array([[5.0, 0.0, -2.0]]))
    assert np.array_equal(long.position_m, short.position_m)


def test_integrator_does_not_wind_up_at_the_limit() -> None:
    weak = Response(acceleration_limit_m_s2=2.0)
    state = at(np.zeros((1, 3)), response=weak)
    for _ in range(300):
        state.step(np.array([[12.0, 0.0, 0.0]]))
    assert state.integral_m_s2[0, 0] == 0.0
    assert np.hypot(*state.acceleration_m_s2[0, :2]) <= 2.0


def test_the_horizontal_limit_bounds_the_vector_not_the_axes() -> None:
    state = at(np.zeros((1, 3)))
    for _ in range(50):
        state.step(np.array([[12.0, 12.0, 0.0]]))
    assert np.hypot(*state.acceleration_m_s2[0, :2]) == pytest.approx(9.8, abs=0.1)


def test_wind_drifts_unpowered_and_tilts_powered_vehicles() -> None:
    wind = np.array([4.0, 0.0, 0.0])
    state = at(np.zeros((2, 3)))
    for _ in range(3000):
        powered = np.array([True, False])
        state.step(np.zeros((2, 3)), wind_m_s=wind, powered=powered)
    assert state.velocity_m_s[0, 0] == pytest.approx(0.0, abs=0.05)
    assert state.velocity_m_s[1, 0] == pytest.approx(4.0, abs=0.01)
    assert state.velocity_m_s[1, 2] == pytest.approx(9.80665, abs=0.01)  # gravity over a drag of 1.0


def test_a_cruising_start_goes_on_cruising() -> None:
    cruise = np.array([[3.0, 0.0, 0.0]])
    state = at(np.zeros((1, 3)), cruise)
    for _ in range(100):
        state.step(cruise)
    assert state.velocity_m_s[0] == pytest.approx(cruise[0], abs=1e-9)


def test_ground_stops_a_fall_and_releases_a_climb() -> None:
    moving = np.array([[1.0, 1.0, 3.0], [0.0, 0.0, -1.0], [1.0, 0.0, 1.0]])
    state = at(np.array([[5.0, 0.0, 0.2], [0.0, 0.0, 0.0], [0.0, 0.0, -2.0]]), moving)
    assert state.rest_on_ground().tolist() == [True, False, False]
    assert state.velocity_m_s[0].tolist() == [0.0, 0.0, 0.0]
    assert state.position_m[0].tolist() == [5.0, 0.0, 0.0]
    assert state.velocity_m_s[1:].tolist() == moving[1:].tolist()


def test_a_measured_velocity_that_is_wrong_moves_the_vehicle() -> None:
    state = at(np.zeros((1, 3)))
    for _ in range(400):
        error = np.array([[0.5, 0.0, 0.0]])
        state.step(np.zeros((1, 3)), velocity_error_m_s=error)
    assert state.velocity_m_s[0, 0] < -0.2


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-50, 50)] * 3), min_size=1, max_size=4))
def test_no_command_makes_the_state_infinite_or_too_fast(
    commands: list[tuple[float, float, float]],
) -> None:
    command = np.array(commands)
    state = at(np.zeros(command.shape), dt_s=0.02)
    for _ in range(100):
        state.step(command)
    assert np.isfinite(state.position_m).all()
    horizontal = np.linalg.norm(state.velocity_m_s[:, :2], axis=1)
    assert (horizontal <= np.linalg.norm(command[:, :2], axis=1) * 1.05 + 1e-6).all()


def test_a_step_changes_no_array_in_place() -> None:
    state = at(np.zeros((2, 3)))
    before = state.position_m, state.velocity_m_s
    state.step(np.ones((2, 3)))
    state.rest_on_ground()
    assert not np.any(before)
