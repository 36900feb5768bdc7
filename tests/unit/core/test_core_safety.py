"""The filter's parts, against numbers computed by hand."""

from math import sqrt

import numpy as np
import pytest

from gcs.errors import ShapeError
from gcs.formation.obstacles import Ellipse
from gcs.safety.constraints import NOBODY, Braking, Constraints
from gcs.safety.filter import Limits, SafetySettings, Surroundings, cap, filter_velocities
from gcs.safety.kernels import warm_up
from gcs.safety.neighbours import near_pairs
from gcs.safety.projection import project, shrink
from gcs.safety.separation import (
    Floor,
    keepout_constraints,
    minimum_separation,
    pairs_that_count,
    scaled_distance_m,
    separation_constraints,
)
from gcs.safety.traffic import Traffic, count_meetings, keep_right
from gcs.safety.walls import Fence, fence_constraints, obstacle_constraints
from gcs.state import Array

BRAKING = Braking(reaction_s=0.5, lead_s=0.0, deceleration_m_s2=1.5, escape_rate_per_s=0.5)
FLOOR = Floor(horizontal_m=2.0, vertical_m=3.0, margin_m=1.0, uncertainty_m=0.0, pad_height_m=2.0)
FENCE = Fence(height_min_m=3.0, height_max_m=100.0, distance_max_m=300.0)
SETTINGS = SafetySettings(limits=Limits(), floor=FLOOR, fence=FENCE, braking=BRAKING)
NO_PATHS = np.zeros((0, 2, 3))


def surroundings(
    position: Array,
    *,
    velocity: Array | None = None,
    commanded: list[bool] | None = None,
    descending: bool = False,
    segments: Array = NO_PATHS,
    ellipses: dict[str, Ellipse] | None = None,
) -> Surroundings:
    n = len(position)
    return Surroundings(
        position,
        np.zeros((n, 3)) if velocity is None else velocity,
        np.ones(n, dtype=bool) if commanded is None else np.array(commanded),
        np.ones(n, dtype=bool),
        np.full(n, descending),
        segments,
        ellipses or {},
        [f"d{i}" for i in range(n)],
        np.zeros(n),
        np.full(n, np.inf),
    )


def filtered(wanted: Array, around: Surroundings) -> Array:
    return filter_velocities(wanted, around, SETTINGS)[0]


# braking


def test_the_braking_speed_stops_within_the_gap() -> None:
    gap = np.array([0.0, 0.1, 1.0, 10.0])
    speed = BRAKING.speed_m_s(gap)
    assert speed * 0.5 + speed**2 / (2 * 1.5) == pytest.approx(gap)


def test_inside_the_gap_moving_away_is_demanded() -> None:
    assert BRAKING.speed_m_s(np.array([-2.0])) == pytest.approx([-1.0])


# constraints


def test_constraints_of_unequal_lengths_are_refused() -> None:
    rows = np.zeros(1, dtype=np.intp)
    with pytest.raises(ShapeError, match="for 2 of them"):
        Constraints(rows, rows, np.zeros((1, 3)), np.zeros(1), ("a", "b"))


def half_space(row: int, other: int, normal: tuple[float, float, float], bound: float) -> Constraints:
    return Constraints(
        np.array([row]), np.array([other]), np.array([normal]), np.array([bound]), (f"{row}-{other}",)
    )


def test_slack_is_how_far_a_half_space_is_from_being_broken() -> None:
    both = Constraints.joined(
        half_space(0, NOBODY, (1.0, 0.0, 0.0), -2.0), half_space(0, 1, (0.0, 1.0, 0.0), 0.5)
    )
    velocity = np.array([[1.0, 1.0, 0.0], [0.0, 3.0, 0.0]])
    assert len(both) == 2
    assert both.slack_m_s(velocity) == pytest.approx([3.0, -2.5])


# the projection and the shrinking


def test_a_pair_shares_the_duty_evenly_and_nothing_else_is_changed() -> None:
    # they close with 4 m/s, 1 is allowed: 1.5 each
    wanted = np.array([[2.0, 1.0, 0.0], [-2.0, 0.0, 0.5]])
    closing = half_space(0, 1, (-1.0, 0.0, 0.0), -1.0)
    assert project(wanted, closing) == pytest.approx(np.array([[0.5, 1.0, 0.0], [-0.5, 0.0, 0.5]]), abs=1e-3)


