"""Paths and places that vehicles close which are lost, or have landed, after the planning."""

import numpy as np
import pytest

from gcs.control import ControlSettings
from gcs.model.state import Array
from gcs.planning.return_paths.closed_ways import are_occupied, closed_paths
from gcs.planning.return_paths.paths import STEP_S, ReturnPaths
from gcs.planning.return_paths.planner import return_places_m
from gcs.safety.floor import Floor

FLOOR, UNSURE_M = Floor(), np.full(2, 0.05)
SPEED_M_S = 4.0


def two_paths() -> ReturnPaths:
    """Level along x for 40 m, 12 m apart, 10 m above the ground; then they stay."""
    along_m = np.minimum(SPEED_M_S * STEP_S * np.arange(80), 40.0)
    path_m = np.zeros((2, 80, 3))
    path_m[:, :, 0], path_m[1, :, 1], path_m[:, :, 2] = along_m, 12.0, -10.0
    return ReturnPaths(path_m, path_m, np.full(2, 10.0), np.full(2, 12.0), ())


def closed(column_m: Array, time_s: float = 0.0) -> list[bool]:
    """Which are closed by a vehicle that hangs at the top of that column (2, 3)."""
    lost = column_m[None], np.full(1, 0.05)
    return [bool(each) for each in closed_paths(two_paths(), np.arange(2), time_s, FLOOR, UNSURE_M, lost)]


def column(x_m: float, y_m: float, top_m: float = 20.0) -> Array:
    return np.array([[x_m, y_m, -top_m], [x_m, y_m, 0.0]])


def test_a_path_below_a_hanging_vehicle_is_closed_and_no_other() -> None:
    assert closed(column(20.0, 1.0)) == [True, False]
    assert closed(column(20.0, 11.0)) == [False, True]
    assert closed(column(20.0, 6.0)) == [False, False]


def test_a_path_over_a_lost_vehicle_is_open() -> None:
    assert closed(column(20.0, 0.0, top_m=4.0)) == [False, False]
    assert closed(column(20.0, 0.0, top_m=8.0)) == [True, False]


@pytest.mark.parametrize(("time_s", "is_closed"), [(4.0, True), (6.0, False), (1e3, False)])
def test_what_has_been_flown_is_not_closed(time_s: float, *, is_closed: bool) -> None:
    assert closed(column(20.0, 0.0), time_s) == [is_closed, False]


def test_without_lost_vehicles_all_paths_are_open() -> None:
    nothing = np.zeros((0, 2, 3)), np.zeros(0)
    assert not closed_paths(two_paths(), np.arange(2), 0.0, FLOOR, UNSURE_M, nothing).any()
    none = np.zeros(0, np.intp)
    assert len(closed_paths(two_paths(), none, 0.0, FLOOR, UNSURE_M, nothing)) == 0


STANDS_M = np.array([[3.0, 0.0]])


def test_a_vehicle_that_stands_beside_a_place_occupies_it() -> None:
    places_m = np.array([[0.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [5.0, 1.0, 0.0]])
    assert are_occupied(places_m, STANDS_M, 4.0).tolist() == [False, False, True]
    assert are_occupied(places_m, STANDS_M, 4.5).tolist() == [True, False, True]
    assert not are_occupied(places_m, STANDS_M[:0], 4.0).any()


def test_vehicles_land_beside_pads_at_which_another_stands() -> None:
    """It was kept off its pad by one that had landed 9 m off its own, and hovered above for ever."""
    pads_m, unsure_m = np.array([[1.0, 0.0, 0.2], [20.0, 0.0, 0.0]]), np.full(2, 0.25)
    nothing = np.zeros((0, 2, 3)), np.zeros(0)

    def places_m(stands_m: Array) -> Array:
        settings = ControlSettings()
        return return_places_m(
            pads_m, STANDS_M, 10.0, 4.0, settings, {}, unsure_m, nothing, stands_m=stands_m
        )

    placed_m = places_m(STANDS_M)
    assert 4.0 <= np.linalg.norm(placed_m[0, :2] - STANDS_M[0]) < 6.0
    assert placed_m[0, 2] == 0.2
    assert (placed_m[1] == pads_m[1]).all()
    assert (places_m(STANDS_M[:0]) == pads_m).all()
