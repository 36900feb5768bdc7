"""Routes of the formation's centre past standing and moving boxes."""

from itertools import pairwise

import numpy as np
import pytest

from gcs.formation.obstacles import Ellipse, Outlines
from gcs.formation.route import (
    MOST_PLACES,
    SPARE_M,
    Boxes,
    Goal,
    Route,
    find_route,
    free_until_s,
    in_the_way,
    leaves_now,
    next_leg,
    timed,
)
from gcs.formation.route_search import CORNERS
from gcs.model.state import Array

SPEED_M_S, REACH_M = 2.0, 300.0
HERE = np.zeros(2)


def box(
    x_m: float, y_m: float, half_x_m: float, half_y_m: float, vx: float = 0.0, vy: float = 0.0
) -> Ellipse:
    """An outline whose box, grown, has these half-lengths."""
    root = float(np.sqrt(2.0))
    return Ellipse(x_m, y_m, root * half_x_m, root * half_y_m, 60.0, vx, vy)


def scene(*ellipses: Ellipse, here_m: Array = HERE) -> Boxes:
    outlines = Outlines.of({f"b{k}": each for k, each in enumerate(ellipses)})
    return Boxes.grown(outlines, np.zeros(len(outlines)), here_m)


def goal(x_m: float, y_m: float) -> Goal:
    return Goal(np.array([x_m, y_m]), np.zeros(2))


def routed(boxes: Boxes, to: Goal, *, reach_m: float = REACH_M, here_m: Array = HERE) -> Route:
    return find_route(boxes, here_m, to, SPEED_M_S, reach_m)


U = (box(30.0, 0.0, 5.0, 40.0), box(0.0, 35.0, 35.0, 5.0), box(0.0, -35.0, 35.0, 5.0))
RING = (*U, box(-30.0, 0.0, 5.0, 40.0))


def test_without_boxes_the_way_is_straight() -> None:
    route = routed(scene(), goal(100.0, 0.0))
    assert (route.reaches, route.corners, route.arrival_s) == (True, (), (50.0,))
    assert leaves_now(scene(), HERE, goal(100.0, 0.0), SPEED_M_S)