def test_the_projection_onto_a_corner_is_the_nearest_point_of_it() -> None:
    corner = Constraints.joined(
        half_space(0, NOBODY, (-1.0, 0.0, 0.0), -1.0), half_space(0, NOBODY, (0.0, -1.0, 0.0), -2.0)
    )
    assert project(np.array([[5.0, 5.0, 1.0]]), corner) == pytest.approx(
        np.array([[1.0, 2.0, 1.0]]), abs=1e-3
    )


def test_velocities_that_break_nothing_are_left_exactly_as_they_are() -> None:
    wanted = np.array([[0.3, -0.2, 0.1], [1.0, 0.0, 0.0]])
    allowed = half_space(0, 1, (-1.0, 0.0, 0.0), -1.0)
    assert project(wanted, allowed).tolist() == wanted.tolist()
    assert shrink(wanted, allowed).tolist() == wanted.tolist()


def test_what_the_projection_leaves_broken_is_shrunk_until_it_holds() -> None:
    velocity = np.array([[3.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    closing = half_space(0, 1, (-1.0, 0.0, 0.0), -1.0)
    shrunk = shrink(velocity, closing)
    assert closing.slack_m_s(shrunk)[0] >= -1e-3
    assert shrunk[2].tolist() == [1.0, 1.0, 1.0]
    assert (shrunk[:2, 0] / velocity[:2, 0] < 1.0).all()


def test_what_even_rest_cannot_mend_is_not_shrunk() -> None:
    fleeing = np.array([[0.5, 0.0, 0.0]])
    assert shrink(fleeing, half_space(0, NOBODY, (1.0, 0.0, 0.0), 2.0)).tolist() == fleeing.tolist()


def test_a_bound_of_zero_against_a_wall_ends_in_rest_and_not_in_a_crawl() -> None:
    crawl = shrink(np.array([[500.0, 0.0, 0.0]]), half_space(0, NOBODY, (-1.0, 0.0, 0.0), 0.0))
    assert crawl[0, 0] == pytest.approx(0.0, abs=1e-3)


# pairs and separation


def test_pairs_on_their_pads_are_exempt_and_unknown_positions_take_no_part() -> None:
    position = np.array(
        [[0.0, 0.0, -1.0], [1.0, 0.0, -1.9], [2.0, 0.0, -2.1], [np.nan, 0.0, -9.0], [3.0, 0.0, 0.0]]
    )
    airborne = np.array([True, True, True, True, False])
    first, second = pairs_that_count(position, airborne, FLOOR)
    assert list(zip(first.tolist(), second.tolist(), strict=True)) == [(0, 2), (1, 2), (2, 4)]


def test_the_minimum_is_the_true_distance_and_the_floor_is_an_ellipsoid() -> None:
    airborne = np.ones(2, dtype=bool)
    beside = np.array([[0.0, 0.0, -9.0], [2.1, 0.0, -9.0]])
    above = np.array([[0.0, 0.0, -9.0], [0.0, 0.0, -11.9]])
    assert minimum_separation(beside, airborne, FLOOR) == pytest.approx((2.1, 0))
    assert minimum_separation(above, airborne, FLOOR) == pytest.approx((2.9, 1))
    assert minimum_separation(beside, ~airborne, FLOOR) == (np.inf, 0)


def test_the_widest_separation_satisfies_the_ellipsoid_in_every_direction() -> None:
    assert FLOOR.widest_m == pytest.approx(4.5)
    unsure = FLOOR.model_copy(update={"uncertainty_m": 0.35, "vertical_uncertainty": 2.0})
    assert unsure.widest_m == pytest.approx(4.5 + 2.0 * 0.7)
    assert unsure.kept_m(0.7) == pytest.approx((3.7, 5.9))
    assert Floor(horizontal_m=3.0, vertical_m=2.0, margin_m=1.0, uncertainty_m=0.0).widest_m == pytest.approx(
        4.0
    )


def test_two_head_on_are_held_to_what_both_together_can_brake() -> None:
    position = np.array([[-4.0, 0.0, -20.0], [4.0, 0.0, -20.0]])  # 5 m to floor and margin
    allowed = filtered(np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]]), surroundings(position))
    closing = allowed[0, 0] - allowed[1, 0]
    assert closing == pytest.approx(float(BRAKING.speed_m_s(np.array([5.0]))[0]), abs=2e-3)
    assert allowed[0, 0] == pytest.approx(-allowed[1, 0], abs=2e-3)


