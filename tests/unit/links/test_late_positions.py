"""How late positions are: by the vehicle's clock as far as answers are late, or behind its other messages."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import development as dialect

from gcs.links.telemetry import FleetTelemetry
from gcs.mavlink.sample_times import LEAST_OF_S, PROMPT_S
from tests.support.tlog_files import frames, read
from tests.unit.links.test_sample_order import START_MS, Vehicle, clocks, flying

TRIP_S = 0.04


def asked(vehicle: Vehicle, asked_s: float) -> int:
    """Ask for the vehicle's clock. Returns: our time in the request."""
    waiting, ours_ns = vehicle.fleet.asked_ns[0], round(asked_s * 1e9)
    waiting[:-1] = waiting[1:]
    waiting[-1] = ours_ns
    return ours_ns


def answer(vehicle: Vehicle, asked_s: float, trip_s: float) -> None:
    vehicle.take(asked_s + trip_s, dialect.MAVLink_timesync_message(42, asked(vehicle, asked_s)))


def known() -> Vehicle:
    """Has flown for 2 s until 10 s over a link with a round trip of `TRIP_S`."""
    vehicle = Vehicle()
    vehicle.fly(clocks(START_MS - 1900, 20), 8.1)
    answer(vehicle, 9.9, TRIP_S)
    vehicle.fly([START_MS], 10.0)
    return vehicle


def found_s(vehicle: Vehicle, late_s: float, from_s: float = 10.1, count: int = 10) -> list[float]:
    """How late each of the positions counts that come `late_s` too late."""
    found = []
    for at in range(count):
        sent_s = from_s + 0.1 * at
        reported = vehicle.fly([START_MS + round((sent_s - 10.0) * 1e3)], sent_s + late_s)
        found.append(float(reported.position_late_s[0]))
    return found


def test_position_on_time_is_not_late() -> None:
    assert found_s(known(), 0.0) == pytest.approx([0.0] * 10, abs=5e-3)


def test_position_is_late_once_two_answers_are_due() -> None:
    vehicle = known()
    asked(vehicle, 10.4)
    assert found_s(vehicle, 1.5, count=2) == pytest.approx([0.0] * 2, abs=5e-3), "one answer may be lost"
    asked(vehicle, 10.9)
    later_s = found_s(vehicle, 1.5, from_s=10.3, count=12)
    assert later_s[0] == pytest.approx(11.8 - 10.9 - TRIP_S, abs=5e-3), "as long as the answer is due"
    assert later_s[-1] == pytest.approx(1.5, abs=5e-3)


def test_position_is_late_when_the_answer_was_late() -> None:
    vehicle = known()
    answer(vehicle, 10.0, 1.54)
    assert found_s(vehicle, 1.5) == pytest.approx([1.5] * 10, abs=5e-3)
    answer(vehicle, 12.6, TRIP_S)
    assert found_s(vehicle, 0.0, from_s=12.7) == pytest.approx([0.0] * 10, abs=5e-3)


def test_delay_that_begins_just_after_a_prompt_answer_is_found() -> None:
    """The first position after that answer is late already: it says nothing about the clock."""
    vehicle = known()
    answer(vehicle, 10.01, TRIP_S)
    for asked_s in (10.4, 10.65):
        asked(vehicle, asked_s)
    assert found_s(vehicle, 1.5)[-1] == pytest.approx(1.5, abs=0.01)


def test_few_late_positions_among_prompt_ones_are_jitter() -> None:
    vehicle = known()
    answer(vehicle, 10.0, 1.54)
    for turn in range(20):
        late_s = 0.0 if turn % 3 == 0 else 0.05
        assert found_s(vehicle, late_s, from_s=11.6 + 0.1 * turn, count=1)[0] <= LEAST_OF_S / 2.0


@pytest.mark.parametrize("stood_s", [0.3, 2.0, 9.0])
def test_clock_that_stood_while_answers_come_is_no_delay(stood_s: float) -> None:
    """A simulation that paused, or a clock that was set."""
    vehicle = known()
    vehicle.fly([START_MS + 50], 10.05 + stood_s)
    answer(vehicle, 10.05 + stood_s, TRIP_S)
    assert found_s(vehicle, stood_s, from_s=10.1) == pytest.approx([0.0] * 10, abs=5e-3)


def test_simulation_that_is_slow_for_an_hour_is_no_delay() -> None:
    """Its clock loses 5 %; even with answers that are lost later it does not count as late."""
    vehicle = known()
    for second in range(0, 3600, 2):
        reported = vehicle.fly([START_MS + 100 + 950 * second], 10.1 + second)
        answer(vehicle, 10.15 + second, TRIP_S)
    for second in range(8):
        asked(vehicle, 3610.0 + second)
        reported = vehicle.fly([START_MS + 100 + round(950 * (3600.4 + second))], 3610.5 + second)
    assert float(reported.position_late_s[0]) <= 0.5 + PROMPT_S


def test_position_behind_the_vehicles_other_messages_is_late() -> None:
    vehicle = flying()
    for at in range(10):
        attitude = dialect.MAVLink_attitude_message(START_MS + 1500 + 100 * at, 0, 0, 0, 0, 0, 0)
        vehicle.take(1.55 + 0.1 * at, attitude)
        reported = vehicle.fly([START_MS + 100 + 100 * at], 1.6 + 0.1 * at)
    assert float(reported.position_late_s[0]) == pytest.approx(1.4, abs=0.01)


def test_vehicle_without_answers_is_dated_by_arrival() -> None:
    vehicle = flying()
    reported = vehicle.fly([START_MS + 100], 1.6)
    assert reported.position_late_s[0] == 0.0


@pytest.mark.parametrize("name", ["session", "kill"])
def test_no_recorded_position_is_late(name: str) -> None:
    fleet, most_s = FleetTelemetry(("d1",)), 0.0
    for time_s, frame in frames(f"ardupilot/{name}.tlog.xz"):
        read(fleet, time_s, frame)
        most_s = max(most_s, float(fleet.clock_late_s[0]), float(fleet.telemetry().position_late_s[0]))
    assert np.isfinite(fleet.position_time_s[0])
    assert most_s < 0.1
