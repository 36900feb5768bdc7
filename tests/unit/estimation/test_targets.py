"""A target estimated from reports that are late, wrong, doubled, frozen or of another place."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.estimation.targets.motion import begun, corrected, foreseen
from gcs.estimation.targets.source_clock import SourceClock
from gcs.estimation.targets.target import TargetEstimate
from gcs.estimation.targets.tracker import TargetReport, Tracker, TrackState

HZ, SPEED_M_S = 5.0, 5.0


def tracker(**settings: float) -> Tracker:
    return Tracker(1.0, 5.0, SourceClock(settings.get("delay_s", 0.0)))


def straight(time_s: float) -> tuple[float, float]:
    return SPEED_M_S * time_s, 0.0


def reports(
    seconds: float, *, seed: int = 0, noise_m: float = 1.0, delay_s: float = 0.0, from_s: float = 0.0
) -> Iterator[TargetReport]:
    """Of a target that moves straight on, by a clock that agrees with the loop's."""
    random = np.random.default_rng(seed)
    for number in range(round(seconds * HZ)):
        was_s = from_s + number / HZ
        x_m, y_m = np.array(straight(was_s)) + random.normal(0.0, noise_m, 2)
        yield TargetReport(was_s + delay_s, (float(x_m), float(y_m)), source_s=was_s)


def fed(seconds: float = 20.0, **how: float) -> Tracker:
    known = tracker()
    for report in reports(seconds, **how):  # type: ignore[arg-type]
        known.take(report, 0.0)
    return known


def off_m(known: Tracker, now_s: float) -> float:
    motion = known.motion(now_s)
    assert motion is not None
    return float(np.hypot(*(motion.position_m - straight(now_s))))


@pytest.mark.parametrize("delay_s", [0.0, 0.3, 1.0])
def test_late_reports_count_for_their_own_time(delay_s: float) -> None:
    known = fed(delay_s=delay_s)
    assert known.state(20.0 + delay_s) is TrackState.TRACKED
    assert off_m(known, 20.0 + delay_s) < 1.5


def test_clock_that_is_wrong_still_has_its_periods() -> None:
    known = tracker(delay_s=0.3)
    random = np.random.default_rng(1)
    for number in range(100):
        was_s = number / HZ
        jitter_s = random.uniform(0.0, 0.4)
        known.take(TargetReport(was_s + 0.3 + jitter_s, straight(was_s), source_s=was_s + 1e6), 0.0)
    assert off_m(known, 20.0) < 0.3


def test_clock_that_steps_is_noticed_and_followed() -> None:
    known = fed(noise_m=0.1)
    for report in reports(10.0, noise_m=0.1, from_s=20.0):
        known.take(TargetReport(report.arrived_s, report.position_m, source_s=report.source_s - 50.0), 0.0)
    assert known.clock.steps == 1
    assert off_m(known, 30.0) < 1.0


def test_source_that_repeats_a_place_is_named_and_not_believed() -> None:
    known = fed(noise_m=0.3)
    stood_m = straight(20.0)
    for number in range(10):
        now_s = 20.0 + number / HZ
        known.take(TargetReport(now_s, stood_m, source_s=now_s), 0.0)
    assert known.standing > 0
    assert "repeated one place" in known.why
    assert known.state(22.0) is TrackState.COASTING
    assert known.state(30.0) is TrackState.LOST


def test_target_that_stops_is_not_taken_for_a_frozen_source() -> None:
    known, random = fed(noise_m=0.3), np.random.default_rng(2)
    for number in range(50):
        now_s = 20.0 + number / HZ
        x_m, y_m = np.array(straight(20.0)) + random.normal(0.0, 0.3, 2)
        known.take(TargetReport(now_s, (float(x_m), float(y_m)), source_s=now_s), 0.0)
    assert known.state(30.0) is TrackState.TRACKED
    motion = known.motion(30.0)
    assert motion is not None
    assert np.hypot(*motion.velocity_m_s) < 0.5


