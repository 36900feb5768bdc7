"""An obstacle that is there is never refused, whoever is near: through the real service."""

import random
from typing import NamedTuple

import pytest

from gcs.control import ellipses_of
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Obstacle
from gcs.model.state import Array
from gcs.planning.landing_sites import CLEAR_M
from gcs.service import CommandRecord, Outcome, ShowAction
from gcs.service.alarms import AlarmCause
from gcs.testing.virtual_show import TARGET_M, VirtualShow, alarm_texts, fly, show_config
from tests.support.show_phases import running

pytestmark = pytest.mark.soak

AROUND_M, CALLS, APART_S = 30.0, 1000, 0.05


def clear_m(show: VirtualShow, places_m: Array) -> float:
    """The least distance of places (n, 3) from the obstacles, with the law's margins, as they stand now."""
    ellipses = ellipses_of(show.view.plan, show.config.control, show.now_s)
    return min(float(ellipse.distance_m(places_m).min()) for ellipse in ellipses.values())


def over(place_m: Array, half_m: float, height_m: float, name: str = "box") -> Obstacle:
    return Obstacle(name, float(place_m[0]), float(place_m[1]), half_m, half_m, height_m)


class LedOut(NamedTuple):
    named: list[str]
    within_s: float
    inside_s: float
    is_named_still: bool
    floor_violations: int


async def box_on_a_vehicle(show: VirtualShow) -> LedOut:
    box = over(show.true_m[1], 3.0, 60.0)
    show.service.plan.add_obstacle(box)
    within_s = await show.until(lambda: any("too near" in text for text in alarm_texts(show)), 5.0)
    named = [text for text in alarm_texts(show) if "too near" in text]
    inside_s = await show.until(lambda: clear_m(show, show.true_m) > -0.3, 20.0)
    show.service.plan.change_obstacle(box)  # a renewal
    await show.wait(10.0)
    (alarm,) = (one for one in show.view.alarms if one.cause == AlarmCause.OBSTACLE_NEAR)
    return LedOut(named, within_s, within_s + inside_s, alarm.lasts, show.floor_violations())


def test_vehicles_are_led_out_of_an_obstacle_that_is_there() -> None:
    flight = fly(box_on_a_vehicle, show_config(4), after=running)
    assert flight.named == [
        "Vehicle d2 too near obstacle box: inside its margin of 2 m. It is led out the nearest way."
    ]
    assert flight.within_s <= 1.0
    assert flight.inside_s <= 8.0
    assert not flight.is_named_still
    assert flight.floor_violations == 0


class Landed(NamedTuple):
    outcomes: set[Outcome]
    clear_m: float
    floor_violations: int


async def all_down(show: VirtualShow, record: CommandRecord) -> Landed:
    record = await show.settled(record, 150.0)
    await show.reach(ShowPhase.LANDED)
    outcomes = {one.outcome for one in record.outcomes.values()}
    return Landed(outcomes, clear_m(show, show.true_m), show.floor_violations())


async def box_on_a_landing_place(show: VirtualShow) -> Landed:
    """While all come down where they are, a box comes under one of them."""
    record = show.service.commands.command_show(ShowAction.ABORT)
    await show.wait(2.0)
    goal_m = show.service.flight.vehicles["d1"].goal_m
    assert goal_m is not None
    show.service.plan.add_obstacle(over(goal_m, 0.5, 1.0))
    return await all_down(show, record)


async def box_on_a_pad(show: VirtualShow) -> Landed:
    """It is there before they are to come home."""
    show.service.plan.add_obstacle(over(show.track.samples[0].true_m[0], 0.5, 3.0))
    return await all_down(show, show.service.commands.command_show(ShowAction.STOP))


async def box_under_one_that_returns(show: VirtualShow) -> Landed:
    """It comes onto a pad while the vehicle of that pad comes down."""
    home_m = show.track.samples[0].true_m[0]
    record = show.service.commands.command_show(ShowAction.STOP)
    await show.phase("d1", Phase.LANDING)
    show.service.plan.add_obstacle(over(home_m, 0.5, 1.5))
    return await all_down(show, record)