def test_one_above_the_other_is_held_off_in_the_taller_way() -> None:
    # 9 m apart, 4.5 m is floor and margin vertically
    position = np.array([[0.0, 0.0, -20.0], [0.0, 0.0, -29.0]])
    allowed = filtered(np.array([[0.0, 0.0, -2.5], [0.0, 0.0, 1.4]]), surroundings(position))
    assert allowed[1, 2] - allowed[0, 2] <= float(BRAKING.speed_m_s(np.array([4.5]))[0]) + 2e-3


def test_from_one_who_is_not_commanded_the_other_yields_all_the_way() -> None:
    position = np.array([[0.0, 0.0, -20.0], [3.5, 0.0, -20.0]])
    oncoming = np.array([[0.0, 0.0, 0.0], [-3.0, 0.0, 0.0]])
    around = surroundings(position, velocity=oncoming, commanded=[True, False])
    allowed = filtered(np.zeros((2, 3)), around)
    brake = float(BRAKING.speed_m_s(np.array([0.5]))[0])
    assert allowed[0, 0] == pytest.approx(-3.0 + brake, abs=2e-3)
    assert not allowed[1].any()


def test_one_of_unknown_velocity_is_still_kept_away_from() -> None:
    position = np.array([[0.0, 0.0, -20.0], [3.5, 0.0, -20.0]])
    unknown = np.array([[0.0, 0.0, 0.0], [np.nan, np.nan, np.nan]])
    around = surroundings(position, velocity=unknown, commanded=[True, False])
    allowed = filtered(np.array([[4.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), around)
    assert allowed[0, 0] <= float(BRAKING.speed_m_s(np.array([0.5]))[0]) + 2e-3


def test_two_in_the_same_place_are_parted_up_and_down() -> None:
    position = np.array([[0.0, 0.0, -20.0], [0.0, 0.0, -20.0]])
    allowed = filtered(np.zeros((2, 3)), surroundings(position))
    assert allowed[0, 2] - allowed[1, 2] > 1.0


def test_nobody_commanded_means_no_constraints() -> None:
    position = np.array([[0.0, 0.0, -20.0], [1.0, 0.0, -20.0]])
    nobody = np.zeros(2, dtype=bool)
    found = separation_constraints(
        position,
        np.zeros((2, 3)),
        nobody,
        ~nobody,
        floor=FLOOR,
        braking=BRAKING,
        uncertainty_m=np.zeros(2),
        course_m_s=np.zeros((2, 3)),
        spare_m_s=np.full(2, 10.0),
    )
    assert len(found) == 0
    paths = np.array([[[0.0, 0.0, -20.0], [0.0, 0.0, 0.0]]])
    assert (
        len(
            keepout_constraints(
                position, nobody, paths, floor=FLOOR, braking=BRAKING, uncertainty_m=np.zeros(2)
            )
        )
        == 0
    )


def test_what_closes_in_now_goes_on_for_the_lead_and_what_parts_earns_nothing() -> None:
    lead = BRAKING.model_copy(update={"lead_s": 0.5})
    settings = SETTINGS.model_copy(update={"braking": lead})
    position = np.array([[-4.0, 0.0, -20.0], [4.0, 0.0, -20.0]])  # 5 m to floor and margin
    wanted = np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]])
    for measured_m_s, gap_m in ((1.0, 4.0), (-1.0, 5.0)):
        closing = np.array([[measured_m_s, 0.0, 0.0], [-measured_m_s, 0.0, 0.0]])
        allowed, _ = filter_velocities(wanted, surroundings(position, velocity=closing), settings)
        expected = float(BRAKING.speed_m_s(np.array([gap_m]))[0])
        assert allowed[0, 0] - allowed[1, 0] == pytest.approx(expected, abs=2e-3)


