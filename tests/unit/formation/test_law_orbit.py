"""The motion of the centre: field, direction, limits."""

from math import cos, hypot, pi, sin

import numpy as np
import pytest

from gcs.formation.law import LawSettings, desired_center_velocity
from gcs.formation.orbit import (
    PACE_LEAST,
    PACE_LOST_MAX_PER_S,
    Center,
    advance_center,
    followed_target,
    held_within,
    next_pace,
    orbit_velocity,
    target_reach_m,
    within_ground_speed,
)
from gcs.model.plan import Direction, Formation, Orbit, Plan, Target
from gcs.model.state import Array

LAW = LawSettings()


def field(x_m: float, y_m: float, *, direction: Direction = Direction.COUNTERCLOCKWISE) -> Array:
    return orbit_velocity(
        np.array([x_m, y_m]), radius_m=15.0, speed_m_s=12.0, direction=direction, braking_m_s2=1.0
    )


@pytest.mark.parametrize(("x_m", "y_m"), [(15.0, 0.0), (3.0, -4.0), (0.1, 0.0), (-200.0, 80.0), (0.0, 0.0)])
def test_the_field_has_the_speed_v_d_everywhere(x_m: float, y_m: float) -> None:
    assert np.linalg.norm(field(x_m, y_m)) == pytest.approx(12.0)


def test_on_the_orbit_the_field_is_along_it() -> None:
    # north of the target (x ahead): counter-clockwise seen from above is westward, -y
    assert field(15.0, 0.0) == pytest.approx(np.array([0.0, -12.0]))
    assert field(15.0, 0.0, direction=Direction.CLOCKWISE) == pytest.approx(np.array([0.0, 12.0]))


def test_off_the_orbit_the_field_is_lyapunov_divided_by_rho() -> None:
    # rho = 30, r = 15: v_d / (30 (900 + 225)) (-30 (900 - 225), -30 (2 * 30 * 15))
    factor = 12.0 / (30.0 * 1125.0)
    assert field(30.0, 0.0) == pytest.approx(factor * np.array([-30.0 * 675.0, -30.0 * 900.0]))


@pytest.mark.parametrize("direction", list(Direction))
@pytest.mark.parametrize("start_m", [(40.0, 5.0), (0.5, 0.0)])
def test_centre_joins_the_circle_in_the_named_direction(
    direction: Direction, start_m: tuple[float, float]
) -> None:
    place, turned_rad = np.array(start_m), 0.0
    for _ in range(2000):
        later = place + 0.01 * field(place[0], place[1], direction=direction)
        cross = place[0] * later[1] - place[1] * later[0]
        turned_rad += np.arctan2(cross, place @ later)
        place = later
    assert hypot(*place) == pytest.approx(15.0, abs=0.2)
    clockwise = turned_rad > 0.0  # x ahead and y right: from x towards y is to the right, seen from above
    assert clockwise == (direction is Direction.CLOCKWISE)
    assert abs(turned_rad) > 2 * pi


def test_radius_zero_leads_to_the_target_and_stops_there() -> None:
    place, speeds = np.array([20.0, -10.0]), []
    for _ in range(1000):
        velocity = orbit_velocity(
            place, radius_m=0.0, speed_m_s=2.0, direction=Direction.CLOCKWISE, braking_m_s2=0.5
        )
        speeds.append(float(np.linalg.norm(velocity)))
        place = place + 0.05 * velocity
    assert max(speeds) == pytest.approx(2.0)
    assert hypot(*place) < 0.01
    assert speeds[-1] < 0.01


def test_the_targets_velocity_is_added() -> None:
    total = within_ground_speed(np.array([1.0, 0.0]), np.array([0.0, 2.0]), 4.0)
    assert total == pytest.approx(np.array([1.0, 2.0]))


def test_the_relative_part_shrinks_until_the_sum_is_at_the_limit() -> None:
    # 3 ahead, 8 across, limit 5: half of the 8 remains
    total = within_ground_speed(np.array([3.0, 0.0]), np.array([0.0, 8.0]), 5.0)
    assert total == pytest.approx(np.array([3.0, 4.0]))


def test_a_target_too_fast_is_followed_at_the_limit() -> None:
    total = within_ground_speed(np.array([6.0, 8.0]), np.array([5.0, 5.0]), 5.0)
    assert total == pytest.approx(np.array([3.0, 4.0]))


def test_without_relative_velocity_only_the_target_counts() -> None:
    assert within_ground_speed(np.array([1.0, 1.0]), np.zeros(2), 5.0) == pytest.approx(np.ones(2))


def test_centre_acceleration_is_limited_and_reported() -> None:
    moved = advance_center(Center.at_rest(np.zeros(3)), np.array([3.0, 4.0, 0.0]), 0.1, 2.0)
    assert moved.velocity_m_s == pytest.approx(np.array([0.12, 0.16, 0.0]))
    assert moved.acceleration_m_s2 == pytest.approx(np.array([1.2, 1.6, 0.0]))
    assert moved.position_m == pytest.approx(np.array([0.006, 0.008, 0.0]))


def test_a_small_change_of_the_centre_is_made_at_once() -> None:
    moved = advance_center(Center.at_rest(np.zeros(3)), np.array([0.05, 0.0, 0.0]), 0.1, 2.0)
    assert moved.velocity_m_s == pytest.approx(np.array([0.05, 0.0, 0.0]))
    assert moved.acceleration_m_s2 == pytest.approx(np.array([0.5, 0.0, 0.0]))


