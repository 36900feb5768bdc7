"""Boxes that drive at a formation from all sides: none comes over a vehicle."""

from typing import Final

import pytest

from gcs.simulation.batch import figure
from gcs.simulation.flight import prepared
from gcs.simulation.metrics import report
from gcs.simulation.scenario import Scenario

pytestmark = pytest.mark.soak

CLOSED_S: Final = 75.0
"""By then the last of the boxes has passed, or closed in."""

BROKEN: Final = [(20, 8001), (20, 8036), (8, 102), (20, 8047)]
"""Climbed for boxes as they were at the begin; a centre without a way; a vehicle parted from the others; two
that followed the formation into a gap that closed.
"""

SOAKED: Final = [(count, seed) for count in (8, 20, 50) for seed in range(8100, 8110)]
"""`gcs simulate boxes-surround-random --judged` flies 201 others."""


@pytest.mark.keeps("8-102")
@pytest.mark.parametrize(
    ("count", "seed"), [*BROKEN, *(pytest.param(*case, marks=pytest.mark.soak) for case in SOAKED)]
)
def test_no_vehicle_is_inside_a_box(count: int, seed: int) -> None:
    scenario = Scenario.load("boxes-surround-random").with_(duration_s=CLOSED_S)
    figures = report(prepared(scenario, count, seed).fly())
    assert figure(figures, "obstacles.penetrations") == 0
    assert figure(figures, "separation.violations") == 0


@pytest.mark.soak
@pytest.mark.parametrize("seed", [1, 2])
def test_those_that_are_left_come_home_beside_the_lost(seed: int) -> None:
    """Vehicles are lost while all return: where they may come down, no other does."""
    figures = report(prepared(Scenario.load("loss-on-return"), 20, seed).fly())
    assert figure(figures, "arrival.missing") == 0
    assert figure(figures, "arrival.expected") in {18, 19, 20}, "all but the lost that were still in the air"
    assert figure(figures, "separation.violations") == 0
