"""The flown law as a whole: what is added up, and what each part is for."""

import numpy as np
import pytest

from gcs.formation.law import LawSettings, formation_velocity, goal_velocity, kick_directions
from gcs.formation.orbit import Center
from gcs.state import Array

LAW = LawSettings()
CENTER = np.array([5.0, -3.0, -20.0])
OCTAHEDRON = np.vstack([np.eye(3), -np.eye(3)])  # the best shape for six
LATER_S = 1e3  # long after the symmetry was broken


def law(position: Array, center: Center, *, engaged_s: float = LATER_S) -> Array:
    n = len(position)
    return formation_velocity(
        position,
        np.ones(n),
        kick_directions(np.arange(n, dtype=np.float64)),
        np.full(n, engaged_s),
        center,
        radius_m=10.0,
        settings=LAW,
    )


def test_in_the_right_shape_everybody_goes_with_the_centre() -> None:
    shape = CENTER + 10.0 * OCTAHEDRON
    center = Center(CENTER, np.array([1.0, 2.0, -0.5]), np.zeros(3))
    assert law(shape, center) == pytest.approx(np.tile([1.0, 2.0, -0.5], (6, 1)), abs=1e-3)


def test_a_shape_that_lags_behind_as_a_whole_is_called_back() -> None:
    shape = CENTER + 10.0 * OCTAHEDRON + (0.5, 0.0, 0.0)
    mean = law(shape, Center.at_rest(CENTER)).mean(axis=0)
    assert mean[0] < -LAW.centroid_rate_per_s * 0.5
    assert abs(mean[1]) < 0.1


def test_calling_back_is_bounded() -> None:
    away = CENTER + 10.0 * OCTAHEDRON + (500.0, 0.0, 0.0)
    alone = law(away, Center.at_rest(CENTER))
    bound = 2 * LAW.speed_m_s + LAW.centroid_speed_max_m_s
    assert (np.linalg.norm(alone, axis=1) <= bound + 1e-9).all()


def test_one_drone_alone_flies_to_the_sphere_and_not_to_its_centre() -> None:
    on_the_shell = CENTER + np.array([[10.0, 0.0, 0.0]])
    assert law(on_the_shell, Center.at_rest(CENTER)) == pytest.approx(np.zeros((1, 3)), abs=1e-9)


def test_an_exactly_symmetric_start_is_broken_at_once_and_the_kick_fades() -> None:
    square = CENTER + 10.0 * np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]])
    begun = law(square, Center.at_rest(CENTER), engaged_s=0.0)
    later = law(square, Center.at_rest(CENTER), engaged_s=LATER_S)
    assert np.abs(begun[:, 2]).max() > 0.05
    assert np.abs(later).max() < 1e-6
    kick = np.linalg.norm(begun - later, axis=1)
    assert kick == pytest.approx(np.full(4, LAW.symmetry_speed_m_s))


def test_every_drone_has_a_kick_of_its_own_the_same_every_time() -> None:
    seeds = np.array([1.0, 2.0, 3.0])
    kicks = kick_directions(seeds)
    assert np.linalg.norm(kicks, axis=1) == pytest.approx(np.ones(3))
    assert kick_directions(seeds[::-1]).tolist() == kicks[::-1].tolist()
    assert np.abs(kicks[0] - kicks[1]).max() > 0.1
    assert kick_directions(np.zeros(0)).shape == (0, 3)


def test_a_goal_far_away_is_approached_at_the_laws_speed_and_a_near_one_gently() -> None:
    place = np.zeros((2, 3))
    goal = np.array([[300.0, 400.0, 0.0], [0.0, 0.0, -0.5]])
    assert goal_velocity(place, goal, settings=LAW) == pytest.approx(
        np.array([[0.6 * LAW.speed_m_s, 0.8 * LAW.speed_m_s, 0.0], [0.0, 0.0, -0.5 * LAW.goal_rate_per_s]])
    )