def test_over_a_slow_link_everybody_is_further_on_brakes_earlier_and_escapes_more_gently() -> None:
    assert BRAKING.over_link(0.0) is BRAKING
    late = BRAKING.over_link(0.2)
    assert (late.reaction_s, late.lead_s) == pytest.approx((0.9, BRAKING.lead_s + 0.4))
    assert late.deceleration_m_s2 == BRAKING.deceleration_m_s2
    assert late.escape_rate_per_s == pytest.approx(1.0 / (1.0 / 0.5 + 0.8))
    settings = SETTINGS.model_copy(update={"link_delay_s": 0.2})
    position = np.array([[-4.0, 0.0, -20.0], [4.0, 0.0, -20.0]])
    closing = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    allowed, _ = filter_velocities(3.0 * closing, surroundings(position, velocity=closing), settings)
    gap_m = 5.0 - 0.2 * 2.0 - late.lead_s * 2.0  # where they are by now, and where that leads
    assert allowed[0, 0] - allowed[1, 0] == pytest.approx(
        float(late.speed_m_s(np.array([gap_m]))[0]), abs=2e-3
    )


def test_who_is_pushed_to_where_nobody_had_looked_is_looked_at_again() -> None:
    # an escape pushes the middle one, which rests, onto the right one, far beyond what anybody wants
    position = np.array([[0.0, 0.0, -20.0], [0.4, 0.0, -20.0], [4.4, 0.0, -20.0]])
    hard = SETTINGS.model_copy(update={"braking": BRAKING.model_copy(update={"escape_rate_per_s": 3.0})})
    allowed, reasons = filter_velocities(np.zeros((3, 3)), surroundings(position), hard)
    assert allowed[1, 0] - allowed[0, 0] > 5.0
    assert allowed[2, 0] - allowed[1, 0] >= -float(BRAKING.speed_m_s(np.array([1.0]))[0]) - 2e-3
    assert reasons[2] == "separation from d1"


# neighbours


@pytest.mark.parametrize("count", [0, 1, 2, 60, 400])
def test_the_grid_finds_every_near_pair_once(count: int) -> None:
    rng = np.random.default_rng(count)
    position = rng.normal(0.0, 15.0, (count, 3))
    position[: count // 10] *= 40.0  # far out
    takes_part = rng.random(count) < 0.9
    radius = rng.uniform(0.1, 4.0, count)
    first, second = near_pairs(np.where(takes_part[:, None], position, np.nan), takes_part, radius)
    i, j = np.triu_indices(count, 1)
    near = np.linalg.norm(position[i] - position[j], axis=1) < radius[i] + radius[j]
    near &= takes_part[i] & takes_part[j]
    found = [tuple(sorted(pair)) for pair in zip(first.tolist(), second.tolist(), strict=True)]
    assert sorted(found) == list(zip(i[near].tolist(), j[near].tolist(), strict=True))


def test_the_minimum_separation_of_a_crowd_and_of_two_far_apart() -> None:
    rng = np.random.default_rng(1)
    crowd = rng.normal(0.0, 30.0, (300, 3)) - (0.0, 0.0, 200.0)
    first, second = pairs_that_count(crowd, np.ones(300, bool), FLOOR)
    least = np.linalg.norm(crowd[first] - crowd[second], axis=1).min()
    inside = int((scaled_distance_m(crowd, first, second, FLOOR) < FLOOR.horizontal_m).sum())
    assert minimum_separation(crowd, np.ones(300, bool), FLOOR) == pytest.approx((least, inside))
    far = np.array([[0.0, 0.0, -9.0], [5e4, 0.0, -9.0]])
    assert minimum_separation(far, np.ones(2, bool), FLOOR) == pytest.approx((5e4, 0))
    assert minimum_separation(np.full((2, 3), np.nan), np.ones(2, bool), FLOOR) == (np.inf, 0)


# traffic


def to_goals(
    position: Array, goal: Array, wanted: Array, *, turned: list[bool] | None = None, angle: float = 45.0
) -> Array:
    n = len(position)
    everybody = np.ones(n, dtype=bool)
    return keep_right(
        wanted,
        position,
        np.zeros((n, 3)),
        goal,
        to_goal=everybody if turned is None else np.array(turned),
        commanded=everybody,
        airborne=everybody,
        flatness=2.0 / 3.0,
        settings=Traffic(angle_max_deg=angle),
    )


HEAD_ON = np.array([[-30.0, 0.0, -20.0], [30.0, 0.0, -20.0]])


def test_two_that_would_meet_head_on_both_keep_to_the_right() -> None:
    wanted = np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]])
    turned = to_goals(HEAD_ON, HEAD_ON[::-1], wanted)
    angle = np.radians(45.0) * -np.expm1(-1.0 / Traffic().crowd)
    assert turned[0] == pytest.approx([3.0 * np.cos(angle), 3.0 * np.sin(angle), 0.0])
    assert turned[1] == pytest.approx(-turned[0])


