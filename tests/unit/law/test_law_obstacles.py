"""Ellipses, tangents and avoidance (article, section 4, corrected)."""

from math import cos, pi, sin, sqrt

import numpy as np
import pytest

from gcs.formation.law import LawSettings, avoid_all, update_sides
from gcs.formation.obstacles import (
    LEFT,
    RIGHT,
    AvoidanceSettings,
    Ellipse,
    avoid,
    choose_side,
    heads_into,
    tangent_directions,
    tangent_points_m,
)
from gcs.formation.orbit import Center
from gcs.plan import Obstacle
from gcs.state import Array

AVOIDANCE = AvoidanceSettings(
    margin_m=2.0, headroom_m=3.0, lookahead_m=12.0, near_m=3.0, push_rate_per_s=0.5, lead_out_m_s=1.5
)
LAW = LawSettings(avoidance=AVOIDANCE)
BOX = Obstacle("b", x_m=10.0, y_m=-5.0, half_length_x_m=2.0, half_length_y_m=4.0, height_m=20.0)
AROUND = Ellipse.around(BOX, margin_m=2.0, headroom_m=3.0)
UNIT = Ellipse(0.0, 0.0, 1.0, 1.0, 100.0)
ROUND = Ellipse(0.0, 0.0, 5.0, 5.0, 20.0)
OUTSIDE = np.array([[30.0, 10.0, -5.0], [10.0, -40.0, -5.0], [-4.0, -6.0, -5.0], [10.0, 9.0, -5.0]])


def flown(position: Array, velocity: Array, *, side: float = 0.0, sliding_m_s: float = 0.0) -> Array:
    """What avoidance of ROUND makes of one drone's velocity."""
    result: Array = avoid(
        position[None],
        velocity[None],
        ROUND,
        AVOIDANCE,
        side=np.array([side]),
        sliding_m_s=np.array([sliding_m_s]),
    )[0]
    return result


def test_the_ellipse_is_the_articles_around_the_grown_box() -> None:
    assert (AROUND.semi_x_m, AROUND.semi_y_m) == pytest.approx((sqrt(2) * 4.0, sqrt(2) * 6.0))
    assert AROUND.top_height_m == 23.0


def test_the_ellipse_leaves_the_margin_everywhere_around_the_box() -> None:
    angle_rad = np.linspace(0.0, 2 * pi, 721)
    contour = np.stack([AROUND.semi_x_m * np.cos(angle_rad), AROUND.semi_y_m * np.sin(angle_rad)], axis=1)
    beyond = np.maximum(np.abs(contour) - (BOX.half_length_x_m, BOX.half_length_y_m), 0.0)
    assert np.linalg.norm(beyond, axis=1).min() >= 2.0 - 1e-9


def test_tangent_points_of_a_circle_are_those_of_the_textbook() -> None:
    # from (2, 0) to the unit circle: (1/2, +-sqrt(3)/2); left, looking along -x with y to the right, is... +y
    left, right = tangent_points_m(UNIT, np.array([[2.0, 0.0]]))
    assert left == pytest.approx(np.array([[0.5, sqrt(3) / 2]]))
    assert right == pytest.approx(np.array([[0.5, -sqrt(3) / 2]]))


@pytest.mark.parametrize("which", [0, 1])
def test_tangent_points_lie_on_the_ellipse_and_the_lines_touch_it_there(which: int) -> None:
    touch = tangent_points_m(AROUND, OUTSIDE)[which]
    assert (AROUND.normalised(touch) ** 2).sum(axis=1) == pytest.approx(np.ones(len(OUTSIDE)))
    along = touch - OUTSIDE[:, :2]
    assert (AROUND.outward(touch) * along).sum(axis=1) == pytest.approx(np.zeros(len(OUTSIDE)), abs=1e-9)


@pytest.mark.parametrize("which", [0, 1])
def test_tangent_directions_are_unit_vectors_that_point_ahead_to_the_tangent_point(which: int) -> None:
    direction = tangent_directions(AROUND, OUTSIDE)[which]
    along = tangent_points_m(AROUND, OUTSIDE)[which] - OUTSIDE[:, :2]
    assert np.linalg.norm(direction, axis=1) == pytest.approx(np.ones(len(OUTSIDE)))
    assert (direction * along).sum(axis=1) == pytest.approx(np.linalg.norm(along, axis=1))
    assert ((AROUND.outward(OUTSIDE) * direction).sum(axis=1) < 0.0).all()


def test_left_and_right_are_as_the_one_who_passes_sees_them() -> None:
    # looking along +x with y to the right: left is -y
    left, right = tangent_directions(ROUND, np.array([[-20.0, 0.0, -5.0]]))
    assert left[0, 1] < 0.0 < right[0, 1]


