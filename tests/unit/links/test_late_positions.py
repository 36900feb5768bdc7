"""Positions that come late are dated by the vehicle's clock, as far as answers are late as well."""

import pytest
from pymavlink.dialects.v20 import development as dialect

from tests.unit.links.test_sample_order import START_MS, Vehicle, clocks, flying

TRIP_S = 0.04


def answer(vehicle: Vehicle, asked_s: float, trip_s: float) -> None:
    """The vehicle's answer to our request."""
    asked(vehicle, asked_s)
    ours_ns = int(vehicle.fleet.sync_sent_ns[0])
    vehicle.take(asked_s + trip_s, dialect.MAVLink_timesync_message(42, ours_ns))


def asked(vehicle: Vehicle, asked_s: float) -> None:
    vehicle.fleet.sync_sent_ns[0] = round(asked_s * 1e9)


def known() -> Vehicle:
    """Has flown for 2 s until 10 s over a link with a round trip of `TRIP_S`."""
    vehicle = Vehicle()
    vehicle.fly(clocks(START_MS - 1900, 20), 8.1)
    answer(vehicle, 9.9, TRIP_S)
    return vehicle


def dated(vehicle: Vehicle, late_s: float, from_s: float = 10.1, count: int = 10) -> list[float]:
    """By how much positions that come `late_s` too late are older than their arrival."""
    found = []
    for at in range(count):
        sent_s = from_s + 0.1 * at
        arrived_s = sent_s + late_s
        reported = vehicle.fly([START_MS + round((sent_s - 10.0) * 1e3)], arrived_s)
        found.append(arrived_s - float(reported.position_time_s[0]))
    return found


def test_position_on_time_is_dated_by_its_arrival() -> None:
    assert dated(known(), 0.0) == pytest.approx([0.0] * 10, abs=5e-3)


def test_late_position_is_older_once_an_answer_is_due() -> None:
    vehicle = known()
    asked(vehicle, 10.9)
    ages_s = dated(vehicle, 1.5)
    assert ages_s[0] == pytest.approx(11.6 - 10.9 - TRIP_S, abs=5e-3), "as long as the answer is due"
    assert ages_s[-1] == pytest.approx(1.5, abs=5e-3)


def test_late_position_is_older_when_the_answer_was_late() -> None:
    vehicle = known()
    answer(vehicle, 10.0, 1.54)
    assert dated(vehicle, 1.5) == pytest.approx([1.5] * 10, abs=5e-3)
    answer(vehicle, 12.6, TRIP_S)
    assert dated(vehicle, 0.0, from_s=12.7) == pytest.approx([0.0] * 10, abs=5e-3)


@pytest.mark.parametrize("stood_s", [0.3, 2.0, 9.0])
def test_clock_that_stood_while_answers_come_is_no_delay(stood_s: float) -> None:
    """A simulation that paused, or a clock that was set."""
    vehicle = known()
    vehicle.fly([START_MS], 10.0 + stood_s)
    answer(vehicle, 10.05 + stood_s, TRIP_S)
    assert dated(vehicle, stood_s, from_s=10.1) == pytest.approx([0.0] * 10, abs=5e-3)


def test_positions_never_become_older_than_the_one_before() -> None:
    vehicle = known()
    dated(vehicle, 0.0)
    before_s = float(vehicle.fleet.telemetry().position_time_s[0])
    asked(vehicle, 8.0)
    reported = vehicle.fly([START_MS + 1001], 20.0)
    assert reported.position_time_s[0] >= before_s


def test_vehicle_without_answers_is_dated_by_arrival() -> None:
    vehicle = flying()
    reported = vehicle.fly([START_MS + 100], 1.6)
    assert reported.position_time_s[0] == 1.6
