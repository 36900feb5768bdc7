"""What a vehicle of each autopilot does without setpoints, compared with recorded ones."""

import numpy as np
import pytest

from gcs.links.autopilots import AUTOPILOTS, DEFAULT
from gcs.model.setpoint_loss import FleetWithoutSetpoints

ARDUPILOT = AUTOPILOTS["ardupilot"]

STOPS = (
    (100, ((1.94, 2.63), (4.03, 8.59), (4.93, 13.0), (7.93, 32.57), (10.0, 50.65))),
    (250, ((1.93, 1.53), (4.04, 4.54), (5.02, 6.64), (7.94, 14.57), (10.04, 21.51))),
    (500, ((1.94, 1.11), (4.07, 3.01), (5.02, 4.39), (7.93, 9.02), (10.04, 13.0))),
)
"""WPNAV_ACCEL in cm/s^2; speed in m/s, and how far the vehicle came after a setpoint at rest, in m."""


@pytest.mark.parametrize(
    ("acceleration_cm_s2", "speed_m_s", "farthest_m"),
    [(acceleration, *stop) for acceleration, stops in STOPS for stop in stops],
)
def test_recorded_stops_of_ardupilot_end_within_its_model(
    acceleration_cm_s2: int, speed_m_s: float, farthest_m: float
) -> None:
    known = {"WPNAV_ACCEL": float(acceleration_cm_s2)}
    alone = ARDUPILOT.without_setpoints("hold", 1.0, known)
    within_m = speed_m_s * alone.stop_s(speed_m_s)
    assert farthest_m <= within_m + 0.02  # speeds are rounded
    assert within_m < 1.25 * farthest_m, "and not far beyond"


def test_recorded_loss_of_setpoints_ends_within_the_model() -> None:
    """From 5.1 m/s it flew on for 3.0 s, 27.4 m in all."""
    alone = ARDUPILOT.without_setpoints("hold", 1.0, {"WPNAV_ACCEL": 100.0})
    assert alone.flies_on_s == 3.0
    way_m = 5.1 * (alone.flies_on_s + alone.stop_s(5.1))
    assert 27.4 <= way_m < 31.0


def test_unknown_parameters_count_as_those_of_the_oldest_version() -> None:
    unknown = ARDUPILOT.without_setpoints("hold", 1.0, {})
    assert (unknown.flies_on_s, unknown.deceleration_m_s2) == (3.0, 1.0)
    known = ARDUPILOT.without_setpoints("hold", 1.0, {"GUID_TIMEOUT": 0.5, "WPNAV_ACCEL": 250.0})
    assert (known.flies_on_s, known.deceleration_m_s2) == (0.5, 2.5)


def test_px4_flies_on_by_its_parameter_as_read() -> None:
    assert DEFAULT.without_setpoints("hold", 3.0, {"COM_OF_LOSS_T": 1.0}).flies_on_s == 1.0
    assert DEFAULT.without_setpoints("hold", 3.0, {}).flies_on_s == 3.0
    assert DEFAULT.without_setpoints("hold", 0.5, {}).flies_on_s == 1.0, "its default, where it was not set"


def test_ardupilot_stays_in_guided_where_px4_changes_its_mode() -> None:
    px4, ardupilot = (each.without_setpoints("hold", 1.0, {}) for each in (DEFAULT, ARDUPILOT))
    assert (px4.changes_mode, ardupilot.changes_mode) == (True, False)
    assert (px4.flies_on_s, px4.stop_s(8.0)) == (1.0, 1.0)
    assert ARDUPILOT.without_setpoints("descend", 1.0, {}).action == "land"


def test_columns_of_a_fleet_are_those_of_its_vehicles() -> None:
    both = [each.without_setpoints("return", 1.0, {}) for each in (DEFAULT, ARDUPILOT)]
    fleet = FleetWithoutSetpoints(both)
    velocity_m_s = np.array([[3.0, 4.0, 0.0], [3.0, 4.0, 0.0], [np.nan, 0.0, 0.0]])
    stop_s = fleet.stop_s(np.array([0, 1, 1]), velocity_m_s)
    assert stop_s.tolist() == pytest.approx([both[0].stop_s(5.0), both[1].stop_s(5.0), both[1].stop_s(0.0)])


def test_heights_of_return_and_actions_are_those_that_were_read() -> None:
    px4 = DEFAULT.without_setpoints("hold", 1.0, {"RTL_RETURN_ALT": 34.0, "COM_OBL_RC_ACT": 3})
    ardupilot = ARDUPILOT.without_setpoints("hold", 1.0, {"RTL_ALT": 3800})
    unread = DEFAULT.without_setpoints("hold", 1.0, {})
    assert (px4.action, unread.action) == ("return", "hold")
    fleet = FleetWithoutSetpoints([px4, ardupilot, unread])
    assert fleet.returns_at_m(np.array([30.0, 30.0, 42.0])).tolist() == [34.0, 38.0, 42.0]
