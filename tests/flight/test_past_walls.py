"""Returns and joins past walls, through the real service: all come home where a way exists."""

import random
from collections.abc import Callable
from functools import partial
from math import ceil, hypot
from typing import Final, NamedTuple

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.control import ellipses_of
from gcs.formation.obstacles import Outlines
from gcs.formation.ways_round import way_between, way_round
from gcs.model.lifecycle import Phase
from gcs.model.plan import Obstacle, Target
from gcs.model.state import Array
from gcs.service import CommandRecord, Outcome, ShowAction, VehicleAction
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, fly, show_config
from tests.support.show_phases import running

THERE_M: Final = (70.0, 0.0)
TALL_M: Final = 60.0
BEYOND_FENCE_M: Final = 120.0
SLACK_S, TIMES = 20.0, 2.0
"""All are home within so many times the shortest way, and so much more."""
LOST_AFTER_S: Final = 9.0
"""The vehicles have stopped, and have begun to follow their planned paths."""


def box(name: str, x_m: float, y_m: float, half_x_m: float, half_y_m: float, **more: float) -> Obstacle:
    return Obstacle(name, x_m, y_m, half_x_m, half_y_m, more.pop("height_m", TALL_M), **more)


def wall(drawn: random.Random) -> list[Obstacle]:
    y_m, half_m = drawn.uniform(-6.0, 6.0), drawn.uniform(10.0, 25.0)
    return [box("wall", drawn.uniform(38.0, 44.0), y_m, drawn.uniform(1.0, 3.0), half_m)]


def corner(drawn: random.Random) -> list[Obstacle]:
    """An L about the formation."""
    side, half_m = drawn.choice((-1.0, 1.0)), drawn.uniform(22.0, 28.0)
    return [box("back", 42.0, 0.0, 1.5, half_m), box("arm", 42.0 + 24.0, side * half_m, 24.0, 1.5)]


def pocket(drawn: random.Random) -> list[Obstacle]:
    """A U with its bottom on the way home."""
    half_m, deep_m = drawn.uniform(24.0, 28.0), drawn.uniform(15.0, 24.0)
    arms = [box(f"arm {y:+g}", 42.0 + deep_m, y * half_m, deep_m, 1.5) for y in (-1.0, 1.0)]
    return [box("back", 42.0, 0.0, 1.5, half_m), *arms]


def ring(drawn: random.Random) -> list[Obstacle]:
    """Four walls: no ellipse leaves a door, and the way leads over them."""
    half_m, height_m = drawn.uniform(24.0, 28.0), drawn.uniform(25.0, 60.0)
    (x_m, y_m), walls = THERE_M, []
    for at, (x, y) in enumerate(((-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0))):
        half = (1.5, half_m) if x else (half_m, 1.5)
        walls.append(box(f"wall {at}", x_m + x * half_m, y_m + y * half_m, *half, height_m=height_m))
    return walls


def doorway(drawn: random.Random) -> list[Obstacle]:
    """Four walls too high to be flown over, with a door that their ellipses cover."""
    half_m, door_m, side = drawn.uniform(24.0, 28.0), drawn.uniform(4.0, 8.0), drawn.choice((-1.0, 1.0))
    x_m, y_m = THERE_M
    walls = [box("far", x_m - side * half_m, y_m, 1.5, half_m, height_m=BEYOND_FENCE_M)]
    part_m = (half_m - door_m) / 2.0
    for y in (-1.0, 1.0):
        walls.append(box(f"long {y:+g}", x_m, y_m + y * half_m, half_m, 1.5, height_m=BEYOND_FENCE_M))
        beside_m = y_m + y * (door_m + part_m)
        walls.append(box(f"post {y:+g}", x_m + side * half_m, beside_m, 1.5, part_m, height_m=BEYOND_FENCE_M))
    return walls


