"""What the filter may never lead into, and what it may leave out."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, event, given
from hypothesis import strategies as st

from gcs.formation.obstacles import Ellipse
from gcs.model.plan import Obstacle
from gcs.model.state import Array, Mask
from gcs.safety.constraints import Constraints
from gcs.safety.filter import cap, filter_velocities
from gcs.safety.floor import Floor
from gcs.safety.lost_paths import keepout_constraints
from gcs.safety.separation import separation_constraints
from gcs.safety.surroundings import Surroundings
from gcs.safety.walls import obstacle_constraints
from tests.support.law_fleets import masks, obstacles, places, vectors
from tests.support.safety_fleets import (
    CALM,
    FASTEST_M_S,
    LIMITS,
    SAFETY,
    TICK_S,
    around,
    closest,
)
from tests.support.safety_world import project, shrink


def gap_to_box_m(position: Array, obstacle: Obstacle, time_s: float) -> Array:
    """(n,) shortest way to the box grown by 2 m beside and 3 m above; 0 inside."""
    beside = np.abs(position[:, :2] - obstacle.position_m(time_s)) - (
        obstacle.half_length_x_m + 2.0,
        obstacle.half_length_y_m + 2.0,
    )
    above = -position[:, 2] - obstacle.height_m - 3.0
    gap: Array = np.linalg.norm(np.maximum(np.column_stack([beside, above]), 0.0), axis=1)
    return gap


@CALM
@given(obstacles(), places(4), vectors(4, 12.0), vectors(1, 2.0))
def test_no_filtered_step_enters_a_moving_obstacle(
    obstacle: Obstacle, position: Array, desired: Array, moves: Array
) -> None:
    obstacle = replace(obstacle, velocity_x_m_s=moves[0, 0], velocity_y_m_s=moves[0, 1])
    ellipse = Ellipse.around(obstacle, margin_m=2.0, headroom_m=3.0)
    fence = SAFETY.fence.model_copy(update={"height_min_m": 0.5, "height_max_m": 1e3, "distance_max_m": 1e3})
    floor = Floor(horizontal_m=1e-3, vertical_m=1e-3, margin_m=0.0, uncertainty_m=0.0)
    lenient = SAFETY.model_copy(update={"fence": fence, "floor": floor})
    outside = gap_to_box_m(position, obstacle, 0.0) > 0.0
    assume(closest(position) >= 0.01)
    allowed, _ = filter_velocities(desired, around(position, ellipses={"b": ellipse}), lenient)
    later = position + TICK_S * allowed
    event(f"beside: {outside.any()}, inside: {(~outside).any()}")
    clear = gap_to_box_m(position, obstacle, 0.0) > 2e-3
    assert (gap_to_box_m(later, obstacle, TICK_S)[clear] > 0.0).all()
    assert (allowed[~outside, 2] <= 2e-3).all()


@CALM
@given(places(3), vectors(3, 12.0), vectors(2, 40.0))
def test_no_filtered_step_leads_onto_the_path_of_a_lost_vehicle(
    position: Array, desired: Array, ends: Array
) -> None:
    segment = (ends * (1.0, 1.0, 0.0) - [(0.0, 0.0, 40.0), (0.0, 0.0, 0.0)]).reshape(1, 2, 3)
    floor = SAFETY.floor.model_copy(update={"pad_height_m": 0.0})
    lenient = SAFETY.model_copy(update={"floor": floor})
    assume(closest(position) >= floor.horizontal_m + floor.margin_m)
    far = scaled_to_segment(position, segment[0]) >= floor.horizontal_m + floor.margin_m
    assume(far.all())
    allowed, _ = filter_velocities(desired, around(position, segments=segment), lenient)
    later = scaled_to_segment(position + TICK_S * allowed, segment[0])
    assert (later >= floor.horizontal_m + floor.margin_m - 2e-3).all()


def scaled_to_segment(position: Array, segment: Array) -> Array:
    """Distances to many points of the segment, in the floor's metric."""
    shares = np.linspace(0.0, 1.0, 801)[:, None]
    points = (segment[0] + shares * (segment[1] - segment[0])) * SAFETY.floor.scale
    distance: Array = np.linalg.norm((position * SAFETY.floor.scale)[:, None] - points[None], axis=2).min(
        axis=1
    )
    return distance


