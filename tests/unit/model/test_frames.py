"""Between the world and the show frame, against metres computed by hand."""

from math import cos, pi, radians, sin, sqrt

import numpy as np
import pytest

from gcs.model.errors import InvalidError
from gcs.model.frames import ShowFrame, wrap_rad

LATITUDE, LONGITUDE, ALTITUDE = 47.397742, 8.545594, 488.0
NORTH = ShowFrame(LATITUDE, LONGITUDE, ALTITUDE)
EAST = ShowFrame(LATITUDE, LONGITUDE, ALTITUDE, heading_deg=90.0)

# WGS84 by hand: radii of curvature at that latitude and height
A_M, E2 = 6378137.0, 6.69437999014e-3
W = sqrt(1.0 - E2 * sin(radians(LATITUDE)) ** 2)
PER_DEG_NORTH_M = (A_M * (1.0 - E2) / W**3 + ALTITUDE) * pi / 180.0
PER_DEG_EAST_M = (A_M / W + ALTITUDE) * cos(radians(LATITUDE)) * pi / 180.0


def test_a_thousandth_of_a_degree_in_metres_on_the_ellipsoid() -> None:
    place = NORTH.position_m(
        np.array([LATITUDE + 1e-3, LATITUDE]), np.array([LONGITUDE, LONGITUDE + 1e-3]), np.full(2, ALTITUDE)
    )
    assert place[0] == pytest.approx([1e-3 * PER_DEG_NORTH_M, 0.0, 0.0], abs=2e-3)
    assert place[1] == pytest.approx([0.0, 1e-3 * PER_DEG_EAST_M, 0.0], abs=2e-3)
    assert pytest.approx(111.2, abs=0.1) == PER_DEG_NORTH_M * 1e-3


def test_up_is_negative_z() -> None:
    place = NORTH.position_m(np.array([LATITUDE]), np.array([LONGITUDE]), np.array([ALTITUDE + 30.0]))
    assert place[0] == pytest.approx([0.0, 0.0, -30.0], abs=1e-6)


def test_with_heading_90_x_points_east_and_y_south() -> None:
    place = EAST.position_m(
        np.array([LATITUDE + 1e-3, LATITUDE]), np.array([LONGITUDE, LONGITUDE + 1e-3]), np.full(2, ALTITUDE)
    )
    assert place[0] == pytest.approx([0.0, -1e-3 * PER_DEG_NORTH_M, 0.0], abs=2e-3)
    assert place[1] == pytest.approx([1e-3 * PER_DEG_EAST_M, 0.0, 0.0], abs=2e-3)


def test_velocities_are_rotated_like_positions_and_back() -> None:
    ned = np.array([[1.0, 2.0, 3.0]])
    assert NORTH.from_ned(ned) == pytest.approx(ned)
    assert EAST.from_ned(ned) == pytest.approx(np.array([[2.0, -1.0, 3.0]]))
    assert EAST.into_ned(np.array([[2.0, -1.0, 3.0]])) == pytest.approx(ned)


@pytest.mark.parametrize("heading_deg", [0.0, 37.0, 90.0, -120.0, 360.0])
def test_show_to_world_and_back_is_the_same_place(heading_deg: float) -> None:
    frame = ShowFrame(LATITUDE, LONGITUDE, ALTITUDE, heading_deg)
    place = np.array([[0.0, 0.0, 0.0], [250.0, -80.0, -60.0], [-12.0, 299.0, 4.0]])
    assert frame.position_m(*frame.geodetic(place)) == pytest.approx(place, abs=1e-5)


def test_unknown_position_stays_unknown() -> None:
    place = NORTH.position_m(
        np.array([np.nan, LATITUDE]), np.array([np.nan, LONGITUDE]), np.array([np.nan, ALTITUDE])
    )
    assert np.isnan(place[0]).all()
    assert np.isfinite(place[1]).all()


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("latitude_deg", (90.1, 8.0, 0.0, 0.0)),
        ("latitude_deg", (float("nan"), 8.0, 0.0, 0.0)),
        ("longitude_deg", (47.0, -180.5, 0.0, 0.0)),
        ("altitude_amsl_m", (47.0, 8.0, float("inf"), 0.0)),
        ("heading_deg", (47.0, 8.0, 0.0, 361.0)),
    ],
)
def test_impossible_origin_is_refused_by_name(field: str, values: tuple[float, float, float, float]) -> None:
    with pytest.raises(InvalidError, match=field):
        ShowFrame(*values)


def test_angles_wrap_into_half_open_turn() -> None:
    assert wrap_rad(np.array([0.0, pi, -pi, 3 * pi / 2, 7.0])) == pytest.approx(
        [0.0, -pi, -pi, -pi / 2, 7.0 - 2 * pi]
    )
