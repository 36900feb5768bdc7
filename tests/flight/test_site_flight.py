"""A formation of several stations: the whole story in virtual time, over a late bus that loses messages."""

import functools

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.flight.features.traffic import OtherTraffic
from gcs.formation.repulsion import energy
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Formation, Orbit
from gcs.model.target_fix import TargetFix
from gcs.service import Outcome, ShowAction
from gcs.service.alarms import AlarmCause
from gcs.simulation.reference_shapes import best
from gcs.testing.virtual_site import SiteShow, fly_assembled, fly_site, site_config

BUS = {"delay_s": 0.02, "spread_s": 0.01, "loss": 0.01}
LARGE = site_config(4, 4)
SMALL = site_config(3, 2, formation={"radius_m": 8.0, "height_m": 14.0})
"""A low sphere as well: climbs and landings take most of a flight's time."""

SITES = pytest.mark.parametrize("site", [SMALL, pytest.param(LARGE, marks=pytest.mark.soak)])


@pytest.mark.soak
@SITES
def test_stations_fly_one_formation_and_bring_it_home(site: Config) -> None:
    count = len(site.ids)

    async def story(show: SiteShow) -> None:
        with pytest.raises(RefusedError, match="a start needs every station: station south"):
            show["north"].service.commands.command_show(ShowAction.START)  # nothing has arrived yet
        record = await show.start()
        assert len(record.outcomes) == count
        await show.wait(12.0)
        plan = show["south"].view.plan
        await show.wait(3.0)
        south = show["south"].view
        assert south.plan == plan  # it came six times more, at other delays
        assert south.center_m is not None
        offset_m = show.true_m - south.center_m
        direction = offset_m / np.linalg.norm(offset_m, axis=1, keepdims=True)
        assert energy(direction) / energy(best(count)) <= 1.002
        record = show["west"].service.commands.command_show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED, limit_s=150.0)
        record = await show.settled("west", record)
        assert {one.outcome for one in record.outcomes.values()} == {Outcome.DONE}
        assert len(record.outcomes) == count
        assert not show.armed.any()
        assert show.violations == 0

    fly_site(story, site, **BUS)


def settled_again(show: SiteShow, names: list[str]) -> bool:
    """Whether the rest is on the sphere again, and goes on."""
    return all(show[name].view.show is ShowPhase.RUNNING for name in names)


@pytest.mark.parametrize(
    ("site", "victim", "after_s"),
    [
        (SMALL, "north", 3.0),
        pytest.param(LARGE, "north", 3.0, marks=pytest.mark.soak),
        pytest.param(LARGE, "south", 7.3, marks=pytest.mark.soak),
        pytest.param(LARGE, "east", 0.4, marks=pytest.mark.soak),
    ],
)
def test_killed_station_ends_no_show(site: Config, victim: str, after_s: float) -> None:
    async def story(show: SiteShow) -> None:
        show["north"].service.plan.set_orbit(Orbit(10.0, 2.0))
        await show.wait(after_s)
        await show[victim].kill()
        rest = [name for name in show.stations if name != victim]
        await show.wait(1.0)
        assert all(show[name].view.show is ShowPhase.PAUSED for name in rest)
        alarms = {alarm.cause: alarm.text for alarm in show[rest[0]].view.alarms}
        assert f"Station {victim} not received" in alarms[AlarmCause.STATION_LOST]
        asked = show[rest[-1]].service
        if victim == "north":
            with pytest.raises(RefusedError, match="gcs lead take"):
                asked.plan.set_orbit(Orbit(5.0, 1.0))
            assert asked.stations is not None
            asked.stations.take_lead()
        took_s = await show.until(lambda: settled_again(show, rest), 20.0)
        assert took_s <= 4.0, "a process that has ended is not waited for as a cut bus is"
        asked.plan.set_orbit(Orbit(5.0, 1.0))
        await show.wait(1.0)
        assert {show[name].view.plan.orbit.radius_m for name in rest} == {5.0}
        record = asked.commands.command_show(ShowAction.STOP)
        await show.reach(ShowPhase.RETURNING, *rest, limit_s=5.0)
        outcomes = {name[0]: one.outcome for name, one in record.outcomes.items()}
        assert {outcomes.pop(victim[0]), *outcomes.values()} == {Outcome.FAILED, Outcome.PENDING}
        landed = functools.partial(show.in_phase, phase=Phase.STANDBY)
        await show.until(lambda: min(map(landed, rest)) == len(site.ids) // len(site.stations), 120.0)
        assert show.violations == 0

    fly_assembled(story, site, **BUS)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("victim", "after_s", "closed"),
    [
        ("south", 0.5, True),
        pytest.param("south", 2.0, True, marks=pytest.mark.soak),
        pytest.param("north", 4.0, False, marks=pytest.mark.soak),  # the lead; its paths may close no pad
    ],
)
def test_pads_closed_on_the_way_home_are_left_for_open_places(
    victim: str, after_s: float, closed: bool
) -> None:
    """Killed on the way home, a station closed pads of another: vehicles hovered beside its space."""

    async def story(show: SiteShow) -> None:
        pads_m = show.true_m
        await show.start()
        show["north"].service.commands.command_show(ShowAction.STOP)
        await show.until(lambda: "on its way home" in show["south"].view.rows.reasons)
        await show.wait(after_s)
        await show[victim].kill()
        rest = "north" if victim == "south" else "south"
        await show.until(lambda: show.in_phase(rest, Phase.STANDBY) == 4, 60.0)
        landed = slice(0, 4) if rest == "north" else slice(4, 8)
        off_m = np.linalg.norm((show.true_m - pads_m)[landed, :2], axis=1)
        assert off_m.max() < 12.0
        assert off_m.max() > 1.0 or not closed
        assert show.violations == 0

    fly_site(story, site_config(2, 4, formation={"radius_m": 8.0, "height_m": 16.0}), **BUS)


