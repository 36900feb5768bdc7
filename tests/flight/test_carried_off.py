"""Vehicles that wind carries off come down: where they are, named, off all that is below them."""

from typing import Any, Final, NamedTuple

import numpy as np
import pytest

from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Obstacle, Orbit, Target
from gcs.model.state import Array
from gcs.service import CommandRecord, Outcome, ShowAction, VehicleAction
from gcs.service.alarms import AlarmCause
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import VirtualShow, badly_written, fly, show_config
from tests.flight.test_wind import FROM_RAD, blow, flown
from tests.support.show_phases import running

DOWN_WITHIN_S: Final = 110.0
"""20 s without headway, and a LAND from at most 34 m; lower ones first."""


class CameDown(NamedTuple):
    record: CommandRecord
    phases: list[Phase]
    took_s: float
    texts: list[str]  # of what landed where it was
    violations: int
    true_m: Array  # (n, 3) where they lie


def command(show: VirtualShow, action: str) -> CommandRecord:
    commands = show.service.commands
    if action == "land":
        return commands.command_vehicles(VehicleAction.LAND)
    return commands.command_show(ShowAction(action))


async def down(show: VirtualShow, record: CommandRecord, limit_s: float) -> CameDown:
    """Wait until all stand, and note what the operator reads meanwhile."""
    texts, began_s = dict[str, None](), show.now_s

    def all_stand() -> bool:
        lands = (each for each in show.view.alarms if each.cause is AlarmCause.LANDS_IN_PLACE and each.lasts)
        texts.update((each.text, None) for each in lands)
        return all(seen.phase is Phase.STANDBY for seen in vehicles_of(show.view))

    await show.until(all_stand, limit_s)
    took_s = show.now_s - began_s
    await show.wait(1.0)
    assert badly_written(show) == []
    phases = [seen.phase for seen in vehicles_of(show.view)]
    ended = show.service.command_log.get(record.id)
    return CameDown(ended, phases, took_s, list(texts), show.floor_violations(), show.true_m)


ALL = [
    (kinds, speed_m_s, count, action)
    for kinds in ("ardupilot", "px4", "mixed")
    for speed_m_s in (14.0, 17.0, 20.0)
    for count in (1, 3, 8)
    for action in ("abort", "stop", "land")
    if kinds != "mixed" or count > 1
]


@pytest.mark.keeps("ardupilot-17.0-3-abort")
@pytest.mark.parametrize(("kinds", "speed_m_s", "count", "action"), ALL)
def test_whatever_the_wind_all_come_down(kinds: str, speed_m_s: float, count: int, action: str) -> None:
    async def story(show: VirtualShow) -> CameDown:
        await show.start()
        blow(show, speed_m_s)
        await show.wait(6.0)
        return await down(show, command(show, action), DOWN_WITHIN_S)

    came_down = flown(story, kinds, count)
    assert came_down.record.outcome is Outcome.DONE
    assert came_down.violations == 0
    if speed_m_s >= 17.0:
        assert any(
            "carried off at" in text and " m south-east of its pad, at 47." in text
            for text in came_down.texts
        )


@pytest.mark.soak
@pytest.mark.parametrize("kinds", ["ardupilot", "px4"])
def test_where_it_comes_down_is_said_in_time(kinds: str) -> None:
    """To within a third of how far wind carries it meanwhile."""

    async def story(show: VirtualShow) -> tuple[float, float, CameDown]:
        await show.start()
        blow(show, 17.0)
        await show.wait(6.0)
        record = command(show, "abort")
        await show.until(
            lambda: any(each.cause is AlarmCause.LANDS_IN_PLACE for each in show.view.alarms), 30.0
        )
        here_m = show.true_m[0, :2].copy()
        (text,) = [each.text for each in show.view.alarms if each.cause is AlarmCause.LANDS_IN_PLACE]
        latitude_deg, longitude_deg = (
            np.array([float(part)]) for part in text.partition(", at ")[2].rstrip(".").split(", ")
        )
        named_m = show.config.frame.position_m(latitude_deg, longitude_deg, np.array([488.0]))[0, :2]
        came_down = await down(show, record, DOWN_WITHIN_S)
        lies_m = came_down.true_m[0, :2]
        return float(np.hypot(*(named_m - lies_m))), float(np.hypot(*(lies_m - here_m))), came_down

    off_m, carried_m, came_down = flown(story, kinds, 1)
    assert off_m < 10.0 + carried_m / 2.0
    assert came_down.phases == [Phase.STANDBY]


