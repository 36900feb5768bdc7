"""Shows of a site that begin at a clock time: together, held at the lead, asked for at any station."""

from pathlib import Path
from typing import Final

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.model.errors import InvalidError, RefusedError
from gcs.model.lifecycle import ShowPhase
from gcs.service import BeginState, BeginView, ShowAction
from gcs.testing.virtual_site import SiteShow, fly_on_pads, fly_site, site_config
from tests.flight.test_site_api import call
from tests.flight.test_site_drawn import config as drawn_config
from tests.flight.test_site_drawn import ready, select, selected
from tests.support.drawn_flight import on_pads, write_show
from tests.support.written_show import NAME, answer
from tests.support.written_show import TEXT as AT_30_DEG

BUS: Final = {"delay_s": 0.005}
ALLOWED_S: Final = 0.020
MOVES_M_S: Final = 0.3
"""A setpoint that differs from the one before the beginning by so much is motion."""

MOVING: Final = (
    AT_30_DEG.replace("heading_deg: 30.0", "heading_deg: 0.0")
    .replace("  endurance_s", "  takeoff_height_m: 5.0\n  takeoff_stagger_s: 0.2\n  endurance_s")
    .replace('lights: ["#ff0000", "#0000ff"]}', "orbit: {radius_m: 4, speed_m_s: 1}}")
)
"""From its first moment on the formation circles."""


def written_config(folder: Path, stations: int) -> Config:
    return site_config(stations, 4 // stations, shows={"folder": folder}, preflight={"shift_max_m": 4.0})


def choose(show: SiteShow, at: str) -> str:
    """Check and select the show at one station. Returns: its hash."""
    shows = show.config.shows
    assert shows is not None
    (shows.folder / f"{NAME}.yaml").write_text(MOVING)
    found = show[at].service.shows.found(NAME, MOVING.encode(), dict(answer(MOVING)))
    return show[at].service.player.select(NAME, found.hash or "").hash


def begin(show: SiteShow, station: str) -> BeginView:
    found = selected(show, station).begin
    assert found is not None
    return found


def waits(show: SiteShow) -> bool:
    """Whether all stations say that the fleet is where the show begins, and waits for its time."""
    found = [selected(show, name).begin for name in show.stations]
    return all(one is not None and one.state is BeginState.WAITING for one in found)


def first_motion_s(show: SiteShow, begins_s: float) -> list[float]:
    """When each vehicle's setpoints first differ from those before `begins_s`, after it."""
    found = []
    for station in show.stations.values():
        for _, ports, _ in station.radios:
            for name in ports.ids:
                sent = [one for one in ports.sent[name] if one.time_s > begins_s - 1.0]
                still = [one.velocity_ned_m_s for one in sent if one.time_s < begins_s - ALLOWED_S]
                mean_m_s = np.mean(still, axis=0)
                away_m_s = [np.linalg.norm(np.array(one.velocity_ned_m_s) - mean_m_s) for one in sent]
                moves = [one.time_s for one, away in zip(sent, away_m_s, strict=True) if away > MOVES_M_S]
                found.append(min(moves) - begins_s)
    return found


@pytest.mark.soak
@pytest.mark.parametrize("off_s", [0.0, 30.0])
def test_stations_begin_a_show_of_the_law_together(tmp_path: Path, off_s: float) -> None:
    """Also with a host whose clock is 30 s ahead: then the lead's message says how long it is until then."""

    async def story(show: SiteShow) -> list[float]:
        await ready(show)
        show_hash = choose(show, "south")
        await show.wait(4.0)
        show["south"].service.commands.command_show(ShowAction.START, show_hash=show_hash)
        at_s = round(show["north"].unix()) + 40.0123
        if not off_s:
            asked = {"at_unix_time_s": at_s}
            reported = await call(show, "south", "POST", "/show/begin", json=asked)
            assert reported["begin"]["state"] == "armed"
        else:
            show["north"].service.player.begin_at(at_s)
        await show.until(lambda: waits(show), 45.0)
        show["south"].unix.ahead_s += off_s
        await show.wait(1.0)
        for name in show.stations:
            assert begin(show, name).at_unix_time_s == at_s
            assert begin(show, name).in_s == pytest.approx(at_s - show["north"].unix(), abs=0.11)
        begins_s = at_s - show["north"].unix.ahead_s
        await show.reach(ShowPhase.RUNNING, limit_s=60.0)
        await show.wait(2.0)
        for name in show.stations:
            clock_s = show[name].view.time_s - begins_s
            assert selected(show, name).clock_s == pytest.approx(clock_s, abs=0.002)
            assert selected(show, name).begin is None
        with pytest.raises(RefusedError, match="has begun"):
            show["south"].service.player.begin_at(at_s + 60.0)
        return first_motion_s(show, begins_s)

    after_s = fly_site(story, written_config(tmp_path, 2), **BUS)
    assert all(-0.001 <= one <= ALLOWED_S for one in after_s), after_s


@pytest.mark.soak
def test_stations_begin_a_drawing_together(tmp_path: Path) -> None:
    write_show(tmp_path)

    async def story(show: SiteShow) -> list[float]:
        await ready(show)
        found = select(show, tmp_path, "north")
        await show.wait(4.0)
        show["north"].service.commands.command_show(ShowAction.START, show_hash=found.hash)
        at_s = round(show["north"].unix()) + 60.0123
        show["south"].service.player.begin_at(at_s)
        begins_s = at_s - show["north"].unix.ahead_s
        await show.until(lambda: waits(show), 55.0)
        await show.reach(ShowPhase.RUNNING, limit_s=70.0)
        began_s = [one.view.time_s - selected(show, name).clock_s for name, one in show.stations.items()]
        assert show.violations == 0
        return [one - begins_s for one in began_s]

    began_after_s = fly_on_pads(story, drawn_config(tmp_path, 2), on_pads(tmp_path), **BUS)
    assert began_after_s == pytest.approx([0.0, 0.0], abs=0.002)


@pytest.mark.soak
def test_a_time_is_kept_by_the_next_lead_and_cancelled_anywhere(tmp_path: Path) -> None:
    async def story(show: SiteShow) -> None:
        await ready(show)
        show_hash = choose(show, "north")
        await show.wait(4.0)
        player = show["south"].service.player
        with pytest.raises(RefusedError, match="no time to begin was given"):
            player.cancel_begin()
        with pytest.raises(InvalidError):
            player.begin_at(show["south"].unix() - 1.0)
        player.begin_at(show["south"].unix() + 90.0)
        await show.wait(1.0)
        assert {begin(show, name).state for name in show.stations} == {BeginState.ARMED}
        show["north"].service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.until(lambda: waits(show), 60.0)
        stations = show["south"].service.stations
        assert stations is not None
        stations.take_lead()
        await show.wait(2.0)
        assert waits(show)
        show["north"].service.player.cancel_begin()
        await show.wait(1.0)
        for name in show.stations:
            assert begin(show, name) == BeginView(BeginState.HELD, None, None)
        await show.wait(60.0)
        assert {each.view.show for each in show.stations.values()} == {ShowPhase.ASSEMBLING}
        show["north"].service.player.begin_at(show["north"].unix() + 2.0)
        await show.reach(ShowPhase.RUNNING, limit_s=4.0)

    fly_site(story, written_config(tmp_path, 2), **BUS)
