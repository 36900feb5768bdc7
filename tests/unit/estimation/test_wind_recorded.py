"""The wind that real autopilots' recordings show; in both their simulators had none."""

from pathlib import Path

import numpy as np
import pytest

from gcs.estimation.wind import WindEstimate, WindEstimator

DATA = Path(__file__).parents[2] / "data" / "attitudes"
FLIES_M = 2.0


def measured(name: str) -> list[WindEstimate]:
    """What one vehicle measures in a recording, while it is known."""
    recorded = np.loadtxt(DATA / f"{name}.csv.gz", delimiter=",")
    estimator, estimates = WindEstimator(1), []
    for row in recorded:
        flies = np.array([row[7] > FLIES_M])
        estimator.take(row[0], row[None, 1:4].copy(), np.zeros(1), row[None, 4:7].copy(), flies)
        estimates.append(estimator.look(row[0]))
    return [estimate for estimate in estimates if estimate.is_known]


@pytest.mark.parametrize(("name", "drag_per_s"), [("px4", 1.0), ("ardupilot", 0.653)])
def test_recorded_flights_in_calm_show_no_wind_and_the_true_drag(name: str, drag_per_s: float) -> None:
    estimates = measured(name)
    assert len(estimates) > 1000
    speed_m_s = np.array([estimate.speed_m_s for estimate in estimates])
    assert np.median(speed_m_s) < 0.3
    assert speed_m_s.max() < 1.5
    assert max(estimate.with_gusts_m_s for estimate in estimates) < 5.0
    assert estimates[-1].drag_per_s == pytest.approx(drag_per_s, rel=0.05)