def test_straight_up_and_straight_down_part_to_different_sides() -> None:
    column = np.array([[0.0, 0.0, -20.0], [0.0, 0.0, -60.0]])
    turned = to_goals(column, column[::-1], np.array([[0.0, 0.0, -2.0], [0.0, 0.0, 1.4]]))
    assert turned[0, 1] > 0.1 > -0.1 > turned[1, 1]


@pytest.mark.parametrize(
    ("goal", "wanted"),
    [
        (np.array([[30.0, 18.0, -20.0], [-30.0, -18.0, -20.0]]), [[3.0, 0.9, 0.0], [-3.0, -0.9, 0.0]]),
        (HEAD_ON * 2.0, [[-3.0, 0.0, 0.0], [3.0, 0.0, 0.0]]),
        (HEAD_ON * 0.5, [[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]]),
        (np.array([[20.0, 0.0, -20.0], [80.0, 0.0, -20.0]]), [[3.0, 0.0, 0.0], [3.0, 0.0, 0.0]]),
    ],
    ids=["past each other at a distance", "apart", "both stop before they meet", "side by side"],
)
def test_who_meets_nobody_flies_straight_on(goal: Array, wanted: list[list[float]]) -> None:
    assert to_goals(HEAD_ON, goal, np.array(wanted)).tolist() == wanted


def test_only_those_on_their_way_to_a_goal_are_turned_and_none_where_the_angle_is_zero() -> None:
    wanted = np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]])
    some = to_goals(HEAD_ON, HEAD_ON[::-1], wanted, turned=[False, True])
    assert some[0].tolist() == wanted[0].tolist()
    assert some[1, 1] < 0.0
    nobody = to_goals(HEAD_ON, HEAD_ON[::-1], wanted, turned=[False, False])
    assert nobody.tolist() == wanted.tolist()
    assert to_goals(HEAD_ON, HEAD_ON[::-1], wanted, angle=0.0).tolist() == wanted.tolist()


def test_an_unknown_place_or_goal_turns_nobody() -> None:
    wanted = np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]])
    unknown = np.where([[True], [False]], HEAD_ON, np.nan)
    assert to_goals(unknown, HEAD_ON[::-1], wanted).tolist() == wanted.tolist()
    assert to_goals(HEAD_ON, unknown * np.nan, wanted).tolist() == wanted.tolist()


def test_warming_up_runs_every_kernel() -> None:
    warm_up()
    assert count_meetings.signatures  # type: ignore[attr-defined]
    assert near_pairs.signatures  # type: ignore[attr-defined]


# paths of lost vehicles


def test_the_column_below_a_lost_vehicle_is_kept_clear_at_every_height() -> None:
    column = np.array([[[0.0, 0.0, -30.0], [0.0, 0.0, 0.0]]])
    for height_m in (29.0, 15.0, 4.0):
        position = np.array([[-5.0, 0.0, -height_m]])  # 2 m to floor and margin
        allowed = filtered(np.array([[6.0, 0.0, 0.0]]), surroundings(position, segments=column))
        assert allowed[0, 0] == pytest.approx(float(BRAKING.speed_m_s(np.array([2.0]))[0]), abs=2e-3)


