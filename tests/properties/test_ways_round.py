"""The way round obstacles touches none, is as short as it says, and does not depend on what is far away."""

from itertools import pairwise

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from gcs.formation.ways_round import (
    HORIZON_S,
    climb_over,
    free_s,
    is_pinched,
    passes,
    passes_box,
    way_between,
    way_out,
    way_round,
)
from gcs.model.state import Array

FAR_M = 400.0
BOX = st.tuples(st.floats(-60.0, 60.0), st.floats(-60.0, 60.0), st.floats(2.0, 20.0), st.floats(2.0, 20.0))
PLACE = st.tuples(st.floats(-90.0, 90.0), st.floats(-90.0, 90.0))


def arrays(boxes: list[tuple[float, float, float, float]]) -> tuple[Array, Array]:
    table = np.array(boxes, dtype=np.float64).reshape(-1, 4)
    return table[:, :2].copy(), table[:, 2:].copy()


def outside(place_m: Array, center_m: Array, semi_m: Array) -> bool:
    return bool((((place_m - center_m) / semi_m) ** 2).sum(axis=1).min(initial=np.inf) > 1.0)


def nearest(one_m: Array, other_m: Array, center_m: Array, semi_m: Array) -> float:
    """Of a leg, in radii of the ellipse it comes nearest to."""
    shares = np.linspace(0.0, 1.0, 201)[:, None, None]
    places_m = one_m + shares * (other_m - one_m)
    return float(np.sqrt((((places_m - center_m) / semi_m) ** 2).sum(axis=2)).min(initial=np.inf))


def length_m(start_m: Array, way_m: Array, goal_m: Array) -> float:
    places_m = np.vstack([start_m, way_m, goal_m])
    return float(np.linalg.norm(np.diff(places_m, axis=0), axis=1).sum())


@given(st.lists(BOX, max_size=8), PLACE, PLACE)
def test_way_touches_no_obstacle(
    boxes: list[tuple[float, float, float, float]], start: tuple[float, float], goal: tuple[float, float]
) -> None:
    center_m, semi_m = arrays(boxes)
    start_m, goal_m = np.array(start), np.array(goal)
    assume(outside(start_m, center_m, semi_m) and outside(goal_m, center_m, semi_m))
    way_m, is_way = way_round(start_m, goal_m, center_m, semi_m, FAR_M)
    assume(is_way)
    places_m = [start_m, *way_m, goal_m]
    for one_m, other_m in pairwise(places_m):
        assert nearest(one_m, other_m, center_m, semi_m) > 0.999
    assert length_m(start_m, way_m, goal_m) >= float(np.linalg.norm(goal_m - start_m)) - 1e-9
    if all(passes(start_m, goal_m, *each) for each in zip(center_m, semi_m, strict=True)):
        assert len(way_m) == 0, "a straight way has no corner"


@given(st.lists(BOX, min_size=1, max_size=6), st.lists(BOX, max_size=4), PLACE, PLACE)
def test_what_the_way_does_not_meet_makes_it_no_longer(
    boxes: list[tuple[float, float, float, float]],
    more: list[tuple[float, float, float, float]],
    start: tuple[float, float],
    goal: tuple[float, float],
) -> None:
    center_m, semi_m = arrays(boxes)
    start_m, goal_m = np.array(start), np.array(goal)
    way_m, is_way = way_round(start_m, goal_m, center_m, semi_m, FAR_M)
    assume(is_way and outside(start_m, center_m, semi_m) and outside(goal_m, center_m, semi_m))
    places_m = [start_m, *way_m, goal_m]
    clear = [
        each
        for each in more
        if all(nearest(one_m, other_m, *arrays([each])) > 1.2 for one_m, other_m in pairwise(places_m))
    ]
    again_m, is_still = way_round(start_m, goal_m, *arrays([*boxes, *clear]), FAR_M)
    assert is_still
    assert length_m(start_m, again_m, goal_m) <= length_m(start_m, way_m, goal_m) + 1e-6


def test_way_out_of_a_pocket_leads_round_its_end() -> None:
    center_m = np.array([[0.0, 0.0], [20.0, 15.0], [20.0, -15.0]])
    semi_m = np.array([[3.0, 20.0], [22.0, 3.0], [22.0, 3.0]])
    way_m, is_way = way_round(np.array([15.0, 1.0]), np.array([-30.0, 0.0]), center_m, semi_m, FAR_M)
    assert is_way
    assert way_m[:, 0].max() > 40.0
    assert (way_m[:, 1] > 0.0).all(), "round the nearer arm"


