"""The fence and obstacles, against numbers computed by hand."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from gcs.formation.obstacles import Ellipse
from gcs.model.plan import Obstacle
from gcs.safety.filter import filter_velocities
from gcs.safety.near_traffic import NearTraffic
from gcs.safety.walls import Fence, fence_constraints, obstacle_constraints
from tests.support.safety_world import BOX, BRAKING, FENCE, SETTINGS, filtered, surroundings


def test_fence_brakes_descent_climb_and_departure() -> None:
    """Vehicles are kept half of the floor's margin inside, 0.5 m."""
    position = np.array([[0.0, 0.0, -4.0], [0.0, 0.0, -98.5], [298.5, 0.0, -20.0]])
    desired = np.array([[0.0, 0.0, 1.4], [0.0, 0.0, -2.5], [5.0, 0.0, 0.0]])
    allowed = filtered(desired, surroundings(position))
    half, one = BRAKING.speed_m_s(np.array([0.5, 1.0])).tolist()
    assert allowed[0, 2] == pytest.approx(half, abs=2e-3)
    assert allowed[1, 2] == pytest.approx(-one, abs=2e-3)
    assert allowed[2, 0] == pytest.approx(one, abs=2e-3)


def test_speed_towards_the_fence_goes_on_at_first() -> None:
    position = np.array([[0.0, 0.0, -7.0], [0.0, 0.0, -95.0], [290.0, 0.0, -50.0], [0.0, 290.0, -50.0]])
    velocity = np.array([[0.5, 0.0, 1.0], [0.0, 0.5, -2.0], [3.0, 1.0, 0.0], [0.0, -3.0, np.nan]])
    everyone = np.ones(4, bool)
    braking = BRAKING.model_copy(update={"lead_s": 0.6})
    found = fence_constraints(
        position, everyone, ~everyone, FENCE, braking, velocity_m_s=velocity, fastest_m_s=3.5
    )
    assert found.first.tolist() == [0, 1, 2, 3]
    gaps_m = np.array([4.0 - 0.6 * 1.0, 5.0 - 0.6 * 2.0, 10.0 - 0.6 * 3.0, 10.0])  # the last flies inwards
    assert found.bound_m_s == pytest.approx(-BRAKING.speed_m_s(gaps_m))


def test_the_fence_keeps_uncertain_vehicles_farther_inside() -> None:
    position = np.array([[295.0, 0.0, -20.0], [-295.0, 0.0, -20.0]])
    here = replace(surroundings(position), uncertainty_m=np.array([0.1, 1.5]))
    allowed = filtered(np.array([[8.0, 0.0, 0.0], [-8.0, 0.0, 0.0]]), here)
    certain, uncertain = BRAKING.speed_m_s(5.0 - 0.5 - np.array([0.1, 1.5])).tolist()
    assert allowed[:, 0] == pytest.approx([certain, -uncertain], abs=2e-3)


def test_below_least_height_it_climbs_unless_it_descends() -> None:
    low = np.array([[0.0, 0.0, -2.5]])
    sinking = np.array([[0.0, 0.0, 1.0]])
    assert filtered(sinking, surroundings(low))[0, 2] == pytest.approx(-0.5, abs=2e-3)
    assert filtered(sinking, surroundings(low, descending=True))[0, 2] == 1.0


def test_above_the_origin_no_direction_is_fenced() -> None:
    over_origin = np.array([[0.0, 0.0, -20.0]])
    found = fence_constraints(over_origin, np.ones(1, bool), np.zeros(1, bool), FENCE, BRAKING)
    assert (found.slack_m_s(np.array([[8.0, 0.0, 0.0]])) > 0.0).all()


def test_slow_traffic_does_not_hold_up_descending_vehicles() -> None:
    inside, sinking = np.array([[1.0, 0.0, -8.0]]), np.array([[0.0, 0.0, 1.0]])
    none, slow = np.zeros((0, 3)), (Obstacle("traffic A", 0.0, 0.0, 5.0, 5.0, 12.0),)
    near_traffic = NearTraffic((), none, none, np.zeros(0), np.zeros(0), np.zeros((0, 2, 3)), 3.0, slow)
    for name, descending, sinks in (
        ("traffic A", True, True),
        ("traffic A", False, False),
        ("B", True, False),
    ):
        here = surroundings(inside, descending=descending, ellipses={name: BOX})
        allowed = filtered(sinking, replace(here, near_traffic=near_traffic))
        assert bool(allowed[0, 2] == 1.0) is sinks


