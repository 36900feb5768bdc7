"""Written shows of a site: selected at any station, played by the lead, gone on with by the next lead."""

from pathlib import Path

import pytest

from gcs.config.schema import Config
from gcs.model.errors import RefusedError, UnknownError
from gcs.model.lifecycle import ShowPhase
from gcs.service import Outcome, SelectedShow, ShowAction
from gcs.testing.virtual_site import SiteShow, fly_site, site_config
from tests.flight.test_site_api import BUS, call
from tests.support.written_show import NAME, answer
from tests.support.written_show import TEXT as AT_30_DEG

TEXT = AT_30_DEG.replace("heading_deg: 30.0", "heading_deg: 0.0").replace(
    "  endurance_s", "  takeoff_height_m: 5.0\n  takeoff_stagger_s: 0.2\n  endurance_s"
)


def config(folder: Path, stations: int, each: int) -> Config:
    return site_config(stations, each, shows={"folder": folder}, preflight={"shift_max_m": 4.0})


def checked(show: SiteShow, station: str) -> str:
    """Upload and check the show at one station. Returns: its hash."""
    service, shows = show[station].service, show.config.shows
    assert shows is not None
    (shows.folder / f"{NAME}.yaml").write_text(TEXT)
    found = service.shows.found(NAME, TEXT.encode(), dict(answer(TEXT)))
    assert found.hash is not None
    return found.hash


def selected(show: SiteShow, station: str) -> SelectedShow:
    found = show[station].view.selected
    assert found is not None
    return found


@pytest.mark.soak
def test_any_station_selects_seeks_and_deselects_for_all(tmp_path: Path) -> None:
    async def story(show: SiteShow) -> None:
        await show.wait(4.0)
        show_hash = checked(show, "south")
        with pytest.raises(UnknownError, match="has not been checked"):
            show["north"].service.shows.checked(NAME)
        body = {"hash": show_hash}
        assert (await call(show, "south", "POST", f"/shows/{NAME}/select", json=body))["hash"] == show_hash
        await show.wait(1.0)
        for name in show.stations:
            assert (selected(show, name).name, selected(show, name).hash) == (NAME, show_hash)
            assert len(selected(show, name).timeline) == 5
            assert show[name].view.plan.formation.radius_m == 6.0
            report = show[name].service.preflight.report()
            assert [each.state for each in report.fleet if each.name == "show"] == ["pass"]
        await call(show, "west", "POST", "/show/seek", json={"cue": "turn"})
        await show.wait(1.0)
        assert {selected(show, name).clock_s for name in show.stations} == {18.0}
        with pytest.raises(RefusedError, match="start with its hash"):
            show["west"].service.commands.command_show(ShowAction.START)
        await show["east"].kill()
        await show.wait(1.0)
        show["south"].service.player.deselect()
        await show.wait(1.0)
        assert {show[name].view.selected for name in ("north", "south", "west")} == {None}
        with pytest.raises(RefusedError, match="no show is selected"):
            show["south"].service.player.seek("turn")

    fly_site(story, config(tmp_path, 4, 1), **BUS)


@pytest.mark.soak
def test_next_lead_goes_on_with_the_show(tmp_path: Path) -> None:
    async def story(show: SiteShow) -> None:
        await show.until(lambda: all(all(each.view.rows.ready) for each in show.stations.values()), 20.0)
        show_hash = checked(show, "south")
        show["south"].service.player.select(NAME, show_hash)
        await show.wait(4.0)
        record = show["south"].service.commands.command_show(ShowAction.START, show_hash=show_hash)
        assert {one.outcome for one in record.outcomes.values()} == {Outcome.PENDING}
        await show.reach(ShowPhase.RUNNING)
        await show.until(lambda: selected(show, "north").clock_s > 10.0)
        assert abs(selected(show, "south").clock_s - selected(show, "north").clock_s) < 0.2
        plan = show["south"].service.plan
        with pytest.raises(RefusedError, match="decides the formation"):
            plan.set_formation(plan.current.formation)
        await show["north"].kill()
        rest = "south", "west", "east"
        await show.reach(ShowPhase.PAUSED, *rest, limit_s=3.0)
        held_s = selected(show, "south").clock_s
        await show.wait(3.0)
        assert selected(show, "south").clock_s == held_s
        assert show["south"].service.stations is not None
        show["south"].service.stations.take_lead()
        await show.reach(ShowPhase.RUNNING, *rest, limit_s=15.0)
        assert held_s <= selected(show, "south").clock_s < held_s + 1.0
        await show.until(lambda: selected(show, "south").cue == "guest")
        await show.wait(1.0)
        assert min(show[name].view.plan.formation.radius_m for name in rest) > 6.0
        await show.reach(ShowPhase.RETURNING, *rest, limit_s=60.0)
        assert all("is over" in show[name].view.reason for name in rest)
        assert show.violations == 0

    fly_site(story, config(tmp_path, 4, 1), **BUS)


@pytest.mark.soak
def test_named_vehicles_of_all_stations_have_parts_of_their_own(tmp_path: Path) -> None:
    """Every station has the same parts: the lead gives them, whichever station is asked."""

    async def story(show: SiteShow) -> None:
        await show.until(lambda: all(all(each.view.rows.ready) for each in show.stations.values()), 20.0)
        show_hash = checked(show, "south")
        show["south"].service.player.select(NAME, show_hash)
        await show.wait(4.0)
        command = show["south"].service.commands.command_show
        with pytest.raises(RefusedError, match="with a vehicle of the leading station north"):
            command(ShowAction.START, ["s1", "s2"], show_hash=show_hash)
        command(ShowAction.START, ["s2", "s1", "n1"], show_hash=show_hash)
        await show.reach(ShowPhase.RUNNING)
        await show.wait(1.0)
        for each in show.stations.values():
            run = each.service.player.show.run
            assert run is not None
            assert run.parts == {"n1": 0, "s1": 1, "s2": 2}
        assert show.violations == 0

    fly_site(story, config(tmp_path, 2, 2), **BUS)
