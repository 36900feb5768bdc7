"""The estimator's error is as large and as slow as measured."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.sim.vehicle.sensors import POSITION_SD_M, draw_errors, step_errors

DT_S = 0.05


def history(scale: float = 1.0, seconds: float = 200.0, count: int = 60) -> np.ndarray:
    """(steps, count, 3)."""
    random = np.random.default_rng(3)
    error = draw_errors(count, scale, random)
    rows = []
    for _ in range(round(seconds / DT_S)):
        error = step_errors(error, DT_S, scale, random)
        rows.append(error.position_m)
    return np.array(rows)


def test_error_has_the_measured_spread_from_the_start() -> None:
    rows = history()
    assert rows.std(axis=(0, 1)) == pytest.approx([0.09, 0.19, 0.41], rel=0.08)
    many = draw_errors(4000, 1.0, np.random.default_rng(1))
    assert many.position_m.std(axis=0) == pytest.approx([0.09, 0.19, 0.41], rel=0.08)


def test_the_error_is_correlated_over_three_to_six_seconds() -> None:
    rows = history() / np.array(POSITION_SD_M)
    lags_s = np.arange(0.0, 12.0, DT_S)
    correlation = np.array([np.mean(rows[: len(rows) - k] * rows[k:]) for k in range(len(lags_s))])
    below = lags_s[int(np.argmax(correlation < np.exp(-1)))]
    assert 3.0 < below < 6.0


def test_the_errors_of_two_vehicles_are_independent() -> None:
    rows = history(count=2, seconds=2000.0)
    assert abs(np.corrcoef(rows[:, 0, 2], rows[:, 1, 2])[0, 1]) < 0.25


def test_scale_zero_has_no_error() -> None:
    assert not history(scale=0.0, seconds=5.0).any()


def test_the_same_seed_gives_the_same_errors() -> None:
    assert (history(seconds=5.0) == history(seconds=5.0)).all()
