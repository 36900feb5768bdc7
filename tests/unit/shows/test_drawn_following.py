"""Who flies which trajectory, when the clock waits, and by how much vehicles lag."""

import numpy as np
import pytest

from gcs.shows.drawn import Motion
from gcs.shows.following import DrawnPace, TrackErrors, assigned
from gcs.shows.format import Drawing
from tests.support.drawn_shows import drawn_show

DT_S = 0.05
CATCH_UP, WAIT = (
    Drawing(source="a.skyc", sha256="0" * 64, late=late, waits_from_m=3.0) for late in ("catch-up", "wait")
)


def motion(speed_m_s: float, count: int = 2) -> Motion:
    velocity_m_s = np.full((count, 3), (speed_m_s, 0.0, 0.0))
    return Motion(np.zeros((count, 3)), velocity_m_s, np.zeros((count, 3)))


def after(
    pace: DrawnPace, seconds: float, off_m: float, drawing: Drawing, speed_m_s: float = 2.0
) -> DrawnPace:
    for _ in range(round(seconds / DT_S)):
        pace = pace.step(motion(speed_m_s), np.array([off_m, np.nan]), DT_S, drawing)
    return pace


def test_vehicles_fly_to_the_nearest_trajectories_overall() -> None:
    start_m = np.array([[0.0, 0.0, -5.0], [4.0, 0.0, -5.0], [8.0, 0.0, -5.0]])
    first_m = np.array([[8.0, 10.0, -9.0], [90.0, 0.0, -9.0], [0.0, 10.0, -9.0], [4.0, 10.0, -9.0]])
    assert assigned(start_m, first_m).tolist() == [2, 3, 0]


def test_no_two_straight_ways_to_first_points_cross() -> None:
    show = drawn_show(20, 40.0, 3.0, ("wall",))
    first_m = show.trajectories.at(10.0).position_m[:, :2]
    start_m = np.random.default_rng(3).uniform(-20.0, 20.0, (20, 2))
    there_m = first_m[
        assigned(np.column_stack([start_m, np.zeros(20)]), np.column_stack([first_m, first_m[:, 0]]))
    ]
    for a in range(20):
        for b in range(a):
            share = (start_m[a] - start_m[b]) @ (there_m[a] - there_m[b])
            assert share >= -1e-9  # else the sum of squares were less with both exchanged


def test_a_part_begins_when_all_are_there() -> None:
    assert after(DrawnPace(), 5.0, 4.0, CATCH_UP).approaches
    assert not after(DrawnPace(), 0.1, 0.5, CATCH_UP).approaches


def test_a_part_begins_without_one_that_never_arrives() -> None:
    assert not after(DrawnPace(), 61.0, 9.0, CATCH_UP).approaches


def test_the_clock_runs_at_once_for_vehicles_at_rest() -> None:
    begun = DrawnPace().step(motion(0.0), np.zeros(2), DT_S, CATCH_UP)
    assert (begun.approaches, begun.rate) == (False, 1.0)
    moving = after(DrawnPace(), 0.5, 0.0, CATCH_UP)
    assert 0.0 < moving.rate < 0.5


@pytest.mark.parametrize(("drawing", "rate"), [(CATCH_UP, 1.0), (WAIT, 0.0)])
def test_only_a_waiting_clock_stops_for_a_late_vehicle(drawing: Drawing, rate: float) -> None:
    late = after(DrawnPace(approaches=False, rate=1.0), 3.0, 5.0, drawing)
    assert late.rate == pytest.approx(rate)
    assert after(late, 3.0, 1.0, drawing).rate == pytest.approx(1.0)


def test_the_clock_waits_for_half_a_minute_at_most() -> None:
    assert after(DrawnPace(approaches=False, rate=1.0), 40.0, 5.0, WAIT).rate == pytest.approx(1.0)


def test_a_slower_clock_means_slower_goals() -> None:
    goals = DrawnPace(approaches=False, rate=0.5, rate_per_s=0.5).goals(motion(2.0), np.array([2, 0]), 3)
    assert goals.velocity_m_s[[0, 2], 0].tolist() == [1.0, 1.0]
    assert goals.acceleration_m_s2[[0, 2], 0].tolist() == [1.0, 1.0]
    assert np.isnan(goals.position_m[1]).all()


def test_errors_are_means_over_the_time_that_was_flown() -> None:
    errors = TrackErrors.none(2).noted(np.array([3.0, np.nan]), 1.0).noted(np.array([4.0, 1.0]), 1.0)
    assert errors.rms_m.tolist() == pytest.approx([np.sqrt(12.5), 1.0])
    assert errors.max_m.tolist() == [4.0, 1.0]
    assert errors.fleet_rms_m == pytest.approx(np.sqrt(26.0 / 3.0))
