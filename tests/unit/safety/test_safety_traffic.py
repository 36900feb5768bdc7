"""Keeping to the right, by whom and how far."""

from collections.abc import Callable
from itertools import combinations

import numpy as np
import pytest
from pydantic import ValidationError

from gcs.model.state import Array
from gcs.safety.meetings import ASIDE_M, CLEAR_M, CLEAR_S, FAR_S, SOON_S, count_meetings, cubes_aside
from gcs.safety.traffic import FURTHER, Traffic, give_way, keep_right, turn_early


def to_goals(
    position: Array, goal: Array, desired: Array, *, turned: list[bool] | None = None, angle: float = 45.0
) -> Array:
    n = len(position)
    all_vehicles = np.ones(n, dtype=bool)
    return keep_right(
        desired,
        position,
        np.zeros((n, 3)),
        goal,
        to_goal=all_vehicles if turned is None else np.array(turned),
        commanded=all_vehicles,
        airborne=all_vehicles,
        flatness=2.0 / 3.0,
        settings=Traffic(angle_max_deg=angle),
    )


HEAD_ON = np.array([[-30.0, 0.0, -20.0], [30.0, 0.0, -20.0]])


def test_head_on_pair_keeps_to_the_right() -> None:
    desired = np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]])
    turned = to_goals(HEAD_ON, HEAD_ON[::-1], desired)
    angle = np.radians(45.0) * -np.expm1(-1.0 / Traffic().crowd)
    assert turned[0] == pytest.approx([3.0 * np.cos(angle), 3.0 * np.sin(angle), 0.0])
    assert turned[1] == pytest.approx(-turned[0])


def test_vertical_opposite_paths_part_to_different_sides() -> None:
    column = np.array([[0.0, 0.0, -20.0], [0.0, 0.0, -60.0]])
    turned = to_goals(column, column[::-1], np.array([[0.0, 0.0, -2.0], [0.0, 0.0, 1.4]]))
    assert turned[0, 1] > 0.1 > -0.1 > turned[1, 1]


@pytest.mark.parametrize(
    ("goal", "desired"),
    [
        (np.array([[30.0, 18.0, -20.0], [-30.0, -18.0, -20.0]]), [[3.0, 0.9, 0.0], [-3.0, -0.9, 0.0]]),
        (HEAD_ON * 2.0, [[-3.0, 0.0, 0.0], [3.0, 0.0, 0.0]]),
        (HEAD_ON * 0.5, [[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]]),
        (np.array([[20.0, 0.0, -20.0], [80.0, 0.0, -20.0]]), [[3.0, 0.0, 0.0], [3.0, 0.0, 0.0]]),
    ],
    ids=["past each other at a distance", "apart", "both stop before they meet", "side by side"],
)
def test_vehicle_without_an_encounter_flies_straight_on(goal: Array, desired: list[list[float]]) -> None:
    assert to_goals(HEAD_ON, goal, np.array(desired)).tolist() == desired


def test_only_vehicles_with_a_goal_turn_and_none_at_zero_angle() -> None:
    desired = np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]])
    some = to_goals(HEAD_ON, HEAD_ON[::-1], desired, turned=[False, True])
    assert some[0].tolist() == desired[0].tolist()
    assert some[1, 1] < 0.0
    no_vehicle = to_goals(HEAD_ON, HEAD_ON[::-1], desired, turned=[False, False])
    assert no_vehicle.tolist() == desired.tolist()
    assert to_goals(HEAD_ON, HEAD_ON[::-1], desired, angle=0.0).tolist() == desired.tolist()


def test_unknown_position_or_goal_turns_no_vehicle() -> None:
    desired = np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]])
    unknown = np.where([[True], [False]], HEAD_ON, np.nan)
    assert to_goals(unknown, HEAD_ON[::-1], desired).tolist() == desired.tolist()
    assert to_goals(HEAD_ON, unknown * np.nan, desired).tolist() == desired.tolist()