@pytest.mark.soak
@pytest.mark.parametrize("kinds", ["ardupilot", "px4"])
def test_wind_that_stops_again_lets_them_come_home(kinds: str) -> None:
    async def story(show: VirtualShow) -> tuple[CameDown, Array]:
        await show.start()
        pads_m = np.array([vehicle.home_m for vehicle in show.service.flight.vehicles.values()])
        blow(show, 17.0)
        await show.wait(6.0)
        record = command(show, "stop")
        await show.wait(12.0)
        blow(show, 0.0)
        return await down(show, record, 150.0), pads_m

    came_down, pads_m = flown(story, kinds, 3)
    assert came_down.texts == []
    assert came_down.record.outcome is Outcome.DONE
    assert np.hypot(*(came_down.true_m - pads_m)[:, :2].T).max() < 2.0


FAR_M: Final = 120.0


@pytest.mark.soak
def test_slowly_home_against_wind_it_is_not_landed_on_the_way() -> None:
    """It falls behind the goal of its planned path, and gets nearer to its pad by 0.8 m/s."""

    async def story(show: VirtualShow) -> tuple[CameDown, Array]:
        await show.start()
        pads_m = np.array([vehicle.home_m for vehicle in show.service.flight.vehicles.values()])
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.set_target(Target(float(FAR_M * np.cos(FROM_RAD)), float(FAR_M * np.sin(FROM_RAD))))
        await show.wait(45.0)
        record = command(show, "stop")
        await show.wait(8.0)
        blow(show, 9.0)
        return await down(show, record, 240.0), pads_m

    came_down, pads_m = flown(story, "px4", 1)
    assert came_down.texts == []
    assert np.hypot(*(came_down.true_m - pads_m)[:, :2].T).max() < 2.0


WIDE_M: Final = 700.0


@pytest.mark.soak
@pytest.mark.parametrize("kinds", ["ardupilot", "px4"])
def test_what_is_below_is_waited_for_but_not_for_ever(kinds: str) -> None:
    """A hall that wind does not carry it past: the operator reads that, and what it hits in the end."""

    async def story(show: VirtualShow) -> tuple[list[str], CameDown]:
        await show.start()
        blow(show, 17.0)
        await show.wait(6.0)
        record = command(show, "abort")
        await show.wait(15.0)
        x_m, y_m = show.true_m[0, :2].tolist()
        show.service.plan.add_obstacle(Obstacle("hall", x_m, y_m, WIDE_M, WIDE_M, 2.0, time_s=show.now_s))
        waits = dict[str, None]()

        def lands() -> bool:
            named = (each for each in show.view.alarms if each.cause is AlarmCause.NOT_LOWER)
            waits.update((each.text, None) for each in named)
            return any(each.cause is AlarmCause.LANDS_IN_PLACE for each in show.view.alarms)

        await show.until(lands, 150.0)
        return list(waits), await down(show, record, DOWN_WITHIN_S)

    waits, came_down = flown(story, kinds, 1)
    assert any("d1 waits for obstacle hall below, and lands where it is in " in text for text in waits)
    assert all("It may hit obstacle hall" in text for text in came_down.texts)
    assert came_down.record.outcome is Outcome.DONE


@pytest.mark.soak
def test_one_that_holds_its_place_is_landed_on_nothing() -> None:
    """An obstacle comes over all places when it is low already, and stays: until its battery is low."""

    async def story(show: VirtualShow) -> tuple[set[str], CameDown]:
        record = command(show, "stop")
        await show.until(lambda: show.vehicle("d1").phase is Phase.LANDING, 60.0)
        show.service.plan.add_obstacle(Obstacle("lorry", 0.0, 0.0, WIDE_M, WIDE_M, 2.0, time_s=show.now_s))
        await show.wait(90.0)
        assert show.vehicle("d1").phase is Phase.LANDING
        assert show.true_m[0, 2] < -3.0
        waits = {each.text for each in show.view.alarms if each.cause is AlarmCause.NOT_LOWER and each.lasts}
        show.befall("d1", "battery", remaining=0.15)
        return waits, await down(show, record, 200.0)

    config = show_config(1, failsafes={"low_battery": {"action": "ignore"}})
    waits, came_down = fly(story, config, after=running)
    (text,) = waits
    assert (
        "d1 waits for obstacle lorry below, and lands where it is once nothing is, or its battery is" in text
    )
    assert any("It may hit obstacle lorry" in each for each in came_down.texts)
    assert came_down.phases == [Phase.STANDBY]


