"""What no route of the centre may do, whatever boxes stand or drive around it."""

import heapq
from itertools import pairwise

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from gcs.formation.obstacles import Ellipse, Outlines
from gcs.formation.route import Boxes, Goal, Route, find_route, next_leg
from gcs.formation.route_search import AXES, FACING_X, FACING_Y, HORIZON_S, is_blocked
from gcs.model.state import Array
from tests.support.law_fleets import within
from tests.support.safety_fleets import CALM

SPEED_M_S, REACH_M, GROWN_M = 3.0, 200.0, 10.0
SAMPLES = 300

STILL = st.just(0.0)
DRIVING = st.one_of(STILL, within(-2.0, 2.0))


def outlines_of(speed: st.SearchStrategy[float], boxes_max: int = 6) -> st.SearchStrategy[Outlines]:
    place, half = within(-60.0, 60.0), within(3.0, 30.0)
    box = st.builds(Ellipse, place, place, half, half, st.just(60.0), speed, speed)
    drawn = st.lists(box, min_size=1, max_size=boxes_max)
    return drawn.map(lambda boxes: Outlines.of({f"b{k}": each for k, each in enumerate(boxes)}))


@st.composite
def scenes(draw: st.DrawFn, speed: st.SearchStrategy[float] = DRIVING) -> tuple[Outlines, Boxes, Goal]:
    outlines = draw(outlines_of(speed))
    boxes = Boxes.grown(outlines, np.full(len(outlines), GROWN_M), np.zeros(2))
    place_m = np.array([draw(within(-90.0, 90.0)), draw(within(-90.0, 90.0))])
    velocity_m_s = np.array([draw(speed), draw(speed)]) / 2.0
    return outlines, boxes, Goal(place_m, velocity_m_s)


def legs_of(route: Route, boxes: Boxes, goal: Goal) -> list[tuple[float, Array, float, Array]]:
    """Time and place at both ends of every straight part of a route, the waiting included."""
    ends: list[tuple[float, Array]] = [(0.0, np.zeros(2))]
    ends += [
        (at_s, boxes.corner_m(corner, at_s))
        for corner, at_s in zip(route.corners, route.arrival_s, strict=False)
    ]
    if route.reaches:
        waited_m = boxes.corner_m(route.corners[-1], route.leaves_s) if route.corners else np.zeros(2)
        ends += [(route.leaves_s, waited_m), (route.arrival_s[-1], goal.later(route.arrival_s[-1]).place_m)]
    return [(*a, *b) for a, b in pairwise(ends) if b[0] > a[0]]


def distance_m(outlines: Outlines, j: int, times_s: Array, places_m: Array) -> Array:
    """(k,) distance of places (k, 2) from a box that is not grown, at its times; negative inside."""
    middle_m = outlines.center_m[j] + times_s[:, None] * outlines.velocity_m_s[j]
    beside_m = np.abs(places_m - middle_m) - outlines.half_length_m[j]
    away_m: Array = np.hypot(*np.maximum(beside_m, 0.0).T) + np.minimum(beside_m.max(axis=1), 0.0)
    return away_m


@CALM
@given(scenes())
def test_route_keeps_its_distance_from_every_box_at_its_time(scene: tuple[Outlines, Boxes, Goal]) -> None:
    """Measured on the boxes themselves, not on the dodecagons that the search knows."""
    outlines, boxes, goal = scene
    route = find_route(boxes, np.zeros(2), goal, SPEED_M_S, REACH_M)
    assume(route.corners or route.reaches)
    for number, (from_s, from_m, to_s, to_m) in enumerate(legs_of(route, boxes, goal)):
        share = np.linspace(0.0, 1.0, SAMPLES)[:, None]
        times_s = (from_s + share * (to_s - from_s))[:, 0]
        places_m = from_m + share * (to_m - from_m)
        first = number == 0 or not route.corners
        for j in range(len(outlines)):
            foreseen = (times_s <= HORIZON_S) | outlines.stand[j]
            away_m = distance_m(outlines, j, times_s, places_m)[foreseen]
            if first and (boxes.first_m[j] < boxes.half_m[j]).any():  # from inside: out, but not deeper
                offset_m = places_m - outlines.center_m[j] - times_s[:, None] * outlines.velocity_m_s[j]
                spans_m = offset_m @ np.array([FACING_X, FACING_Y])[:, :AXES]
                outside = (np.abs(spans_m) > boxes.first_m[j] - 1e-5).any(axis=1)
                assert outside[foreseen].all(), (number, j)
            else:
                assert (away_m > GROWN_M - 1e-4).all(), (number, j, away_m.min())


