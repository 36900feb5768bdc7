"""Turning the formation about the vertical."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gcs.formation.law import spin_velocity, turned


def test_positive_is_x_to_y_clockwise_from_above() -> None:
    ahead = np.array([[10.0, 0.0, -3.0]])
    assert np.allclose(turned(ahead, np.pi / 2), [[0.0, 10.0, -3.0]])
    assert np.allclose(spin_velocity(ahead, 0.1, 0.0), [[0.0, 1.0, 0.0]])


@given(angle_rad=st.floats(-7.0, 7.0), seed=st.integers(0, 1000))
def test_rotation_keeps_lengths_and_heights(angle_rad: float, seed: int) -> None:
    places = np.random.default_rng(seed).normal(size=(5, 3))
    after = turned(places, angle_rad)
    assert np.allclose(np.linalg.norm(after, axis=1), np.linalg.norm(places, axis=1))
    assert (after[:, 2] == places[:, 2]).all()


@given(rate_rad_s=st.floats(-1.0, 1.0), seed=st.integers(0, 1000))
def test_velocity_is_the_derivative_of_a_rotating_slot(rate_rad_s: float, seed: int) -> None:
    places = np.random.default_rng(seed).normal(size=(5, 3))
    change = (turned(places, 1e-6 * rate_rad_s) - turned(places, -1e-6 * rate_rad_s)) / 2e-6
    assert np.allclose(spin_velocity(places, rate_rad_s, 0.0), change, atol=1e-6)