def test_beside_its_end_the_distance_to_the_end_counts() -> None:
    # 10 m above the top of the column: 4.5 m of them are floor and margin, 1.4 m/s down is allowed
    column = np.array([[[0.0, 0.0, -30.0], [0.0, 0.0, 0.0]]])
    allowed = filtered(
        np.array([[0.0, 0.0, 1.4]]), surroundings(np.array([[0.0, 0.0, -40.0]]), segments=column)
    )
    assert allowed[0, 2] == pytest.approx(1.4)


def test_one_exactly_on_the_path_is_sent_off_it() -> None:
    column = np.array([[[0.0, 0.0, -30.0], [0.0, 0.0, 0.0]]])
    allowed = filtered(np.zeros((1, 3)), surroundings(np.array([[0.0, 0.0, -10.0]]), segments=column))
    assert np.hypot(*allowed[0, :2]) == pytest.approx(1.5, abs=2e-3)


# walls


def test_the_fence_brakes_sinking_climbing_and_leaving() -> None:
    position = np.array([[0.0, 0.0, -3.5], [0.0, 0.0, -99.0], [299.0, 0.0, -20.0]])
    wanted = np.array([[0.0, 0.0, 1.4], [0.0, 0.0, -2.5], [5.0, 0.0, 0.0]])
    allowed = filtered(wanted, surroundings(position))
    half, one = BRAKING.speed_m_s(np.array([0.5, 1.0])).tolist()
    assert allowed[0, 2] == pytest.approx(half, abs=2e-3)
    assert allowed[1, 2] == pytest.approx(-one, abs=2e-3)
    assert allowed[2, 0] == pytest.approx(one, abs=2e-3)


def test_below_the_least_height_one_climbs_unless_on_the_way_down() -> None:
    low = np.array([[0.0, 0.0, -2.0]])
    sinking = np.array([[0.0, 0.0, 1.0]])
    assert filtered(sinking, surroundings(low))[0, 2] == pytest.approx(-0.5, abs=2e-3)
    assert filtered(sinking, surroundings(low, descending=True))[0, 2] == 1.0


def test_right_above_the_origin_no_direction_is_fenced() -> None:
    over_origin = np.array([[0.0, 0.0, -20.0]])
    found = fence_constraints(over_origin, np.ones(1, bool), np.zeros(1, bool), FENCE, BRAKING)
    assert (found.slack_m_s(np.array([[8.0, 0.0, 0.0]])) > 0.0).all()


BOX = Ellipse(0.0, 0.0, 5.0 * sqrt(2), 5.0 * sqrt(2), top_height_m=12.0)  # its wall: 5 m to every side


def test_below_its_top_an_obstacle_is_a_wall_and_above_it_a_floor() -> None:
    beside, over = np.array([[-7.0, 0.0, -8.0]]), np.array([[0.0, 0.0, -12.5]])
    into = filtered(np.array([[4.0, 1.0, 0.0]]), surroundings(beside, ellipses={"b": BOX}))
    assert into[0] == pytest.approx([float(BRAKING.speed_m_s(np.array([2.0]))[0]), 1.0, 0.0], abs=2e-3)
    down = filtered(np.array([[4.0, 0.0, 1.4]]), surroundings(over, ellipses={"b": BOX}))
    assert down[0] == pytest.approx([4.0, 0.0, float(BRAKING.speed_m_s(np.array([0.5]))[0])], abs=2e-3)


def test_well_above_an_obstacle_nothing_is_changed() -> None:
    wanted = np.array([[4.0, 2.0, 1.0]])
    over = surroundings(np.array([[0.0, 0.0, -18.0]]), ellipses={"b": BOX})
    assert filtered(wanted, over).tolist() == wanted.tolist()


