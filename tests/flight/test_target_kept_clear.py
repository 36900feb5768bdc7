"""A person with a clearance: vehicles keep it in formation, on the way home, and where they land."""

import numpy as np
import pytest

from gcs.model.lifecycle import Phase
from gcs.model.plan import MAX_OBSTACLES, Obstacle, Orbit, Target
from gcs.model.state import Array
from gcs.service import ShowAction
from gcs.service.alarms import AlarmCause
from gcs.testing.virtual_show import VirtualShow, fly, show_config
from tests.support.reported_target import alarms, off_m, report
from tests.support.show_phases import running

pytestmark = pytest.mark.soak

PERSON = {
    "targets": [{"name": "boat", "sources": [{"kind": "rest"}], "deviation_m": 0.5, "clearance_m": 12.0}]
}


FAR_M = np.array([60.0, 5.0, 0.0])


def test_formation_flies_clear_of_a_person() -> None:
    """The sphere rises above them. A vehicle stands too near to their first place: the start is refused."""

    async def story(show: VirtualShow) -> tuple[float, float]:
        await show.standby()
        show.service.plan.select_target("boat")
        await report(show, 2.0, lambda _: np.zeros(3))
        check = {each.name: each for each in show.service.preflight.report().fleet}["kept clear"]
        assert "clearance of 12 m" in check.problem
        await report(show, 2.0, lambda _: FAR_M)
        show.service.plan.select_target("boat")
        await report(show, 2.0, lambda _: FAR_M)
        await show.start()
        await report(show, 40.0, lambda _: FAR_M)
        nearest_m = np.inf
        for _ in range(20):
            await report(show, 1.0, lambda _: FAR_M)
            nearest_m = min(nearest_m, float(np.linalg.norm(show.true_m - FAR_M, axis=1).min()))
        assert AlarmCause.TARGET_NEAR not in alarms(show)
        return nearest_m, off_m(show, FAR_M)

    nearest_m, off = fly(story, show_config(4, **PERSON))
    assert nearest_m > 12.0
    assert off < 1.0


@pytest.mark.soak
def test_person_under_a_low_fence_is_kept_clear_of_and_said() -> None:
    """The fence leaves no room for the sphere above them: the filter keeps the distance, not the shape."""
    low = {"control": {"safety": {"fence": {"height_max_m": 24.0}}}}

    async def story(show: VirtualShow) -> tuple[float, set[AlarmCause]]:
        show.service.plan.set_orbit(Orbit(0.0, 2.0))
        await report(show, 2.0, lambda _: FAR_M)
        show.service.plan.select_target("boat")
        seen, nearest_m = set(), np.inf
        for _ in range(60):
            await report(show, 1.0, lambda _: FAR_M)
            seen |= alarms(show)
            nearest_m = min(nearest_m, float(np.linalg.norm(show.true_m - FAR_M, axis=1).min()))
        return nearest_m, seen

    nearest_m, seen = fly(story, show_config(4, **PERSON, **low), after=running)
    assert AlarmCause.TARGET_NO_ROOM in seen
    assert nearest_m > 12.0


@pytest.mark.soak
def test_vehicle_that_a_person_walks_under_is_an_alarm() -> None:
    async def story(show: VirtualShow) -> set[AlarmCause]:
        await show.wait(5.0)
        show.service.plan.set_orbit(Orbit(0.0, 2.0))
        under_m = show.true_m[0] * (1.0, 1.0, 0.0)
        await report(show, 1.0, lambda _: under_m)
        show.service.plan.select_target("boat")
        await report(show, 2.0, lambda _: under_m)
        seen = alarms(show)
        await report(show, 30.0, lambda _: under_m)
        assert AlarmCause.TARGET_NEAR not in alarms(show)
        return seen

    config = show_config(4, targets=[PERSON["targets"][0] | {"clearance_m": 25.0}])
    assert AlarmCause.TARGET_NEAR in fly(story, config, after=running)


