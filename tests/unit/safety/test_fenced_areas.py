"""Areas of the fence: vehicles stop before their edges, from either side, and are led back over them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from gcs.model.state import Array
from gcs.safety.constraints import Braking
from gcs.safety.fenced_areas import AREAS_MAX, CORNERS_MAX, Corner, FencedArea, area_constraints, beyond_m
from gcs.safety.walls import Fence, fence_constraints

SQUARE: tuple[Corner, ...] = ((-10.0, -10.0), (10.0, -10.0), (10.0, 10.0), (-10.0, 10.0))
ELL: tuple[Corner, ...] = ((0.0, 0.0), (30.0, 0.0), (30.0, 10.0), (10.0, 10.0), (10.0, 30.0), (0.0, 30.0))
NO_FENCE = Fence(height_min_m=0.1, height_max_m=1e4, distance_max_m=1e4)
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


def test_a_fence_without_areas_is_as_before() -> None:
    place_m, rows = np.array([[5.0, 0.0, -20.0]]), np.array([True])
    before = fence_constraints(place_m, rows, ~rows, NO_FENCE, Braking(), fastest_m_s=8.0)
    assert set(before.reason.tolist()) == {"least height"}
    fence = NO_FENCE.model_copy(update={"areas": (FencedArea(corners_m=SQUARE),)})
    found = fence_constraints(place_m, rows, ~rows, fence, Braking(), fastest_m_s=8.0)
    assert set(found.reason.tolist()) == {"least height", "area 1 of the fence"}
    assert len(fence_constraints(place_m, ~rows, ~rows, fence, Braking(), fastest_m_s=8.0)) == 0


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


def test_areas_are_bounded() -> None:
    with pytest.raises(ValidationError):
        FencedArea(corners_m=SQUARE[:2])
    with pytest.raises(ValidationError):
        FencedArea(corners_m=tuple((float(at), 0.0) for at in range(CORNERS_MAX + 1)))
    with pytest.raises(ValidationError):
        Fence(areas=(FencedArea(corners_m=SQUARE),) * (AREAS_MAX + 1))
    assert beyond_m([], np.zeros((2, 2))).tolist() == [-np.inf] * 2
    assert beyond_m([FencedArea(corners_m=SQUARE)], np.array([[np.nan, 0.0]])).tolist() != [10.0]
