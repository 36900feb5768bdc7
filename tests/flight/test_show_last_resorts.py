"""No vehicle is left hovering: superseded commands, refusals, vehicles that become ours late."""

from typing import NamedTuple

import numpy as np
import pytest

from gcs.links import Verb
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import AIRBORNE, Phase, ShowPhase
from gcs.model.state import Mode
from gcs.service import CommandRecord, Outcome, ShowAction, VehicleAction
from gcs.service.alarms import AlarmCause
from gcs.sim.vehicle.px4 import Mode as PilotMode
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, fly, refused, show_config
from tests.support.show_phases import running


async def hold_overtaken_by_stop(show: VirtualShow) -> tuple[CommandRecord, ShowPhase, list[bool]]:
    """HOLD is on its way to d1 when the whole show is ordered home."""
    show.service.commands.command_vehicle("d1", VehicleAction.HOLD)
    await show.wait(0.02)
    stopped = await show.settled(show.service.commands.command_show(ShowAction.STOP), 120.0)
    await show.reach(ShowPhase.LANDED)
    return stopped, show.view.show, [vehicle.armed for vehicle in vehicles_of(show.view)]


@pytest.mark.soak
def test_vehicle_with_hold_overtaken_by_stop_returns_home() -> None:
    stopped, phase, armed = fly(hold_overtaken_by_stop, show_config(3), after=running)
    assert stopped.outcome is Outcome.DONE
    assert (phase, armed) == (ShowPhase.LANDED, [False] * 3)


async def hold_that_comes_late(show: VirtualShow) -> tuple[list[Phase], int]:
    """An order to hold is refused, and its autopilot holds a while later nevertheless."""
    show.ports.refused.add(("d1", Verb.HOLD))
    held = await show.command("d1", VehicleAction.HOLD)
    assert held.outcome is Outcome.FAILED
    show.pilot("d1", PilotMode.HOLD)
    await show.phase("d1", Phase.HOLD, 5.0)
    began_s = show.now_s
    await show.wait(2.0)
    return show.track.phases("d1"), sum(setpoint.time_s > began_s for setpoint in show.ports.sent["d1"])


@pytest.mark.soak
def test_hold_that_seemed_to_fail_is_noticed_when_it_succeeds() -> None:
    phases, setpoints_after = fly(hold_that_comes_late, show_config(2), after=running)
    assert phases[-2:] == [Phase.FORMATION, Phase.HOLD]
    assert setpoints_after == 0


class Refused(NamedTuple):
    record: CommandRecord
    verbs: list[Verb]
    show: ShowPhase
    armed: list[bool]


async def offboard_refused_on_the_way_down(show: VirtualShow) -> Refused:
    """d2 holds; when all are to come down its autopilot refuses OFFBOARD, again and again."""
    await show.command("d2", VehicleAction.HOLD)
    show.ports.refused.add(("d2", Verb.OFFBOARD))
    began_s = show.now_s
    record = await show.settled(show.service.commands.command_show(ShowAction.ABORT), 120.0)
    await show.reach(ShowPhase.LANDED)
    verbs = [command.verb for command in show.ports.commands["d2"] if command.time_s > began_s]
    return Refused(record, verbs, show.view.show, [vehicle.armed for vehicle in vehicles_of(show.view)])


def test_autopilot_land_is_the_last_resort_without_offboard() -> None:
    flight = fly(offboard_refused_on_the_way_down, show_config(3), after=running)
    assert flight.verbs == [Verb.OFFBOARD] * 3 + [Verb.LAND]
    assert flight.record.outcome is Outcome.DONE
    assert (flight.show, flight.armed) == (ShowPhase.LANDED, [False] * 3)


async def land_refused_for_long(show: VirtualShow) -> tuple[list[tuple[str, ...]], bool, ShowPhase]:
    """The autopilot of d2 refuses its LAND, until it obeys again."""
    show.ports.refused.add(("d2", Verb.LAND))
    show.service.commands.command_show(ShowAction.ABORT)
    named = list[tuple[str, ...]]()
    for _ in range(90):
        await show.wait(1.0)
        named += [each.vehicles for each in show.view.alarms if each.cause is AlarmCause.NOT_LOWER]
    show.ports.refused.clear()
    await show.reach(ShowPhase.LANDED)
    await show.wait(2.0)
    lasts = any(each.lasts for each in show.view.alarms if each.cause is AlarmCause.NOT_LOWER)
    return named, lasts, show.view.show


@pytest.mark.soak
def test_vehicle_that_lands_and_gets_no_lower_is_named() -> None:
    named, lasts, phase = fly(land_refused_for_long, show_config(3), after=running)
    assert set(named) == {("d2",)}
    assert len(named) > 20
    assert (lasts, phase) == (False, ShowPhase.LANDED)


async def offboard_refused_after_the_climb(show: VirtualShow) -> CommandRecord:
    """d2 climbs, and then its autopilot refuses OFFBOARD: the others assemble without it."""
    await show.standby()
    show.ports.refused.add(("d2", Verb.OFFBOARD))
    record = show.service.commands.command_show(ShowAction.START)
    await show.reach(ShowPhase.RUNNING, 90.0)
    assert show.vehicle("d2").phase is Phase.HOLD
    return await show.settled(record)


@pytest.mark.soak
def test_vehicle_that_cannot_join_after_climb_fails_the_start() -> None:
    record = fly(offboard_refused_after_the_climb, show_config(3))
    assert record.outcomes["d1"].outcome is Outcome.DONE
    assert record.outcomes["d2"].outcome is Outcome.FAILED
    assert "offboard failed (COMMAND_DENIED)" in record.outcomes["d2"].reason


