"""The station stalls in every phase of a show: what it shows is true, one command brings all home."""

import random
from collections.abc import Awaitable, Callable

import numpy as np
import pytest
from stalls import floor_violations, stall
from virtual_show import HOLDS_WHEN_LOST, Show, fly, show_config

from gcs.alarms import AlarmCause
from gcs.counts import Counts
from gcs.lifecycle import FLOWN, ShowPhase
from gcs.service import Outcome, ShowAction
from gcs.sim.modes import Mode as PilotMode

COUNT = 5
TRUE_WITHIN_S = 1.0
FLIES_M, STANDS_M = 0.6, 0.005
"""Heights above which a vehicle truly flies, and below which it truly stands."""

DOWN = frozenset({ShowPhase.IDLE, ShowPhase.COUNTDOWN, ShowPhase.PREFLIGHT, ShowPhase.LANDED})


async def on_the_ground(show: Show) -> None:
    await show.standby()


async def counting_down(show: Show) -> None:
    await show.standby()
    show.service.command_show(ShowAction.START, at_unix_time_s=show.unix() + 30.0)


async def arming(show: Show) -> None:
    await show.standby()
    show.service.command_show(ShowAction.START)


async def assembling(show: Show) -> None:
    await arming(show)
    await show.reach(ShowPhase.ASSEMBLING)


async def running(show: Show) -> None:
    await show.start()


async def paused(show: Show) -> None:
    await running(show)
    show.service.command_show(ShowAction.PAUSE)


async def returning(show: Show) -> None:
    await running(show)
    show.service.command_show(ShowAction.STOP)


async def aborting(show: Show) -> None:
    await running(show)
    show.service.command_show(ShowAction.ABORT)


async def uncontrolled(show: Show) -> None:
    await running(show)
    await show.wait(1.0)
    stall(show, 3.0)


PHASES: tuple[Callable[[Show], Awaitable[None]], ...] = (
    running,
    assembling,
    returning,
    arming,
    aborting,
    paused,
    uncontrolled,
    counting_down,
    on_the_ground,
    returning,
)
STALLS_S = (4.0, 1.0, 10.0, 2.0)
CASES = [(turn, PHASES[turn % len(PHASES)], STALLS_S[turn % len(STALLS_S)]) for turn in range(20)]


def assert_true(show: Show) -> None:
    """The phase and the counts are what the simulated vehicles really do."""
    view, counts = show.view, show.view.counts
    heights_m = -show.true_m[:, 2]
    assert np.sum(heights_m > FLIES_M) <= counts.airborne <= np.sum(heights_m > STANDS_M)
    assert counts.unknown == 0
    if counts.airborne:
        assert view.show not in DOWN
    for seen, pilot in zip(view.vehicles, show.fleet.autopilots, strict=True):
        if seen.phase in FLOWN and seen.setpoint_m_s is not None:
            assert pilot.commander.mode is PilotMode.OFFBOARD, f"{seen.id} is believed to be flown"
    if counts.airborne and not counts.controlled:
        assert view.show is ShowPhase.UNCONTROLLED
        assert f"{counts.airborne} vehicle" in view.reason


@pytest.mark.parametrize(("turn", "into", "stalled_s"), CASES)
def test_within_a_second_of_a_stall_all_that_is_shown_is_true_and_one_command_brings_all_home(
    turn: int, into: Callable[[Show], Awaitable[None]], stalled_s: float
) -> None:
    chance = random.Random(turn)

    async def story(show: Show) -> None:
        await show.standby()
        pads_m = show.true_m.copy()
        await into(show)
        await show.wait(chance.uniform(0.2, 6.0))
        meanwhile_m = stall(show, stalled_s, kept_share=chance.choice([1.0, 0.5]))
        await show.wait(TRUE_WITHIN_S)
        assert_true(show)
        if show.view.counts.airborne:
            record = show.service.command_show(ShowAction.STOP)
            assert Outcome.NOT_INCLUDED not in {part.outcome for part in record.outcomes.values()}
            await show.settled(record, 150.0)
            assert show.service.order(record.id).outcome is Outcome.DONE
        elif show.view.show is ShowPhase.COUNTDOWN:
            show.service.command_show(ShowAction.STOP)
        await show.until(lambda: show.view.show in {ShowPhase.LANDED, ShowPhase.IDLE})
        await show.wait(0.2)
        assert show.view.counts == Counts(0, 0, 0, on_ground=COUNT, offline=0)
        if into is not aborting:
            assert np.linalg.norm((show.true_m - pads_m)[:, :2], axis=1).max() < 1.5
        assert show.floor_violations() == 0
        assert floor_violations(show, meanwhile_m) == 0

    fly(story, show_config(COUNT, operation=HOLDS_WHEN_LOST))


def test_the_alarm_of_a_stall_says_which_commands_lead_back() -> None:
    async def story(show: Show) -> None:
        await running(show)
        stall(show, 4.0)
        await show.wait(TRUE_WITHIN_S)
        alarms = [each for each in show.view.alarms if each.cause is AlarmCause.OWN_FAILSAFE]
        assert [len(each.vehicles) for each in alarms] == [COUNT]
        assert "take-over or bring-home" in alarms[0].advice

    fly(story, show_config(COUNT, operation=HOLDS_WHEN_LOST))
