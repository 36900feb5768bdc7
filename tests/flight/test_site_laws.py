"""A law of another package at several stations: local and led, and one that fails at one of them."""

from pathlib import Path

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.formation.laws import registry
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array
from gcs.service import ShowAction
from gcs.service.alarms import AlarmCause
from gcs.simulation import Scenario
from gcs.simulation import fly as simulate
from gcs.site.simulated import SimulatedStations
from gcs.testing.virtual_site import SiteShow, fly_on_pads, fly_site, site_config
from tests.support.hostile_laws import WELL_TICKS

pytestmark = pytest.mark.soak

SUPPORT = Path(__file__).parents[1] / "support"
BUS = {"delay_s": 0.02, "spread_s": 0.01, "loss": 0.01}
WELL_S, LOOKS_S = 8.0, 0.2
EACH, TICK_S, HOLDS_WITHIN_S, STANDS_M_S, STOPS_S, HELD_M = 3, 0.05, 0.5, 0.4, 1.5, 0.5


@pytest.fixture(autouse=True)
def _beside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_beside", [])
    registry.allow_code(SUPPORT)


def site(law: str, **settings: object) -> Config:
    """Two stations with three vehicles each."""
    control = {"law": {"laws": {law: settings}}} if settings else {}
    return site_config(2, EACH, formation={"radius_m": 12.0, "height_m": 16.0, "law": law}, control=control)


def off_ring_m(place_m: Array, center_m: Array) -> Array:
    """(n,) distances of vehicles at (n, 3) from n places on the ring of 12 m, each taken by one."""
    offset_m = place_m - center_m
    angle_rad = 2.0 * np.pi * np.arange(len(offset_m)) / len(offset_m)
    there_m = 12.0 * np.column_stack([np.cos(angle_rad), np.sin(angle_rad), np.zeros_like(angle_rad)])
    away_m = np.linalg.norm(offset_m[:, None] - there_m[None], axis=2)
    assert sorted(away_m.argmin(axis=1)) == list(range(len(offset_m)))
    nearest_m: Array = away_m.min(axis=1)
    return nearest_m


@pytest.mark.keeps("RingByRow")
@pytest.mark.parametrize("law", ["RingById", "RingByRow"])
def test_stations_fly_a_law_of_another_package(law: str) -> None:
    async def story(show: SiteShow) -> None:
        await show.start()
        center_m = show["south"].view.center_m
        assert center_m is not None
        assert off_ring_m(show.true_m, np.array(center_m)).max() < 1.0
        show["south"].service.commands.command_show(ShowAction.PAUSE)
        await show.reach(ShowPhase.PAUSED)
        show["south"].service.commands.command_show(ShowAction.RESUME)
        await show.reach(ShowPhase.RUNNING)
        record = show["north"].service.commands.command_show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED, limit_s=120.0)
        await show.settled("north", record)
        assert not show.armed.any()
        assert show.violations == 0
        assert not [one for each in show.stations.values() for one in each.view.alarms if of_law(one.cause)]

    fly_site(story, site(f"ring_laws:{law}"), **BUS)


def of_law(cause: AlarmCause) -> bool:
    return cause is AlarmCause.LAW_FAILED


HOSTILE = {
    ("Fails", "south"): "ZeroDivisionError: no vehicle is left",
    ("SleepsASecond", "south"): "it took longer than 10 ms in 5 ticks",
    ("LedFails", "north"): "ZeroDivisionError: no vehicle is left",
    ("LedSleepsASecond", "north"): "it took longer than 10 ms in 5 ticks",
}
"""By the law, and the station at which it is hostile: north leads."""