def angle_rad(meetings: float) -> float:
    return float(np.radians(45.0) * -np.expm1(-meetings / Traffic().crowd))


@pytest.mark.parametrize(("up_m_s", "side"), [(-2.0, 1.0), (1.4, -1.0)])
def test_vertical_motion_keeps_shortened_speed_and_sidesteps_y(up_m_s: float, side: float) -> None:
    here, there = [0.0, 0.0, -20.0], [0.0, 0.0, -20.0 + 10.0 * up_m_s]
    turned = to_goals(
        np.array([here, there]), np.array([there, here]), np.array([[0.0, 0.0, up_m_s], [0.0, 0.0, -up_m_s]])
    )
    angle = angle_rad(1.0)
    assert turned[0] == pytest.approx([0.0, side * abs(up_m_s) * np.sin(angle), up_m_s * np.cos(angle)])


def test_vertical_path_below_a_metre_has_its_side() -> None:
    here, there = (
        np.array([[0.0, 0.0, -20.0], [0.0, 0.0, -20.6]]),
        np.array([[0.0, 0.0, -20.6], [0.0, 0.0, -20.0]]),
    )
    turned = to_goals(here, there, np.array([[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]]))
    assert turned[0, 1] > 0.01 > -0.01 > turned[1, 1]


def test_level_path_below_a_metre_has_its_right() -> None:
    here = np.array([[0.0, 0.0, -20.0], [0.6, 0.0, -20.0]])
    turned = to_goals(here, here[::-1], np.array([[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]]))
    assert turned[0] == pytest.approx([0.5 * np.cos(angle_rad(1.0)), 0.5 * np.sin(angle_rad(1.0)), 0.0])


@pytest.mark.parametrize(("speed_m_s", "ahead_m"), [(0.1, 5.0), (0.1, 7.0)])
def test_standing_vehicle_is_met_where_it_is(speed_m_s: float, ahead_m: float) -> None:
    # d1 hardly moves: what counts is how near it is, not how near d0 would come to it
    position = np.array([[0.0, 0.0, -20.0], [ahead_m, 0.0, -20.0]])
    desired = np.array([[3.0, 0.0, 0.0], [-speed_m_s, 0.0, 0.0]])
    turned = to_goals(
        position, np.array([[40.0, 0.0, -20.0], [-40.0, 0.0, -20.0]]), desired, turned=[True, False]
    )
    angle = angle_rad(1.0 - (ahead_m / 8.0) ** 2)
    assert turned[0] == pytest.approx([3.0 * np.cos(angle), 3.0 * np.sin(angle), 0.0])


def test_creeping_vehicle_does_not_count_as_standing() -> None:
    position = np.array([[0.0, 0.0, -20.0], [6.0, 0.0, -20.0]])
    desired = np.array([[3.0, 0.0, 0.0], [-0.5, 0.0, 0.0]])
    turned = to_goals(
        position, np.array([[40.0, 0.0, -20.0], [-40.0, 0.0, -20.0]]), desired, turned=[True, False]
    )
    assert turned[0, 1] == pytest.approx(3.0 * np.sin(angle_rad(1.0)))


@pytest.mark.parametrize(("above_m", "meets"), [(6.0, 0.75), (12.0, 0.0)])
def test_vertical_metre_counts_less_by_the_flatness(above_m: float, meets: float) -> None:
    # d1 crosses above d0's way: two thirds of 6 m are 4 m, half of what is of no concern
    position = np.array([[-15.0, 0.0, -20.0], [15.0, 0.0, -20.0 - above_m]])
    goal = np.array([[15.0, 0.0, -20.0], [-15.0, 0.0, -20.0 - above_m]])
    turned = to_goals(position, goal, np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]]))
    assert turned[0, 1] == pytest.approx(3.0 * np.sin(angle_rad(meets)))