@given(st.floats(-8.0, 8.0), st.floats(-12.0, 2.0))
def test_way_out_of_a_u_that_is_open(x_m: float, y_m: float) -> None:
    """Corners about its back lie within its arms: no way was seen, and a vehicle stayed there for ever."""
    center_m = np.array([[0.0, -20.5], [23.4, -3.6], [-23.4, -3.6]])
    semi_m = np.array([[39.9, 10.3], [10.3, 27.2], [10.3, 27.2]])
    start_m, goal_m = np.array([x_m, y_m]), np.array([-11.4, -57.4])
    way_m, is_way = way_round(start_m, goal_m, center_m, semi_m, FAR_M)
    assert is_way
    for one_m, other_m in pairwise([*way_m, goal_m]):
        assert nearest(one_m, other_m, center_m, semi_m) > 0.999


def test_closed_ring_has_no_way() -> None:
    center_m = np.array([[20.0, 0.0], [-20.0, 0.0], [0.0, 20.0], [0.0, -20.0]])
    semi_m = np.array([[3.0, 30.0], [3.0, 30.0], [30.0, 3.0], [30.0, 3.0]])
    _, is_way = way_round(np.zeros(2), np.array([60.0, 0.0]), center_m, semi_m, FAR_M)
    assert not is_way


def test_start_inside_a_margin_is_led_out() -> None:
    center_m, semi_m = np.zeros((1, 2)), np.array([[5.0, 20.0]])
    way_m, is_way = way_round(np.array([4.5, 1.0]), np.array([-30.0, 0.0]), center_m, semi_m, FAR_M)
    assert is_way
    assert passes(np.array([4.5, 1.0]), way_m[0], center_m[0], semi_m[0])


MOVES = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
MOVING = st.lists(st.tuples(BOX, MOVES), min_size=1, max_size=6)


def clear(
    start_m: Array, end_m: Array, speed_m_s: float, boxes: tuple[Array, Array, Array], until_s: float
) -> bool:
    """Whether a vehicle that flies there and stays is outside of all boxes at many moments until then."""
    time_s = np.linspace(0.0, until_s, 400)[:, None]
    lasts_s = max(float(np.linalg.norm(end_m - start_m)) / speed_m_s, 1e-9)
    place_m = start_m + np.minimum(time_s / lasts_s, 1.0) * (end_m - start_m)
    off_m = np.abs(place_m[:, None] - boxes[0] - time_s[:, None] * boxes[1]) - boxes[2]
    return bool((off_m.max(axis=2) > -1e-6).all())


@given(MOVING, PLACE, PLACE, st.floats(1.0, 8.0))
def test_way_is_free_of_moving_boxes_until_it_says(
    drawn: list[tuple[tuple[float, float, float, float], tuple[float, float]]],
    start: tuple[float, float],
    end: tuple[float, float],
    speed_m_s: float,
) -> None:
    place_m, half_m = arrays([box for box, _ in drawn])
    boxes = place_m, np.array([moves for _, moves in drawn]), half_m
    start_m, end_m = np.array(start), np.array(end)
    assume((np.abs(start_m - boxes[0]) - boxes[2]).max(axis=1).min() > 0.0)
    until_s = free_s(start_m, end_m, speed_m_s, boxes)
    assert clear(start_m, end_m, speed_m_s, boxes, min(until_s, 60.0))


@given(MOVING, PLACE, PLACE)
def test_way_out_stays_clear_no_shorter_than_the_goal(
    drawn: list[tuple[tuple[float, float, float, float], tuple[float, float]]],
    start: tuple[float, float],
    goal: tuple[float, float],
) -> None:
    place_m, half_m = arrays([box for box, _ in drawn])
    boxes = place_m, np.array([moves for _, moves in drawn]), half_m
    start_m, goal_m = np.array(start), np.array(goal)
    out_m, clear_s = way_out(start_m, goal_m, 4.0, boxes, FAR_M)
    straight_s = free_s(start_m, goal_m, 4.0, boxes)
    assert free_s(start_m, out_m, 4.0, boxes) >= clear_s >= min(straight_s, HORIZON_S)
    if straight_s >= HORIZON_S:
        assert (out_m == goal_m).all()


@given(MOVING, PLACE, PLACE, st.floats(5.0, 60.0), st.floats(10.0, 60.0))
def test_climb_is_above_each_box_when_it_comes(
    drawn: list[tuple[tuple[float, float, float, float], tuple[float, float]]],
    start: tuple[float, float],
    end: tuple[float, float],
    height_m: float,
    tops_m: float,
) -> None:
    place_m, half_m = arrays([box for box, _ in drawn])
    boxes = place_m, np.array([moves for _, moves in drawn]), half_m
    start_m, end_m, top_m = np.array(start), np.array(end), np.linspace(tops_m, tops_m + 20.0, len(drawn))
    over_m = climb_over(start_m, end_m, (4.0, 2.0), boxes, top_m, height_m)
    for k in range(len(drawn)):
        enters_s = free_s(
            start_m, end_m, 4.0, (boxes[0][k : k + 1], boxes[1][k : k + 1], boxes[2][k : k + 1])
        )
        if enters_s < HORIZON_S and np.isfinite(over_m):
            assert over_m >= top_m[k]
            assert height_m + 2.0 * enters_s >= top_m[k] - 1e-9