def test_frozen_source_with_a_velocity_moves_nothing() -> None:
    """It is not believed from its first repetition on: else the target would be taken for one that stops."""
    known = fed(noise_m=0.3)
    expected = known.motion(22.0)
    for number in range(10):
        now_s = 20.0 + number / HZ
        report = TargetReport(now_s, known._place_m, (SPEED_M_S, 0.0), source_s=now_s)
        known.take(report, 0.0)
    motion = known.motion(22.0)
    assert motion is not None
    assert expected is not None
    assert np.hypot(*(motion.position_m - expected.position_m)) == 0.0
    assert "repeated one place" in known.why


def test_source_that_sends_the_past_again_is_named() -> None:
    """By its own times: else three of them would count as a clock that was set."""
    past = list(reports(20.0, noise_m=0.3))
    known = fed(noise_m=0.3)
    before = known.accepted
    for number, report in enumerate(past[-60:-20]):
        known.take(replace(report, arrived_s=20.0 + number / HZ), 0.0)
    assert known.accepted == before
    assert known.why == "its source repeats old reports"


@pytest.mark.parametrize("silent_s", [3.0, 10.0])
def test_target_that_turned_back_unseen_is_found_again(silent_s: float) -> None:
    """Far from where it was expected, but within what it can have moved."""
    known, random = fed(noise_m=0.3), np.random.default_rng(3)
    x_m, y_m = straight(20.0)
    back_s = 20.0 + silent_s
    for number in range(10):
        now_s = back_s + number / HZ
        there_m = x_m - SPEED_M_S * (now_s - 20.0) + random.normal(0.0, 0.3), y_m + random.normal(0.0, 0.3)
        known.take(TargetReport(now_s, there_m, source_s=now_s), 0.0)
    assert known.state(back_s + 2.0) is TrackState.TRACKED
    motion = known.motion(back_s + 2.0)
    assert motion is not None
    assert np.hypot(*(motion.position_m - (x_m - SPEED_M_S * (silent_s + 2.0), y_m))) < 2.0


def test_source_that_returns_elsewhere_stays_refused() -> None:
    known = fed(noise_m=0.3)
    x_m, y_m = straight(20.0)
    for number in range(500):
        now_s = 23.0 + number / HZ
        known.take(TargetReport(now_s, (x_m, y_m + 200.0 + 0.1 * number), source_s=now_s), 0.0)
    assert "m from where it was expected" in known.why
    assert known.state(123.0) is TrackState.LOST


def test_jump_stays_refused_and_is_named() -> None:
    known = fed(noise_m=0.3)
    for report in reports(60.0, noise_m=0.3, from_s=20.0):
        x_m, y_m = report.position_m
        known.take(TargetReport(report.arrived_s, (x_m, y_m + 100.0), source_s=report.source_s), 0.0)
    assert "m from where it was expected" in known.why
    assert known.state(80.0) is TrackState.LOST
    known.begin_again()
    known.take(TargetReport(80.0, (0.0, 100.0), source_s=80.0), 0.0)
    assert known.state(80.0) is TrackState.TRACKED


@pytest.mark.parametrize("wrong_m_s", [(300.0, 0.0), (0.0, -50.0), (20.0, 20.0)])
@pytest.mark.parametrize("many", [1, 3])
def test_wrong_velocity_with_a_good_place_leads_nowhere(wrong_m_s: tuple[float, float], many: int) -> None:
    known, moves_m_s = tracker(), (SPEED_M_S, 0.0)
    for number, report in enumerate(reports(40.0, noise_m=0.3)):
        reported_m_s = wrong_m_s if 100 <= number < 100 + many else moves_m_s
        known.take(replace(report, velocity_m_s=reported_m_s), 0.0)
        if number > 20:
            assert off_m(known, report.arrived_s) < 2.0
            assert known.state(report.arrived_s) is TrackState.TRACKED
    assert known.outliers == many