def sliding(drawn: random.Random) -> list[Obstacle]:
    """A wall that slides across the way."""
    speed_m_s = drawn.choice((-1.0, 1.0)) * drawn.uniform(0.3, 1.0)
    return [box("slider", 42.0, -10.0 * np.sign(speed_m_s), 1.5, 15.0, velocity_y_m_s=speed_m_s)]


WORLDS: Final[dict[str, Callable[[random.Random], list[Obstacle]]]] = {
    "wall": wall,
    "corner": corner,
    "pocket": pocket,
    "ring": ring,
    "doorway": doorway,
    "sliding": sliding,
}


class Ended(NamedTuple):
    outcomes: set[Outcome]
    took_s: float
    allowed_s: float
    floor_violations: int
    penetrations: int


def config(count: int) -> Config:
    radius_m = max(6.0, 2.5 * count**0.5)
    return show_config(
        count, operation=HOLDS_WHEN_LOST, formation={"radius_m": radius_m, "height_m": radius_m + 8.0}
    )


def shortest_s(show: VirtualShow, start_m: Array, goal_m: Array) -> float:
    """Of the way round all obstacles, up and down included; where none leads round, over or between them."""
    outlines = Outlines.of(ellipses_of(show.view.plan, show.config.control, show.now_s))
    law, limits = show.config.control.law, show.config.control.safety.limits
    here_m, there_m = start_m[:2].copy(), goal_m[:2].copy()
    corner_m, is_way = way_round(
        here_m, there_m, np.array(outlines.center_m), np.array(outlines.semi_m), 300.0
    )
    if outlines.top_height_m.max() > BEYOND_FENCE_M:
        boxes = np.array(outlines.center_m), np.array(outlines.half_length_m)
        corner_m, is_way = way_between(here_m, there_m, *boxes, 300.0)
    places_m = np.vstack([here_m, corner_m, there_m])
    level_s = float(np.linalg.norm(np.diff(places_m, axis=0), axis=1).sum()) / law.speed_m_s
    up_m = 0.0 if is_way else float(outlines.top_height_m.max() + start_m[2])
    return level_s + up_m / limits.up_m_s + (up_m - float(start_m[2])) / limits.down_m_s


def penetrations(show: VirtualShow, since_s: float) -> int:
    """Ticks with a true position within a box."""
    inside: int = 0
    for sample in show.track.between(since_s).samples:
        for each in sample.view.plan.obstacles:
            x_m, y_m = each.position_m(sample.time_s)
            off_m = np.abs(sample.true_m[:, :2] - (x_m, y_m)) - (each.half_length_x_m, each.half_length_y_m)
            inside += int(((off_m < 0.0).all(axis=1) & (-sample.true_m[:, 2] < each.height_m)).any())
    return inside


async def beyond(show: VirtualShow, kind: str, seed: int, *, without: str = "") -> float:
    """Lead the formation (but one, if named) to the place, and build the walls. Returns: when they stood."""
    if without:
        await show.command(without, VehicleAction.HOLD)
    show.service.plan.set_target(Target(*THERE_M))

    def there() -> bool:
        center_m = show.view.center_m
        return center_m is not None and hypot(center_m[0] - THERE_M[0], center_m[1] - THERE_M[1]) < 1.0

    await show.until(there, 90.0)
    await show.wait(8.0)
    for each in WORLDS[kind](random.Random(seed)):
        show.service.plan.add_obstacle(each)
    await show.wait(1.0)
    return show.now_s


async def measured(show: VirtualShow, began_s: float, record: CommandRecord, least_s: float) -> Ended:
    record = await show.settled(record, TIMES * least_s + 3.0 * SLACK_S)
    took_s = show.now_s - began_s
    outcomes = {one.outcome for one in record.outcomes.values()}
    allowed_s = TIMES * least_s + SLACK_S
    return Ended(outcomes, took_s, allowed_s, show.floor_violations(), penetrations(show, began_s))


