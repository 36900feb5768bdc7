"""A start by two tokens with several stations: the lead decides, the others refuse in words."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from gcs.config.schema import Config
from gcs.model.errors import GcsError, RefusedError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.recording.session import Record
from gcs.service import CommandRecord, GoView, Outcome, ShowAction, WeatherEntry
from gcs.site.member import SiteMember
from gcs.site.requests import REQUEST, ShowRequest
from gcs.testing.virtual_site import SiteShow, fly_site, site_config
from tests.flight.test_site_start import asked_until_s
from tests.support.tokens_flown import by_two, token

pytestmark = pytest.mark.soak

BUS = {"delay_s": 0.02, "spread_s": 0.01}


def go_of(show: SiteShow, station: str) -> GoView:
    view = show[station].view.features.go
    assert view is not None
    return view


async def proposed(show: SiteShow) -> tuple[CommandRecord, str]:
    """A start that alice has proposed at the lead, and its hash."""
    with token("alice"):
        record, reasons = await asked_until_s(show, 15.0)
    assert record is not None, reasons
    await show.wait(0.2)
    proposal = go_of(show, "north").proposal
    assert proposal is not None
    return record, proposal.hash


def refusal(show: SiteShow, station: str, what: str, go_hash: str = "0" * 12) -> str:
    service = show[station].service
    calls: dict[str, Callable[[], object]] = {
        "start": lambda: service.commands.command_show(ShowAction.START),
        "confirm": lambda: service.commands.confirm_start(go_hash),
        "weather": lambda: service.go.enter_weather(WeatherEntry(wind_m_s=1.0)),
        "sign": lambda: service.go.sign("pads", [1]),
    }
    with token("bob"), pytest.raises(GcsError) as refused:
        calls[what]()
    assert refused.type is RefusedError
    return str(refused.value)


def test_the_lead_starts_all_stations_once_confirmed() -> None:
    async def story(show: SiteShow) -> None:
        record, shown = await proposed(show)
        await show.wait(5.0)
        assert not show.armed.any()
        for what in ("start", "confirm", "weather", "sign"):
            text = refusal(show, "south", what, shown)
            assert text.endswith("here: station north leads, and decides on a start; do it there")
        with token("alice"), pytest.raises(RefusedError, match="another token confirms it"):
            show["north"].service.commands.confirm_start(shown)
        with token("bob"):
            started = show["north"].service.commands.confirm_start(shown)
        assert started.id == record.id
        await show.reach(ShowPhase.RUNNING)
        assert [show.in_phase(name, Phase.FORMATION) for name in show.stations] == [2, 2]
        done = show["north"].service.command_log.get(record.id)
        assert len(done.outcomes) == 4
        assert done.outcome is Outcome.DONE

    fly_site(story, site_config(2, 2, **by_two()), **BUS)


@pytest.mark.soak
def test_a_stop_at_any_station_calls_the_proposal_off() -> None:
    async def story(show: SiteShow) -> None:
        record, shown = await proposed(show)
        with token("guard"):
            show["south"].service.commands.command_show(ShowAction.STOP)
        await show.wait(1.0)
        assert "called off by guard" in refusal(show, "north", "confirm", shown)
        assert show["north"].service.command_log.get(record.id).outcome is Outcome.FAILED
        at_s = show["north"].unix() + 60.0
        with token("alice"), pytest.raises(RefusedError, match="made at once: give the show a time to begin"):
            show["north"].service.commands.command_show(ShowAction.START, at_unix_time_s=at_s)
        assert not show.armed.any()

    fly_site(story, site_config(2, 2, **by_two()), **BUS)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("names", "starts"), [(("", ""), 0), (("alice", ""), 0), (("alice", "alice"), 0), (("alice", "bob"), 2)]
)
def test_a_station_starts_nothing_that_two_did_not_confirm(names: tuple[str, str], starts: int) -> None:
    """Whatever the bus carries: a request without two different names is refused."""

    async def story(show: SiteShow) -> None:
        await proposed(show)
        request = ShowRequest("o9", "alice", ShowAction.START, proposed_by=names[0], confirmed_by=names[1])
        member = show["north"].service.local.flight.elsewhere
        assert isinstance(member, SiteMember)
        agreed = member.as_agreed("south", request)
        member.post("south", REQUEST.dump_python(agreed, mode="json"))
        await show.wait(8.0)
        assert show.armed.sum() == starts

    fly_site(story, site_config(2, 2, **by_two()), **BUS)


@pytest.mark.soak
def test_an_approved_start_ends_what_waits_elsewhere() -> None:
    """A station that led before starts as another asks; its own proposal is over, and that command failed."""

    async def story(show: SiteShow) -> None:
        record, _ = await proposed(show)
        request = ShowRequest("o9", "carol", ShowAction.START, proposed_by="carol", confirmed_by="bob")
        member = show["south"].service.local.flight.elsewhere
        assert isinstance(member, SiteMember)
        agreed = member.as_agreed("north", request)
        member.post("north", REQUEST.dump_python(agreed, mode="json"))
        await show.wait(8.0)
        assert (go_of(show, "north").proposal, go_of(show, "north").ended) == (None, "another start was made")
        own = show["north"].service.command_log.get(record.id)
        assert {part.reason for part in own.outcomes.values()} == {"not confirmed: another start was made"}
        assert show.armed.sum() == 2

    fly_site(story, site_config(2, 2, **by_two()), **BUS)


def other(config: Config, what: str) -> Config:
    """The configuration of a station whose files are not those of the others."""
    safety = config.control.safety
    lower = safety.model_copy(update={"fence": safety.fence.model_copy(update={"height_max_m": 60.0})})
    changed: dict[str, dict[str, object]] = {
        "go.confirmed_by_another": {"go": None},
        "control.safety.fence": {"control": config.control.model_copy(update={"safety": lower})},
    }
    return config.model_copy(update=changed[what])


@pytest.mark.soak
@pytest.mark.parametrize(
    ("what", "asked"), [("go.confirmed_by_another", ("north", "south")), ("control.safety.fence", ("north",))]
)
def test_stations_with_other_rules_start_nothing(what: str, asked: tuple[str, ...], tmp_path: Path) -> None:
    """Neither at the lead nor at a follower that needs one token only."""

    async def story(show: SiteShow) -> None:
        south = show["south"]
        await south.kill()
        south.config = other(south.config, what)
        rows = {name: (number, "loop") for number, name in enumerate(south.config.ids, 1)}
        with Record(tmp_path, south.config.model_dump_json(), rows, flight=False) as record:
            south.restart(record)
            await show.wait(12.0)
            for station in asked:
                differs = f"differs from this station in {what}: give both the same configuration"
                assert differs in refusal(show, station, "start")
            await show.wait(8.0)
            assert not show.armed.any()

    fly_site(story, site_config(2, 2, **by_two()), **BUS)


async def restarted(show: SiteShow, station: str, what: str, folder: Path) -> None:
    """Start a station again, with other rules if `what` names some, until the others receive it again."""
    south = show[station]
    await south.kill()
    south.config = other(south.config, what) if what else south.config
    rows = {name: (number, "loop") for number, name in enumerate(south.config.ids, 1)}
    with Record(folder, south.config.model_dump_json(), rows, flight=False) as record:
        south.restart(record)
        await show.wait(12.0)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("what", "differs"),
    [
        ("control.safety.fence", "it differs from this station in control.safety.fence: give both the same"),
        ("", "its countdown is over: it was started again, or refused"),
    ],
)
def test_a_station_that_starts_again_ends_the_countdown(what: str, differs: str, tmp_path: Path) -> None:
    """With another fence, or as it was: what it counted down to is gone, and so is the whole start."""
    differs = f"station south: {differs}"

    async def story(show: SiteShow) -> None:
        north = show["north"]
        at_s = north.unix() + 40.0
        record, reasons = await asked_until_s(show, 15.0, at_unix_time_s=at_s)
        assert record is not None, reasons
        await show.wait(2.0)
        phases = [show[name].view.show for name in show.stations]
        assert phases == [ShowPhase.COUNTDOWN, ShowPhase.COUNTDOWN]
        await restarted(show, "south", what, tmp_path)
        assert differs in north.view.start_refused
        assert differs in north.view.reason
        await show.wait(at_s - north.unix() + 2.0)
        assert differs in north.view.reason
        assert north.view.reason.startswith("did not start: a start needs every station: ")
        assert not show.armed.any()
        own = north.service.command_log.get(record.id).outcomes["n1"]
        assert (own.outcome, differs in own.reason) == (Outcome.FAILED, True)

    fly_site(story, site_config(2, 2), **BUS)


@pytest.mark.soak
def test_other_rules_between_proposal_and_confirmation(tmp_path: Path) -> None:
    async def story(show: SiteShow) -> None:
        _, shown = await proposed(show)
        await restarted(show, "south", "control.safety.fence", tmp_path)
        assert "changed since alice proposed it" in refusal(show, "north", "confirm", shown)
        differs = "differs from this station in control.safety.fence: give both the same configuration"
        assert differs in refusal(show, "north", "start")
        await show.wait(8.0)
        assert not show.armed.any()

    fly_site(story, site_config(2, 2, **by_two()), **BUS)


async def answered(show: SiteShow, request: ShowRequest) -> str:
    """What south answers to a start that north asks for as the bus carries it; empty: it starts."""
    member = show["north"].service.local.flight.elsewhere
    assert isinstance(member, SiteMember)
    member.post("south", REQUEST.dump_python(request, mode="json"))
    for _ in range(100):
        await show.wait(0.05)
        for _, body in member.received:
            if body["kind"] == "outcomes" and body["ref"] == request.ref:
                return str(body["refused"])
    return ""


@pytest.mark.soak
def test_a_station_compares_the_rules_of_who_asks_for_a_start() -> None:
    """At the moment of the start, whatever was compared before: a request carries them."""

    async def story(show: SiteShow) -> None:
        await proposed(show)
        member = show["north"].service.local.flight.elsewhere
        assert isinstance(member, SiteMember)
        bare = ShowRequest("o9", "alice", ShowAction.START, proposed_by="alice", confirmed_by="bob")
        agreed = member.as_agreed("south", bare)
        assert agreed.rules is not None
        other_site = replace(agreed, rules={**agreed.rules, "site": "another"})
        assert "does not say by which site and rules" in await answered(show, bare)
        assert "differs from this station in site: " in await answered(show, other_site)
        changed = await answered(show, replace(agreed, parameters="0" * 64))
        assert changed.startswith("the parameters of station south changed since the start was confirmed")
        assert not show.armed.any()
        assert await answered(show, agreed) == ""
        await show.wait(8.0)
        assert show.armed.sum() == 2

    fly_site(story, site_config(2, 2, **by_two()), **BUS)


@pytest.mark.soak
def test_no_station_shows_a_start_as_possible_that_is_not() -> None:
    """A follower names the station where it is proposed, and the lead the one that is missing."""

    async def story(show: SiteShow) -> None:
        north, south = show["north"], show["south"]
        await proposed(show)
        await show.wait(3.0)
        assert north.view.start_refused == ""
        assert north.service.preflight.report().passes
        at_lead = "a start is proposed at the station that leads, north"
        assert (south.view.start_refused, south.service.preflight.report().in_short) == (at_lead, at_lead)
        await south.kill()
        await show.wait(3.0)
        missing = "a start needs every station: station south is not received"
        report = north.service.preflight.report()
        assert north.view.start_refused == missing
        assert (report.passes, report.in_short) == (False, missing)
        (check,) = (each for each in report.fleet if each.name == "stations")
        assert check.problem == missing
        assert "station south is not received" in refusal(show, "north", "start")

    fly_site(story, site_config(2, 2, **by_two()), **BUS)


@pytest.mark.soak
def test_a_follower_does_not_ask_for_what_the_lead_has() -> None:
    """Its own empty list keeps no vehicle on the ground, and what it shows is the lead's reason."""

    async def story(show: SiteShow) -> None:
        north, south = show["north"], show["south"]
        await asked_until_s(show, 12.0)
        no_weather = "wind: not known"
        assert any(no_weather in text for text in go_of(show, "north").missing)
        assert (go_of(show, "south").missing, go_of(show, "south").decides) == ((), False)
        assert no_weather in south.view.start_refused
        with token("alice"):
            north.service.go.enter_weather(WeatherEntry(wind_m_s=1.0))
        await show.wait(6.0)
        assert go_of(show, "north").missing == ()
        assert south.view.start_refused == ""
        assert ("checklists and weather count where the show is led, not here",) in (
            *go_of(show, "south").table(),
        )

    go = {"weather": {"wind_max_m_s": 8.0}}
    fly_site(story, site_config(2, 2, go=go), **BUS)


@pytest.mark.soak
def test_parameters_at_another_station_are_confirmed_too() -> None:
    async def story(show: SiteShow) -> None:
        _, shown = await proposed(show)
        south = show["south"].service.local.flight
        name, values = next(iter(south.parameters.items()))
        south.parameters[name] = {**values, "MPC_XY_CRUISE": 3.0}
        await show.wait(2.0)
        text = refusal(show, "north", "confirm", shown)
        assert "parameters elsewhere changed since alice proposed it" in text

    fly_site(story, site_config(2, 2, **by_two()), **BUS)
