"""Descending vehicles that were pushed off their places, close above the ground."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.control import ControlSettings, Memory, Task, Tasks, tick
from gcs.control.landing_beside import Ground, landing_beside
from gcs.formation.obstacles import Ellipse
from gcs.model.plan import Formation, Plan, Target
from gcs.model.state import Array, FleetState, Traits
from gcs.safety.fenced_areas import FencedArea
from gcs.safety.surroundings import SafetySettings
from gcs.safety.walls import Fence

SAFETY = SafetySettings()
NO_PATHS = np.zeros((0, 2, 3))
FAR_M = (60.0, 0.0, -30.0)

ALONE = Ground(
    np.array([(3.0, 0.0, -1.0), FAR_M]),
    np.array([(0.0, 0.0, 0.0), (60.0, 0.0, 0.0)]),
    np.full(2, 0.05),
    NO_PATHS,
    {},
    (),
    100.0,
)
"""The first is 3 m off its place, 1 m above the ground; the other is far from both."""

BOX = Ellipse(20.0, 0.0, 5.0, 5.0, 60.0)
CLOSED = FencedArea(inside=False, corners_m=((2.0, -2.0), (6.0, -2.0), (6.0, 2.0), (2.0, 2.0)))


def of_first(ground: Ground, safety: SafetySettings = SAFETY) -> tuple[bool, bool, bool]:
    """Of the first: whether it descends, lands where it is, and stays low."""
    landing = landing_beside(ground, np.array([True, False]), safety)
    below = bool((landing.goal_m[0, :2] == ground.position_m[0, :2]).all())
    return bool(landing.descending[0]), below, bool(landing.low[0])


def moved(ground: Ground, row: int, place_m: tuple[float, float, float]) -> Ground:
    position_m = ground.position_m.copy()
    position_m[row] = place_m
    return replace(ground, position_m=position_m)


def led(ground: Ground, row: int, goal_m: tuple[float, float, float]) -> Ground:
    goals_m = ground.goal_m.copy()
    goals_m[row] = goal_m
    return replace(ground, goal_m=goals_m)


def test_above_its_place_it_descends_onto_it() -> None:
    assert of_first(moved(ALONE, 0, (1.5, 0.0, -1.0))) == (True, False, False)


def test_low_and_off_its_place_it_lands_where_it_is() -> None:
    assert of_first(ALONE) == (True, True, False)


def test_higher_it_goes_back_to_its_place() -> None:
    assert of_first(moved(ALONE, 0, (3.0, 0.0, -2.5))) == (False, False, False)


def test_led_to_another_place_it_climbs_there() -> None:
    assert of_first(led(ALONE, 0, (20.0, 0.0, -5.0))) == (False, False, False)


def test_one_without_a_position_lands() -> None:
    assert of_first(moved(ALONE, 0, (np.nan, np.nan, np.nan))) == (True, False, False)


def test_beside_one_that_has_landed_it_stays_low() -> None:
    assert of_first(moved(ALONE, 1, (4.8, 0.0, 0.0))) == (False, False, True)


CLOSED_TO_IT = {
    "the place of another": led(ALONE, 1, (4.0, 0.0, 0.0)),
    "a box": replace(ALONE, ellipses={"box": replace(BOX, x_m=7.0)}),
    "a box that comes": replace(ALONE, ellipses={"box": replace(BOX, velocity_x_m_s=-3.0)}),
    "a person": replace(ALONE, targets=(Target(5.0, 0.0, clearance_m=5.0),)),
    "the path of a lost vehicle": replace(ALONE, path_m=np.array([[(4.0, 0.0, -9.0), (4.0, 0.0, 0.0)]])),
}


@pytest.mark.parametrize("comes_m_s", [-2.0, -3.0, -6.0, -12.0])
@pytest.mark.parametrize("after_s", [0.5, 2.0, 4.5])
def test_it_lands_before_no_box_that_comes(comes_m_s: float, after_s: float) -> None:
    """Also before one that has passed again 5 s later: it ran over the vehicle as it touched down."""
    box = replace(BOX, x_m=3.0 - comes_m_s * after_s, velocity_x_m_s=comes_m_s)
    assert of_first(replace(ALONE, ellipses={"box": box})) == (False, False, False)
    away = replace(box, velocity_x_m_s=-comes_m_s, x_m=3.0 + 6.0 - comes_m_s)
    assert of_first(replace(ALONE, ellipses={"box": away})) == (True, True, False)


@pytest.mark.parametrize("ground", CLOSED_TO_IT.values(), ids=CLOSED_TO_IT)
def test_where_the_ground_is_not_clear_it_goes_back(ground: Ground) -> None:
    assert of_first(ground) == (False, False, False)


def test_a_box_that_goes_away_closes_nothing() -> None:
    assert of_first(replace(ALONE, ellipses={"box": replace(BOX, velocity_x_m_s=3.0)})) == (True, True, False)


def test_it_does_not_land_in_a_closed_area() -> None:
    safety = SAFETY.model_copy(update={"fence": Fence(areas=(CLOSED,))})
    assert of_first(ALONE, safety) == (False, False, False)


def flown_m_s(position_m: Array, goal_m: Array, descending: list[bool], in_air: list[bool]) -> Array:
    """(n, 3) what a tick sends."""
    n, settings = len(position_m), ControlSettings()
    ids = tuple(f"d{i}" for i in range(n))
    fleet = FleetState(100.0, ids, position_m, np.zeros((n, 3)), np.zeros(n), np.zeros(n))
    task = np.where(in_air, Task.GOAL, Task.NONE).astype(np.int8)
    tasks = Tasks(task, goal_m, np.array(in_air), np.array(descending), NO_PATHS)
    memory = Memory.fresh(n, 99.95)
    setpoints = tick(fleet, tasks, Plan(Formation(10.0, 30.0)), Traits.alike(n), memory, settings).setpoints
    sent_m_s = np.zeros((n, 3))
    sent_m_s[[int(name[1:]) for name in setpoints.ids]] = setpoints.velocity_m_s
    return sent_m_s


def test_it_comes_straight_down_beside_its_place() -> None:
    sent_m_s = flown_m_s(ALONE.position_m.copy(), ALONE.goal_m.copy(), [True, False], [True, True])
    assert sent_m_s[0, 2] > 0.0
    assert np.hypot(*sent_m_s[0, :2]) < 1e-6


def test_it_climbs_past_no_vehicle_on_the_ground() -> None:
    """At 1.5 m from one that has landed it had climbed at once: past that, at less than the floor."""
    position_m = np.array([(3.0, 0.0, -0.3), (4.5, 0.0, 0.0)])
    goal_m = np.array([(0.0, 0.0, 0.0), (4.5, 0.0, 0.0)])
    sent_m_s = flown_m_s(position_m, goal_m, [True, True], [True, False])
    up_m_s, away_m_s = -sent_m_s[0, 2], -sent_m_s[0, 0]
    assert away_m_s > 0.2
    assert up_m_s < 0.2 * away_m_s


@pytest.mark.parametrize("height_m", [0.0, 5.0])
def test_low_it_does_not_fly_into_one_on_the_ground(height_m: float) -> None:
    """Not even to a place behind that, nor to above one."""
    position_m = np.array([(3.0, 0.0, -1.0), (5.0, 0.0, 0.0)])
    goal_m = np.array([(9.0, 0.0, -height_m), (5.0, 0.0, 0.0)])
    sent_m_s = flown_m_s(position_m, goal_m, [True, False], [True, False])
    assert sent_m_s[0, 0] < 0.0
    assert -sent_m_s[0, 2] < 0.2
