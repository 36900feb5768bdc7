"""Sphere, spreading, response and yaw: the flown terms against numbers computed by hand."""

from math import pi, sqrt

import numpy as np
import pytest

from gcs.formation.article import repulsion_force
from gcs.formation.law import desired_yaw_rad, ramped_spin, turn_towards
from gcs.formation.neighbours import sphere_velocity
from gcs.formation.repulsion import (
    CHANGE_MAX_RAD,
    MUTUAL_FROM,
    SWEEP_MAX_RAD,
    energy,
    nearest_m,
    pushes,
    smallest_radius_m,
    sweep,
    sweeps_for,
)
from gcs.formation.response import compensate, correct_trim, limit_change, scale_to_limits, shrink_relative
from gcs.model.plan import Yaw, YawPolicy
from gcs.model.state import Array
from gcs.simulation.reference_shapes import best

ORIGIN = np.zeros(3)


# the sphere


def test_near_the_shell_the_pull_is_rate_times_radial_error() -> None:
    place = np.array([[0.0, 10.01, 0.0], [0.0, 0.0, -9.99]])
    velocity = sphere_velocity(place, ORIGIN, radius_m=10.0, rate_per_s=0.8, speed_max_m_s=4.0)
    assert velocity == pytest.approx(np.array([[0.0, -0.008, 0.0], [0.0, 0.0, -0.008]]), abs=1e-5)


def test_far_away_the_pull_is_the_speed_bound_to_the_centre() -> None:
    velocity = sphere_velocity(
        np.array([[300.0, 400.0, 0.0]]), ORIGIN, radius_m=10.0, rate_per_s=0.8, speed_max_m_s=4.0
    )
    assert velocity == pytest.approx(np.array([[-2.4, -3.2, 0.0]]))


def test_vehicle_at_the_exact_centre_is_sent_up() -> None:
    # excess (0 - 100) / 20 = -5 m, times 0.8
    velocity = sphere_velocity(np.zeros((1, 3)), ORIGIN, radius_m=10.0, rate_per_s=0.8, speed_max_m_s=9.0)
    assert velocity == pytest.approx(np.array([[0.0, 0.0, -4.0]]))


# spreading


def spread(direction: Array, sweeps: int = 400, charge: Array | None = None) -> Array:
    charge = np.ones(len(direction)) if charge is None else charge
    return sweep(direction, np.zeros_like(direction), direction, charge, sweeps, 0.0)[0]


def random_directions(count: int, seed: int) -> Array:
    raw = np.random.default_rng(seed).normal(size=(count, 3))
    unit: Array = raw / np.linalg.norm(raw, axis=1, keepdims=True)
    return unit


@pytest.mark.parametrize(
    ("count", "best"),
    [(2, 0.5), (3, 1.732051), (4, 3.674235), (6, 9.985281), (8, 19.675288), (12, 49.165253), (50, 1055.182)],
)
def test_repulsion_alone_leads_to_the_best_shape_known(count: int, best: float) -> None:
    assert energy(spread(random_directions(count, seed=1))) == pytest.approx(best, rel=1e-4)


def test_eight_drones_off_a_cube_settle_in_the_square_antiprism() -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / sqrt(3.0)
    nudged = corners + 0.02 * random_directions(8, seed=2)
    settled = spread(nudged / np.linalg.norm(nudged, axis=1, keepdims=True), sweeps=2000)
    assert energy(corners) == pytest.approx(19.7408, abs=1e-3)
    assert energy(settled) == pytest.approx(19.675288, rel=1e-5)


def test_one_sweep_keeps_its_turn_limit() -> None:
    crowded = np.array([[1.0, 0.0, 0.0], [1.0, 1e-3, 0.0]])
    crowded = crowded / np.linalg.norm(crowded, axis=1, keepdims=True)
    turned = np.linalg.norm(spread(crowded, sweeps=1) - crowded, axis=1)
    assert turned == pytest.approx([SWEEP_MAX_RAD, SWEEP_MAX_RAD], rel=1e-2)
    _, change = sweep(crowded, np.zeros((2, 3)), crowded, np.ones(2), 20, 0.0)
    assert (np.linalg.norm(change, axis=1) <= CHANGE_MAX_RAD * (1 + 1e-9)).all()


