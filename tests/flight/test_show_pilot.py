"""Vehicles that a person, or their own failsafe, takes over, while the others fly on."""

from typing import NamedTuple

import pytest

from gcs.links import Verb
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Mode, VehicleId
from gcs.service import CommandRecord, Outcome, ShowAction, VehicleAction
from gcs.sim.vehicle.px4 import Mode as PilotMode
from gcs.testing.virtual_show import (
    HOLDS_WHEN_LOST,
    JUMP_M_S,
    SLOWLY_DISARMED,
    FlownTrack,
    RefusedCall,
    VirtualShow,
    fly,
    refused,
    show_config,
)
from tests.support.show_phases import running


class TakenOver(NamedTuple):
    track: FlownTrack
    change_s: dict[VehicleId, float]
    pilot_s: dict[VehicleId, float]
    sent_to_pilots: dict[VehicleId, int]  # setpoints after the takeover was seen
    commands_to_pilots: dict[VehicleId, int]
    stopped: CommandRecord
    control_taken: CommandRecord
    after_take_control: FlownTrack
    refusals: dict[str, RefusedCall]


async def taken_over(show: VirtualShow) -> TakenOver:
    """A person takes d3; d1 receives nothing any more and fails safe, while it still reports."""
    change_s: dict[VehicleId, float] = {"d3": show.now_s}
    pilot_s: dict[VehicleId, float] = {}
    show.pilot("d3", PilotMode.HOLD)
    await show.phase("d3", Phase.PILOT)
    pilot_s["d3"] = show.now_s
    change_s["d1"] = show.now_s
    show.ports.silence("d1", down=False)
    await show.phase("d1", Phase.PILOT)
    pilot_s["d1"] = show.now_s
    show.ports.restore("d1")
    commands_before = {name: len(show.ports.commands[name]) for name in ("d1", "d3")}
    await show.wait(4.0)
    refusals = {
        name: await refused(show, lambda action=action: show.service.commands.command_vehicle("d3", action))  # type: ignore[misc]
        for name, action in (("join", VehicleAction.JOIN), ("hold", VehicleAction.HOLD))
    }
    sent = {
        name: sum(setpoint.time_s > pilot_s[name] for setpoint in show.ports.sent[name])
        for name in ("d1", "d3")
    }
    commands = {name: len(show.ports.commands[name]) - commands_before[name] for name in ("d1", "d3")}
    back_s = show.now_s
    control_taken = await show.command("d3", VehicleAction.TAKE_CONTROL)
    await show.wait(2.0)
    await show.command("d3", VehicleAction.JOIN)
    await show.wait(5.0)
    after = show.track.between(back_s)
    stopped = await show.show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED)
    return TakenOver(show.track, change_s, pilot_s, sent, commands, stopped, control_taken, after, refusals)


@pytest.fixture(scope="module")
def recovery() -> TakenOver:
    return fly(taken_over, after=running, parameters=SLOWLY_DISARMED)


@pytest.mark.parametrize("name", ["d1", "d3"])
def test_mode_not_commanded_here_gives_the_pilot_control(recovery: TakenOver, name: VehicleId) -> None:
    waited_s = recovery.pilot_s[name] - recovery.change_s[name]
    assert waited_s < 2.3  # failing safe takes a second, and the next heartbeat another
    seen = recovery.track.between(recovery.pilot_s[name]).of(name)[0]
    assert seen.phase is Phase.PILOT
    assert "this station did not command" in seen.reason or "setpoint-loss failsafe" in seen.reason


def test_the_autopilots_own_failsafe_counts_as_a_pilot(recovery: TakenOver) -> None:
    assert Mode.POSITION in {seen.mode for seen in recovery.track.of("d1") if seen.phase is Phase.PILOT}


@pytest.mark.parametrize("name", ["d1", "d3"])
def test_piloted_vehicle_gets_no_setpoints_and_no_commands(recovery: TakenOver, name: VehicleId) -> None:
    assert recovery.sent_to_pilots[name] == 0
    assert recovery.commands_to_pilots[name] == 0


def test_commands_to_a_piloted_vehicle_are_refused(recovery: TakenOver) -> None:
    for refusal in recovery.refusals.values():
        assert refusal.kind is RefusedError
        assert "d3: " in refusal.text
        assert "not possible while pilot" in refusal.text


def test_taken_vehicle_holds_and_joins_without_a_jump(recovery: TakenOver) -> None:
    assert recovery.control_taken.outcome is Outcome.DONE
    assert recovery.after_take_control.phases("d3") == [Phase.PILOT, Phase.HOLD, Phase.FORMATION]
    assert recovery.after_take_control.hardest_change_m_s() < JUMP_M_S


def test_stop_leaves_a_piloted_vehicle_and_the_show_ends(recovery: TakenOver) -> None:
    left_out = recovery.stopped.outcomes["d1"]
    assert (left_out.outcome, left_out.reason[:6]) == (Outcome.NOT_INCLUDED, "pilot:")
    assert recovery.stopped.outcome is Outcome.DONE


