"""Section 5 of the article, flown as it is shipped."""

from pathlib import Path

import numpy as np
import pytest

from gcs.simulation.article import article_figures
from gcs.simulation.batch import broken
from gcs.simulation.flight import prepared
from gcs.simulation.metrics import report
from gcs.simulation.plot import draw
from gcs.simulation.record import FlightRecord
from gcs.simulation.scenario import ArticleFlight, Scenario

VEHICLES = 4


def flown(name: str, seed: int) -> FlightRecord:
    return prepared(Scenario.load(name), VEHICLES, seed).fly()


@pytest.fixture(scope="module")
def around_a_box() -> FlightRecord:
    return flown("article-obstacle", 7)


@pytest.mark.keeps("article-assembly")
@pytest.mark.parametrize("name", ["article-assembly", "article-tracking"])
def test_four_drones_form_a_tetrahedron_round_the_target(name: str) -> None:
    record = flown(name, 7)
    figures = report(record)
    assert not broken(figures, record.scenario.judged.must)
    assert figures["formation"]["settled"]  # type: ignore[index]
    assert figures["tracking"]["center_speed_m_s"] == pytest.approx(12.0, abs=0.5)  # type: ignore[index]


@pytest.mark.soak
def test_the_formation_passes_a_box_and_is_a_tetrahedron_again(around_a_box: FlightRecord) -> None:
    flight = around_a_box.scenario.flight
    assert isinstance(flight, ArticleFlight)
    assert not broken(report(around_a_box), around_a_box.scenario.judged.must)
    path_m = around_a_box.path_m
    box = flight.boxes[0]
    away_m = np.linalg.norm(path_m[:, :, :2] - (box.x_m, box.y_m), axis=2).min(axis=1)
    assert away_m.min() < 10.0


@pytest.mark.soak
def test_same_seed_same_flight_another_seed_another() -> None:
    short = Scenario.load("article-tracking").with_(duration_s=25.0)
    once, again, other = (prepared(short, VEHICLES, seed).fly() for seed in (7, 7, 8))
    assert np.array_equal(again.path_m, once.path_m)
    assert not np.allclose(other.path_m, once.path_m)
    assert article_figures(again) == article_figures(once)


@pytest.mark.soak
def test_section_5_is_drawn(around_a_box: FlightRecord, tmp_path: Path) -> None:
    draw(around_a_box, tmp_path / "article.png")
    assert (tmp_path / "article.png").stat().st_size > 50_000