def test_descending_vehicle_is_met_where_the_paths_meet() -> None:
    # 15 m to go sideways, 9 m down, both in 5 s
    position = np.array([[-15.0, 0.0, -20.0], [0.0, 0.0, -29.0]])
    goal = np.array([[15.0, 0.0, -20.0], [0.0, 0.0, -11.0]])
    turned = to_goals(position, goal, np.array([[3.0, 0.0, 0.0], [0.0, 0.0, 1.8]]))
    assert turned[0, 1] == pytest.approx(3.0 * np.sin(angle_rad(1.0)))


def test_angle_of_one_degree_is_applied() -> None:
    desired = np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]])
    assert to_goals(HEAD_ON, HEAD_ON[::-1], desired, angle=1.0)[0, 1] > 0.0


@pytest.mark.parametrize("aside", [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0]])
def test_passing_at_half_the_ignored_distance_weighs_0_75(aside: list[float]) -> None:
    along = np.array([*aside[1::-1], 0.0])
    position = np.array([-5.0 * along, 5.0 * along + aside]) - (0.0, 0.0, 20.0)
    goal = np.array([5.0 * along, -5.0 * along + aside]) - (0.0, 0.0, 20.0)
    desired = np.array([0.75 * along, -0.75 * along])
    turned = to_goals(position, goal, desired)
    assert turned[0] @ desired[0] == pytest.approx(9.0 * np.cos(angle_rad(0.75)))


@pytest.mark.parametrize("first_m_s", [0.0, -3.0], ids=["is not turned either", "flies away"])
def test_encounter_is_found_after_a_vehicle_that_is_none(first_m_s: float) -> None:
    # d0 is met head-on by d2, which alone is turned; d1, looked at before, is of no concern to d0
    position = np.array([[-30.0, 0.0, -20.0], [-50.0, 30.0, -20.0], [30.0, 0.0, -20.0]])
    goal = np.array([[30.0, 0.0, -20.0], [-90.0, 30.0, -20.0], [-30.0, 0.0, -20.0]])
    desired = np.array([[3.0, 0.0, 0.0], [first_m_s, 0.0, 0.0], [-3.0, 0.0, 0.0]])
    turned = to_goals(position, goal, desired, turned=[False, first_m_s < 0.0, True])
    assert turned[2] == pytest.approx([-3.0 * np.cos(angle_rad(1.0)), -3.0 * np.sin(angle_rad(1.0)), 0.0])


def test_meeting_far_ahead_turns_none_to_the_right() -> None:
    for ahead_s, share in ((SOON_S, 1.0), (0.5 * (SOON_S + FAR_S), 0.5), (FAR_S, 0.0), (50.0, 0.0)):
        position = np.array([[-3.0 * ahead_s, 0.0, -20.0], [3.0 * ahead_s, 0.0, -20.0]])
        turned = to_goals(position, position[::-1], np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]]))
        assert turned[0, 1] == pytest.approx(3.0 * np.sin(angle_rad(share)))


def turned_early(
    position: Array, goal: Array, desired: Array, *, to_goal: list[bool] | None = None, angle: float = 45.0
) -> Array:
    return turn_early(
        desired,
        position,
        goal,
        to_goal=np.ones(len(position), dtype=bool) if to_goal is None else np.array(to_goal),
        flatness=2.0 / 3.0,
        settings=Traffic(angle_max_deg=angle),
    )


def far_head_on(ahead_s: float = 40.0, miss_m: float = 0.0) -> tuple[Array, Array, Array]:
    """Two at 2 m/s that meet after so long; the second passes to the left of the first."""
    position = np.array([[-2.0 * ahead_s, 0.0, -20.0], [2.0 * ahead_s, -miss_m, -20.0]])
    goal = position * (-1.0, 1.0, 1.0)
    return position, goal, np.array([[2.0, 0.0, 0.0], [-2.0, 0.0, 0.0]])


