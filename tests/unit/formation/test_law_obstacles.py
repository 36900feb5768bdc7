"""Ellipses, tangents and avoidance (article, section 4, corrected)."""

from math import cos, inf, pi, sin, sqrt

import numpy as np
import pytest

from gcs.formation.obstacles import AvoidanceSettings, Ellipse, Outlines
from gcs.formation.steering import LEFT, RIGHT, STEERED_MOST, avoid_all, contact_m, tangent
from gcs.model.plan import Obstacle
from gcs.model.state import Array
from gcs.simulation.article import Way, steer_center
from tests.support.law_fleets import met_m, tangent_of

AVOIDANCE = AvoidanceSettings(
    margin_m=2.0, headroom_m=3.0, lookahead_m=12.0, near_m=3.0, push_rate_per_s=0.5, lead_out_m_s=1.5
)
BOX = Obstacle("b", x_m=10.0, y_m=-5.0, half_length_x_m=2.0, half_length_y_m=4.0, height_m=20.0)
AROUND = Ellipse.around(BOX, margin_m=2.0, headroom_m=3.0)
ROUND = Ellipse(0.0, 0.0, 5.0, 5.0, 20.0)
OUTSIDE = np.array([[30.0, 10.0, -5.0], [10.0, -40.0, -5.0], [-4.0, -6.0, -5.0], [10.0, 9.0, -5.0]])
BEHIND = Way(np.array([60.0, 0.0]), 80.0)


def flown(
    position: Array,
    velocity: Array,
    *,
    side: float = 0.0,
    sliding_m_s: float = 0.0,
    ellipses: dict[str, Ellipse] | None = None,
) -> Array:
    """What avoidance of ROUND, or of others, makes of one drone's velocity."""
    ellipses = ellipses or {"r": ROUND}
    sides = {name: side for name in ellipses if side}
    result: Array = avoid_all(
        position[None], velocity[None], ellipses, sides, np.array([sliding_m_s]), AVOIDANCE
    )[0]
    return result


def led(
    center: Array,
    desired: Array,
    ellipses: dict[str, Ellipse],
    sides: dict[str, float] | None = None,
    *,
    way: Way = BEHIND,
    radius_m: float = 10.0,
) -> tuple[Array, dict[str, float]]:
    """Where the centre of a sphere is led."""
    drones = center + radius_m * np.vstack([np.eye(3), -np.eye(3)])
    return steer_center(center, desired, drones, ellipses, sides or {}, AVOIDANCE, radius_m=radius_m, way=way)


def test_ellipse_is_the_articles_around_the_grown_box() -> None:
    assert (AROUND.semi_x_m, AROUND.semi_y_m) == pytest.approx((sqrt(2) * 4.0, sqrt(2) * 6.0))
    assert AROUND.top_height_m == 23.0


def test_the_ellipse_leaves_the_margin_everywhere_around_the_box() -> None:
    angle_rad = np.linspace(0.0, 2 * pi, 721)
    contour = np.stack([AROUND.semi_x_m * np.cos(angle_rad), AROUND.semi_y_m * np.sin(angle_rad)], axis=1)
    beyond = np.maximum(np.abs(contour) - (BOX.half_length_x_m, BOX.half_length_y_m), 0.0)
    assert np.linalg.norm(beyond, axis=1).min() >= 2.0 - 1e-9


def test_tangents_of_a_circle_are_those_of_the_textbook() -> None:
    # from (2, 0) to the unit circle: (1/2, +-sqrt(3)/2); left, looking along -x with y to the right, is... +y
    assert tangent(2.0, 0.0, 1.0, 1.0, LEFT) == pytest.approx((-sqrt(3) / 2, 0.5))
    assert tangent(2.0, 0.0, 1.0, 1.0, RIGHT) == pytest.approx((-sqrt(3) / 2, -0.5))


@pytest.mark.parametrize("side", [LEFT, RIGHT])
def test_tangent_misses_the_ellipse_and_inside_of_it_one_meets(side: float) -> None:
    for place in OUTSIDE:
        ahead = tangent_of(AROUND, place, side)
        for off_rad, meets in ((1e-3, side == LEFT), (-1e-3, side == RIGHT)):
            turned = ahead + off_rad * np.array([-ahead[1], ahead[0]])
            assert (met_m(AROUND, place, turned) < inf) == meets


def test_left_and_right_are_seen_from_the_passing_vehicle() -> None:
    # looking along +x with y to the right: left is -y
    assert tangent(-20.0, 0.0, 5.0, 5.0, LEFT)[1] < 0.0 < tangent(-20.0, 0.0, 5.0, 5.0, RIGHT)[1]


