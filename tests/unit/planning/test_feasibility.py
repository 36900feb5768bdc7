"""A wish that does not fit is refused with what would, and what would is then accepted."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from gcs.control import ControlSettings
from gcs.formation.laws.settings import FlownLawSettings
from gcs.formation.obstacles import AvoidanceSettings
from gcs.model.errors import InvalidError, RefusedError
from gcs.model.plan import MAX_OBSTACLES, Formation, Obstacle, Orbit, Plan, Target
from gcs.planning.feasibility import (
    check_formation,
    check_obstacle,
    check_orbit,
    check_target,
    followed,
    smallest_formation_radius_m,
)
from gcs.safety.constraints import Braking
from gcs.safety.floor import Floor
from gcs.safety.surroundings import SafetySettings
from gcs.safety.walls import Fence

SAFETY = SafetySettings(
    floor=Floor(horizontal_m=2.0, vertical_m=3.0, margin_m=1.0, uncertainty_m=0.0),
    fence=Fence(height_min_m=3.0, height_max_m=100.0, distance_max_m=300.0),
)
CONTROL = ControlSettings(
    safety=SAFETY, law=FlownLawSettings(center_speed_max_m_s=4.0, center_acceleration_max_m_s2=1.0)
)
AVOIDANCE = AvoidanceSettings(margin_m=2.0, headroom_m=3.0, near_m=3.0)


def describe(check: Callable[[], None], field: str) -> float:
    """The number that the refusal says would work."""
    with pytest.raises(InvalidError) as refused:
        check()
    assert refused.value.field == field
    found = re.search(r"(?:least|most|within|centre's) ([\d.]+)", refused.value.allowed)
    assert found is not None, refused.value.allowed
    return float(found[1])


def test_smallest_radius_follows_floor_margin_and_number() -> None:
    # 3 m horizontally means 4.5 m in every direction; 4.5 sqrt(8) / 3.1 = 4.106, told as 4.2
    assert smallest_formation_radius_m(8, SAFETY) == 4.2
    assert smallest_formation_radius_m(1, SAFETY) == 0.0


@pytest.mark.parametrize("count", [2, 3, 4, 8, 13, 50, 250])
def test_too_small_sphere_names_an_accepted_radius(count: int) -> None:
    radius_m = describe(lambda: check_formation(Formation(0.5, 50.0), count, SAFETY), "radius_m")
    check_formation(Formation(radius_m, 50.0), count, SAFETY)
    with pytest.raises(InvalidError):
        check_formation(Formation(radius_m - 0.2, 50.0), count, SAFETY)


@pytest.mark.parametrize("radius_m", [5.04, 5.05, 4.25, 1.1, 10.0])
def test_sphere_too_low_or_high_names_an_accepted_height(
    radius_m: float,
) -> None:
    lowest_m = describe(lambda: check_formation(Formation(radius_m, 3.5), 1, SAFETY), "height_m")
    check_formation(Formation(radius_m, lowest_m), 1, SAFETY)
    assert lowest_m - radius_m < 3.2
    highest_m = describe(lambda: check_formation(Formation(radius_m, 99.5), 1, SAFETY), "height_m")
    check_formation(Formation(radius_m, highest_m), 1, SAFETY)


@pytest.mark.parametrize("speed_m_s", [2.5, 1.0, 3.3, 4.0])
def test_too_tight_orbit_names_an_accepted_radius(speed_m_s: float) -> None:
    radius_m = describe(lambda: check_orbit(Orbit(0.3, speed_m_s), CONTROL.law), "radius_m")
    check_orbit(Orbit(radius_m, speed_m_s), CONTROL.law)
    check_orbit(Orbit(0.0, speed_m_s), CONTROL.law)
    assert radius_m == pytest.approx(speed_m_s**2, abs=0.1)


def test_too_fast_orbit_names_an_accepted_speed() -> None:
    speed_m_s = describe(lambda: check_orbit(Orbit(50.0, 4.1), CONTROL.law), "speed_m_s")
    check_orbit(Orbit(50.0, speed_m_s), CONTROL.law)


def test_a_target_too_fast_is_refused() -> None:
    target = Target(velocity_x_m_s=3.0, velocity_y_m_s=3.0)
    assert describe(lambda: check_target(target, Orbit(), Formation(5.0, 20.0), CONTROL), "velocity") == 4.0


@pytest.mark.parametrize("radius_m", [5.0, 7.77, 12.34])
def test_target_with_orbit_across_the_fence_names_a_distance(
    radius_m: float,
) -> None:
    formation, orbit = Formation(radius_m, 20.0), Orbit(15.0, 2.0)
    within_m = describe(lambda: check_target(Target(300.0, 0.0), orbit, formation, CONTROL), "position")
    check_target(Target(within_m, 0.0), orbit, formation, CONTROL)


def test_too_wide_orbit_at_the_target_is_refused_by_its_radius() -> None:
    formation, target = Formation(10.0, 20.0), Target(100.0, 0.0)
    radius_m = describe(
        lambda: check_target(target, Orbit(5000.0), formation, CONTROL, changed="orbit"), "radius_m"
    )
    assert radius_m == 300.0 - 2.0 - 10.0 - 100.0
    check_target(target, Orbit(radius_m), formation, CONTROL, changed="orbit")


def test_too_large_sphere_at_the_target_is_refused_by_its_radius() -> None:
    orbit, target = Orbit(30.0), Target(0.0, -100.0)
    radius_m = describe(
        lambda: check_target(target, orbit, Formation(500.0, 20.0), CONTROL, changed="formation"), "radius_m"
    )
    assert radius_m == 300.0 - 2.0 - 30.0 - 100.0
    check_target(target, orbit, Formation(radius_m, 20.0), CONTROL, changed="formation")


def test_no_refusal_ever_names_a_limit_below_zero() -> None:
    far, wide, large = Target(900.0, 0.0), Orbit(400.0), Formation(400.0, 20.0)
    for changed, field in (("target", "position"), ("orbit", "radius_m"), ("formation", "radius_m")):
        check = partial(check_target, far, wide, large, CONTROL, changed=changed)  # type: ignore[arg-type]
        assert describe(check, field) == 0.0


def test_target_is_extrapolated_within_its_reach() -> None:
    plan = Plan(Formation(10.0, 20.0), Orbit(15.0), Target(0.0, 0.0, 3.0, 0.0, time_s=100.0))
    assert followed(plan, 120.0, SAFETY.fence) == Target(60.0, 0.0, 3.0, 0.0, time_s=120.0)
    gone = followed(plan, 400.0, SAFETY.fence)
    assert (gone.x_m, gone.y_m) == pytest.approx((273.0, 0.0))
    check_target(gone, plan.orbit, plan.formation, CONTROL, changed="formation")  # what is flown is allowed


def test_plan_with_too_many_obstacles_names_the_number_allowed() -> None:
    boxes = tuple(Obstacle(str(index), 10.0 * index, 0.0, 1.0, 1.0, 5.0) for index in range(40))
    plan = Plan(Formation(5.0, 20.0), obstacles=boxes[:MAX_OBSTACLES])
    assert len(plan.obstacles) == 32
    assert describe(lambda: replace_obstacles(plan, boxes), "obstacles") == MAX_OBSTACLES


def replace_obstacles(plan: Plan, boxes: tuple[Obstacle, ...]) -> None:
    replace(plan, obstacles=boxes)


def refuse(
    obstacle: Obstacle, airborne: dict[str, tuple[float, float, float]], homes: dict[str, tuple[float, ...]]
) -> str:
    with pytest.raises(RefusedError) as refused:
        accept(obstacle, airborne, homes)
    return str(refused.value)


def accept(
    obstacle: Obstacle, airborne: dict[str, tuple[float, float, float]], homes: dict[str, tuple[float, ...]]
) -> None:
    check_obstacle(
        obstacle,
        AVOIDANCE,
        {name: np.array(place) for name, place in airborne.items()},
        {name: np.array(place) for name, place in homes.items()},
    )


BOX = Obstacle("box", 0.0, 0.0, 3.0, 3.0, 10.0)  # its ellipse is a circle of 7.07 m, up to 13 m


def test_obstacle_on_an_airborne_vehicle_is_refused_by_name() -> None:
    stated = refuse(BOX, {"a": (7.0, 0.0, -12.9), "b": (30.0, 0.0, -5.0)}, {})
    assert "would stand on a " in stated
    accept(BOX, {"a": (7.0, 0.0, -13.1), "b": (7.2, 0.0, -5.0)}, {})


def test_obstacle_inside_stopping_distance_is_refused_by_name() -> None:
    def place(x_m: float, flies_m_s: float, box_m_s: float = 0.0) -> None:
        moving = replace(BOX, velocity_x_m_s=box_m_s)
        check_obstacle(
            moving,
            AVOIDANCE,
            {"a": np.array([x_m, 0.0, -5.0])},
            {},
            velocities_m_s={"a": np.array([flies_m_s, 0.0, 0.0])},
            braking=Braking(),
        )

    place(-12.3, 4.0)  # its wall is 5 m from its centre, and 4 m/s stop within 7.2 m
    for x_m, flies_m_s, box_m_s in ((-12.1, 4.0, 0.0), (-12.3, 3.0, -1.1)):
        with pytest.raises(RefusedError, match="too close ahead of a to stop"):
            place(x_m, flies_m_s, box_m_s)
    place(-12.1, -4.0)
    place(-12.1, float("nan"))


def test_obstacle_near_a_landing_site_is_refused_by_name() -> None:
    assert "landing place of home" in refuse(BOX, {}, {"home": (1.0, 1.0, 0.0)})
    assert "landing place of home" in refuse(BOX, {}, {"home": (7.07 + 2.9, 0.0, 0.0)})
    accept(BOX, {}, {"home": (7.07 + 3.1, 0.0, 0.0)})


def test_vehicle_at_an_unknown_position_blocks_nothing() -> None:
    assert "would stand on a" in refuse(BOX, {"a": (0.0, 0.0, -5.0)}, {})
    accept(BOX, {"a": (float("nan"), 0.0, -5.0)}, {"a": (float("nan"), 0.0, 0.0)})
