"""Routes to goals past the paths of lost vehicles: clear of them, over them, and past vehicles that stand."""

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest

from gcs.control import ControlSettings, Memory, Task, Tasks, tick
from gcs.control.goal_routes import ROUTE_SPARE_M, follow_routes
from gcs.control.inputs import TickInputs
from gcs.control.memory import GoalRoutes
from gcs.control.path_search import find_corners, lines_apart_m
from gcs.control.routes_among_boxes import boxes_of, way_among
from gcs.model.plan import Formation, Obstacle, Plan
from gcs.model.state import Array, FleetState, Traits

SETTINGS = ControlSettings()
FLOOR = SETTINGS.safety.floor
KEPT_M = FLOOR.kept_m(FLOOR.worst_reserve_m())[0]
TOP_M, DT_S = 30.0, 0.05


def column(x_m: float, y_m: float, top_m: float = TOP_M) -> list[list[float]]:
    """Where a vehicle stays that was lost at `top_m`, and comes down."""
    return [[x_m, y_m, -top_m], [x_m, y_m, 0.0]]


CAGE = np.array([column(x_m, y_m) for x_m in (-8.0, -4.0, 0.0, 4.0) for y_m in (-6.0, 6.0)])
CAGE = np.concatenate([CAGE, [column(6.0, y_m) for y_m in (-4.0, 0.0, 4.0)]])
"""A U of columns about the origin, its bottom at x = 6 m."""


def flown(
    place_m: Array,
    goal_m: Array,
    lost_m: Array,
    seconds: float,
    task: Task = Task.GOAL,
    walls: tuple[Obstacle, ...] = (),
) -> tuple[Array, Array]:
    """(ticks, n, 3) positions of vehicles that fly as commanded, and the first one's distance (ticks,)."""
    n, settings = len(place_m), SETTINGS
    memory, traits, plan = Memory.fresh(n, 0.0), Traits.alike(n), Plan(Formation(10.0, 20.0), obstacles=walls)
    none = np.zeros(n, dtype=bool)
    tasks = Tasks(np.full(n, task, dtype=np.int8), goal_m, ~none, none, lost_m)
    velocity_m_s, path_m, least_m = np.zeros((n, 3)), [], []
    ids = tuple(f"d{k}" for k in range(n))
    for k in range(1, int(seconds / DT_S)):
        fleet = FleetState(k * DT_S, ids, place_m.copy(), velocity_m_s.copy(), np.zeros(n), np.zeros(n))
        memory = tick(fleet, tasks, plan, traits, memory, settings).memory
        velocity_m_s = np.array(memory.desired_m_s)
        place_m = place_m + DT_S * velocity_m_s
        path_m.append(place_m)
        scaled_m = place_m[0] * FLOOR.scale, np.ascontiguousarray(lost_m * FLOOR.scale)
        least_m.append(min(lines_apart_m(scaled_m[0], scaled_m[0], one[0], one[1]) for one in scaled_m[1]))
    return np.array(path_m), np.array(least_m)


def inputs(place_m: Array, goal_m: Array, lost_m: Array, walls: tuple[Obstacle, ...] = ()) -> TickInputs:
    """Of one vehicle at rest."""
    none, plan = np.zeros(1, dtype=bool), Plan(Formation(10.0, 20.0), obstacles=walls)
    tasks = Tasks(np.full(1, Task.GOAL, dtype=np.int8), goal_m, ~none, none, lost_m)
    fleet = FleetState(20.0, ("a",), place_m, np.zeros((1, 3)), np.zeros(1), np.zeros(1))
    return TickInputs.of(fleet, tasks, plan, Traits.alike(1), SETTINGS, before_s=19.9, own=1)


def test_distance_of_two_lines_is_that_of_their_nearest_points() -> None:
    random, shares = np.random.default_rng(1), np.linspace(0.0, 1.0, 201)[:, None]
    for case in range(60):
        a_m, b_m, c_m, d_m = random.uniform(-5.0, 5.0, (4, 3))
        b_m = a_m if case % 5 == 0 else b_m  # a place
        d_m = c_m + 0.5 * (b_m - a_m) if case % 7 == 0 else d_m  # parallel
        one_m, other_m = a_m + shares * (b_m - a_m), c_m + shares * (d_m - c_m)
        sampled_m = np.linalg.norm(one_m[:, None] - other_m[None], axis=2).min()
        assert 0.0 <= sampled_m - lines_apart_m(a_m, b_m, c_m, d_m) < 0.06


def test_route_is_clear_of_all_closed_paths() -> None:
    start_m, goal_m = np.array([0.0, 0.0, -10.0]), np.array([20.0, 0.0, -10.0])
    kept_m = np.full(len(CAGE), KEPT_M)
    low_m, high_m = np.array([-25.0, -25.0, -50.0]), np.array([35.0, 25.0, -3.0])
    corner_m, reaches = find_corners(start_m, goal_m, CAGE, kept_m, low_m, high_m, 1.0, 1.5, 100.0)
    assert reaches
    assert (corner_m[-1] == goal_m).all()
    way_m = np.vstack([start_m, corner_m])
    for one_m, next_m in pairwise(way_m):
        away_m = min(lines_apart_m(one_m, next_m, path_m[0], path_m[1]) for path_m in CAGE)
        assert away_m > KEPT_M - 0.2


