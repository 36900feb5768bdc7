"""Two hosts on one radio network: the standby takes over the vehicles of a lost owner."""

import asyncio
from typing import Any

import numpy as np
import pytest

from gcs.model.errors import RefusedError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Orbit
from gcs.model.state import Array
from gcs.service import Outcome, ShowAction
from gcs.testing.virtual_site import SiteShow, fly_assembled, fly_site, two_hosts

pytestmark = pytest.mark.soak

BUS = {"delay_s": 0.01, "spread_s": 0.005, "loss": 0.01}
QUIET: dict[str, Any] = {"delay_s": 0.01, "tells_arrival": False}
"""As Zenoh is over a good network: it loses nothing, and does not tell when a message arrived."""


def setpoints_s(show: SiteShow, of: str, vehicle: str) -> Array:
    """Times of the setpoints that a station has sent to a vehicle of north."""
    ports = show["north"].radios[0][1] if of == "north" else show["south"].mirrors["north"]
    return np.array([sent.time_s for sent in ports.sent[vehicle]])


def owned(show: SiteShow) -> int:
    """Vehicles that south flies, as its view has it."""
    return list(show["south"].view.rows.stations).count("south")


def both_never_at_once(show: SiteShow, least_s: float = 0.5) -> bool:
    """Whether the setpoints of the two stations are apart in time, for every vehicle."""
    for vehicle in show["north"].config.ids:
        north_s, south_s = setpoints_s(show, "north", vehicle), setpoints_s(show, "south", vehicle)
        if len(north_s) and len(south_s):
            apart_s = np.abs(north_s[:, None] - south_s[None, :]).min()
            if apart_s < least_s:
                return False
    return True


@pytest.mark.parametrize("after_s", [2.0, pytest.param(5.7, marks=pytest.mark.soak)])
def test_show_goes_on_when_the_owner_is_killed(after_s: float) -> None:
    async def story(show: SiteShow) -> None:
        show["north"].service.plan.set_orbit(Orbit(8.0, 2.0))
        await show.wait(after_s)
        assert owned(show) == 0
        await show["north"].kill()
        took_s = await show.until(lambda: owned(show) == 4, 3.0)
        assert took_s <= 1.5
        south = show["south"].service
        await show.until(lambda: show.in_phase("south", Phase.HOLD) == 4, 4.0)
        assert south.stations is not None
        with pytest.raises(RefusedError, match="may still send setpoints"):
            south.stations.take_over("north")
        await show.wait(2.0)
        record = south.stations.take_over("north")
        await show.until(lambda: show["south"].view.show is ShowPhase.RUNNING, 15.0)
        record = await show.settled("south", record)
        assert {one.outcome for one in record.outcomes.values()} == {Outcome.DONE}
        assert show["south"].view.plan.orbit.radius_m == 8.0
        south.commands.command_show(ShowAction.STOP)
        await show.until(lambda: show.in_phase("south", Phase.STANDBY) > 0, 60.0)
        assert both_never_at_once(show)
        assert show.violations == 0

    fly_assembled(story, two_hosts(4), **BUS)


@pytest.mark.soak
def test_show_goes_on_by_itself_where_configured() -> None:
    async def story(show: SiteShow) -> None:
        await show["north"].kill()
        await show.until(
            lambda: (
                show["south"].view.show is ShowPhase.RUNNING and show.in_phase("south", Phase.FORMATION) == 4
            ),
            20.0,
        )
        assert both_never_at_once(show)
        assert show.violations == 0

    fly_assembled(story, two_hosts(4, rejoins=True), **BUS)


@pytest.mark.soak
def test_owner_that_is_cut_off_holds_and_obeys_the_standby() -> None:
    async def story(show: SiteShow) -> None:
        show.network.cut({"north"}, {"south"})
        await show.until(lambda: show.in_phase("south", Phase.HOLD) == 4, 6.0)
        await show.until(
            lambda: (
                show["south"].view.show is ShowPhase.RUNNING and show.in_phase("south", Phase.FORMATION) == 4
            ),
            20.0,
        )
        show.network.cut()
        await show.wait(5.0)
        assert show.in_phase("south", Phase.FORMATION) == 4
        assert list(show["north"].view.rows.stations).count("south") == 4
        assert both_never_at_once(show)
        assert show.violations == 0

    fly_assembled(story, two_hosts(4, rejoins=True), **BUS)


