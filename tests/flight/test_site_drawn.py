"""A drawn show flown by several stations, each of which has its own copy of the drawing."""

import asyncio
from functools import cache
from pathlib import Path
from shutil import copyfile
from typing import Final

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array
from gcs.service import SelectedShow, ShowAction
from gcs.shows.drawn import LightPrograms
from gcs.shows.drawn.light_programs import LightProgram
from gcs.shows.formats import write_drawing
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, fly, show_config
from gcs.testing.virtual_site import SiteShow, fly_on_pads, site_config
from tests.support.drawn_flight import COUNT, DRAWING, FRAME, NAME, SPACING_M, checked, on_pads, write_show
from tests.support.drawn_shows import drawn_show

BUS: Final = {"delay_s": 0.02, "spread_s": 0.01, "loss": 0.01}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the stations keep shows: a show file, and its drawing beside it."""
    folder = tmp_path_factory.mktemp("shows")
    write_show(folder)
    return folder


def config(folder: Path, stations: int) -> Config:
    operation = {"takeoff_height_m": 5.0, "takeoff_stagger_s": 1.0, "require_safe_setpoint_loss": False}
    return site_config(
        stations,
        COUNT // stations,
        shows={"folder": folder},
        show_frame=FRAME,
        operation=operation | HOLDS_WHEN_LOST,
    )


def select(show: SiteShow, folder: Path, at: str, drawing: str = "{}") -> SelectedShow:
    """Check and select the show at one station."""
    text, answer = checked(folder / f"{NAME}.yaml", drawing)
    kept = show[at].config.shows
    assert kept is not None
    (kept.folder / f"{NAME}.yaml").write_text(text)
    reported = show[at].service.shows.found(NAME, text.encode(), dict(answer))
    assert reported.good, reported.problems
    return show[at].service.player.select(NAME, reported.hash or "")


def selected(show: SiteShow, station: str) -> SelectedShow:
    found = show[station].view.selected
    assert found is not None
    return found


async def ready(show: SiteShow) -> None:
    await show.until(lambda: all(all(each.view.rows.ready) for each in show.stations.values()), 20.0)


async def start(show: SiteShow, folder: Path, at: str, drawing: str = "{}") -> None:
    """Select and start at one station, and wait until the drawing is flown."""
    await ready(show)
    found = select(show, folder, at, drawing)
    await show.wait(4.0)
    show[at].service.commands.command_show(ShowAction.START, show_hash=found.hash)
    await show.reach(ShowPhase.RUNNING, limit_s=90.0)


def parts(show: SiteShow, station: str) -> dict[str, int]:
    run = show[station].service.player.show.run
    assert run is not None
    return run.parts


def off_m(show: SiteShow) -> Array:
    """(n,) true distances of all vehicles from their trajectories, at the lead's clock."""
    run = show["north"].service.player.show.run
    assert run is not None
    motion = run.timeline.motion_at(selected(show, "north").clock_s)
    assert motion is not None
    rows = [run.parts[name] for name in show.config.ids]
    return np.asarray(np.linalg.norm(show.true_m - motion.position_m[rows], axis=1))


@cache
def alone_rms_m(folder: Path) -> float:
    """Track error of the same show flown by one station."""

    async def story(show: VirtualShow) -> float:
        text, answer = checked(folder / f"{NAME}.yaml", "{}")
        reported = show.service.shows.found(NAME, text.encode(), dict(answer))
        show.service.player.select(NAME, reported.hash or "")
        await show.standby()
        show.service.commands.command_show(ShowAction.START, show_hash=reported.hash)
        await show.reach(ShowPhase.LANDED, 300.0)
        await show.wait(0.2)
        found = show.view.selected
        assert found is not None
        assert found.track_rms_m is not None
        return found.track_rms_m

    plan = show_config(COUNT, shows={"folder": folder}, show_frame=FRAME, operation=HOLDS_WHEN_LOST)
    return fly(story, plan, **on_pads(folder), ideal=True)