def test_vehicle_leaves_while_a_way_is_left_and_not_before() -> None:
    """Three boxes close in about it; the way between two of them, to the right, gets narrower."""
    place_m = np.array([[30.0, 0.0], [-30.0, 0.0], [0.0, 30.0]])
    boxes = place_m, -place_m / 15.0, np.full((3, 2), 14.0)
    here_m = np.zeros(2)
    alone = tuple(each[:1] for each in boxes)
    assert not is_pinched(here_m, here_m, 3.0, (alone[0], alone[1], alone[2]), FAR_M)
    assert is_pinched(here_m, here_m, 3.0, boxes, FAR_M)
    assert way_out(here_m, here_m, 3.0, boxes, FAR_M)[1] >= HORIZON_S, "there still is a way"
    farther = (2.0 * place_m, boxes[1] / 2.0, boxes[2])
    assert not is_pinched(here_m, here_m, 3.0, farther, FAR_M), "they are not there for long"


def test_vehicle_flies_through_a_gap_that_closes() -> None:
    """Two walls close in, a third comes from behind: it flies on while there is room, and not back."""
    boxes = (
        np.array([[20.0, 12.0], [20.0, -12.0], [-20.0, 0.0]]),
        np.array([[0.0, -1.0], [0.0, 1.0], [2.0, 0.0]]),
        np.array([[10.0, 4.0], [10.0, 4.0], [4.0, 30.0]]),
    )
    out_m, _ = way_out(np.zeros(2), np.array([60.0, 0.0]), 6.0, boxes, FAR_M)
    assert out_m[0] > 30.0


def inside_m(one_m: Array, other_m: Array, center_m: Array, half_m: Array) -> float:
    """How deep a leg comes into a box, of all boxes."""
    shares = np.linspace(0.0, 1.0, 201)[:, None, None]
    beyond_m = np.abs(one_m + shares * (other_m - one_m) - center_m) - half_m
    return float(-beyond_m.max(axis=2).min(initial=0.0))


@given(st.lists(BOX, max_size=8), PLACE, PLACE)
def test_way_between_boxes_enters_none(
    boxes: list[tuple[float, float, float, float]], start: tuple[float, float], goal: tuple[float, float]
) -> None:
    center_m, half_m = arrays(boxes)
    start_m, goal_m = np.array(start), np.array(goal)
    for end_m in (start_m, goal_m):
        assume(inside_m(end_m, end_m, center_m, half_m) <= 0.0)
    way_m, is_way = way_between(start_m, goal_m, center_m, half_m, FAR_M)
    assume(is_way)
    for one_m, other_m in pairwise([start_m, *way_m, goal_m]):
        assert inside_m(one_m, other_m, center_m, half_m) <= 1e-6
    if all(passes_box(start_m, goal_m, *each) for each in zip(center_m, half_m, strict=True)):
        assert len(way_m) == 0, "a straight way has no corner"


@given(st.floats(0.1, 10.0), st.floats(12.0, 40.0))
def test_doorway_that_ellipses_cover_is_a_way(half_door_m: float, long_m: float) -> None:
    """Two long walls, each with its other end beyond the fence: the only way is the doorway."""
    off_m = np.array([0.0, half_door_m + 2.0 * long_m])
    center_m, half_m = np.array([-off_m, off_m]), np.tile([2.0, 2.0 * long_m], (2, 1))
    start_m, goal_m = np.array([9.0, 0.9 * long_m]), np.array([-9.0, -0.9 * long_m])
    assert not way_round(start_m, goal_m, center_m, np.sqrt(2.0) * half_m, 2.0 * long_m)[1]
    way_m, is_way = way_between(start_m, goal_m, center_m, half_m, 2.0 * long_m)
    assert is_way
    assert (np.abs(way_m[:, 1]) <= half_door_m).all()
    assert length_m(start_m, way_m, goal_m) <= 18.0 + 1.8 * long_m + 1.0


def test_vehicle_inside_a_margin_leaves_it_and_goes_no_deeper() -> None:
    center_m, half_m = np.zeros(2), np.array([4.0, 20.0])
    inside = np.array([3.5, 5.0])
    assert passes_box(inside, np.array([9.0, 5.0]), center_m, half_m)
    assert passes_box(inside, np.array([3.5, 30.0]), center_m, half_m), "along the side"
    assert not passes_box(inside, np.array([2.0, 30.0]), center_m, half_m)
    assert not passes_box(inside, np.array([-9.0, 5.0]), center_m, half_m)
