"""A start by two tokens, checklists and weather, flown: what starts, what is refused, in which words."""

import json
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from random import Random
from typing import Any, Final

import pytest

from gcs.api.schemas import convert
from gcs.cli.main import main
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Formation
from gcs.recording.session import Record
from gcs.service import CommandRecord, GoView, Outcome, ShowAction, WeatherEntry
from gcs.service.alarms import AlarmCause
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, fly, refused, show_config
from tests.support import written_show
from tests.support.tokens_flown import by_two, lists_file, token

GOOD: Final = WeatherEntry(wind_m_s=4.0, kp=2.0)
WEATHER: Final = {"wind_max_m_s": 8.0, "kp_max": 4.0, "age_max_s": 60.0}


def go_of(show: VirtualShow) -> GoView:
    view = show.view.features.go
    assert view is not None
    return view


def propose(show: VirtualShow, by: str = "alice", **given: Any) -> CommandRecord:
    with token(by):
        return show.service.commands.command_show(ShowAction.START, **given)


def confirm(show: VirtualShow, by: str, go_hash: str) -> CommandRecord:
    with token(by):
        return show.service.commands.confirm_start(go_hash)


async def why_not(show: VirtualShow, by: str, go_hash: str) -> str:
    """The words of a refused confirmation, by which nothing has started."""
    call = await refused(show, lambda: confirm(show, by, go_hash))
    assert call.kind is RefusedError
    assert show.view.show is ShowPhase.IDLE
    return call.text


async def hash_shown(show: VirtualShow) -> str:
    await show.wait(0.1)
    proposal = go_of(show).proposal
    assert proposal is not None
    return proposal.hash


def test_a_proposed_start_flies_once_another_confirms_it() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        record = propose(show)
        shown = await hash_shown(show)
        proposal = go_of(show).proposal
        assert proposal is not None
        assert (proposal.by, proposal.vehicles, proposal.command_id) == ("alice", 2, record.id)
        assert proposal.until_unix_time_s == pytest.approx(show.unix() + 60.0, abs=0.2)
        assert go_of(show).hashes.keys() == {"show", "parameters", "vehicles", "time"}
        await show.wait(20.0)
        assert show.view.show is ShowPhase.IDLE
        assert await why_not(show, "alice", shown) == "alice proposed this start: another token confirms it"
        assert "not '000000000000'" in await why_not(show, "bob", "0" * 12)
        started = confirm(show, "bob", shown)
        assert (started.id, started.by) == (record.id, "alice")
        await show.reach(ShowPhase.RUNNING)
        done = show.service.command_log.get(record.id)
        assert done.outcome is Outcome.DONE
        actions = [(each.action, each.by) for each in show.service.command_log.newest()]
        assert actions == [("confirm", "bob"), ("start", "alice")]
        texts = [event.text for event in show.service.events.newest()]
        assert f"start of 2 vehicles proposed by alice, to be confirmed in 60 s: {shown}" in texts
        assert f"start of alice confirmed by bob, hash {shown}" in texts
        assert go_of(show).proposal is None

    fly(story, show_config(2, **by_two()))


def shown_of(show: VirtualShow) -> tuple[bool, str]:
    """Whether the API lists a start as possible now, and why not, of the newest state."""
    view = show.view
    answer = convert.show(view, convert.health_problem(view, view.time_s))
    return ShowAction.START in answer.possible, answer.start_refused


@pytest.mark.soak
def test_no_start_is_possible_while_it_would_be_refused(tmp_path: Path) -> None:
    """What displays show agrees with what a start says, at each step to a go and back."""

    async def story(show: VirtualShow) -> None:
        service = show.service

        async def agree(why: str) -> None:
            await show.wait(2.1)
            possible, refused_by = shown_of(show)
            assert possible is not bool(why)
            assert why in refused_by
            report = service.preflight.report()
            assert (report.passes, report.in_short) == (possible, refused_by)
            if why:
                call = await refused(show, lambda: propose(show))
                assert (call.kind, why in call.text) == (RefusedError, True)

        assert not shown_of(show)[0]
        await show.standby()
        await agree("checklist pads: 2 of 2 items are open")
        with token("alice"):
            service.go.sign("pads", [1, 2])
            service.go.sign("observer", [1])
        await agree("wind: not known")
        with token("alice"):
            service.go.enter_weather(GOOD)
        await agree("")
        await show.wait(61.0)
        await agree("entered by alice")
        with token("alice"):
            service.go.enter_weather(GOOD)
        await agree("")
        service.preflight.exclude("d1", "bent")
        service.preflight.exclude("d2", "bent")
        await agree("no vehicle is left")
        service.preflight.include("d1")
        await agree("")
        propose(show)
        confirm(show, "bob", await hash_shown(show))
        await show.reach(ShowPhase.RUNNING)
        assert shown_of(show) == (False, "the show is running: a start is for the ground")

    fly(story, show_config(2, **by_two(weather=WEATHER, checklists=str(lists_file(tmp_path)))))


