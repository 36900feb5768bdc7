"""The rule by which a vehicle is silent, at its boundary."""

from math import inf, nan

import numpy as np
import pytest

from gcs.estimation.link_health import are_silent

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