@pytest.mark.soak
@pytest.mark.parametrize("stations", [2, 4])
def test_stations_fly_a_drawing_as_one_does(folder: Path, stations: int) -> None:
    async def story(show: SiteShow) -> tuple[SelectedShow, float]:
        await start(show, folder, "south")
        farthest_m = 0.0
        while show["north"].view.show is ShowPhase.RUNNING:
            farthest_m = max(farthest_m, float(off_m(show).max()))
            clocks_s = [selected(show, name).clock_s for name in show.stations]
            assert np.ptp(clocks_s) < 0.1, clocks_s
            assert all(parts(show, name) == parts(show, "north") for name in show.stations)
            await show.wait(0.5)
        assert sorted(parts(show, "south").values()) == list(range(COUNT))
        await show.reach(ShowPhase.LANDED, limit_s=240.0)
        assert not show.armed.any()
        assert show.violations == 0
        return selected(show, "north"), farthest_m

    exact = {**on_pads(folder), "ideal": True}  # both with the same: errors of estimates are no difference
    ended, farthest_m = fly_on_pads(story, config(folder, stations), exact, **BUS)
    assert ended.track_rms_m is not None
    assert ended.track_rms_m <= alone_rms_m(folder) + 0.05
    assert farthest_m < 1.0


@pytest.mark.soak
def test_the_next_lead_goes_on_with_the_drawing(folder: Path) -> None:
    async def story(show: SiteShow) -> None:
        await start(show, folder, "north")
        await show.until(lambda: selected(show, "north").clock_s > 8.0)
        assigned = parts(show, "south")
        await show["north"].kill()
        rest = "south", "west", "east"
        await show.reach(ShowPhase.PAUSED, *rest, limit_s=3.0)
        held_s = selected(show, "south").clock_s
        await show.wait(3.0)
        before_m = show.true_m
        await show.wait(2.0)
        assert np.abs(show.true_m - before_m).max() < 0.5
        assert selected(show, "south").clock_s == held_s
        assert show["south"].service.stations is not None
        show["south"].service.stations.take_lead()
        await show.reach(ShowPhase.RUNNING, *rest, limit_s=90.0)
        assert held_s <= selected(show, "south").clock_s < held_s + 1.0
        await show.until(lambda: selected(show, "south").clock_s > held_s + 5.0)
        assert all(parts(show, name) == assigned for name in rest)
        assert all(abs(selected(show, name).clock_s - selected(show, "south").clock_s) < 0.1 for name in rest)
        await show.reach(ShowPhase.RETURNING, *rest, limit_s=90.0)
        await show.reach(ShowPhase.LANDED, *rest, limit_s=240.0)
        assert all(show.in_phase(name, Phase.STANDBY) == COUNT // 4 for name in rest)
        assert show.violations == 0

    exact = {**on_pads(folder), "ideal": True}  # honest receivers have them wander by 0.7 m in 2 s
    fly_on_pads(story, config(folder, 4), exact, **BUS)


@pytest.mark.soak
def test_a_cut_bus_holds_both_sides_which_go_on_when_it_heals(folder: Path) -> None:
    async def story(show: SiteShow) -> None:
        await start(show, folder, "north")
        await show.until(lambda: selected(show, "north").clock_s > 8.0)
        show.network.cut({"north"}, {"south"})
        lost_s = selected(show, "south").clock_s
        await show.reach(ShowPhase.PAUSED, "south", limit_s=3.0)
        assert lost_s + 0.3 < selected(show, "south").clock_s < lost_s + 1.0
        show.network.cut()
        await show.reach(ShowPhase.RUNNING, limit_s=30.0)
        await show.wait(2.0)
        assert selected(show, "south").clock_s == pytest.approx(selected(show, "north").clock_s, abs=0.1)
        await show.reach(ShowPhase.LANDED, limit_s=240.0)
        assert show.violations == 0

    fly_on_pads(story, config(folder, 2), on_pads(folder), **BUS)


def own_folders(folder: Path, *stations: str) -> None:
    """Give each of these stations a folder of its own with the show's drawing."""
    for name in stations:
        (folder / name).mkdir()
        copyfile(folder / DRAWING, folder / name / DRAWING)


@pytest.mark.soak
def test_a_start_names_the_station_without_the_drawing(tmp_path: Path) -> None:
    write_show(tmp_path)
    own_folders(tmp_path, "north", "south", "west")
    write_drawing(drawn_show(COUNT, 30.0, SPACING_M, ("rings",), seed=2), tmp_path / "south" / DRAWING)
    (tmp_path / "west" / DRAWING).unlink()

    async def story(show: SiteShow) -> None:
        await ready(show)
        found = select(show, tmp_path, "north")
        await show.wait(4.0)
        command = show["north"].service.commands.command_show
        with pytest.raises(RefusedError, match=f"station south: the drawing {DRAWING} .* is another"):
            command(ShowAction.START, show_hash=found.hash)
        copyfile(tmp_path / DRAWING, tmp_path / "south" / DRAWING)
        await show.wait(8.0)
        with pytest.raises(RefusedError, match=f"station west: the drawing {DRAWING} is not in its folder"):
            command(ShowAction.START, show_hash=found.hash)
        assert show["west"].view.selected is None
        copyfile(tmp_path / DRAWING, tmp_path / "west" / DRAWING)
        await show.wait(8.0)
        command(ShowAction.START, show_hash=found.hash)
        await show.reach(ShowPhase.ARMING, limit_s=5.0)

    fly_on_pads(story, config(tmp_path, 4), on_pads(tmp_path), **BUS)


@pytest.mark.soak
def test_a_lead_without_the_drawing_refuses_it_by_name(tmp_path: Path) -> None:
    write_show(tmp_path)
    own_folders(tmp_path, "north", "south")
    (tmp_path / "north" / DRAWING).unlink()

    async def story(show: SiteShow) -> None:
        await show.wait(4.0)
        select(show, tmp_path, "south")
        await show.wait(1.0)
        reported = [one.text for one in show["south"].service.events.newest()]
        why = [text for text in reported if text.startswith("station north refused to select")]
        assert f"the drawing {DRAWING} is not in its folder" in why[-1]
        assert {each.view.selected for each in show.stations.values()} == {None}

    fly_on_pads(story, config(tmp_path, 2), on_pads(tmp_path), **BUS)


@pytest.mark.soak
def test_spares_are_refused_at_a_site(folder: Path) -> None:
    async def story(show: SiteShow) -> None:
        await show.wait(2.0)
        text, answer = checked(folder / f"{NAME}.yaml", "{spares: {count: 1, before_cue: 2 back}}")
        reported = show["south"].service.shows.found(NAME, text.encode(), dict(answer))
        assert not reported.good
        assert any("spare vehicles fly with one station alone" in each.text for each in reported.problems)

    fly_on_pads(story, config(folder, 2), on_pads(folder), **BUS)


@pytest.mark.soak
def test_lights_go_to_their_end_at_every_station(tmp_path: Path) -> None:
    """On the way home as well: red to 4 s after the show's end, then green for 3 s, then blue."""
    end_s = drawn_show(COUNT, 30.0, SPACING_M, ("rings",)).duration_s
    times_s = np.array([0.0, end_s + 4.0, end_s + 7.0, end_s + 8.0])
    program = LightProgram(times_s, RGB, RGB)
    write_show(tmp_path, LightPrograms.joined([program] * COUNT))

    async def story(show: SiteShow) -> dict[str, set[int]]:
        await start(show, tmp_path, "north")
        await show.reach(ShowPhase.RETURNING, limit_s=120.0)
        seen: dict[str, set[int]] = {name: set() for name in show.stations}
        now_s = asyncio.get_running_loop().time
        began_s = now_s()
        while any(each.view.show is ShowPhase.RETURNING for each in show.stations.values()):
            since_s = now_s() - began_s
            for name, each in show.stations.items():
                run = each.service.player.show.run
                assert run is not None
                near_a_change = min(abs(since_s - 4.0), abs(since_s - 7.0)) < 0.5
                if each.service.player.show.phase is not ShowPhase.RETURNING or near_a_change:
                    continue
                own = list(run.parts)[: COUNT // 2]
                colours, lit = run.colours(own, each.service.player.newest.state.time_s)
                assert lit.all()
                meant = int(np.searchsorted((4.0, 7.0), since_s))
                assert colours.tolist() == [RGB[meant].tolist()] * len(own), (name, since_s)
                seen[name].add(meant)
            await show.wait(0.25)
        return seen

    exact = {**on_pads(tmp_path), "ideal": True}
    for name, seen in fly_on_pads(story, config(tmp_path, 2), exact, **BUS).items():
        assert {0, 1} <= seen, name


RGB: Final = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255]], np.uint8)
