"""The judge of traffic: entries are counted, and those that could have been avoided."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.control import ControlSettings
from gcs.control.memory import Memory
from gcs.formation.orbit import Center
from gcs.model.state import Array
from gcs.simulation.crossing import Crossing, TrafficFigures, figures
from gcs.simulation.scenario import CrossingTraffic


def judged(settings: CrossingTraffic, place_m: Array) -> TrafficFigures:
    """The figures of vehicles that stand at (n, 3), whatever comes."""
    crossing = Crossing(settings, 1, ControlSettings().safety, 10.0)
    center = Center.at_rest(np.array([0.0, 0.0, -40.0]))
    memory = replace(Memory.fresh(len(place_m), 0.0), center=center)
    for tick in range(6000):
        crossing.near(0.2 * tick, place_m, memory)
        if crossing.is_over:
            break
    assert crossing.is_over
    return figures(crossing.passages)


@pytest.mark.parametrize(("from_m", "avoidable"), [(300.0, 1), (45.0, 0)])
def test_entry_is_told_apart_that_no_vehicle_could_avoid(from_m: float, avoidable: int) -> None:
    """At 30 m/s, known from 45 m away and a second later: no vehicle leaves a cylinder of 30 m."""
    settings = CrossingTraffic(
        count=1, radius_m=30.0, half_height_m=15.0, from_m=from_m, speed_min_m_s=29.9, speed_max_m_s=30.0,
        aside_m=1.0, above_m=1.0,
    )  # fmt: skip
    found = judged(settings, np.array([[0.0, 0.0, -40.0], [0.0, 0.0, -90.0]]))
    assert (found.crossings, found.entries, found.avoidable) == (1, 1, avoidable)


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["turn", "circle", "back", "hover"])
def test_tracks_that_turn_come_from_afar_and_pass(kind: str) -> None:
    settings = CrossingTraffic(count=6, radius_m=60.0, motions=(kind,))  # type: ignore[arg-type]
    found = judged(settings, np.array([[0.0, 0.0, -40.0]]))
    assert found.crossings == found.announced == 6
    assert found.entries >= 4, "they are aimed at the formation"


def test_several_cross_together() -> None:
    found = judged(CrossingTraffic(count=5, together=5), np.array([[0.0, 0.0, -40.0]]))
    assert 10 <= found.crossings <= 25
