"""A stranger floods the bus with junk in the name of a station: the others still receive that station."""

import asyncio
import itertools
import random

import pytest

from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Orbit
from gcs.service import ShowAction
from gcs.testing.virtual_site import SiteShow, fly_site, site_config

BUS = {"delay_s": 0.02, "spread_s": 0.01, "loss": 0.01}
TOPICS = (
    *("states", "formation", "plan", "homes", "info", "slots.north", "slots.east"),
    *("letters.north", "letters.east", "return.north.0"),
)
PER_S = 1000


async def flood(show: SiteShow) -> None:
    """Junk in each tick after every message of south, which leads, and so in place of it."""
    samples, topics = random.Random(3), itertools.cycle(TOPICS)
    while True:
        for _ in range(PER_S // 200):
            show.network.carry("south", next(topics), samples.randbytes(samples.choice((0, 1, 7, 100, 1000))))
        await show.wait(1.0 / 200.0)


@pytest.mark.soak
def test_junk_takes_the_place_of_no_valid_message() -> None:
    async def story(show: SiteShow) -> None:
        stations = show["south"].service.stations
        await show.wait(1.0)
        assert stations is not None
        stations.take_lead()
        flooding = asyncio.create_task(flood(show))
        await show.start()
        show["east"].service.plan.set_orbit(Orbit(6.0, 2.0))
        for _ in range(40):
            await show.wait(0.25)
            for name in ("north", "west", "east"):
                seen = {each.name: each for each in show[name].view.stations}
                assert seen["south"].received
                assert seen["south"].silent_s is not None
                assert seen["south"].silent_s < 0.2
                assert show[name].view.show is ShowPhase.RUNNING
        assert {each.view.plan.orbit.radius_m for each in show.stations.values()} == {6.0}
        show["west"].service.commands.command_show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED, limit_s=120.0)
        flooding.cancel()
        bus = show["north"].view.bus
        assert bus is not None
        assert bus.refused > 30 * PER_S
        assert show.violations == 0

    fly_site(story, site_config(4, 2), **BUS)