@SITES
def test_cut_bus_holds_both_halves_until_it_heals(site: Config) -> None:
    async def story(show: SiteShow) -> None:
        show["south"].service.plan.set_orbit(Orbit(10.0, 2.0))
        await show.wait(6.0)
        show.network.cut({"north", "south"}, {"west", "east"} & set(show.stations))
        await show.wait(3.0)
        assert {each.view.show for each in show.stations.values()} == {ShowPhase.PAUSED}
        await show.wait(2.0)
        show.network.cut()
        await show.until(lambda: settled_again(show, list(show.stations)), 20.0)
        await show.wait(10.0)
        assert sum(show.in_phase(name, Phase.FORMATION) for name in show.stations) == len(show.config.ids)
        assert show.violations == 0

    fly_assembled(story, site, **BUS)


@pytest.mark.soak
def test_all_hold_for_each_of_two_stations_that_are_cut_off() -> None:
    """The second is cut off while all hold for the first: its bus may heal as well."""

    async def story(show: SiteShow) -> None:
        show.network.cut({"north", "west", "east"}, {"south"})
        await show.wait(4.0)
        show.network.cut({"north", "east"}, {"west"}, {"south"})
        await show.wait(4.0)  # 8 s after the first cut: for south alone they would go on after 6.5
        assert show["north"].view.show is ShowPhase.PAUSED
        await show.reach(ShowPhase.RUNNING, "north", "east", limit_s=20.0)
        assert show.violations == 0

    fly_assembled(story, site_config(4, 4), **BUS)


@pytest.mark.soak
def test_manned_aircraft_near_one_station_lowers_all() -> None:
    """Only one receives it: the lead lowers the formation, or it is said why it does not."""
    traffic = {"sources": [{"kind": "mavlink", "at": "udp://127.0.0.1:14999"}]}
    site = site_config(2, 2, formation={"radius_m": 8.0, "height_m": 40.0}, traffic=traffic)

    async def story(show: SiteShow) -> None:
        south = show["south"].service.local
        (traffic_there,) = [each for each in south.flight.features if isinstance(each, OtherTraffic)]
        (north_deg,), (east_deg,), (high_m,) = show.config.frame.geodetic(np.array([[150.0, 0.0, -60.0]]))
        now_s = south.flight.newest.state.time_s
        traffic_there.take(0, TargetFix(now_s, north_deg, east_deg, high_m, track="A", kind="manned"))
        await show.until(lambda: bool(show["south"].view.failsafes), 10.0)
        await show.wait(3.0)
        for station in show.stations.values():
            assert station.view.plan.formation.height_m < 20.0
        show.network.cut({"north"}, {"south"})
        await show.wait(2.0)
        assert "north is not received" in south.flight.elsewhere.hooks.lower(Formation(8.0, 15.0))

    fly_assembled(story, site, **BUS)