async def all_return(show: VirtualShow, kind: str, seed: int) -> Ended:
    began_s = await beyond(show, kind, seed)
    home_m = show.track.samples[0].true_m
    ways_s = [shortest_s(show, *places) for places in zip(show.true_m, home_m, strict=True)]
    return await measured(show, began_s, show.service.commands.command_show(ShowAction.STOP), max(ways_s))


async def all_return_past_lost(show: VirtualShow, kind: str, seed: int) -> Ended:
    """A fifth of the vehicles lose their links on the way home, and hang in the air."""
    began_s = await beyond(show, kind, seed)
    home_m = show.track.samples[0].true_m
    ways_s = [shortest_s(show, *places) for places in zip(show.true_m, home_m, strict=True)]
    record = show.service.commands.command_show(ShowAction.STOP)
    await show.wait(LOST_AFTER_S)
    lost = show.config.ids[1::5]
    for each in lost:
        show.ports.silence(each)
    record = await show.settled(record, TIMES * max(ways_s) + 3.0 * SLACK_S)
    outcomes = {outcome.outcome for each, outcome in record.outcomes.items() if each not in lost}
    took_s, allowed_s = show.now_s - began_s, TIMES * max(ways_s) + SLACK_S
    return Ended(outcomes, took_s, allowed_s, show.floor_violations(), penetrations(show, began_s))


async def one_returns(show: VirtualShow, kind: str, seed: int) -> Ended:
    began_s = await beyond(show, kind, seed)
    way_s = shortest_s(show, show.true_m[0], show.track.samples[0].true_m[0])
    record = show.service.commands.command_vehicle("d1", VehicleAction.RETURN)
    return await measured(show, began_s, record, way_s)


async def one_joins(show: VirtualShow, kind: str, seed: int) -> Ended:
    began_s = await beyond(show, kind, seed, without="d1")
    show.service.commands.command_vehicle("d1", VehicleAction.JOIN)
    way_s = shortest_s(show, show.true_m[0], np.array([*THERE_M, show.true_m[0, 2]]))
    allowed_s = TIMES * way_s + SLACK_S

    def there() -> bool:
        center_m = show.view.center_m
        assert center_m is not None
        off_m = float(np.linalg.norm(show.true_m[0] - center_m)) - show.view.plan.formation.radius_m
        return show.vehicle("d1").phase is Phase.FORMATION and abs(off_m) < 1.0

    took_s = await show.until(there, allowed_s + 2.0 * SLACK_S)
    return Ended({Outcome.DONE}, took_s, allowed_s, show.floor_violations(), penetrations(show, began_s))


STORIES: Final = {
    "return": all_return,
    "return-past-lost": all_return_past_lost,
    "one-returns": one_returns,
    "join": one_joins,
}
SOAKED: Final = 14
"""Worlds of each kind and story: 322 in all."""


def is_short(story: str, kind: str) -> bool:
    """For `make test`: a return of all out of a pocket."""
    return story == "return" and kind == "pocket"


def cases() -> list[object]:
    return [
        pytest.param(story, kind, seed, marks=() if seed == 0 and is_short(story, kind) else pytest.mark.soak)
        for story in STORIES
        for kind in WORLDS
        for seed in range(SOAKED)
        if (story, kind) != ("return-past-lost", "doorway")  # lost vehicles may close a doorway
    ]


@pytest.mark.soak
@pytest.mark.parametrize(("story", "kind", "seed"), cases())
def test_vehicles_find_their_way_past_walls(story: str, kind: str, seed: int) -> None:
    count = (4, 8, 20)[seed % 3]
    about = {"grid_columns": ceil(count**0.5), "spacing_m": 5.0}
    flown = fly(partial(STORIES[story], kind=kind, seed=seed), config(count), after=running, **about)
    assert flown.outcomes == {Outcome.DONE}
    assert flown.took_s <= flown.allowed_s
    assert flown.floor_violations == 0
    assert flown.penetrations == 0
