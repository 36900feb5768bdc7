"""A vehicle whose motors are stopped on order, while the others fly on."""

from typing import NamedTuple

import numpy as np
import pytest

from gcs.model.errors import RefusedError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import CommandRecord, Outcome, ShowAction, VehicleAction
from gcs.service.alarms import AlarmCause
from gcs.testing.virtual_show import (
    HOLDS_WHEN_LOST,
    FlownTrack,
    RefusedCall,
    VirtualShow,
    fly,
    refused,
    show_config,
)
from tests.support.show_phases import running


class Killed(NamedTuple):
    track: FlownTrack
    kill_s: float
    off_s: float
    outcome: CommandRecord
    again: CommandRecord
    sent: int
    start: RefusedCall
    confirmed: CommandRecord


async def killed(show: VirtualShow) -> Killed:
    await show.wait(3.0)
    kill_s = show.now_s
    record = show.service.commands.kill(["d2"])
    await show.until(lambda: not show.autopilot("d2").commander.armed)
    off_s = show.now_s
    outcome = await show.settled(record)
    again = await show.settled(show.service.commands.kill(["d2", "d2"]))
    await show.wait(5.0)
    sent = sum(setpoint.time_s > kill_s + 0.06 for setpoint in show.ports.sent["d2"])
    await show.show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED)
    await show.wait(1.0)
    assert show.view.alarms[0].cause is AlarmCause.KILLED
    assert show.view.alarms[0].lasts
    start = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
    confirmed = await show.command("d2", VehicleAction.CONFIRM_DOWN)
    await show.wait(1.0)
    return Killed(show.track, kill_s, off_s, outcome, again, sent, start, confirmed)


@pytest.fixture(scope="module")
def kill() -> Killed:
    return fly(killed, show_config(4, operation=HOLDS_WHEN_LOST), after=running)


def test_kill_stops_the_motors_at_once(kill: Killed) -> None:
    assert kill.off_s - kill.kill_s < 0.15
    assert kill.outcome.outcomes["d2"].outcome is Outcome.DONE


def test_killed_vehicle_is_sent_nothing_until_confirmed_down(kill: Killed) -> None:
    assert kill.sent == 0
    assert kill.track.between(kill.kill_s + 0.06).phases("d2") == [Phase.KILLED, Phase.STANDBY]
    assert kill.start.kind is RefusedError
    assert "d2: killed: motors stopped on command" in kill.start.text
    assert kill.confirmed.outcome is Outcome.DONE


def test_a_kill_may_be_repeated(kill: Killed) -> None:
    assert kill.again.outcome is Outcome.DONE


def test_the_others_fly_on_after_a_kill_and_come_home(kill: Killed) -> None:
    last = kill.track.samples[-1]
    off_m = np.hypot(*(last.true_m - kill.track.samples[0].true_m)[:, :2].T)
    assert off_m[[0, 2, 3]].max() < 1.5
    assert last.armed == (False,) * 4
