"""The shipped configuration for simulators starts from pads of 5 m, with what their receivers report."""

from typing import Any

import pytest

from gcs.config import schema as configuration
from gcs.config.schema import Config
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import ShowAction
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import VirtualShow, fly


def shipped(count: int, autopilot: str = "px4") -> Config:
    """`px4-sitl` with so many of its vehicles; those of the other autopilot are named as such."""
    raw: dict[str, Any] = configuration.load(configuration.find("px4-sitl")).model_dump()
    (link,) = raw["links"]
    vehicles = link["vehicles"] | {"count": count}
    raw["links"] = [link | {"ports": count, "autopilot": autopilot, "vehicles": vehicles}]
    return Config.model_validate(raw)


def failing(show: VirtualShow) -> list[str]:
    """Checks that refuse the start, apart from the parameters' that were not read yet."""
    report = show.service.preflight.report()
    found = [*report.fleet, *(check for vehicle in report.vehicles for check in vehicle.checks)]
    return [f"{check.name}: {check.problem}" for check in found if not check.passes]


@pytest.mark.soak
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_two_to_ten_vehicles_are_accepted_on_shipped_pads(autopilot: str) -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        for _ in range(10):  # the errors of the estimates wander within 3 to 6 s
            await show.wait(5.0)
            assert failing(show) == []

    for count in (2, 6, 10):
        fly(story, shipped(count, autopilot), grid_columns=3, seed=count)


@pytest.mark.soak
def test_ten_start_beside_neighbours_whose_estimators_reset() -> None:
    """A reset in the air moves no pad: vehicles that still stand are not left behind."""

    async def story(show: VirtualShow) -> None:
        await show.standby()
        show.service.commands.command_show(ShowAction.START)
        for row in (0, 1):
            await show.until(lambda row=row: -show.true_m[row, 2] > 1.0)  # type: ignore[misc]
            show.befall(show.config.ids[row], "position-reset", east_m=0.1)
        await show.reach(ShowPhase.RUNNING, 120.0)
        assert {seen.id: seen.phase for seen in vehicles_of(show.view)} == dict.fromkeys(
            show.config.ids, Phase.FORMATION
        )
        assert show.floor_violations() == 0

    fly(story, shipped(10), grid_columns=3)