@pytest.mark.soak
def test_any_station_has_the_standby_go_on() -> None:
    async def story(show: SiteShow) -> None:
        await show.start("west")
        stations = show["west"].service.stations
        assert stations is not None
        with pytest.raises(RefusedError, match="no station stands by for west"):
            stations.take_over("west")
        early = stations.take_over("north")
        await show.wait(1.0)
        early = await show.settled("west", early)
        assert early.outcomes["n1"].reason == "station south: station north is not lost: stop it there first"
        await show["north"].kill()
        await show.until(lambda: show.in_phase("south", Phase.HOLD) == 2, 6.0)
        await show.wait(2.5)
        record = stations.take_over("north")
        assert set(record.outcomes) == {"n1", "n2"}
        record = await show.settled("west", record, 30.0)
        assert {one.outcome for one in record.outcomes.values()} == {Outcome.DONE}
        executed = [one.action for one in show["south"].service.command_log.newest()]
        assert executed[:2] == ["resume", "take-over"]
        assert show.in_phase("south", Phase.FORMATION) == 2
        assert both_never_at_once(show)
        assert show.violations == 0

    fly_site(story, two_hosts(2, west=True), **BUS)


@pytest.mark.soak
def test_owner_not_received_by_its_standby_gives_vehicles_up() -> None:
    """A cut of one direction: the standby ends the connection, as a process that ends does."""

    async def story(show: SiteShow) -> None:
        show.network.cut_one_way("north", "south")
        await show.until(lambda: show.in_phase("south", Phase.HOLD) == 4, 6.0)
        await show.until(lambda: flies_on(show, "south"), 20.0)
        assert both_never_at_once(show)
        assert show.violations == 0

    fly_assembled(story, two_hosts(4, rejoins=True), **BUS)


def flies_on(show: SiteShow, name: str) -> bool:
    """Whether all vehicles fly in formation at that station, and its show runs."""
    return show[name].view.show is ShowPhase.RUNNING and show.in_phase(name, Phase.FORMATION) == 4


@pytest.mark.soak
@pytest.mark.parametrize("cut_s", [0.0, 0.4, 1.5])
def test_owner_that_stood_still_sends_nothing_once_taken_over(cut_s: float) -> None:
    """It wakes when the standby flies its vehicles, and the bus connects the two at once or later."""

    async def story(show: SiteShow) -> None:
        show["north"].stop()
        show.network.cut({"north"}, {"south"})  # its connections are closed when their lease ends
        stopped_s = asyncio.get_running_loop().time()
        await show.until(lambda: flies_on(show, "south"), 20.0)
        show["north"].go_on()
        await show.wait(cut_s)
        show.network.cut()
        await show.wait(5.0)
        for vehicle in show["north"].config.ids:
            assert setpoints_s(show, "north", vehicle).max() <= stopped_s
            assert setpoints_s(show, "south", vehicle).max() > stopped_s + 5.0
        assert flies_on(show, "south")
        assert list(show["north"].view.rows.stations).count("south") == 4
        assert show.violations == 0

    fly_assembled(story, two_hosts(4, rejoins=True), **QUIET)


@pytest.mark.soak
def test_owner_that_stood_still_briefly_goes_on_once_answered() -> None:
    """Too briefly for its standby to take over, which it cannot know."""

    async def story(show: SiteShow) -> None:
        show["north"].stop()
        await show.wait(0.43)
        woke_s = asyncio.get_running_loop().time()
        show["north"].go_on()
        await show.wait(3.0)
        for vehicle in show["north"].config.ids:
            sent_s = setpoints_s(show, "north", vehicle)
            first_s = sent_s[sent_s > woke_s - 0.01][0]
            assert woke_s + 0.02 < first_s < woke_s + 0.2  # once the standby has answered: two ways
            assert len(setpoints_s(show, "south", vehicle)) == 0
        assert flies_on(show, "north")
        assert show.violations == 0

    fly_assembled(story, two_hosts(4, rejoins=True), **QUIET)


@pytest.mark.soak
def test_owner_without_a_standby_left_goes_on_after_a_pause() -> None:
    async def story(show: SiteShow) -> None:
        await show["south"].kill()
        await show.wait(3.0)
        assert flies_on(show, "north")
        show["north"].stop()
        await show.wait(0.6)
        woke_s = asyncio.get_running_loop().time()
        show["north"].go_on()
        await show.wait(3.0)
        for vehicle in show["north"].config.ids:
            sent_s = setpoints_s(show, "north", vehicle)
            assert sent_s[sent_s > woke_s - 0.01][0] < woke_s + 0.1
        assert flies_on(show, "north")

    fly_assembled(story, two_hosts(4, rejoins=True), **QUIET)
