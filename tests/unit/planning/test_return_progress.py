"""The plan waits for delayed vehicles for a limited time, and not for vehicles that do not fly it."""

import numpy as np
import pytest

from gcs.model.state import Array
from gcs.planning.return_paths.paths import (
    BESIDE_S,
    LATE_S,
    PATIENCE_S,
    STEP_S,
    PathProgress,
    ReturnPaths,
    above_place_m,
    lowest_beside_m,
)

TICK_S = 0.05
PADS_M = np.array([[40.0, 0.0, 0.0], [40.0, 10.0, 0.0]])
BOTH = np.ones(2, dtype=np.bool_)


def abreast() -> ReturnPaths:
    """Two vehicles fly 40 m side by side, in 10 s."""
    x_m = np.minimum(np.arange(60) * STEP_S * 4.0, 40.0)
    path_m = np.zeros((2, 60, 3))
    path_m[:, :, 0], path_m[1, :, 1] = x_m, 10.0
    return ReturnPaths(path_m, path_m, np.full(2, 8.0), np.full(2, 10.0), ())


def flown(
    progress: PathProgress,
    seconds: float,
    behind_m: Array,
    flown_rows: np.ndarray[tuple[int], np.dtype[np.bool_]],
) -> float:
    """Fly with each vehicle off by `behind_m` (n, 3). Returns: by how many seconds the plan progressed."""
    before_s = progress.time_s
    for _ in range(round(seconds / TICK_S)):
        progress.advance(TICK_S, progress.return_paths.expected_m(progress.time_s) + behind_m, flown_rows)
    return progress.time_s - before_s


def test_plan_that_all_keep_up_with_follows_the_clock() -> None:
    assert flown(PathProgress(abreast(), PADS_M), 5.0, np.full((2, 3), 0.5), BOTH) == pytest.approx(5.0)


def test_progress_waits_for_a_held_vehicle_and_continues() -> None:
    progress = PathProgress(abreast(), PADS_M)
    held_m = np.array([[0.0, 0.0, 0.0], [-6.0, 0.0, 0.0]])
    assert flown(progress, 2.0, held_m, BOTH) == pytest.approx(0.0)
    assert flown(progress, 2.0, 0.2 * held_m, BOTH) == pytest.approx(2.0)


def test_progress_slows_with_the_greatest_lag() -> None:
    went_s = [
        flown(PathProgress(abreast(), PADS_M), 2.0, np.array([[0.0] * 3, [-m, 0.0, 0.0]]), BOTH)
        for m in (3.0, 3.8, 4.6)
    ]
    assert 2.0 > went_s[0] > went_s[1] > went_s[2] > 0.0


def test_progress_waits_up_to_a_total_limit() -> None:
    progress = PathProgress(abreast(), PADS_M)
    assert flown(progress, 60.0, np.full((2, 3), 3.5), BOTH) == pytest.approx(60.0 - PATIENCE_S)


@pytest.mark.parametrize("away_m", [20.0, np.nan])
def test_no_wait_for_a_vehicle_gone_elsewhere_or_not_received(away_m: float) -> None:
    assert flown(
        PathProgress(abreast(), PADS_M), 2.0, np.array([[0.0] * 3, [away_m, 0.0, 0.0]]), BOTH
    ) == pytest.approx(2.0)


def test_no_wait_for_a_vehicle_with_another_command() -> None:
    only_first = np.array([True, False])
    assert flown(
        PathProgress(abreast(), PADS_M), 2.0, np.array([[0.0] * 3, [-6.0, 0.0, 0.0]]), only_first
    ) == pytest.approx(2.0)


def test_goals_follow_the_plan_clock_to_the_pad() -> None:
    progress = PathProgress(abreast(), PADS_M)
    flown(progress, 5.0, np.zeros((2, 3)), BOTH)
    assert progress.goal_m[1] == pytest.approx([20.0, 10.0, 0.0])
    assert not progress.arrived[1]
    flown(progress, 60.0, np.zeros((2, 3)), BOTH)
    assert progress.goal_m[1] == pytest.approx([40.0, 10.0, 0.0])
    assert progress.arrived[1]


def test_vehicle_off_its_pad_after_the_end_of_its_path_is_late() -> None:
    progress = PathProgress(abreast(), PADS_M)
    ends_s = float(progress.return_paths.over_s[1])
    off_m = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    while progress.time_s < ends_s + LATE_S - 2.0 * TICK_S:
        progress.advance(TICK_S, progress.return_paths.expected_m(progress.time_s) + off_m, ~BOTH)
        assert not progress.late.any()
    flown(progress, 1.0, off_m, ~BOTH)
    assert progress.late[1]
    flown(progress, 1.0, np.zeros((2, 3)), ~BOTH)
    assert not progress.late.any()


def test_vehicle_kept_off_its_pad_comes_down_beside_it() -> None:
    """One of fifty had landed between two pads: the vehicle of the second hovered beside its own for ever."""
    for off_m, comes_down in ((1.5, True), (2.5, False)):
        progress = PathProgress(abreast(), PADS_M)
        flown(progress, 8.0 + BESIDE_S + PATIENCE_S - 1.0, np.array([[0.0] * 3, [0.0, off_m, 0.0]]), BOTH)
        assert progress.arrived.tolist() == [True, comes_down]
        early = PathProgress(abreast(), PADS_M)
        flown(early, 8.0 + LATE_S, np.array([[0.0] * 3, [0.0, off_m, 0.0]]), BOTH)
        assert early.arrived.tolist() == [True, False]


def test_way_home_is_level_but_not_below_the_takeoff_height() -> None:
    here_m = np.array([[9.0, 0.0, -3.0], [9.0, 4.0, -20.0]])
    home_m = np.array([[0.0, 0.0, 1.0], [0.0, 4.0, 1.0]])
    assert above_place_m(here_m, home_m, 5.0).tolist() == [[0.0, 0.0, -4.0], [0.0, 4.0, -20.0]]


def test_lowest_landing_vehicle_beside_its_column_descends_first() -> None:
    goal_m = np.zeros((3, 3))
    here_m = np.array([[0.5, 0.0, -2.0], [3.0, 0.0, -6.0], [0.0, 3.0, -9.0]])
    assert lowest_beside_m(here_m, goal_m) == -6.0
    assert lowest_beside_m(here_m[:1], goal_m[:1]) == -np.inf
