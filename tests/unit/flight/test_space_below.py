"""What keeps a vehicle from landing where it is, and what it hits if it does."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs.flight.monitors.space_below import UNKNOWN_PLACE, Below, SpaceBelow
from gcs.flight.state.flight import Flight
from gcs.model.lifecycle import Phase
from gcs.model.plan import Obstacle, Target
from gcs.model.state import Array, FleetState
from gcs.safety.fenced_areas import FencedArea
from gcs.safety.walls import Fence
from tests.unit.flight.test_assembled import flight

STILL = np.zeros(2)
SQUARE = ((-8.0, -8.0), (8.0, -8.0), (8.0, 8.0), (-8.0, 8.0))


def above(
    *others_m: tuple[float, float, float], here_m: tuple[float, float, float] = (0.0, 0.0, -12.0)
) -> Flight:
    """d0 lands from 12 m, and the others stand or fly where they are."""
    subject = flight(1 + len(others_m))
    for vehicle in subject.vehicles.values():
        vehicle.phase = Phase.LANDING
    place_m, n = np.array([here_m, *others_m]), 1 + len(others_m)
    ids, zero = subject.newest.state.ids, np.zeros(n)
    subject.newest.state = FleetState(1.0, ids, place_m, np.zeros((n, 3)), zero, zero)
    return subject


def of(subject: Flight, drift_m_s: Array = STILL) -> Below:
    return SpaceBelow(subject).of(subject.vehicles["d0"], drift_m_s)


def fenced(subject: Flight, **fence: Any) -> Flight:
    safety = subject.in_force.control.safety.model_copy(update={"fence": Fence(**fence)})
    subject.in_force.control = subject.in_force.control.model_copy(update={"safety": safety})
    return subject


def test_open_ground_is_free() -> None:
    below = of(above())
    assert (below.in_the_way, below.hits) == ((), ())
    assert below.end_m == pytest.approx((0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("other_m", "waits", "hits"),
    [
        ((1.0, 0.0, 0.0), True, True),
        ((3.5, 0.0, 0.0), True, False),
        ((3.5, 0.0, -9.0), True, False),
        ((1.0, 0.0, -17.0), False, False),
        ((6.0, 0.0, 0.0), False, False),
    ],
)
def test_vehicles_below_are_kept_off_twice_the_least(
    other_m: tuple[float, float, float], *, waits: bool, hits: bool
) -> None:
    """Sideways; one above it waits itself."""
    below = of(above(other_m))
    assert below.in_the_way == (("d1",) if waits else ())
    assert below.hits == (("d1",) if hits else ())


def test_wind_carries_it_over_one_that_stands_farther_on() -> None:
    subject = above((50.0, 1.0, 0.0))
    subject.vehicles["d1"].phase = Phase.STANDBY
    assert of(subject).in_the_way == ()
    assert of(subject, np.array([4.0, 0.0])).in_the_way == ("d1",)
    assert of(subject, np.array([-4.0, 0.0])).in_the_way == ()


def test_a_lost_vehicle_is_where_it_was_seen() -> None:
    subject = above((1.0, 0.0, -3.0))
    subject.note_seen(np.ones(2, np.bool_))
    subject.vehicles["d1"].phase = Phase.LOST
    place_m = subject.newest.state.position_m.copy()
    place_m[1] = np.nan
    subject.newest.state = replace(subject.newest.state, position_m=place_m)
    assert "d1" in of(subject).in_the_way


def test_people_are_waited_for_and_named() -> None:
    subject = above()
    subject.newest.kept_clear = {
        "anna": Target(x_m=7.0, clearance_m=5.0),
        "car": Target(x_m=60.0, clearance_m=5.0),
    }
    subject.in_force.plan = replace(subject.in_force.plan, target=Target(x_m=-2.0, clearance_m=3.0))
    below = of(subject)
    assert below.in_the_way == below.hits == ("target anna", "the target")


def test_obstacles_and_closed_areas_are_waited_for() -> None:
    subject = fenced(above(), areas=(FencedArea(corners_m=SQUARE, inside=False),))
    hall = Obstacle("hall", 0.0, 0.0, 6.0, 6.0, 5.0)
    subject.in_force.plan = replace(subject.in_force.plan, obstacles=(hall,))
    assert of(subject).in_the_way == ("a closed area", "obstacle hall")
    assert of(subject, np.array([3.0, 0.0])).in_the_way == ()


@pytest.mark.parametrize(
    ("fence", "hits"),
    [
        ({"controlled_ground": FencedArea(corners_m=SQUARE)}, "ground that is not controlled"),
        ({"areas": (FencedArea(corners_m=SQUARE),)}, "ground outside the fence"),
    ],
)
def test_ground_outside_the_site_is_named_and_not_waited_for(fence: Mapping[str, Any], hits: str) -> None:
    """Farther on it is no better."""
    subject = fenced(above(), **fence)
    assert of(subject).hits == ()
    below = of(subject, np.array([2.0, 0.0]))
    assert (below.in_the_way, below.hits) == ((), (hits,))


def test_an_unknown_position_may_be_above_anything() -> None:
    assert of(above(here_m=(np.nan, np.nan, np.nan))).in_the_way == (UNKNOWN_PLACE,)