@pytest.mark.parametrize(("ahead_s", "share"), [(15.9, 0.0), (18.0, 0.5), (20.0, 1.0), (40.0, 1.0)])
def test_far_head_on_pair_turns_right_as_far_as_it_must(ahead_s: float, share: float) -> None:
    position, goal, desired = far_head_on(ahead_s)
    turned = turned_early(position, goal, desired)
    aside_m_s = share * FURTHER * 0.5 * (CLEAR_M + 4.0 * CLEAR_S) / ahead_s
    assert turned[0, 1] / turned[0, 0] == pytest.approx(aside_m_s / 2.0)
    assert turned[1] == pytest.approx(-turned[0])
    assert np.linalg.norm(turned, axis=1) == pytest.approx([2.0, 2.0])


@pytest.mark.parametrize(("miss_m", "side"), [(-5.0, -1.0), (-ASIDE_M + 1.0, 1.0), (5.0, 1.0), (8.0, 0.0)])
def test_far_pair_parts_to_the_side_where_it_passes(miss_m: float, side: float) -> None:
    turned = turned_early(*far_head_on(miss_m=miss_m))
    assert np.sign(turned[:, 1].round(9)).tolist() == [side, -side]


def test_far_pair_above_each_other_parts_in_height() -> None:
    position, goal, desired = far_head_on()
    position[1, 2] = goal[1, 2] = -28.0  # 5.3 m in the floor's metric
    turned = turned_early(position, goal, desired)
    assert turned[0, 2] > 0.02 > -0.02 > turned[1, 2]


def test_far_vertical_pair_parts_to_different_sides() -> None:
    column = np.array([[0.0, 0.0, -20.0], [0.0, 0.0, -120.0]])
    up, down = [0.0, 0.0, -2.0], [0.0, 0.0, 1.5]
    turned = turned_early(column, column[::-1], np.array([up, down]))
    assert turned[0, 1] > 0.1 > -0.1 > turned[1, 1]
    swapped = turned_early(column[::-1].copy(), column, np.array([down, up]))
    assert swapped[::-1].tolist() == turned.tolist()


@pytest.mark.parametrize("far", [[True, False], [False, False]])
def test_no_vehicle_turns_early_without_another_on_its_way(far: list[bool]) -> None:
    position, goal, desired = far_head_on()
    assert turned_early(position, goal, desired, to_goal=far).tolist() == desired.tolist()


def test_no_vehicle_turns_early_at_zero_angle_or_unknown_place() -> None:
    position, goal, desired = far_head_on()
    assert turned_early(position, goal, desired, angle=0.0).tolist() == desired.tolist()
    unknown = np.where([[True], [False]], position, np.nan)
    assert turned_early(unknown, goal, desired).tolist() == desired.tolist()
    assert turned_early(position, unknown * np.nan, desired).tolist() == desired.tolist()


def test_many_that_meet_turn_at_most_by_the_angle() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 300, endpoint=False)
    position = 44.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1) - (0.0, 0.0, 20.0)
    goal = position * (-1.0, -1.0, 1.0)
    desired = 2.0 * (goal - position) / 88.0
    turned = turned_early(position, goal, desired, angle=20.0)
    assert (turned * desired).sum(axis=1) == pytest.approx(np.full(300, 4.0 * np.cos(np.radians(20.0))))
    wider = turned_early(position, goal, desired)
    assert (wider * desired).sum(axis=1).max() < 4.0 * np.cos(np.radians(25.0))


