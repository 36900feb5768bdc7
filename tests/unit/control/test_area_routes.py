"""Ways within concave areas: a tick looks them up in graphs that were made before, and makes none."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from types import FrameType

import numpy as np
import pytest

from gcs.control import ControlSettings, Memory, Task, Tasks, prepare, tick, warm_up
from gcs.control.area_graphs import BANDS_MAX, GRAPHS_MAX, POINTS_MAX, band_of, graph_of, prepared_ways
from gcs.control.memory import AreaWays
from gcs.model.plan import Formation, Plan
from gcs.model.state import Array, FleetState, Traits
from gcs.safety.fenced_areas import Corner, FencedArea
from gcs.safety.surroundings import SafetySettings
from gcs.safety.walls import Fence

DT_S = 0.05


def star(corners: int, inner_m: float, outer_m: float, at_m: Corner = (0.0, 0.0)) -> tuple[Corner, ...]:
    """A ring about `at_m` with every second corner farther out; it begins outside."""
    turn_rad = 2.0 * np.pi * np.arange(corners) / corners
    away_m = np.where(np.arange(corners) % 2, inner_m, outer_m)
    return tuple(zip(at_m[0] + away_m * np.cos(turn_rad), at_m[1] + away_m * np.sin(turn_rad), strict=True))


def site(outer_m: float = 300.0) -> SafetySettings:
    """148 corners: a star within another one's ground, round a third that is closed up to 30 m."""
    closed = FencedArea(corners_m=star(42, 20.0, 40.0), inside=False, height_max_m=30.0)
    fence = Fence(
        distance_max_m=1e3,
        areas=(FencedArea(corners_m=star(64, 150.0, outer_m)), closed),
        controlled_ground=FencedArea(corners_m=star(42, 250.0, 450.0)),
    )
    return SafetySettings(fence=fence)


PLACE_M = np.array([[-70.0, 0.0, -20.0], [0.0, -70.0, -12.0], [230.0, 0.0, -25.0], [-90.0, 9.0, -55.0]])
GOAL_M = np.array([[70.0, 0.0, -20.0], [0.0, 70.0, -28.0], [0.0, 230.0, -5.0], [90.0, 9.0, -58.0]])
HIDDEN = [True, True, True, False]
"""The last flies over the closed space."""