def test_obstacle_is_a_wall_below_its_top_and_a_floor_above() -> None:
    beside, over = np.array([[-7.0, 0.0, -8.0]]), np.array([[0.0, 0.0, -12.5]])
    into = filtered(np.array([[4.0, 1.0, 0.0]]), surroundings(beside, ellipses={"b": BOX}))
    assert into[0] == pytest.approx([float(BRAKING.speed_m_s(np.array([2.0]))[0]), 1.0, 0.0], abs=2e-3)
    down = filtered(np.array([[4.0, 0.0, 1.4]]), surroundings(over, ellipses={"b": BOX}))
    assert down[0] == pytest.approx([4.0, 0.0, float(BRAKING.speed_m_s(np.array([0.5]))[0])], abs=2e-3)


def test_well_above_an_obstacle_nothing_changes() -> None:
    desired = np.array([[4.0, 2.0, 1.0]])
    over = surroundings(np.array([[0.0, 0.0, -18.0]]), ellipses={"b": BOX})
    assert filtered(desired, over).tolist() == desired.tolist()


def test_inside_an_obstacle_it_is_led_out_without_descending() -> None:
    inside = surroundings(np.array([[-4.0, 0.0, -9.0]]), ellipses={"b": BOX})
    allowed = filtered(np.array([[3.0, 0.0, 1.4]]), inside)
    assert allowed[0, 0] == pytest.approx(-0.5, abs=2e-3)
    assert allowed[0, 2] == pytest.approx(0.0, abs=2e-3)
    just_below = surroundings(np.array([[-4.0, 0.0, -11.8]]), ellipses={"b": BOX})
    risen = filtered(np.array([[3.0, 0.0, 1.4]]), just_below)
    assert risen[0] == pytest.approx([3.0, 0.0, -0.1], abs=2e-3)


def test_beside_and_above_an_edge_the_normal_is_diagonal() -> None:
    diagonal = np.array([[-8.0, 0.0, -16.0]])  # 3 m beside and 4 m above: 5 m away
    found = obstacle_constraints(diagonal, np.array([True]), {"b": BOX}, BRAKING)
    assert found.normal == pytest.approx(np.array([[-0.6, 0.0, -0.8]]))
    assert found.bound_m_s == pytest.approx(-BRAKING.speed_m_s(np.array([5.0])))


def test_moving_obstacle_is_kept_off_by_relative_velocity() -> None:
    coming = Ellipse(0.0, 0.0, 5.0 * sqrt(2), 5.0 * sqrt(2), 12.0, velocity_x_m_s=-1.5, velocity_y_m_s=1.0)
    beside = surroundings(np.array([[-5.5, 0.0, -8.0]]), ellipses={"b": coming})
    allowed = filtered(np.zeros((1, 3)), beside)
    possible = float(BRAKING.speed_m_s(np.array([0.5]))[0])
    assert allowed[0] == pytest.approx([possible - 1.5, 0.0, 0.0], abs=2e-3)


def test_obstacles_constrain_only_commanded_vehicles() -> None:
    position = np.array([[-5.5, 0.0, -8.0], [-5.5, 0.0, -8.0]])
    found = obstacle_constraints(position, np.array([False, True]), {"b": BOX}, BRAKING)
    assert found.first.tolist() == [1]
    assert found.reason.tolist() == ["obstacle b"]


def test_three_crowded_in_a_corner_of_the_fence_break_no_wall() -> None:
    position = np.array([[298.0, 0.0, -3.2], [298.0, 3.1, -3.2], [298.0, -3.1, -3.2]])
    allowed = filtered(np.tile([8.0, 0.0, 1.4], (3, 1)), surroundings(position))
    gap = 300.0 - np.hypot(position[:, 0], position[:, 1])
    assert (allowed[:, 0] <= BRAKING.speed_m_s(gap) * sqrt(1.001) + 5e-3).all()
    assert (allowed[:, 2] <= BRAKING.speed_m_s(np.full(3, 0.2)) + 2e-3).all()


