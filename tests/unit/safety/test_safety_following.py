"""Two that share a velocity on the way to goals of their own: the one in front may stop by itself."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.safety.filter import filter_velocities
from tests.support.safety_world import BRAKING, SETTINGS, surroundings

FOLLOW_S = 1.0
FOLLOWS = SETTINGS.model_copy(update={"braking": BRAKING.model_copy(update={"follow_s": FOLLOW_S})})


def closing_m_s(apart_m: float, shared_m_s: float, *, goes: tuple[bool, bool], along: bool = True) -> float:
    """How fast the second may close in on the first, that is in front of it or abeam, and flies as before."""
    ahead = np.array([1.0, 0.0, 0.0] if along else [0.0, 1.0, 0.0])
    position_m = np.array([[apart_m, 0.0, -20.0], [0.0, 0.0, -20.0]])
    velocity_m_s = np.tile(shared_m_s * ahead, (2, 1))
    here = surroundings(position_m, velocity=velocity_m_s, commanded=[False, True])
    here = replace(here, goes=np.array(goes))
    desired_m_s = velocity_m_s + np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    allowed_m_s, _ = filter_velocities(desired_m_s, here, FOLLOWS)
    return float(allowed_m_s[1, 0] - velocity_m_s[0, 0])


@pytest.mark.parametrize("shared_m_s", [0.0, 1.0, 2.0, 3.0])
def test_the_velocity_that_both_share_counts_for_a_second(shared_m_s: float) -> None:
    """8 m apart it is 5 m to floor and margin."""
    left_m = 5.0 - FOLLOW_S * shared_m_s
    expected_m_s = float(BRAKING.speed_m_s(np.array([left_m]))[0])
    assert closing_m_s(8.0, shared_m_s, goes=(True, True)) == pytest.approx(expected_m_s, abs=2e-3)


def test_nearer_it_falls_back() -> None:
    assert closing_m_s(4.0, 3.0, goes=(True, True)) < 0.0


@pytest.mark.parametrize("goes", [(False, False), (True, False), (False, True)])
def test_a_formation_may_move_as_fast_as_it_likes(goes: tuple[bool, bool]) -> None:
    expected_m_s = float(BRAKING.speed_m_s(np.array([5.0]))[0])
    assert closing_m_s(8.0, 3.0, goes=goes) == pytest.approx(expected_m_s, abs=2e-3)


def test_abeam_nothing_is_shared_along_the_line() -> None:
    expected_m_s = float(BRAKING.speed_m_s(np.array([5.0]))[0])
    assert closing_m_s(8.0, 3.0, goes=(True, True), along=False) == pytest.approx(expected_m_s, abs=2e-3)