def test_inside_an_obstacle_one_is_led_out_and_does_not_sink_meanwhile() -> None:
    inside = surroundings(np.array([[-4.0, 0.0, -9.0]]), ellipses={"b": BOX})
    allowed = filtered(np.array([[3.0, 0.0, 1.4]]), inside)
    assert allowed[0, 0] == pytest.approx(-0.5, abs=2e-3)
    assert allowed[0, 2] == pytest.approx(0.0, abs=2e-3)
    just_below = surroundings(np.array([[-4.0, 0.0, -11.8]]), ellipses={"b": BOX})
    risen = filtered(np.array([[3.0, 0.0, 1.4]]), just_below)
    assert risen[0] == pytest.approx([3.0, 0.0, -0.1], abs=2e-3)


def test_over_its_edge_an_obstacle_is_a_wall_across_both_ways() -> None:
    diagonal = np.array([[-8.0, 0.0, -16.0]])  # 3 m beside and 4 m above: 5 m away
    found = obstacle_constraints(diagonal, np.array([True]), {"b": BOX}, BRAKING)
    assert found.normal == pytest.approx(np.array([[-0.6, 0.0, -0.8]]))
    assert found.bound_m_s == pytest.approx(-BRAKING.speed_m_s(np.array([5.0])))


def test_from_an_obstacle_that_moves_everybody_keeps_away_relative_to_it() -> None:
    coming = Ellipse(0.0, 0.0, 5.0 * sqrt(2), 5.0 * sqrt(2), 12.0, velocity_x_m_s=-1.5, velocity_y_m_s=1.0)
    beside = surroundings(np.array([[-5.5, 0.0, -8.0]]), ellipses={"b": coming})
    allowed = filtered(np.zeros((1, 3)), beside)
    possible = float(BRAKING.speed_m_s(np.array([0.5]))[0])
    assert allowed[0] == pytest.approx([possible - 1.5, 0.0, 0.0], abs=2e-3)


def test_obstacles_concern_only_those_who_are_commanded() -> None:
    position = np.array([[-5.5, 0.0, -8.0], [-5.5, 0.0, -8.0]])
    found = obstacle_constraints(position, np.array([False, True]), {"b": BOX}, BRAKING)
    assert found.first.tolist() == [1]
    assert found.reason == ("obstacle b",)


# limits and reasons


def test_rows_not_finite_become_rest_and_long_ones_are_scaled() -> None:
    wanted = np.array([[np.nan, 1.0, 0.0], [0.0, np.inf, 0.0], [12.0, 16.0, 0.0], [0.0, 0.0, -5.0]])
    capped = cap(wanted, Limits(horizontal_m_s=10.0, up_m_s=2.5, down_m_s=1.4))
    assert capped == pytest.approx(
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [6.0, 8.0, 0.0], [0.0, 0.0, -2.5]])
    )


def test_every_restraint_has_its_reason_in_words() -> None:
    position = np.array([[0.0, 0.0, -20.0], [3.2, 0.0, -20.0], [0.0, 50.0, -3.1], [90.0, 0.0, -20.0]])
    wanted = np.array([[3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.4], [0.0, 1.0, 0.0]])
    _, reasons = filter_velocities(wanted, surroundings(position), SETTINGS)
    assert reasons == ("separation from d1", "separation from d0", "least height", "")


def test_the_worst_of_several_restraints_is_the_one_that_is_told() -> None:
    position = np.array([[-7.0, 0.0, -3.3]])
    around = surroundings(position, ellipses={"b": BOX})
    _, reasons = filter_velocities(np.array([[8.0, 0.0, 0.6]]), around, SETTINGS)
    assert reasons == ("obstacle b",)


def test_three_crowded_in_a_corner_of_the_fence_break_no_wall() -> None:
    position = np.array([[298.0, 0.0, -3.2], [298.0, 3.1, -3.2], [298.0, -3.1, -3.2]])
    allowed = filtered(np.tile([8.0, 0.0, 1.4], (3, 1)), surroundings(position))
    gap = 300.0 - np.hypot(position[:, 0], position[:, 1])
    assert (allowed[:, 0] <= BRAKING.speed_m_s(gap) * sqrt(1.001) + 5e-3).all()
    assert (allowed[:, 2] <= BRAKING.speed_m_s(np.full(3, 0.2)) + 2e-3).all()