@pytest.mark.parametrize("count", [0, 1, 2, 40, MUTUAL_FROM + 50])
def test_the_fast_sum_is_the_articles_force(count: int) -> None:
    height, angle = np.linspace(-0.99, 0.99, count), np.pi * (3.0 - 5.0**0.5) * np.arange(count)
    ring = np.sqrt(1.0 - height**2)
    direction = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
    charge = np.linspace(0.5, 2.0, count)
    exact = repulsion_force(direction, charge, gain=1.0)
    assert np.abs(pushes(direction, charge) - exact).max(initial=0.0) <= 1e-5 * np.abs(exact).max(initial=0.0)


def test_coincident_directions_do_not_repel() -> None:
    assert np.isfinite(spread(np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))).all()


def test_large_fleets_make_fewer_sweeps() -> None:
    assert [sweeps_for(count, 4, 7) for count in (0, 1, 500, 600, 1000)] == [4, 4, 4, 2, 1]
    assert [sweeps_for(10_000, 4, number) for number in range(4)] == [0, 1, 0, 1]


def test_slots_follow_vehicles_that_cannot_reach_them() -> None:
    place = best(4)
    angle_rad = 0.5
    turn = np.array(
        [[np.cos(angle_rad), -np.sin(angle_rad), 0], [np.sin(angle_rad), np.cos(angle_rad), 0], [0, 0, 1]]
    )
    held = place @ turn.T
    followed, _ = sweep(place, np.zeros((4, 3)), held, np.ones(4), 4000, 0.002)
    assert followed == pytest.approx(held, abs=1e-3)


def test_a_larger_charge_keeps_the_others_farther_away() -> None:
    direction = spread(random_directions(4, seed=3), charge=np.array([3.0, 1.0, 1.0, 1.0]))
    distance = np.linalg.norm(direction[:, None] - direction[None], axis=2)
    from_heavy = distance[0, 1:]
    between_light = np.array([distance[1, 2], distance[1, 3], distance[2, 3]])
    assert from_heavy.min() > between_light.max() + 0.1


# how many fit


@pytest.mark.parametrize("count", [2, 3, 4, 5, 7, 8, 13])
def test_best_shape_keeps_separation_on_the_smallest_sphere(count: int) -> None:
    radius_m = smallest_radius_m(count, 4.5)
    assert nearest_m(radius_m * best(count)) >= 4.5 * (1 - 1e-5)


def test_one_two_and_three_vehicles_have_own_smallest_spheres() -> None:
    assert smallest_radius_m(1, 4.0) == 0.0
    assert smallest_radius_m(2, 4.0) == pytest.approx(2.0)
    assert smallest_radius_m(3, 4.0) == pytest.approx(4.0 / sqrt(3.0))


@pytest.mark.parametrize(
    ("count", "known"),
    [(4, 3.674235), (5, 6.474691), (8, 19.675288), (12, 49.165253), (20, 150.881568)],
)
def test_the_reference_shapes_have_the_best_known_energies(count: int, known: float) -> None:
    assert energy(best(count)) == pytest.approx(known, abs=2e-5)


# from velocity to setpoint


def test_vector_above_one_limit_is_scaled_as_a_whole() -> None:
    desired = np.array([[12.0, 16.0, -1.0], [3.0, 4.0, -5.0], [3.0, 4.0, 2.8], [1.0, 1.0, 1.0]])
    scaled = scale_to_limits(desired, horizontal_max_m_s=10.0, up_max_m_s=2.5, down_max_m_s=1.4)
    by_hand = desired * np.array([[0.5], [0.5], [0.5], [1.0]])
    assert scaled == pytest.approx(by_hand)


