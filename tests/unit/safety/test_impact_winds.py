"""Discs of impacts in more wind than the settings allow."""

import numpy as np
import pytest

from gcs.control.area_graphs import prepare_ways, prepared_ways
from gcs.safety.fenced_areas import FencedArea
from gcs.safety.impact import ImpactSettings, impacts, in_wind, winds_of
from gcs.safety.surroundings import SafetySettings
from gcs.safety.walls import Fence


@pytest.mark.parametrize("wind_m_s", [0.0, 7.9, 8.0, np.nan, -1.0])
def test_no_more_wind_than_allowed_changes_nothing(wind_m_s: float) -> None:
    settings = ImpactSettings(wind_max_m_s=8.0)
    assert in_wind(settings, wind_m_s) is settings


@pytest.mark.parametrize("wind_m_s", [8.01, 12.0, 12.1, 24.9, 25.0, 40.0, np.inf])
def test_more_wind_has_a_table_that_holds_it_and_was_made(wind_m_s: float) -> None:
    settings = ImpactSettings(wind_max_m_s=8.0)
    counted = in_wind(settings, wind_m_s)
    assert counted.wind_max_m_s >= min(wind_m_s, 25.0)
    assert counted.wind_max_m_s in winds_of(settings)
    assert counted is in_wind(settings, wind_m_s), "the same object from tick to tick"
    place_m, velocity_m_s = np.array([[0.0, 0.0, -30.0]]), np.array([[3.0, 0.0, 0.0]])
    discs = [impacts(place_m, velocity_m_s, each).spread_m[0] for each in (settings, counted)]
    assert discs[1] > discs[0]


@pytest.mark.parametrize("wind_m_s", [0.0, 8.0, 24.0, 25.0])
def test_tables_begin_with_the_wind_of_the_settings(wind_m_s: float) -> None:
    winds_m_s = winds_of(ImpactSettings(wind_max_m_s=wind_m_s))
    assert (winds_m_s[0], winds_m_s[-1]) == (wind_m_s, 25.0)
    assert list(winds_m_s) == sorted(set(winds_m_s))


def test_ways_round_walls_stay_in_more_wind() -> None:
    ground = FencedArea(corners_m=((-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0)))
    fence = Fence(controlled_ground=ground, height_max_m=40.0)
    safety = SafetySettings(fence=fence, impact=ImpactSettings(wind_max_m_s=5.0))
    prepare_ways(safety)
    ways = prepared_ways(safety)
    assert ways is not None
    windier = safety.model_copy(update={"impact": in_wind(safety.impact, 9.5)})
    assert prepared_ways(windier) is ways
    calmer = safety.model_copy(update={"impact": ImpactSettings(wind_max_m_s=4.0)})
    assert prepared_ways(calmer) is None
    prepare_ways(calmer)
    assert prepared_ways(calmer) is not ways
