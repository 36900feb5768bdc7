"""The article's own forces and virtual dynamics, against numbers computed by hand."""

from math import sqrt

import numpy as np
import pytest

from gcs.formation.article import ArticleParameters, repulsion_force, sphere_force
from gcs.formation.obstacles import AvoidanceSettings, Ellipse
from gcs.formation.orbit import Center
from gcs.formation.repulsion import energy, nearest_m
from gcs.model.state import Array
from gcs.simulation.article import step_center, step_virtual
from gcs.simulation.article_forces import ANSWER_S, avoiding_force, feed_forward_force, formation_force

SECTION_5 = ArticleParameters()
DT_S = 0.02
FINE_S = 0.005  # the orbit's own discretisation would shake a formation that is nearly undamped
TETRAHEDRON_ENERGY = 3.674235


def test_sphere_force_is_the_printed_one() -> None:
    # offset (3, 0, 4), |offset|^2 = 25, excess 25 - 4 = 21: -5 (3, 0, 4) 21
    force = sphere_force(np.array([[4.0, 2.0, 7.0]]), np.array([1.0, 2.0, 3.0]), radius_m=2.0, gain=5.0)
    assert force == pytest.approx(np.array([[-315.0, 0.0, -420.0]]))


def test_sphere_force_pushes_outward_and_vanishes_on_the_shell() -> None:
    """The force vanishes at the centre and on the shell, and pushes outward between them."""
    places = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    force = sphere_force(places, np.zeros(3), radius_m=2.0, gain=5.0)
    assert force == pytest.approx(np.array([[15.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))


def test_pair_repulsion_is_as_printed_with_its_charges() -> None:
    # r = 5, k_r q_1 q_2 / r^2 = 0.2 * 2 * 3 / 25 = 0.048, along (3, 4, 0) / 5
    force = repulsion_force(
        np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0]]), charge=np.array([2.0, 3.0]), gain=0.2
    )
    assert force == pytest.approx(np.array([[0.0288, 0.0384, 0.0], [-0.0288, -0.0384, 0.0]]))


def test_the_repulsion_of_three_in_a_row_sums_the_pairs() -> None:
    # unit charges at 0, 1, 3 and gain 1: from the left -1 - 1/9, 1 - 1/4, 1/9 + 1/4
    places = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    force = repulsion_force(places, np.ones(3), gain=1.0)
    assert force[:, 0] == pytest.approx(np.array([-10 / 9, 3 / 4, 13 / 36]))
    assert not force[:, 1:].any()


def test_the_combined_force_is_the_sum_of_both() -> None:
    places = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0]])
    combined = formation_force(places, np.zeros(3), np.array([2.0, 3.0]), SECTION_5)
    # the first is 5 from the centre: -5 (3, 4, 0) (25 - 4), plus the pair's repulsion
    assert combined == pytest.approx(
        np.array([[-315.0 + 0.0288, -420.0 + 0.0384, 0.0], [-0.0288, -0.0384, 0.0]])
    )


def test_virtual_dynamics_step_is_newtons_law_with_damping() -> None:
    # (u - k v) / M = (21 - 1) / 10 = 2 m/s^2, for 0.5 s
    position, velocity = step_virtual(
        np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]), np.array([[21.0, 0.0, 0.0]]), 0.5, SECTION_5
    )
    assert velocity == pytest.approx(np.array([[2.0, 0.0, 0.0]]))
    assert position == pytest.approx(np.array([[1.0, 0.0, 0.0]]))


def settle(seconds: float) -> tuple[Array, Array]:
    """Four drones from a seeded random start, about a centre that stands still."""
    rng = np.random.default_rng(5)
    position, velocity = rng.normal(size=(4, 3)) * 2.0, np.zeros((4, 3))
    for _ in range(round(seconds / DT_S)):
        force = formation_force(position, np.zeros(3), np.ones(4), SECTION_5)
        position, velocity = step_virtual(position, velocity, force, DT_S, SECTION_5)
    return position, velocity


@pytest.fixture(scope="module")
def settled() -> Array:
    return settle(240.0)[0]


def test_section_5_settles_four_drones_to_a_tetrahedron(settled: Array) -> None:
    first, second = np.triu_indices(4, 1)
    edge_m = np.linalg.norm(settled[first] - settled[second], axis=1)
    assert edge_m == pytest.approx(np.full(6, sqrt(8 / 3) * SECTION_5.radius_m), rel=0.01)


def test_repulsion_holds_vehicles_slightly_outside_the_sphere(
    settled: Array,
) -> None:
    """The distance to the sphere follows from the balance of forces."""
    radius_m = np.linalg.norm(settled, axis=1)
    assert (radius_m > SECTION_5.radius_m).all()
    r = float(radius_m.mean())
    pull = SECTION_5.sphere_gain * r * (r**2 - SECTION_5.radius_m**2)
    push = SECTION_5.repulsion_gain / (2 * r**2) * (2 * TETRAHEDRON_ENERGY / 4)
    assert pull == pytest.approx(push, rel=0.05)


