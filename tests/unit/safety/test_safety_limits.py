"""Limits of speed, and what a vehicle is told it was restrained for."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.safety.filter import cap, filter_velocities
from gcs.safety.surroundings import Limits
from tests.support.safety_world import BOX, SETTINGS, surroundings


def test_rows_not_finite_become_rest_and_long_ones_are_scaled() -> None:
    desired = np.array([[np.nan, 1.0, 0.0], [0.0, np.inf, 0.0], [12.0, 16.0, 0.0], [0.0, 0.0, -5.0]])
    capped = cap(desired, Limits(horizontal_m_s=10.0, up_m_s=2.5, down_m_s=1.4))
    assert capped == pytest.approx(
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [6.0, 8.0, 0.0], [0.0, 0.0, -2.5]])
    )


def test_every_limit_has_its_reason_in_words() -> None:
    position = np.array([[0.0, 0.0, -20.0], [3.2, 0.0, -20.0], [0.0, 50.0, -3.1], [90.0, 0.0, -20.0]])
    desired = np.array([[3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.4], [0.0, 1.0, 0.0]])
    _, reasons = filter_velocities(desired, surroundings(position), SETTINGS)
    assert reasons == ("separation from d1", "separation from d0", "least height", "")


def test_worst_of_several_limits_is_reported() -> None:
    position = np.array([[-7.0, 0.0, -3.3]])
    around = surroundings(position, ellipses={"b": BOX})
    _, reasons = filter_velocities(np.array([[8.0, 0.0, 0.6]]), around, SETTINGS)
    assert reasons == ("obstacle b",)


def test_a_vehicles_own_speed_shortens_it_in_every_direction() -> None:
    desired = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, -2.0], [3.0, 4.0, 0.0]])
    capped = cap(desired, Limits(), np.array([2.5, 1.0, np.inf]))
    assert capped == pytest.approx(np.array([[1.5, 2.0, 0.0], [0.0, 0.0, -1.0], [3.0, 4.0, 0.0]]))
    assert cap(desired, Limits(), 2.5)[2] == pytest.approx([1.5, 2.0, 0.0])


def test_filter_keeps_the_speed_limit_of_each_vehicle() -> None:
    # a pilot comes at 3 m/s; the slow one can give way with 1 m/s only
    position = np.array([[0.0, 0.0, -20.0], [3.5, 0.0, -20.0]])
    oncoming = np.array([[0.0, 0.0, 0.0], [-3.0, 0.0, 0.0]])
    around = replace(
        surroundings(position, velocity=oncoming, commanded=[True, False]),
        speed_max_m_s=np.array([1.0, np.inf]),
    )
    allowed, _ = filter_velocities(np.array([[3.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), around, SETTINGS)
    assert allowed[0] == pytest.approx([-1.0, 0.0, 0.0], abs=2e-3)


def test_nothing_within_limits_exceeds_the_fastest_they_allow() -> None:
    assert Limits(horizontal_m_s=4.0, up_m_s=3.0, down_m_s=1.0).fastest_m_s == pytest.approx(5.0)
    assert Limits(horizontal_m_s=4.0, up_m_s=1.0, down_m_s=3.0).fastest_m_s == pytest.approx(5.0)


@pytest.mark.parametrize(("desired_m_s", "reported"), [(0.1, "least height"), (0.04, "")])
def test_only_a_noticeable_change_is_reported(desired_m_s: float, reported: str) -> None:
    # half of the margin above the least height nothing down is allowed
    _, reasons = filter_velocities(
        np.array([[0.0, 0.0, desired_m_s]]), surroundings(np.array([[0.0, 0.0, -3.5]])), SETTINGS
    )
    assert reasons == (reported,)


@pytest.mark.parametrize(("desired_m_s", "capped_m_s"), [(-0.6, -0.6), (-0.9, -0.7), (0.6, 0.5), (0.4, 0.4)])
def test_vertical_limits_hold_at_any_horizontal_speed(desired_m_s: float, capped_m_s: float) -> None:
    limits = Limits(horizontal_m_s=8.0, up_m_s=0.7, down_m_s=0.5)
    assert cap(np.array([[0.0, 0.0, desired_m_s]]), limits)[0, 2] == pytest.approx(capped_m_s)


def test_worst_limit_is_reported_for_both_of_a_pair() -> None:
    # d2 comes close to d0, less close to d1
    position = np.array([[0.0, 0.0, -20.0], [9.0, 0.0, -20.0], [3.2, 0.0, -20.0]])
    desired = np.array([[3.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    _, reasons = filter_velocities(desired, surroundings(position), SETTINGS)
    assert (reasons[0], reasons[2]) == ("separation from d2", "separation from d0")
