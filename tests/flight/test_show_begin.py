"""A show that begins to move at a clock time: when, how exactly, how it waits, how it is called off."""

from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pytest

from gcs.flight.state.ticker import ticks
from gcs.model.errors import InvalidError, RefusedError
from gcs.model.lifecycle import ShowPhase
from gcs.service import BeginState, BeginView, SelectedShow, ShowAction
from gcs.service.alarms import AlarmCause
from gcs.testing.virtual_show import FLEET_STEP_S, VirtualShow, refused
from gcs.testing.virtual_time import run_virtual
from tests.support.written_show import TEXT, config, fly, select

MOVING: Final = TEXT.replace('lights: ["#ff0000", "#0000ff"]}', "orbit: {radius_m: 4, speed_m_s: 1}}")
"""From its first moment on the formation circles."""

ALLOWED_S: Final = 0.020
MOVES_M_S: Final = 0.3
"""A setpoint that differs from the one before the beginning by so much is motion."""


class First(NamedTuple):
    """First setpoints of motion, in s after the time that was given."""

    after_s: list[float]  # of each vehicle
    clock_off_s: float  # the show's clock, seconds later


def selected(show: VirtualShow) -> SelectedShow:
    found = show.view.selected
    assert found is not None
    return found


def begin(show: VirtualShow) -> BeginView:
    found = selected(show).begin
    assert found is not None
    return found


def waits(show: VirtualShow) -> bool:
    """Whether the fleet is where the show begins, and waits for its time."""
    found = selected(show).begin
    return found is not None and found.state is BeginState.WAITING


async def take_off(show: VirtualShow, text: str = MOVING) -> None:
    show_hash = select(show, text)
    await show.standby()
    show.service.commands.command_show(ShowAction.START, show_hash=show_hash)


def first_motion_s(show: VirtualShow, begins_s: float) -> list[float]:
    """When each vehicle's setpoints first differ from those before `begins_s`, after it."""
    found = []
    for name in show.config.ids:
        sent = [one for one in show.ports.sent[name] if one.time_s > begins_s - 1.0]
        still = [one.velocity_ned_m_s for one in sent if one.time_s < begins_s - ALLOWED_S]
        mean_m_s = np.mean(still, axis=0)
        moves = (
            one.time_s - begins_s
            for one in sent
            if np.linalg.norm(np.array(one.velocity_ned_m_s) - mean_m_s) > MOVES_M_S
        )
        found.append(next(moves))
    return found


@pytest.mark.soak
@pytest.mark.parametrize("phase_s", [0.0, 0.0123, 0.0249, 0.041])
def test_the_fleet_begins_within_20_ms_of_the_time(tmp_path: Path, phase_s: float) -> None:
    """Ticks are 50 ms apart: their phase is shifted, so that one falls on the time, whatever that is."""

    async def story(show: VirtualShow) -> First:
        await take_off(show)
        at_s = round(show.unix()) + 40.0 + phase_s
        show.service.player.begin_at(at_s)
        begins_s = at_s - show.unix.ahead_s
        await show.reach(ShowPhase.RUNNING, 60.0)
        await show.wait(2.0)
        clock_s = selected(show).clock_s
        return First(first_motion_s(show, begins_s), clock_s - (show.view.time_s - begins_s))

    first = fly(story, config(tmp_path), step_s=FLEET_STEP_S)
    assert all(-0.001 <= one <= ALLOWED_S for one in first.after_s), first
    assert np.ptp(first.after_s) <= ALLOWED_S
    assert abs(first.clock_off_s) < 0.001