@pytest.mark.parametrize("x_m", [-5.0, -2.0])
def test_on_and_inside_the_ellipse_tangents_follow_the_contour(x_m: float) -> None:
    assert tangent(x_m, 0.0, 5.0, 5.0, LEFT) == pytest.approx((0.0, -1.0), abs=1e-9)
    assert tangent(x_m, 0.0, 5.0, 5.0, RIGHT) == pytest.approx((0.0, 1.0), abs=1e-9)


def test_at_the_exact_centre_there_is_a_tangent() -> None:
    assert tangent(0.0, 0.0, 5.0, 5.0, LEFT) == (0.0, 1.0)


def test_contact_is_the_distance_flown_to_the_ellipse() -> None:
    assert contact_m(-20.0, 0.0, 5.0, 5.0, 3.0, 0.0) == pytest.approx(15.0)
    assert contact_m(-20.0, 3.0, 5.0, 5.0, 0.1, 0.0) == pytest.approx(16.0)
    assert contact_m(-20.0, 5.1, 5.0, 5.0, 3.0, 0.0) == inf
    assert contact_m(-20.0, 0.0, 5.0, 5.0, -3.0, 0.0) == inf
    assert contact_m(-20.0, 0.0, 5.0, 5.0, 0.0, 0.0) == inf
    assert contact_m(-4.0, 0.0, 5.0, 5.0, 1.0, 0.0) == 0.0
    assert contact_m(-4.0, 0.0, 5.0, 5.0, -1.0, 0.0) == inf


def test_moving_box_is_where_dead_reckoning_says() -> None:
    box = Obstacle("b", 1.0, 2.0, 3.0, 4.0, 5.0, velocity_x_m_s=0.5, velocity_y_m_s=-1.0, time_s=10.0)
    reported = Ellipse.around(box, margin_m=2.0, headroom_m=3.0)
    later = Ellipse.around(box, margin_m=2.0, headroom_m=3.0, time_s=14.0)
    assert (reported.x_m, reported.y_m) == (1.0, 2.0)
    assert (later.x_m, later.y_m) == (3.0, -2.0)
    assert (later.velocity_x_m_s, later.velocity_y_m_s) == (0.5, -1.0)


def test_distances_to_many_outlines_equal_those_of_each() -> None:
    outlines = Outlines.of({"r": ROUND, "a": AROUND})
    places = np.vstack([OUTSIDE, [(0.0, 0.0, -5.0), (10.0, -5.0, -5.0)]])
    for count in range(len(places) + 1):
        expected = [e.distance_m(places[:count]).min(initial=inf) for e in (ROUND, AROUND)]
        assert outlines.nearest_m(places[:count]) == pytest.approx(expected)
    assert outlines.half_length_m[1] == pytest.approx([4.0, 6.0])
    assert outlines.only(np.array([False, True])).names == ("a",)


def test_distance_is_exact_for_a_circle_and_along_the_axes() -> None:
    assert ROUND.distance_m(np.array([[3.0, 4.0], [6.0, 8.0], [1.5, 2.0]])) == pytest.approx([0.0, 5.0, -2.5])
    assert AROUND.distance_m(np.array([[10.0 + AROUND.semi_x_m + 7.0, -5.0]])) == pytest.approx([7.0])


def test_distance_is_never_overestimated() -> None:
    contour_rad = np.linspace(0.0, 2 * pi, 3601)
    contour = np.array([10.0, -5.0]) + np.stack(
        [AROUND.semi_x_m * np.cos(contour_rad), AROUND.semi_y_m * np.sin(contour_rad)], axis=1
    )
    places = np.array([[10.0 + 14.0 * cos(a), -5.0 + 14.0 * sin(a)] for a in np.linspace(0.0, 6.0, 25)])
    true_m = np.linalg.norm(places[:, None] - contour[None], axis=2).min(axis=1)
    assert (AROUND.distance_m(places) <= true_m + 1e-3).all()


def test_exact_centre_is_inside_and_has_a_way_out() -> None:
    center = np.array([[10.0, -5.0, -5.0]])
    assert AROUND.distance_m(center) == pytest.approx([-AROUND.semi_x_m])
    assert AROUND.outward(center) == pytest.approx(np.array([[1.0, 0.0]]))
    assert AROUND.contains(center).all()
    assert not AROUND.contains(OUTSIDE).any()


def test_near_the_obstacle_velocity_turns_along_the_tangent() -> None:
    place = np.array([-8.0, 0.1, -5.0])  # just at near_m: only the tangent counts
    result = flown(place, np.array([2.0, 0.0, -0.5]), side=RIGHT, sliding_m_s=2.0)
    right = np.array(tangent(-8.0, 0.1, 5.0, 5.0, RIGHT))
    assert result[2] == -0.5
    assert np.linalg.norm(result[:2] - 2.0 * right) == pytest.approx(0.0, abs=0.01)