def test_the_centre_climbs_to_its_height_no_faster_than_allowed() -> None:
    plan = Plan(Formation(5.0, 30.0), Orbit(0.0, 2.0), Target(10.0, 0.0))
    low = desired_center_velocity(
        Center.at_rest(np.array([10.0, 0.0, -10.0])), plan, 0.0, LAW, reach_m=200.0, pace=1.0, height_m=30.0
    )
    near = desired_center_velocity(
        Center.at_rest(np.array([10.0, 0.0, -30.5])), plan, 0.0, LAW, reach_m=200.0, pace=1.0, height_m=30.0
    )
    assert low == pytest.approx(np.array([0.0, 0.0, -LAW.climb_max_m_s]))
    assert near == pytest.approx(np.array([0.0, 0.0, 0.5 * LAW.goal_rate_per_s]))


def test_moving_target_is_orbited_at_its_current_position() -> None:
    plan = Plan(Formation(5.0, 30.0), Orbit(10.0, 2.0), Target(0.0, 0.0, 1.0, 0.0, time_s=100.0))
    center = Center.at_rest(np.array([20.0, 10.0, -30.0]))  # at 120 s right beside the target, on the circle
    desired = desired_center_velocity(center, plan, 120.0, LAW, reach_m=200.0, pace=1.0, height_m=30.0)
    assert desired == pytest.approx(np.array([1.0 + 2.0, 0.0, 0.0]))


def test_named_directions_are_as_seen_on_a_map() -> None:
    for direction, sign in ((Direction.CLOCKWISE, 1.0), (Direction.COUNTERCLOCKWISE, -1.0)):
        for angle_rad in np.linspace(0.0, 2 * pi, 7):
            velocity = field(15.0 * cos(angle_rad), 15.0 * sin(angle_rad), direction=direction)
            along = np.array([-sin(angle_rad), cos(angle_rad)])
            assert velocity @ along == pytest.approx(sign * 12.0)


def test_target_within_reach_is_followed_exactly() -> None:
    place, velocity = followed_target(np.array([30.0, 40.0]), np.array([1.0, -2.0]), 50.0)
    assert place.tolist() == [30.0, 40.0]
    assert velocity.tolist() == [1.0, -2.0]


def test_target_beyond_reach_is_followed_at_its_projection() -> None:
    place, velocity = followed_target(np.array([60.0, 80.0]), np.array([0.6, 0.8]), 50.0)
    assert place == pytest.approx(np.array([30.0, 40.0]))
    assert velocity == pytest.approx(np.zeros(2), abs=1e-12)


@pytest.mark.parametrize("velocity", [(3.0, 1.0), (-2.0, 0.5), (0.0, 2.0)])
def test_followed_point_has_the_velocity_of_its_own_motion(velocity: tuple[float, float]) -> None:
    target, step_s = np.array([120.0, 35.0]), 1e-4
    place, followed = followed_target(target, np.array(velocity), 90.0)
    later, _ = followed_target(target + step_s * np.array(velocity), np.array(velocity), 90.0)
    assert followed == pytest.approx((later - place) / step_s, abs=1e-3)


def test_without_reach_the_origin_is_followed() -> None:
    place, velocity = followed_target(np.array([5.0, 0.0]), np.array([1.0, 1.0]), 0.0)
    assert place == pytest.approx(np.zeros(2))
    assert velocity == pytest.approx(np.zeros(2))


def test_orbit_sphere_and_fence_margin_reduce_the_reach() -> None:
    assert target_reach_m(300.0, 15.0, 10.0) == 273.0
    assert target_reach_m(30.0, 25.0, 10.0) == 0.0


def test_outward_motion_is_bounded_by_stopping_distance() -> None:
    # 8 m are left: from 4 m/s one stops within them at 1 m/s^2
    held = held_within(np.array([6.0, 3.0]), np.array([92.0, 0.0]), 100.0, 1.0)
    assert held == pytest.approx(np.array([4.0, 3.0]))
    assert held_within(np.array([-6.0, 3.0]), np.array([92.0, 0.0]), 100.0, 1.0).tolist() == [-6.0, 3.0]
    beyond = held_within(np.array([1.0, 3.0]), np.array([105.0, 0.0]), 100.0, 1.0)
    assert beyond == pytest.approx(np.array([0.0, 3.0]))


def test_orbit_slows_down_for_a_vehicle_left_behind() -> None:
    slowed = next_pace(1.0, 2.0, 0.05)
    assert slowed == pytest.approx(1.0 - 0.05 * PACE_LOST_MAX_PER_S)
    assert slowed < next_pace(slowed, 0.0, 0.05) < 1.0
    assert next_pace(1.0, 0.0, 0.05) == 1.0
    assert next_pace(PACE_LEAST, 100.0, 0.05) == PACE_LEAST


def test_the_targets_own_velocity_is_not_slowed_down() -> None:
    plan = Plan(Formation(5.0, 30.0), Orbit(10.0, 2.0), Target(0.0, 0.0, 1.0, 0.0))
    center = Center.at_rest(np.array([0.0, 10.0, -30.0]))
    desired = desired_center_velocity(center, plan, 0.0, LAW, reach_m=200.0, pace=0.5, height_m=30.0)
    assert desired == pytest.approx(np.array([1.0 + 1.0, 0.0, 0.0]))