def test_vehicle_leaves_a_u_of_columns_and_arrives() -> None:
    goal_m = np.array([[20.0, 0.0, -10.0]])
    path_m, least_m = flown(np.array([[0.0, 0.0, -10.0]]), goal_m, CAGE, 60.0)
    assert np.linalg.norm(path_m[-1] - goal_m) < 0.5
    assert least_m.min() > min(least_m[0], KEPT_M) - 0.3


def test_way_round_a_wall_and_lost_vehicles_beside_it() -> None:
    """The way round the wall led to the lost ones, and the route past these back to the wall, for ever."""
    wall = Obstacle("wall", 20.0, 0.0, 1.0, 12.0, 60.0)
    beside = np.array([column(20.0, y_m) for y_m in np.arange(16.0, 46.0, 4.0)])
    goal_m = np.array([[45.0, 3.0, -10.0]])
    path_m, least_m = flown(np.array([[0.0, 3.0, -10.0]]), goal_m, beside, 60.0, walls=(wall,))
    assert np.linalg.norm(path_m[-1] - goal_m) < 0.5
    assert path_m[:, 0, 1].min() < -12.0, "past the open end of the wall"
    assert least_m.min() > KEPT_M - 0.3


def test_a_gap_beside_a_lost_vehicle_in_a_door_is_found() -> None:
    """It was seen from some places only: a vehicle went to and fro between the door and the back wall."""
    across = [Obstacle(f"{y_m}", 0.0, y_m, 23.4, 1.97, 44.0) for y_m in (-23.4, 23.4)]
    front = [Obstacle(f"front {y_m}", 23.4, y_m, 1.97, 5.985, 44.0) for y_m in (-17.415, 17.415)]
    walls = (Obstacle("back", -23.4, 0.0, 1.97, 23.4, 44.0), *across, *front)
    goal_m = np.array([-79.0, 7.3, -7.0])
    lost_m = np.array([column(25.6, -0.7, top_m=4.8), column(25.9, -1.2, top_m=9.9)])
    kept_m = FLOOR.horizontal_m + FLOOR.reserve_m(np.full(2, 0.05), 0.05)
    now = inputs(np.zeros((1, 3)), goal_m[None], lost_m, walls)
    for x_m, y_m in product(np.arange(-14.0, 15.0, 2.0), (-1.5, 0.3, 1.1)):
        start_m = np.array([x_m, y_m, -7.0])
        scaled = start_m * FLOOR.scale, goal_m * FLOOR.scale, boxes_of(now), lost_m * FLOOR.scale
        corner_m = way_among(*scaled, kept_m)
        assert corner_m is not None, start_m
        assert corner_m[:, 0].max() > 25.0, "through the door"
        way_m = np.vstack([scaled[0], corner_m])
        for one_m, next_m in pairwise(way_m):
            away_m = min(lines_apart_m(one_m, next_m, path_m[0], path_m[1]) for path_m in scaled[3])
            assert away_m > kept_m[0] - 0.2


def test_a_box_far_outside_the_fence_does_not_end_a_tick() -> None:
    """The search had room for all cells as far as the box: no memory was left, and the tick failed."""
    wall, far = Obstacle("w", 20.0, 0.0, 1.0, 12.0, 60.0), Obstacle("f", 1e6, -1e6, 1.0, 12.0, 60.0)
    here_m, goal_m = np.array([[0.0, 3.0, -10.0]]), np.array([[45.0, 3.0, -10.0]])
    beside = np.array([column(20.0, y_m) for y_m in np.arange(16.0, 46.0, 4.0)])
    path_m, _ = flown(here_m, goal_m, beside, 2.0, walls=(wall, far))
    assert path_m == pytest.approx(flown(here_m, goal_m, beside, 2.0, walls=(wall,))[0])


@pytest.mark.soak
@pytest.mark.long
def test_vehicle_climbs_out_of_a_ring_of_columns() -> None:
    ring = np.array([column(9.0 * np.cos(turn), 9.0 * np.sin(turn)) for turn in np.arange(0.0, 6.28, 0.4)])
    goal_m = np.array([[30.0, 0.0, -10.0]])
    path_m, least_m = flown(np.array([[0.0, 0.0, -10.0]]), goal_m, ring, 90.0)
    assert np.linalg.norm(path_m[-1] - goal_m) < 0.5
    assert -path_m[:, 0, 2].min() > TOP_M, "over the columns"
    assert least_m.min() > KEPT_M - 0.3


