"""The service is cut off in flight; the next one knows from the record what was, and goes on when ordered."""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.model.errors import RefusedError
from gcs.model.interrupted_flight import Offer
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Formation
from gcs.model.state import Mode
from gcs.service import CALLER, CommandRecord, Outcome, ShowAction, VehicleAction
from gcs.service.alarms import AlarmCause
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import JUMP_M_S, VirtualShow, alarm_texts, refused
from tests.support.sessions import ALL, after_interruption, fly_for_a_while, found, four, sessions
from tests.support.written_show import NAME, TEXT, check, keep

LATE = ("d3", "d4")
AT_REST_M_S = 0.3


def test_interrupted_flight_is_reported_and_left_alone(tmp_path: Path) -> None:
    async def look(show: VirtualShow) -> None:
        await found(show)
        await show.wait(5.0)
        shown = show.view.interrupted
        assert shown is not None
        assert (shown.show, shown.offers) == (ShowPhase.RUNNING, (Offer.TAKE_OVER, Offer.BRING_HOME))
        assert [(name, one.before, one.pad_known, one.waits) for name, one in shown.vehicles.items()] == [
            (name, Phase.FORMATION, True, True) for name in ALL
        ]
        (cut_off,) = [alarm for alarm in show.view.alarms if alarm.cause is AlarmCause.INTERRUPTED]
        assert cut_off.text == "Flight interrupted: the service was cut off while the show was running."
        assert cut_off.advice == "Command take-over or bring-home."
        assert (show.view.show, show.view.setpoints_sent) == (ShowPhase.UNCONTROLLED, 0)
        assert {phase for name in ALL for phase in show.track.phases(name)} <= {Phase.OFFLINE, Phase.PILOT}

    after_interruption(tmp_path, (four(), look), (four(), look), (four(), look))


@pytest.mark.soak
def test_excluded_vehicle_stays_out_until_included(tmp_path: Path) -> None:
    why = "Vehicle d2 not flying: taken out of the show by anna: a cracked propeller."

    async def take_out(show: VirtualShow) -> None:
        await show.standby()
        CALLER.set("anna")
        for name, reason in (("d1", "a guess"), ("d2", "unclear"), ("d2", "a cracked propeller")):
            show.service.preflight.exclude(name, reason)
        show.service.preflight.include("d1")
        await show.wait(0.2)

    async def take_in(show: VirtualShow) -> None:
        await show.standby()
        assert why in alarm_texts(show)
        assert not any("d1" in text for text in alarm_texts(show))
        by_name = lambda: show.service.commands.command_show(ShowAction.START, ["d1", "d2"])  # noqa: E731
        assert "include it first" in (await refused(show, by_name)).text
        show.service.preflight.include("d2")
        await show.wait(0.2)

    async def all_fly(show: VirtualShow) -> None:
        await show.standby()
        assert not any("d2" in text for text in alarm_texts(show))

    sessions(tmp_path, (four(), take_out), (four(), take_in), (four(), all_fly))


def test_recovered_fleet_stands_and_resumes_on_command(tmp_path: Path) -> None:
    async def go_on(show: VirtualShow) -> None:
        await found(show)
        record = await show.settled(show.service.recovery.settle(Offer.TAKE_OVER))
        assert {part.outcome for part in record.outcomes.values()} == {Outcome.DONE}
        assert show.view.show is ShowPhase.PAUSED
        assert {seen.phase for seen in vehicles_of(show.view)} == {Phase.FORMATION}
        assert show.view.plan.formation == Formation(radius_m=7.0, height_m=15.0)
        assert [box.id for box in show.view.plan.obstacles] == ["box"]
        await show.until(lambda: show.view.interrupted is None)
        first_m_s = [show.ports.sent[name][0].velocity_ned_m_s for name in ALL]
        assert np.linalg.norm(first_m_s, axis=1).max() < AT_REST_M_S
        await show.show(ShowAction.RESUME)
        await show.reach(ShowPhase.RUNNING)
        assert show.track.hardest_change_m_s() < JUMP_M_S
        turned_down = await refused(show, lambda: show.service.recovery.settle(Offer.BRING_HOME))
        assert turned_down.kind is RefusedError
        assert show.floor_violations() == 0

    after_interruption(tmp_path, (four(), go_on))


@pytest.mark.soak
def test_recovered_fleet_returns_to_its_pads_after_two_restarts(tmp_path: Path) -> None:
    pads_m = []

    async def fly_first(show: VirtualShow) -> None:
        await show.standby()
        pads_m.append(show.true_m.copy())
        await fly_for_a_while(show)

    async def only_look(show: VirtualShow) -> None:
        await show.wait(0.5)

    async def home(show: VirtualShow) -> None:
        await found(show)
        await show.settled(show.service.recovery.settle(Offer.BRING_HOME), 120.0)
        await show.reach(ShowPhase.LANDED)
        assert np.linalg.norm((show.true_m - pads_m[0])[:, :2], axis=1).max() < 1.0
        assert show.floor_violations() == 0
        assert show.view.interrupted is None

    async def nothing_left(show: VirtualShow) -> None:
        await show.standby()
        assert show.view.interrupted is None
        assert alarm_texts(show) == []

    parts = [(four(), fly_first), (four(), only_look), (four(), home), (four(), nothing_left)]
    sessions(tmp_path, *parts)


