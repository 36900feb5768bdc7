"""What boxes shut off from each other: only what is sure."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.control import ControlSettings
from gcs.control.round_obstacles import shut_in_by
from gcs.formation.enclosures import Enclosures
from gcs.formation.obstacles import Ellipse
from gcs.model.plan import Obstacle

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