def test_inner_loop_asks_for_more_where_the_vehicle_lags() -> None:
    # sideways 2 + 1.5 (2 - 1) + 0.5 * 0.4; down 1 + 0.2 (1 - 0.5)
    setpoint = compensate(
        np.array([[2.0, 0.0, 1.0]]),
        np.array([[1.0, 0.0, 0.5]]),
        np.array([[0.4, 0.0, 0.0]]),
        np.array([1.5]),
        np.array([0.2]),
        np.array([0.5]),
    )
    assert setpoint == pytest.approx(np.array([[3.7, 0.0, 1.1]]))


def test_desired_velocity_keeps_the_acceleration_limit() -> None:
    before = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    desired = np.array([[3.0, 4.0, 0.0], [1.05, 0.0, 0.0]])
    followed = limit_change(desired, before, before, np.full(2, 2.0), 0.1)
    assert followed == pytest.approx(np.array([[0.12, 0.16, 0.0], [1.05, 0.0, 0.0]]))


def test_newly_commanded_vehicle_starts_at_its_velocity() -> None:
    desired, unknown, measured = (
        np.array([[3.0, 4.0, 0.0]]),
        np.full((1, 3), np.nan),
        np.array([[0.0, 1.0, 0.0]]),
    )
    followed = limit_change(desired, unknown, measured, np.full(1, 2.0), 0.1)
    assert followed == pytest.approx(measured + 0.2 * np.array([[1.0, 1.0, 0.0]]) / sqrt(2.0))


LIMITLESS = np.full(1, np.inf)


def test_common_part_is_kept_and_the_relative_part_shrinks() -> None:
    base = np.array([3.0, 0.0, 0.0])
    # |(3 + 4 s, 0)| = 5 and 1 m/s of climbing out of 2
    ahead = shrink_relative(base, np.array([[4.0, 0.0, 0.0]]), 5.0, 1.0, 1.0, LIMITLESS)
    climbing = shrink_relative(base, np.array([[2.0, 0.0, -2.0]]), 5.0, 1.0, 1.0, LIMITLESS)
    slow = shrink_relative(base, np.array([[0.0, 0.0, -2.0]]), 9.0, 9.0, 9.0, np.array([3.5]))
    assert ahead == pytest.approx(np.array([[5.0, 0.0, 0.0]]))
    assert climbing == pytest.approx(np.array([[4.0, 0.0, -1.0]]))
    assert slow == pytest.approx(np.array([[3.0, 0.0, -sqrt(3.5**2 - 9.0)]]))


def test_formation_above_the_limit_leaves_no_relative_part() -> None:
    base = np.array([6.0, 0.0, 0.0])
    assert shrink_relative(base, np.array([[-1.0, 1.0, 0.0]]), 5.0, 1.0, 1.0, LIMITLESS) == pytest.approx(
        base[None]
    )


def trimmed(
    measured: Array, *, at_limit: bool = False, trim: float = 0.0, ticks: int = 1, yields: bool = False
) -> Array:
    """After being told to fly at (2, 0, 0), of which 1 is the formation's."""
    one = np.array([[1.0, 0.0, 0.0]])
    trim_m_s, expected = trim * one, np.full((1, 3), np.nan)
    for _ in range(ticks):
        trim_m_s, expected = correct_trim(
            trim_m_s,
            expected,
            2.0 * one,
            measured,
            one,
            np.ones(1, dtype=bool),
            np.full(1, yields),
            np.array([[at_limit, not at_limit]]),
            0.05,
            0.4,
            np.array([1.0]),
            np.array([0.5]),
            4.0,
        )
    return trim_m_s


def test_slow_vehicle_is_trimmed_faster_up_to_the_limit() -> None:
    slow = np.array([[0.5, 0.0, 0.0]])
    assert 0.0 < trimmed(slow)[0, 0] < trimmed(slow, ticks=20)[0, 0]
    assert trimmed(slow, ticks=4000) == pytest.approx(np.array([[4.0, 0.0, 0.0]]))