@pytest.mark.parametrize("silent_s", [1.0, 3.0, 10.0])
def test_target_is_found_again_after_a_drop_out(silent_s: float) -> None:
    known = fed(noise_m=0.5)
    for report in reports(5.0, noise_m=0.5, from_s=20.0 + silent_s, seed=3):
        known.take(report, 0.0)
    assert known.state(25.0 + silent_s) is TrackState.TRACKED
    assert off_m(known, 25.0 + silent_s) < 1.0


@pytest.mark.parametrize("place_m", [(nan, 0.0), (0.0, np.inf), (1e7, 2e7)])
def test_what_is_no_place_changes_nothing(place_m: tuple[float, float]) -> None:
    known = fed()
    before = known.belief
    known.take(TargetReport(20.0, place_m, source_s=20.0), 0.0)
    assert known.belief is before
    assert known.outliers == 1


def test_doubled_reports_count_once() -> None:
    known = tracker()
    for report in reports(10.0):
        for _ in range(3):
            known.take(report, 0.0)
    assert (known.accepted, known.doubled) == (50, 100)


@pytest.mark.parametrize(("moved_s", "coasts_s"), [(3.0, 5.0), (9.0, 9.0), (60.0, 12.0)])
def test_target_is_expected_to_go_on_as_long_as_it_has(moved_s: float, coasts_s: float) -> None:
    """At least for `coast_s`, and not for ever."""
    known = fed(moved_s)
    ends_s = moved_s + coasts_s
    assert known.state(ends_s - 1.0) is TrackState.COASTING
    assert known.state(ends_s + 1.0) is TrackState.LOST


def test_target_that_has_just_turned_is_not_expected_to_go_on() -> None:
    known = fed()
    for number in range(15):
        was_s, along_m = 20.0 + number / HZ, SPEED_M_S * number / HZ
        known.take(TargetReport(was_s, (SPEED_M_S * 20.0, along_m), source_s=was_s), 0.0)
    assert known.state(22.8 + 4.5) is TrackState.COASTING
    assert known.state(22.8 + 5.5) is TrackState.LOST


def test_gains_of_the_centre_do_not_swing_between_reports() -> None:
    """What it goes by is how well the target was known at its newest report."""
    known = fed()
    at, later = known.motion(20.0), known.motion(22.0)
    assert at is not None
    assert later is not None
    assert at.target(20.0).deviation_m_s == later.target(22.0).deviation_m_s > 0.0


@given(st.permutations(range(8)))
def test_order_of_arrival_does_not_matter(order: list[int]) -> None:
    known, as_sent = fed(10.0, noise_m=0.2), fed(10.0, noise_m=0.2)
    late = list(reports(8 / HZ, noise_m=0.2, from_s=10.0, seed=4))
    for report in late:
        as_sent.take(report, 0.0)
    for number in order:
        known.take(late[number], 0.0)
    one, other = known.motion(13.0), as_sent.motion(13.0)
    assert one is not None
    assert other is not None
    if known.outliers == as_sent.outliers == 0:
        np.testing.assert_allclose(one.position_m, other.position_m, atol=1e-9)


anything = st.floats() | st.sampled_from([0.0, 1e-300, 1e160, 1e300, -1e300])
places = st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)) | st.tuples(anything, anything)
any_report = st.builds(
    TargetReport,
    st.floats(0.0, 60.0),
    places,
    st.tuples(anything, anything),
    *[anything] * 5,
)


@given(st.lists(any_report, min_size=1, max_size=8))
def test_any_reports_leave_a_target_that_can_be_followed(received: list[TargetReport]) -> None:
    known = tracker()
    for report in received:
        known.take(report, 0.0)
        motion = known.motion(60.0)
        if motion is not None:
            motion.target(60.0)  # refuses what is not finite


@given(st.floats(0.01, 30.0), st.floats(0.01, 30.0))
def test_uncertainty_grows_without_reports(first_s: float, more_s: float) -> None:
    belief = fed(10.0).belief
    assert belief is not None
    sooner = foreseen(belief, 10.0 + first_s)
    later = foreseen(belief, 10.0 + first_s + more_s)
    assert later.deviation_m >= sooner.deviation_m