@pytest.mark.soak
def test_the_flight_report_has_who_started_signed_and_entered(tmp_path: Path) -> None:
    """By the names of their tokens and with times, of each start: as JSON, as text and as a page."""

    async def story(show: VirtualShow) -> str:
        await show.standby()
        for name, role, items in (("carol", "pads", [1]), ("dan", "pads", [2]), ("carol", "observer", [1])):
            with token(name):
                show.service.go.sign(role, items)
        with token("erin"):
            show.service.go.enter_weather(GOOD)
        await show.wait(2.1)
        propose(show)
        await show.wait(5.0)
        shown = await hash_shown(show)
        confirm(show, "bob", shown)
        await show.reach(ShowPhase.RUNNING)
        await show.show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED)
        assert go_of(show).start is not None
        return shown

    config = show_config(2, **by_two(weather=WEATHER, checklists=str(lists_file(tmp_path))))
    root = tmp_path / "runs"
    vehicles = {name: (row + 1, "loop") for row, name in enumerate(config.ids)}
    with Record(root, config.model_dump_json(), vehicles) as record:
        shown = fly(story, config, record=record)
    files = {kind: tmp_path / f"report.{kind}" for kind in ("json", "html")}
    printed = StringIO()
    with redirect_stdout(printed):
        assert main(["report", str(root), "--report", str(files["json"]), "--html", str(files["html"])]) == 0
    (start,) = json.loads(files["json"].read_text())["starts"]
    named = [start[key] for key in ("command_id", "proposed_by", "confirmed_by", "hash")]
    assert named == ["o5", "alice", "bob", shown]
    signers = [item["by"] for role in start["checklists"] for item in role["items"]]
    assert (signers, start["weather"]["by"]) == (["carol", "dan", "carol"], "erin")
    signed_s = start["checklists"][0]["items"][0]["unix_time_s"]
    assert 7.0 < start["unix_time_s"] - signed_s < 9.0
    assert 7.0 < start["unix_time_s"] - start["weather"]["unix_time_s"] < 9.0
    for text in (printed.getvalue(), files["html"].read_text()):
        assert f"proposed by alice, confirmed by bob, hash {shown}" in text
        assert "checklist pads: no person is near: signed by dan at " in text
        assert "weather: wind 4 m/s, Kp 2, entered by erin at " in text


@pytest.mark.soak
def test_a_late_confirmation_starts_nothing() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        record = propose(show)
        shown = await hash_shown(show)
        await show.wait(60.5)
        late = "no other token confirmed it within 60 s"
        assert late in await why_not(show, "bob", shown)
        closed = show.service.command_log.get(record.id)
        assert {part.reason for part in closed.outcomes.values()} == {f"not confirmed: {late}"}
        assert closed.outcome is Outcome.FAILED
        await show.wait(1.0)
        assert go_of(show).ended == late
        assert show.view.show is ShowPhase.IDLE

    fly(story, show_config(2, **by_two()))


def test_what_changes_after_the_proposal_calls_it_off(tmp_path: Path) -> None:
    """Show, vehicles, weather and checklists: each by itself, named in the refusal."""

    async def story(show: VirtualShow) -> None:
        service = show.service
        changes: dict[str, Callable[[], object]] = {
            "show": lambda: service.plan.set_formation(Formation(6.5, 14.0)),
            "vehicles": lambda: service.preflight.exclude("d2", "bent"),
            "weather": lambda: service.go.enter_weather(WeatherEntry(wind_m_s=4.1, kp=2.0)),
            "checklists": lambda: service.go.reopen("pads", [1]),
        }
        await show.standby()
        with token("alice"):
            service.go.enter_weather(GOOD)
            service.go.sign("pads", [1, 2])
            service.go.sign("observer", [1])
        for name, change in changes.items():
            record = propose(show)
            shown = await hash_shown(show)
            with token("bob"):
                change()
            text = await why_not(show, "bob", shown)
            assert f"{name} changed since alice proposed it" in text
            assert service.command_log.get(record.id).outcome is Outcome.FAILED
            assert show.view.show is ShowPhase.IDLE

    fly(story, show_config(2, **by_two(weather=WEATHER, checklists=str(lists_file(tmp_path)))))


