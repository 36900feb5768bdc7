"""A vehicle on the wrong side of several areas comes out of all of them, and still descends meanwhile."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.model.state import Array
from gcs.safety.fenced_areas import Corner, FencedArea, beyond_m
from gcs.safety.filter import filter_velocities
from gcs.safety.surroundings import SafetySettings
from gcs.safety.walls import Fence
from tests.support.safety_world import surroundings

TICK_S, FOLLOWS_S = 0.05, 0.4


def box(x_m: float, y_m: float, to_x_m: float, to_y_m: float) -> tuple[Corner, ...]:
    return (x_m, y_m), (to_x_m, y_m), (to_x_m, to_y_m), (x_m, to_y_m)


def closed(*sides_m: float, top_m: float | None = None, bottom_m: float | None = None) -> FencedArea:
    return FencedArea(corners_m=box(*sides_m), inside=False, height_max_m=top_m, height_min_m=bottom_m)


SITE = FencedArea(corners_m=box(-100.0, -100.0, 0.0, 100.0))
CASES = {
    "edge to edge": ((closed(0, -20, 40, 20), closed(40, -20, 80, 20)), (37.0, 0.0)),
    "overlapping": ((closed(0, -20, 45, 20), closed(40, -20, 80, 20)), (42.0, 0.0)),
    "one of two that overlap": ((closed(0, -20, 45, 20), closed(40, -20, 80, 20)), (39.0, 0.0)),
    "along the site's edge": ((SITE, closed(-30, -15, 0, 15)), (5.0, 0.0)),
    "near the site's edge": ((SITE, closed(-30, -15, -0.2, 15)), (5.0, 0.0)),
    "audience between": ((SITE, closed(10, -15, 20, 15)), (35.0, 0.0)),
    "one above the other": ((closed(-9, -9, 9, 9, top_m=22), closed(-9, -9, 9, 9, bottom_m=22)), (0.0, 1.0)),
}
SHUT_IN = (FencedArea(corners_m=box(-60, -60, 60, 60)), closed(-90, -90, 90, 90))


def flown(
    areas: tuple[FencedArea, ...], start_m: Corner, velocity_m_s: Array, seconds: float, down: bool = False
) -> tuple[Array, list[str]]:
    """(k, 3) the way of a vehicle that follows the filter with a lag, and the filter's reasons."""
    settings = SafetySettings(fence=Fence(areas=areas, distance_max_m=500.0, height_max_m=100.0))
    place_m, velocity, way_m, reasons = np.array([[*start_m, -20.0]]), np.zeros((1, 3)), [], []
    for _ in range(int(seconds / TICK_S)):
        here = surroundings(place_m.copy(), velocity=velocity.copy(), descending=down)
        allowed_m_s, reason = filter_velocities(velocity_m_s[None].copy(), here, settings)
        velocity = velocity + (allowed_m_s - velocity) * TICK_S / FOLLOWS_S
        place_m = place_m + velocity * TICK_S
        way_m.append(place_m[0])
        reasons.append(reason[0])
    return np.array(way_m), reasons


@pytest.mark.parametrize("case", CASES)
def test_it_comes_out_and_enters_no_other_area(case: str) -> None:
    areas, start_m = CASES[case]
    way_m, reasons = flown(areas, start_m, np.zeros(3), 60.0)
    assert beyond_m(areas, way_m)[-1] <= 0.0
    assert reasons[0].startswith("area ")
    for area in areas:
        over_m = beyond_m([area], np.vstack([[*start_m, -20.0], way_m]))
        assert over_m[0] > 0.0 or over_m.max() <= 0.0


@pytest.mark.parametrize("case", CASES)
def test_its_descent_goes_on_meanwhile(case: str) -> None:
    areas, start_m = CASES[case]
    way_m, _ = flown(areas, start_m, np.array([0.0, 0.0, 1.0]), 15.0, down=True)
    assert -way_m[-1, 2] <= 20.0 - 14.0


def test_without_a_way_out_it_is_not_led_and_still_lands() -> None:
    way_m, _ = flown(SHUT_IN, (35.0, 0.0), np.zeros(3), 5.0)
    assert np.abs(way_m - [35.0, 0.0, -20.0]).max() == 0.0
    down_m, _ = flown(SHUT_IN, (35.0, 0.0), np.array([0.0, 0.0, 1.0]), 5.0, down=True)
    assert -down_m[-1, 2] <= 20.0 - 4.0


def test_without_a_way_in_it_gets_no_farther_out() -> None:
    areas = (FencedArea(corners_m=box(-60, -60, 60, 60)), closed(-70, -70, 70, 70))
    way_m, reasons = flown(areas, (80.0, 0.0), np.array([3.0, 0.0, 0.0]), 5.0)
    assert way_m[-1, 0] <= 80.0
    assert set(reasons) == {"area 1 of the fence"}


