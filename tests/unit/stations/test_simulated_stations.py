"""A formation of several stations in virtual time, over a late bus that loses messages."""

import pytest

from gcs.model.errors import ConfigError
from gcs.simulation.flight import prepared
from gcs.simulation.metrics import report
from gcs.simulation.scenario import Scenario
from gcs.site.simulated import SimulatedStations


@pytest.mark.soak
def test_crowd_of_many_stations_keeps_apart_as_that_of_one() -> None:
    """A vehicle between two of other stations has nowhere to go, and those behind it have to know."""
    scenario = Scenario.load("stations-scale")
    changed = {"duration_s": 13.0, "divided": {"count": 20, "delay_s": 0.02, "spread_s": 0.01, "loss": 0.01}}
    record = prepared(scenario.with_(**changed), 400, 1, SimulatedStations).fly()
    assert min(record.closest_m) >= 2.6  # of the 2.7 m that floor, margin and reserve ask for


def flown(stations: int) -> dict[str, object]:
    scenario = Scenario.load("stations")
    changed = {"divided": {"count": stations, "loss": 0.05}, "duration_s": 44.0}
    return report(prepared(scenario.with_(**changed), 32, 3, SimulatedStations).fly())


@pytest.mark.soak
def test_four_stations_fly_the_shape_that_one_flies() -> None:
    one, four = flown(1), flown(4)
    for figures in (one, four):
        separation, formation = figures["separation"], figures["formation"]
        assert isinstance(separation, dict)
        assert isinstance(formation, dict)
        assert separation["violations"] == 0
        assert formation["settled"]
        assert formation["energy_ratio"] <= 1.002


def test_without_flights_a_divided_scenario_is_refused() -> None:
    with pytest.raises(ConfigError, match="stations: several flights divide its vehicles"):
        prepared(Scenario.load("stations"), 32, 3)