def test_between_lookahead_and_near_both_count() -> None:
    place = np.array([-5.0 - 7.5, 0.0, -5.0])  # half way: 7.5 m, between 12 and 3
    result = flown(place, np.array([2.0, 0.0, 0.0]), side=LEFT, sliding_m_s=2.0)
    left = np.array(tangent(-12.5, 0.0, 5.0, 5.0, LEFT))
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
def test_vehicle_without_an_encounter_is_left_alone(
    place: tuple[float, float, float], velocity: tuple[float, float, float]
) -> None:
    assert flown(np.array(place), np.array(velocity)).tolist() == list(velocity)


@pytest.mark.parametrize("place", [(-4.9, 0.0, -5.0), (0.0, 0.0, -5.0), (1.0, 2.0, -19.0)])
def test_vehicle_inside_is_led_out_whatever_its_velocity(place: tuple[float, float, float]) -> None:
    for angle_rad in np.linspace(0.0, 2 * pi, 9):
        here = np.array(place)
        result = flown(here, np.array([3.0 * cos(angle_rad), 3.0 * sin(angle_rad), 0.0]))
        assert result[:2] @ ROUND.outward(here[None])[0] >= AVOIDANCE.lead_out_m_s - 1e-9


def test_without_a_side_the_smaller_change_is_taken() -> None:
    place = np.array([-8.0, 0.0, -5.0])
    assert flown(place, np.array([2.0, 0.4, 0.0]))[1] > 0.4
    assert flown(place, np.array([2.0, -0.4, 0.0]))[1] < -0.4


def test_straight_at_the_obstacle_it_waits_or_slides_as_set() -> None:
    place, straight = np.array([-6.0, 0.0, -5.0]), np.array([1.0, 0.0, 0.0])
    assert np.hypot(*flown(place, straight, sliding_m_s=3.0)[:2]) > 2.5
    assert np.hypot(*flown(place, straight, sliding_m_s=0.0)[:2]) < 1.5


def test_notch_between_overlapping_obstacles_is_left_outwards() -> None:
    pair = {"a": Ellipse(0.0, -4.0, 5.0, 5.0, 20.0), "b": Ellipse(0.0, 4.0, 5.0, 5.0, 20.0)}
    notch = np.array([-3.2, 0.0, -5.0])
    for side in (LEFT, RIGHT):
        result = flown(notch, np.array([2.0, 0.0, 0.0]), side=side, sliding_m_s=2.0, ellipses=pair)
        assert result[0] < 0.0
        assert result[1] * side > 0.5


def test_of_two_ellipses_in_a_row_neither_is_entered() -> None:
    near, far = Ellipse(5.0, 0.0, 3.0, 3.0, 100.0), Ellipse(14.0, 3.0, 4.0, 4.0, 100.0)
    place, desired = np.array([-0.5, 0.0, -5.0]), np.array([2.0, 0.0, 0.0])
    around = flown(place, desired, sliding_m_s=2.0, ellipses={"near": near, "far": far})
    again = flown(place, desired, sliding_m_s=2.0, ellipses={"far": far, "near": near})
    assert around == pytest.approx(again)
    for ellipse in (near, far):
        assert met_m(ellipse, place, around, 0.99) == inf


def test_moving_obstacle_is_passed_on_the_relative_tangent() -> None:
    crossing = Ellipse(8.0, -8.0, 3.0, 3.0, 100.0, 0.0, 1.5)  # would be in the way just in time
    place, desired = np.array([2.0, 0.0, -5.0]), np.array([2.0, 0.0, 0.0])
    around = flown(place, desired, sliding_m_s=2.0, ellipses={"c": crossing})
    assert around.tolist() != desired.tolist()
    still = flown(place, desired, sliding_m_s=2.0, ellipses={"c": Ellipse(8.0, -8.0, 3.0, 3.0, 100.0)})
    assert still.tolist() == desired.tolist()


def test_resting_vehicle_avoids_an_approaching_obstacle() -> None:
    coming = Ellipse(-8.0, 1.0, 4.0, 4.0, 100.0, 2.0, 0.0)
    away = flown(np.array([0.0, 0.0, -5.0]), np.zeros(3), ellipses={"c": coming})
    assert away[1] < -0.3
    assert np.hypot(away[0], away[1]) < 2.0


