"""The flown law as a whole: each vehicle's path to its slot, and what breaks symmetry."""

import numpy as np
import pytest

from gcs.formation.law import (
    LawSettings,
    begun,
    directions_from,
    goal_velocity,
    slot_velocity,
    symmetry_offset_of,
    symmetry_offsets,
)
from gcs.formation.repulsion import sweep
from gcs.model.state import Array

LAW = LawSettings()
CENTER = np.array([5.0, -3.0, -20.0])
OCTAHEDRON = np.vstack([np.eye(3), -np.eye(3)])  # the best shape for six
SQUARE = np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]])
NAMES = ("a", "b", "c", "d")


def led(position: Array, place: Array) -> Array:
    direction, distance_m = directions_from(position, CENTER)
    fastest_m_s = np.full(len(position), LAW.speed_m_s)
    return slot_velocity(direction, distance_m, place, 10.0, LAW.slot_rate_per_s, fastest_m_s)


def test_at_its_slot_no_vehicle_moves_relative_to_the_centre() -> None:
    assert led(CENTER + 10.0 * OCTAHEDRON, OCTAHEDRON) == pytest.approx(np.zeros((6, 3)), abs=1e-9)


def test_near_its_slot_each_flies_straight_at_the_rate() -> None:
    off = np.random.default_rng(1).normal(size=(6, 3)) * 0.01
    velocity = led(CENTER + 10.0 * OCTAHEDRON + off, OCTAHEDRON)
    assert velocity == pytest.approx(-LAW.slot_rate_per_s * off, abs=1e-4)


def test_path_to_the_other_side_follows_the_sphere() -> None:
    velocity = led(CENTER + np.array([[10.0, 0.0, 0.0]]), np.array([[-0.99, 0.0, -np.sqrt(1 - 0.99**2)]]))
    assert velocity == pytest.approx(np.array([[0.0, 0.0, -LAW.speed_m_s]]), abs=1e-9)


def test_no_vehicle_exceeds_the_law_speed() -> None:
    far = CENTER + 300.0 * OCTAHEDRON[::-1]
    assert np.linalg.norm(led(far, OCTAHEDRON), axis=1) == pytest.approx(np.full(6, LAW.speed_m_s))


def test_at_the_centre_or_opposite_the_slot_velocity_is_finite() -> None:
    position = CENTER + np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]])
    velocity = led(position, np.array([[0.0, 0, -1], [-1.0, 0, 0]]))
    assert np.isfinite(velocity).all()
    assert velocity[0, 2] < 0.0


def test_symmetric_start_is_broken_at_once_by_a_small_offset() -> None:
    place = begun(SQUARE, NAMES, np.arange(4), LAW)
    assert np.abs(place[:, 2]).max() > 1e-3
    assert np.linalg.norm(place - SQUARE, axis=1).max() <= LAW.symmetry_rad
    change = np.zeros((4, 3))
    place, change = sweep(place, change, SQUARE, np.ones(4), 100, 0.0)
    assert np.linalg.norm(place[:, None] - place[None], axis=2)[0, 1:] == pytest.approx(
        np.full(3, 1.633), abs=1e-3
    )


def test_every_vehicle_has_its_own_repeatable_symmetry_offset() -> None:
    assert len({symmetry_offset_of(f"d{i}") for i in range(1000)}) == 1000
    assert symmetry_offset_of("d1") == symmetry_offset_of("d1")
    assert max(np.hypot(*symmetry_offset_of(f"d{i}")) for i in range(1000)) <= 1.0
    order = np.array([2, 0, 3, 1])
    assert (
        symmetry_offsets(SQUARE[order], NAMES, order).tolist()
        == symmetry_offsets(SQUARE, NAMES, np.arange(4))[order].tolist()
    )
    assert symmetry_offsets(np.zeros((0, 3)), NAMES, np.arange(0)).shape == (0, 3)


def test_above_the_centre_there_is_a_symmetry_offset() -> None:
    above = np.array([[0.0, 0.0, -1.0]])
    assert np.linalg.norm(symmetry_offsets(above, NAMES, np.array([1]))) == pytest.approx(
        np.hypot(*symmetry_offset_of("b"))
    )


LIMITS_M_S = (3.0, 2.5, 1.5)
"""Sideways, of climbing, of descending."""


def test_far_goal_at_the_law_speed_and_near_goal_slowly() -> None:
    place = np.zeros((2, 3))
    goal = np.array([[300.0, 400.0, 0.0], [0.0, 0.0, -0.5]])
    assert goal_velocity(place, goal, settings=LAW, limits_m_s=(8.0, 2.5, 1.5)) == pytest.approx(
        np.array([[0.6 * LAW.speed_m_s, 0.8 * LAW.speed_m_s, 0.0], [0.0, 0.0, -0.5 * LAW.goal_rate_per_s]])
    )


@pytest.mark.parametrize(
    ("way", "expected"),
    [
        ((200.0, 0.0, -250.0), (2.0, 0.0, -2.5)),  # both at their limits: a slope of 51 degrees
        ((200.0, 0.0, -125.0), (2.0, 0.0, -1.25)),
        ((0.0, 100.0, -250.0), (0.0, 1.0, -2.5)),
        ((0.0, 0.0, -250.0), (0.0, 0.0, -2.5)),
        ((-200.0, 0.0, 150.0), (-2.0, 0.0, 1.5)),
        ((120.0, 160.0, 300.0), (0.6, 0.8, 1.5)),
    ],
)
def test_on_a_slope_each_limit_counts_by_itself(
    way: tuple[float, float, float], expected: tuple[float, float, float]
) -> None:
    law, goal = LAW.model_copy(update={"speed_m_s": 2.0}), np.array([way])
    flown = goal_velocity(np.zeros((1, 3)), goal, settings=law, limits_m_s=LIMITS_M_S)
    assert flown[0] == pytest.approx(expected)


def test_sideways_no_faster_to_a_goal_than_the_vehicle_may() -> None:
    flown = goal_velocity(np.zeros((1, 3)), np.array([[90.0, 0.0, 0.0]]), settings=LAW, limits_m_s=LIMITS_M_S)
    assert flown[0] == pytest.approx((3.0, 0.0, 0.0))


def test_a_slow_vehicle_keeps_its_own_speed_on_a_slope() -> None:
    place, goal = np.zeros((2, 3)), np.array([[200.0, 0.0, -250.0], [200.0, 0.0, -250.0]])
    own_m_s = np.array([1.5, np.inf])
    flown = goal_velocity(place, goal, settings=LAW, limits_m_s=LIMITS_M_S, speed_max_m_s=own_m_s)
    assert np.linalg.norm(flown[0]) == pytest.approx(1.5)
    assert flown[0] / 1.5 == pytest.approx(flown[1] / np.hypot(2.0, 2.5))
    assert flown[1] == pytest.approx((2.0, 0.0, -2.5))
