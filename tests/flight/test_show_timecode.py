"""A show that follows a timecode: it begins with it, keeps up with it, freezes, goes on, never jumps."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from gcs.flight.features.timecode import Timecode
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import ShowPhase
from gcs.model.state import Array
from gcs.service import SelectedShow, ShowAction
from gcs.service.alarms import AlarmCause, AlarmSeverity
from gcs.service.features import TimecodeView
from gcs.shows.timecode import Rate
from gcs.shows.timecode.midi import MidiTimecode
from gcs.shows.timecode.smpte import Label, label_at
from gcs.testing.virtual_show import JUMP_M_S, VirtualShow, refused
from tests.support.timecode import late, running
from tests.support.written_show import config, fly, select

START: Final = Label(1, 0, 0, 0)
TIMECODE: Final = {
    "timecode": {"source": "udp-midi://127.0.0.1:5006", "starts_at": "01:00:00:00", "freewheel_s": 1.0}
}
ALLOWED_S: Final = 0.020


def selected(show: VirtualShow) -> SelectedShow:
    found = show.view.selected
    assert found is not None
    return found


def timecode(show: VirtualShow) -> TimecodeView:
    found = show.view.features.timecode
    assert found is not None
    return found


@dataclass
class Source:
    """Sends timecode to the service, in virtual time, until it is stopped."""

    show: VirtualShow
    rate: Rate = Rate.FPS_25
    speed: float = 1.0
    delay_s: Callable[[], float] = field(default_factory=lambda: late(0.003, 5))
    drops: Callable[[float], bool] = lambda _: False  # whether the message at this time of the run is lost
    zero_s: float = np.nan  # the loop's time at which the timecode was START, or would have been

    @asynccontextmanager
    async def runs(self, from_s: float = 0.0) -> AsyncIterator["Source"]:
        """Run it from so long after START on, until the block ends."""
        task = asyncio.create_task(self._run(from_s))
        try:
            yield self
        finally:
            task.cancel()

    async def _run(self, from_s: float) -> None:
        clock = self.show.service.flight.outside_clock
        assert isinstance(clock, Timecode)
        loop, midi = asyncio.get_running_loop(), MidiTimecode()
        begin_s = loop.time()
        self.zero_s = begin_s - from_s / self.speed
        start = label_at(START.time_s(self.rate) + from_s + 0.5 / self.rate.per_s, self.rate)
        for sent in running(start, self.rate, self.speed):
            arrives_s = begin_s + sent.at_s + self.delay_s()
            await asyncio.sleep(arrives_s - loop.time())
            if self.drops(sent.at_s):
                continue
            for reading in midi.take(sent.message):
                clock.take(reading, loop.time())

    def true_s(self, now_s: float) -> float:
        """The show's time that belongs to the timecode."""
        return (now_s - self.zero_s) * self.speed


async def take_off(show: VirtualShow) -> None:
    """Fly to where the show begins, where it waits for the timecode."""
    show_hash = select(show)
    await show.standby()
    show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
    await show.until(lambda: timecode(show).problem != "", 40.0)


async def noted(show: VirtualShow, seconds: float) -> Array:
    """(k, 2) time of each tick, and the show's clock at it."""
    rows: list[tuple[float, float]] = []
    until_s = show.now_s + seconds
    async for view in show.service.view.values():
        if view.selected is not None:
            rows.append((view.time_s, view.selected.clock_s))
        if show.now_s >= until_s:
            return np.array(rows)
    return np.array(rows)


def settings(tmp_path: Path, **more: Any) -> Any:
    return config(tmp_path, timecode={**TIMECODE["timecode"], **more})


def alarms(show: VirtualShow) -> list[str]:
    return [one.text for one in show.view.alarms if one.cause is AlarmCause.TIMECODE and one.lasts]


@pytest.mark.soak
@pytest.mark.parametrize(("rate", "speed"), [(Rate.FPS_25, 1.001), (Rate.FPS_29_97_DROP, 0.999)])
def test_a_flying_show_is_within_20_ms_of_its_timecode(tmp_path: Path, rate: Rate, speed: float) -> None:
    """Delays of 3 ms with a long tail, drop-outs of 0.3 s, 0.1 % of drift; its beginning is in time too."""

    async def story(show: VirtualShow) -> tuple[Array, float, list[str]]:
        await take_off(show)
        source = Source(show, rate, speed, drops=lambda at_s: at_s % 8.0 > 7.7)
        async with source.runs(from_s=-2.0):
            await show.reach(ShowPhase.RUNNING, 10.0)
            began_s = source.true_s(show.view.time_s) - selected(show).clock_s
            rows = await noted(show, 30.0)
            assert timecode(show).label.startswith("01:00:")
            return np.array([[source.true_s(at_s), clock_s] for at_s, clock_s in rows]), began_s, alarms(show)

    rows, began_s, reported = fly(story, settings(tmp_path))
    assert abs(began_s) <= ALLOWED_S
    off_s = np.abs(rows[:, 0] - rows[:, 1])
    assert np.percentile(off_s, 99) <= ALLOWED_S
    assert (np.diff(rows[:, 1]) > 0.0).all()
    assert not reported


