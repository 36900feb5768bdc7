"""A station of four is killed at a random moment of a flight, the lead among them, again and again.

`SITE_VEHICLES` and `SITE_KILLS` in the environment change the number of vehicles and of flights.
"""

import asyncio
import os
import random
from functools import partial
from math import sqrt
from typing import Final

import pytest

from gcs.config.schema import Config
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import AIRBORNE, Phase, ShowPhase
from gcs.model.plan import Orbit
from gcs.service import ShowAction
from gcs.testing.virtual_site import NAMES, SiteShow, fly_site, site_config

VEHICLES: Final = int(os.environ.get("SITE_VEHICLES", "16"))
KILLS: Final = int(os.environ.get("SITE_KILLS", "20"))
FORMED_S: Final = 15.0
BUS: Final = {"delay_s": 0.02, "spread_s": 0.01, "loss": 0.01}


def site_of(vehicles: int) -> Config:
    """Four stations with equal shares."""
    radius_m = 3.4 * sqrt(vehicles)  # with room for the space of the lost quarter
    operation = {
        "takeoff_height_m": 5.0,
        "takeoff_stagger_s": 0.2,
        "setpoint_loss_action": "hold",
        "pads_within_m": 7.5 * sqrt(vehicles) + 10.0,  # they stand 5 m apart
    }
    safety = {"fence": {"height_max_m": 2.0 * radius_m + 50.0}}
    return site_config(
        4,
        vehicles // 4,
        formation={"radius_m": radius_m, "height_m": radius_m + 8.0},
        operation=operation,
        control={"safety": safety},
    )


def leads_or_follows(seed: int) -> str:
    """The first station leads; each third kill is of it."""
    return NAMES[0] if seed % 3 == 0 else random.Random(seed).choice(NAMES[1:])


class Operators:
    """Change the orbit once a second at one of the stations that are left, and note what is refused."""

    def __init__(self, show: SiteShow, stations: list[str], samples: random.Random) -> None:
        self.accepted = 0
        self.refused: list[str] = []
        self._show, self._stations, self._samples = show, stations, samples
        self._task = asyncio.create_task(self._work())

    async def _work(self) -> None:
        while True:
            plan = self._show[self._samples.choice(self._stations)].service.plan
            try:
                plan.set_orbit(
                    Orbit(self._samples.choice((0.0, 10.0, 15.0)), self._samples.uniform(0.5, 3.0))
                )
            except RefusedError as refused:
                self.refused.append(str(refused))
            else:
                self.accepted += 1
            await self._show.wait(1.0)

    def end(self) -> None:
        self._task.cancel()


def re_formed(show: SiteShow, rest: list[str]) -> bool:
    """Whether all vehicles of these stations fly in formation, and their show runs."""
    share = len(show.config.ids) // 4
    return all(
        show[name].view.show is ShowPhase.RUNNING and show.in_phase(name, Phase.FORMATION) == share
        for name in rest
    )


def down(show: SiteShow, rest: list[str]) -> bool:
    return not any(show.in_phase(name, phase) for name in rest for phase in AIRBORNE)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(KILLS))
def test_killed_station_harms_no_other(seed: int) -> None:
    samples = random.Random(1000 + seed)
    victim = leads_or_follows(seed)
    rest = [name for name in NAMES if name != victim]
    climbs, returns = seed % 5 == 4, seed % 5 == 3

    async def story(show: SiteShow) -> None:
        await show.until(lambda: all(all(each.view.rows.ready) for each in show.stations.values()), 30.0)
        await show.wait(3.0)
        show["north"].service.commands.command_show(ShowAction.START)
        if climbs:
            await show.wait(samples.uniform(2.0, 25.0))
        else:
            await show.reach(ShowPhase.RUNNING, limit_s=90.0)
            show["north"].service.plan.set_orbit(Orbit(10.0, 2.0))
            await show.wait(samples.uniform(0.0, 15.0))
        if returns:
            show[samples.choice(NAMES)].service.commands.command_show(ShowAction.STOP)
            await show.wait(samples.uniform(0.5, 25.0))
        await show[victim].kill()
        if not returns:
            await goes_on(show)
        await show.until(partial(down, show, rest), 180.0)
        assert show.violations == 0, show.nearest_m

    async def goes_on(show: SiteShow) -> None:
        killed_s = asyncio.get_running_loop().time()
        operators = Operators(show, rest, samples)
        await show.wait(samples.uniform(0.5, 2.0))
        if victim == NAMES[0]:
            stations = show[samples.choice(rest)].service.stations
            assert stations is not None
            stations.take_lead()
            await show.wait(0.2)
            assert all("gcs lead take" in reason for reason in operators.refused)
            operators.refused.clear()
        else:
            assert not operators.refused
        limit_s = 90.0 if climbs else 60.0
        await show.until(partial(re_formed, show, rest), limit_s)
        took_s = asyncio.get_running_loop().time() - killed_s
        operators.end()
        assert operators.refused == []
        assert operators.accepted >= took_s - 4.0
        if not climbs:
            assert took_s <= FORMED_S
        await show.wait(samples.uniform(0.0, 5.0))
        record = show[samples.choice(rest)].service.commands.command_show(ShowAction.STOP)
        assert {name[0] for name in record.outcomes} >= {name[0] for name in rest}

    fly_site(story, site_of(VEHICLES), **BUS)
