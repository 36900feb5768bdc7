"""Alarms of vehicles that could fall near, or beyond, the edge of the controlled ground."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.flight.monitors.ground_alarms import BACK_M, GroundAlarms
from gcs.flight.state.flight import Flight
from gcs.model.lifecycle import Phase
from gcs.model.state import FleetState
from gcs.safety.controlled_ground import kept_in_m
from gcs.safety.fenced_areas import FencedArea
from gcs.safety.impact import ImpactSettings
from gcs.safety.walls import Fence
from gcs.service.alarms import CAUSES, AlarmAction, AlarmCause, AlarmSeverity
from tests.unit.flight.test_assembled import flight

ROOM = FencedArea(corners_m=((-90.0, -90.0), (90.0, -90.0), (90.0, 90.0), (-90.0, 90.0)))
IMPACT = ImpactSettings()
HEIGHT_M = 30.0
REACH_M = float(kept_in_m(np.array([HEIGHT_M]), IMPACT)[0]) - IMPACT.soft_m


def with_margins(*margins_m: float, ground: FencedArea | None = ROOM) -> Flight:
    """Vehicles at rest that would fall so far inside the edge."""
    subject = flight(len(margins_m))
    for vehicle in subject.vehicles.values():
        vehicle.phase = Phase.FORMATION
    safety = subject.in_force.control.safety.model_copy(update={"fence": Fence(controlled_ground=ground)})
    subject.in_force.control = subject.in_force.control.model_copy(update={"safety": safety})
    return at(subject, *margins_m)


def at(subject: Flight, *margins_m: float) -> Flight:
    place_m = np.array([[90.0 - REACH_M - margin_m, 0.0, -HEIGHT_M] for margin_m in margins_m])
    n, state = len(margins_m), subject.newest.state
    subject.newest.state = FleetState(1.0, state.ids, place_m, np.zeros((n, 3)), np.zeros(n), np.zeros(n))
    return subject


def alarms(subject: Flight) -> GroundAlarms:
    return GroundAlarms(subject.newest, subject.in_force, subject.vehicles)


def test_each_line_has_its_alarm() -> None:
    conditions = list(alarms(with_margins(5.0, 0.6, -1.4)).conditions())
    assert [(each.cause, each.vehicles) for each in conditions] == [
        (AlarmCause.GROUND_LEFT, ("d2",)),
        (AlarmCause.GROUND_NEAR, ("d1",)),
    ]
    assert conditions[0].because == "if [its|their] motors stopped now, up to 1.4 m beyond the edge"
    assert conditions[1].because == "it could fall 0.6 m from the edge, 1 m are kept"
    assert CAUSES[AlarmCause.GROUND_LEFT].severity is AlarmSeverity.EMERGENCY
    assert CAUSES[AlarmCause.GROUND_LEFT].action is AlarmAction.LAND


def test_a_margin_at_the_line_does_not_flicker() -> None:
    subject = with_margins(0.9)
    monitor = alarms(subject)
    seen = [len(list(monitor.conditions()))]
    for margin_m in (1.0 + BACK_M / 2, 1.0 + 2.0 * BACK_M, 1.0 + BACK_M / 2):
        at(subject, margin_m)
        seen.append(len(list(monitor.conditions())))
    assert seen == [1, 1, 0, 0]


@pytest.mark.parametrize("phase", [Phase.STANDBY, Phase.OFFLINE])
def test_vehicles_on_the_ground_are_not_named(phase: Phase) -> None:
    subject = with_margins(-1.4)
    subject.vehicles["d0"].phase = phase
    assert list(alarms(subject).conditions()) == []


def test_without_controlled_ground_nothing_is_named() -> None:
    assert list(alarms(with_margins(-1.4, ground=None)).conditions()) == []


def test_a_pilot_is_named_as_well_and_unknown_places_are_not() -> None:
    subject = with_margins(-1.4, -1.4)
    subject.vehicles["d0"].phase = Phase.PILOT
    state = subject.newest.state
    position_m = np.array(state.position_m)
    position_m[1] = np.nan
    subject.newest.state = replace(state, position_m=position_m)
    assert [each.vehicles for each in alarms(subject).conditions()] == [("d0",)]
