"""A drawn show, flown by the service: approach, trajectories, lost and late vehicles, landing."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import SelectedShow, ShowAction
from gcs.shows.formats import read_drawing
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, FlownTrack, VirtualShow, fly, show_config
from tests.support.drawn_flight import COUNT, FRAME, NAME, checked, on_pads, write_show


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the service keeps shows: a show file, and its drawing beside it."""
    folder = tmp_path_factory.mktemp("shows")
    write_show(folder)
    return folder


SPARE = "{late: catch-up, spares: {count: 1, before_cue: 2 back}}"


def config(folder: Path, count: int = COUNT) -> Config:
    return show_config(count, shows={"folder": folder}, show_frame=FRAME, operation=HOLDS_WHEN_LOST)


def select(show: VirtualShow, folder: Path, drawing: str = "{}") -> SelectedShow:
    path = folder / f"{NAME}.yaml"
    text, answer = checked(path, drawing)
    path.write_text(text)
    reported = show.service.shows.found(NAME, text.encode(), dict(answer))
    assert reported.good, reported.problems
    assert reported.hash is not None
    return show.service.player.select(NAME, reported.hash)


def selected(show: VirtualShow) -> SelectedShow:
    found = show.view.selected
    assert found is not None
    return found


async def start(show: VirtualShow, folder: Path, drawing: str = "{}") -> None:
    found = select(show, folder, drawing)
    await show.standby()
    show.service.commands.command_show(ShowAction.START, show_hash=found.hash)
    await show.reach(ShowPhase.RUNNING, 90.0)


@pytest.mark.soak
def test_a_drawn_show_is_flown_from_pad_to_pad(folder: Path) -> None:
    async def story(show: VirtualShow) -> tuple[FlownTrack, SelectedShow, int]:
        await start(show, folder)
        await show.reach(ShowPhase.LANDED, 240.0)
        await show.wait(0.2)
        return show.track, selected(show), show.floor_violations()

    track, ended, violations = fly(story, config(folder), **on_pads(folder))
    assert violations == 0
    assert track.show_phases()[-4:] == [
        ShowPhase.ASSEMBLING,
        ShowPhase.RUNNING,
        ShowPhase.RETURNING,
        ShowPhase.LANDED,
    ]
    assert ended.track_rms_m is not None
    assert ended.track_rms_m <= 0.3
    assert not any(track.samples[-1].armed)


@pytest.mark.soak
def test_a_lost_vehicle_does_not_end_a_drawn_show(folder: Path) -> None:
    async def story(show: VirtualShow) -> tuple[FlownTrack, float, int]:
        await start(show, folder)
        await show.until(lambda: selected(show).clock_s > 8.0)
        show.befall("d4", "silence")
        lost_s = show.now_s
        await show.phase("d4", Phase.LOST, 30.0)
        await show.wait(0.5)
        (text,) = (alarm.text for alarm in show.view.alarms if alarm.cause == "vehicle-lost")
        assert text.endswith(". The others fly on as drawn, and keep clear of it."), (
            "no formation closes a gap"
        )
        await show.until(lambda: show.view.show is ShowPhase.RETURNING, 60.0)
        return show.track, lost_s, show.floor_violations()

    track, lost_s, violations = fly(story, config(folder), **on_pads(folder))
    assert violations == 0
    assert ShowPhase.UNCONTROLLED not in track.show_phases()
    flown = track.between(lost_s + 5.0)
    assert {seen.phase for name in ("d1", "d8") for seen in flown.of(name)} >= {Phase.FORMATION}


@pytest.mark.soak
def test_a_spare_takes_the_place_of_a_lost_vehicle(folder: Path) -> None:
    async def story(show: VirtualShow) -> tuple[list[tuple[str, ...]], float, FlownTrack, int]:
        await start(show, folder, SPARE)
        stood_by = [selected(show).spares]
        await show.until(lambda: selected(show).clock_s > 4.0)
        grounded = show.vehicle("d9").phase
        show.befall("d4", "silence")
        await show.phase("d4", Phase.LOST, 30.0)
        await show.phase("d9", Phase.FORMATION, 40.0)
        stood_by.append(selected(show).spares)
        await show.until(lambda: off_m(show, "d9") < 0.5, 40.0)
        assert grounded is Phase.STANDBY
        away_m = off_m(show, "d9")
        await show.reach(ShowPhase.LANDED, 240.0)
        return stood_by, away_m, show.track, show.floor_violations()

    stood_by, away_m, track, violations = fly(story, config(folder, COUNT + 1), **on_pads(folder))
    assert stood_by == [("d9",), ()]
    assert away_m < 0.5
    assert violations == 0
    assert {Phase.TAKEOFF, Phase.FORMATION, Phase.RETURN} <= set(track.phases("d9"))


