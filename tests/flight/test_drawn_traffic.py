"""In drawn shows vehicles that pass at the spacing of the show do not slow down for each other."""

import pytest

from gcs.simulation.batch import Run, run_once
from gcs.simulation.scenario import Scenario

WORLDS = ("drawn-opposing", "drawn-opposing-delayed", "drawn-opposing-noise")
SEEDS = range(12800, 12900)

pytestmark = pytest.mark.soak


@pytest.mark.parametrize(("name", "seed"), [(name, seed) for name in WORLDS for seed in SEEDS])
def test_vehicles_pass_at_the_drawn_spacing_without_a_delay(name: str, seed: int) -> None:
    figures = run_once(Run(Scenario.load(name), 8 + seed % 17, seed))
    assert figures["failed"] == []
