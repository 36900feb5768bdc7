"""The station stalls in every phase of a show: what it shows is true, one command brings all home."""

import random
from collections.abc import Awaitable, Callable
from typing import NamedTuple

import numpy as np
import pytest

from gcs.model.interrupted_flight import Offer
from gcs.model.lifecycle import FLOWN, Phase, ShowPhase
from gcs.model.state import Array, Counts, Mode
from gcs.service import Outcome, ShowAction
from gcs.service.alarms import AlarmCause
from gcs.sim.vehicle.px4 import Mode as PilotMode
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import (
    HOLDS_WHEN_LOST,
    SLOWLY_DISARMED,
    TAKEOFF_HEIGHT_M,
    VirtualShow,
    fly,
    show_config,
)
from tests.support.show_phases import aborting, arming, assembling, on_the_pads, paused, returning, running
from tests.support.stalls import floor_violations, stall

Into = Callable[[VirtualShow], Awaitable[None]]

COUNT = 5
TRUE_WITHIN_S = 1.0
FLIES_M, STANDS_M = 0.6, 0.002
"""Heights above which a vehicle truly flies, and below which it truly stands."""

DOWN = frozenset({ShowPhase.IDLE, ShowPhase.COUNTDOWN, ShowPhase.PREFLIGHT, ShowPhase.LANDED})


async def counting_down(show: VirtualShow) -> None:
    await show.standby()
    show.service.commands.command_show(ShowAction.START, at_unix_time_s=show.unix() + 30.0)


async def uncontrolled(show: VirtualShow) -> None:
    await running(show)
    await show.wait(1.0)
    stall(show, 3.0)


async def climbing(show: VirtualShow) -> None:
    await arming(show)
    await show.until(lambda: 1.0 < -show.true_m[:, 2].min() < TAKEOFF_HEIGHT_M)


async def landing(show: VirtualShow) -> None:
    await returning(show)
    await show.until(lambda: Phase.LANDING in {seen.phase for seen in vehicles_of(show.view)})


PHASES: tuple[Into, ...] = (
    running,
    assembling,
    returning,
    arming,
    aborting,
    paused,
    uncontrolled,
    counting_down,
    on_the_pads,
    climbing,
    landing,
)


def begins(into: Into) -> Into:
    """What phases have in common, which is flown once for all of them."""
    return on_the_pads if into in {arming, assembling, climbing, counting_down, on_the_pads} else running


STALLS_S = (4.0, 1.0, 10.0, 2.0)
KEPT = (0, 1, 11)
"""In formation, while assembling, and in formation with a STOP before a heartbeat came after the stall."""

CASES = [
    pytest.param(
        turn,
        PHASES[turn % len(PHASES)],
        STALLS_S[turn] if turn < 2 else round(random.Random(turn).uniform(0.3, 10.0), 1),
        marks=() if turn in KEPT else pytest.mark.soak,
    )
    for turn in range(33)
]
"""`make soak` flies each phase with three moments and lengths; after the shortest vehicles are flown on."""


def assert_true(show: VirtualShow) -> None:
    """The phase and the counts are what the simulated vehicles really do."""
    view, counts = show.view, show.view.counts
    heights_m = -show.true_m[:, 2]
    assert np.sum(heights_m > FLIES_M) <= counts.airborne <= np.sum(heights_m > STANDS_M)
    assert counts.unknown == 0
    if counts.airborne:
        assert view.show not in DOWN
    for seen, pilot in zip(vehicles_of(view), show.fleet.autopilots, strict=True):
        if seen.phase in FLOWN and seen.setpoint_m_s is not None:
            assert pilot.commander.mode is PilotMode.OFFBOARD, f"{seen.id} is believed to be flown"
    if counts.airborne and not counts.controlled:
        assert view.show is ShowPhase.UNCONTROLLED
        assert f"{counts.airborne} vehicle" in view.reason


async def stalls_once(show: VirtualShow, turn: int, into: Into, stalled_s: float) -> Array:
    """Lead the show into a phase, and stall at a random moment. Returns: (n, 3) the pads, show frame."""
    chance = random.Random(turn)
    await into(show)
    await show.wait(chance.uniform(0.2, 6.0))
    meanwhile_m = stall(show, stalled_s, kept_share=chance.choice([1.0, 0.5]))
    assert floor_violations(show, meanwhile_m) == 0
    return show.track.samples[0].true_m


class Landed(NamedTuple):
    """What one STOP led to, once the show has landed."""

    outcome: Outcome
    reasons: dict[str, str]  # of each vehicle's part of the command
    counts: Counts
    off_pads_m: float  # of the vehicle that is farthest from its pad
    floor_violations: int


ALL_DOWN = Counts(0, 0, 0, on_ground=COUNT, offline=0)
NEAR_PADS_M = 1.5


async def landed_by_one_stop(show: VirtualShow, pads_m: Array) -> Landed:
    record = await show.settled(show.service.commands.command_show(ShowAction.STOP), 150.0)
    await show.until(lambda: show.view.show in {ShowPhase.LANDED, ShowPhase.IDLE})
    await show.wait(0.2)
    off_pads_m = np.linalg.norm((show.true_m - pads_m)[:, :2], axis=1).max()
    reasons = {name: part.reason for name, part in record.outcomes.items()}
    return Landed(record.outcome, reasons, show.view.counts, float(off_pads_m), show.floor_violations())


