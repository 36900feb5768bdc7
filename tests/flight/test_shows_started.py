"""How a written show is started: only as it was checked, by whom it needs, at a clock time, from a cue."""

from pathlib import Path
from typing import Any

import httpx
import pytest

from gcs.api.app import create_app
from gcs.model.errors import InvalidError, RefusedError, UnknownError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import MAX_OBSTACLES, Formation, Obstacle
from gcs.service import Outcome, ShowAction, VehicleAction
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, alarm_texts, refused
from tests.support.written_show import NAME, TEXT, answer, check, config, fly, keep, select

ALL = ("d1", "d2", "d3", "d4")
AHEAD_S = 12.0
LINES = {
    "origin": "origin:",
    "origin.heading_deg": "origin:",
    "fence.distance_max_m": "fence:",
    "limits.separation_min_m": "",  # left out: the file's first line
    "fleet.takeoff_height_m": "fleet:",
    "fleet.takeoff_stagger_s": "fleet:",
}
"""Where in the file the problem is."""


def box(name: str, y_m: float = -60.0) -> Obstacle:
    return Obstacle(name, 60.0, y_m, 1.0, 1.0, 5.0)


def test_start_must_name_the_checked_show(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        service = show.service
        await show.standby()

        async def start_refused(show_hash: str | None, *vehicles: str) -> str:
            desired = vehicles or None
            refusal = await refused(
                show, lambda: service.commands.command_show(ShowAction.START, desired, show_hash=show_hash)
            )
            assert refusal.kind is RefusedError
            assert show.view.show is ShowPhase.IDLE
            return refusal.text

        assert "no show is selected" in await start_refused("0" * 64)
        show_hash = check(show)
        assert "no show is selected" in await start_refused(show_hash)
        service.player.select(NAME, show_hash)
        assert f"start with its hash {show_hash}" in await start_refused(None)
        assert "is selected with the hash" in await start_refused("0" * 64)
        assert "d4: offline: no telemetry for " in await start_refused_with_one_silent(show, show_hash)
        keep(show, TEXT.replace("radius_m: 7", "radius_m: 8"))
        assert "has changed since it was checked" in await start_refused(show_hash)
        keep(show)
        record = service.commands.command_show(ShowAction.START, ALL[:3], show_hash=show_hash)
        await show.reach(ShowPhase.RUNNING)
        assert service.command_log.get(record.id).outcomes["d4"].reason == "not chosen"
        assert show.vehicle("d4").colour is None
        assert [show.vehicle(name).colour for name in ALL[:3]] == ["#ff0000", "#0000ff", "#ff0000"]

    async def start_refused_with_one_silent(show: VirtualShow, show_hash: str) -> str:
        show.ports.silence("d4")
        await show.wait(5.0)
        refusal = await refused(
            show, lambda: show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        )
        show.ports.restore("d4")
        await show.standby()
        return refusal.text

    fly(story, config(tmp_path))


@pytest.mark.parametrize(
    ("sections", "says"),
    [
        ({"show_frame": {"heading_deg": 37.0}}, "origin.heading_deg = 30: the service's is 37"),
        ({"show_frame": {"latitude_deg": 47.397787}}, "origin: 5.0 m sideways"),
        ({"control": {"safety": {"fence": {"distance_max_m": 90.0}}}}, "fence.distance_max_m = 100: at most"),
        ({"control": {"safety": {"floor": {"horizontal_m": 2.5}}}}, "separation_min_m = 2: at least"),
        ({"operation": {"takeoff_height_m": 6.0}}, "fleet.takeoff_height_m = 5: the service's"),
        ({"operation": {"takeoff_stagger_s": 0.3}}, "fleet.takeoff_stagger_s = 1: the service's"),
    ],
)
def test_show_that_would_fly_differently_cannot_be_selected(
    tmp_path: Path, sections: dict[str, dict[str, object]], says: str
) -> None:
    async def story(show: VirtualShow) -> None:
        show_hash = check(show)
        refusal = await refused(show, lambda: show.service.player.select(NAME, show_hash))
        assert refusal.kind is RefusedError
        assert says in refusal.text
        assert show.view.selected is None
        describe = show.service.shows.checked(NAME)
        assert (describe.state, describe.good, describe.fits_service) == ("done", False, False)
        (problem,) = describe.problems
        assert f"does not fit this service: {problem.text}" in refusal.text
        assert TEXT.splitlines()[problem.line - 1].startswith(
            LINES[problem.text.split(" =")[0].split(":")[0]]
        )

    fly(story, config(tmp_path, **sections))


def test_rest_check_reports_all_that_select_would_refuse(
    tmp_path: Path,
) -> None:
    """Before: "good to fly" on the card, refused on Select, and still good to fly."""

    async def story(show: VirtualShow) -> None:
        show_hash = check(show)
        transport = httpx.ASGITransport(create_app(show.service))
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as api:

            async def describe() -> dict[str, Any]:
                found: dict[str, Any] = (await api.get(f"/api/v1/shows/{NAME}/check")).json()
                return found

            async def select() -> httpx.Response:
                return await api.post(f"/api/v1/shows/{NAME}/select", json={"hash": show_hash})

            assert ((await describe())["good"], (await describe())["fits_service"]) == (True, True)
            show.service.plan.add_obstacle(box("tower"))
            found = await describe()
            assert (found["state"], found["good"], found["fits_service"]) == ("done", False, False)
            refusal = await select()
            assert refusal.status_code == 409
            assert [each["text"] for each in found["problems"]] == [
                "it has obstacles of its own called tower: remove those that stand"
            ]
            assert found["problems"][0]["text"] in refusal.json()["detail"]
            show.service.plan.remove_obstacle("tower")
            assert (await describe())["good"]
            assert (await select()).status_code == 200

    fly(story, config(tmp_path))


@pytest.mark.soak
def test_obstacles_of_show_and_operator_are_kept_apart(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        service = show.service
        show_hash = check(show)
        service.plan.add_obstacle(box("tower"))
        refusal = await refused(show, lambda: service.player.select(NAME, show_hash))
        assert "obstacles of its own called tower" in refusal.text
        service.plan.remove_obstacle("tower")
        for number in range(MAX_OBSTACLES):
            service.plan.add_obstacle(box(f"b{number}", -20.0 - 4.0 * number))
        refusal = await refused(show, lambda: service.player.select(NAME, show_hash))
        assert f"at most {MAX_OBSTACLES} together" in refusal.text
        service.plan.remove_obstacle("b0")
        service.player.select(NAME, show_hash)
        refusal = await refused(show, lambda: service.plan.add_obstacle(box("b0")))
        assert "the most possible" in refusal.text
        for change in (
            lambda: service.plan.remove_obstacle("tower"),
            lambda: service.plan.change_obstacle(box("tower")),
        ):
            assert "decides the obstacle tower" in (await refused(show, change)).text

    fly(story, config(tmp_path))


@pytest.mark.soak
def test_deselected_show_restores_the_earlier_plan(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        service = show.service
        service.plan.set_formation(Formation(9.0, 16.0))
        select(show)
        await show.wait(1.0)
        assert show.view.plan.formation == Formation(6.0, 14.0)
        service.plan.add_obstacle(box("crane"))
        service.player.deselect()
        await show.wait(1.0)
        assert show.view.selected is None
        assert show.view.plan.formation == Formation(9.0, 16.0)
        assert [each.id for each in show.view.plan.obstacles] == ["crane"]
        service.plan.set_formation(Formation(8.0, 15.0))

    fly(story, config(tmp_path))


def test_vertical_overlaps_of_the_check_are_named_before_takeoff(tmp_path: Path) -> None:
    found = {"upper": 4, "lower": 1, "sideways_m": 0.4, "cue": "turn"}

    async def story(show: VirtualShow) -> None:
        await show.standby()
        keep(show)
        checked = show.service.shows.found(NAME, TEXT.encode(), {**answer(TEXT), "columns": [found]})
        assert checked.hash is not None
        show.service.player.select(NAME, checked.hash)
        show.service.commands.command_show(ShowAction.START, show_hash=checked.hash)
        await show.reach(ShowPhase.ARMING)
        await show.until(lambda: any("are stacked" in text for text in alarm_texts(show)), 1.0)
        (notice,) = alarm_texts(show)
        assert "d4 above d1 at 'turn'" in notice

    fly(story, config(tmp_path))


@pytest.mark.soak
def test_a_start_at_a_clock_time_counts_down_and_takes_off_then(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        service = show.service
        await show.standby()
        show_hash = select(show)
        at_s = show.unix() + AHEAD_S
        record = service.commands.command_show(ShowAction.START, show_hash=show_hash, at_unix_time_s=at_s)
        begun_s = show.now_s
        await show.wait(AHEAD_S / 2)
        assert show.view.show is ShowPhase.COUNTDOWN
        assert show.view.start_unix_time_s == at_s
        assert show.view.countdown_s == pytest.approx(AHEAD_S / 2, abs=0.1)
        assert service.command_log.get(record.id).outcome is Outcome.PENDING
        for change in (lambda: service.player.seek("turn"), service.player.deselect):
            assert "counted down" in (await refused(show, change)).text
        await show.reach(ShowPhase.ARMING)
        assert show.now_s - begun_s == pytest.approx(AHEAD_S, abs=0.1)
        assert show.view.countdown_s is None
        await show.reach(ShowPhase.RUNNING)
        assert service.command_log.get(record.id).outcome is Outcome.DONE

    fly(story, config(tmp_path))


@pytest.mark.soak
def test_called_off_countdown_fails_its_command_no_takeoff(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        service = show.service
        await show.standby()
        show_hash = select(show)
        record = service.commands.command_show(
            ShowAction.START, show_hash=show_hash, at_unix_time_s=show.unix() + AHEAD_S
        )
        service.commands.command_show(ShowAction.STOP)
        await show.wait(2.0 * AHEAD_S)
        assert show.view.show is ShowPhase.IDLE
        assert {part.outcome for part in service.command_log.get(record.id).outcomes.values()} == {
            Outcome.FAILED
        }
        assert not any(show.fleet.autopilots[row].commander.armed for row in range(4))

    fly(story, config(tmp_path))


@pytest.mark.keeps("changed")
@pytest.mark.parametrize("what", ["silent", "changed", "clock"])
def test_change_before_the_clock_time_calls_the_start_off(tmp_path: Path, what: str) -> None:
    async def story(show: VirtualShow) -> None:
        service = show.service
        await show.standby()
        show_hash = select(show)
        record = service.commands.command_show(
            ShowAction.START, show_hash=show_hash, at_unix_time_s=show.unix() + AHEAD_S
        )
        await show.wait(1.0)
        if what == "silent":
            show.ports.silence("d3")
        elif what == "changed":
            keep(show, TEXT + "\n# a word\n")
        else:
            show.unix.ahead_s += 3600.0
        await show.until(lambda: show.view.show is ShowPhase.IDLE, 2.0 * AHEAD_S)
        expected = {"silent": "d3: offline", "changed": "has changed", "clock": "missed by"}[what]
        assert expected in show.view.reason
        assert expected in service.command_log.get(record.id).outcomes["d1"].reason

    fly(story, config(tmp_path))


@pytest.mark.parametrize("ahead_s", [-1.0, 0.0, 2e5, float("nan")])
def test_a_clock_time_that_is_past_or_far_is_refused(tmp_path: Path, ahead_s: float) -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        at_s = show.unix() + ahead_s
        refusal = await refused(
            show, lambda: show.service.commands.command_show(ShowAction.START, at_unix_time_s=at_s)
        )
        assert refusal.kind is InvalidError
        assert "ahead by at most 24 h" in refusal.text

    fly(story, config(tmp_path))


@pytest.mark.soak
def test_on_the_ground_a_show_is_set_to_a_cue_and_begins_there(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        service = show.service
        await show.standby()
        refusal = await refused(show, lambda: service.player.seek("turn"))
        assert "no show is selected" in refusal.text
        show_hash = select(show)
        refusal = await refused(show, lambda: service.player.seek("nowhere"))
        assert (refusal.kind, "there are stand, walk" in refusal.text) == (UnknownError, True)
        assert service.player.seek("guest").clock_s == 26.0
        service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.reach(ShowPhase.RUNNING)
        assert show.view.selected is not None
        assert show.view.selected.cue == "guest"
        assert show.view.selected.clock_s == pytest.approx(26.0, abs=0.1)
        for change in (
            lambda: service.player.seek("stand"),
            lambda: service.player.select(NAME, show_hash),
            service.player.deselect,
        ):
            assert "home first" in (text := (await refused(show, change)).text) or "stop it" in text
        service.commands.command_show(ShowAction.STOP)
        await show.phase("d1", Phase.LANDING)
        assert show.view.selected.clock_s < 42.0

    fly(story, config(tmp_path))


@pytest.mark.soak
def test_vehicle_found_airborne_does_not_begin_an_unstarted_show(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        service = show.service
        await show.standby()
        await show.start()
        show.ports.silence("d1")
        await show.until(lambda: show.vehicle("d1").phase == "lost")
        for name in show.config.ids[1:]:
            await show.command(name, VehicleAction.LAND)
        await show.reach(ShowPhase.LANDED)
        show_hash = check(show)
        service.player.select(NAME, show_hash)
        show.ports.restore("d1")
        await show.reach(ShowPhase.PAUSED)
        refusal = await refused(show, lambda: service.commands.command_show(ShowAction.RESUME))
        assert "was never started: stop brings home" in refusal.text
        service.commands.command_show(ShowAction.STOP)
        await show.phase("d1", Phase.LANDING)

    fly(story, config(tmp_path, operation=HOLDS_WHEN_LOST))
