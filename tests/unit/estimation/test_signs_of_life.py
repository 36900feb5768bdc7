"""The rule by which a vehicle is silent, at its boundary; the gaps that a stall of the station leaves."""

from math import inf, nan

import numpy as np
import pytest

from gcs.estimation.link_health import GAP_COUNTS_S, SetpointGaps, are_silent

NOW_S, SILENCE_S = 100.0, 2.0
FRESH = np.array([NOW_S])


@pytest.mark.parametrize("sign", ["life", "beat", "position"])
@pytest.mark.parametrize(
    ("age_s", "silent"), [(0.0, False), (2.0, False), (2.001, True), (50.0, True), (inf, True), (nan, True)]
)
def test_each_sign_of_life_counts_from_just_above_the_limit(sign: str, age_s: float, silent: bool) -> None:
    arrival = dict.fromkeys(["life", "beat", "position"], FRESH) | {sign: NOW_S - np.array([age_s])}
    found = are_silent(NOW_S, arrival["life"], arrival["beat"], arrival["position"], SILENCE_S)
    assert found.tolist() == [silent]


def test_after_a_stall_a_vehicle_is_judged_from_its_end() -> None:
    old = np.full(3, NOW_S - 30.0)
    judged_s = np.array([2.0, 2.001, inf])
    assert are_silent(NOW_S, old, old, old, SILENCE_S, judged_s=judged_s).tolist() == [False, True, True]


def test_only_the_silent_of_several_vehicles_are_named() -> None:
    life_s = np.array([NOW_S, NOW_S - 3.0, NOW_S])
    position_s = np.array([NOW_S - 1.0, NOW_S, NOW_S - 3.0])
    beat_s = np.full(3, NOW_S - 9.0) + 8.0  # heartbeats may be late by eight seconds
    assert are_silent(NOW_S, life_s, beat_s, position_s, SILENCE_S).tolist() == [False, True, True]


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
