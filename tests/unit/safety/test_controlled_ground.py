"""Vehicles stay where they would fall on controlled ground: towards edges, up, past corners, outside."""

import numpy as np
import pytest

from gcs.model.state import Array
from gcs.safety.constraints import Braking, nearest
from gcs.safety.controlled_ground import (
    REASON,
    falling_speed_m_s,
    ground_constraints,
    ground_margins,
    kept_in_m,
)
from gcs.safety.fenced_areas import Corner, FencedArea
from gcs.safety.filter import filter_velocities
from gcs.safety.impact import Airframe, ImpactSettings
from gcs.safety.surroundings import SafetySettings
from gcs.safety.walls import Fence
from tests.support.safety_fleets import around

TICK_S = 0.05
ROOM: tuple[Corner, ...] = ((-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0))
ELL: tuple[Corner, ...] = ((-60, -60), (90, -60), (90, 60), (60, 60), (60, 0), (-60, 0))
IMPACT = ImpactSettings(airframe=Airframe(mass_kg=1.3, drag_area_m2=0.035, dimension_m=0.5), wind_max_m_s=6.0)


def flown(
    ring: tuple[Corner, ...], start_m: Array, velocity_m_s: Array, seconds: float
) -> tuple[Array, Array]:
    """(k, 3) positions and velocities of a vehicle that follows what the row leaves within 3 m/s^2."""
    ground, place_m, pace_m_s = FencedArea(corners_m=ring), start_m[None].copy(), np.zeros((1, 3))
    places_m, paces_m_s = [], []
    for _ in range(int(seconds / TICK_S)):
        walls = ground_constraints(
            place_m,
            np.array([True]),
            ground,
            IMPACT,
            Braking(),
            velocity_m_s=pace_m_s,
            standoff_m=np.zeros(1),
            fastest_m_s=8.4,
        )
        allowed = nearest(velocity_m_s[None].copy(), walls.first, walls.second, walls.normal, walls.bound_m_s)
        change = allowed - pace_m_s
        pace_m_s = pace_m_s + change * min(1.0, 3.0 * TICK_S / max(float(np.linalg.norm(change)), 1e-9))
        place_m = place_m + TICK_S * pace_m_s
        places_m.append(place_m[0])
        paces_m_s.append(pace_m_s[0])
    return np.array(places_m), np.array(paces_m_s)


@pytest.mark.parametrize("ring", [ROOM, ROOM[::-1], ELL, ELL[::-1]])
@pytest.mark.parametrize("angle_deg", range(0, 360, 40))
@pytest.mark.parametrize("climb_m_s", [0.0, 2.5])
def test_no_impact_leaves_the_ground(ring: tuple[Corner, ...], angle_deg: int, climb_m_s: float) -> None:
    """Whatever the direction: the margin never falls below the hard line."""
    angle = np.radians(angle_deg)
    desired = np.array([8.0 * np.cos(angle), 8.0 * np.sin(angle), -climb_m_s])
    places_m, paces_m_s = flown(ring, np.array([20.0, -30.0, -15.0]), desired, 25.0)
    margins = ground_margins(places_m, paces_m_s, FencedArea(corners_m=ring), IMPACT)
    assert margins.margin_m.min() >= IMPACT.hard_m
    if not climb_m_s:
        assert margins.margin_m[-1] <= IMPACT.soft_m + 0.6


@pytest.mark.parametrize("start_m", [(75.0, 0.0), (-80.0, 70.0), (60.0, 60.0), (59.0, 10.0)])
def test_vehicles_outside_are_led_in(start_m: Corner) -> None:
    places_m, paces_m_s = flown(ROOM, np.array([*start_m, -25.0]), np.zeros(3), 40.0)
    margins = ground_margins(places_m, paces_m_s, FencedArea(corners_m=ROOM), IMPACT)
    assert margins.margin_m[-1] >= IMPACT.hard_m