@pytest.mark.soak
def test_a_parameter_that_changes_calls_the_proposal_off() -> None:
    """One of which preflight demands nothing that it breaks: the hash alone notices it."""

    async def story(show: VirtualShow) -> None:
        await show.standby()
        await show.link.set_parameter("d2", "COM_OF_LOSS_T", 0.8)
        await show.wait(2.0)
        propose(show)
        shown = await hash_shown(show)
        await show.link.set_parameter("d2", "COM_OF_LOSS_T", 0.9)
        await show.wait(2.0)
        assert "parameters changed since alice proposed it" in await why_not(show, "bob", shown)
        propose(show)
        confirm(show, "bob", await hash_shown(show))
        await show.reach(ShowPhase.RUNNING)

    fly(story, show_config(2, operation=HOLDS_WHEN_LOST, **by_two()))


async def standing(show: VirtualShow) -> None:
    await show.standby()


@pytest.mark.soak
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_random_calls_of_three_tokens_start_nothing_alone(seed: int) -> None:
    """Proposals, confirmations, changes and pauses in any order: what starts was confirmed by another."""

    async def story(show: VirtualShow) -> bool:
        chance, service = Random(seed), show.service
        by, shown, until_s, radius_m = "", "", 0.0, show.view.plan.formation.radius_m
        first_m = proposed_m = radius_m
        kept = True  # nothing has changed since the proposal, not even for a moment
        for _ in range(100):
            token_ = chance.choice(["alice", "bob", "carol"])
            what = chance.choice(["propose", "confirm", "guess", "change", "wait", "wait"])
            now_s = show.now_s
            if what == "wait":
                await show.wait(chance.choice([0.1, 2.0, 25.0, 40.0]))
                continue
            try:
                if what == "propose":
                    propose(show, token_)
                    by, until_s, proposed_m, kept = token_, now_s + 60.0, radius_m, True
                    shown = await hash_shown(show)
                elif what == "change":
                    radius_m = first_m if radius_m != first_m else first_m + 0.5
                    service.plan.set_formation(Formation(radius_m, show.view.plan.formation.height_m))
                    kept = False
                else:
                    confirm(show, token_, shown if what == "confirm" else "ab12" * 3)
                    assert what == "confirm"
                    assert token_ != by != ""
                    assert radius_m == proposed_m
                    assert now_s <= until_s
                    await show.reach(ShowPhase.RUNNING)
                    return True
            except RefusedError:
                assert not (what == "confirm" and token_ != by != "" and kept and now_s <= until_s)
            assert show.view.show is ShowPhase.IDLE
            assert not any(vehicle.armed for vehicle in vehicles_of(show.view))
        return False

    assert fly(story, show_config(2, **by_two()), after=standing)


@pytest.mark.soak
def test_anyone_stops_a_proposal_and_a_flight() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        record = propose(show)
        shown = await hash_shown(show)
        with token("guard"):
            show.service.commands.command_show(ShowAction.STOP)
        assert "called off by guard" in await why_not(show, "bob", shown)
        assert show.service.command_log.get(record.id).outcome is Outcome.FAILED
        propose(show)
        confirm(show, "bob", await hash_shown(show))
        await show.reach(ShowPhase.RUNNING)
        with token("guard"):
            show.service.commands.command_show(ShowAction.STOP)
        await show.reach(ShowPhase.RETURNING)

    fly(story, show_config(2, **by_two()))


@pytest.mark.soak
def test_a_confirmed_countdown_is_called_off_by_a_change() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        record = propose(show, at_unix_time_s=show.unix() + 40.0)
        assert show.view.show is ShowPhase.IDLE
        confirm(show, "bob", await hash_shown(show))
        await show.reach(ShowPhase.COUNTDOWN)
        with token("carol"):
            show.service.go.enter_weather(WeatherEntry(wind_m_s=5.0, kp=2.0))
        await show.wait(3.0)
        changed = "weather changed since the start was confirmed; propose it again"
        assert show.view.reason == f"NOT READY: {changed}"
        alarm = next(each for each in show.view.alarms if each.cause is AlarmCause.START_NOT_READY)
        assert changed in alarm.text
        await show.reach(ShowPhase.IDLE)
        assert show.view.reason == f"did not start: {changed}"
        assert show.service.command_log.get(record.id).outcome is Outcome.FAILED

    fly(story, show_config(2, **by_two()))