def test_single_wall_is_applied() -> None:
    wide = SETTINGS.model_copy(
        update={"fence": Fence(height_min_m=3.0, height_max_m=1e4, distance_max_m=1e4)}
    )
    allowed, _ = filter_velocities(
        np.array([[0.0, 0.0, 1.4]]), surroundings(np.array([[0.0, 0.0, -3.7]])), wide
    )
    assert allowed[0, 2] == pytest.approx(float(BRAKING.speed_m_s(np.array([0.2]))[0]), abs=2e-3)


@pytest.mark.parametrize(("side", "moving"), [(-1.0, -1.5), (1.0, 1.5)])
def test_obstacle_moving_along_y_pushes_vehicles_ahead_of_it(side: float, moving: float) -> None:
    coming = Ellipse(0.0, 0.0, 5.0 * sqrt(2), 5.0 * sqrt(2), 12.0, velocity_x_m_s=0.7, velocity_y_m_s=moving)
    beside = surroundings(np.array([[0.0, side * 5.5, -8.0]]), ellipses={"b": coming})
    possible = float(BRAKING.speed_m_s(np.array([0.5]))[0])
    assert filtered(np.zeros((1, 3)), beside)[0] == pytest.approx(
        [0.0, moving - side * possible, 0.0], abs=2e-3
    )


def test_near_an_edge_the_normal_is_diagonal() -> None:
    found = obstacle_constraints(np.array([[-5.3, -5.4, -8.0]]), np.array([True]), {"b": BOX}, BRAKING)
    assert found.normal == pytest.approx(np.array([[-0.6, -0.8, 0.0]]))
    assert found.bound_m_s == pytest.approx(-BRAKING.speed_m_s(np.array([0.5])))


@pytest.mark.parametrize(
    ("x_m", "y_m", "out"),
    [(0.6, 0.1, (1, 0)), (-0.6, 0.1, (-1, 0)), (0.1, 0.6, (0, 1)), (0.1, -0.6, (0, -1))],
)
def test_nearest_side_is_the_way_out_of_a_narrow_obstacle(
    x_m: float, y_m: float, out: tuple[int, int]
) -> None:
    mast = Ellipse(0.0, 0.0, 0.8 * sqrt(2), 0.8 * sqrt(2), top_height_m=12.0)
    found = obstacle_constraints(np.array([[x_m, y_m, -5.0]]), np.array([True]), {"b": mast}, BRAKING)
    assert found.normal[0] == pytest.approx([*out, 0.0])
    assert found.bound_m_s[0] == pytest.approx(0.1)


def test_fence_of_a_narrow_field_holds_near_its_middle() -> None:
    narrow = Fence(height_min_m=3.0, height_max_m=100.0, distance_max_m=2.0)
    found = fence_constraints(
        np.array([[0.3, 0.4, -20.0]]), np.ones(1, bool), np.zeros(1, bool), narrow, BRAKING, fastest_m_s=3.0
    )
    assert found.reason.tolist() == ["greatest distance"]
    assert found.normal[0] == pytest.approx([-0.6, -0.8, 0.0])


@pytest.mark.parametrize(("allowed_m_s", "sides"), [(3.9, 1), (4.1, 0)])
def test_wall_is_omitted_only_beyond_braking_at_twice_the_speed(allowed_m_s: float, sides: int) -> None:
    gap_m = allowed_m_s * BRAKING.reaction_s + allowed_m_s**2 / (2.0 * BRAKING.deceleration_m_s2)
    one = np.ones(1, dtype=bool)
    low, beside = np.array([[0.0, 0.0, -3.0 - gap_m]]), np.array([[5.0 + gap_m, 0.0, -8.0]])
    fence = fence_constraints(low, one, ~one, FENCE, BRAKING, fastest_m_s=2.0)
    boxes = obstacle_constraints(beside, one, {"b": BOX}, BRAKING, fastest_m_s=2.0)
    assert (len(fence), len(boxes)) == (sides, sides)