@pytest.mark.parametrize(("goal_y_m", "narrows"), [(12.0, True), (-12.0, False)], ids=["on", "back"])
def test_route_that_narrows_inside_a_margin_is_a_passage(goal_y_m: float, narrows: bool) -> None:
    """The filter held a vehicle before a gate for ever: its route led nearer to both columns."""
    beside_m = FLOOR.kept_m(0.0)[0] - 0.2
    lost_m = np.array([column(-beside_m, 0.0), column(beside_m, 0.0), column(0.0, goal_y_m / 2.0)])
    place_m, goal_m = np.array([[0.0, -0.3, -5.0]]), np.array([[0.0, goal_y_m, -5.0]])
    now = inputs(place_m, goal_m, lost_m)
    _, _, routes = follow_routes(now, None, np.empty((0, 3)))
    assert routes is not None
    assert np.isfinite(routes.corner_m[0, 0]).all()
    assert not routes.no_way.any()
    assert routes.passage.tolist() == [narrows]


@pytest.mark.soak
def test_vehicle_in_formation_leaves_a_passage_of_columns() -> None:
    """Walls have closed on both sides, nearer than the distance to be kept; its slot lies beyond one."""
    beside_m, along_m = KEPT_M - 0.1, np.arange(-8.0, 9.0, 2.0)
    walls = [column(22.0 + side * beside_m, y_m) for side in (-1.0, 1.0) for y_m in along_m]
    place_m = np.array([[22.0, 0.5, -20.0], [-9.0, 0.0, -20.0], [0.0, 9.0, -20.0], [0.0, -9.0, -20.0]])
    path_m, least_m = flown(place_m, np.full((4, 3), np.nan), np.array(walls), 60.0, Task.FORMATION)
    assert np.linalg.norm(path_m[-1, 0] - [0.0, 0.0, -20.0]) < 14.0, "at the sphere of the others"
    assert least_m.min() > KEPT_M - FLOOR.margin_m - 0.1, "gives up the margin, not the floor and the reserve"


def test_stalled_vehicle_searches_past_one_that_stands() -> None:
    """Two vehicles; the first has swung within 5 m of its place for longer than it may."""
    place_m = np.array([[0.0, 0.0, -10.0], [8.0, 0.0, -10.0]])
    goal_m = np.array([[16.0, 0.0, -10.0], [8.0, 0.0, -10.0]])
    none, lost_m = np.zeros(2, dtype=bool), np.array([column(8.0, 40.0)])
    tasks = Tasks(np.full(2, Task.GOAL, dtype=np.int8), goal_m, ~none, none, lost_m)
    fleet = FleetState(20.0, ("a", "b"), place_m, np.zeros((2, 3)), np.zeros(2), np.zeros(2))
    now = TickInputs.of(
        fleet, tasks, Plan(Formation(10.0, 20.0)), Traits.alike(2), SETTINGS, before_s=19.9, own=2
    )
    begun = GoalRoutes.none(2)
    calm = replace(begun, goal_m=goal_m.copy(), place_m=place_m.copy(), since_s=np.full(2, 19.0))
    slot_m = np.empty((0, 3))
    aim_m, rows, routes = follow_routes(now, calm, slot_m)
    assert routes is not None
    assert not routes.wary.any()
    assert (aim_m == goal_m).all()
    assert rows.tolist() == [0, 1]
    stalled = replace(calm, place_m=place_m - [5.0, 0.0, 0.0], since_s=np.full(2, 3.0))
    _, _, routes = follow_routes(now, stalled, slot_m)
    assert routes is not None
    assert routes.wary.tolist() == [True, False], "the second is at its goal"
    corner_m = routes.corner_m[0][np.isfinite(routes.corner_m[0, :, 0])]
    assert (corner_m[-1] == goal_m[0]).all()
    away_m = np.linalg.norm((corner_m - place_m[1]) * FLOOR.scale, axis=1)
    assert away_m.min() > KEPT_M + ROUTE_SPARE_M - 0.3


def test_a_route_waits_for_a_clear_slot_and_follows_its_moves() -> None:
    """A vehicle in formation that has stood behind a column for longer than it may."""
    place_m, lost_m = np.array([[0.0, 0.0, -20.0]]), np.array([column(10.0, 0.0)])
    none = np.zeros(1, dtype=bool)
    tasks = Tasks(np.full(1, Task.FORMATION, np.int8), np.full((1, 3), np.nan), ~none, none, lost_m)
    fleet = FleetState(20.0, ("a",), place_m, np.zeros((1, 3)), np.zeros(1), np.zeros(1))
    now = TickInputs.of(
        fleet, tasks, Plan(Formation(10.0, 20.0)), Traits.alike(1), SETTINGS, before_s=19.9, own=1
    )
    stands = replace(GoalRoutes.none(1), place_m=place_m.copy(), since_s=np.full(1, 3.0))
    _, _, routes = follow_routes(now, stands, np.array([[11.0, 0.0, -20.0]]))  # in the column's space
    assert routes is not None
    assert routes.next_s[0] == -np.inf, "not searched in vain"
    _, _, routes = follow_routes(now, routes, np.array([[20.0, 0.0, -20.0]]))
    assert routes is not None
    assert routes.next_s[0] > 20.0
    assert np.isfinite(routes.corner_m[0, 0]).all()
    again_s = replace(routes, next_s=np.full(1, 35.0))  # as after a search that found none
    _, _, routes = follow_routes(now, again_s, np.array([[20.0, 4.0, -20.0]]))
    assert routes is not None
    assert routes.next_s[0] < 35.0