@contextmanager
def graphs_made() -> Iterator[list[str]]:
    """A name for each graph that is made meanwhile."""
    made: list[str] = []

    def seen(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code is graph_of.__code__:
            made.append(frame.f_code.co_name)

    before = sys.getprofile()
    sys.setprofile(seen)
    try:
        yield made
    finally:
        sys.setprofile(before)


def ways_of(
    safety: SafetySettings,
    memory: Memory,
    index: int,
    deviation_m: float,
    place_m: Array = PLACE_M,
    goal_m: Array = GOAL_M,
) -> Memory:
    """A tick of vehicles (n, 3) to goals; `deviation_m` is that of the last."""
    zero, n = np.zeros(len(place_m)), len(place_m)
    ids = tuple(f"d{row}" for row in range(n))
    fleet = FleetState(DT_S * index, ids, place_m, np.zeros((n, 3)), zero, zero.copy())
    tasks = replace(Tasks.of_formation(n, center_moves=False), goal_m=goal_m)
    tasks.task[:] = Task.GOAL
    traits = replace(Traits.alike(n), uncertainty_m=np.append(np.full(n - 1, 0.05), deviation_m))
    settings = ControlSettings(safety=safety)
    return tick(fleet, tasks, Plan(Formation(10.0, 25.0)), traits, memory, settings).memory


def corners_m(ways: AreaWays | None) -> Array:
    return np.full((len(PLACE_M), 2), np.nan) if ways is None else ways.corner_m


def test_a_receiver_that_degrades_makes_no_graph_in_a_tick() -> None:
    warm_up()
    safety = site()
    with graphs_made() as before:
        prepare(safety)
    memory = Memory.fresh(len(PLACE_M), 0.0)
    with graphs_made() as made:
        for index, deviation_m in enumerate(np.arange(0.3, 2.01, 0.05).tolist(), 1):
            memory = ways_of(safety, memory, index, deviation_m)
            assert np.isfinite(corners_m(memory.ways)[:, 0]).tolist() == HIDDEN, deviation_m
    assert before
    assert made == []


def test_what_is_far_beyond_all_graphs_takes_the_widest() -> None:
    warm_up()
    safety = site()
    prepare(safety)
    for deviation_m in (9.0, 1e6, np.inf):
        with graphs_made() as made:
            ways_of(safety, Memory.fresh(len(PLACE_M), 0.0), 1, deviation_m)
        assert made == []
    ways = prepared_ways(safety)
    assert ways is not None
    far_m = np.array([[0.0, 0.0, 9.0], [0.0, 0.0, -1e9], [0.0, 0.0, -20.0]])
    for one_m, other_m in zip(far_m, far_m[::-1].copy(), strict=True):
        band = band_of(one_m, other_m, ways.step_m, ways.walls.at.shape[1] - 1)
        assert [ways.graph(band, kept_m)[1] for kept_m in (0.1, 1.25, 1.3, 99.0)] == [0.35, 1.25, 2.0, 3.0]


CLEAR_M = np.array([[60.0, -60.0, -20.0], [-100.0, 60.0, -20.0], [0.0, 100.0, -20.0], [100.0, 100.0, -20.0]])
BEFORE_M = np.array([[90.0, -20.0, -20.0], [-60.0, 100.0, -20.0], [60.0, 80.0, -20.0], [100.0, 100.0, -20.0]])
"""Goals that are seen, a little nearer to walls than the places."""


@pytest.mark.parametrize("deviation_m", [9.0, 1e6, np.inf, np.nan])
def test_a_receiver_without_a_fix_leads_no_other_astray(deviation_m: float) -> None:
    warm_up()
    safety = site()
    prepare(safety)
    memory = ways_of(safety, Memory.fresh(4, 0.0), 1, deviation_m, CLEAR_M, BEFORE_M)
    assert np.isnan(corners_m(memory.ways)).all()
    memory = ways_of(safety, Memory.fresh(4, 0.0), 1, deviation_m)
    assert np.isfinite(corners_m(memory.ways)[:, 0]).tolist() == HIDDEN


def test_a_site_that_was_not_prepared_is_flown_straight() -> None:
    safety = site(outer_m=301.0)
    with graphs_made() as made:
        memory = ways_of(safety, Memory.fresh(len(PLACE_M), 0.0), 1, 0.05)
    assert made == []
    assert memory.ways is None


def test_a_show_with_less_height_has_the_graphs_of_its_site() -> None:
    safety = site()
    prepare(safety)
    lower = safety.model_copy(update={"fence": safety.fence.model_copy(update={"height_max_m": 60.0})})
    with graphs_made() as made:
        prepare(lower)
    assert made == []
    assert prepared_ways(lower) is prepared_ways(safety)


@pytest.mark.long
def test_graphs_are_bounded_for_the_greatest_site() -> None:
    places_m = [(45.0 * (at % 6) - 110.0, 45.0 * (at // 6) - 80.0) for at in range(22)]
    closed = tuple(
        FencedArea(corners_m=star(14, 5.0, 12.0, at_m), inside=False, height_max_m=5.0 + 13.0 * row)
        for row, at_m in enumerate(places_m)
    )
    ground = FencedArea(corners_m=star(64, 250.0, 350.0))
    safety = SafetySettings(fence=Fence(height_max_m=400.0, areas=closed, controlled_ground=ground))
    prepare(safety)
    ways = prepared_ways(safety)
    assert ways is not None
    heights = ways.walls.at.shape[1]
    assert heights * (heights - 1) // 2 <= BANDS_MAX
    assert len(ways.graphs) <= GRAPHS_MAX
    assert max(len(graph.point_m) for graph in ways.graphs) <= POINTS_MAX
