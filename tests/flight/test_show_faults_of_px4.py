"""What a real PX4 does by itself is reported in the right words within a second, and so is what to do."""

from typing import Any

import pytest

from gcs.failsafe.autopilot_failsafe import FailsafeCause
from gcs.model.lifecycle import Phase
from gcs.service import Outcome, ShowAction, VehicleAction
from gcs.service.alarms import AlarmCause, AlarmSeverity
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, fly, refused, show_config
from tests.support.show_phases import running

pytestmark = pytest.mark.soak

FOUR = show_config(4, operation=HOLDS_WHEN_LOST)

ABOUT_OTHERS = {
    AlarmCause.RADIUS_SMALL,
    AlarmCause.LITTLE_AUTHORITY,
    AlarmCause.SLOW_ANSWERS,
    AlarmCause.SLOW_VEHICLE,
    AlarmCause.WIND,
}
REPORTED_S, BEAT_S = 1.0, 1.2
"""Told within this time of what is received; a heartbeat tells a mode once a second."""
ACTS_S = 4.8
"""So long after its receiver has failed PX4 descends, in mode LAND."""


async def blind(show: VirtualShow) -> dict[str, Any]:
    began_s = show.now_s
    show.befall("d2", "fix", type="no-gps")
    await show.wait(REPORTED_S)
    first = {alarm.cause: alarm for alarm in show.view.alarms}
    await show.wait(ACTS_S + BEAT_S)
    then = {alarm.cause: alarm for alarm in show.view.alarms if alarm.lasts}
    cause = show.service.flight.vehicles["d2"].cause
    taken = await refused(
        show, lambda: show.service.commands.command_vehicle("d2", VehicleAction.TAKE_CONTROL)
    )
    await show.phase("d2", Phase.STANDBY, 60.0)
    seen = {alarm.cause for one in show.track.between(began_s).samples for alarm in one.view.alarms}
    violations = show.floor_violations()
    return {
        "first": first,
        "then": then,
        "cause": cause,
        "taken": taken,
        "seen": seen,
        "violations": violations,
    }


@pytest.mark.soak
def test_blind_vehicle_is_told_as_one_that_cannot_be_steered() -> None:
    found = fly(blind, FOUR, after=running)
    reported = found["first"][AlarmCause.BAD_POSITION]
    assert (reported.vehicles, "no 3D fix" in reported.text) == (("d2",), True)
    assert found["cause"] is FailsafeCause.POSITION_LOSS
    own = found["then"][AlarmCause.OWN_FAILSAFE]
    assert "lands by its own position-loss failsafe" in own.text
    assert own.advice == "It cannot be steered without a position: leave it, keep clear of it."
    assert (own.vehicles, "no 3D fix" in own.text) == (("d2",), True)
    assert AlarmCause.BAD_POSITION not in found["then"], "one alarm has the cause, and what to do"
    assert "no 3D fix" in found["taken"].text
    assert not found["seen"] & ABOUT_OTHERS
    assert found["violations"] == 0


async def terminated(show: VirtualShow) -> dict[str, Any]:
    show.befall("d2", "termination")
    await show.wait(BEAT_S + REPORTED_S)
    seen = {alarm.cause: alarm for alarm in show.view.alarms}
    phase = show.vehicle("d2").phase
    await show.wait(5.0)
    down = await show.command("d2", VehicleAction.CONFIRM_DOWN)
    await show.wait(2.0)
    after, stays = {alarm.cause for alarm in show.view.alarms if alarm.lasts}, show.vehicle("d2").phase
    home = await show.show(ShowAction.STOP)
    return {
        "seen": seen,
        "phase": phase,
        "down": down.outcome,
        "after": after,
        "stays": stays,
        "home": home,
        "violations": show.floor_violations(),
    }


def test_flight_termination_is_told_at_once_and_confirmed_down() -> None:
    found = fly(terminated, FOUR, after=running)
    alarm = found["seen"][AlarmCause.TERMINATED]
    assert (alarm.severity, alarm.vehicles) == (AlarmSeverity.EMERGENCY, ("d2",))
    assert not {AlarmCause.OUTSIDE_CONTROL, AlarmCause.OWN_FAILSAFE} & found["seen"].keys()
    assert found["phase"] is Phase.KILLED
    assert found["down"] is Outcome.DONE
    assert AlarmCause.TERMINATED not in found["after"]
    assert found["stays"] is Phase.STANDBY
    assert {part.outcome for part in found["home"].outcomes.values()} == {Outcome.DONE}
    assert found["violations"] == 0


async def asked_to_land(show: VirtualShow) -> dict[str, Any]:
    show.befall("d2", "compass")
    await show.wait(REPORTED_S)
    seen = {alarm.cause: alarm for alarm in show.view.alarms}
    landed = await show.command("d2", VehicleAction.LAND)
    return {"seen": seen, "landed": landed.outcome}


@pytest.mark.soak
def test_landing_that_px4_asks_for_is_told_and_works() -> None:
    found = fly(asked_to_land, FOUR, after=running)
    alarm = found["seen"][AlarmCause.LAND_NOW]
    assert (alarm.vehicles, alarm.advice) == (("d2",), "Land it.")
    assert "Compass needs calibration - Land now!" in alarm.text
    assert found["landed"] is Outcome.DONE
