"""The responses of a fleet, as columns."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.model.errors import ShapeError
from gcs.model.response import FleetResponse, Response

GENTLE = Response(acceleration_m_s2=2.5, swings_s=0.45, loop_share=0.5, lead_share=0.0, trim_share=0.0)


def test_rows_and_joined_fleets_keep_each_vehicle_its_own() -> None:
    both = FleetResponse.of([Response(), GENTLE]).joined(FleetResponse.alike(1))
    assert both.acceleration_m_s2.tolist() == [np.inf, 2.5, np.inf]
    assert both.rows(np.array([1, 0])).swings_s.tolist() == [0.45, 0.0]
    assert both.rows(np.array([1])).trim_share.tolist() == [0.0]


def test_over_a_link_stops_begin_a_round_trip_later() -> None:
    fleet = FleetResponse.of([GENTLE])
    assert fleet.over_link(0.0) is fleet
    assert fleet.over_link(0.2).swings_s == pytest.approx([0.85])


def test_columns_are_read_only_and_of_one_length() -> None:
    fleet = FleetResponse.alike(2)
    with pytest.raises(ValueError, match="read-only"):
        fleet.swings_s[0] = 1.0
    one, two = np.ones(1), np.ones(2)
    with pytest.raises(ShapeError, match="lead_share"):
        FleetResponse(two, two, two, one, two, two)


def test_vehicles_that_fly_on_for_longer_stop_so_much_later() -> None:
    patient = replace(GENTLE, blind_s=2.0)
    alike = FleetResponse.of([GENTLE, Response()])
    assert alike.without_setpoints(0.8) is alike
    fleet = FleetResponse.of([GENTLE, patient, patient])
    drawn = np.array([False, False, True])
    assert fleet.without_setpoints(0.8, drawn).swings_s == pytest.approx([0.45, 4.8, 0.45])
    assert fleet.without_setpoints(0.3).swings_s == pytest.approx([0.45, 4.45, 4.45])