@pytest.mark.soak
def test_a_show_freezes_with_its_timecode_and_goes_on(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await take_off(show)
        source = Source(show)
        async with source.runs(from_s=-2.0):
            await show.until(lambda: selected(show).clock_s > 10.0, 20.0)  # the target walks
        stopped_s = show.now_s
        await show.until(lambda: timecode(show).tempo == 0.0, 5.0)
        assert timecode(show).state == "lost"
        frozen_since_s = timecode(show).frozen_since_unix_time_s
        assert frozen_since_s is not None
        after_s = frozen_since_s - (show.unix() - show.now_s) - stopped_s
        assert 0.9 <= after_s <= 1.2  # once it could be no drop-out any more
        frozen_s = selected(show).clock_s
        await show.wait(5.0)
        before_m = show.true_m
        await show.wait(5.0)
        assert selected(show).clock_s == pytest.approx(frozen_s, abs=1e-6)
        assert np.abs(show.true_m - before_m).max() < 0.5
        assert show.view.show is ShowPhase.RUNNING
        (alarm,) = [one for one in show.view.alarms if one.cause is AlarmCause.TIMECODE and one.lasts]
        assert alarm.severity is AlarmSeverity.WARNING
        assert "no timecode arrives any more" in alarm.text
        assert "The show stands still" in alarm.text
        async with source.runs(from_s=10.0):
            await show.wait(12.0)
            assert selected(show).clock_s == pytest.approx(source.true_s(show.view.time_s), abs=ALLOWED_S)
            assert not alarms(show)
            assert timecode(show).frozen_since_unix_time_s is None
        assert show.track.between(stopped_s).hardest_change_m_s() <= JUMP_M_S
        assert show.floor_violations() == 0

    fly(story, settings(tmp_path), ideal=True)  # errors of estimates move vehicles that stand still


@pytest.mark.soak
def test_a_large_jump_is_refused_told_and_taken_back(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await take_off(show)
        source = Source(show)
        async with source.runs(from_s=-2.0):
            await show.until(lambda: selected(show).clock_s > 6.0, 20.0)
        async with source.runs(from_s=600.0):
            await show.wait(6.0)
            assert timecode(show).state == "refused"
            assert timecode(show).tempo == 0.0
            (text,) = alarms(show)
            assert "jumped by" in text
            assert selected(show).clock_s < 9.5
        async with source.runs(from_s=6.0):
            await show.wait(12.0)
            assert selected(show).clock_s == pytest.approx(source.true_s(show.view.time_s), abs=ALLOWED_S)
        assert show.track.hardest_change_m_s() <= JUMP_M_S

    fly(story, settings(tmp_path))


@pytest.mark.soak
def test_a_show_waits_for_its_timecode_and_is_let_go_by_hand(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await take_off(show)
        assert timecode(show).problem == "no timecode has arrived"
        async with Source(show).runs(from_s=300.0):
            await show.wait(3.0)
            assert show.view.show is ShowPhase.ASSEMBLING
            assert "past the show's beginning" in timecode(show).problem
        refusal = await refused(show, lambda: show.service.player.begin_at(show.unix() + 5.0))
        assert (refusal.kind, "follow the timecode" in refusal.text) == (RefusedError, True)
        show.service.player.follow_external_clock(False)
        await show.reach(ShowPhase.RUNNING, 1.0)
        await show.wait(3.0)
        assert selected(show).clock_s == pytest.approx(3.0, abs=0.11)
        assert not timecode(show).followed
        assert not alarms(show)

    fly(story, settings(tmp_path))


@pytest.mark.soak
def test_a_show_frozen_without_timecode_goes_on_by_the_clock(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await take_off(show)
        async with Source(show).runs(from_s=-2.0):
            await show.until(lambda: selected(show).clock_s > 3.0, 20.0)
        await show.until(lambda: timecode(show).tempo == 0.0, 5.0)
        show.service.player.follow_external_clock(False)
        await show.wait(3.0)
        clock_s = selected(show).clock_s
        await show.wait(5.0)
        assert selected(show).clock_s - clock_s == pytest.approx(5.0, abs=0.01)

    fly(story, settings(tmp_path))


@pytest.mark.soak
def test_a_paused_show_goes_on_once_the_timecode_is_there(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await take_off(show)
        source = Source(show)
        async with source.runs(from_s=-2.0):
            await show.until(lambda: selected(show).clock_s > 3.0, 20.0)
            show.service.commands.command_show(ShowAction.PAUSE)
            await show.wait(2.0)
        await show.wait(2.0)
        paused_s = selected(show).clock_s
        show.service.commands.command_show(ShowAction.RESUME)
        await show.wait(15.0)
        assert show.view.show is ShowPhase.ASSEMBLING
        assert selected(show).clock_s == pytest.approx(paused_s, abs=0.05)
        async with source.runs(from_s=paused_s - 2.0):
            await show.reach(ShowPhase.RUNNING, 4.0)
            await show.wait(10.0)
            assert selected(show).clock_s == pytest.approx(source.true_s(show.view.time_s), abs=ALLOWED_S)
        assert show.track.hardest_change_m_s() <= JUMP_M_S

    fly(story, settings(tmp_path))
