"""What no route of the centre may do, whatever boxes stand or drive around it."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from gcs.formation.obstacles import Ellipse, Outlines
from gcs.formation.route import HORIZON_S, Boxes, Goal, Route, find_route
from gcs.model.state import Array, Mask
from tests.support.law_fleets import within
from tests.support.safety_fleets import CALM

SPEED_M_S, REACH_M, GROWN_M = 3.0, 200.0, 10.0
SAMPLES = 400

BOX = st.builds(
    Ellipse,
    within(-60.0, 60.0),
    within(-60.0, 60.0),
    within(3.0, 30.0),
    within(3.0, 30.0),
    st.just(60.0),
    within(-1.5, 1.5),
    within(-1.5, 1.5),
)


@st.composite
def scenes(draw: st.DrawFn) -> tuple[Boxes, Goal]:
    ellipses = {f"b{k}": box for k, box in enumerate(draw(st.lists(BOX, min_size=1, max_size=6)))}
    outlines = Outlines.of(ellipses)
    boxes = Boxes.grown(outlines, np.full(len(outlines), GROWN_M), np.zeros(2))
    place_m = np.array([draw(within(-90.0, 90.0)), draw(within(-90.0, 90.0))])
    return boxes, Goal(place_m, np.zeros(2))


def places_of(route: Route, boxes: Boxes, goal: Goal) -> tuple[Array, Array, Mask]:
    """Times, places and first legs of a route, sampled; with the waiting beside the last corner."""
    times_s, places_m = [0.0], [np.zeros(2)]
    for corner, at_s in zip(route.corners, route.arrival_s, strict=False):
        times_s.append(at_s)
        places_m.append(boxes.corner_m(corner, at_s))
    if route.reaches:
        times_s += [route.leaves_s, route.arrival_s[-1]]
        places_m.append(boxes.corner_m(route.corners[-1], route.leaves_s) if route.corners else places_m[0])
        places_m.append(goal.place_m)
    sampled_s = np.linspace(0.0, min(times_s[-1], HORIZON_S), SAMPLES)
    x_m, y_m = (np.interp(sampled_s, times_s, np.array(places_m)[:, axis]) for axis in (0, 1))
    return sampled_s, np.column_stack([x_m, y_m]), sampled_s <= route.arrival_s[0] + 1e-6


@CALM
@given(scenes())
def test_route_never_enters_a_grown_box_at_its_time(scene: tuple[Boxes, Goal]) -> None:
    boxes, goal = scene
    route = find_route(boxes, np.zeros(2), goal, SPEED_M_S, REACH_M)
    assume(route.corners or route.reaches)
    times_s, places_m, first = places_of(route, boxes, goal)
    for j in range(len(boxes.table)):
        x_m, y_m, vx_m_s, vy_m_s, half_x_m, half_y_m = boxes.table[j]
        half_m = np.where(first[:, None], boxes.first[j], (half_x_m, half_y_m))
        middle_m = np.array([x_m, y_m]) + times_s[:, None] * (vx_m_s, vy_m_s)
        inside = (np.abs(places_m - middle_m) < half_m - 0.02).all(axis=1)
        assert not inside.any()


@CALM
@given(scenes())
def test_routes_stay_inside_the_fence_and_keep_their_speed(scene: tuple[Boxes, Goal]) -> None:
    boxes, goal = scene
    route = find_route(boxes, np.zeros(2), goal, SPEED_M_S, 70.0)
    times_s, here_m = 0.0, np.zeros(2)
    for corner, at_s in zip(route.corners, route.arrival_s, strict=False):
        there_m = boxes.corner_m(corner, at_s)
        assert np.hypot(*there_m) <= 70.0 + 1e-6
        assert np.hypot(*(there_m - here_m)) <= SPEED_M_S * (at_s - times_s) + 1e-6
        times_s, here_m = at_s, there_m