def test_the_reason_is_named_while_another_vehicle_is_in_the_way() -> None:
    settings = SafetySettings(fence=Fence(areas=(SITE,), distance_max_m=500.0, height_max_m=100.0))
    here = surroundings(np.array([[2.6, 0.0, -20.0], [0.0, 0.0, -20.0]]), commanded=[True, False])
    allowed_m_s, reasons = filter_velocities(np.zeros((2, 3)), here, settings)
    assert allowed_m_s[0, 0] > -1.0
    assert reasons[0] == "area 1 of the fence"


def test_a_pair_still_stops_a_descent_beside_walls() -> None:
    areas, start_m = CASES["edge to edge"]
    settings = SafetySettings(fence=Fence(areas=areas, distance_max_m=500.0, height_max_m=100.0))
    here = surroundings(
        np.array([[*start_m, -20.0], [*start_m, -16.0]]), commanded=[True, False], descending=True
    )
    desired_m_s = np.array([[0.0, 0.0, 1.4], [0.0, 0.0, 0.0]])
    with_areas, _ = filter_velocities(desired_m_s, here, settings)
    alone, _ = filter_velocities(desired_m_s, here, SafetySettings())
    assert alone[0, 2] < 1.0
    assert with_areas[0, 2] <= max(alone[0, 2], 0.0) + 1e-3


LIDS = {
    "above its top": ((closed(-9, -9, 9, 9, top_m=18),), 15.0),
    "its top is nearer than its sides": ((closed(-9, -9, 9, 9, top_m=22),), 15.0),
    "closed space above another": ((closed(-9, -9, 9, 9, top_m=12), closed(-9, -9, 9, 9, bottom_m=16)), 15.0),
    "a lid upon two that overlap": (
        (closed(-9, -9, 4, 9, top_m=22), closed(0, -9, 9, 9, top_m=24), closed(-9, -9, 9, 9, top_m=20)),
        15.0,
    ),
    "under a wire": ((closed(-9, -9, 9, 9, bottom_m=22, top_m=40),), 0.0),
}


@pytest.mark.parametrize("case", LIDS)
def test_a_vehicle_that_lands_comes_down_beside_a_lid(case: str) -> None:
    """It is neither lifted nor held over it, and before it is down it has come out sideways."""
    areas, aside_m = LIDS[case]
    way_m, _ = flown(areas, (0.0, 1.0), np.array([0.0, 0.0, 1.4]), 11.0, down=True)
    assert (np.diff(way_m[20:, 2]) > 1.3 * TICK_S).all()
    assert beyond_m(areas, way_m)[-1] <= 0.0
    assert (np.abs(way_m[-1, :2]).max() > 9.0) == (aside_m > 0.0)


def test_a_vehicle_that_lands_crosses_no_lid() -> None:
    """Beside closed space it keeps off it also above its top: it would come down into it."""
    areas = (closed(-9, -9, 9, 9, top_m=12),)
    across_m, _ = flown(areas, (-20.0, 0.0), np.array([5.0, 0.0, 0.0]), 8.0)
    assert across_m[-1, 0] > 9.0
    down_m, _ = flown(areas, (-20.0, 0.0), np.array([5.0, 0.0, 1.0]), 12.0, down=True)
    assert beyond_m(areas, down_m).max() <= 0.0
    assert -down_m[-1, 2] <= 20.0 - 11.0


corner = st.tuples(st.integers(-40, 40), st.integers(-40, 40))
height = st.none() | st.integers(0, 45)


@st.composite
def shapes(draw: st.DrawFn) -> FencedArea:
    """Areas of both kinds, with and without heights."""
    low, high = draw(height), draw(height)
    if low is not None and high is not None and low >= high:
        low, high = high, low + 1
    return FencedArea(
        corners_m=tuple(draw(st.lists(corner, min_size=3, max_size=7, unique=True))),
        inside=draw(st.booleans()),
        height_min_m=low,
        height_max_m=high,
    )


@given(
    st.lists(shapes(), min_size=1, max_size=5),
    corner,
    st.floats(0.0, 1.4),
    st.tuples(corner, corner),
    st.none() | st.floats(-2.0, 2.0),
)
def test_no_area_slows_a_descent_or_lifts(
    areas: list[FencedArea],
    at: Corner,
    down_m_s: float,
    motion: tuple[Corner, Corner],
    sinks_m_s: float | None,
) -> None:
    """Whatever the areas' heights, where the vehicle is, and how it moves; nor does controlled ground."""
    (x, y), (level_x, level_y) = motion
    ground = FencedArea(corners_m=box(-50.0, -50.0, 50.0, 50.0)) if sinks_m_s is None else None
    settings = SafetySettings(
        fence=Fence(areas=tuple(areas), controlled_ground=ground, distance_max_m=500.0, height_max_m=100.0)
    )
    velocity = np.array([[x / 10.0, y / 10.0, sinks_m_s or 0.0]])
    here = surroundings(np.array([[*at, -20.0]], float), velocity=velocity, descending=True)
    desired_m_s = np.array([[level_x / 10.0, level_y / 10.0, down_m_s]])
    allowed_m_s, _ = filter_velocities(desired_m_s, here, settings)
    assert allowed_m_s[0, 2] >= down_m_s - 1e-9