def ring(x_m: float, y_m: float, time_s: float) -> list[Obstacle]:
    """Four high walls round a place."""
    off_m = 12.0
    return [
        Obstacle(f"wall{number}", x_m + east * off_m, y_m + north * off_m, *half_m, 200.0, time_s=time_s)
        for number, (east, north, half_m) in enumerate(
            [(1, 0, (1.0, 14.0)), (-1, 0, (1.0, 14.0)), (0, 1, (14.0, 1.0)), (0, -1, (14.0, 1.0))]
        )
    ]


@pytest.mark.soak
def test_one_whose_way_home_is_closed_for_a_minute_lands_at_home() -> None:
    """It holds its place, and the ground below is none to land on: its way opens again."""

    async def story(show: VirtualShow) -> tuple[set[str], CameDown, Array]:
        pads_m = np.array([vehicle.home_m for vehicle in show.service.flight.vehicles.values()])
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.set_target(Target(90.0, 60.0))
        await show.wait(40.0)
        record = command(show, "stop")
        await show.wait(5.0)
        x_m, y_m = show.true_m[0, :2].tolist()
        walls = ring(x_m, y_m, show.now_s)
        for wall in walls:
            show.service.plan.add_obstacle(wall)
        waits = set[str]()
        for _ in range(12):
            await show.wait(5.0)
            waits |= {each.text for each in show.view.alarms if each.cause is AlarmCause.NOT_LOWER}
        for wall in walls:
            show.service.plan.remove_obstacle(wall.id)
        return waits, await down(show, record, 200.0), pads_m

    waits, came_down, pads_m = fly(story, show_config(1), after=running)
    assert any("d1 waits for its way home, and lands where it is in " in text for text in waits)
    assert came_down.texts == []
    assert np.hypot(*(came_down.true_m - pads_m)[:, :2].T).max() < 2.0


def east_of(show: VirtualShow, name: str) -> Array:
    """(2,) Where a vehicle is along the wind, and across it, in m."""
    north_m, east_m, _ = show.fleet.position_m[show.config.ids.index(name)]
    along_m = north_m * np.cos(FROM_RAD) + east_m * np.sin(FROM_RAD)
    return np.array([along_m, east_m * np.cos(FROM_RAD) - north_m * np.sin(FROM_RAD)])


@pytest.mark.soak
@pytest.mark.parametrize("kinds", ["ardupilot", "px4"])
def test_vehicles_that_drift_over_others_land_beside_them(kinds: str) -> None:
    """Wind has seven of eight; the last stands below where some of them pass."""

    async def story(show: VirtualShow) -> CameDown:
        await show.start()
        along_m = {name: east_of(show, name)[0] for name in show.config.ids}
        farthest = max(along_m, key=along_m.__getitem__)
        await show.settled(show.service.commands.command_vehicle(farthest, VehicleAction.LAND))
        await show.phase(farthest, Phase.STANDBY, 90.0)
        blow(show, 17.0)
        await show.wait(2.0)
        return await down(show, command(show, "abort"), 2.0 * DOWN_WITHIN_S)

    came_down = flown(story, kinds, 8)
    assert came_down.violations == 0
    apart_m = np.linalg.norm(came_down.true_m[:, None, :2] - came_down.true_m[None, :, :2], axis=2)
    assert apart_m[~np.eye(8, dtype=np.bool_)].min() > 2.0
    assert came_down.record.outcome is Outcome.DONE


async def over_the_record(show: VirtualShow) -> list[str]:
    await show.start()
    blow(show, 20.0)
    await show.wait(6.0)
    await down(show, command(show, "abort"), DOWN_WITHIN_S)
    await show.reach(ShowPhase.LANDED)
    return [each.text for each in show.service.events.newest() if "autopilot lands it about" in each.text]


@pytest.mark.soak
def test_the_events_say_where_each_came_down() -> None:
    events: Any = flown(over_the_record, "ardupilot", 3)
    assert len(events) == 3
    assert all("m/s" in text and "of its pad, at 47." in text for text in events)