@pytest.mark.soak
def test_the_drawings_yaw_is_flown_where_the_show_asks_for_it(folder: Path) -> None:
    """The drawing turns every vehicle by half a turn, from its beginning to its end."""

    async def story(show: VirtualShow) -> tuple[float, list[float]]:
        await start(show, folder, "{yaw: drawn}")
        await show.until(lambda: selected(show).clock_s > 15.0)
        fleet = show.service.player.newest.state
        return selected(show).clock_s, np.degrees(fleet.yaw_rad).tolist()

    clock_s, yaws_deg = fly(story, config(folder), **on_pads(folder))
    end_s = read_drawing(folder / "rings.skyc")[0].duration_s
    assert yaws_deg == pytest.approx([180.0 * clock_s / end_s] * COUNT, abs=8.0)


class Late(NamedTuple):
    """A vehicle that a gust blew off its trajectory."""

    farthest_m: float
    later_m: float  # 12 s after the gust
    waited_s: float  # by which the show's clock is late
    shown: SelectedShow


def blown_off(folder: Path, late: str) -> Late:
    async def story(show: VirtualShow) -> Late:
        await start(show, folder, f"{{late: {late}}}")
        await show.until(lambda: selected(show).clock_s > 2.0)
        begun_s = show.now_s - selected(show).clock_s
        show.befall("d1", "wind", north_m_s=11.0, east_m_s=0.0, down_m_s=0.0)
        farthest_m = 0.0
        for _ in range(12):
            await show.wait(0.25)
            farthest_m = max(farthest_m, off_m(show))
        show.befall("d1", "wind", north_m_s=0.0, east_m_s=0.0, down_m_s=0.0)
        for _ in range(48):
            await show.wait(0.25)
            farthest_m = max(farthest_m, off_m(show))
        return Late(farthest_m, off_m(show), show.now_s - begun_s - selected(show).clock_s, selected(show))

    return fly(story, config(folder), **on_pads(folder))


def off_m(show: VirtualShow, vehicle_id: str = "d1") -> float:
    """How far a vehicle is off its trajectory, as the service estimates it."""
    flight = show.service.player
    assert flight.show.run is not None
    return float(flight.show.run.off_m[flight.vehicles[vehicle_id].row])


@pytest.mark.soak
def test_a_late_vehicle_catches_up_and_the_clock_runs_on(folder: Path) -> None:
    late = blown_off(folder, "catch-up")
    assert late.farthest_m > 3.0
    assert late.later_m < 0.5
    assert late.waited_s == pytest.approx(0.0, abs=0.11)
    assert late.shown.track_max_m is not None
    assert late.shown.track_max_m > 3.0


@pytest.mark.soak
def test_the_clock_of_a_waiting_show_waits_for_a_late_one(folder: Path) -> None:
    late = blown_off(folder, "wait")
    assert late.farthest_m > 3.0
    assert late.later_m < 0.5
    assert 1.0 < late.waited_s < 15.0


@pytest.mark.soak
def test_a_drawn_show_begins_at_its_time_and_keeps_it(folder: Path) -> None:
    """The vehicles wait where the drawing begins, then are where it has them for the time since then."""

    async def story(show: VirtualShow) -> tuple[float, float, float]:
        found = select(show, folder)
        await show.standby()
        show.service.commands.command_show(ShowAction.START, show_hash=found.hash)
        at_s = show.unix() + 60.0317
        show.service.player.begin_at(at_s)
        begins_s = at_s - show.unix.ahead_s
        await show.reach(ShowPhase.RUNNING, 90.0)
        begun_s = show.view.time_s - begins_s
        await show.wait(10.0)
        off_s = selected(show).clock_s - (show.view.time_s - begins_s)
        return begun_s, off_s, float(selected(show).track_max_m or 0.0)

    begun_s, off_s, track_max_m = fly(
        story, config(folder), **on_pads(folder), ideal=True
    )  # its time is judged
    assert begun_s == pytest.approx(0.0, abs=0.001)
    assert off_s == pytest.approx(0.0, abs=0.001)
    assert 0.0 < track_max_m < 0.5
