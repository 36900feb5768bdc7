"""A vehicle whose receiver fails goes on sending positions: it is told as blind, and no other vehicle is."""

from typing import Any

from gcs.failsafe.autopilot_failsafe import FailsafeCause
from gcs.model.lifecycle import Phase
from gcs.service import VehicleAction
from gcs.service.alarms import AlarmCause
from gcs.sim.vehicle.px4 import Mode as PilotMode
from tests.support.show_phases import running
from tests.support.virtual_show import HOLDS_WHEN_LOST, Show, fly, refused, show_config

ABOUT_OTHERS = {
    AlarmCause.RADIUS_SMALL,
    AlarmCause.LITTLE_AUTHORITY,
    AlarmCause.SLOW_ANSWERS,
    AlarmCause.SLOW_VEHICLE,
    AlarmCause.WIND,
}
ACTS_S = 4.8
"""So long after its receiver had failed a real PX4 v1.16 descended, in mode LAND."""


async def blind(show: Show) -> dict[str, Any]:
    began_s = show.now_s
    show.befall("d2", "fix", type="none")
    await show.wait(0.8)
    first = {alarm.cause: alarm for alarm in show.view.alarms}
    await show.wait(ACTS_S - 0.8)
    show.autopilot("d2").commander._intervene(PilotMode.LAND)
    show.autopilot("d2").commander.send_text(2, "Failsafe activated\t")
    await show.phase("d2", Phase.PILOT, 2.0)
    await show.wait(2.0)
    then = {alarm.cause: alarm for alarm in show.view.alarms if alarm.lasts}
    cause = show.service._flight.vehicles["d2"].cause
    taken = await refused(
        show, lambda: show.service.commands.command_vehicle("d2", VehicleAction.TAKE_CONTROL)
    )
    seen = {alarm.cause for one in show.track.between(began_s).samples for alarm in one.view.alarms}
    return {"first": first, "then": then, "cause": cause, "taken": taken, "seen": seen}


def test_blind_vehicle_is_told_as_one_that_cannot_be_steered() -> None:
    found = fly(blind, show_config(4, operation=HOLDS_WHEN_LOST), after=running)
    told = found["first"][AlarmCause.BAD_POSITION]
    assert (told.vehicles, "no 3D fix" in told.text) == (("d2",), True), "within a second"
    assert found["cause"] is FailsafeCause.POSITION_LOSS
    own = found["then"][AlarmCause.OWN_FAILSAFE]
    assert "lands by its own position-loss failsafe" in own.text
    assert own.advice == "It cannot be steered without a position: leave it, keep clear of it."
    assert found["then"][AlarmCause.BAD_POSITION].vehicles == ("d2",), "as long as it lasts"
    assert "cannot be steered" in found["then"][AlarmCause.BAD_POSITION].advice
    assert "no 3D fix" in found["taken"].text
    assert not found["seen"] & ABOUT_OTHERS