@pytest.mark.soak
def test_person_who_is_not_followed_is_kept_clear_of_too() -> None:
    """The formation is sent over them, to a place behind; also after they are lost."""
    people = {"targets": [PERSON["targets"][0] | {"coast_s": 3.0}]}

    async def story(show: VirtualShow) -> float:
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        await report(show, 2.0, lambda _: FAR_M)
        show.service.plan.set_target(Target(2.0 * FAR_M[0], FAR_M[1]))
        nearest_m = np.inf
        for number in range(40):
            if number < 5:
                await report(show, 1.0, lambda _: FAR_M)
            else:
                await show.wait(1.0)
            nearest_m = min(nearest_m, float(np.linalg.norm(show.true_m - FAR_M, axis=1).min()))
        assert off_m(show, 2.0 * FAR_M) < 8.0
        return nearest_m

    assert fly(story, show_config(4, **people), after=running) > 12.0


async def walks_with(show: VirtualShow, seconds: float, place_m: Array) -> tuple[float, set[Phase]]:
    """Report the person there, until all have landed; how near one in the air came, and the phases then."""
    nearest_m, phases = np.inf, set[Phase]()
    for _ in range(round(seconds)):
        await report(show, 1.0, lambda _: place_m)
        aloft_m = show.true_m[show.true_m[:, 2] < -0.5]
        off_m = np.linalg.norm(aloft_m - place_m, axis=1)
        nearest_m = min(nearest_m, float(off_m.min(initial=np.inf)))
        phases = {show.vehicle(name).phase for name in show.config.ids}
        if phases == {Phase.STANDBY}:
            break
    return nearest_m, phases


@pytest.mark.soak
@pytest.mark.parametrize("action", [ShowAction.ABORT, ShowAction.STOP])
def test_all_land_clear_of_a_person(action: ShowAction) -> None:
    """An abort over the person who is followed, and a return to pads at which the person stands by now."""

    async def story(show: VirtualShow) -> tuple[float, set[Phase]]:
        await report(show, 1.0, lambda _: FAR_M)
        await show.start()
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.select_target("boat")
        await walks_with(show, 30.0, FAR_M)
        there_m = FAR_M
        if action is ShowAction.STOP:
            show.service.plan.hold_target()
            show.service.plan.select_target("boat")  # it is believed to be elsewhere now
            show.service.plan.hold_target()
            there_m = np.zeros(3)
            await report(show, 1.0, lambda _: there_m)
        await show.show(action)
        return await walks_with(show, 120.0, there_m)

    nearest_m, phases = fly(story, show_config(4, **PERSON))
    assert phases == {Phase.STANDBY}
    assert nearest_m > 12.0


@pytest.mark.soak
def test_person_counts_beside_as_many_obstacles_as_there_may_be() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        for number in range(MAX_OBSTACLES):
            show.service.plan.add_obstacle(Obstacle(f"b{number}", 5.0 * number - 80.0, 90.0, 1.0, 1.0, 3.0))
        show.service.plan.select_target("boat")
        await report(show, 2.0, lambda _: FAR_M)
        assert show.service.commands.places.is_covered(FAR_M)

    fly(story, show_config(4, **PERSON))


@pytest.mark.soak
def test_target_can_be_held_where_the_fence_leaves_no_room() -> None:
    low = {"control": {"safety": {"fence": {"height_max_m": 24.0}}}}

    async def story(show: VirtualShow) -> float:
        show.service.plan.set_orbit(Orbit(0.0, 2.0))
        await report(show, 2.0)
        show.service.plan.select_target("boat")
        await report(show, 10.0, begin_s=2.0)
        show.service.plan.hold_target()
        await show.wait(1.0)
        held_m = np.array(show.view.target_m)
        await report(show, 10.0, begin_s=12.0)
        return float(np.hypot(*(np.array(show.view.target_m) - held_m)))

    assert fly(story, show_config(4, **PERSON, **low), after=running) < 0.1


@pytest.mark.soak
def test_person_who_is_lost_is_forgotten_by_a_command() -> None:
    """Selected again, and held: the start is no longer refused."""

    async def story(show: VirtualShow) -> list[bool]:
        await show.standby()
        await report(show, 2.0, lambda _: np.zeros(3))
        await show.wait(60.0)
        passes = []
        for name in ("", "boat", ""):
            if name:
                show.service.plan.select_target(name)
            else:
                show.service.plan.hold_target()
            await show.wait(1.0)
            checks = {each.name: each for each in show.service.preflight.report().fleet}
            passes.append("kept clear" not in checks or checks["kept clear"].passes)
        return passes

    assert fly(story, show_config(4, **PERSON)) == [False, True, True]