def test_vehicle_that_fails_safe_to_the_ground_is_on_standby(recovery: TakenOver) -> None:
    assert recovery.track.phases("d1")[-2:] == [Phase.PILOT, Phase.STANDBY]


async def taken_over_while_it_joins(show: VirtualShow) -> tuple[CommandRecord, set[Verb]]:
    """The pilot reports while setpoints flow already, and OFFBOARD is about to be ordered."""
    await show.command("d1", VehicleAction.HOLD)
    await show.until(lambda: 0.9 < (show.vehicle("d1").heartbeat_age_s or 0.0) < 0.98)
    began_s = show.now_s
    show.pilot("d1", PilotMode.RETURN)
    joined = await show.command("d1", VehicleAction.JOIN)
    await show.wait(2.0)
    return joined, {command.verb for command in show.ports.commands["d1"] if command.time_s > began_s}


@pytest.mark.soak
def test_pilot_takeover_ends_the_planned_actions() -> None:
    joined, verbs = fly(taken_over_while_it_joins, show_config(2), after=running)
    assert joined.outcome is Outcome.FAILED
    assert (
        "d1 is pilot now: d1 is in mode return, which this station did not command"
        in joined.outcomes["d1"].reason
    )
    assert verbs == set()


class SilentPilot(NamedTuple):
    track: FlownTrack  # from the moment it is received again
    sent: int  # setpoints and orders since the takeover
    hold_while_lost: RefusedCall
    reason: str
    control_taken: CommandRecord
    after_take_control: list[Phase]


async def silent_while_a_pilot_has_it(show: VirtualShow, action: ShowAction | None) -> SilentPilot:
    """A person takes d2, it falls silent, is lost, and is received again in HOLD, where its pilot left it."""
    show.pilot("d2", PilotMode.HOLD)
    await show.phase("d2", Phase.PILOT)
    taken_s = show.now_s
    show.ports.silence("d2")
    await show.phase("d2", Phase.LOST)
    if action is not None:
        show.service.commands.command_show(action)
    hold = await refused(show, lambda: show.service.commands.command_vehicle("d2", VehicleAction.HOLD))
    await show.wait(2.0)
    back_s = show.now_s
    show.ports.restore("d2")
    await show.phase("d2", Phase.PILOT, 5.0)
    reason = show.vehicle("d2").reason
    if action in {ShowAction.STOP, ShowAction.ABORT}:
        await show.until(lambda: {show.vehicle(name).phase for name in ("d1", "d3")} == {Phase.STANDBY})
    await show.wait(6.0)
    track = show.track.between(back_s)
    sent = sum(setpoint.time_s > taken_s for setpoint in show.ports.sent["d2"])
    sent += sum(command.time_s > taken_s for command in show.ports.commands["d2"])
    given_s = show.now_s
    control_taken = await show.command("d2", VehicleAction.TAKE_CONTROL)
    await show.wait(4.0)
    return SilentPilot(track, sent, hold, reason, control_taken, show.track.between(given_s).phases("d2"))


@pytest.mark.soak
@pytest.mark.parametrize("action", [None, ShowAction.PAUSE, ShowAction.STOP, ShowAction.ABORT])
def test_piloted_vehicle_received_again_in_hold_stays_piloted(
    action: ShowAction | None,
) -> None:
    config = show_config(3, operation=HOLDS_WHEN_LOST)
    flight = fly(lambda show: silent_while_a_pilot_has_it(show, action), config, after=running)
    assert flight.track.phases("d2") == [Phase.LOST, Phase.PILOT]
    assert flight.sent == 0
    assert "no take-control came since" in flight.reason
    assert flight.hold_while_lost.kind is RefusedError
    assert "taken over before its telemetry stopped" in flight.hold_while_lost.text
    assert flight.control_taken.outcome is Outcome.DONE
    assert flight.after_take_control == [Phase.PILOT, Phase.HOLD], "it waits for commands"


async def received_again_in_hold(show: VirtualShow) -> tuple[list[Phase], list[Verb]]:
    """Its own failsafe would have it sink; it is found in HOLD: a person's doing."""
    show.ports.silence("d2")
    await show.phase("d2", Phase.LOST)
    show.pilot("d2", PilotMode.HOLD)
    back_s = show.now_s
    show.ports.restore("d2")
    await show.wait(6.0)
    verbs = [command.verb for command in show.ports.commands["d2"] if command.time_s > back_s]
    return show.track.between(back_s).phases("d2"), verbs


@pytest.mark.soak
def test_hold_after_silence_is_piloted_with_another_failsafe() -> None:
    phases, verbs = fly(received_again_in_hold, show_config(2), after=running)
    assert (phases, verbs) == ([Phase.LOST, Phase.PILOT], [])