def test_on_and_inside_the_ellipse_the_directions_follow_its_contour() -> None:
    place = np.array([[-5.0, 0.0, -5.0], [-2.0, 0.0, -5.0]])
    left, right = tangent_directions(ROUND, place)
    assert left == pytest.approx(np.array([[0.0, -1.0], [0.0, -1.0]]), abs=1e-9)
    assert right == pytest.approx(np.array([[0.0, 1.0], [0.0, 1.0]]), abs=1e-9)


def test_distance_is_exact_for_a_circle_and_along_the_axes() -> None:
    assert ROUND.distance_m(np.array([[3.0, 4.0], [6.0, 8.0], [1.5, 2.0]])) == pytest.approx([0.0, 5.0, -2.5])
    assert AROUND.distance_m(np.array([[10.0 + AROUND.semi_x_m + 7.0, -5.0]])) == pytest.approx([7.0])


def test_distance_never_promises_more_room_than_there_is() -> None:
    contour_rad = np.linspace(0.0, 2 * pi, 3601)
    contour = np.array([10.0, -5.0]) + np.stack(
        [AROUND.semi_x_m * np.cos(contour_rad), AROUND.semi_y_m * np.sin(contour_rad)], axis=1
    )
    places = np.array([[10.0 + 14.0 * cos(a), -5.0 + 14.0 * sin(a)] for a in np.linspace(0.0, 6.0, 25)])
    true_m = np.linalg.norm(places[:, None] - contour[None], axis=2).min(axis=1)
    assert (AROUND.distance_m(places) <= true_m + 1e-3).all()


def test_the_very_centre_is_inside_and_has_a_way_out() -> None:
    center = np.array([[10.0, -5.0, -5.0]])
    assert AROUND.distance_m(center) == pytest.approx([-AROUND.semi_x_m])
    assert AROUND.outward(center) == pytest.approx(np.array([[1.0, 0.0]]))
    assert AROUND.contains(center).all()
    assert not AROUND.contains(OUTSIDE).any()


def test_who_heads_into_the_ellipse_is_between_its_tangents() -> None:
    place = np.tile(np.array([-20.0, 0.0, -5.0]), (5, 1))
    half_rad = np.arcsin(5.0 / 20.0)
    angles_rad = np.array([0.0, half_rad - 0.01, half_rad + 0.01, pi, 0.0])
    velocity = np.stack([np.cos(angles_rad), np.sin(angles_rad), np.zeros(5)], axis=1)
    velocity[4] = 0.0
    assert heads_into(ROUND, place, velocity).tolist() == [True, True, False, False, False]


def test_near_the_obstacle_the_velocity_is_turned_along_the_tangent() -> None:
    place = np.array([-8.0, 0.1, -5.0])  # just inside near_m: only the tangent counts
    result = flown(place, np.array([2.0, 0.0, -0.5]), side=RIGHT, sliding_m_s=2.0)
    right = tangent_directions(ROUND, place[None])[1][0]
    pushed = result[:2] - 2.0 * right
    assert result[2] == -0.5
    assert np.linalg.norm(pushed) == pytest.approx(0.0, abs=0.01)


def test_between_lookahead_and_near_both_count() -> None:
    place = np.array([-5.0 - 7.5, 0.0, -5.0])  # half way: 7.5 m, between 12 and 3
    result = flown(place, np.array([2.0, 0.0, 0.0]), side=LEFT, sliding_m_s=2.0)
    left = tangent_directions(ROUND, place[None])[0][0]
    assert result[:2] == pytest.approx((np.array([2.0, 0.0]) + 2.0 * left) / 2)


@pytest.mark.parametrize(
    ("place", "velocity"),
    [
        ((-18.0, 0.0, -5.0), (2.0, 0.0, 0.0)),  # too far to bother
        ((-8.5, 0.0, -5.0), (-2.0, 0.0, 0.0)),  # flies away
        ((-8.5, 0.0, -5.0), (0.0, 2.0, 0.0)),  # passes by
        ((-2.0, 0.0, -20.5), (2.0, 0.0, 0.0)),  # well above the box
    ],
)
def test_who_need_not_avoid_is_left_alone(
    place: tuple[float, float, float], velocity: tuple[float, float, float]
) -> None:
    assert flown(np.array(place), np.array(velocity)).tolist() == list(velocity)


@pytest.mark.parametrize("place", [(-4.9, 0.0, -5.0), (0.0, 0.0, -5.0), (1.0, 2.0, -19.0)])
def test_one_inside_is_led_out_whatever_it_wants(place: tuple[float, float, float]) -> None:
    for angle_rad in np.linspace(0.0, 2 * pi, 9):
        here = np.array(place)
        result = flown(here, np.array([3.0 * cos(angle_rad), 3.0 * sin(angle_rad), 0.0]))
        assert result[:2] @ ROUND.outward(here[None])[0] >= AVOIDANCE.lead_out_m_s - 1e-9


