"""The article's law as flown, its Lyapunov functions, and its rule of the side."""

from math import atan2, pi

import numpy as np
import pytest

from gcs.formation.article import ForceSettings, flown_velocity, scheduled, sphere_force
from gcs.formation.orbit import orbit_velocity
from gcs.formation.steering import LEFT, RIGHT, tangent
from gcs.model.plan import Direction
from gcs.model.state import Array
from gcs.simulation.article_forces import formation_force
from gcs.simulation.reference_shapes import best
from tests.support.article import orbit_potential, side_of_table_2, sphere_potential

SETTINGS = ForceSettings()
RADIUS_M = 12.0
CENTER_M = np.array([3.0, -4.0, -30.0])


def flown(
    position_m: Array, momentum_m_s: Array | None = None, charge: Array | None = None
) -> tuple[Array, Array]:
    return flown_velocity(
        position_m,
        CENTER_M,
        np.ones(len(position_m)) if charge is None else charge,
        np.zeros_like(position_m) if momentum_m_s is None else momentum_m_s,
        radius_m=RADIUS_M,
        dt_s=0.05,
        speed_max_m_s=5.0,
        settings=SETTINGS,
    )


def test_sphere_force_is_the_gradient_of_v_n() -> None:
    place = np.array([[4.0, 1.0, 7.0]])
    slope = [
        (
            sphere_potential(place + step, CENTER_M, radius_m=2.0)
            - sphere_potential(place - step, CENTER_M, radius_m=2.0)
        )[0]
        / 2e-4
        for step in 1e-4 * np.eye(3)
    ]
    force = sphere_force(place, CENTER_M, radius_m=2.0, gain=5.0)
    assert force[0] == pytest.approx(-5.0 * np.array(slope), rel=1e-6)
    on_shell = CENTER_M + np.array([[0.0, 2.0, 0.0]])
    assert sphere_potential(on_shell, CENTER_M, radius_m=2.0) == pytest.approx(np.zeros(1), abs=1e-9)


@pytest.mark.parametrize("rho_m", [2.0, 14.0, 16.0, 80.0])
@pytest.mark.parametrize("direction", list(Direction))
def test_v_t_falls_along_the_orbit_field(rho_m: float, direction: Direction) -> None:
    offset = rho_m * np.array([np.cos(2.0), np.sin(2.0)])
    pace = orbit_velocity(offset, radius_m=15.0, speed_m_s=3.0, direction=direction, braking_m_s2=0.5)
    later = orbit_potential(offset + 1e-3 * pace, radius_m=15.0)
    assert later < orbit_potential(offset, radius_m=15.0)
    assert orbit_potential(np.array([9.0, 12.0]), radius_m=15.0) == 0.0


def test_table_2_leads_all_vehicles_past_the_same_side() -> None:
    """All round an ellipse the rule passes it clockwise; as printed it flips where the angle wraps."""
    sides, printed = set(), set()
    for angle_rad in np.linspace(-pi, pi, 73):
        x_m, y_m = 20.0 * np.cos(angle_rad), 20.0 * np.sin(angle_rad)
        chi_rad = [atan2(*reversed(tangent(x_m, y_m, 4.0, 12.0, side))) for side in (LEFT, RIGHT)]
        phi_rad = atan2(-y_m, -x_m)
        sides.add(side_of_table_2(phi_rad, (chi_rad[0], chi_rad[1])))
        sides.add(side_of_table_2(phi_rad, (chi_rad[1], chi_rad[0])))
        printed.add(phi_rad <= min(chi_rad))
    assert sides == {LEFT}
    assert printed == {True, False}


def test_table_2_takes_the_other_side_beyond_both_tangents() -> None:
    assert side_of_table_2(0.5, (-0.2, 0.3)) == RIGHT
    assert side_of_table_2(-pi + 0.1, (pi - 0.3, pi - 0.1)) == RIGHT


@pytest.mark.parametrize("count", [2, 8, 20, 50])
def test_best_shape_is_at_rest_on_the_sphere_for_any_count(count: int) -> None:
    """The radial part of the printed repulsion moves the rest outside the sphere; the flown law does not."""
    place = CENTER_M + RADIUS_M * best(count)  # any minimum is at rest
    velocity, _ = flown(place)
    assert np.linalg.norm(velocity, axis=1).max() < 2e-3
    printed = formation_force(
        place, CENTER_M, np.ones(count), scheduled(count, np.ones(count), RADIUS_M, SETTINGS)
    )
    assert ((printed * (place - CENTER_M)).sum(axis=1) > 1e-3).all()


def test_gains_respond_at_their_rates_for_any_count_and_radius() -> None:
    for count, radius_m in ((8, 5.0), (50, 12.0)):
        gains = scheduled(count, np.ones(count), radius_m, SETTINGS)
        off = np.array([[radius_m + 0.01, 0.0, 0.0]])
        pull = sphere_force(off, np.zeros(3), radius_m=radius_m, gain=gains.sphere_gain)[0, 0]
        rate_per_s = -SETTINGS.ahead_s / gains.mass_kg * pull / 0.01
        assert rate_per_s == pytest.approx(SETTINGS.sphere_rate_per_s, rel=0.01)


def test_momentum_gathers_along_the_push_and_ends_against_it() -> None:
    place = CENTER_M + RADIUS_M * np.array([[1.0, 0.0, 0.0], [np.cos(2.9), np.sin(2.9), 0.0]])
    first, momentum = flown(place)
    assert (momentum * first).sum() > 0.0
    assert np.abs((momentum * (place - CENTER_M)).sum(axis=1)).max() < 1e-9
    _, ended = flown(place, -0.4 * first / np.linalg.norm(first, axis=1, keepdims=True))
    assert not ended.any()


def test_vehicle_at_the_centre_is_sent_up() -> None:
    velocity, _ = flown(np.array([CENTER_M]))
    assert velocity[0] == pytest.approx(np.array([0.0, 0.0, -5.0]))
