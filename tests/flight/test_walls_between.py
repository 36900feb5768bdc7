"""Vehicles and their pads, with walls or moving boxes between them: all come home, land and join in time."""

from typing import Final

import pytest

from gcs.simulation.batch import figure
from gcs.simulation.flight import prepared
from gcs.simulation.metrics import report
from gcs.simulation.scenario import Scenario

SEEDS: Final = {
    "return-walls": (6000, 7000),
    "return-walls-lost": (7100, 7101),
    "return-walls-alone": (7200, 7201),
    "land-walls": (7300, 7301),
    "join-walls": (7400, 7401),
}
"""`gcs simulate --row return` flies others."""

CASES: Final = [(name, 8, seed) for name, seeds in SEEDS.items() for seed in seeds]


def number(figures: dict[str, object], name: str) -> float:
    value = figure(figures, name)
    assert isinstance(value, float), f"{name}: {value}"
    return value


@pytest.mark.keeps("return-walls-8-6000")
@pytest.mark.parametrize(("name", "count", "seed"), CASES)
def test_all_are_there_in_time(name: str, count: int, seed: int) -> None:
    figures = report(prepared(Scenario.load(name), count, seed).fly())
    assert figure(figures, "separation.violations") == 0
    assert figure(figures, "obstacles.penetrations") == 0
    assert figure(figures, "arrival.missing") == 0
    assert number(figures, "arrival.late_s") <= 0.0


@pytest.mark.soak
@pytest.mark.parametrize(("count", "seed"), [(20, 6003), (20, 6014)])
def test_those_on_planned_paths_wait_for_boxes_that_pass(count: int, seed: int) -> None:
    """Boxes had counted as if no vehicle waited; out of a pocket some had climbed over its walls."""
    figures = report(prepared(Scenario.load("return-walls"), count, seed).fly())
    assert number(figures, "arrival.total_s") <= 90.0
    assert figure(figures, "obstacles.penetrations") == 0


@pytest.mark.soak
def test_one_that_a_box_pushes_aside_lands_where_it_is() -> None:
    """0.1 m above the ground it had climbed to go back, and passed one on the ground at 1.92 m."""
    figures = report(prepared(Scenario.load("land-walls"), 50, 6301).fly())
    assert figure(figures, "separation.violations") == 0
    assert figure(figures, "arrival.missing") == 0
