"""Areas of the fence: vehicles stop before their edges, from either side, and are led back over them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from gcs.model.state import Array
from gcs.safety.area_walls import area_constraints
from gcs.safety.constraints import Braking, nearest
from gcs.safety.fenced_areas import (
    AREAS_MAX,
    CORNERS_IN_ALL,
    CORNERS_MAX,
    PASSES_M,
    Corner,
    FencedArea,
    beyond_m,
    is_within,
    shapes_of,
)
from gcs.safety.filter import filter_velocities
from gcs.safety.surroundings import SafetySettings
from gcs.safety.walls import Fence
from tests.support.safety_fleets import around

SQUARE: tuple[Corner, ...] = ((-10.0, -10.0), (10.0, -10.0), (10.0, 10.0), (-10.0, 10.0))
ELL: tuple[Corner, ...] = ((0.0, 0.0), (30.0, 0.0), (30.0, 10.0), (10.0, 10.0), (10.0, 30.0), (0.0, 30.0))
TICK_S = 0.05


def flown(area: FencedArea, start_m: Corner, velocity_m_s: Corner, seconds: float) -> Array:
    """(k, 2) The way of a vehicle that does at once what the constraints leave of its desired velocity."""
    place_m, way = np.array([[*start_m, -20.0]]), []
    desired_m_s = np.array([*velocity_m_s, 0.0])
    for _ in range(int(seconds / TICK_S)):
        found = area_constraints(
            place_m,
            np.array([True]),
            [area],
            Braking(),
            velocity_m_s=np.zeros((1, 3)),
            standoff_m=np.zeros(1),
            fastest_m_s=8.0,
        )
        velocity = desired_m_s.copy()
        for _ in range(50):
            if (found.normal @ velocity >= found.bound_m_s).all():
                break
            for normal, bound_m_s in zip(found.normal, found.bound_m_s, strict=True):
                velocity += max(bound_m_s - normal @ velocity, 0.0) * normal
        place_m = place_m + TICK_S * velocity
        way.append(place_m[0, :2])
    return np.array(way)


@pytest.mark.parametrize("corners_m", [SQUARE, SQUARE[::-1], ELL, ELL[::-1]])
@pytest.mark.parametrize("angle_deg", range(0, 360, 24))
def test_a_vehicle_stays_inside_whatever_the_shape(corners_m: tuple[Corner, ...], angle_deg: int) -> None:
    area, angle = FencedArea(corners_m=corners_m), np.radians(angle_deg)
    way_m = flown(area, (5.0, 5.0), (8.0 * np.cos(angle), 8.0 * np.sin(angle)), 12.0)
    assert beyond_m([area], way_m).max() <= 0.0
    assert beyond_m([area], way_m[-1:])[0] >= -0.3


@pytest.mark.parametrize("angle_deg", range(0, 360, 24))
def test_a_vehicle_stays_outside_of_what_is_excluded(angle_deg: int) -> None:
    area, angle = FencedArea(corners_m=SQUARE, inside=False), np.radians(angle_deg)
    start_m = (-30.0 * np.cos(angle), -30.0 * np.sin(angle))
    way_m = flown(area, start_m, (8.0 * np.cos(angle), 8.0 * np.sin(angle)), 12.0)
    assert beyond_m([area], way_m).max() <= 0.0


@pytest.mark.parametrize(("inside", "start_m"), [(True, (13.0, 4.0)), (False, (7.0, -2.0))])
def test_a_vehicle_beyond_an_edge_is_led_over_the_nearest_one(inside: bool, start_m: Corner) -> None:
    area = FencedArea(corners_m=SQUARE, inside=inside)
    way_m = flown(area, start_m, (0.0, 0.0), 8.0)
    assert beyond_m([area], way_m)[-1] <= 0.05
    assert np.abs(way_m[:, 1] - start_m[1]).max() <= 1e-6


@given(
    st.lists(st.tuples(st.integers(-50, 50), st.integers(-50, 50)), min_size=3, max_size=12, unique=True),
    st.tuples(st.integers(-60, 60), st.integers(-60, 60)),
)
def test_the_kernel_and_plain_arrays_agree(corners_m: list[Corner], near_m: Corner) -> None:
    """On which side a vehicle is, and how far from the nearest edge, also where edges cross."""
    area = FencedArea(corners_m=tuple((float(x_m), float(y_m)) for x_m, y_m in corners_m))
    place = np.array([[near_m[0] + 0.371, near_m[1] + 0.617, -5.0]])
    over_m = beyond_m([area], place[:, :2])[0]
    found = area_constraints(
        place, np.array([True]), [area], Braking(), velocity_m_s=np.zeros((1, 3)), standoff_m=np.zeros(1)
    )
    gap_m = -over_m
    expected = Braking().speed_m_s(np.array([gap_m]))[0]
    assert -found.bound_m_s.max() == pytest.approx(expected, abs=1e-6)
    assert (len(found) == 1) == (over_m > 0.0) or len(found) == len(corners_m)


@given(
    st.lists(st.tuples(st.integers(-50, 50), st.integers(-50, 50)), min_size=3, max_size=12, unique=True),
    st.tuples(st.floats(-60.0, 60.0), st.floats(-60.0, 60.0)),
)
def test_the_raster_and_the_edges_agree(corners_m: list[Corner], at_m: Corner) -> None:
    """Which side a place is on, by the raster where that knows it, and by all edges."""
    area = FencedArea(corners_m=tuple(corners_m))
    by_edges_m = beyond_m([area], np.array([at_m]))[0]
    if abs(by_edges_m) > 1e-9:
        assert is_within(*at_m, shapes_of((area,)), 0) == (by_edges_m < 0.0)


def test_the_filter_names_areas_of_commanded_vehicles() -> None:
    place_m, desired_m_s = np.array([[8.0, 0.0, -20.0]]), np.array([[6.0, 0.0, 0.0]])
    plain, fence = SafetySettings(), Fence(areas=(FencedArea(corners_m=SQUARE),))
    assert filter_velocities(desired_m_s, around(place_m), plain)[1] == ("",)
    within = plain.model_copy(update={"fence": fence})
    allowed_m_s, reasons = filter_velocities(desired_m_s, around(place_m), within)
    assert reasons == ("area 1 of the fence",)
    assert allowed_m_s[0, 0] < 2.0
    flown_by_hand = around(place_m, commanded=np.array([False]))
    assert filter_velocities(desired_m_s, flown_by_hand, within)[1] == ("",)


def test_walls_are_kept_by_a_vehicle_that_others_push() -> None:
    """It desired to stand still: walls that this could not break count as soon as others push it."""
    column_m = np.array([[[6.5, 0.0, -30.0], [6.5, 0.0, 0.0]]])  # of a lost vehicle, beside it
    place_m, still = np.array([[7.5, 0.0, -20.0]]), np.zeros((1, 3))
    near = FencedArea(corners_m=((-20.0, -20.0), (8.6, -20.0), (8.6, 20.0), (-20.0, 20.0)))
    pushed = around(place_m, segments=column_m)
    free_m_s, _ = filter_velocities(still, pushed, SafetySettings())
    assert free_m_s[0, 0] > 0.6
    kept_m_s, _ = filter_velocities(still, pushed, SafetySettings(fence=Fence(areas=(near,))))
    standoff_m = float(SafetySettings().floor.standoff_m(np.zeros(1))[0])
    assert kept_m_s[0, 0] <= Braking().speed_m_s(np.array([1.1 - standoff_m]))[0] + 1e-3


def test_measured_speed_and_standoff_narrow_what_is_allowed() -> None:
    def allowed_m_s(velocity_m_s: float, standoff_m: float) -> float:
        found = area_constraints(
            np.array([[5.0, 0.0, -20.0]]),
            np.array([True]),
            [FencedArea(corners_m=SQUARE)],
            Braking(),
            velocity_m_s=np.array([[velocity_m_s, 0.0, 0.0]]),
            standoff_m=np.array([standoff_m]),
        )
        ahead = found.normal[:, 0] < -0.99
        return float(-found.bound_m_s[ahead].min())

    assert allowed_m_s(3.0, 0.0) < allowed_m_s(0.0, 0.0)
    assert allowed_m_s(-3.0, 0.0) == allowed_m_s(0.0, 0.0)
    assert allowed_m_s(0.0, 2.0) < allowed_m_s(0.0, 0.0)


SPIKE: tuple[Corner, ...] = (
    (0.0, 0.0),
    (30.0, 0.0),
    (30.0, 20.0),
    (16.0, 20.0),
    (15.0, 3.0),
    (14.0, 20.0),
    (0.0, 20.0),
)
TOWER = FencedArea(corners_m=SQUARE, inside=False, height_min_m=0.0, height_max_m=25.0)
WIRE = FencedArea(corners_m=SQUARE, inside=False, height_min_m=20.0, height_max_m=40.0)


def led(
    areas: list[FencedArea], start_m: Array, velocity_m_s: Array, seconds: float, most_m: float = 100.0
) -> Array:
    """(k, 3) the way of a vehicle that does at once what walls and limits leave of its desired velocity."""
    place_m, way_m = start_m[None].copy(), []
    for _ in range(int(seconds / TICK_S)):
        walls = area_constraints(
            place_m,
            np.array([True]),
            areas,
            Braking(),
            velocity_m_s=np.zeros((1, 3)),
            standoff_m=np.full(1, 0.3),
            fastest_m_s=8.0,
            heights_m=(3.0, most_m),
        )
        velocity = nearest(
            velocity_m_s[None].copy(), walls.first, walls.second, walls.normal, walls.bound_m_s
        )
        place_m = place_m + TICK_S * velocity
        way_m.append(place_m[0])
    return np.array(way_m)


@pytest.mark.parametrize("height_m", [10.0, 24.0, 26.5, 40.0])
def test_closed_space_is_flown_over_and_not_through(height_m: float) -> None:
    way_m = led([TOWER], np.array([-30.0, 0.5, -height_m]), np.array([6.0, 0.0, 0.0]), 14.0)
    assert beyond_m([TOWER], way_m).max() <= -0.2
    assert (way_m[-1, 0] > 15.0) == (height_m > 25.0)


@pytest.mark.parametrize(("height_m", "passes"), [(10.0, True), (30.0, False), (50.0, True)])
def test_closed_space_above_is_flown_under(height_m: float, passes: bool) -> None:
    way_m = led([WIRE], np.array([-30.0, 0.5, -height_m]), np.array([6.0, 0.0, 0.0]), 14.0)
    assert beyond_m([WIRE], way_m).max() <= -0.2
    assert (way_m[-1, 0] > 15.0) == passes


def test_no_vehicle_descends_into_closed_space() -> None:
    way_m = led([TOWER], np.array([2.0, 1.0, -40.0]), np.array([0.0, 0.0, 1.4]), 20.0)
    assert beyond_m([TOWER], way_m).max() <= -0.25
    assert -way_m[-1, 2] == pytest.approx(25.3, abs=0.2)


def test_out_of_closed_space_the_nearest_way_is_taken() -> None:
    """Over the top where it is near and the fence allows it, else sideways."""
    near_top_m, still = np.array([2.0, 1.0, -24.0]), np.zeros(3)
    over_m = led([TOWER], near_top_m, still, 6.0)
    assert beyond_m([TOWER], over_m)[-1] <= 0.0
    assert np.abs(over_m[:, :2] - near_top_m[:2]).max() < 1e-6
    beside_m = led([TOWER], near_top_m, still, 12.0, most_m=25.0 + PASSES_M / 2.0)
    assert beyond_m([TOWER], beside_m)[-1] <= 0.0
    assert np.abs(beside_m[:, 2] - near_top_m[2]).max() < 1e-6


def test_flight_inside_stays_below_its_ceiling() -> None:
    """And above its floor, but for vehicles that land."""
    box = FencedArea(corners_m=SQUARE, height_min_m=5.0, height_max_m=30.0)
    up_m = led([box], np.array([0.0, 0.0, -20.0]), np.array([0.0, 0.0, -2.0]), 12.0)
    down_m = led([box], np.array([0.0, 0.0, -20.0]), np.array([0.0, 0.0, 2.0]), 12.0)
    assert -up_m[-1, 2] == pytest.approx(29.7, abs=0.2)
    assert -down_m[-1, 2] == pytest.approx(5.3, abs=0.2)
    assert beyond_m([box], np.array([[0.0, 0.0, -1.0]]))[0] < 0.0
    landing = area_constraints(
        np.array([[0.0, 0.0, -5.0]]),
        np.array([True]),
        [box],
        Braking(),
        velocity_m_s=np.zeros((1, 3)),
        standoff_m=np.zeros(1),
        fastest_m_s=2.0,
        descending=np.array([True]),
    )
    assert (landing.normal[:, 2] == 0.0).all()


@pytest.mark.parametrize("corners_m", [SQUARE, SQUARE[::-1], ELL, ELL[::-1], SPIKE, SPIKE[::-1]])
@pytest.mark.parametrize("inside", [True, False])
def test_a_vehicle_exactly_on_a_corner_or_edge_leaves_it(corners_m: tuple[Corner, ...], inside: bool) -> None:
    area = FencedArea(corners_m=corners_m, inside=inside)
    ring_m = np.array(corners_m)
    for x_m, y_m in np.vstack([ring_m, (ring_m + np.roll(ring_m, 1, axis=0)) / 2.0]).tolist():
        way_m = led([area], np.array([x_m, y_m, -20.0]), np.zeros(3), 8.0)
        assert beyond_m([area], way_m)[-1] <= 0.0, (x_m, y_m)


@pytest.mark.parametrize("start_m", [(15.0, -9.0), (15.0, 15.0), (40.0, 30.0), (15.0, 60.0), (-20.0, 10.0)])
def test_vehicles_outside_are_led_in_past_a_spike(start_m: Corner) -> None:
    area = FencedArea(corners_m=SPIKE)
    way_m = led([area], np.array([*start_m, -20.0]), np.zeros(3), 40.0)
    assert beyond_m([area], way_m)[-1] <= 0.0


def test_a_narrow_place_holds_no_vehicle() -> None:
    """Between two edges nearer than is kept from both a vehicle still flies along, and out."""
    x_m, y_m = (
        (0, 10, 10, 20, 20, 30, 30, 20, 20, 10, 10, 0),
        (0, 0, 4.8, 4.8, 0, 0, 10, 10, 5.2, 5.2, 10, 10),
    )
    area = FencedArea(corners_m=tuple(zip(map(float, x_m), map(float, y_m), strict=True)))
    way_m = led([area], np.array([15.0, 5.0, -20.0]), np.array([2.0, 0.0, 0.0]), 10.0)
    assert beyond_m([area], way_m).max() <= 0.05
    assert way_m[-1, 0] > 20.0


def test_areas_are_bounded() -> None:
    with pytest.raises(ValidationError):
        FencedArea(corners_m=SQUARE[:2])
    with pytest.raises(ValidationError):
        FencedArea(corners_m=tuple((float(at), 0.0) for at in range(CORNERS_MAX + 1)))
    with pytest.raises(ValidationError):
        Fence(areas=(FencedArea(corners_m=SQUARE),) * (AREAS_MAX + 1))
    ring = tuple((float(at), float(at**2)) for at in range(CORNERS_MAX))
    with pytest.raises(ValidationError, match=f"corners in all: at most {CORNERS_IN_ALL}"):
        Fence(areas=(FencedArea(corners_m=ring),) * (CORNERS_IN_ALL // CORNERS_MAX + 1))
    with pytest.raises(ValidationError, match="height_max_m = 5: above height_min_m = 9"):
        FencedArea(corners_m=SQUARE, height_min_m=9.0, height_max_m=5.0)
    with pytest.raises(ValidationError, match="controlled_ground: inside: true, and no heights"):
        Fence(controlled_ground=TOWER)
    assert beyond_m([], np.zeros((2, 2))).tolist() == [-np.inf] * 2
    assert beyond_m([FencedArea(corners_m=SQUARE)], np.array([[np.nan, 0.0]])).tolist() != [10.0]
