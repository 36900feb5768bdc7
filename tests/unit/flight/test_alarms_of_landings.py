"""A vehicle that lands and gets no lower is named; those that get on, or wait for lower ones, are not."""

import numpy as np
import pytest

from gcs.flight.monitors.landing_alarms import NOT_LOWER_S, LandingAlarms
from gcs.flight.state.flight import Flight
from gcs.model.lifecycle import Phase
from gcs.model.state import Array, FleetState
from gcs.service.alarms import CAUSES, AlarmCause, AlarmSeverity
from tests.unit.flight.test_assembled import flight

UP_M = np.array([[0.0, 0.0, -14.0], [9.0, 0.0, -20.0]])


def landing() -> Flight:
    """Two vehicles above their places."""
    subject = flight(2)
    for vehicle, place_m in zip(subject.vehicles.values(), UP_M, strict=True):
        vehicle.phase, vehicle.goal_m = Phase.LANDING, place_m * (1.0, 1.0, 0.0)
    return at(subject, 0.0, UP_M)


def at(subject: Flight, time_s: float, place_m: Array) -> Flight:
    ids, zero = subject.newest.state.ids, np.zeros(2)
    subject.newest.state = FleetState(time_s, ids, place_m, np.zeros((2, 3)), zero, zero)
    return subject


def named(monitor: LandingAlarms) -> list[tuple[str, ...]]:
    conditions = list(monitor.conditions())
    assert {each.cause for each in conditions} <= {AlarmCause.NOT_LOWER}
    return [each.vehicles for each in conditions]


def alarms(subject: Flight) -> LandingAlarms:
    return LandingAlarms(subject.newest, subject.vehicles, subject.may_descend)


def test_only_what_gets_no_lower_is_named() -> None:
    subject = landing()
    monitor = alarms(subject)
    for second in range(int(NOT_LOWER_S) + 1):
        at(
            subject,
            float(second),
            UP_M + np.array([[0.0, 0.0, 0.2 * (second % 2)], [0.0, 0.0, 0.4 * second]]),
        )
        listed = named(monitor)
    assert listed == [("d0",)]
    (condition,) = monitor.conditions()
    assert condition.because == "14 m high, and no lower for 20 s"
    assert CAUSES[AlarmCause.NOT_LOWER].severity is AlarmSeverity.WARNING
    at(subject, 30.0, UP_M + np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 9.0]]))
    assert named(monitor) == []


@pytest.mark.parametrize("handed_over", [False, True])
def test_a_way_to_a_place_counts_while_it_is_led(*, handed_over: bool) -> None:
    """Nearer to its place it gets on; what its own LAND does sideways does not bring it down."""
    subject = landing()
    subject.vehicles["d0"].goal_m = np.array([60.0, 0.0, -14.0])
    subject.vehicles["d0"].set_flags(handed_over=handed_over)
    monitor = alarms(subject)
    for second in range(int(NOT_LOWER_S) + 1):
        at(subject, float(second), UP_M + np.array([[2.0 * second, 0.0, 0.0], [0.0, 0.0, 0.4 * second]]))
        listed = named(monitor)
    assert listed == ([("d0",)] if handed_over else [])


def test_a_vehicle_that_waits_for_lower_ones_is_not_named() -> None:
    """The lower one, which is not above its place yet, is."""
    subject = landing()
    subject.vehicles["d0"].goal_m = np.array([30.0, 0.0, -14.0])
    monitor = alarms(subject)
    for second in range(int(NOT_LOWER_S) + 1):
        at(subject, float(second), UP_M)
        listed = named(monitor)
    assert listed == [("d0",)]


def test_the_time_counts_from_each_landing_on() -> None:
    subject = landing()
    monitor = alarms(subject)
    assert named(monitor) == []
    subject.vehicles["d0"].phase = Phase.HOLD
    assert named(at_later(monitor, subject, 15.0)) == []
    subject.vehicles["d0"].phase = Phase.LANDING
    assert named(at_later(monitor, subject, 16.0)) == []
    assert named(at_later(monitor, subject, 25.0)) == [("d1",)]
    assert named(at_later(monitor, subject, 36.0)) == [("d0",), ("d1",)]
    unknown_m = UP_M.copy()
    unknown_m[0] = np.nan
    at(subject, 37.0, unknown_m)
    assert named(monitor) == [("d1",)]


def at_later(monitor: LandingAlarms, subject: Flight, time_s: float) -> LandingAlarms:
    at(subject, time_s, UP_M)
    return monitor