@given(st.floats(-np.pi, np.pi), st.floats(-500.0, 500.0), st.floats(-500.0, 500.0))
def test_estimate_turns_and_moves_with_its_reports(turn_rad: float, x_m: float, y_m: float) -> None:
    turned = np.array([[np.cos(turn_rad), -np.sin(turn_rad)], [np.sin(turn_rad), np.cos(turn_rad)]])
    plain = elsewhere = None
    for report in reports(6.0):
        seen_m, variance = np.array(report.position_m), np.ones(2)
        there_m = turned @ seen_m + (x_m, y_m)
        if plain is None or elsewhere is None:
            plain, elsewhere = (begun(report.source_s, each, variance) for each in (seen_m, there_m))
            continue
        plain = corrected(plain, report.source_s, seen_m, variance)
        elsewhere = corrected(elsewhere, report.source_s, there_m, variance)
    assert plain is not None
    assert elsewhere is not None
    one, other = foreseen(plain, 7.0), foreseen(elsewhere, 7.0)
    np.testing.assert_allclose(turned @ one.position_m + (x_m, y_m), other.position_m, atol=1e-6)
    np.testing.assert_allclose(turned @ one.velocity_m_s, other.velocity_m_s, atol=1e-6)


def turning(time_s: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return 15.0 * np.array([np.sin(time_s / 3.0), 1.0 - np.cos(time_s / 3.0)])


def mean_off_m(place: Callable[[float], object], *, turns: bool) -> float:
    """With one model that is brisk everywhere, and with all that interact."""
    random, off = np.random.default_rng(5), []
    belief = None
    for number in range(150):
        was_s = number / HZ
        seen_m = np.asarray(place(was_s)) + random.normal(0.0, 1.0, 2)
        if belief is None:
            belief = begun(was_s, seen_m, np.ones(2))
        else:
            belief = corrected(belief, was_s, seen_m, np.ones(2))
            if not turns:
                belief.weight[:] = (0.0005, 0.999, 0.0005)
        off.append(np.hypot(*(foreseen(belief, was_s).position_m - np.asarray(place(was_s)))))
    return float(np.mean(off[40:]))


@pytest.mark.parametrize("place", [straight, turning])
def test_models_that_interact_are_nearer_than_one(place: Callable[[float], object]) -> None:
    assert mean_off_m(place, turns=True) < 0.9 * mean_off_m(place, turns=False)


def test_better_source_counts_without_a_jump() -> None:
    best, other = tracker(), tracker()
    target = TargetEstimate([best, other])
    random, last_m, jumps_m = np.random.default_rng(6), None, []
    for tick in range(1200):
        now_s = tick / 20.0
        if tick % 4 == 0:
            x_m, y_m = straight(now_s)
            if not 20.0 <= now_s < 40.0:
                best.take(TargetReport(now_s, (x_m + random.normal(0.0, 0.2), y_m), source_s=now_s), 0.0)
            other.take(TargetReport(now_s, (x_m + 3.0, y_m + random.normal(0.0, 0.5)), source_s=now_s), 0.0)
        motion = target.motion(now_s)
        if motion is None or tick < 200:
            continue
        if last_m is not None:
            jumps_m.append(float(np.hypot(*(motion.position_m - last_m))))
        last_m = motion.position_m
        assert target.active == (1 if 20.2 <= now_s < 40.0 else 0) or 20.0 <= now_s <= 20.2
    assert target.changes == 2
    assert max(jumps_m) < SPEED_M_S / 20.0 + 0.3


def test_sources_that_contradict_each_other_are_noticed() -> None:
    best, other = tracker(), tracker()
    target = TargetEstimate([best, other])
    for report in reports(20.0):
        best.take(report, 0.0)
        other.take(
            TargetReport(report.arrived_s, (report.position_m[0], 30.0), source_s=report.source_s), 0.0
        )
    assert target.motion(20.0) is not None
    assert target.apart_m(20.0) == pytest.approx(30.0, abs=2.0)