def test_out_of_a_u_of_overlapping_boxes_it_leads_round_an_arm() -> None:
    route = routed(scene(*U), goal(60.0, 3.0))
    assert route.reaches
    assert list(dict.fromkeys(corner // CORNERS for corner in route.corners)) == [1, 0]  # arm, bottom
    length_m = SPEED_M_S * route.arrival_s[-1]
    assert length_m < 180.0


def test_out_of_a_closed_ring_there_is_none_and_it_names_a_wall() -> None:
    boxes = scene(*RING)
    route = routed(boxes, goal(60.0, 0.0))
    assert not route.reaches
    assert in_the_way(boxes, HERE, goal(60.0, 0.0), SPEED_M_S) == "b0"


def test_goal_inside_a_box_is_approached_as_near_as_a_corner() -> None:
    boxes = scene(box(40.0, 0.0, 5.0, 5.0))
    route = routed(boxes, goal(40.0, 4.0))
    assert not route.reaches
    assert boxes.corner_m(route.corners[-1], 0.0)[1] > 0.0


def test_fence_closes_the_shorter_way() -> None:
    wall = box(40.0, 20.0, 2.0, 45.0)  # from y = -25 to 65
    south = routed(scene(wall), goal(80.0, 20.0))
    assert scene(wall).corner_m(south.corners[0], 0.0)[1] < 0.0
    assert not routed(scene(wall), goal(80.0, 20.0), reach_m=45.0).reaches


def test_moving_box_that_passes_before_is_ignored() -> None:
    crossing = box(40.0, -20.0, 5.0, 5.0, 0.0, 3.0)  # across the way after 5 to 8 s
    assert leaves_now(scene(crossing), HERE, goal(80.0, 0.0), SPEED_M_S)


def test_moving_boxes_that_close_a_gap_are_gone_round() -> None:
    closing = (box(60.0, 50.0, 5.0, 30.0, 0.0, -1.0), box(60.0, -50.0, 5.0, 30.0, 0.0, 1.0))
    route = routed(scene(*closing), goal(120.0, 0.0))
    assert route.reaches
    assert route.corners  # straight, it would meet them closed after 27 s


def test_goal_that_a_box_passes_over_is_reached_after_it() -> None:
    over = scene(box(-40.0, 0.0, 10.0, 20.0, 1.0, 0.0))
    route = routed(over, goal(0.0, 0.0))
    assert route.reaches
    assert route.corners
    assert route.arrival_s[-1] == pytest.approx(51.0, abs=2.0)  # its end passes after 50 s


def test_the_shorter_way_leads_to_a_goal_that_becomes_free() -> None:
    passing, to = scene(box(-34.0, 13.0, 10.0, 15.0, 1.0, 0.0)), goal(10.0, -1.0)
    route = routed(passing, to)
    assert route.reaches
    assert route.arrival_s[-1] == pytest.approx(55.0, abs=1.0)  # its end passes after 54 s
    places_m = [HERE, *map(passing.corner_m, route.corners, route.arrival_s)]
    flown_m = sum(np.hypot(*(after - before)) for before, after in pairwise(places_m))
    assert flown_m + SPEED_M_S * (route.arrival_s[-1] - route.leaves_s) < 40.0  # the other way round: 77 m


def test_boxes_from_both_sides_are_left_sideways() -> None:
    pair = scene(box(-40.0, 0.0, 10.0, 20.0, 1.0, 0.0), box(40.0, 0.0, 10.0, 20.0, -1.0, 0.0))
    route = routed(pair, goal(0.0, 0.0))
    assert route.reaches
    assert abs(pair.corner_m(route.corners[0], route.arrival_s[0])[1]) > 20.0


def test_centre_inside_a_grown_box_gets_out_but_not_deeper() -> None:
    around = (box(12.0, 0.0, 20.0, 30.0),)
    route = routed(scene(*around), goal(60.0, 0.0))
    leg = next_leg(scene(*around), HERE, route.corners, goal(60.0, 0.0), SPEED_M_S, reaches=True)
    assert leg is not None
    assert leg[1][0] <= 1e-6  # the nearest way out is towards -x


def test_known_route_is_timed_anew_or_found_blocked() -> None:
    boxes = scene(*U)
    route = routed(boxes, goal(60.0, 3.0))
    again = timed(boxes, HERE, route.corners, goal(60.0, 3.0), SPEED_M_S)
    assert again is not None
    assert again.arrival_s == pytest.approx(route.arrival_s)
    assert timed(scene(*RING), HERE, route.corners, goal(60.0, 3.0), SPEED_M_S) is None


def test_corners_are_passed_over_once_the_next_is_in_sight() -> None:
    route = routed(scene(*U), goal(60.0, 3.0))
    here_m = np.array([-40.0, 45.0 if scene(*U).corner_m(route.corners[0], 0.0)[1] > 0.0 else -45.0])
    leg = next_leg(scene(*U, here_m=here_m), here_m, route.corners, goal(60.0, 3.0), SPEED_M_S, reaches=True)
    assert leg is not None
    assert leg[0] == route.corners[-1:]


STILL = np.zeros(2)


def test_places_beside_a_box_lie_outside_the_nearest_first() -> None:
    boxes = scene(box(10.0, 0.0, 5.0, 20.0))
    places_m, goes_m_s = boxes.free_places(np.array([8.0, 1.0]), STILL, REACH_M)
    assert places_m[0] == pytest.approx((5.0 - SPARE_M, 1.0))
    away_m = np.hypot(*(places_m - (8.0, 1.0)).T)
    assert (np.diff(away_m) >= 0.0).all()
    assert not boxes.hold(places_m, np.zeros(len(places_m))).any()
    assert not goes_m_s.any()


def test_where_boxes_overlap_no_place_lies_in_the_other() -> None:
    boxes = scene(box(10.0, 0.0, 5.0, 20.0), box(10.0, 0.0, 20.0, 5.0))
    places_m, _ = boxes.free_places(np.array([10.0, 0.0]), STILL, REACH_M)
    assert not boxes.hold(places_m, np.zeros(len(places_m))).any()
    assert np.hypot(*(places_m[0] - (10.0, 0.0))) == pytest.approx(5.0 * np.sqrt(2.0), abs=2.0)


def test_a_place_slides_along_its_side_with_the_target() -> None:
    boxes = scene(box(10.0, 0.0, 5.0, 20.0))
    _, goes_m_s = boxes.free_places(np.array([6.0, 1.0]), np.array([0.3, 1.0]), REACH_M)
    assert goes_m_s[0] == pytest.approx((0.0, 1.0))


def test_a_place_moves_with_a_box_that_carries_the_target() -> None:
    boxes = scene(box(10.0, 0.0, 5.0, 20.0, 0.5, 0.0))
    _, goes_m_s = boxes.free_places(np.array([6.0, 1.0]), np.array([0.5, 0.0]), REACH_M)
    assert goes_m_s[0] == pytest.approx((0.5, 0.0))


def test_no_place_is_beyond_the_reach() -> None:
    places_m, _ = scene(box(10.0, 0.0, 5.0, 20.0)).free_places(np.array([12.0, 0.0]), STILL, 12.0)
    assert len(places_m) > 0
    assert (np.hypot(*places_m.T) <= 12.0).all()


def test_places_are_bounded_in_number_and_may_be_none() -> None:
    many = [box(10.0 * k, 40.0, 4.0, 4.0) for k in range(60)]
    assert len(scene(*many).free_places(np.array([300.0, 40.0]), STILL, 1000.0)[0]) <= MOST_PLACES
    assert len(scene().free_places(HERE, STILL, REACH_M)[0]) == 0


def test_a_place_is_free_until_a_box_comes_over_it() -> None:
    boxes = scene(box(30.0, 0.0, 5.0, 5.0, -1.0, 0.0))
    assert free_until_s(boxes, HERE) == pytest.approx(25.0)
    assert free_until_s(boxes, np.array([0.0, 20.0])) == np.inf
