"""The filter counts on the stop of each vehicle, not on one of the fleet."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.model.response import FleetResponse, Response
from gcs.model.state import Array
from gcs.safety.constraints import Braking
from gcs.safety.filter import filter_velocities
from gcs.safety.surroundings import SafetySettings, Surroundings
from tests.support.safety_world import BOX, BRAKING, SETTINGS, surroundings

GENTLE = Response(acceleration_m_s2=0.8, swings_s=0.7)
SLOW = Braking(reaction_s=0.7, lead_s=0.0, deceleration_m_s2=0.8, escape_rate_per_s=0.5)
FAST_M_S = 8.0


def speed_m_s(braking: Braking, gap_m: float) -> float:
    return float(braking.speed_m_s(np.array([gap_m]))[0])


def allowed(
    around: Surroundings, desired: Array, vehicles: list[Response], settings: SafetySettings = SETTINGS
) -> Array:
    return filter_velocities(desired, replace(around, response=FleetResponse.of(vehicles)), settings)[0]


def test_gentle_vehicle_brakes_earlier_at_the_fence() -> None:
    position = np.array([[293.5, 0.0, -20.0], [0.0, 293.5, -20.0]])
    outward = FAST_M_S * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    flown = allowed(surroundings(position), outward, [Response(), GENTLE])
    assert flown[0, 0] == pytest.approx(speed_m_s(BRAKING, 6.0), abs=2e-3)
    assert flown[1, 1] == pytest.approx(speed_m_s(SLOW, 6.0), abs=2e-3)


def test_gentle_vehicle_brakes_earlier_before_a_box() -> None:
    position = np.array([[-11.0, 0.0, -8.0], [0.0, -11.0, -8.0]])
    inward = FAST_M_S * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    flown = allowed(surroundings(position, ellipses={"box": BOX}), inward, [GENTLE, Response()])
    assert flown[0, 0] == pytest.approx(speed_m_s(SLOW, 6.0), abs=2e-3)
    assert flown[1, 1] == pytest.approx(speed_m_s(BRAKING, 6.0), abs=2e-3)


def test_gentle_vehicle_brakes_earlier_before_a_lost_path() -> None:
    column = np.array([[[0.0, 0.0, -40.0], [0.0, 0.0, 0.0]]])
    position = np.array([[-10.0, 0.0, -20.0], [0.0, 10.0, -20.0]])
    inward = FAST_M_S * np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    flown = allowed(surroundings(position, segments=column), inward, [GENTLE, Response()])
    assert flown[0, 0] == pytest.approx(speed_m_s(SLOW, 7.0), abs=2e-3)
    assert -flown[1, 1] == pytest.approx(speed_m_s(BRAKING, 7.0), abs=2e-3)


@pytest.mark.parametrize(
    ("vehicles", "braking"),
    [
        ([Response(), Response()], BRAKING),
        ([GENTLE, Response()], SLOW),
        ([Response(), GENTLE], SLOW),
        ([GENTLE, GENTLE], SLOW),
    ],
    ids=["hard", "mixed", "mixed", "gentle"],
)
def test_a_pair_closes_in_as_the_gentler_of_both_can_stop(vehicles: list[Response], braking: Braking) -> None:
    position = np.array([[-4.0, 0.0, -20.0], [4.0, 0.0, -20.0]])  # 5 m to floor and margin
    desired = np.array([[6.0, 0.0, 0.0], [-6.0, 0.0, 0.0]])
    flown = allowed(surroundings(position), desired, vehicles)
    assert flown[0, 0] - flown[1, 0] == pytest.approx(speed_m_s(braking, 5.0), abs=2e-3)


def test_gentle_pair_is_found_as_far_apart_as_it_needs() -> None:
    """The search reaches as far as the gentlest vehicle needs."""
    position = np.array([[-22.0, 0.0, -20.0], [22.0, 0.0, -20.0]])
    desired = np.array([[8.0, 0.0, 0.0], [-8.0, 0.0, 0.0]])
    gap_m = 44.0 - 3.0
    assert speed_m_s(SLOW, gap_m) < 16.0 < speed_m_s(Braking(reaction_s=0.5, deceleration_m_s2=10.0), gap_m)
    flown = allowed(surroundings(position), desired, [GENTLE, Response()])
    assert flown[0, 0] - flown[1, 0] == pytest.approx(speed_m_s(SLOW, gap_m), abs=2e-3)


def test_over_a_late_link_its_stop_begins_a_round_trip_later() -> None:
    late = SETTINGS.model_copy(update={"link_delay_s": 0.2})
    position = np.array([[293.5, 0.0, -20.0]])
    flown = allowed(surroundings(position), np.array([[FAST_M_S, 0.0, 0.0]]), [GENTLE], late)
    later = SLOW.model_copy(update={"reaction_s": 1.1})
    assert flown[0, 0] == pytest.approx(speed_m_s(later, 6.0), abs=2e-3)


def test_braking_harder_than_configured_earns_nothing() -> None:
    hard = Response(acceleration_m_s2=5.0, swings_s=0.1)
    position = np.array([[293.5, 0.0, -20.0]])
    flown = allowed(surroundings(position), np.array([[FAST_M_S, 0.0, 0.0]]), [hard])
    assert flown[0, 0] == pytest.approx(speed_m_s(BRAKING, 6.0), abs=2e-3)


def test_what_holds_for_all_is_the_gentlest_of_them() -> None:
    of_all = BRAKING.of_slowest(FleetResponse.of([Response(), GENTLE]))
    assert (of_all.reaction_s, of_all.deceleration_m_s2) == (0.7, 0.8)
    assert BRAKING.of_slowest(FleetResponse.alike(3)) == BRAKING
