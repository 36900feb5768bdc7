"""The vehicles' own lights: battery and `find` on the ground, the show's colours in the air."""

from pathlib import Path

import pytest

from gcs.config.schema import Config
from gcs.flight.features.lights import FOUND, FULL, LOW, OFF
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import ShowPhase
from gcs.service import ShowAction, VehicleAction
from gcs.testing.virtual_show import VirtualShow, fly, refused, show_config
from tests.support import written_show

LED = {"lights": {"driver": "led-control"}}


def light(show: VirtualShow, vehicle_id: str) -> tuple[int, ...]:
    """The colour that the fake vehicle received last."""
    truth = show.fleet.autopilots[show.config.ids.index(vehicle_id)].equipment.truth
    return tuple(bytes.fromhex(truth["light"][1:]))


def test_battery_is_shown_as_colour_on_the_ground() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        show.fleet.state.remaining[1] = 0.12
        await show.until(lambda: light(show, "d2") == LOW)
        assert light(show, "d1") == FULL
        show.fleet.state.remaining[1] = 1.0
        await show.until(lambda: light(show, "d2") == FULL)
        await show.start()
        await show.until(lambda: light(show, "d1") == OFF)

    fly(story, show_config(4, **LED))


@pytest.mark.soak
def test_found_vehicle_blinks_and_then_stops() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        await show.command("d3", VehicleAction.FIND)
        await show.until(lambda: light(show, "d3") == FOUND)
        assert light(show, "d1") == FULL
        await show.until(lambda: light(show, "d3") == OFF, 1.0)
        await show.until(lambda: light(show, "d3") == FOUND, 1.0)
        await show.wait(4.0)
        assert light(show, "d3") == FULL

    fly(story, show_config(4, lights={"driver": "actuator", "find_s": 3.0}))


@pytest.mark.soak
def test_find_is_refused_in_the_air_and_without_lights() -> None:
    async def in_the_air(show: VirtualShow) -> None:
        await show.start()
        refusal = await refused(show, lambda: show.service.commands.command_vehicle("d1", VehicleAction.FIND))
        assert refusal.kind is RefusedError
        assert "find is for vehicles received on the ground" in refusal.text

    async def without_lights(show: VirtualShow) -> None:
        await show.standby()
        refusal = await refused(show, lambda: show.service.commands.command_vehicle("d1", VehicleAction.FIND))
        assert "lights.driver of the configuration is none" in refusal.text

    fly(in_the_air, show_config(4, **LED))
    fly(without_lights)


@pytest.mark.soak
def test_flying_vehicles_show_the_colours_of_the_show(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        show_hash = written_show.select(show)
        await show.standby()
        show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.reach(ShowPhase.RUNNING)
        await show.wait(0.5)
        assert [light(show, name) for name in show.config.ids] == [(255, 0, 0), (0, 0, 255)] * 2
        await show.wait(18.0)
        assert {light(show, name) for name in show.config.ids} == {(0, 255, 0)}

    plan: Config = written_show.config(tmp_path, **LED)
    written_show.fly(story, plan)
