"""Where vehicles would fall: never nearer than an integration of its own, and than casex, finds."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from gcs.safety.impact import Airframe, ImpactSettings, hover_reach_m, impacts
from gcs.simulation.falls import fallen

LIGHT = Airframe(mass_kg=0.35, drag_area_m2=0.018, dimension_m=0.35)
MIDDLE = Airframe(mass_kg=1.3, drag_area_m2=0.035, dimension_m=0.5)
HEAVY = Airframe(mass_kg=3.0, drag_area_m2=0.06, dimension_m=0.8)
CASEX = Path(__file__).parents[2] / "data" / "casex.csv"


@pytest.mark.parametrize("airframe", [LIGHT, MIDDLE, HEAVY])
def test_no_impact_is_outside_its_disc(airframe: Airframe) -> None:
    """Whatever height, velocity and wind up to the limit; and the disc is no larger than it must be."""
    rng = np.random.default_rng(7)
    n = 2_000
    settings = ImpactSettings(airframe=airframe, wind_max_m_s=8.0, reaction_s=0.0)
    place_m, velocity_m_s = np.zeros((n, 3)), rng.normal(0.0, 4.0, (n, 3))
    place_m[:, 2] = -rng.uniform(0.5, 150.0, n)
    velocity_m_s[:, 2] = rng.uniform(-3.0, 3.0, n)
    turn_rad, wind_m_s = rng.uniform(0.0, 2.0 * np.pi, n), np.zeros((n, 3))
    strong_m_s = 8.0 * rng.choice([1.0, 1.0, 0.6, 0.0], n)
    wind_m_s[:, 0], wind_m_s[:, 1] = strong_m_s * np.cos(turn_rad), strong_m_s * np.sin(turn_rad)
    hit_m, took_s, hit_m_s = fallen(place_m, velocity_m_s, wind_m_s, airframe)
    falls = impacts(place_m, velocity_m_s, settings)
    off_m = np.linalg.norm(hit_m - falls.place_m, axis=1) + airframe.dimension_m / 2.0
    assert (off_m <= falls.spread_m).all()
    assert (took_s <= falls.fall_s + 0.02).all()
    assert (hit_m_s <= falls.speed_m_s + 0.2).all()
    ahead_m = np.linalg.norm(hit_m, axis=1)
    windy = strong_m_s == 8.0
    assert np.quantile(off_m[windy] / falls.spread_m[windy], 0.9) > 0.8
    assert (falls.spread_m <= 1.3 * (8.0 * took_s + ahead_m) + 1.0).all()


def by_casex() -> list[tuple[float, ...]]:
    """Mass, drag area, height and speed, and how far casex lets such a vehicle fall."""
    return [tuple(row) for row in np.genfromtxt(CASEX, delimiter=",", skip_header=2).tolist()]


@pytest.mark.parametrize(("mass_kg", "drag_area_m2", "height_m", "speed_m_s", "casex_m"), by_casex())
def test_casex_lets_no_vehicle_fall_farther(
    mass_kg: float, drag_area_m2: float, height_m: float, speed_m_s: float, casex_m: float
) -> None:
    """Above 1 kg, up to 10 m/s and without wind: within 5 %, and never farther than ours."""
    airframe = Airframe(mass_kg=mass_kg, drag_area_m2=drag_area_m2, dimension_m=0.55)
    settings = ImpactSettings(airframe=airframe, wind_max_m_s=0.0, reaction_s=0.0)
    falls = impacts(np.array([[0.0, 0.0, -height_m]]), np.array([[speed_m_s, 0.0, 0.0]]), settings)
    ours_m = float(falls.place_m[0, 0] + falls.spread_m[0]) - airframe.dimension_m / 2.0
    assert casex_m <= ours_m <= 1.05 * casex_m


def test_reaction_and_ground_count() -> None:
    here, moving = np.array([[0.0, 0.0, -40.0]]), np.array([[5.0, 0.0, -2.0]])
    calm = ImpactSettings(airframe=MIDDLE, wind_max_m_s=0.0, reaction_s=0.0)
    at_once = impacts(here, moving, calm)
    late = impacts(here, moving, calm.model_copy(update={"reaction_s": 2.0}))
    hit_m, _, _ = fallen(here, moving, np.zeros((1, 3)), MIDDLE, reaction_s=2.0)
    assert late.place_m[0, 0] > at_once.place_m[0, 0] + 9.9
    assert late.place_m[0, 0] + late.spread_m[0] >= hit_m[0, 0]
    lower = impacts(here, moving, calm.model_copy(update={"ground_m": -30.0}))
    above = impacts(np.array([[0.0, 0.0, -70.0]]), moving, calm)
    assert lower.place_m[0, 0] == pytest.approx(above.place_m[0, 0])


def test_what_is_not_known_is_not_known() -> None:
    places_m = np.array([[0.0, 0.0, -40.0], [np.nan, 0.0, -40.0]])
    falls = impacts(places_m, np.zeros((2, 3)), ImpactSettings())
    assert np.isfinite(falls.spread_m).tolist() == [True, False]
    assert np.isnan(falls.place_m[1]).all()
    assert np.isnan(falls.energy_j[1])


@pytest.mark.parametrize("much_m_s", [1e4, 1e19, 1e300, np.inf])
def test_speeds_beyond_belief_fall_far_and_are_known(much_m_s: float) -> None:
    place_m = np.tile([0.0, 0.0, -20.0], (5, 1))
    much = [[1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [1, 0, 1]]
    velocity_m_s = np.where(much, np.copysign(much_m_s, much), 0.0)
    falls = impacts(place_m, velocity_m_s, ImpactSettings())
    for known in (falls.place_m, falls.spread_m, falls.fall_s, falls.speed_m_s, falls.energy_j):
        assert np.isfinite(known).all()
    assert (np.abs(falls.place_m[[0, 1], [0, 1]]) >= 100.0).all()
    assert (falls.spread_m > 0.0).all()


def test_energies_are_those_of_the_final_speed() -> None:
    """A light vehicle reaches its final speed, with that of the wind."""
    settings = ImpactSettings(airframe=LIGHT, wind_max_m_s=6.0)
    falls = impacts(np.array([[0.0, 0.0, -300.0]]), np.zeros((1, 3)), settings)
    fastest_m_s = np.hypot(LIGHT.terminal_m_s, 6.0)
    assert falls.energy_j[0] == pytest.approx(0.5 * 0.35 * fastest_m_s**2, rel=0.02)


@given(st.floats(1.0, 120.0), st.floats(1.0, 120.0))
def test_a_higher_hover_falls_farther(one_m: float, other_m: float) -> None:
    low_m, high_m = sorted((one_m, other_m))
    reach_m = hover_reach_m(np.array([low_m, high_m]), ImpactSettings())
    assert reach_m[0] <= reach_m[1] + 1e-9


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"mass_kg": 0.01}, "greater than or equal to 0.05"),
        ({"mass_kg": 0.05, "drag_area_m2": 1.0, "dimension_m": 0.5}, "fall at 0.9 m/s in the end: 4 to"),
        ({"mass_kg": "1"}, "mass_kg"),
        ({"mass": 1.0}, "mass"),
        ({"mass_kg": 1.3}, "dimension_m\n  Field required"),
    ],
)
def test_airframes_are_bounded(values: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        Airframe.model_validate(values)


def test_the_hard_line_is_not_inside_the_soft_one() -> None:
    with pytest.raises(ValidationError, match="hard_m = 3: at most soft_m = 2"):
        ImpactSettings(hard_m=3.0)
