"""Rates and times of the fleet at a glance, from numbers alone."""

import numpy as np
import pytest

from gcs.estimation.time_estimates import BatteryHistory, Speeds, approach_s, batteries, home_s, to_slots_s
from gcs.model.state import Array

SPEEDS = Speeds(
    level_m_s=4.0,
    up_m_s=2.5,
    down_m_s=1.4,
    slot_m_s=4.0,
    slot_rate_per_s=1.0,
    radius_m_s=1.0,
    climb_m_s=1.0,
)
FLYING = np.array([True])


def reported(endurance_s: float, until_s: float, noise: float = 0.0) -> BatteryHistory:
    """One vehicle, noted once a second in whole percent, as an autopilot reports it."""
    random = np.random.default_rng(5)
    history = BatteryHistory(1)
    for now_s in np.arange(0.0, until_s + 0.5):
        true = 1.0 - now_s / endurance_s + noise * random.standard_normal()
        history.note(np.array([np.ceil(100.0 * np.clip(true, 0.0, 1.0)) / 100.0]), FLYING, now_s)
    return history


@pytest.mark.parametrize("endurance_s", [60.0, 300.0, 1200.0, 3600.0])
def test_steady_battery_is_predicted_within_a_few_percent(endurance_s: float) -> None:
    for share in (0.06, 0.2, 0.5, 0.9):
        now_s = float(round(share * endurance_s + 6.0))
        left_s = float(reported(endurance_s, now_s).left_s(0.0, now_s)[0])
        assert left_s == pytest.approx(endurance_s - now_s, abs=max(3.0, 0.1 * endurance_s))


def test_time_left_is_unknown_before_three_percent_in_the_air() -> None:
    assert np.isnan(reported(1200.0, 35.0).rate_per_s(35.0)).all()
    assert np.isnan(reported(1e9, 3000.0).rate_per_s(3000.0)).all()


def test_noise_of_a_percent_does_not_spoil_the_estimate() -> None:
    left_s = float(reported(1200.0, 300.0, noise=0.004).left_s(0.2, 300.0)[0])
    assert left_s == pytest.approx(0.8 * 1200.0 - 300.0, rel=0.25)


def test_estimate_soon_follows_a_slower_battery_drain() -> None:
    history, remaining = reported(600.0, 120.0), 0.8
    before_s = float(history.left_s(0.0, 120.0)[0])
    for now_s in np.arange(121.0, 241.0):
        history.note(np.array([remaining]), FLYING, now_s)
    assert float(history.left_s(0.0, 240.0)[0]) > 1.3 * before_s


def test_landing_restarts_the_estimate_and_low_has_no_time_left() -> None:
    history = reported(300.0, 270.0)
    assert history.left_s(0.2, 270.0)[0] == 0.0
    assert 0.0 < history.left_s(0.0, 270.0)[0] < 60.0
    history.note(np.array([1.0]), ~FLYING, 271.0)
    history.note(np.array([1.0]), FLYING, 300.0)
    assert np.isnan(history.left_s(0.0, 300.0)).all()


def test_jump_of_the_battery_level_is_no_rate() -> None:
    history = reported(1200.0, 200.0)
    assert np.isfinite(history.left_s(0.0, 200.0)).all()
    history.note(np.array([0.18]), FLYING, 201.0)
    assert np.isnan(history.left_s(0.0, 202.0)).all()


def of(remaining: Array, flying: list[bool], received: list[bool]) -> list[float | None]:
    n = len(remaining)
    found = batteries(BatteryHistory(n), remaining, np.array(flying), np.array(received), 0.2, 0.0)
    known = (found.battery_least, found.battery_median)
    return [None if value is None else round(value, 6) for value in known]


def test_least_and_median_prefer_flying_vehicles() -> None:
    remaining = np.array([0.9, 0.5, 0.3, np.nan])
    assert of(remaining, [True, True, False, True], [True] * 4) == [0.5, 0.7]
    assert of(remaining, [False] * 4, [True, False, True, True]) == [0.3, 0.6]
    assert of(remaining, [False] * 4, [False] * 4) == [None, None]
    assert of(np.full(4, np.nan), [True] * 4, [True] * 4) == [None, None]


def test_vehicle_already_low_is_first_whatever_its_rate() -> None:
    all_fly = np.array([True, True, True])
    found = batteries(BatteryHistory(3), np.array([0.9, 0.18, np.nan]), all_fly, all_fly, 0.2, 0.0)
    assert found.low_row == 1
    assert found.low_s[1] == 0.0
    assert np.isnan(found.low_s[[0, 2]]).all()


def test_path_time_includes_the_slow_end() -> None:
    far_s, near_s, there_s = approach_s(np.array([44.0, 4.0, 0.5]), 4.0, 1.0, 1.0)
    assert far_s == pytest.approx(10.0 + np.log(4.0))
    assert near_s == pytest.approx(np.log(4.0))
    assert there_s == 0.0


def test_assembly_time_counts_the_last_vehicle_and_the_climb() -> None:
    here_m = np.array([[0.0, 0.0, -10.0], [0.0, 0.0, -10.0]])
    level_s = to_slots_s(here_m, here_m + np.array([[1.0, 0.0, 0.0], [20.0, 0.0, 0.0]]), 1.0, SPEEDS)
    up_s = to_slots_s(here_m, here_m + np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -20.0]]), 1.0, SPEEDS)
    assert level_s == pytest.approx(4.0 + np.log(4.0))
    assert up_s == pytest.approx(19.0 / 2.5)
    assert to_slots_s(np.zeros((0, 3)), np.zeros((0, 3)), 1.0, SPEEDS) == 0.0


def test_home_time_is_unknown_without_position_or_pad() -> None:
    there_m, pads_m = np.array([[30.0, 40.0, -20.0]]), np.zeros((1, 3))
    assert home_s(np.zeros((0, 3)), np.zeros((0, 3)), 5.0, 1.5, SPEEDS, standing=False) is None
    assert home_s(there_m * np.nan, pads_m, 5.0, 1.5, SPEEDS, standing=False) is None
    now_s = home_s(there_m, pads_m, 5.0, 1.5, SPEEDS, standing=False)
    later_s = home_s(there_m, pads_m, 5.0, 1.5, SPEEDS, standing=True)
    assert now_s is not None
    assert later_s is not None
    assert now_s > later_s > 18.5 / 1.4