def test_sums_of_cubes_are_those_of_every_pair() -> None:
    """The kernel looks at several pairs at a time."""
    rng, n = np.random.default_rng(5), 60
    position_m = rng.uniform(-60.0, 60.0, (n, 3))
    course_m_s = -position_m / 30.0 + rng.uniform(-0.5, 0.5, (n, 3))
    course_m_s[:5] = course_m_s[0]  # these do not meet each other
    lasts_s = rng.uniform(10.0, 60.0, n)
    expected, pairs = np.zeros((n, 3)), 0
    for i, j in combinations(range(n), 2):
        offset_m, relative_m_s = position_m[j] - position_m[i], course_m_s[j] - course_m_s[i]
        speed_m_s = float(np.linalg.norm(relative_m_s))
        when_s = min(-float(offset_m @ relative_m_s) / speed_m_s**2, *lasts_s[[i, j]]) if speed_m_s else 0.0
        miss_m = offset_m + when_s * relative_m_s
        lack_m = CLEAR_M + CLEAR_S * speed_m_s - float(np.linalg.norm(miss_m))
        if when_s <= SOON_S or lack_m <= 0.0:
            continue
        pairs += 1
        right = np.array([relative_m_s[1], -relative_m_s[0], 0.0]) / np.hypot(*relative_m_s[:2])
        away = ASIDE_M * right - miss_m
        lack_m_s = 0.5 * min(1.0, (when_s - SOON_S) / (FAR_S - SOON_S)) * lack_m / when_s
        cube = lack_m_s**3 * away / np.linalg.norm(away)
        expected[i] += cube
        expected[j] -= cube
    assert pairs > 20
    assert cubes_aside(position_m, course_m_s, lasts_s) == pytest.approx(expected, rel=1e-5, abs=1e-7)


def after_giving_way(
    position: Array,
    goal: Array,
    desired: Array,
    *,
    to_goal: list[bool] | None = None,
    give_way_m: float = 10.0,
) -> Array:
    return give_way(
        desired,
        position,
        goal,
        to_goal=np.ones(len(position), dtype=bool) if to_goal is None else np.array(to_goal),
        flatness=2.0 / 3.0,
        settings=Traffic(give_way_m=give_way_m),
    )


def head_on(apart_m: float) -> tuple[Array, Array, Array]:
    """d0 has 60 m to go, d1 has 6 m: towards each other at 3 m/s."""
    position = np.array([[0.0, 0.0, -20.0], [apart_m, 0.0, -20.0]])
    goal = np.array([[60.0, 0.0, -20.0], [apart_m - 6.0, 0.0, -20.0]])
    return position, goal, np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("apart_m", "expected_m_s"), [(12.0, 3.0), (10.0, 3.0), (9.0, 1.5), (8.0, 0.0), (6.0, -3.0), (5.0, -3.0)]
)
def test_farther_from_goal_stops_closing_on_the_nearer_to_goal(apart_m: float, expected_m_s: float) -> None:
    given = after_giving_way(*head_on(apart_m))
    assert given[0] == pytest.approx([expected_m_s, 0.0, 0.0])
    assert given[1].tolist() == [-3.0, 0.0, 0.0]


def test_giving_way_ignores_the_row_order() -> None:
    position, goal, desired = head_on(5.0)
    given = after_giving_way(position[::-1], goal[::-1], desired[::-1])
    assert given.tolist() == [[-3.0, 0.0, 0.0], pytest.approx([-3.0, 0.0, 0.0])]


def test_vertical_approach_within_the_floor_metric_is_given_up() -> None:
    position = np.array([[0.0, 0.0, -20.0], [0.0, 0.0, -28.5]])  # 5.67 m in the floor's metric
    goal = np.array([[0.0, 0.0, -60.0], [0.0, 0.0, -24.5]])
    given = after_giving_way(position, goal, np.array([[0.0, 0.0, -2.0], [0.0, 0.0, 1.0]]))
    assert given[0] == pytest.approx([0.0, 0.0, 1.0])
    assert given[1].tolist() == [0.0, 0.0, 1.0]


