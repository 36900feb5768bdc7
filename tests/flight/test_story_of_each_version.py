"""Each supported version of both autopilots flies the whole story with the shipped configuration."""

from typing import NamedTuple

import pytest

from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Formation, Orbit, Target
from gcs.service import Outcome, ShowAction
from gcs.service.alarms import AlarmSeverity
from gcs.sim.vehicle import versions
from gcs.sim.vehicle.px4 import Quirks
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import VirtualShow, fly
from tests.flight.test_shipped_pads import shipped

pytestmark = pytest.mark.soak

READY_MAX_S = 20.0
"""From when all vehicles can be armed until a start would be accepted."""

BOOTED_MAX_S = 60.0

VERSIONS = [(kind, name) for kind in ("px4", "ardupilot") for name in versions.names(kind)]


class Outcomes(NamedTuple):
    ready_s: float
    versions: set[str]
    outcomes: list[Outcome]
    violations: int
    alarms: set[str]  # since the start, but those for information only


async def story(show: VirtualShow) -> Outcomes:
    service = show.service
    await show.until(lambda: all(seen.ready for seen in vehicles_of(show.view)), BOOTED_MAX_S)
    ready_s = await show.until(lambda: service.preflight.report().passes, READY_MAX_S)
    reported = {each.version for each in service.preflight.report().vehicles}
    began_s = show.now_s
    outcomes = [(await show.settled(service.commands.command_show(ShowAction.START), 180.0)).outcome]
    await show.reach(ShowPhase.RUNNING, 120.0)
    service.plan.set_formation(Formation(10.0, 25.0))
    service.plan.set_orbit(Orbit(12.0, 2.0))
    service.plan.set_target(Target(6.0, 4.0, 0.5, -0.3))
    await show.wait(15.0)
    outcomes.append((await show.show(ShowAction.STOP)).outcome)
    await show.reach(ShowPhase.LANDED, 120.0)
    alarms = {
        alarm.text
        for sample in show.track.between(began_s).samples
        for alarm in sample.view.alarms
        if alarm.severity is not AlarmSeverity.INFORMATION
    }
    return Outcomes(ready_s, reported, outcomes, show.floor_violations(), alarms)


@pytest.mark.keeps("px4-1.14")
@pytest.mark.parametrize(("kind", "version"), VERSIONS, ids=lambda part: part or "recorded")
def test_version_flies_the_story_with_what_is_shipped(kind: str, version: str) -> None:
    flown = fly(story, shipped(4, kind), version=version, grid_columns=3, quirks=Quirks())
    assert flown.ready_s <= READY_MAX_S
    (reported,) = flown.versions
    assert reported.startswith(version)
    assert flown.outcomes == [Outcome.DONE, Outcome.DONE]
    assert flown.violations == 0
    assert flown.alarms == set()
