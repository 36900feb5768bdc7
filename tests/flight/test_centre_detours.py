"""The centre leaves a U, gives way to boxes, and stands in a closed ring: through the real service."""

from typing import NamedTuple

import numpy as np
import pytest

from gcs.model.plan import Obstacle, Orbit, Target
from gcs.model.state import Array
from gcs.testing.virtual_show import TARGET_M, FlownTrack, VirtualShow, alarm_texts, fly, show_config

X_M, Y_M = TARGET_M
BEHIND = Target(X_M + 60.0, Y_M + 2.0)
U = (
    Obstacle("bottom", X_M + 22.0, Y_M, 2.0, 24.0, 60.0),
    Obstacle("left", X_M, Y_M - 22.0, 24.0, 2.0, 60.0),
    Obstacle("right", X_M, Y_M + 22.0, 24.0, 2.0, 60.0),
)
LID = Obstacle("lid", X_M - 22.0, Y_M, 2.0, 24.0, 60.0)
FENCE = {"safety": {"fence": {"height_max_m": 60.0}}}


class Flight(NamedTuple):
    ring: FlownTrack
    reported: list[str]
    reported_later: list[str]
    out: FlownTrack
    driven_at: FlownTrack
    boxes: tuple[Obstacle, ...]
    violations: int


def depth_m(track: FlownTrack, boxes: tuple[Obstacle, ...]) -> float:
    """How deep a vehicle was in a box grown by 1 m; negative outside."""
    worst_m = -np.inf
    for sample in track.samples:
        for box in boxes:
            x_m, y_m = box.position_m(sample.time_s)
            beside_m = np.abs(sample.true_m[:, :2] - (x_m, y_m)) - (box.half_length_x_m, box.half_length_y_m)
            worst_m = max(worst_m, float((1.0 - beside_m.max(axis=1)).max()))
    return worst_m


def off_m(show: VirtualShow) -> float:
    """Horizontal distance of the centre from the last target."""
    assert show.view.center_m is not None
    return float(np.hypot(show.view.center_m[0] - BEHIND.x_m, show.view.center_m[1] - BEHIND.y_m))


def centre_m(track: FlownTrack, at: int) -> Array:
    center_m = track.samples[at].view.center_m
    assert center_m is not None
    return np.array(center_m[:2])


async def story(show: VirtualShow) -> Flight:
    service = show.service
    await show.start()
    service.plan.set_orbit(Orbit(0.0, 4.0))
    for box in (*U, LID):
        service.plan.add_obstacle(box)
    service.plan.set_target(BEHIND)
    began_s = show.now_s
    await show.wait(9.0)
    reported = alarm_texts(show)
    ring = show.track.between(began_s)
    service.plan.remove_obstacle(LID.id)
    began_s = show.now_s
    await show.until(lambda: off_m(show) < 1.0, 81.0)
    await show.wait(3.0)
    out, reported_later = show.track.between(began_s), alarm_texts(show)
    for box in U:
        service.plan.remove_obstacle(box.id)
    now_s, beside_m = show.now_s, BEHIND.y_m - 2.0
    boxes = tuple(
        # 2 m beside the target: driven straight at it, which side is shorter would be left to chance
        Obstacle(f"truck {k}", BEHIND.x_m - side * 30.0, beside_m, 3.0, 6.0, 60.0, side * 1.5, 0.0, now_s)
        for k, side in enumerate((1.0, -1.0))
    )
    for box in boxes:
        service.plan.add_obstacle(box)
    left_s = 63.0 - await show.until(lambda: off_m(show) > 10.0)
    await show.until(lambda: off_m(show) < 1.0, left_s)  # kept clear of the second truck until it has passed
    await show.wait(3.0)
    driven_at = show.track.between(now_s)
    return Flight(ring, reported, reported_later, out, driven_at, boxes, show.floor_violations())


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly(story, show_config(4, control=FENCE))


@pytest.mark.soak
def test_no_vehicle_enters_a_box_or_comes_too_close(flight: Flight) -> None:
    assert depth_m(flight.ring, (*U, LID)) < 0.0
    assert depth_m(flight.out, U) < 0.0
    assert depth_m(flight.driven_at, flight.boxes) < 0.0
    assert flight.violations == 0


@pytest.mark.soak
def test_in_a_closed_ring_it_stands_and_names_a_wall(flight: Flight) -> None:
    moved_m = centre_m(flight.ring, -1) - centre_m(flight.ring, -40)
    assert np.hypot(*moved_m) < 0.1
    assert any("No headway past obstacle" in text for text in flight.reported)


@pytest.mark.soak
def test_out_of_the_u_it_reaches_the_target_behind(flight: Flight) -> None:
    assert centre_m(flight.out, -1) == pytest.approx((BEHIND.x_m, BEHIND.y_m), abs=1.0)
    assert not any("No headway" in text for text in flight.reported_later)


@pytest.mark.soak
def test_boxes_from_both_sides_are_left_and_it_returns(flight: Flight) -> None:
    places_m = np.array(
        [centre_m(flight.driven_at, at) for at in range(0, len(flight.driven_at.samples), 20)]
    )
    away_m = np.hypot(*(places_m - (BEHIND.x_m, BEHIND.y_m)).T)
    assert away_m.max() > 10.0
    assert away_m[-1] < 1.0