@pytest.mark.soak
def test_a_waiting_show_says_so_and_does_not_move(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        show_hash = select(show, MOVING)
        await show.standby()
        show.service.player.begin_at(show.unix() + 60.0)
        await show.wait(0.1)
        assert begin(show).state is BeginState.ARMED
        show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.until(lambda: waits(show), 45.0)
        assert show.view.show is ShowPhase.ASSEMBLING
        await show.wait(10.0)  # the vehicles settle on the sphere
        before_m = show.true_m
        await show.wait(3.0)
        assert np.abs(show.true_m - before_m).max() < 0.5
        assert not selected(show).runs
        waited_s = begin(show).in_s
        assert waited_s is not None
        await show.until(lambda: show.view.show is ShowPhase.RUNNING, waited_s + 0.1)
        await show.wait(0.1)
        assert selected(show).begin is None
        refusal = await refused(show, lambda: show.service.player.begin_at(show.unix() + 10.0))
        assert "has begun" in refusal.text

    fly(story, config(tmp_path))


@pytest.mark.soak
def test_a_time_cancelled_in_the_air_holds_until_the_next(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await take_off(show)
        player = show.service.player
        player.begin_at(show.unix() + 60.0)
        await show.until(lambda: waits(show), 45.0)
        player.cancel_begin()
        await show.wait(40.0)
        assert show.view.show is ShowPhase.ASSEMBLING
        assert begin(show) == BeginView(BeginState.HELD, None, None)
        at_s = show.unix() + 2.0
        player.begin_at(at_s)
        await show.reach(ShowPhase.RUNNING, 3.0)
        await show.wait(1.0)
        assert selected(show).clock_s == pytest.approx(show.view.time_s + show.unix.ahead_s - at_s, abs=0.001)

    fly(story, config(tmp_path))


@pytest.mark.soak
def test_a_time_cancelled_on_the_ground_is_forgotten(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        show_hash = select(show, MOVING)
        player = show.service.player
        refusal = await refused(show, player.cancel_begin)
        assert "no time to begin was given" in refusal.text
        player.begin_at(show.unix() + 600.0)
        player.cancel_begin()
        show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.reach(ShowPhase.RUNNING, 60.0)

    fly(story, config(tmp_path))


@pytest.mark.soak
def test_a_show_that_is_not_ready_begins_late_and_says_so(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await take_off(show)
        show.service.player.begin_at(show.unix() + 3.0)
        await show.wait(4.0)
        assert begin(show).state is BeginState.LATE
        await show.reach(ShowPhase.RUNNING, 60.0)
        await show.wait(1.0)
        assert selected(show).clock_s == pytest.approx(1.0, abs=0.11)

    fly(story, config(tmp_path))


@pytest.mark.soak
def test_the_time_is_forgotten_when_the_fleet_comes_home(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await take_off(show)
        show.service.player.begin_at(show.unix() + 300.0)
        await show.reach(ShowPhase.ASSEMBLING)
        show.service.commands.command_show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED, 120.0)
        await show.wait(0.1)
        assert selected(show).begin is None

    fly(story, config(tmp_path))


@pytest.mark.parametrize("ahead_s", [-1.0, 0.0, 2e5])
def test_a_time_that_is_past_or_far_is_refused(tmp_path: Path, ahead_s: float) -> None:
    async def story(show: VirtualShow) -> None:
        player = show.service.player
        refusal = await refused(show, lambda: player.begin_at(show.unix() + 5.0))
        assert refusal.kind is RefusedError
        assert "no show is selected" in refusal.text
        select(show, MOVING)
        refusal = await refused(show, lambda: player.begin_at(show.unix() + ahead_s))
        assert refusal.kind is InvalidError
        refusal = await refused(show, lambda: player.follow_external_clock(True))
        assert "no timecode is configured" in refusal.text

    fly(story, config(tmp_path))


@pytest.mark.soak
def test_a_clock_that_is_not_synchronised_is_told(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        select(show, MOVING)
        show.service.player.begin.clock_problem = lambda: "it is not synchronised"
        await show.wait(3.0)
        assert not [one for one in show.view.alarms if one.cause is AlarmCause.CLOCK_DOUBTFUL]
        show.service.player.begin_at(show.unix() + 60.0)
        await show.wait(3.0)
        (alarm,) = [one for one in show.view.alarms if one.cause is AlarmCause.CLOCK_DOUBTFUL]
        assert "not synchronised" in alarm.text

    fly(story, config(tmp_path))


async def shifted(desired_s: float) -> list[float]:
    seen: list[float] = []
    async for now_s, _, _ in ticks(0.05, lambda: desired_s):
        seen.append(now_s)
        if len(seen) > 40:
            break
    return seen


@pytest.mark.parametrize("desired_s", [1.5, 1.512, 1.5249, 1.5251, 1.541])
def test_a_tick_falls_on_the_desired_time_by_small_steps(desired_s: float) -> None:
    times_s = np.array(run_virtual(lambda: shifted(desired_s)))
    assert np.abs(times_s - desired_s).min() < 1e-6
    assert np.abs(np.diff(times_s) - 0.05).max() <= 0.0025 + 1e-9
