"""Vehicles that no way leads home: named at once, at rest, and home as soon as there is a way."""

from typing import Final, NamedTuple

import numpy as np
import pytest

from gcs.control import Memory
from gcs.flight.monitors.space_alarms import SURE_S
from gcs.model.plan import Obstacle, Orbit, Target
from gcs.model.state import Array
from gcs.service import ShowAction
from gcs.service.alarms import AlarmCause
from gcs.simulation.flight import prepared
from gcs.simulation.formation_run import FormationRun
from gcs.simulation.record import penetrations_and_clearance_m
from gcs.simulation.scenario import RandomObstacles, Scenario, Wind
from gcs.testing.virtual_show import VirtualShow, fly, show_config
from tests.support.show_phases import running

NAMED_S: Final = 10.0
LOW_M: Final = 45.0


def in_a_ring(
    count: int, seed: int, *, opens: bool, gust_m_s: float = 0.0, duration_s: float = 30.0
) -> FormationRun:
    """As `return-walls`, in a closed ring or among its walls, below a fence over which nothing climbs."""
    scenario = Scenario.load("return-walls")
    safety = scenario.control.safety
    fence = safety.fence.model_copy(update={"height_max_m": LOW_M})
    control = scenario.control.model_copy(update={"safety": safety.model_copy(update={"fence": fence})})
    flight = scenario.flight
    if not opens:
        flight = flight.model_copy(update={"random_obstacles": RandomObstacles(kind="home-closed")})
    changed: dict[str, object] = {"flight": flight, "control": control, "duration_s": duration_s}
    if gust_m_s:
        world = scenario.world.model_copy(update={"wind": Wind(gust_m_s=gust_m_s)})
        changed |= {"world": world, "worlds": ()}
    run = prepared(scenario.model_copy(update=changed), count, seed)
    assert isinstance(run, FormationRun)
    run.get_ready()
    return run


def named(memory: Memory) -> Array:
    """(n,) Which vehicles are known to have no way."""
    since_s = memory.no_way_s
    return np.zeros(0, np.bool_) if since_s is None else np.isfinite(since_s)


CASES: Final = [(5, 8000), (8, 8001), (20, 8002), (50, 8003), (8, 8004), (20, 8005)]


@pytest.mark.keeps("5-8000")
@pytest.mark.parametrize(("count", "seed"), CASES)
def test_in_a_closed_ring_all_are_named_and_rest(count: int, seed: int) -> None:
    """They flew to and fro before the walls at 1 to 2 m/s, and were named after 30 s."""
    flight, named_s = in_a_ring(count, seed, opens=False), np.inf
    while not flight.is_over:
        flight.step()
        if np.count_nonzero(named(flight.memory)) == count:
            named_s = min(named_s, flight.time_s + SURE_S)
    assert named_s - flight.flight.ending_s <= NAMED_S
    assert np.linalg.norm(flight.world.velocity_m_s, axis=1).max() <= 0.1
    assert not flight.record.violating
    assert penetrations_and_clearance_m(flight.record)[0] == 0


@pytest.mark.keeps("5-8000")
@pytest.mark.parametrize(("count", "seed"), CASES)
def test_where_a_way_leads_home_no_vehicle_is_named(count: int, seed: int) -> None:
    flight = in_a_ring(count, seed, opens=True)
    while not flight.is_over:
        flight.step()
        assert not named(flight.memory).any(), f"at {flight.time_s} s"


def test_out_of_an_open_u_all_come_home() -> None:
    """One of eight stayed in it for ever: it saw no way past walls whose ellipses overlap."""
    flight = in_a_ring(8, 8004, opens=True, duration_s=90.0)
    while not flight.is_over:
        flight.step()
    assert not flight.world.in_air.any()
    assert np.hypot(*(flight.world.position_m - flight.record.goal_m)[:, :2].T).max() < 2.0
    assert not flight.record.violating


@pytest.mark.keeps("5-8000")
@pytest.mark.parametrize(("count", "seed"), CASES[:3])
def test_gusts_do_not_carry_off_what_waits(count: int, seed: int) -> None:
    """Vehicles that only stopped were 9 to 14 m off after a minute."""
    flight = in_a_ring(count, seed, opens=False, gust_m_s=2.0, duration_s=60.0)
    while not named(flight.memory).any():
        flight.step()
    began_m, off_m = flight.world.position_m.copy(), list[Array]()
    while not flight.is_over:
        flight.step()
        if flight.time_s > 40.0:
            off_m.append(np.linalg.norm(flight.world.position_m - began_m, axis=1))
    assert np.mean(off_m, axis=0).max() <= 2.0
    assert not flight.record.violating


class Shut(NamedTuple):
    texts: list[str]  # of the alarm
    fast_m_s: float  # while it waits
    late: list[str]  # of the alarm once a wall is gone
    off_m: float  # from the pad, landed


def ring(x_m: float, y_m: float, time_s: float) -> list[Obstacle]:
    """Four walls round a place, higher than the fence."""
    off_m = 14.0
    sides = [(1, 0, (1.0, 16.0)), (-1, 0, (1.0, 16.0)), (0, 1, (16.0, 1.0)), (0, -1, (16.0, 1.0))]
    return [
        Obstacle(f"wall{number}", x_m + east * off_m, y_m + north * off_m, *half_m, 200.0, time_s=time_s)
        for number, (east, north, half_m) in enumerate(sides)
    ]


async def shut_in(show: VirtualShow, *, before_s: float) -> Shut:
    """Close a ring round one vehicle `before_s` before it is to come home, or so long after."""
    show.service.plan.set_orbit(Orbit(0.0, 4.0))
    show.service.plan.set_target(Target(90.0, 60.0))
    await show.wait(40.0)
    if before_s < 0.0:
        show.service.commands.command_show(ShowAction.STOP)
    await show.wait(abs(before_s))
    x_m, y_m = show.true_m[0, :2].tolist()
    walls = ring(x_m, y_m, show.now_s)
    for wall in walls:
        show.service.plan.add_obstacle(wall)
    if before_s >= 0.0:
        await show.wait(3.0)
        show.service.commands.command_show(ShowAction.STOP)
    await show.wait(NAMED_S)
    texts = [each.text for each in show.view.alarms if each.cause is AlarmCause.NO_WAY]
    before_m = show.true_m.copy()
    await show.wait(5.0)
    fast_m_s = float(np.linalg.norm(show.true_m - before_m, axis=1).max()) / 5.0
    show.service.plan.remove_obstacle("wall0")
    show.service.plan.remove_obstacle("wall1")
    await show.wait(3.0)
    late = [each.text for each in show.view.alarms if each.cause is AlarmCause.NO_WAY and each.lasts]
    await show.until(lambda: not show.service.flight.vehicles.airborne)
    (vehicle,) = show.service.flight.vehicles.values()
    return Shut(texts, fast_m_s, late, float(np.hypot(*(show.true_m[0] - vehicle.home_m)[:2])))


@pytest.mark.soak
@pytest.mark.parametrize("before_s", [1.0, -6.0])
def test_the_operator_reads_of_it_within_10_s(before_s: float) -> None:
    async def story(show: VirtualShow) -> Shut:
        return await shut_in(show, before_s=before_s)

    shut = fly(story, show_config(1), after=running)
    assert len(shut.texts) == 1
    assert shut.texts[0].startswith("No way for Vehicle d1 past obstacles that stand")
    assert shut.fast_m_s <= 0.1
    assert shut.late == []
    assert shut.off_m < 2.0