@pytest.mark.soak
def test_a_countdown_outlasts_what_is_said_anew(tmp_path: Path) -> None:
    """It takes longer than an entry counts: the same wind again, and a second signature, change nothing."""

    async def story(show: VirtualShow) -> None:
        service = show.service
        await show.standby()
        with token("alice"):
            service.go.enter_weather(GOOD)
            service.go.sign("pads", [1, 2])
            service.go.sign("observer", [1])
        propose(show, at_unix_time_s=show.unix() + 75.0)
        shown = await hash_shown(show)
        with token("carol"), pytest.raises(RefusedError, match="alice has proposed a start"):
            service.commands.command_show(ShowAction.START)
        confirm(show, "bob", shown)
        await show.wait(50.0)
        with token("carol"):
            service.go.enter_weather(GOOD)
            service.go.sign("pads", [1])
        await show.wait(3.0)
        assert not show.view.reason.startswith("NOT READY")
        await show.reach(ShowPhase.RUNNING)

    fly(story, show_config(2, **by_two(weather=WEATHER, checklists=str(lists_file(tmp_path)))))


@pytest.mark.soak
def test_open_items_and_unknown_weather_keep_all_down(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        service, start = show.service, partial(show.service.commands.command_show, ShowAction.START)
        await show.standby()
        text = (await refused(show, start)).text
        for says in (
            "checklist pads: 2 of 2 items are open: (1) each vehicle stands on its pad; (2) no person is",
            "checklist observer: 1 of 1 items are open",
            "do them, and sign each: gcs sign observer NUMBER",
            "wind: not known",
            "Kp: not known",
            "look again, and enter it: gcs weather",
        ):
            assert says in text
        with token("alice"):
            service.go.sign("pads", [1, 2])
            service.go.enter_weather(GOOD)
        with token("bob"):
            service.go.sign("observer", [1])
        lists = {each.role: [item.by for item in each.items] for each in service.go.checklists}
        assert lists == {"pads": ["alice", "alice"], "observer": ["bob"]}
        service.go.enter_weather(WeatherEntry(wind_m_s=9.0, kp=2.0))
        assert "wind: 9 m/s, as service entered it" in (await refused(show, start)).text
        service.go.enter_weather(GOOD)
        await show.wait(61.0)
        assert "wind: entered by service 1 min ago" in (await refused(show, start)).text
        service.go.enter_weather(GOOD)
        start()
        await show.reach(ShowPhase.RUNNING)
        service.commands.command_show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED, 120.0)
        await show.wait(1.1)
        assert all(item.by == "" for each in go_of(show).checklists for item in each.items)
        assert "checklist pads: 2 of 2 items are open" in (await refused(show, start)).text

    fly(story, show_config(2, go={"weather": WEATHER, "checklists": str(lists_file(tmp_path))}))


@pytest.mark.soak
def test_another_show_opens_what_depends_on_it(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        with token("alice"):
            show.service.go.sign("pads", [1, 2])
            show.service.go.sign("observer", [1])
        show_hash = written_show.select(show)
        text = (
            await refused(
                show,
                lambda: show.service.commands.command_show(ShowAction.START, show_hash=show_hash),
            )
        ).text
        assert "checklist pads: 1 of 2 items are open: (1) each vehicle stands on its pad" in text
        assert "checklist observer: 1 of 1 items are open" in text

    plan = written_show.config(tmp_path, go={"checklists": str(lists_file(tmp_path))})
    written_show.fly(story, plan)


def test_one_person_starts_where_nothing_is_set() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        show.service.commands.command_show(ShowAction.START)
        text = (await refused(show, lambda: show.service.commands.confirm_start("0" * 12))).text
        assert "a start needs no confirmation here" in text
        assert show.view.features.go is None
        assert "go is not set" in (await refused(show, lambda: show.service.go.enter_weather(GOOD))).text
        assert (
            "go.checklists is not set" in (await refused(show, lambda: show.service.go.sign("a", [1]))).text
        )
        await show.reach(ShowPhase.RUNNING)
        assert show.vehicle("d1").phase is Phase.FORMATION

    fly(story, show_config(2))


def test_two_tokens_need_a_file_of_tokens() -> None:
    with pytest.raises(ValueError, match=r"needs access\.tokens_file"):
        show_config(2, go={"confirmed_by_another": True})
