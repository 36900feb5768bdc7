"""How the centre closes the distance to a target, and keeps beside one that circles too fast for it."""

from math import cos, hypot, pi, sin, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.formation.following import KNOWN_M_S, CenterLimits, closing_velocity, inside_circle
from gcs.model.plan import Target

AGILE_M_S2 = 3.0
LIMITS = CenterLimits(9.6, AGILE_M_S2)


def circling(radius_m: float, speed_m_s: float, at_rad: float, x_m: float = 0.0, y_m: float = 0.0) -> Target:
    """Around a point, with rising angles."""
    ahead, aside = cos(at_rad), sin(at_rad)
    turning_m_s2 = speed_m_s**2 / radius_m
    return Target(
        x_m + radius_m * ahead,
        y_m + radius_m * aside,
        -speed_m_s * aside,
        speed_m_s * ahead,
        acceleration_x_m_s2=-turning_m_s2 * ahead,
        acceleration_y_m_s2=-turning_m_s2 * aside,
    )


radii_m, speeds_m_s, angles = st.floats(5.0, 500.0), st.floats(0.5, 60.0), st.floats(-pi, pi)
places_m = st.floats(-1000.0, 1000.0)


@given(radii_m, speeds_m_s, angles, places_m, places_m)
def test_circle_inside_can_be_flown_and_is_nearer_than_behind(
    radius_m: float, speed_m_s: float, at_rad: float, x_m: float, y_m: float
) -> None:
    """One that trails goes round as small a circle, where the target is straight ahead."""
    inside = inside_circle(circling(radius_m, speed_m_s, at_rad, x_m, y_m), LIMITS)
    inner_m = hypot(inside.x_m - x_m, inside.y_m - y_m)
    inner_m_s = hypot(inside.velocity_x_m_s, inside.velocity_y_m_s)
    assert inner_m_s <= LIMITS.speed_m_s + 1e-9
    assert hypot(inside.acceleration_x_m_s2, inside.acceleration_y_m_s2) <= LIMITS.acceleration_m_s2 + 1e-9
    assert inner_m_s * radius_m == pytest.approx(speed_m_s * inner_m)  # as many rounds
    assert radius_m - inner_m <= sqrt(max(radius_m**2 - inner_m**2, 0.0)) + 1e-6


@given(radii_m, speeds_m_s, angles, angles)
def test_circle_inside_turns_with_the_target(
    radius_m: float, speed_m_s: float, at_rad: float, turn_rad: float
) -> None:
    plain = inside_circle(circling(radius_m, speed_m_s, at_rad), LIMITS)
    turned = inside_circle(circling(radius_m, speed_m_s, at_rad + turn_rad), LIMITS)
    expected = complex(plain.x_m, plain.y_m) * complex(cos(turn_rad), sin(turn_rad))
    assert (turned.x_m, turned.y_m) == pytest.approx((expected.real, expected.imag), abs=1e-6)


@pytest.mark.parametrize("target", [circling(30.0, 5.0, 1.0), Target(3.0, 4.0, 20.0), Target(1.0)])
def test_target_that_is_slow_or_straight_is_followed_itself(target: Target) -> None:
    assert inside_circle(target, LIMITS) == target


def closed_m_s(away_m: float, deviation_m_s: float) -> float:
    return float(closing_velocity(np.array([away_m, 0.0]), AGILE_M_S2, deviation_m_s)[0])


def test_small_distance_from_a_doubtful_target_is_closed_slowly() -> None:
    """What its next report corrects is not worth an acceleration."""
    assert closed_m_s(0.2, 3.0 * KNOWN_M_S) < 0.5 * closed_m_s(0.2, KNOWN_M_S)


@pytest.mark.parametrize("away_m", [0.1, 1.0, 3.0, 10.0, 100.0])
@pytest.mark.parametrize("doubt", [1.5, 3.0, 10.0])
def test_doubtful_target_is_closed_no_faster_than_a_known_one(away_m: float, doubt: float) -> None:
    assert closed_m_s(away_m, doubt * KNOWN_M_S) <= closed_m_s(away_m, KNOWN_M_S)
