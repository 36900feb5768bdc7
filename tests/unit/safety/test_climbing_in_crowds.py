"""By how much less a vehicle that climbs through a crowd keeps to the right."""

import numpy as np
import pytest

from gcs.safety.meetings import FAR_S, SOON_S
from gcs.safety.traffic import Traffic, keep_right


def angle_rad(meetings: float) -> float:
    """The angle of a vehicle that flies level, for so many meetings."""
    return float(np.radians(45.0) * -np.expm1(-meetings / Traffic().crowd))


def turned_rad(climb: float, lasts_s: float = 50.0, count: int = 8) -> float:
    """By how much one is turned that climbs by the sine `climb`, and meets so many that come down its way."""
    velocity = np.array([np.sqrt(1.0 - climb**2), 0.0, -climb])
    meets_s, here = np.arange(1.0, 1.0 + count)[:, None], np.array([0.0, 0.0, -80.0])
    position = np.vstack([here, here + 2.0 * meets_s * velocity])
    desired = np.vstack([velocity, np.tile(-velocity, (count, 1))])
    every_row = np.ones(1 + count, dtype=bool)
    kept = keep_right(
        desired,
        position,
        np.zeros_like(position),
        position + lasts_s * desired,
        to_goal=every_row,
        commanded=every_row,
        airborne=every_row,
        flatness=2.0 / 3.0,
        settings=Traffic(),
    )
    return float(np.arccos(kept[0] @ velocity))


@pytest.mark.parametrize("climb", [0.0, -0.5, -1.0])
def test_one_in_a_crowd_turns_fully_on_the_level_and_down(climb: float) -> None:
    assert turned_rad(climb) == pytest.approx(angle_rad(8.0))


@pytest.mark.parametrize(("climb", "share"), [(0.2, 0.8), (0.5, 0.5)])
def test_one_that_climbs_through_a_crowd_turns_less(climb: float, share: float) -> None:
    assert turned_rad(climb) == pytest.approx(share * angle_rad(8.0))


@pytest.mark.parametrize("count", [1, 8])
def test_one_that_climbs_turns_as_for_one_meeting_at_least(count: int) -> None:
    assert turned_rad(1.0, count=count) == pytest.approx(angle_rad(1.0))


@pytest.mark.parametrize(("lasts_s", "share"), [(SOON_S, 1.0), (0.5 * (SOON_S + FAR_S), 0.75), (FAR_S, 0.5)])
def test_one_that_climbs_near_its_goal_turns_fully(lasts_s: float, share: float) -> None:
    assert turned_rad(0.5, lasts_s) == pytest.approx(share * angle_rad(8.0))
