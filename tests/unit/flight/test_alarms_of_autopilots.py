"""What autopilots do and ask by themselves is told as such: a termination, a landing that they ask for."""

from dataclasses import replace

import numpy as np

from gcs.control import Memory, Tick
from gcs.failsafe.autopilot_failsafe import FailsafeCause
from gcs.flight.monitors.alarm_monitor import AlarmMonitor, Findings
from gcs.flight.state.flight import Flight
from gcs.flight.state.vehicle import VehicleStatus
from gcs.model.lifecycle import Event, Phase
from gcs.model.state import Landed, Mode, Setpoints, StatusText
from gcs.safety.floor import Floor
from gcs.service.alarms import Alarm, AlarmSeverity
from gcs.simulation.reference_shapes import best
from tests.unit.flight.test_assembled import CENTER_M, RADIUS_M, at, flight

COUNT = 4
LAND_NOW = "Compass needs calibration - Land now!"
TERMINATED = VehicleStatus(silent=False, mode=Mode.TERMINATED, armed=True, landed=Landed.IN_AIR)


def flying() -> Flight:
    subject = at(flight(COUNT), CENTER_M + RADIUS_M * best(COUNT))
    subject.newest.silent = np.zeros(COUNT, np.bool_)
    return subject


def listed(subject: Flight) -> dict[str, Alarm]:
    """By their causes."""
    monitor, memory = AlarmMonitor(subject), Memory.fresh(COUNT, 0.0)
    nothing = Setpoints(0.0, (), np.zeros((0, 3)), np.zeros(0))
    place_m, airborne = subject.newest.state.position_m, np.ones(COUNT, np.bool_)
    monitor.look(Tick(nothing, lambda: memory, ("",) * COUNT, place_m, airborne, Floor()), Findings())
    return {alarm.cause.value: alarm for alarm in monitor.alarms}


def test_termination_is_an_emergency_and_no_pilot() -> None:
    subject = flying()
    vehicle = subject.vehicles.named("d2")
    assert vehicle.observe(TERMINATED)
    (alarm,) = listed(subject).values()
    assert (alarm.cause, alarm.severity) == ("terminated", AlarmSeverity.EMERGENCY)
    assert alarm.text == (
        "Vehicle d2 falling: its autopilot has stopped its motors (flight termination, or a kill switch)."
        " Other vehicles keep clear of where it was."
    )
    assert "confirm-down" in alarm.advice
    vehicle.apply(Event.KILL, "motors stopped on command")
    assert list(listed(subject)) == ["killed"]


def test_space_below_a_terminated_vehicle_is_closed() -> None:
    subject = flying()
    subject.note_seen(np.ones(COUNT, np.bool_))
    assert len(subject.closed()[0]) == 0
    assert subject.vehicles.named("d2").observe(TERMINATED)
    segments_m, _ = subject.closed()
    here_m = subject.newest.position_m(subject.vehicles.named("d2"))
    below = (np.abs(segments_m[:, :, :2] - here_m[:2]).max(axis=(1, 2)) < 0.1) & (segments_m[:, 1, 2] > -0.1)
    assert below.any()
    assert subject.closing() == {"d2"}


def test_landing_that_an_autopilot_asks_for_is_an_alarm() -> None:
    subject = flying()
    texts = tuple((StatusText(0.0, 2, LAND_NOW),) if row == 1 else () for row in range(COUNT))
    subject.newest.telemetry = replace(subject.newest.telemetry, texts=texts)
    (alarm,) = listed(subject).values()
    assert alarm.text == f'Vehicle d1 asked to land by the autopilot: "{LAND_NOW}".'
    assert (alarm.advice, alarm.vehicles) == ("Land it.", ("d1",))
    subject.vehicles.named("d1").phase = Phase.STANDBY
    assert listed(subject) == {}, "it has landed"


def test_own_failsafe_of_a_blind_vehicle_is_one_alarm() -> None:
    """It says why: no second one beside it has the cause."""
    subject = flying()
    doubtful = np.arange(COUNT) == 2
    subject.newest.state = replace(subject.newest.state, doubtful=doubtful)
    vehicle = subject.vehicles.named(subject.newest.state.ids[2])
    vehicle.apply(Event.TAKEN_OVER, f"{vehicle.id} lands by its own position-loss failsafe. Leave it.")
    vehicle.cause = FailsafeCause.POSITION_LOSS
    (alarm,) = listed(subject).values()
    assert alarm.cause == "own-failsafe"
    assert "lands by its own position-loss failsafe: its receiver has no 3D fix" in alarm.text