def test_at_a_limit_the_trim_does_not_grow_but_may_shrink() -> None:
    assert trimmed(np.array([[0.5, 0.0, 0.0]]), at_limit=True, trim=1.0, ticks=50)[0, 0] == 1.0
    assert trimmed(np.array([[3.5, 0.0, 0.0]]), at_limit=True, trim=1.0, ticks=50)[0, 0] < 1.0


def test_trim_of_a_yielding_vehicle_may_only_shrink() -> None:
    assert trimmed(np.array([[0.5, 0.0, 0.0]]), trim=1.0, ticks=50, yields=True)[0, 0] == 1.0
    assert trimmed(np.array([[3.5, 0.0, 0.0]]), trim=1.0, ticks=50, yields=True)[0, 0] < 1.0


def test_vehicle_that_responds_as_expected_is_not_trimmed() -> None:
    assert np.abs(trimmed(np.array([[2.0, 0.0, 0.0]]), ticks=400)).max() < 1e-9


def test_trim_of_an_uncommanded_vehicle_is_forgotten() -> None:
    here, no_vehicle = np.ones((1, 3)), np.zeros(1, dtype=bool)
    trim, expected = correct_trim(
        here,
        here,
        here,
        here,
        here,
        no_vehicle,
        no_vehicle,
        np.zeros((1, 2), dtype=bool),
        0.05,
        0.4,
        np.array([1.0]),
        np.array([0.5]),
        4.0,
    )
    assert (trim == 0.0).all()
    assert np.isnan(expected).all()


# yaw

HELD = np.array([0.7, -2.0])
PLACE = np.array([[10.0, 0.0, -20.0], [0.0, -10.0, -20.0]])


def test_held_yaw_is_that_of_engagement() -> None:
    yaw = desired_yaw_rad(Yaw(YawPolicy.HELD), HELD, PLACE, np.zeros(2))
    assert yaw == pytest.approx(HELD)


def test_fixed_yaw_is_the_same_for_all_and_wrapped() -> None:
    yaw = desired_yaw_rad(Yaw(YawPolicy.FIXED, 3.5), HELD, PLACE, np.zeros(2))
    assert yaw == pytest.approx(np.full(2, 3.5 - 2 * pi))


def test_all_vehicles_face_the_target() -> None:
    yaw = desired_yaw_rad(Yaw(YawPolicy.TARGET), HELD, PLACE, np.zeros(2))
    assert np.cos(yaw) == pytest.approx([-1.0, 0.0], abs=1e-9)  # one looks back along x, one along y
    assert np.sin(yaw) == pytest.approx([0.0, 1.0], abs=1e-9)


def test_overhead_the_target_yaw_is_kept() -> None:
    yaw = desired_yaw_rad(Yaw(YawPolicy.TARGET), HELD, PLACE, np.array([10.0, 1.5]))
    assert yaw[0] == pytest.approx(0.7)


def test_yaw_turns_the_short_way_round_through_south() -> None:
    yaw = turn_towards(np.array([3.0]), np.array([-3.0]), rate_max_rad_s=1.0, dt_s=0.1)
    assert yaw == pytest.approx([3.1])


def test_unknown_yaw_stays_unknown() -> None:
    yaw = turn_towards(np.array([np.nan]), np.array([0.0]), rate_max_rad_s=1.0, dt_s=0.1)
    assert np.isnan(yaw).all()


def test_a_reversed_spin_changes_no_faster_than_its_limit() -> None:
    spin_rad_s, seen = 0.4, []
    for _ in range(400):
        after = ramped_spin(spin_rad_s, -0.4, 12.0, 0.05, 1.0)
        seen.append(abs(after - spin_rad_s) / 0.05 * 12.0)
        spin_rad_s = after
    assert max(seen) == pytest.approx(1.0)  # m/s^2 along the equator
    assert spin_rad_s == -0.4
