"""Distinct places to come down on."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.control import ControlSettings, ellipses_of, ellipses_until
from gcs.control.inputs import STEPS_MOST
from gcs.formation.obstacles import AvoidanceSettings, Ellipse
from gcs.model.plan import MAX_OBSTACLES, Formation, Obstacle, Plan
from gcs.model.state import Array, Mask
from gcs.planning.landing_sites import (
    CLEAR_M,
    LANDS_WITHIN_S,
    distinct_sites_m,
    open_places_m,
)

NO_ROW = np.zeros((0, 2))
PLAN = Plan(Formation(10.0, 20.0))
BOX = Ellipse.around(Obstacle("b", 0.0, 0.0, 3.0, 6.0, 10.0), margin_m=2.0, headroom_m=3.0)


def closest_m(place_m: Array, taken_m: Array = NO_ROW) -> float:
    all_places = np.vstack([place_m, taken_m])
    distance = np.linalg.norm(place_m[:, None] - all_places[None], axis=2)
    distance[np.arange(len(place_m)), np.arange(len(place_m))] = np.inf
    return float(distance.min())


def test_sites_that_are_apart_are_kept() -> None:
    desired = np.array([[0.0, 0.0], [5.0, 0.0], [0.0, 9.0]])
    assert distinct_sites_m(desired, NO_ROW, 4.0, {}) == pytest.approx(desired, abs=1e-5)


def test_pair_too_close_parts_evenly() -> None:
    place = distinct_sites_m(np.array([[-1.0, 0.0], [1.0, 0.0]]), NO_ROW, 4.0, {})
    assert place == pytest.approx(np.array([[-2.0, 0.0], [2.0, 0.0]]), abs=0.05)


def test_fleet_over_one_point_lands_apart() -> None:
    place = distinct_sites_m(np.zeros((12, 2)), NO_ROW, 4.0, {})
    assert closest_m(place) >= 4.0 - 1e-9
    assert np.linalg.norm(place, axis=1).max() < 10.0


def test_occupied_sites_stay_and_are_respected() -> None:
    taken = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [4.0, 4.0]])
    place = distinct_sites_m(np.array([[1.0, 1.0], [2.0, 3.0]]), taken, 4.0, {})
    assert closest_m(place, taken) >= 4.0 - 1e-9


@pytest.mark.parametrize(
    "taken",
    [
        [[2.0, 0.0], [-2.0, 0.0]],  # exactly between two
        [[2.0, 2.0], [2.0, -2.0], [-2.0, 2.0], [-2.0, -2.0]],  # in the middle of four pads
        [[4.0 * i, 4.0 * j] for i in range(-3, 4) for j in range(-3, 4)],  # on a full grid of pads
    ],
)
def test_enclosed_vehicle_finds_the_nearest_free_site(taken: list[list[float]]) -> None:
    others = np.array(taken)
    place = distinct_sites_m(np.zeros((1, 2)), others, 4.0, {})
    assert closest_m(place, others) >= 4.0 - 1e-9
    assert np.linalg.norm(place) < 18.0


def test_no_vehicle_lands_on_or_beside_an_obstacle() -> None:
    desired = np.array([[0.0, 0.0], [1.0, 7.0], [-6.0, 0.0], [0.5, 0.0]])
    place = distinct_sites_m(desired, NO_ROW, 4.0, {"b": BOX})
    assert (BOX.distance_m(place) >= CLEAR_M).all()
    assert closest_m(place) >= 4.0 - 1e-9


def test_the_clearance_is_where_the_law_no_longer_pushes() -> None:
    assert AvoidanceSettings().near_m == CLEAR_M


def test_pocket_between_obstacles_and_sites_is_left() -> None:
    ellipses = {
        name: Ellipse.around(Obstacle(name, x, 0.0, 3.0, 30.0, 9.0), margin_m=2.0, headroom_m=3.0)
        for name, x in (("west", -6.0), ("east", 6.0))
    }
    place = distinct_sites_m(np.zeros((2, 2)), np.array([[0.0, 3.0]]), 4.0, ellipses)
    assert all((ellipse.distance_m(place) >= CLEAR_M).all() for ellipse in ellipses.values())
    assert closest_m(place, np.array([[0.0, 3.0]])) >= 4.0 - 1e-9


def test_unknown_position_stays_unknown_and_disturbs_no_other() -> None:
    desired = np.array([[np.nan, 0.0], [1.0, 1.0], [1.0, 1.5]])
    place = distinct_sites_m(desired, NO_ROW, 4.0, {})
    assert np.isnan(place[0]).all()
    assert closest_m(place[1:]) >= 4.0 - 1e-9


@pytest.mark.parametrize("half_m", [1.0, 3.0, 10.0])
def test_large_fleet_among_most_obstacles_finds_its_sites(half_m: float) -> None:
    random = np.random.default_rng(0)
    boxes = [
        Obstacle(str(index), x_m, y_m, half_m, half_m, 10.0)
        for index, (x_m, y_m) in enumerate(random.uniform(-60.0, 60.0, (MAX_OBSTACLES, 2)).tolist())
    ]
    ellipses = {box.id: Ellipse.around(box, margin_m=2.0, headroom_m=3.0) for box in boxes}
    desired, taken = random.normal(size=(50, 2)) * 8.0, random.uniform(-30.0, 30.0, (50, 2))
    place = distinct_sites_m(desired, taken, 4.0, ellipses)
    assert closest_m(place, taken) >= 4.0 - 1e-9
    assert all((ellipse.distance_m(place) >= CLEAR_M - 1e-9).all() for ellipse in ellipses.values())


def test_site_inside_a_wide_obstacle_is_moved_beside_it() -> None:
    wide = Ellipse.around(Obstacle("w", 0.0, 0.0, 150.0, 150.0, 10.0), margin_m=2.0, headroom_m=3.0)
    place = distinct_sites_m(np.zeros((3, 2)), NO_ROW, 4.0, {"w": wide})
    assert (wide.distance_m(place) >= CLEAR_M).all()
    assert closest_m(place) >= 4.0 - 1e-9
    assert np.linalg.norm(place, axis=1).max() < 1.3 * 215.0


def test_no_vehicle_needs_no_site() -> None:
    assert distinct_sites_m(NO_ROW, NO_ROW, 4.0, {}).shape == (0, 2)


def test_a_closed_pad_is_left_for_the_nearest_open_place() -> None:
    pad_m = np.array([[0.0, 0.0, 0.5], [4.0, 0.0, 0.0], [30.0, 0.0, 0.0]])
    closed = np.array([True, False, False])
    taken_m = np.array([[0.0, 5.0]])

    def are_open(place_m: Array) -> Mask:
        return np.asarray(np.hypot(place_m[:, 0], place_m[:, 1]) > 3.0)

    place_m = open_places_m(pad_m, closed, taken_m, 4.0, {}, are_open)
    assert (place_m[1:] == pad_m[1:]).all()
    assert place_m[0, 2] == 0.5
    assert 3.0 < np.hypot(*place_m[0, :2]) < 4.5
    assert np.hypot(*(pad_m[1:, :2] - place_m[0, :2]).T).min() >= 4.0
    assert np.hypot(*(taken_m - place_m[0, :2]).T).min() >= 4.0


def test_two_closed_pads_get_places_apart() -> None:
    pad_m = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])

    def are_open(place_m: Array) -> Mask:
        return np.asarray(place_m[:, 0] > 5.0)

    place_m = open_places_m(pad_m, np.ones(2, dtype=bool), np.zeros((0, 2)), 4.0, {}, are_open)
    assert np.hypot(*(place_m[0] - place_m[1])[:2]) >= 4.0
    assert (place_m[:, 0] > 5.0).all()
    nowhere_m = open_places_m(
        pad_m, np.ones(2, dtype=bool), np.zeros((0, 2)), 4.0, {}, lambda place_m: place_m[:, 0] > 1e6
    )
    assert (nowhere_m == pad_m).all()


def test_no_box_comes_to_a_site_while_vehicles_come_down() -> None:
    """A slow box beside the vehicles, that would pass over where they are."""
    box = Obstacle("crane", 0.0, -20.0, 4.0, 4.0, 60.0, velocity_y_m_s=0.6)
    plan, settings = replace(PLAN, obstacles=(box,)), ControlSettings()
    desired_m = np.array([[-2.0, 0.0], [3.0, 1.0], [1.0, 5.0]])
    now = ellipses_of(plan, settings, 0.0)
    assert distinct_sites_m(desired_m, NO_ROW, 4.0, now) == pytest.approx(desired_m, abs=1e-3)
    ahead = ellipses_until(plan, settings, 0.0, LANDS_WITHIN_S)
    sites_m = distinct_sites_m(desired_m, NO_ROW, 4.0, ahead)
    for at_s in np.arange(0.0, LANDS_WITHIN_S, 1.0):
        (passing,) = ellipses_of(plan, settings, float(at_s)).values()
        assert passing.distance_m(sites_m).min() > CLEAR_M - 0.3
    assert np.linalg.norm(sites_m - desired_m, axis=1).max() < 15.0


def test_ways_of_many_boxes_stay_bounded() -> None:
    boxes = tuple(Obstacle(f"b{k}", 9.0 * k, 0.0, 1.0, 1.0, 9.0, 0.0, 20.0) for k in range(MAX_OBSTACLES))
    ahead = ellipses_until(replace(PLAN, obstacles=boxes), ControlSettings(), 0.0, LANDS_WITHIN_S)
    assert len(ahead) <= 2 * MAX_OBSTACLES + STEPS_MOST


@pytest.mark.parametrize("count", [8, 12, 32])
def test_no_site_is_on_the_way_of_one_of_many_boxes(count: int) -> None:
    """With eight boxes places were looked at 11 m apart, and boxes are 4 m wide."""
    random, settings = np.random.default_rng(count), ControlSettings()
    places_m, goes_m_s = random.uniform(-80.0, 80.0, (2, count)), random.uniform(-2.0, 2.0, (2, count))
    boxes = tuple(
        Obstacle(f"b{k}", x_m, y_m, 1.0, 1.0, 60.0, x_m_s, y_m_s)
        for k, (x_m, y_m, x_m_s, y_m_s) in enumerate(np.vstack([places_m, goes_m_s]).T.tolist())
    )
    plan, desired_m = replace(PLAN, obstacles=boxes), random.uniform(-25.0, 25.0, (20, 2))
    ahead = ellipses_until(plan, settings, 0.0, LANDS_WITHIN_S)
    sites_m = distinct_sites_m(desired_m, NO_ROW, 4.0, ahead)
    for at_s in np.arange(0.0, LANDS_WITHIN_S, 0.5).tolist():
        for passing in ellipses_of(plan, settings, at_s).values():
            assert passing.distance_m(sites_m).min() > CLEAR_M - 0.3