@pytest.mark.soak
def test_written_show_resumes_where_it_was_and_as_checked(tmp_path: Path) -> None:
    shows, root = tmp_path / "shows", tmp_path / "runs"
    shows.mkdir()

    async def into_the_walk(show: VirtualShow) -> None:
        show_hash = check(show)
        show.service.player.select(NAME, show_hash)
        await show.standby()
        show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.until(lambda: show.view.selected is not None and show.view.selected.clock_s > 12.0)
        keep(show, TEXT.replace("#00ff00", "#00fe00"))

    async def changed(show: VirtualShow) -> None:
        await found(show)
        shown = show.view.interrupted
        assert shown is not None
        assert shown.written is not None
        assert (shown.written.name, shown.written.cue) == (NAME, "walk")
        assert shown.offers == (Offer.BRING_HOME,)
        assert any("has changed since it was flown" in problem for problem in shown.problems)
        keep(show)

    async def flies_on(show: VirtualShow) -> None:
        await found(show)
        await show.settled(show.service.recovery.settle(Offer.TAKE_OVER))
        selected = show.view.selected
        assert selected is not None
        assert (selected.cue, selected.runs) == ("walk", False)
        assert 11.0 < selected.clock_s <= 12.2
        await show.show(ShowAction.RESUME)
        await show.until(lambda: show.view.selected is not None and show.view.selected.runs)
        assert None not in [show.vehicle(name).colour for name in ALL]
        await show.until(lambda: show.view.selected is not None and show.view.selected.cue == "turn")

    configs = four(shows={"folder": str(shows)})
    sessions(root, (configs, into_the_walk), (configs, changed), (configs, flies_on))


@pytest.mark.soak
def test_a_time_to_begin_that_a_restart_forgets_is_reported_once(tmp_path: Path) -> None:
    shows, root = tmp_path / "shows", tmp_path / "runs"
    shows.mkdir()
    given: list[str] = []

    def forgotten(show: VirtualShow) -> list[str]:
        return [event.text for event in show.service.events.newest() if "does not begin" in event.text]

    async def waits(show: VirtualShow) -> None:
        show.service.player.select(NAME, check(show))
        at_s = show.unix() + 600.0
        show.service.player.begin_at(at_s)
        given.append(f"{datetime.fromtimestamp(at_s, UTC):%Y-%m-%d %H:%M:%S} UTC")
        await show.wait(0.5)

    async def look(show: VirtualShow) -> list[str]:
        await show.wait(0.5)
        return forgotten(show)

    configs = four(shows={"folder": str(shows)})
    _, after, later = sessions(root, (configs, waits), (configs, look), (configs, look))
    why = "the service was restarted, give it again"
    assert after == [f"show {NAME} does not begin at {given[0]} any more: {why}"]
    assert later == []


@pytest.mark.soak
@pytest.mark.parametrize(
    ("section", "says"),
    [
        ({"show_frame": {"heading_deg": 37.0}}, "show_frame is another"),
        ({"links": [{"name": "loop", "listen": "udpin://127.0.0.1:14540", "vehicles": {"count": 3}}]}, "d4"),
    ],
)
def test_another_configuration_offers_no_wrong_recovery(
    tmp_path: Path, section: dict[str, object], says: str
) -> None:
    other = Config.model_validate(four().model_dump() | _merged(section))

    async def look(show: VirtualShow) -> None:
        await found(show)
        shown = show.view.interrupted
        assert shown is not None
        assert shown.offers == ()
        assert any(says in problem for problem in shown.problems)
        for offer in Offer:
            assert says in (await refused(show, lambda: show.service.recovery.settle(offer))).text  # noqa: B023

    after_interruption(tmp_path, (other, look))


def _merged(section: dict[str, object]) -> dict[str, object]:
    raw = four().model_dump()
    return {
        key: {**raw[key], **value} if isinstance(value, dict) else value for key, value in section.items()
    }


@pytest.mark.soak
def test_vehicle_under_pilot_control_is_left_to_the_pilot(tmp_path: Path) -> None:
    async def fly_and_lose_one(show: VirtualShow) -> None:
        await fly_for_a_while(show)
        show.befall("d2", "pilot")
        await show.phase("d2", Phase.PILOT)
        await show.wait(1.0)

    async def others_only(show: VirtualShow) -> None:
        await found(show)
        shown = show.view.interrupted
        assert shown is not None
        assert set(shown.vehicles) == {"d1", "d3", "d4"}, "the record knows that d2 is a pilot's"
        show.befall("d3", "pilot")
        await show.until(lambda: show.vehicle("d3").mode is Mode.POSITION)
        await show.wait(0.2)
        record = show.service.recovery.settle(Offer.BRING_HOME)
        assert record.outcomes["d3"].outcome is Outcome.NOT_INCLUDED
        assert "in mode position" in record.outcomes["d3"].reason
        assert record.outcomes["d2"].outcome is Outcome.NOT_INCLUDED
        others = ("d1", "d4")
        await show.until(lambda: {show.vehicle(name).reason for name in others} == {"on its way home"})
        assert [show.vehicle(name).phase for name in ("d2", "d3")] == [Phase.PILOT] * 2
        assert not show.ports.sent["d2"]

    sessions(tmp_path, (four(), fly_and_lose_one), (four(), others_only))


