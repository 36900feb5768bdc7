"""What `gcs serve` says in plain words: links that fail, and vehicles that it leaves in the air."""

import asyncio

import pytest

from gcs.cli.service.serve import left_behind, say_failures
from gcs.model.errors import LinkError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import ShowAction
from gcs.sim.vehicle.px4 import Mode as PilotMode
from gcs.testing.virtual_show import VirtualShow, fly, show_config
from tests.support.show_phases import running


@pytest.mark.soak
def test_vehicles_left_in_the_air_are_named_at_the_end() -> None:
    async def story(show: VirtualShow) -> None:
        four = "d1 (formation), d2 (formation), d3 (formation), d4 (formation)"
        assert left_behind(show.view) == f"still in the air, not under this station's control: {four}"
        show.pilot("d3", PilotMode.HOLD)
        await show.phase("d3", Phase.PILOT)
        show.service.commands.command_show(ShowAction.STOP)
        await show.until(lambda: show.view.counts.controlled == 0, 120.0)
        assert left_behind(show.view) == "still in the air, not under this station's control: d3 (pilot)"
        show.ports.silence("d3")
        await show.phase("d3", Phase.LOST)
        assert left_behind(show.view) == "not known whether on the ground: d3 (lost)"

    fly(story, show_config(4), after=running)


def test_a_link_that_fails_is_said_once_with_what_is_received() -> None:
    printed: list[str] = []

    async def story(show: VirtualShow) -> None:
        await show.standby()
        saying = asyncio.create_task(say_failures(show.service, lambda _, text: printed.append(text)))
        show.link.failures.put_nowait(LinkError("UDP port 14540 on 127.0.0.1: another program has it"))
        await show.wait(3.0)
        saying.cancel()
        assert show.view.show is ShowPhase.IDLE

    fly(story, show_config(4))
    (text,) = printed
    assert "another program has it. " in text
    assert text.endswith(" of 4 vehicles are received")
