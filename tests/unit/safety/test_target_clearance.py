"""The clearance of a target: no velocity that the filter lets through ends nearer to it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.control import ControlSettings
from gcs.model.errors import InvalidError, RefusedError
from gcs.model.plan import Formation, Orbit, Target
from gcs.model.state import Array
from gcs.planning.feasibility import check_clearance, check_target, without_room_m
from gcs.safety.filter import filter_velocities
from gcs.safety.target_clearance import away_m, clear_height_m, kept_clear_m
from tests.support.safety_world import FLOOR, SETTINGS, surroundings

PERSON = Target(0.0, 0.0, clearance_m=10.0, deviation_m=0.5)
KEPT_M = kept_clear_m(PERSON, FLOOR, np.zeros(1))[:, 0]
STEP_S = 0.05


def allowed(
    position_m: Array, desired_m_s: Array, target: Target, velocity_m_s: Array | None = None
) -> Array:
    around = replace(surroundings(position_m, velocity=velocity_m_s), targets=(target,))
    return filter_velocities(desired_m_s, around, SETTINGS)[0]


@given(
    st.floats(-np.pi, np.pi),
    st.floats(0.05, 1.4),
    st.floats(1.0, 40.0),
    st.tuples(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0), st.floats(-2.0, 2.0)),
)
def test_no_velocity_leads_a_vehicle_into_the_clearance(
    bearing: float, elevation: float, off_m: float, desired: tuple[float, float, float]
) -> None:
    """It answers at once here, whatever it is asked for; the person stands."""
    out = np.array(
        [np.cos(bearing) * np.cos(elevation), np.sin(bearing) * np.cos(elevation), -np.sin(elevation)]
    )
    place_m = (out * (KEPT_M[0] + off_m) + (0.0, 0.0, -3.0))[None]
    velocity_m_s = np.zeros((1, 3))
    for _ in range(100):
        velocity_m_s = allowed(place_m, np.array([desired]), PERSON, velocity_m_s)
        place_m = place_m + STEP_S * velocity_m_s
        assert away_m(place_m, PERSON, 0.0)[0] > PERSON.clearance_m


def test_vehicle_gives_way_to_a_person_who_comes() -> None:
    person = Target(0.0, 0.0, 3.0, 0.0, clearance_m=10.0)
    place_m = np.array([[KEPT_M[0] + 6.0, 0.0, -4.0]])
    velocity_m_s = np.zeros((1, 3))
    for number in range(200):
        at = Target(3.0 * STEP_S * number, 0.0, 3.0, 0.0, clearance_m=10.0)
        velocity_m_s = allowed(place_m, np.zeros((1, 3)), at, velocity_m_s)
        place_m = place_m + STEP_S * velocity_m_s
        assert away_m(place_m, at, 0.0)[0] > person.clearance_m


def test_what_is_not_known_of_the_target_widens_the_distance() -> None:
    vague = replace(PERSON, deviation_m=3.0, height_deviation_m=2.0)
    wider_m = kept_clear_m(vague, FLOOR, np.zeros(1))[:, 0] - KEPT_M
    assert wider_m == pytest.approx([4.0 * 2.5, 4.0 * 2.0])


def test_sphere_is_clear_of_its_target_at_the_height_it_is_given() -> None:
    for orbit_m in (0.0, 5.0, 12.0, 30.0):
        height_m = clear_height_m(PERSON, orbit_m, 6.0, KEPT_M)
        assert np.hypot(orbit_m, height_m) - 6.0 >= PERSON.clearance_m


def test_fence_without_room_above_the_target_is_refused() -> None:
    control, formation = ControlSettings(), Formation(8.0, 20.0)
    low = control.model_copy(
        update={
            "safety": SETTINGS.model_copy(
                update={"fence": SETTINGS.fence.model_copy(update={"height_max_m": 28.0})}
            )
        }
    )
    check_target(PERSON, Orbit(), formation, control)
    with pytest.raises(InvalidError, match=r"clearance_m.*fence.height_max_m"):
        check_target(PERSON, Orbit(), formation, low)
    assert without_room_m(PERSON, Orbit(40.0, 2.0), formation, low.safety) == 0.0


def test_pads_within_the_clearance_are_named() -> None:
    pads_m = {"d1": np.array([3.0, 0.0, 0.0]), "d2": np.array([30.0, 0.0, 0.0])}
    with pytest.raises(RefusedError, match=r"target anna .* 10 m to the pad of d1$"):
        check_clearance("anna", PERSON, pads_m)
    check_clearance("anna", replace(PERSON, clearance_m=2.0), pads_m)


@pytest.mark.parametrize("clearance_m", [-1.0, np.nan, np.inf])
def test_clearance_is_a_distance(clearance_m: float) -> None:
    with pytest.raises(InvalidError, match="clearance_m"):
        Target(clearance_m=clearance_m)


def test_plan_with_a_clearance_is_still_held_after_a_loss() -> None:
    moving = Target(1.0, 2.0, 3.0, 0.0, clearance_m=10.0, height_m=4.0, climb_m_s=1.0, deviation_m=2.0)
    held = moving.held(2.0)
    assert (held.x_m, held.velocity_m_s, held.climb_m_s) == (7.0, (0.0, 0.0), 0.0)
    assert (held.clearance_m, held.height_m, held.deviation_m) == (10.0, 4.0, 2.0)