def test_with_no_side_given_the_tangent_that_loses_less_is_taken() -> None:
    place = np.array([-8.0, 0.0, -5.0])
    assert flown(place, np.array([2.0, 0.4, 0.0]))[1] > 0.4
    assert flown(place, np.array([2.0, -0.4, 0.0]))[1] < -0.4


def test_straight_at_the_obstacle_one_waits_or_slides_as_told() -> None:
    place, straight = np.array([-6.0, 0.0, -5.0]), np.array([1.0, 0.0, 0.0])
    assert np.hypot(*flown(place, straight, sliding_m_s=3.0)[:2]) > 2.5
    assert np.hypot(*flown(place, straight, sliding_m_s=0.0)[:2]) < 1.5


def test_the_side_that_turns_the_formation_least_is_chosen() -> None:
    center = np.array([-20.0, -2.0, -10.0])
    assert choose_side(ROUND, center, np.array([2.0, 0.0, 0.0])) == LEFT
    assert choose_side(ROUND, center * (1, -1, 1), np.array([2.0, 0.0, 0.0])) == RIGHT


@pytest.mark.parametrize("turn_rad", np.linspace(-pi, pi, 9))
def test_the_choice_does_not_flip_where_angles_wrap(turn_rad: float) -> None:
    c, s = cos(turn_rad), sin(turn_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    assert choose_side(ROUND, turn @ (-20.0, -2.0, -10.0), turn @ (2.0, 0.0, 0.0)) == LEFT


def test_the_whole_formation_passes_on_one_side_and_keeps_to_it() -> None:
    swarm = np.array([[-11.0, -4.0, -5.0], [-11.0, 4.0, -5.0], [-14.0, 0.0, -5.0]])
    center = Center(swarm.mean(axis=0) + np.array([0.0, 0.5, 0.0]), np.array([2.0, 0.0, 0.0]), np.zeros(3))
    wanted = np.array([2.0, 0.0, 0.0])
    ellipses = {"r": ROUND}
    chosen = update_sides({}, ellipses, swarm, center, wanted, LAW)
    assert chosen == {"r": RIGHT}
    kept = update_sides(chosen, ellipses, swarm * (1, -1, 1), center, wanted * (1, -1, 1), LAW)
    assert kept == chosen
    around = avoid_all(swarm, np.tile(wanted, (3, 1)), ellipses, chosen, np.full(3, 2.0), LAW)
    assert (around[:, 1] > 0.0).all()


def test_a_side_is_chosen_only_near_and_forgotten_once_past() -> None:
    ellipses, wanted = {"r": ROUND}, np.array([2.0, 0.0, 0.0])
    far = np.array([[-60.0, 1.0, -5.0]])
    beside = np.array([[-15.0, 1.0, -5.0]])
    assert update_sides({}, ellipses, far, Center.at_rest(far[0]), wanted, LAW) == {}
    assert update_sides({"r": LEFT}, ellipses, far, Center.at_rest(far[0]), wanted, LAW) == {}
    assert update_sides({}, ellipses, beside, Center.at_rest(beside[0]), -wanted, LAW) == {}
    assert update_sides({"r": LEFT}, ellipses, beside, Center.at_rest(beside[0]), -wanted, LAW) == {"r": LEFT}


def test_the_nearest_of_several_obstacles_has_the_last_word() -> None:
    near = Ellipse(5.0, 0.0, 3.0, 3.0, 100.0)
    far = Ellipse(14.0, 3.0, 4.0, 4.0, 100.0)
    place = np.array([[-0.5, 0.0, -5.0]])
    wanted = np.array([[2.0, 0.0, 0.0]])
    around = avoid_all(place, wanted, {"near": near, "far": far}, {}, np.array([2.0]), LAW)
    reordered = avoid_all(place, wanted, {"far": far, "near": near}, {}, np.array([2.0]), LAW)
    assert around == pytest.approx(reordered)
    assert not heads_into(near, place, around)[0]


def test_obstacles_out_of_everybodys_reach_cost_nothing_and_change_nothing() -> None:
    random = np.random.default_rng(4)
    ellipses = {
        str(index): Ellipse(x_m, y_m, 4.0, 6.0, 100.0)
        for index, (x_m, y_m) in enumerate(random.uniform(-60.0, 60.0, (32, 2)).tolist())
    }
    place, wanted = random.normal(size=(8, 3)) * 12.0, random.normal(size=(8, 3)) * 3.0
    place[:, 2] -= 30.0
    slides = np.full(8, 2.0)
    by_distance = sorted(ellipses, key=lambda name: -float(ellipses[name].distance_m(place).min()))
    expected, near = wanted, 0
    for name in by_distance:
        before, near = expected, near + int(ellipses[name].distance_m(place).min() < 12.0)
        expected = avoid(place, before, ellipses[name], LAW.avoidance, side=np.zeros(8), sliding_m_s=slides)
    assert 0 < near < 32
    assert avoid_all(place, wanted, ellipses, {}, slides, LAW).tolist() == expected.tolist()
