"""Room among the areas of a fence for a sphere on its orbit; refusals name the metres that are missing."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.control import ControlSettings
from gcs.formation.orbit import CLEAR_OF_FENCE_M
from gcs.model.errors import InvalidError
from gcs.model.plan import Formation, Orbit, Target
from gcs.planning.area_room import Space, lacking_m, space_of
from gcs.planning.feasibility import check_target
from gcs.safety.fenced_areas import FencedArea, beyond_m
from tests.support.fields import ELL

INSIDE = FencedArea(corners_m=tuple((float(x), float(y)) for x, y in ELL))
MAST = FencedArea(corners_m=((-2.0, -2.0), (-2.0, 2.0), (2.0, 2.0), (2.0, -2.0)), inside=False)
FORMATION, ORBIT = Formation(radius_m=10.0, height_m=20.0), Orbit(radius_m=0.0, speed_m_s=1.0)
USUAL = ControlSettings()


def fenced(*areas: FencedArea) -> ControlSettings:
    fence = USUAL.safety.fence.model_copy(update={"areas": areas})
    return USUAL.model_copy(update={"safety": USUAL.safety.model_copy(update={"fence": fence})})


def test_what_is_missing_is_what_a_vehicle_would_be_beyond() -> None:
    """Vehicles on the ring about a place: the farthest of them beyond the area, and what is kept clear."""
    random = np.random.default_rng(1)
    place_m = random.uniform(-60.0, 120.0, (200, 2))
    swept = np.column_stack([np.zeros(200), random.uniform(1.0, 30.0, 200)])
    turn = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    lack = lacking_m([INSIDE], Space(place_m, swept, np.full((200, 2), 20.0)), 0.0).lack_m
    for at in range(200):
        out_m = beyond_m([INSIDE], place_m[at] + swept[at, 1] * ring).max()
        assert (lack[at] > 0.3) <= (out_m > 0.0), at
        assert (out_m > 0.3) <= (lack[at] > 0.0), at


def test_a_mast_may_stand_inside_of_an_orbit() -> None:
    orbit = replace(ORBIT, radius_m=30.0)
    around = space_of((0.0, 0.0), orbit, FORMATION)
    assert around.ring_m.tolist() == [[20.0, 40.0]]
    assert lacking_m([MAST], around, 5.0).lack_m[0] <= 0.0
    near = space_of((0.0, 16.0), orbit, FORMATION)
    assert lacking_m([MAST], near, 5.0).lack_m[0] == pytest.approx(np.hypot(2.0, 18.0) + 5.0 - 20.0)


def test_an_area_is_flown_over_where_its_height_allows() -> None:
    """The sphere is from 10 to 30 m high, and keeps 2 m over a tree."""
    for top_m, lack_m in ((7.0, -1.0), (9.0, 1.0), (None, 4.83)):
        tree = MAST.model_copy(update={"height_max_m": top_m})
        above = space_of((0.0, 0.0), ORBIT, FORMATION)
        assert lacking_m([tree], above, 2.0).lack_m[0] == pytest.approx(lack_m, abs=0.01)
    hanging = MAST.model_copy(update={"height_min_m": 40.0})
    assert lacking_m([hanging], space_of((0.0, 0.0), ORBIT, FORMATION), 2.0).lack_m[0] == -8.0


def test_vehicles_that_might_fall_outside_lack_room() -> None:
    """The higher the sphere, the more ground its vehicles need around it."""
    target, formation = Target(x_m=0.0, y_m=60.0), Formation(radius_m=10.0, height_m=20.0)
    fence = USUAL.safety.fence.model_copy(update={"controlled_ground": INSIDE})
    safety = USUAL.safety.model_copy(update={"fence": fence})
    control = USUAL.model_copy(update={"safety": safety})
    check_target(target, ORBIT, formation, control)
    high = replace(formation, height_m=95.0)
    with pytest.raises(InvalidError, match=r"m are missing to the edge of the controlled ground, on which"):
        check_target(target, ORBIT, high, control)


@pytest.mark.parametrize("changed", ["target", "orbit", "formation"])
def test_a_plan_without_room_is_refused_with_the_metres(changed: str) -> None:
    target, control = Target(x_m=0.0, y_m=100.0), fenced(INSIDE)
    lack_m = 100.0 + 12.0 + (0.1 if changed == "orbit" else 0.0) + CLEAR_OF_FENCE_M - 110.0
    formation = replace(FORMATION, radius_m=12.0)
    orbit = replace(ORBIT, radius_m=12.0) if changed == "orbit" else ORBIT
    other = replace(FORMATION, radius_m=0.1) if changed == "orbit" else formation
    with pytest.raises(InvalidError) as error:
        check_target(target, orbit, other, control, changed=changed)  # type: ignore[arg-type]
    assert f"{np.ceil(lack_m * 10) / 10:.1f} m are missing to area 1" in str(error.value)
    if changed != "target":
        most_m = float(str(error.value).split("at most ")[1].split(" m")[0])
        accepted = replace(orbit, radius_m=most_m) if changed == "orbit" else orbit
        sphere = replace(other, radius_m=most_m) if changed == "formation" else other
        check_target(target, accepted, sphere, control, changed=changed)  # type: ignore[arg-type]


def test_a_lack_that_was_there_before_refuses_no_smaller_plan() -> None:
    """A followed target may have left the areas: its formation can still be made smaller."""
    target, control = Target(x_m=0.0, y_m=130.0), fenced(INSIDE)
    smaller = replace(FORMATION, radius_m=8.0)
    check_target(target, ORBIT, smaller, control, changed="formation", instead_of=(ORBIT, FORMATION))
    with pytest.raises(InvalidError, match="less does not help, move the target first"):
        check_target(target, ORBIT, FORMATION, control, changed="formation", instead_of=(ORBIT, smaller))


def test_without_areas_nothing_is_missing() -> None:
    check_target(Target(x_m=0.0, y_m=200.0), ORBIT, FORMATION, USUAL)
