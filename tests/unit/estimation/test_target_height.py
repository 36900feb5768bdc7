"""The height of a target: how soon it is known, and what a report that is wrong changes."""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.estimation.targets.height import HeightBelief
from gcs.estimation.targets.source_clock import SourceClock
from gcs.estimation.targets.target import TargetEstimate
from gcs.estimation.targets.tracker import TargetReport, Tracker

NOISE_M, PERIOD_S = 2.0, 0.2


def after(seconds: float, climb_m_s: float, *, wrong_m: float = 0.0) -> HeightBelief:
    """From 10 m on, with errors; the last report is off by `wrong_m`."""
    random, belief = Random(1), HeightBelief.begun(0.0, 10.0, NOISE_M)
    for number in range(1, round(seconds / PERIOD_S)):
        time_s = number * PERIOD_S
        error_m = random.gauss(0.0, NOISE_M)
        belief = belief.corrected(time_s, 10.0 + climb_m_s * time_s + error_m, NOISE_M)
    return belief.corrected(seconds, 10.0 + climb_m_s * seconds + wrong_m, NOISE_M)


@pytest.mark.parametrize("climb_m_s", [0.0, 0.8, -1.5])
def test_height_and_climb_are_known_after_ten_seconds(climb_m_s: float) -> None:
    belief = after(10.0, climb_m_s)
    assert belief.height_m == pytest.approx(10.0 + 10.0 * climb_m_s, abs=1.5)
    assert belief.climb_m_s == pytest.approx(climb_m_s, abs=0.6)
    assert belief.deviation_m < 0.6 * NOISE_M


def test_height_that_jumps_once_moves_little() -> None:
    assert abs(after(10.0, 0.0, wrong_m=1000.0).height_m - after(10.0, 0.0).height_m) < NOISE_M


def test_late_height_changes_nothing() -> None:
    belief = after(10.0, 0.0)
    assert belief.corrected(9.0, 50.0, NOISE_M) == belief


@given(st.floats(0.0, 20.0), st.floats(0.0, 20.0))
def test_height_is_never_better_known_without_reports(one_s: float, more_s: float) -> None:
    belief = after(5.0, 0.5)
    sooner, later = belief.foreseen(5.0 + one_s), belief.foreseen(5.0 + one_s + more_s)
    assert later.deviation_m >= sooner.deviation_m >= belief.deviation_m


def test_height_stays_when_its_source_falls_silent() -> None:
    """The other source reports none. It climbed: it does not climb on for ever."""
    first, second = (Tracker(1.0, 5.0, SourceClock(0.0)) for _ in range(2))
    estimate = TargetEstimate([first, second])
    for number in range(100):
        time_s = number * PERIOD_S
        if number < 50:
            first.take(TargetReport(time_s, (0.0, 0.0), height_m=40.0 + time_s))
        second.take(TargetReport(time_s, (0.0, 0.0)))
        motion = estimate.motion(time_s)
    assert estimate.active == 1
    assert motion is not None
    assert motion.height is not None
    assert motion.height.height_m == pytest.approx(50.0, abs=1.5)
    assert motion.height.climb_m_s == 0.0


@pytest.mark.parametrize("tiny", [1e-170, 5e-324])
def test_deviation_that_cannot_be_is_no_failure(tiny: float) -> None:
    """Two equal events with it ended the service."""
    tracker = Tracker(tiny, 5.0, SourceClock(0.0))
    for _ in range(3):
        tracker.take(
            TargetReport(1.0, (0.0, 0.0), (1.0, 0.0), tiny, tiny, height_m=3.0, height_deviation_m=tiny)
        )
    assert tracker.motion(2.0) is not None