def test_where_the_ground_is_narrow_vehicles_come_down() -> None:
    """From both edges at once there is no way but down: the disc of a lower vehicle is smaller."""
    strip: tuple[Corner, ...] = ((-100.0, -9.0), (100.0, -9.0), (100.0, 9.0), (-100.0, 9.0))
    ground = FencedArea(corners_m=strip)
    places_m, paces_m_s = flown(strip, np.array([0.0, 1.0, -80.0]), np.zeros(3), 60.0)
    margins = ground_margins(places_m, paces_m_s, ground, IMPACT)
    assert margins.margin_m[0] < 0.0
    assert margins.margin_m[-1] >= IMPACT.hard_m
    assert -places_m[-1, 2] > 10.0


def test_the_filter_names_the_row_and_keeps_it() -> None:
    fence = Fence(controlled_ground=FencedArea(corners_m=ROOM))
    settings = SafetySettings(fence=fence, impact=IMPACT)
    place_m = np.array([[48.0, 0.0, -30.0], [0.0, 0.0, -30.0]])
    desired_m_s = np.array([[6.0, 0.0, 0.0], [6.0, 0.0, 0.0]])
    allowed_m_s, reasons = filter_velocities(desired_m_s, around(place_m), settings)
    assert reasons == (REASON, "")
    assert allowed_m_s[0, 0] < 2.0
    assert allowed_m_s[1, 0] == 6.0
    without, _ = filter_velocities(desired_m_s, around(place_m), SafetySettings(impact=IMPACT))
    assert (without == desired_m_s).all()


@pytest.mark.parametrize("falls_s", [0.5, 1.5, 3.0])
def test_a_braking_vehicle_never_falls_beyond_the_gap(falls_s: float) -> None:
    """From the speed that is allowed, after its reaction, braking as assumed: at every moment."""
    for gap_m in (0.5, 2.0, 5.0, 12.0, 40.0):
        speed = falling_speed_m_s(gap_m, 0.8, 2.0, 1.5, falls_s)
        time_s = np.linspace(0.0, speed / 2.0, 200)
        ahead_m = 0.8 * speed + speed * time_s - time_s**2 + (speed - 2.0 * time_s) * falls_s
        assert max(ahead_m.max(), speed * falls_s) <= gap_m + 1e-6
        assert ahead_m.max() >= gap_m - 1e-3


@pytest.mark.parametrize("much_m_s", [1e4, 1e19, 1e300, np.inf])
def test_rows_stay_at_speeds_beyond_belief(much_m_s: float) -> None:
    """A vehicle in the middle that reports such a speed is held back from the wall ahead, and is an alarm."""
    place_m, zero = np.array([[0.0, 0.0, -20.0]]), np.zeros(1)
    for row in np.eye(3)[:2]:
        velocity_m_s = np.where(row > 0.0, much_m_s, 0.0)[None]
        rows = ground_constraints(
            place_m,
            np.ones(1, np.bool_),
            FencedArea(corners_m=ROOM),
            IMPACT,
            Braking(),
            velocity_m_s=velocity_m_s,
            standoff_m=zero,
            fastest_m_s=5.0,
        )
        assert np.isfinite(rows.bound_m_s).all()
        assert (rows.normal @ row < -0.4).any()
        assert ground_margins(place_m, velocity_m_s, FencedArea(corners_m=ROOM), IMPACT).margin_m[0] < 0.0


def test_margins_say_what_is_not_known() -> None:
    place_m, still = np.array([[0.0, 0.0, -30.0], [np.nan, 0.0, -30.0]]), np.zeros((2, 3))
    margins = ground_margins(place_m, still, FencedArea(corners_m=ROOM), IMPACT)
    assert np.isnan(margins.margin_m).tolist() == [False, True]
    kept_m = kept_in_m(np.array([30.0]), IMPACT)[0]
    assert margins.margin_m[0] == pytest.approx(60.0 - kept_m + IMPACT.soft_m, abs=1e-6)