def test_encounter_weight_depends_on_time_not_distance() -> None:
    # 24 m at 6 m/s are 4 s, 3 m at 1 m/s are 3 s, and at 2 m/s they are 1.5 s
    position, goal, _ = head_on(5.0)
    goal[:, 0] = 24.0, 2.0
    slow = np.array([[6.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    assert after_giving_way(position, goal, slow).tolist() == slow.tolist()
    faster = np.array([[6.0, 0.0, 0.0], [-2.0, 0.0, 0.0]])
    assert after_giving_way(position, goal, faster)[0] == pytest.approx([-2.0, 0.0, 0.0])


def test_keeping_right_in_every_direction() -> None:
    # copied, because the kernels would be compiled once more for this order of the array's elements
    position, goal, desired = (array[:, [1, 0, 2]].copy() for array in head_on(9.0))
    assert after_giving_way(position, goal, desired)[0] == pytest.approx([0.0, 1.5, 0.0])


def test_right_of_way_is_found_after_a_vehicle_without_it() -> None:
    position, goal, desired = head_on(5.0)
    others = [[0.0, -4.0, -20.0]], [[60.0, -4.0, -20.0]], [[3.0, 0.0, 0.0]]
    position, goal, desired = (
        np.insert(array, 1, other, axis=0)
        for array, other in zip((position, goal, desired), others, strict=True)
    )
    assert after_giving_way(position, goal, desired)[0] == pytest.approx([-3.0, 0.0, 0.0])


def test_encounter_is_found_among_hundreds() -> None:
    rng = np.random.default_rng(4)
    crowd = rng.normal(0.0, 5.0, (210, 3)) - (0.0, 0.0, 20.0)
    ahead = np.array([60.0, 0.0, 0.0])
    position, goal, desired = (
        np.concatenate([pair, others])
        for pair, others in zip(
            head_on(5.9),
            (crowd, crowd + ahead, np.tile([3.0, 0.0, 0.0], (210, 1))),
            strict=True,
        )
    )
    assert after_giving_way(position, goal, desired)[0] == pytest.approx([-3.0, 0.0, 0.0])


def test_beyond_the_distance_parting_velocity_is_kept() -> None:
    position, goal, desired = head_on(12.0)
    desired[0] = -4.0, 0.0, 0.0
    assert after_giving_way(position, goal, desired).tolist() == desired.tolist()


def test_giving_way_keeps_sideways_velocity() -> None:
    position, goal, desired = head_on(5.0)
    desired[0, 1] = 1.0
    assert after_giving_way(position, goal, desired)[0] == pytest.approx([-3.0, 1.0, 0.0])


@pytest.mark.parametrize(
    "change",
    [
        lambda position, goal, desired: goal.__setitem__((0, 0), 11.9),  # less than twice as far to go
        lambda position, goal, desired: goal.__setitem__((1, 0), -26.0),  # likewise
        lambda position, goal, desired: desired.__setitem__(0, [-4.0, 0.0, 0.0]),  # moves off already
        lambda position, goal, desired: desired.__setitem__(1, [0.1, 0.0, 0.0]),  # stands
        lambda position, goal, desired: position.__setitem__(1, np.nan),
        lambda position, goal, desired: goal.__setitem__(1, np.nan),
    ],
    ids=["as near", "the other as far", "moves off", "the other stands", "unknown place", "unknown goal"],
)
def test_no_way_is_given_without_every_condition(change: Callable[[Array, Array, Array], None]) -> None:
    position, goal, desired = head_on(5.0)
    change(position, goal, desired)
    assert after_giving_way(position, goal, desired).tolist() == desired.tolist()


def test_no_way_is_given_without_a_goal_or_at_zero_distance() -> None:
    position, goal, desired = head_on(5.0)
    assert after_giving_way(position, goal, desired, to_goal=[True, False]).tolist() == desired.tolist()
    assert after_giving_way(position, goal, desired, to_goal=[False, True]).tolist() == desired.tolist()
    assert after_giving_way(position, goal, desired, give_way_m=0.0).tolist() == desired.tolist()


@pytest.mark.parametrize("reverse", [False, True])
def test_way_is_given_to_the_fastest_approaching_of_two(reverse: bool) -> None:
    position = np.array([[0.0, 0.0, -20.0], [5.0, 0.0, -20.0], [0.0, 7.0, -20.0]])
    goal = np.array([[60.0, 1.0, -20.0], [1.0, 0.0, -20.0], [0.0, 3.0, -20.0]])
    desired = np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0], [0.0, -3.0, 0.0]])
    rows = [0, 2, 1] if reverse else [0, 1, 2]
    given = after_giving_way(position[rows], goal[rows], desired[rows])
    assert given[0] == pytest.approx([-3.0, 0.0, 0.0])