def test_side_that_turns_the_formation_least_is_kept() -> None:
    center, desired = np.array([-40.0, -2.0, -10.0]), np.array([2.0, 0.0, 0.0])
    around, sides = led(center, desired, {"r": ROUND})
    assert sides == {"r": LEFT}
    assert around[1] < 0.0
    assert led(center * (1, -1, 1), desired, {"r": ROUND})[1] == {"r": RIGHT}
    kept, still = led(center * (1, -1, 1), desired, {"r": ROUND}, sides)
    assert still == sides
    assert kept[1] < 0.0


@pytest.mark.parametrize("turn_rad", np.linspace(-pi, pi, 9))
def test_choice_does_not_flip_where_angles_wrap(turn_rad: float) -> None:
    c, s = cos(turn_rad), sin(turn_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    way = Way(turn[:2, :2] @ (60.0, 0.0), 80.0)
    _, sides = led(turn @ (-40.0, -2.0, -10.0), turn @ (2.0, 0.0, 0.0), {"r": ROUND}, way=way)
    assert sides == {"r": LEFT}


def test_all_drones_of_a_formation_pass_on_the_side_it_chose() -> None:
    swarm = np.array([[-11.0, -4.0, -5.0], [-11.0, 4.0, -5.0], [-14.0, 0.0, -5.0]])
    desired = np.tile([2.0, 0.0, 0.0], (3, 1))
    around = avoid_all(swarm, desired, {"r": ROUND}, {"r": RIGHT}, np.full(3, 2.0), AVOIDANCE)
    assert (around[:, 1] > 0.0).all()


def test_a_column_beyond_the_slot_turns_no_vehicle() -> None:
    place, desired = np.array([[-14.0, 1.0, -5.0]]), np.array([[2.0, 0.0, 0.0]])
    column = Ellipse(0.0, 0.0, 5.0, 5.0, 20.0, beside_slots=True)
    around = {
        until_m: avoid_all(place, desired, {"r": column}, {}, np.zeros(1), AVOIDANCE, np.array([until_m]))
        for until_m in (8.0, 9.6, 10.2, 60.0)  # the ellipse is met after 9.1 m
    }
    assert (around[8.0] == desired).all()
    assert 0.0 < abs(around[9.6][0, 1]) < abs(around[10.2][0, 1])
    assert (around[10.2] == around[60.0]).all()
    past_box = avoid_all(place, desired, {"r": ROUND}, {}, np.zeros(1), AVOIDANCE, np.array([8.0]))
    assert (past_box == around[60.0]).all(), "boxes may move"


def test_a_column_beside_which_slots_lie_pushes_no_vehicle() -> None:
    place, along = np.array([[-6.0, 0.0, -5.0]]), np.array([[0.0, 1.0, 0.0]])
    column = Ellipse(0.0, 0.0, 5.0, 5.0, 20.0, beside_slots=True)
    pushed, passing = (
        avoid_all(place, along, {"r": each}, {}, np.zeros(1), AVOIDANCE) for each in (ROUND, column)
    )
    assert pushed[0, 0] < 0.0
    assert (passing == along).all()


def test_the_centre_keeps_the_whole_sphere_clear() -> None:
    center, desired = np.array([-40.0, -2.0, -10.0]), np.array([2.0, 0.0, 0.0])
    for _ in range(400):
        center = center + 0.2 * led(center, desired, {"r": ROUND}, {"r": LEFT})[0]
        assert np.hypot(*center[:2]) > 5.0 + 10.0 + 2.5
        toward = np.array([60.0, 0.0, -10.0]) - center
        desired = 2.0 * toward / max(float(np.linalg.norm(toward)), 2.0)
    assert center == pytest.approx([60.0, 0.0, -10.0], abs=0.5)


def test_sphere_mostly_above_the_box_counts_only_below_its_top() -> None:
    desired = np.array([2.0, 0.0, 0.0])
    assert led(np.array([-40.0, 10.0, -21.0]), desired, {"r": ROUND})[0][1] > 0.0
    assert led(np.array([-40.0, 10.0, -29.9]), desired, {"r": ROUND})[0].tolist() == desired.tolist()
    assert led(np.array([-40.0, 0.0, -30.1]), desired, {"r": ROUND})[0].tolist() == desired.tolist()


def test_close_destination_is_reached_and_inside_is_not_circled() -> None:
    desired = np.array([2.0, 0.0, 0.0])
    beside = Way(np.array([-9.0, 0.0]), 3.0)
    assert (
        led(np.array([-12.0, 0.0, -10.0]), desired, {"r": ROUND}, way=beside)[0].tolist() == desired.tolist()
    )
    within = Way(np.array([0.0, 0.0]), 5.5)
    waits, _ = led(np.array([-5.5, 0.0, -10.0]), np.array([2.0, 0.0, 0.0]), {"r": ROUND}, way=within)
    assert np.hypot(waits[0], waits[1]) < 0.9


def test_side_is_forgotten_when_clear_and_the_path_is_free() -> None:
    desired = np.array([2.0, 0.0, 0.0])
    assert led(np.array([60.0, 1.0, -5.0]), desired, {"r": ROUND}, {"r": LEFT})[1] == {}
    assert led(np.array([20.0, 1.0, -5.0]), desired, {"r": ROUND}, {"r": LEFT})[1] == {"r": LEFT}
    assert led(np.array([-15.0, 1.0, -5.0]), -desired, {"r": ROUND})[1] == {}


def test_chosen_side_is_kept_although_turning_back_is_shorter() -> None:
    boxes = (
        Obstacle("by", -11.3, 84.5, 4.8, 4.4, 32.8),
        Obstacle("ahead", -4.8, 120.5, 3.6, 2.5, 40.2),
        Obstacle("beyond", -14.6, 77.0, 4.3, 6.4, 22.1),
        Obstacle("far", -22.1, 79.6, 7.9, 5.9, 21.2),
    )
    ellipses = {box.id: Ellipse.around(box, margin_m=2.0, headroom_m=3.0) for box in boxes}
    center, desired = np.array([15.0, 110.8, -20.0]), np.array([-3.02, 0.39, 0.0])
    way = Way(np.array([-28.4, 116.6]), 43.8)
    for side in (LEFT, RIGHT):
        around, sides = led(center, desired, ellipses, {"ahead": side}, way=way)
        assert around[1] * side < -2.5  # left of a heading along -x is +y
        assert sides["ahead"] == side


def test_hovering_formation_avoids_only_approaching_obstacles() -> None:
    coming = Ellipse(-25.0, 3.0, 5.0, 5.0, 100.0, 1.5, 0.0)
    center = np.array([0.0, 0.0, -20.0])
    here = Way(center[:2], 0.0)
    away, sides = led(center, np.zeros(3), {"c": coming}, way=here)
    assert away[1] < -0.3
    assert sides == {"c": RIGHT}
    going = Ellipse(-30.0, 3.0, 5.0, 5.0, 100.0, -1.5, 0.0)
    assert led(center, np.zeros(3), {"c": going}, way=here)[0].tolist() == [0.0, 0.0, 0.0]


def test_obstacles_out_of_reach_cost_and_change_nothing() -> None:
    random = np.random.default_rng(4)
    ellipses = {
        str(index): Ellipse(x_m, y_m, 4.0, 6.0, 100.0)
        for index, (x_m, y_m) in enumerate(random.uniform(-60.0, 60.0, (32, 2)).tolist())
    }
    place, desired = random.normal(size=(8, 3)) * 12.0, random.normal(size=(8, 3)) * 3.0
    place[:, 2] -= 30.0
    slides = np.full(8, 2.0)
    near = {name: e for name, e in ellipses.items() if float(e.distance_m(place).min()) < 12.0}
    assert 0 < len(near) < 32
    expected = avoid_all(place, desired, near, {}, slides, AVOIDANCE)
    assert avoid_all(place, desired, ellipses, {}, slides, AVOIDANCE).tolist() == expected.tolist()
    far = {name: e for name, e in ellipses.items() if name not in near}
    assert avoid_all(place, desired, far, {}, slides, AVOIDANCE) is desired


def test_each_vehicle_steers_past_its_nearest_obstacles() -> None:
    """More obstacles than one vehicle steers past at a time, in two groups that are far from each other."""

    def group(x_m: float, name: str) -> dict[str, Ellipse]:
        return {
            f"{name}{k}": Ellipse(x_m + 4.0 + 3.0 * (k // 4), 3.0 * (k % 4) - 3.0, 1.0, 1.0, 30.0)
            for k in range(STEERED_MOST - 4)
        }

    here, there = group(0.0, "a"), group(2000.0, "b")
    place_m, desired_m_s = (
        np.array([[0.0, 0.0, -10.0], [2000.0, 0.3, -10.0]]),
        np.array([[2.0, 0.0, 0.0]] * 2),
    )
    together = avoid_all(place_m, desired_m_s, here | there, {}, np.full(2, 2.0), AVOIDANCE)
    for row, own in enumerate((here, there)):
        alone = avoid_all(place_m[[row]], desired_m_s[[row]], own, {}, np.full(1, 2.0), AVOIDANCE)
        assert together[row].tolist() == alone[0].tolist()
        assert together[row].tolist() != desired_m_s[row].tolist()