def constraints(here: Surroundings, fastest_m_s: float) -> Constraints:
    """Those of `filter_velocities`, but what `fastest_m_s` in any direction could not break."""
    pairs = separation_constraints(
        here.position_m,
        here.velocity_m_s,
        here.commanded,
        here.airborne,
        floor=SAFETY.floor,
        braking=SAFETY.braking,
        uncertainty_m=here.uncertainty_m,
        course_m_s=np.zeros_like(here.position_m),
        spare_m_s=np.full(len(here.position_m), fastest_m_s),
    )
    separation = Constraints(
        pairs.first, pairs.second, pairs.normal, pairs.bound_m_s, np.full(len(pairs), "pair", dtype=object)
    )
    keepout = keepout_constraints(
        here.position_m,
        here.commanded,
        here.segments_m,
        floor=SAFETY.floor,
        braking=SAFETY.braking,
        uncertainty_m=here.uncertainty_m,
        fastest_m_s=fastest_m_s,
    )
    walls = obstacle_constraints(
        here.position_m, here.commanded, here.ellipses, SAFETY.braking, fastest_m_s=fastest_m_s
    )
    return Constraints.joined(separation, keepout, walls)


@CALM
@given(
    vectors(5, 250.0),
    vectors(5, 12.0),
    masks(5),
    vectors(2, 250.0),
    st.lists(obstacles(), min_size=1, max_size=5),
)
def test_what_the_filter_omits_as_too_far_changes_nothing(
    spread: Array, desired: Array, commanded: Mask, ends: Array, boxes: list[Obstacle]
) -> None:
    """It is kept anyway, and the nearest velocities are the same where they are within the limits.

    Where they are not, as a way out of a box asks for more than a vehicle can fly, they are shortened. With
    every constraint they could be held up by one that no vehicle can reach.
    """
    position = spread * (1.0, 1.0, 0.1) - (0.0, 0.0, 30.0)
    ellipses = {
        str(index): Ellipse.around(box, margin_m=2.0, headroom_m=3.0) for index, box in enumerate(boxes)
    }
    here = around(position, commanded=commanded, segments=ends.reshape(1, 2, 3), ellipses=ellipses)
    every, few = constraints(here, 1e3), constraints(here, FASTEST_M_S)
    asked = cap(np.where(commanded[:, None], desired, 0.0), LIMITS)
    nearest = project(asked, few)
    allowed = shrink(cap(nearest, LIMITS), few)
    within = np.allclose(nearest, cap(nearest, LIMITS))
    event(f"left out: {'some' if len(few) < len(every) else 'none'}, within the limits: {within}")
    assert (every.slack_m_s(allowed)[every.bound_m_s <= 0.0] >= -2e-3).all()
    if within:
        assert np.allclose(allowed, shrink(cap(project(asked, every), LIMITS), every), atol=2e-3)


@pytest.mark.parametrize("apart_m", [27.0, 30.0])
def test_distant_vehicle_does_not_hold_up_the_way_out_of_a_box(apart_m: float) -> None:
    """3 m below the top, and a path above: the way out asks for a climb faster than the limit.

    Found by the property above when it compared such velocities as well: with the distant vehicle among the
    constraints this one leaves 0.9 m/s slower.
    """
    ellipses = {"b": Ellipse.around(Obstacle("b", 0.0, 0.0, 2.0, 2.0, 30.0), margin_m=2.0, headroom_m=3.0)}
    segments = np.array([[(0.0, 0.0, -35.0), (0.0, 0.5, -34.0)]])
    position = np.array([(0.0, 0.0, -30.0), (0.0, -apart_m, -30.0)])
    both, one = np.array([True, False]), np.array([True])
    desired = np.zeros((2, 3))
    there, _ = filter_velocities(
        desired, around(position, commanded=both, segments=segments, ellipses=ellipses), SAFETY
    )
    alone, _ = filter_velocities(
        desired[:1], around(position[:1], commanded=one, segments=segments, ellipses=ellipses), SAFETY
    )
    assert np.allclose(there[0], alone[0], atol=2e-3)
    assert there[0, 2] == pytest.approx(-LIMITS.up_m_s)


@CALM
@given(places(4), vectors(4, 12.0), obstacles())
def test_omitted_constraints_cannot_be_broken_within_the_limits(
    position: Array, desired: Array, obstacle: Obstacle
) -> None:
    ellipses = {"b": Ellipse.around(obstacle, margin_m=2.0, headroom_m=3.0)}
    all_vehicles = np.ones(4, dtype=bool)
    every = obstacle_constraints(position, all_vehicles, ellipses, SAFETY.braking)
    kept = obstacle_constraints(position, all_vehicles, ellipses, SAFETY.braking, fastest_m_s=2.0)
    left_out = every.bound_m_s < -2.0 * 2.0
    assert len(kept) >= len(every) - left_out.sum()
    slow = cap(desired, LIMITS) * (2.0 / FASTEST_M_S)
    assert (every.slack_m_s(slow)[left_out] > 0.0).all()