@pytest.mark.soak
def test_vehicle_under_taken_control_returns_to_its_start(tmp_path: Path) -> None:
    async def one_by_one(show: VirtualShow) -> None:
        await found(show)
        await show.command("d1", VehicleAction.TAKE_CONTROL)
        record = await show.command("d1", VehicleAction.RETURN)
        assert record.outcomes["d1"].outcome is Outcome.DONE

    after_interruption(tmp_path, (four(), one_by_one))


async def received_first(show: VirtualShow) -> None:
    """Of LATE nothing arrives yet."""
    await show.until(lambda: [show.vehicle(name).phase for name in ("d1", "d2")] == [Phase.PILOT] * 2)


COMMANDS: dict[str, Callable[[VirtualShow], CommandRecord]] = {
    "take-over": lambda show: show.service.recovery.settle(Offer.TAKE_OVER),
    "bring-home": lambda show: show.service.recovery.settle(Offer.BRING_HOME),
    "stop": lambda show: show.service.commands.command_show(ShowAction.STOP),
    "abort": lambda show: show.service.commands.command_show(ShowAction.ABORT),
    "pause": lambda show: show.service.commands.command_show(ShowAction.PAUSE),
}


FLOWN_THEN = {
    "take-over": Phase.FORMATION,
    "bring-home": Phase.RETURN,
    "stop": Phase.RETURN,
    "abort": Phase.LANDING,
    "pause": Phase.HOLD,
}


@pytest.mark.soak
@pytest.mark.parametrize("command", COMMANDS)
def test_fleet_command_includes_vehicles_received_later(tmp_path: Path, command: str) -> None:
    async def go_on(show: VirtualShow) -> None:
        await received_first(show)
        show.befall("d4", "pilot")
        record = COMMANDS[command](show)
        await show.wait(1.0)
        show.ports.restore(*LATE)
        flown = FLOWN_THEN[command]
        await show.until(lambda: {show.vehicle(name).phase for name in ("d1", "d2", "d3")} == {flown})
        if command in {"take-over", "pause"}:  # the others end on the ground
            record = await show.settled(record)
        outcomes = show.service.command_log.get(record.id).outcomes
        reported = {name: (part.outcome, part.reason) for name, part in outcomes.items()}
        expected = Outcome.PENDING if flown in {Phase.RETURN, Phase.LANDING} else Outcome.DONE
        assert [reported[name][0] for name in ("d1", "d2", "d3")] == [expected] * 3, reported
        assert reported["d4"][0] is Outcome.NOT_INCLUDED
        assert "take-control" in reported["d4"][1]
        assert show.vehicle("d4").phase is Phase.PILOT
        assert not show.ports.sent["d4"]
        assert show.floor_violations() == 0

    after_interruption(tmp_path, (four(), go_on), late=LATE)


@pytest.mark.soak
def test_late_vehicles_are_named_and_newer_changes_stay(
    tmp_path: Path,
) -> None:
    """A vehicle that is not received in time is named; a later command keeps newer changes."""
    changed = Formation(radius_m=8.0, height_m=16.0)

    async def go_on(show: VirtualShow) -> None:
        await received_first(show)
        record = await show.settled(show.service.recovery.settle(Offer.TAKE_OVER))
        for name in LATE:
            assert record.outcomes[name].outcome is Outcome.FAILED
            assert record.outcomes[name].reason == "not received within 3 s of the command"
        await show.show(ShowAction.RESUME)
        show.service.plan.set_formation(changed)
        show.ports.restore(*LATE)
        await show.until(lambda: [show.vehicle(name).phase for name in LATE] == [Phase.PILOT] * 2)
        record = await show.settled(show.service.recovery.settle(Offer.TAKE_OVER))
        assert [record.outcomes[name].outcome for name in LATE] == [Outcome.DONE] * 2
        assert show.view.plan.formation == changed

    after_interruption(tmp_path, (four(), go_on), late=LATE)


@pytest.mark.soak
def test_a_later_command_replaces_one_that_still_awaits_vehicles(tmp_path: Path) -> None:
    async def go_on(show: VirtualShow) -> None:
        await received_first(show)
        take_over = show.service.recovery.settle(Offer.TAKE_OVER)
        await show.wait(0.5)
        stopped = show.service.commands.command_show(ShowAction.STOP)
        await show.wait(0.5)
        show.ports.restore(*LATE)
        record = await show.settled(stopped, 150.0)
        assert {part.outcome for part in record.outcomes.values()} == {Outcome.DONE}
        assert show.service.command_log.get(take_over.id).outcome is Outcome.FAILED
        await show.reach(ShowPhase.LANDED)
        assert show.floor_violations() == 0

    after_interruption(tmp_path, (four(), go_on), late=LATE)