@pytest.mark.keeps("0-running-4.0")
@pytest.mark.parametrize(("turn", "into", "stalled_s"), CASES)
def test_stall_state_is_true_and_one_command_returns_all(turn: int, into: Into, stalled_s: float) -> None:
    """Within a second of a stall the shown state is true; one command brings all home."""

    async def story(show: VirtualShow) -> None:
        pads_m = await stalls_once(show, turn, into, stalled_s)
        await show.wait(TRUE_WITHIN_S)
        assert_true(show)
        if show.view.counts.airborne:
            found = await landed_by_one_stop(show, pads_m)
            assert found.outcome is Outcome.DONE, found.reasons
            assert found.counts == ALL_DOWN
            assert found.off_pads_m < NEAR_PADS_M or into is aborting
            assert found.floor_violations == 0
        elif show.view.show in {ShowPhase.COUNTDOWN, ShowPhase.ARMING}:
            show.service.commands.command_show(ShowAction.STOP)
        await show.until(lambda: show.view.show in {ShowPhase.LANDED, ShowPhase.IDLE})

    fly(story, show_config(COUNT, operation=HOLDS_WHEN_LOST), after=begins(into))


EARLY: tuple[Into, ...] = (running, assembling, returning, aborting, paused)
STOPS_AFTER_S = (0.0, 0.3, 0.05, 0.6, 0.9)
EARLY_CASES = [
    pytest.param(
        turn,
        EARLY[turn % len(EARLY)],
        STALLS_S[turn % len(STALLS_S)],
        after_s,
        marks=() if turn < 1 else pytest.mark.soak,
    )
    for turn, after_s in enumerate(STOPS_AFTER_S * 2)
]
"""Before the first tick; `make soak` has the other phases."""


@pytest.mark.soak
@pytest.mark.parametrize(("turn", "into", "stalled_s", "after_s"), EARLY_CASES)
def test_stop_before_modes_are_known_returns_all(
    turn: int, into: Into, stalled_s: float, after_s: float
) -> None:
    async def story(show: VirtualShow) -> None:
        pads_m = await stalls_once(show, turn, into, stalled_s)
        if after_s:  # otherwise before the first tick
            await show.wait(after_s)
        found = await landed_by_one_stop(show, pads_m)
        assert found.outcome is Outcome.DONE, found.reasons
        assert found.counts == ALL_DOWN
        assert found.off_pads_m < NEAR_PADS_M or into is aborting
        assert found.floor_violations == 0

    fly(story, show_config(COUNT, operation=HOLDS_WHEN_LOST), after=begins(into))


@pytest.mark.soak
@pytest.mark.parametrize("action", ["descend", "land", "return"])
def test_stall_explains_the_mode_of_the_configured_failsafe(action: str) -> None:
    async def story(show: VirtualShow) -> None:
        await running(show)
        show.befall("d1", "pilot")
        stall(show, 2.5)
        await show.wait(TRUE_WITHIN_S)
        view = show.view
        assert view.interrupted is not None
        assert {name for name, one in view.interrupted.vehicles.items() if one.waits} == {
            "d2",
            "d3",
            "d4",
            "d5",
        }
        assert "by the setpoint-loss failsafe" in show.vehicle("d2").reason
        assert view.interrupted.offers == (Offer.TAKE_OVER, Offer.BRING_HOME)
        record = show.service.commands.command_show(ShowAction.STOP)
        assert record.outcomes["d1"].outcome is Outcome.NOT_INCLUDED, "it is a pilot's"
        others = ("d2", "d3", "d4", "d5")
        await show.until(lambda: {show.vehicle(name).reason for name in others} == {"on its way home"})
        assert {show.vehicle(name).mode for name in others} == {Mode.OFFBOARD}, "no failsafe flies it"

    operation = {"setpoint_loss_action": action, "require_safe_setpoint_loss": False}
    fly(story, show_config(COUNT, operation=operation))


@pytest.mark.soak
def test_vehicle_nearly_landed_by_its_failsafe_may_touch_down() -> None:
    async def story(show: VirtualShow) -> None:
        await show.wait(1.0)
        stall(show, 2.5)
        await show.until(lambda: 0.3 < -show.true_m[:, 2].min() < 1.0)
        low = show.config.ids[int(np.argmax(show.true_m[:, 2]))]
        record = show.service.commands.command_show(ShowAction.STOP)
        assert record.outcomes[low].outcome is Outcome.NOT_INCLUDED
        assert "it is left to touch down" in record.outcomes[low].reason
        await show.reach(ShowPhase.LANDED, 150.0)
        assert show.view.counts == Counts(0, 0, 0, on_ground=COUNT, offline=0)

    fly(story, show_config(COUNT), after=running, parameters=SLOWLY_DISARMED)


@pytest.mark.soak
def test_stall_alarm_names_the_commands_for_recovery() -> None:
    async def story(show: VirtualShow) -> None:
        stall(show, 4.0)
        await show.wait(TRUE_WITHIN_S)
        alarms = [each for each in show.view.alarms if each.cause is AlarmCause.OWN_FAILSAFE]
        assert [len(each.vehicles) for each in alarms] == [COUNT]
        assert "take-over or bring-home" in alarms[0].advice

    fly(story, show_config(COUNT, operation=HOLDS_WHEN_LOST), after=running)
