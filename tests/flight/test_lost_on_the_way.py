"""Vehicles that lose their links on the way home hang between the others and their pads."""

import pytest

from gcs.simulation.flight import fly
from gcs.simulation.scenario import Scenario

pytestmark = pytest.mark.soak


@pytest.mark.soak
@pytest.mark.parametrize(("count", "seed"), [(20, 6100), (20, 6103), (50, 6100), (50, 6104)])
def test_the_others_come_home_in_time_past_them(count: int, seed: int) -> None:
    """They followed planned paths up to lost vehicles, and waited there: the last came 15 s too late."""
    metrics = fly(Scenario.load("return-walls-lost"), count, seed).metrics
    assert metrics.arrival.arrived == metrics.arrival.expected
    assert metrics.arrival.late_s is not None
    assert metrics.arrival.late_s <= 0.0
    assert metrics.separation.violations == 0
    assert metrics.obstacles is not None
    assert metrics.obstacles.penetrations == 0
