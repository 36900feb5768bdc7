"""Behind a vehicle that is not commanded, on the way to a goal: it may stop by itself."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.safety.filter import filter_velocities
from gcs.safety.surroundings import SafetySettings
from tests.support.safety_world import BRAKING, FLOOR, SETTINGS, surroundings

FOLLOW_S = 1.0


def following(follow_s: float) -> SafetySettings:
    return SETTINGS.model_copy(update={"braking": BRAKING.model_copy(update={"follow_s": follow_s})})


FOLLOWS = following(FOLLOW_S)


def closing_m_s(
    apart_m: float,
    shared_m_s: float,
    *,
    goes: bool = True,
    along: bool = True,
    settings: SafetySettings = FOLLOWS,
) -> float:
    """How fast the second may close in on the first, that is in front of it or abeam, and flies as before."""
    ahead = np.array([1.0, 0.0, 0.0] if along else [0.0, 1.0, 0.0])
    position_m = np.array([[apart_m, 0.0, -20.0], [0.0, 0.0, -20.0]])
    velocity_m_s = np.tile(shared_m_s * ahead, (2, 1))
    here = surroundings(position_m, velocity=velocity_m_s, commanded=[False, True])
    here = replace(here, goes=np.array([False, goes]))  # not commanded, a vehicle has no goal
    desired_m_s = velocity_m_s + np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    allowed_m_s, _ = filter_velocities(desired_m_s, here, settings)
    return float(allowed_m_s[1, 0] - velocity_m_s[0, 0])


def as_if_alone_m_s(left_m: float) -> float:
    return float(BRAKING.speed_m_s(np.array([left_m]))[0])


@pytest.mark.parametrize("shared_m_s", [0.0, 1.0, 2.0, 3.0])
def test_the_speed_that_both_share_counts_for_a_second(shared_m_s: float) -> None:
    """8 m apart it is 5 m to floor and margin."""
    expected_m_s = as_if_alone_m_s(5.0 - FOLLOW_S * shared_m_s)
    assert closing_m_s(8.0, shared_m_s) == pytest.approx(expected_m_s, abs=2e-3)


def test_nearer_it_falls_back() -> None:
    assert closing_m_s(4.0, 3.0) < 0.0


@pytest.mark.parametrize("shared_m_s", [3.0, 5.0, 8.0])
def test_it_backs_off_no_faster_than_2_m_s(shared_m_s: float) -> None:
    """What is shared alone would ask for one and a half times its speed, backwards."""
    backs_m_s = shared_m_s + closing_m_s(3.2, shared_m_s, settings=following(5.0))
    assert backs_m_s == pytest.approx(-2.0, abs=1e-2)


def test_inside_the_margin_it_parts_whatever_is_shared() -> None:
    """1 m inside."""
    assert closing_m_s(2.0, 0.0) == pytest.approx(-BRAKING.escape_rate_per_s, abs=1e-2)
    assert closing_m_s(2.0, 1.0) <= -BRAKING.escape_rate_per_s


def test_a_formation_may_move_as_fast_as_it_likes() -> None:
    assert closing_m_s(8.0, 3.0, goes=False) == pytest.approx(as_if_alone_m_s(5.0), abs=2e-3)


def test_abeam_nothing_is_shared_along_the_line() -> None:
    assert closing_m_s(8.0, 3.0, along=False) == pytest.approx(as_if_alone_m_s(5.0), abs=2e-3)


@pytest.mark.parametrize("behind", [0, 1])
def test_where_both_are_commanded_nothing_is_taken(behind: int) -> None:
    """In swaps rows of vehicles that follow each other would lose a tenth of their time."""
    position_m = np.array([[8.0, 0.0, -20.0], [0.0, 0.0, -20.0]])
    velocity_m_s = np.tile([3.0 if behind else -3.0, 0.0, 0.0], (2, 1))
    here = surroundings(position_m, velocity=velocity_m_s)
    here = replace(here, goes=np.ones(2, np.bool_))
    allowed_m_s, _ = filter_velocities(velocity_m_s, here, FOLLOWS)
    assert np.allclose(allowed_m_s, velocity_m_s)


def test_one_in_front_of_another_that_stops_flies_on() -> None:
    position_m = np.array([[0.0, 0.0, -20.0], [4.0, 0.0, -20.0]])
    velocity_m_s = np.tile([3.0, 0.0, 0.0], (2, 1))
    here = surroundings(position_m, velocity=velocity_m_s, commanded=[False, True])
    here = replace(here, goes=np.array([False, True]))
    allowed_m_s, _ = filter_velocities(velocity_m_s, here, FOLLOWS)
    assert np.allclose(allowed_m_s[1], velocity_m_s[1])


@pytest.mark.parametrize("shared_m_s", [3.0, 5.0, 8.0])
@pytest.mark.parametrize("apart_m", [3.1, 4.0, 6.0, 8.0])
def test_it_does_not_stop_before_one_that_comes_behind(apart_m: float, shared_m_s: float) -> None:
    """Between two in a row that are not commanded and fly on: that the one in front may stop counts less."""
    position_m = np.array([[0.0, 0.0, -20.0], [apart_m, 0.0, -20.0], [-apart_m, 0.0, -20.0]])
    velocity_m_s = np.tile([shared_m_s, 0.0, 0.0], (3, 1))
    desired_m_s, least_m, dt_s, lag_s = velocity_m_s.copy(), np.inf, 0.1, 0.4
    for _ in range(100):
        here = surroundings(position_m.copy(), velocity=velocity_m_s.copy(), commanded=[True, False, False])
        here = replace(here, goes=np.array([True, False, False]))
        allowed_m_s, _ = filter_velocities(desired_m_s, here, following(2.0))
        velocity_m_s[0] += (allowed_m_s[0] - velocity_m_s[0]) * dt_s / lag_s
        position_m += dt_s * velocity_m_s
        least_m = min(least_m, float(np.linalg.norm(position_m[1:] - position_m[0], axis=1).min()))
    assert least_m > FLOOR.horizontal_m