@CALM
@given(scenes())
def test_goal_that_a_route_reaches_then_stays_free(scene: tuple[Outlines, Boxes, Goal]) -> None:
    _, boxes, goal = scene
    route = find_route(boxes, np.zeros(2), goal, SPEED_M_S, REACH_M)
    assume(route.reaches and route.arrival_s[-1] < HORIZON_S)
    times_s = np.linspace(route.arrival_s[-1] + 1e-3, HORIZON_S, SAMPLES)
    places_m = goal.place_m + times_s[:, None] * goal.velocity_m_s
    shrunk = Boxes(boxes.names, boxes.place, boxes.half_m - 0.02, boxes.first_m, boxes.corners)
    assert not shrunk.hold(places_m, times_s).any()


@CALM
@given(scenes())
def test_routes_stay_inside_the_fence_and_keep_their_speed(scene: tuple[Outlines, Boxes, Goal]) -> None:
    _, boxes, goal = scene
    route = find_route(boxes, np.zeros(2), goal, SPEED_M_S, 70.0)
    times_s, here_m = 0.0, np.zeros(2)
    for corner, at_s in zip(route.corners, route.arrival_s, strict=False):
        there_m = boxes.corner_m(corner, at_s)
        assert np.hypot(*there_m) <= 70.0 + 1e-6
        assert np.hypot(*(there_m - here_m)) <= SPEED_M_S * (at_s - times_s) + 1e-6
        times_s, here_m = at_s, there_m


def shortest_m(boxes: Boxes, goal_m: Array) -> float:
    """The shortest way past standing boxes, by Dijkstra over all pairs of corners, tangents or not."""
    nodes_m = np.vstack([np.zeros((1, 2)), boxes.corners[:, :2], goal_m[None]])
    least_m, open_nodes = {0: 0.0}, [(0.0, 0)]
    done: set[int] = set()
    while open_nodes:
        here_m, u = heapq.heappop(open_nodes)
        if u in done:
            continue
        done.add(u)
        if u == len(nodes_m) - 1:
            return here_m
        for v in set(range(1, len(nodes_m))) - done:
            way_m = nodes_m[v] - nodes_m[u]
            length_m = float(np.hypot(*way_m))
            there_m = here_m + length_m
            if there_m >= least_m.get(v, np.inf) or np.hypot(*nodes_m[v]) > REACH_M:
                continue
            half_m = boxes.half_m if u else boxes.first_m
            leg = (*nodes_m[u].tolist(), *(SPEED_M_S * way_m / max(length_m, 1e-9)).tolist())
            if not is_blocked(boxes.place, half_m, leg, 0.0, length_m / SPEED_M_S):
                least_m[v] = there_m
                heapq.heappush(open_nodes, (there_m, v))
    return np.inf


@CALM
@given(scenes(STILL))
def test_past_standing_boxes_no_way_is_shorter(scene: tuple[Outlines, Boxes, Goal]) -> None:
    _, boxes, goal = scene
    covered = boxes.hold(goal.place_m[None], np.zeros(1))[0]
    shortest = np.inf if covered else shortest_m(boxes, goal.place_m)
    route = find_route(boxes, np.zeros(2), goal, SPEED_M_S, REACH_M)
    assert route.reaches == (shortest < np.inf)
    if route.reaches and (boxes.first_m == boxes.half_m).all():  # the centre begins outside
        assert abs(SPEED_M_S * route.arrival_s[-1] - shortest) < 1e-6


def test_way_out_of_two_boxes_turns_where_it_leaves_them() -> None:
    boxes = [Ellipse(5.0, -12.76, 3.0, 9.0, 60.0), Ellipse(-11.0, 10.73, 6.07, 6.0, 60.0)]
    outlines = Outlines.of(
        {"south": boxes[0], "west": boxes[1], "north": Ellipse(9.25, 18.0, 18.0, 3.0, 60.0)}
    )
    grown = Boxes.grown(outlines, np.full(3, GROWN_M), np.zeros(2))
    route = find_route(grown, np.zeros(2), Goal(np.array([58.3, 0.0]), np.zeros(2)), SPEED_M_S, REACH_M)
    assert route.reaches
    assert SPEED_M_S * route.arrival_s[-1] < 61.0


@CALM
@given(scenes(), within(0.0, 3.0))
def test_leg_that_is_flown_next_enters_no_box(scene: tuple[Outlines, Boxes, Goal], for_s: float) -> None:
    _, boxes, goal = scene
    route = find_route(boxes, np.zeros(2), goal, SPEED_M_S, REACH_M)
    leg = next_leg(boxes, np.zeros(2), route.corners, goal, SPEED_M_S, reaches=route.reaches)
    if leg is None or not leg[0]:
        return
    corner_m, velocity_m_s = boxes.corner_m(leg[0][0], 0.0), boxes.velocity_m_s(leg[0][0])
    if np.hypot(*(corner_m + for_s * velocity_m_s - for_s * leg[1])) < 1.0:
        return  # it arrives
    ends_s = float(np.hypot(*corner_m) / max(np.hypot(*(leg[1] - velocity_m_s)), 1e-9))
    mover = (0.0, 0.0, *leg[1].tolist())
    assert not is_blocked(boxes.place, boxes.first_m, mover, 0.0, min(for_s, ends_s - 1e-6))