def orbit(start: Array, seconds: float, *, fed_forward: bool) -> tuple[float, float]:
    """Section 5.1: centre at v_d = 12 on r_orbit = 15. Smallest distance and worst radius, both in m."""
    speed, around = 12.0, 15.0
    rate = speed / around
    position = start + np.array([around, 0.0, 0.0])
    velocity = np.tile((0.0, speed, 0.0), (4, 1))
    closest_m, worst_radius_m = np.inf, 0.0
    for index in range(round(seconds / FINE_S)):
        c, s = np.cos(rate * index * FINE_S), np.sin(rate * index * FINE_S)
        center = np.array([around * c, around * s, 0.0])
        force = formation_force(position, center, np.ones(4), SECTION_5)
        if fed_forward:
            center_m_s = np.array([-speed * s, speed * c, 0.0])
            center_m_s2 = -(rate**2) * center
            assert np.linalg.norm(center_m_s2) == pytest.approx(9.6)
            force = force + feed_forward_force(center_m_s, center_m_s2, SECTION_5)
        position, velocity = step_virtual(position, velocity, force, FINE_S, SECTION_5)
        closest_m = min(closest_m, nearest_m(position))
        away_m = np.abs(np.linalg.norm(position - center, axis=1) - SECTION_5.radius_m).max()
        worst_radius_m = max(worst_radius_m, float(away_m))
    return closest_m, worst_radius_m


def test_feedforward_holds_the_formation_at_almost_10_m_s2(
    settled: Array,
) -> None:
    closest_m, worst_radius_m = orbit(settled, 40.0, fed_forward=True)
    assert closest_m > 0.9 * sqrt(8 / 3) * SECTION_5.radius_m
    assert worst_radius_m < 0.1


def test_without_it_the_articles_orbit_pulls_the_formation_apart(settled: Array) -> None:
    closest_m, worst_radius_m = orbit(settled, 40.0, fed_forward=False)
    assert closest_m < 1.0
    assert worst_radius_m > 1.0


def test_the_settled_shape_has_the_energy_of_the_tetrahedron(settled: Array) -> None:
    direction = settled / np.linalg.norm(settled, axis=1, keepdims=True)
    assert energy(direction) == pytest.approx(TETRAHEDRON_ENERGY, rel=1e-3)


def test_hard_turn_of_the_centre_keeps_vehicles_in_place() -> None:
    start = np.random.default_rng(2).uniform(-2.0, 2.0, (4, 3))
    at_rest, velocity = start.copy(), np.zeros((4, 3))
    led, led_m_s, center = start.copy(), np.zeros((4, 3)), Center.at_rest(np.zeros(3))
    for index in range(400):
        angle_rad = 0.01 * index
        desired_m_s = 12.0 * np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0])
        force = formation_force(at_rest, np.zeros(3), np.ones(4), SECTION_5)
        at_rest, velocity = step_virtual(at_rest, velocity, force, FINE_S, SECTION_5)
        later = step_center(center, desired_m_s, FINE_S, 20.0)
        force = formation_force(led, center.position_m, np.ones(4), SECTION_5) + feed_forward_force(
            center.velocity_m_s, later.acceleration_m_s2, SECTION_5
        )
        led, led_m_s = step_virtual(led, led_m_s, force, FINE_S, SECTION_5)
        center = later
    assert np.linalg.norm(center.position_m) > 10.0
    assert led - center.position_m == pytest.approx(at_rest, abs=1e-9)


def avoiding(place: Array, velocity: Array) -> Array:
    """Force near an ellipse about the origin, half-axes 4 and 3, to be passed right; none was wanted."""
    box = {"box": Ellipse(0.0, 0.0, 4.0, 3.0, 30.0)}
    settings = AvoidanceSettings(lookahead_m=10.0, near_m=1.0)
    sliding = np.linalg.norm(velocity, axis=1)
    return avoiding_force(
        place, velocity, SECTION_5.damping_n_s_m * velocity, box, {"box": 1.0}, sliding, SECTION_5, settings
    )


def test_force_is_unchanged_without_obstacles() -> None:
    place = np.array([[-30.0, 0.0, -10.0], [-8.0, 0.0, -10.0], [-8.0, 0.0, -40.0]])
    velocity = np.array([[5.0, 0.0, 0.0], [-5.0, 0.0, 0.0], [5.0, 0.0, 0.0]])  # far; leaving; above
    assert avoiding(place, velocity) == pytest.approx(SECTION_5.damping_n_s_m * velocity)


def test_vehicle_at_an_ellipse_turns_to_its_tangent_in_time() -> None:
    # from (-5, 0) the tangent to x^2/16 + y^2/9 = 1 touches at x = -16/5, y = 9/5: along (1.8, 1.8)
    velocity = np.array([[5.0, 0.0, 0.0]])
    force = avoiding(np.array([[-5.0, 0.0, -10.0]]), velocity)
    free = (force - SECTION_5.damping_n_s_m * velocity) / SECTION_5.mass_kg
    turned = velocity + ANSWER_S * free
    assert turned[0, 1] == pytest.approx(turned[0, 0])
    assert turned[0, 1] > 2.0