async def box_on_a_pad_of_one_under_way(show: VirtualShow) -> Landed:
    """It comes onto a pad while all fly home."""
    home_m = show.track.samples[0].true_m[0]
    record = show.service.commands.command_show(ShowAction.STOP)
    await show.wait(4.0)
    show.service.plan.add_obstacle(over(home_m, 1.0, 4.0))
    return await all_down(show, record)


@pytest.mark.soak
def test_vehicles_land_beside_an_obstacle_on_their_places() -> None:
    stories = (
        box_on_a_landing_place,
        box_on_a_pad,
        box_under_one_that_returns,
        box_on_a_pad_of_one_under_way,
    )
    for story in stories:
        landed = fly(story, show_config(2), after=running)
        assert landed.outcomes == {Outcome.DONE}, story.__name__
        assert landed.clear_m > CLEAR_M - 0.5, story.__name__  # of true positions
        assert landed.floor_violations == 0, story.__name__


async def boxes_everywhere(show: VirtualShow) -> tuple[set[str], int, set[Outcome]]:
    """Sizes, places and velocities as an operator, or a sensor that errs, may give them."""
    chance, plan, known = random.Random(48), show.service.plan, set[str]()
    for _ in range(CALLS):
        x_m, y_m = (middle_m + chance.uniform(-AROUND_M, AROUND_M) for middle_m in TARGET_M)
        half_m, height_m = (chance.uniform(0.1, 15.0), chance.uniform(0.1, 15.0)), chance.uniform(0.5, 60.0)
        speed_m_s = chance.choice([(0.0, 0.0), (chance.uniform(-2.0, 2.0), chance.uniform(-2.0, 2.0))])
        box = Obstacle(f"box{chance.randrange(4)}", x_m, y_m, *half_m, height_m, *speed_m_s)
        (plan.change_obstacle if box.id in known else plan.add_obstacle)(box)  # a view may be a tick old
        known.add(box.id)
        await show.wait(APART_S)
    standing = {one.id for one in show.view.plan.obstacles}
    for name in standing:
        plan.remove_obstacle(name)
    record = await show.settled(show.service.commands.command_show(ShowAction.STOP), 150.0)
    outcomes = {one.outcome for one in record.outcomes.values()}
    return standing, show.floor_violations(), outcomes


@pytest.mark.soak
def test_no_obstacle_of_a_thousand_is_refused_in_flight() -> None:
    standing, violations, outcomes = fly(boxes_everywhere, show_config(4), after=running)
    assert standing == {"box0", "box1", "box2", "box3"}
    assert violations == 0
    assert outcomes == {Outcome.DONE}


class Waited(NamedTuple):
    reason: str
    landed: Landed


async def box_under_the_whole_field(show: VirtualShow) -> Waited:
    record = show.service.commands.command_show(ShowAction.STOP)
    await show.wait(2.0)
    show.service.plan.add_obstacle(Obstacle("flood", 0.0, 0.0, 1000.0, 1000.0, 1.0))
    await show.until(lambda: "no place to land is free" in show.vehicle("d1").reason, 60.0)
    reason = show.vehicle("d1").reason
    await show.wait(10.0)
    assert {show.vehicle(name).phase for name in show.config.ids} == {Phase.RETURN}
    show.service.plan.remove_obstacle("flood")
    record = await show.settled(record, 150.0)
    outcomes = {one.outcome for one in record.outcomes.values()}
    return Waited(reason, Landed(outcomes, 0.0, show.floor_violations()))


@pytest.mark.soak
def test_vehicles_wait_in_the_air_while_no_place_is_free() -> None:
    waited = fly(box_under_the_whole_field, show_config(2), after=running)
    assert waited.reason == "waits in the air: no place to land is free of obstacles"
    assert waited.landed.outcomes == {Outcome.DONE}
    assert waited.landed.floor_violations == 0
