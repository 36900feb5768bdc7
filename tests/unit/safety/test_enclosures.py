"""What boxes shut off from each other: only what is sure."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
import scipy.ndimage

from gcs.control import ControlSettings
from gcs.control.round_obstacles import shut_in_by
from gcs.formation.obstacles import Ellipse
from gcs.model.plan import Obstacle
from gcs.safety.enclosures import Enclosures
from gcs.safety.fenced_areas import FencedArea, beyond_m
from gcs.safety.walls import Fence

MARGIN_M = 2.0
INSIDE, OUT = np.array([[1.0, -2.0, -10.0]]), np.array([[40.0, 3.0, -10.0]])


def around(box: Obstacle) -> Ellipse:
    return Ellipse.around(box, margin_m=MARGIN_M, headroom_m=2.0)


def ring(*, half_m: float = 15.0, door_m: float = 0.0) -> list[Ellipse]:
    """Four walls about the origin; the door is in the wall at +x, its margins not counted."""
    ends_m = [(-half_m, -door_m / 2.0), (door_m / 2.0, half_m)]
    doored = [
        Obstacle(f"door {low_m}", half_m, (low_m + high_m) / 2.0, 1.0, (high_m - low_m) / 2.0, 60.0)
        for low_m, high_m in ends_m
    ]
    across = [Obstacle(f"wall {y_m}", 0.0, y_m, half_m + 1.0, 1.0, 60.0) for y_m in (-half_m, half_m)]
    return [around(box) for box in (*doored, *across, Obstacle("back", -half_m, 0.0, 1.0, half_m, 60.0))]


def shut(walls: list[Ellipse], over_m: float = 40.0) -> tuple[bool, bool]:
    """Whether the middle is apart from the outside, and the other way round."""
    enclosures = Enclosures.of(walls, over_m)
    if enclosures is None:
        return False, False
    return bool(enclosures.apart(INSIDE, OUT)[0]), bool(enclosures.apart(OUT, INSIDE)[0])


@pytest.mark.parametrize("half_m", [8.0, 15.0, 200.0])
def test_a_closed_ring_shuts_off(half_m: float) -> None:
    enclosures = Enclosures.of(ring(half_m=half_m), 40.0)
    assert enclosures is not None
    far_m = np.array([[half_m + 30.0, 0.0, -10.0]])
    assert enclosures.apart(
        np.vstack([INSIDE, INSIDE, far_m]), np.vstack([far_m, -INSIDE, -far_m])
    ).tolist() == [
        True,
        False,
        False,
    ]


@pytest.mark.parametrize(("door_m", "is_shut"), [(3.0, True), (4.6, False), (9.0, False)])
def test_a_door_wider_than_its_margins_is_a_way(door_m: float, is_shut: bool) -> None:
    assert shut(ring(door_m=door_m)) == (is_shut, is_shut)


@pytest.mark.parametrize("creeps_m_s", [0.02, -0.05])
def test_walls_that_creep_shut_off_as_they_do_at_rest(creeps_m_s: float) -> None:
    """Their places are measured: none has a speed of exactly 0."""
    creeping = [replace(each, velocity_x_m_s=creeps_m_s, x_m=each.x_m + 0.033) for each in ring()]
    assert shut(creeping) == (True, True)
    doored = [replace(each, velocity_x_m_s=creeps_m_s) for each in ring(door_m=4.6)]
    assert shut(doored) == (False, False)


def test_a_wall_that_moves_shuts_nothing_off() -> None:
    first, *rest = ring()
    assert shut([replace(first, velocity_x_m_s=0.1), *rest]) == (False, False)


def test_walls_that_can_be_flown_over_shut_nothing_off() -> None:
    assert shut(ring(), over_m=70.0) == (False, False)


@pytest.mark.parametrize("away_m", [2e4, 1e9, 1e160])
def test_a_box_far_away_changes_nothing(away_m: float) -> None:
    """A box at 1e160 m ended every tick; one at 20 km made the cells too wide to see a ring of walls."""
    far = around(Obstacle("far", away_m, -away_m, 1.0, 1.0, 60.0))
    assert shut([*ring(), far]) == shut(ring())
    assert Enclosures.of([far], 40.0) is None


def test_a_place_within_a_margin_counts_as_where_it_is_led_out() -> None:
    enclosures = Enclosures.of(ring(), 40.0)
    assert enclosures is not None
    inner_m, outer_m = np.array([[12.5, 0.0, -10.0]]), np.array([[17.5, 0.0, -10.0]])
    assert enclosures.apart(inner_m, OUT).tolist() == [True]
    assert enclosures.apart(outer_m, OUT).tolist() == [False]
    assert enclosures.apart(outer_m, INSIDE).tolist() == [True]


def test_of_an_unknown_place_nothing_is_said() -> None:
    enclosures = Enclosures.of(ring(), 40.0)
    assert enclosures is not None
    nowhere = np.full((1, 3), np.nan)
    assert enclosures.apart(nowhere, OUT).tolist() == [False]
    assert enclosures.apart(INSIDE, nowhere).tolist() == [False]
    assert enclosures.apart(INSIDE[:0], OUT[:0]).tolist() == []


@pytest.mark.parametrize("climbs", [True, False])
def test_a_ring_shuts_in_also_where_nothing_may_climb(climbs: bool) -> None:
    """Without `climbs` no vehicle above the least height was shut in."""
    settings = ControlSettings()
    avoidance = settings.law.avoidance.model_copy(update={"climbs": climbs})
    fence = settings.safety.fence.model_copy(update={"height_max_m": 40.0})
    law = settings.law.model_copy(update={"avoidance": avoidance})
    safety = settings.safety.model_copy(update={"fence": fence})
    settings = settings.model_copy(update={"law": law, "safety": safety})
    walls = {str(number): each for number, each in enumerate(ring())}
    assert shut_in_by(walls, INSIDE, OUT, settings).tolist() == [True]


REACH_M = 60.0
OPEN_M = 22.0
"""The walls of `u_shape` end there, with their margins 2 m beyond."""


def u_shape() -> list[Ellipse]:
    """Walls about the origin on all sides but +x."""
    across = [Obstacle(f"wall {y_m}", 4.0, y_m, 18.0, 1.0, 60.0) for y_m in (-15.0, 15.0)]
    return [around(box) for box in (*across, Obstacle("back", -13.0, 0.0, 1.0, 15.0, 60.0))]


def strip(low_m: float, high_m: float, *, inside: bool = False, **heights_m: float) -> FencedArea:
    """An area from x to x, 80 m wide."""
    corners_m = ((low_m, -40.0), (high_m, -40.0), (high_m, 40.0), (low_m, 40.0))
    return FencedArea(corners_m=corners_m, inside=inside, **heights_m)


def shut_with(fence: Fence, walls: list[Ellipse]) -> bool:
    settings = ControlSettings()
    settings = settings.model_copy(update={"safety": settings.safety.model_copy(update={"fence": fence})})
    away_m = np.array([[-30.0, 3.0, -10.0]])
    both = [
        shut_in_by({str(number): each for number, each in enumerate(walls)}, *way_m, settings).tolist()
        for way_m in ((INSIDE, away_m), (away_m, INSIDE))
    ]
    assert both[0] == both[1]
    return bool(both[0][0])


LOW = Fence(height_max_m=40.0, distance_max_m=REACH_M)


def test_a_box_beyond_the_fence_hides_no_ring() -> None:
    """One at 9 km made cells of 45 m: a ring of walls was none."""
    far = around(Obstacle("far", 9000.0, -9000.0, 1.0, 1.0, 60.0))
    assert shut_with(LOW, [*ring(), far])
    assert not shut_with(LOW, [*ring(door_m=9.0), far])


@pytest.mark.parametrize(
    ("fence", "is_shut"),
    [
        (LOW, False),
        (LOW.model_copy(update={"distance_max_m": 20.0}), True),
        (LOW.model_copy(update={"distance_max_m": OPEN_M + 8.0}), False),
        (LOW.model_copy(update={"areas": (strip(OPEN_M, 40.0),)}), True),
        (LOW.model_copy(update={"areas": (strip(OPEN_M + 6.0, 40.0),)}), False),
        (LOW.model_copy(update={"areas": (strip(-35.0, OPEN_M, inside=True),)}), True),
        (LOW.model_copy(update={"areas": (strip(-35.0, OPEN_M + 6.0, inside=True),)}), False),
        (LOW.model_copy(update={"areas": (strip(OPEN_M, 40.0, height_max_m=20.0),)}), False),
        (LOW.model_copy(update={"areas": (strip(OPEN_M, 40.0, height_min_m=20.0),)}), False),
        (LOW.model_copy(update={"areas": (strip(OPEN_M, 40.0, height_max_m=39.0),)}), True),
    ],
)
def test_what_the_fence_closes_shuts_off_too(fence: Fence, is_shut: bool) -> None:
    """Where the walls alone leave an opening; such vehicles were named after 20 s."""
    assert shut_with(fence, u_shape()) == is_shut


def test_no_areas_and_no_walls_shut_nothing_off() -> None:
    assert not shut_with(LOW.model_copy(update={"areas": (strip(-20.0, -10.0),)}), [])


class World(NamedTuple):
    boxes: list[Obstacle]
    fence: Fence


def random_world(random: np.random.Generator) -> World:
    """Boxes, at most one area that vehicles stay inside of, at most two others, and a circle."""
    boxes = []
    for k in range(int(random.integers(1, 6))):
        (x_m, y_m), (half_x_m, half_y_m) = random.uniform(-25.0, 25.0, 2), random.uniform(0.5, 14.0, 2)
        boxes.append(Obstacle(f"box {k}", x_m, y_m, half_x_m, half_y_m, 60.0))
    areas = []
    for k in range(int(random.integers(0, 4))):
        turn_rad = np.sort(random.uniform(0.0, 2.0 * np.pi, int(random.integers(3, 8))))
        reach_m = random.uniform(20.0, 40.0) if k == 0 else random.uniform(3.0, 20.0)
        middle_m = np.zeros(2) if k == 0 else random.uniform(-25.0, 25.0, 2)
        ring_m = middle_m + reach_m * np.column_stack([np.cos(turn_rad), np.sin(turn_rad)])
        areas.append(FencedArea(corners_m=tuple(map(tuple, ring_m.tolist())), inside=k == 0))
    reach_m = float(random.uniform(15.0, 45.0))
    return World(boxes, Fence(height_max_m=40.0, distance_max_m=reach_m, areas=tuple(areas)))


def test_what_is_connected_is_never_shut_off() -> None:
    """Compared with places every 0.25 m, each examined on its own, in 60 random worlds."""
    random, axis_m, shutting = np.random.default_rng(1), np.arange(-50.0, 50.0, 0.25), 0
    places_m = np.stack(np.meshgrid(axis_m, axis_m, indexing="ij"), axis=-1).reshape(-1, 2)
    for _ in range(60):
        world = random_world(random)
        free = np.hypot(*places_m.T) <= world.fence.distance_max_m
        free &= beyond_m(world.fence.areas, places_m) <= 0.0
        for box in world.boxes:
            off_m = np.abs(places_m - (box.x_m, box.y_m)) - (box.half_length_x_m, box.half_length_y_m)
            free &= off_m.max(axis=1) >= MARGIN_M
        enclosures = Enclosures.of(map(around, world.boxes), 40.0, world.fence)
        if enclosures is None or not free.any():
            continue
        connected, _ = scipy.ndimage.label(free.reshape(len(axis_m), len(axis_m)))
        begins, ends = random.choice(np.flatnonzero(free), (2, 400))
        together = connected.ravel()[begins] == connected.ravel()[ends]
        apart = enclosures.apart(places_m[begins], places_m[ends])
        assert not (apart & together).any()
        shutting += bool(apart.any())
    assert shutting > 10