@pytest.mark.keeps("Fails-south")
@pytest.mark.parametrize(("law", "station"), list(HOSTILE))
def test_all_hold_when_a_law_fails_at_one_station(law: str, station: str) -> None:
    name = f"hostile_laws:{law}"

    async def story(show: SiteShow) -> None:
        await show.until(lambda: all(all(each.view.rows.ready) for each in show.stations.values()), 20.0)
        await show.wait(3.0)
        show["south"].service.commands.command_show(ShowAction.START)
        while not any(show.in_phase(each, Phase.FORMATION) for each in show.stations):
            await show.wait(TICK_S)
        await show.wait(WELL_S - LOOKS_S)
        flying = {ShowPhase.ASSEMBLING, ShowPhase.RUNNING}
        assert all(each.view.show in flying for each in show.stations.values())
        await show.wait(LOOKS_S + HOLDS_WITHIN_S)
        assert all(each.view.show is ShowPhase.PAUSED for each in show.stations.values())
        alarms = {each.cause: each for each in show[station].view.alarms}
        assert alarms[AlarmCause.LAW_FAILED].text.startswith(f"Law {name} failed: {HOSTILE[law, station]}")
        for each in show.stations.values():
            assert each.view.reason.startswith(f"law {name} failed: {HOSTILE[law, station]}"), each.name
        await show.wait(STOPS_S)
        fastest_m_s, farthest_m = await moved(show, 10.0)
        assert fastest_m_s < STANDS_M_S
        assert farthest_m < HELD_M
        show["south"].service.commands.command_show(ShowAction.RESUME)
        await show.wait(1.0)
        assert show[station].view.show is ShowPhase.PAUSED
        show["south"].service.commands.command_show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED, limit_s=120.0)
        assert not show.armed.any()
        assert show.violations == 0

    hostile = site(name, well_ticks=round(WELL_S / TICK_S), where=station[0])
    fly_on_pads(story, hostile, {"ideal": True}, **BUS)


async def moved(show: SiteShow, seconds: float) -> tuple[float, float]:
    """How fast a vehicle flew for half a second, and how far one went from where it was."""
    track_m = []
    for _ in range(round(seconds / TICK_S)):
        track_m.append(show.true_m)
        await show.wait(TICK_S)
    place_m, step = np.array(track_m), round(0.5 / TICK_S)
    fastest_m_s = np.linalg.norm(place_m[step:] - place_m[:-step], axis=2).max() / 0.5
    farthest_m = np.linalg.norm(place_m - place_m[0], axis=2).max()
    return float(fastest_m_s), float(farthest_m)


def test_a_law_that_cannot_begin_keeps_all_on_the_ground() -> None:
    name = "hostile_laws:Fails"

    async def story(show: SiteShow) -> None:
        await show.until(lambda: all(all(each.view.rows.ready) for each in show.stations.values()), 20.0)
        await show.wait(3.0)
        with pytest.raises(RefusedError, match="law"):
            show["north"].service.commands.command_show(ShowAction.START)

    fly_site(story, site(name, well_ticks=0), **BUS)


@pytest.mark.keeps("ring_laws:RingByRow")
@pytest.mark.parametrize("law", ["ring_laws:RingById", "ring_laws:RingByRow"])
def test_simulated_stations_fly_a_law_of_another_package(law: str) -> None:
    flight = simulate(two_stations(law), 6, 3, divide=SimulatedStations)
    assert flight.metrics.law_failed is None
    assert flight.metrics.goal_shape == "ring"
    assert off_ring_m(flight.position_m[-1], flight.centre_m[-1]).max() < 1.0
    assert flight.metrics.separation.violations == 0


def test_a_simulated_station_whose_law_fails_is_named() -> None:
    flight = simulate(two_stations("hostile_laws:Fails"), 6, 3, divide=SimulatedStations)
    failed = flight.metrics.law_failed
    assert failed is not None
    assert failed.why.startswith("station s1: ZeroDivisionError: no vehicle is left")
    assert WELL_TICKS * TICK_S - TICK_S <= failed.time_s <= WELL_TICKS * TICK_S + HOLDS_WITHIN_S
    assert flight.metrics.separation.violations == 0


def two_stations(law: str) -> Scenario:
    scenario = Scenario.load("assembly").with_(law=law, duration_s=40.0, radius_m=12.0)
    divided = scenario.divided.model_copy(update={"count": 2, "delay_s": 0.02, "loss": 0.01})
    return scenario.model_copy(update={"divided": divided})
