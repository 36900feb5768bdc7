"""A target inside a hall is followed from beside it, by the whole formation: through the real service."""

from typing import NamedTuple

import numpy as np
import pytest

from gcs.model.plan import Obstacle, Orbit, Target
from gcs.model.state import Array
from gcs.testing.virtual_show import TARGET_M, VirtualShow, alarm_texts, fly, show_config

X_M, Y_M = TARGET_M
HALL = Obstacle("hall", X_M + 45.0, Y_M, 8.0, 12.0, 60.0)
INSIDE = Target(HALL.x_m - 2.0, HALL.y_m + 3.0)
FENCE = {"safety": {"fence": {"height_max_m": 60.0}}}


class Flight(NamedTuple):
    named_after_s: float
    reported: list[str]
    center_m: Array
    speed_m_s: float
    radius_m: float
    radius_error_m: float
    along_m: float
    back_off_m: float
    floor_violations: int


def center_m(show: VirtualShow) -> Array:
    assert show.view.center_m is not None
    return np.array(show.view.center_m)


def named(show: VirtualShow) -> bool:
    return any("obstacle hall" in text for text in alarm_texts(show))


async def story(show: VirtualShow) -> Flight:
    service = show.service
    await show.start()
    service.plan.set_orbit(Orbit(0.0, 4.0))
    service.plan.add_obstacle(HALL)
    service.plan.set_target(INSIDE)
    named_after_s = await show.until(lambda: named(show), 10.0)
    await show.wait(45.0)
    reported, there_m = alarm_texts(show), center_m(show)
    radius_m = np.linalg.norm(show.true_m - there_m, axis=1)
    await show.wait(5.0)
    speed_m_s = float(np.linalg.norm(center_m(show) - there_m)) / 5.0
    service.plan.set_target(Target(INSIDE.x_m, INSIDE.y_m, 0.0, -0.5))  # it drives inside the hall
    await show.wait(12.0)
    along_m = float(center_m(show)[1] - there_m[1])
    service.plan.set_target(Target(X_M, Y_M))
    await show.until(lambda: float(np.hypot(*(center_m(show)[:2] - TARGET_M))) < 1.0, 60.0)
    await show.wait(3.0)
    back_off_m = float(np.hypot(*(center_m(show)[:2] - TARGET_M)))
    desired_m = show.view.plan.formation.radius_m
    error_m = float(np.abs(radius_m - desired_m).max())
    went_m = along_m, back_off_m
    shape_m = desired_m, error_m
    return Flight(named_after_s, reported, there_m, speed_m_s, *shape_m, *went_m, show.floor_violations())


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly(story, show_config(4, control=FENCE))


@pytest.mark.soak
def test_the_hall_is_named_and_what_the_formation_does(flight: Flight) -> None:
    assert flight.named_after_s <= 10.0
    assert any("obstacle hall: the whole formation has no room" in text for text in flight.reported)


@pytest.mark.soak
def test_the_whole_formation_rests_beside_the_hall(flight: Flight) -> None:
    half_m = HALL.half_length_x_m, HALL.half_length_y_m
    beside_m = np.abs(flight.center_m[:2] - (HALL.x_m, HALL.y_m)) - half_m
    assert beside_m.max() > flight.radius_m
    assert flight.speed_m_s < 0.1
    assert flight.radius_error_m < 1.0  # of true positions
    assert flight.floor_violations == 0


@pytest.mark.soak
def test_it_follows_a_target_that_drives_inside(flight: Flight) -> None:
    assert -7.0 < flight.along_m < -3.0  # of 6 m: along the sides of the hall's ellipse


@pytest.mark.soak
def test_it_returns_to_a_target_that_is_outside_again(flight: Flight) -> None:
    assert flight.back_off_m < 1.0