def test_coincident_vehicles_give_no_way() -> None:
    position, goal, desired = head_on(0.0)
    assert after_giving_way(position, goal, desired).tolist() == desired.tolist()


def test_giving_way_may_begin_at_one_metre() -> None:
    position, goal, desired = head_on(0.4)
    near = Traffic(give_way_m=1.0, give_way_fully_m=0.5)
    all_vehicles = np.ones(2, dtype=bool)
    given = give_way(desired, position, goal, to_goal=all_vehicles, flatness=1.0, settings=near)
    assert given[0] == pytest.approx([-3.0, 0.0, 0.0])


def test_giving_way_begins_gradually() -> None:
    with pytest.raises(ValidationError, match="give_way_m 5 must be more than give_way_fully_m 6, or 0"):
        Traffic(give_way_m=5.0)
    for not_enough_m in (6.0, 0.5):
        with pytest.raises(ValidationError, match="must be more than"):
            Traffic(give_way_m=not_enough_m)
    assert Traffic(give_way_m=0.0).give_way_m == 0.0


def test_vehicle_just_passed_is_no_encounter() -> None:
    abeam = np.array([[0.0, 0.0, -20.0], [0.0, 4.0, -20.0]])
    desired = np.array([[3.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    goal = np.array([[30.0, 0.0, -20.0], [0.0, 4.0, -20.0]])
    assert to_goals(abeam, goal, desired, turned=[True, False]).tolist() == desired.tolist()


def test_side_by_side_at_half_a_millimetre_per_second_is_none() -> None:
    position = np.array([[0.0, 0.0, -20.0], [0.0, 5.0, -20.0]])
    desired = np.array([[3.0, 0.0, 0.0], [3.0, -5e-4, 0.0]])
    goal = np.array([[30.0, 0.0, -20.0], [30.0, 5.0, -20.0]])
    assert to_goals(position, goal, desired).tolist() == desired.tolist()


def test_meetings_are_those_of_every_pair() -> None:
    """The kernel sums pairs in another order, several at a time."""
    rng, n, passing_m = np.random.default_rng(3), 60, 8.0
    position_m, course_m_s = rng.uniform(-30.0, 30.0, (n, 3)), rng.uniform(-4.0, 4.0, (n, 3))
    course_m_s[:5] = course_m_s[0]  # these do not meet each other
    lasts_s, turned = rng.uniform(0.0, 10.0, n), rng.random(n) < 0.7
    members = np.flatnonzero(rng.random(n) < 0.9)
    expected = np.zeros(n)
    for i, j in combinations(members.tolist(), 2):
        if not (turned[i] or turned[j]):
            continue
        offset_m, relative_m_s = position_m[j] - position_m[i], course_m_s[j] - course_m_s[i]
        square = float(relative_m_s @ relative_m_s)
        when_s = min(-float(offset_m @ relative_m_s) / square, lasts_s[i], lasts_s[j]) if square else 0.0
        if when_s > 0.0:
            passed_m = np.linalg.norm(offset_m + when_s * relative_m_s)
            expected[[i, j]] += max(0.0, 1.0 - float(passed_m / passing_m) ** 2)
    assert (expected > 0.0).sum() > 20
    found = count_meetings(members, turned, position_m, course_m_s, lasts_s, passing_m)
    assert found == pytest.approx(expected, abs=1e-5)  # in single precision