class ControlTaken(NamedTuple):
    taken: ShowPhase
    given_back: ShowPhase
    refusal: type[Exception]
    landed: ShowPhase
    armed: list[bool]


async def all_taken_over_then_control_taken(show: VirtualShow) -> ControlTaken:
    """Pilots take both vehicles, and so the show is over; then one is handed back."""
    for name in ("d1", "d2"):
        show.pilot(name, PilotMode.HOLD)
        await show.phase(name, Phase.PILOT)
    await show.wait(1.0)
    taken = show.view.show
    await show.command("d1", VehicleAction.TAKE_CONTROL)
    await show.wait(0.2)
    given_back = show.view.show
    turned_down = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
    await show.settled(show.service.commands.command_show(ShowAction.ABORT), 120.0)
    await show.reach(ShowPhase.UNCONTROLLED)
    return ControlTaken(
        taken,
        given_back,
        turned_down.kind,
        show.view.show,
        [vehicle.armed for vehicle in vehicles_of(show.view)],
    )


@pytest.mark.soak
def test_vehicle_taken_after_the_show_can_be_landed() -> None:
    flight = fly(all_taken_over_then_control_taken, show_config(2), after=running)
    assert flight.taken is ShowPhase.UNCONTROLLED, "two are airborne"
    assert flight.given_back is ShowPhase.PAUSED, "one is: the show is not over"
    assert flight.refusal is RefusedError
    assert (flight.landed, flight.armed) == (ShowPhase.UNCONTROLLED, [False, True])


async def stop_again_and_again(show: VirtualShow) -> list[CommandRecord]:
    """Stop, abort, abort and stop while all are on their way down."""
    records = []
    for action in (ShowAction.STOP, ShowAction.ABORT, ShowAction.ABORT, ShowAction.STOP):
        records.append(show.service.commands.command_show(action))
        await show.wait(3.0)
    await show.reach(ShowPhase.LANDED, 120.0)
    await show.wait(0.2)
    assert show.floor_violations() == 0
    return [show.service.command_log.get(record.id) for record in records]


@pytest.mark.soak
def test_return_and_landing_can_be_commanded_whenever_airborne() -> None:
    *replaced, last = fly(stop_again_and_again, show_config(3), after=running)
    assert [record.outcome for record in replaced] == [Outcome.FAILED] * 3
    assert last.outcome is Outcome.DONE


async def refuses_to_hold_when_lost(show: VirtualShow) -> tuple[ShowPhase, int, str]:
    """A lost vehicle is received again and refuses HOLD for ever; the others come home meanwhile."""
    show.ports.refused.add(("d2", Verb.HOLD))
    show.ports.silence("d2")
    await show.phase("d2", Phase.LOST)
    show.ports.restore("d2")
    await show.settled(show.service.commands.command_show(ShowAction.STOP), 120.0)
    await show.reach(ShowPhase.LANDED)
    attempts = sum(command.verb is Verb.HOLD for command in show.ports.commands["d2"])
    next_command = show.service.commands.kill(["d1"]).id
    return show.view.show, attempts, next_command


@pytest.mark.soak
def test_one_disobedient_vehicle_does_not_keep_the_show_alive() -> None:
    phase, attempts, next_command = fly(
        refuses_to_hold_when_lost, show_config(3, operation=HOLDS_WHEN_LOST), after=running
    )
    assert phase is ShowPhase.LANDED
    assert 3 <= attempts <= 20, "now and then, not without pause"
    assert next_command == "o4", (
        "start, re-form, stop; that it tries again by itself is no order of anybody's"
    )


async def found_in_the_air(show: VirtualShow) -> tuple[str, list[bool]]:
    """The service has no record of where a vehicle started: as after a restart."""
    vehicle = show.service.flight.vehicles["d1"]
    show.pilot("d1", PilotMode.HOLD)
    await show.phase("d1", Phase.PILOT)
    vehicle.home_m = None
    await show.command("d1", VehicleAction.TAKE_CONTROL)
    turned_down = await refused(
        show, lambda: show.service.commands.command_vehicle("d1", VehicleAction.RETURN)
    )
    await show.settled(show.service.commands.command_show(ShowAction.STOP), 120.0)
    await show.reach(ShowPhase.LANDED)
    assert not any(seen.phase in AIRBORNE for seen in vehicles_of(show.view))
    return turned_down.text, [seen.armed for seen in vehicles_of(show.view)]


@pytest.mark.soak
def test_vehicle_with_unknown_start_lands_where_it_is() -> None:
    text, armed = fly(found_in_the_air, show_config(2), after=running)
    assert text == "d1 cannot return: where it started is not known; use land; accepted instead: land d1"
    assert armed == [False, False]


async def turn_comes_late(show: VirtualShow) -> CommandRecord:
    """While d1 climbs, d2's position freezes: its turn comes when it may no longer fly."""
    await show.standby()
    record = show.service.commands.command_show(ShowAction.START)
    show.ports.silence("d2", up=False)
    await show.reach(ShowPhase.ASSEMBLING)
    assert Mode.TAKEOFF not in {seen.mode for seen in show.track.of("d2")}
    assert not np.any([sample.armed[1] for sample in show.track.samples])
    return await show.settled(record)


@pytest.mark.soak
def test_vehicle_is_checked_again_at_its_turn_to_take_off() -> None:
    record = fly(turn_comes_late, show_config(2))
    assert record.outcomes["d1"].outcome is Outcome.DONE
    assert record.outcomes["d2"].outcome is Outcome.FAILED
    assert "no position for" in record.outcomes["d2"].reason
