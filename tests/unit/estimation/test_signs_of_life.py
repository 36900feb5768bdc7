"""The rule by which a vehicle is silent, at its boundary; the gaps that a stall of the station leaves."""

from math import inf, nan

import numpy as np
import pytest

from gcs.estimation.link_health import GAP_COUNTS_S, SetpointGaps, signs_of_life

NOW_S, SILENCE_S = 100.0, 2.0
FRESH = np.array([NOW_S])


def silent_of(
    life_s: np.ndarray,
    beat_s: np.ndarray,
    position_s: np.ndarray,
    judged_s: float = inf,
    lacks_s: float = 0.0,
) -> list[bool]:
    count = len(life_s)
    none, here_m, lacks = np.zeros(count, np.bool_), np.zeros((count, 3)), np.full(count, lacks_s)
    arrivals = NOW_S, life_s, beat_s, position_s
    seen, silent, _, fresh = signs_of_life(*arrivals, here_m, lacks, none, SILENCE_S, judged_s)
    assert not (fresh & silent).any()
    assert judged_s < inf or (seen == ~silent).all()
    return [bool(each) for each in silent]


@pytest.mark.parametrize("sign", ["life", "beat", "position"])
@pytest.mark.parametrize(
    ("age_s", "silent"), [(0.0, False), (2.0, False), (2.001, True), (50.0, True), (inf, True), (nan, True)]
)
def test_each_sign_of_life_counts_from_just_above_the_limit(sign: str, age_s: float, silent: bool) -> None:
    arrival = dict.fromkeys(["life", "beat", "position"], FRESH) | {sign: NOW_S - np.array([age_s])}
    assert silent_of(arrival["life"], arrival["beat"], arrival["position"]) == [silent]


@pytest.mark.parametrize(("judged_s", "silent"), [(2.0, False), (2.001, True), (inf, True)])
def test_after_a_stall_a_vehicle_is_judged_from_its_end(judged_s: float, silent: bool) -> None:
    old = np.full(1, NOW_S - 30.0)
    assert silent_of(old, old, old, judged_s=judged_s) == [silent]


def test_only_the_silent_of_several_vehicles_are_named() -> None:
    life_s = np.array([NOW_S, NOW_S - 3.0, NOW_S])
    position_s = np.array([NOW_S - 1.0, NOW_S, NOW_S - 3.0])
    beat_s = np.full(3, NOW_S - 9.0)
    assert silent_of(life_s, beat_s, position_s, lacks_s=8.0) == [False, True, True]


def test_signs_of_life_of_absent_and_unplaced_vehicles() -> None:
    old, absent, lacks_s = np.full(2, NOW_S - 30.0), np.array([True, False]), np.zeros(2)
    here_m = np.array([[0.0, 0.0, -5.0], [nan, nan, nan]])
    seen, silent, beats, fresh = signs_of_life(NOW_S, old, old, old, here_m, lacks_s, absent, SILENCE_S, 1.0)
    assert silent.tolist() == [True, False]  # a stall excuses only those that were there before it
    assert not seen.any()
    assert not beats.any()
    assert fresh.tolist() == [False, True]
    now = np.full(2, NOW_S)
    seen, _, beats, _ = signs_of_life(NOW_S, now, now, now, here_m, lacks_s, absent, SILENCE_S, inf)
    assert seen.tolist() == [True, False]
    assert beats.all()


EVERY, NONE_LEFT = np.ones(2, dtype=np.bool_), np.zeros(2, dtype=np.bool_)


def gaps_after(*ticks_s: float, commanded: np.ndarray = EVERY) -> SetpointGaps:
    gaps = SetpointGaps(2)
    for tick_s in ticks_s:
        gaps.note(commanded, NONE_LEFT, tick_s)
    return gaps


def test_station_stall_is_a_gap_for_every_commanded_vehicle() -> None:
    gaps = gaps_after(1.0, 1.05, 2.55, 2.6, commanded=np.array([True, False]))
    assert gaps.longest_s(0) == pytest.approx(1.5)
    assert np.isnan(gaps.longest_s(1))


def test_tick_that_commands_nothing_is_no_gap() -> None:
    gaps = gaps_after(1.0)
    for step in range(1, 61):  # three seconds without its position
        gaps.note(np.array([False, True]), NONE_LEFT, 1.0 + 0.05 * step)
    assert gaps.longest_s(0) == pytest.approx(0.05)


def test_gap_is_forgotten_except_of_vehicles_outside_control() -> None:
    gaps = gaps_after(1.0, 3.0)
    left = np.array([True, False])
    for step in range(1, 301):
        gaps.note(EVERY, left, 3.0 + 0.05 * step)
    assert GAP_COUNTS_S < 300 * 0.05
    assert gaps.longest_s(0) == pytest.approx(2.0)
    assert gaps.longest_s(1) == pytest.approx(0.05)
