"""Shows of a site that follow timecode: the lead follows its own, the others get the lead's clock."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.flight.features.timecode import Timecode
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import ShowPhase
from gcs.service import ShowAction
from gcs.service.alarms import AlarmCause
from gcs.service.features import TimecodeView
from gcs.shows.timecode import Rate
from gcs.shows.timecode.midi import MidiTimecode
from gcs.shows.timecode.smpte import Label, label_at
from gcs.testing.virtual_site import SiteShow, fly_site
from tests.flight.test_site_begin import choose, written_config
from tests.flight.test_site_drawn import ready, selected
from tests.support.timecode import late, running

BUS: Final = {"delay_s": 0.005}
START: Final = Label(1, 0, 0, 0)
ALLOWED_S: Final = 0.020


def config(folder: Path) -> Config:
    """Two stations, each with timecode at a port of its own."""
    raw = written_config(folder, 2).model_dump()
    for at, station in enumerate(raw["stations"]):
        station["timecode"] = {"source": f"udp-midi://127.0.0.1:{5006 + 2 * at}", "starts_at": str(START)}
    return Config.model_validate(raw)


def timecode(show: SiteShow, station: str) -> TimecodeView:
    found = show[station].view.features.timecode
    assert found is not None
    return found


class Source:
    """Timecode that arrives at one station."""

    def __init__(self, show: SiteShow, station: str) -> None:
        self.show, self.station = show, station
        self.zero_s = np.nan  # the loop's time at which it was START

    @asynccontextmanager
    async def runs(self, from_s: float) -> AsyncIterator["Source"]:
        """Run it from so long after START on, until the block ends."""
        task = asyncio.create_task(self._run(from_s))
        try:
            yield self
        finally:
            task.cancel()

    async def _run(self, from_s: float) -> None:
        clock = self.show[self.station].service.local.flight.outside_clock
        assert isinstance(clock, Timecode)
        loop, midi, delay_s = asyncio.get_running_loop(), MidiTimecode(), late(0.003, 5)
        begin_s, rate = loop.time(), Rate.FPS_25
        self.zero_s = begin_s - from_s
        start = label_at(START.time_s(rate) + from_s + 0.5 / rate.per_s, rate)
        for sent in running(start, rate):
            await asyncio.sleep(begin_s + sent.at_s + delay_s() - loop.time())
            for reading in midi.take(sent.message):
                clock.take(reading, loop.time())


async def take_off(show: SiteShow) -> None:
    """Fly to where the show begins, where it waits for the timecode."""
    await ready(show)
    show_hash = choose(show, "south")
    await show.wait(4.0)
    show["south"].service.commands.command_show(ShowAction.START, show_hash=show_hash)
    await show.until(lambda: timecode(show, "north").problem == "no timecode has arrived", 60.0)
    await show.wait(10.0)


def alarms(show: SiteShow, station: str) -> list[str]:
    listed = show[station].view.alarms
    return [one.text for one in listed if one.cause is AlarmCause.TIMECODE and one.lasts]


@pytest.mark.soak
def test_all_stations_follow_the_timecode_of_the_lead(tmp_path: Path) -> None:
    async def story(show: SiteShow) -> None:
        await take_off(show)
        assert timecode(show, "south").problem == "not followed: station north leads"
        source = Source(show, "north")
        async with source.runs(-2.0):
            await show.reach(ShowPhase.RUNNING, limit_s=10.0)
            off_s: list[float] = []
            for _ in range(60):
                await show.wait(0.2)
                clocks_s = [show[name].view.time_s - selected(show, name).clock_s for name in show.stations]
                off_s += [clock_s - source.zero_s for clock_s in clocks_s]
            assert np.percentile(np.abs(off_s), 99) <= ALLOWED_S
            assert not alarms(show, "south")
        await show.wait(6.0)
        stopped_s = [selected(show, name).clock_s for name in show.stations]
        await show.wait(5.0)
        assert [selected(show, name).clock_s for name in show.stations] == pytest.approx(stopped_s, abs=1e-3)
        assert np.ptp(stopped_s) < ALLOWED_S
        show["south"].service.player.follow_external_clock(False)
        await show.wait(10.0)
        later_s = np.subtract([selected(show, name).clock_s for name in show.stations], stopped_s)
        assert later_s == pytest.approx([9.0, 9.0], abs=1.0)
        assert show.violations == 0

    fly_site(story, config(tmp_path), **BUS)


@pytest.mark.soak
def test_timecode_at_a_follower_alone_is_an_alarm(tmp_path: Path) -> None:
    async def story(show: SiteShow) -> None:
        await take_off(show)
        async with Source(show, "south").runs(-8.0) as source:
            await show.wait(4.0)
            (text,) = alarms(show, "south")
            assert "not followed: station north leads, and no timecode arrives there" in text
            stations = show["south"].service.stations
            assert stations is not None
            stations.take_lead()
            await show.reach(ShowPhase.RUNNING, limit_s=8.0)
            await show.wait(5.0)
            for name in show.stations:
                true_s = show[name].view.time_s - source.zero_s
                assert selected(show, name).clock_s == pytest.approx(true_s, abs=ALLOWED_S)
            assert not alarms(show, "south")

    fly_site(story, config(tmp_path), **BUS)


@pytest.mark.soak
def test_no_timecode_is_followed_where_the_lead_has_none(tmp_path: Path) -> None:
    async def story(show: SiteShow) -> None:
        await ready(show)
        choose(show, "north")
        await show.wait(2.0)
        with pytest.raises(RefusedError, match="no timecode is configured at station north, which leads"):
            show["south"].service.player.follow_external_clock(True)

    fly_site(story, written_config(tmp_path, 2), **BUS)
