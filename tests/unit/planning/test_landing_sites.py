"""Distinct places to come down on, and what a lost vehicle may sweep."""

import numpy as np
import pytest

from gcs.formation.obstacles import AvoidanceSettings, Ellipse
from gcs.model.plan import MAX_OBSTACLES, Obstacle
from gcs.model.state import Array, Mask
from gcs.planning.landing_sites import (
    CLEAR_M,
    COLUMNS_APART_M,
    DRIFT_S,
    OVERSHOOT_M,
    distinct_sites_m,
    expected_drift,
    open_places_m,
    return_heights_m,
    silent_segments_m,
    swept_segments_m,
)
from gcs.safety.separation import Floor

NO_ROW = np.zeros((0, 2))
BOX = Ellipse.around(Obstacle("b", 0.0, 0.0, 3.0, 6.0, 10.0), margin_m=2.0, headroom_m=3.0)


def closest_m(place_m: Array, taken_m: Array = NO_ROW) -> float:
    all_places = np.vstack([place_m, taken_m])
    distance = np.linalg.norm(place_m[:, None] - all_places[None], axis=2)
    distance[np.arange(len(place_m)), np.arange(len(place_m))] = np.inf
    return float(distance.min())


def test_sites_that_are_apart_are_kept() -> None:
    desired = np.array([[0.0, 0.0], [5.0, 0.0], [0.0, 9.0]])
    assert distinct_sites_m(desired, NO_ROW, 4.0, {}) == pytest.approx(desired, abs=1e-5)


def test_pair_too_close_parts_evenly() -> None:
    place = distinct_sites_m(np.array([[-1.0, 0.0], [1.0, 0.0]]), NO_ROW, 4.0, {})
    assert place == pytest.approx(np.array([[-2.0, 0.0], [2.0, 0.0]]), abs=0.05)


def test_fleet_over_one_point_lands_apart() -> None:
    place = distinct_sites_m(np.zeros((12, 2)), NO_ROW, 4.0, {})
    assert closest_m(place) >= 4.0 - 1e-9
    assert np.linalg.norm(place, axis=1).max() < 10.0


def test_occupied_sites_stay_and_are_respected() -> None:
    taken = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [4.0, 4.0]])
    place = distinct_sites_m(np.array([[1.0, 1.0], [2.0, 3.0]]), taken, 4.0, {})
    assert closest_m(place, taken) >= 4.0 - 1e-9


@pytest.mark.parametrize(
    "taken",
    [
        [[2.0, 0.0], [-2.0, 0.0]],  # exactly between two
        [[2.0, 2.0], [2.0, -2.0], [-2.0, 2.0], [-2.0, -2.0]],  # in the middle of four pads
        [[4.0 * i, 4.0 * j] for i in range(-3, 4) for j in range(-3, 4)],  # on a full grid of pads
    ],
)
def test_enclosed_vehicle_finds_the_nearest_free_site(taken: list[list[float]]) -> None:
    others = np.array(taken)
    place = distinct_sites_m(np.zeros((1, 2)), others, 4.0, {})
    assert closest_m(place, others) >= 4.0 - 1e-9
    assert np.linalg.norm(place) < 18.0


def test_no_vehicle_lands_on_or_beside_an_obstacle() -> None:
    desired = np.array([[0.0, 0.0], [1.0, 7.0], [-6.0, 0.0], [0.5, 0.0]])
    place = distinct_sites_m(desired, NO_ROW, 4.0, {"b": BOX})
    assert (BOX.distance_m(place) >= CLEAR_M).all()
    assert closest_m(place) >= 4.0 - 1e-9


def test_the_clearance_is_where_the_law_no_longer_pushes() -> None:
    assert AvoidanceSettings().near_m == CLEAR_M


def test_pocket_between_obstacles_and_sites_is_left() -> None:
    ellipses = {
        name: Ellipse.around(Obstacle(name, x, 0.0, 3.0, 30.0, 9.0), margin_m=2.0, headroom_m=3.0)
        for name, x in (("west", -6.0), ("east", 6.0))
    }
    place = distinct_sites_m(np.zeros((2, 2)), np.array([[0.0, 3.0]]), 4.0, ellipses)
    assert all((ellipse.distance_m(place) >= CLEAR_M).all() for ellipse in ellipses.values())
    assert closest_m(place, np.array([[0.0, 3.0]])) >= 4.0 - 1e-9


def test_unknown_position_stays_unknown_and_disturbs_no_other() -> None:
    desired = np.array([[np.nan, 0.0], [1.0, 1.0], [1.0, 1.5]])
    place = distinct_sites_m(desired, NO_ROW, 4.0, {})
    assert np.isnan(place[0]).all()
    assert closest_m(place[1:]) >= 4.0 - 1e-9


@pytest.mark.parametrize("half_m", [1.0, 3.0, 10.0])
def test_large_fleet_among_most_obstacles_finds_its_sites(half_m: float) -> None:
    random = np.random.default_rng(0)
    boxes = [
        Obstacle(str(index), x_m, y_m, half_m, half_m, 10.0)
        for index, (x_m, y_m) in enumerate(random.uniform(-60.0, 60.0, (MAX_OBSTACLES, 2)).tolist())
    ]
    ellipses = {box.id: Ellipse.around(box, margin_m=2.0, headroom_m=3.0) for box in boxes}
    desired, taken = random.normal(size=(50, 2)) * 8.0, random.uniform(-30.0, 30.0, (50, 2))
    place = distinct_sites_m(desired, taken, 4.0, ellipses)
    assert closest_m(place, taken) >= 4.0 - 1e-9
    assert all((ellipse.distance_m(place) >= CLEAR_M - 1e-9).all() for ellipse in ellipses.values())


def test_site_inside_a_wide_obstacle_is_moved_beside_it() -> None:
    wide = Ellipse.around(Obstacle("w", 0.0, 0.0, 150.0, 150.0, 10.0), margin_m=2.0, headroom_m=3.0)
    place = distinct_sites_m(np.zeros((3, 2)), NO_ROW, 4.0, {"w": wide})
    assert (wide.distance_m(place) >= CLEAR_M).all()
    assert closest_m(place) >= 4.0 - 1e-9
    assert np.linalg.norm(place, axis=1).max() < 1.3 * 215.0


def test_no_vehicle_needs_no_site() -> None:
    assert distinct_sites_m(NO_ROW, NO_ROW, 4.0, {}).shape == (0, 2)


LAST, HOME = np.array([30.0, 40.0, -20.0]), np.array([1.0, 2.0, 0.5])
COLUMN = [[[30.0, 40.0, -20.0], [30.0, 40.0, 0.0]]]


@pytest.mark.parametrize("action", ["descend", "land", "hold"])
def test_vehicle_landing_by_itself_sweeps_the_column_below(action: str) -> None:
    assert swept_segments_m(LAST, None, HOME, action, 30.0).tolist() == COLUMN


def test_returning_vehicle_may_climb_fly_home_and_descend() -> None:
    swept = swept_segments_m(LAST, None, HOME, "return", 30.0)
    assert swept.tolist() == [
        *COLUMN,
        [[30.0, 40.0, -20.0], [30.0, 40.0, -29.5]],
        [[30.0, 40.0, -29.5], [1.0, 2.0, -29.5]],
        [[1.0, 2.0, -29.5], [1.0, 2.0, 0.5]],
    ]


def test_vehicle_near_home_may_return_lower_as_px4_does() -> None:
    near = np.array([7.0, 10.0, -8.0])  # 10 m from home
    swept = swept_segments_m(near, None, HOME, "return", 30.0)
    assert [[7.0, 10.0, -9.5], [1.0, 2.0, -9.5]] in swept.tolist()
    assert [[7.0, 10.0, -29.5], [1.0, 2.0, -29.5]] in swept.tolist()


def test_return_heights_differ_up_to_the_fence() -> None:
    assert return_heights_m(4, 30.0, 4.0, 100.0).tolist() == [30.0, 34.0, 38.0, 42.0]
    assert return_heights_m(3, 30.0, 0.0, 100.0).tolist() == [30.0] * 3
    assert return_heights_m(2, 120.0, 4.0, 100.0).tolist() == [120.0] * 2
    heights_m = return_heights_m(50, 30.0, 4.0, 100.0)
    assert heights_m.min() == 30.0
    assert heights_m.max() <= 100.0
    assert (np.diff(heights_m) >= 0.0).all()
    assert np.unique(heights_m, return_counts=True)[1].max() == 3  # 18 layers for 50


def silent(action: str, silent_s: float, last: Array = LAST, home: Array | None = HOME) -> Array:
    return silent_segments_m(last, np.zeros(3), home, action, 30.0, silent_s=silent_s, noticed_s=1.0)


def test_space_of_a_silent_vehicle_grows() -> None:
    assert silent("hold", 1.5).tolist() == [[LAST.tolist(), LAST.tolist()]]
    for action, sign in (("return", -1.0), ("land", 1.0)):
        reach_m = [sign * (silent(action, s)[:, :, 2] * sign).max() for s in (0.5, 1.0, 1.5)]
        assert (np.diff(sign * np.array(reach_m)) > 0.0).all()
        assert sign * (reach_m[0] - LAST[2]) > 0.0, "before the autopilot acts"
    assert silent("return", 9.0)[:, :, 2].min() == -29.5, "no higher than its return height"


def test_silent_vehicle_that_is_high_may_begin_to_fly_home() -> None:
    high = np.array([30.0, 40.0, -60.0])
    way = silent("return", 1.0, high)[-1]
    assert way[0].tolist() == high.tolist()
    assert np.linalg.norm(way[1] - way[0]) == pytest.approx(15.0)
    assert (way[1] - way[0]) @ (HOME - high) > 0.0


def test_silent_vehicle_near_home_may_fly_there_without_a_climb() -> None:
    near = HOME - np.array([6.0, 0.0, 20.0])
    swept = silent("return", 1.0, near)
    assert distance_m(near + np.array([6.0, 0.0, 0.0]), swept) < 1e-9
    assert distance_m(near + np.array([6.0, 0.0, 0.0]), silent("hold", 1.0, near)) > 5.0


def test_silent_vehicle_may_drift() -> None:
    swept = silent_segments_m(
        LAST, np.array([4.0, 0.0, 0.0]), HOME, "hold", 30.0, silent_s=0.6, noticed_s=1.0
    )
    assert distance_m(LAST + np.array([4.0 * DRIFT_S, 0.0, 0.0]), swept) < 1e-9
    assert swept[:, :, 2].min() == swept[:, :, 2].max() == LAST[2]


def test_silent_vehicle_flies_on_before_it_can_have_noticed() -> None:
    swept = silent_segments_m(
        LAST, np.array([4.0, 0.0, 0.0]), HOME, "hold", 30.0, silent_s=0.6, noticed_s=1.0
    )
    assert distance_m(LAST, swept) == pytest.approx(4.0), "the space that it leaves is not closed"


def test_expected_drift_flies_on_then_brakes_then_is_unknown() -> None:
    silent_s = np.array([0.6, 1.0, 2.4, 3.4, 5.0, 1.0])
    rows = np.array([True, True, True, True, True, False])
    moves = np.tile([4.0, 0.0, 0.0], (6, 1))
    place_m, velocity_m_s = expected_drift(np.zeros((6, 3)), moves, silent_s, rows, noticed_s=1.0)
    assert place_m[:4, 0] == pytest.approx([0.4, 2.0, 6.6, 7.6])
    assert velocity_m_s[:4, 0] == pytest.approx([4.0, 4.0, 2.0, 0.0])
    assert np.isnan(place_m[4:]).all()
    assert np.isnan(velocity_m_s[4:]).all()


def test_vehicle_above_the_return_height_flies_home_level() -> None:
    swept = swept_segments_m(np.array([30.0, 40.0, -60.0]), None, HOME, "return", 30.0)
    assert swept[2].tolist() == [[30.0, 40.0, -60.0], [1.0, 2.0, -60.0]]


def test_without_a_known_home_only_the_column_is_known() -> None:
    assert swept_segments_m(LAST, None, None, "return", 30.0).tolist() == COLUMN


def test_vehicle_below_the_origin_sweeps_no_column_above() -> None:
    low = np.array([0.0, 0.0, 2.0])
    assert swept_segments_m(low, None, None, "land", 30.0).tolist() == [[[0.0, 0.0, 2.0], [0.0, 0.0, 2.0]]]


def drifting(
    velocity: tuple[float, float, float], action: str = "descend", home: Array | None = HOME
) -> Array:
    return swept_segments_m(LAST, np.array(velocity), home, action, 30.0)


def distance_m(place: Array, segments: Array) -> float:
    """From a point to the nearest of the segments."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    share = ((place - start) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-9)
    nearest = start + np.clip(share, 0.0, 1.0)[:, None] * along
    return float(np.linalg.norm(nearest - place, axis=1).min())


def test_moving_vehicle_drifts_and_may_descend_at_either_end() -> None:
    swept = drifting((4.0, -3.0, 0.0)).tolist()
    end = [30.0 + 4.0 * DRIFT_S, 40.0 - 3.0 * DRIFT_S]
    assert COLUMN[0] in swept
    assert pytest.approx(np.array([[*end, -20.0], [*end, 0.0]])) in swept
    assert pytest.approx(np.array([[30.0, 40.0, -20.0], [*end, -20.0]])) in swept


def test_columns_of_a_drift_leave_no_gap_between_them() -> None:
    assert Floor().kept_m(Floor().worst_reserve_m())[0] >= COLUMNS_APART_M
    swept = drifting((8.0, 0.0, 0.0))
    for share in np.linspace(0.0, 1.0, 50):
        for height_m in (1.0, 10.0, 19.0):
            below = LAST + np.array([8.0 * DRIFT_S * share, 0.0, 20.0 - height_m])
            assert distance_m(below, swept) <= COLUMNS_APART_M / 2


def test_climbing_may_be_higher_and_descending_as_high() -> None:
    assert drifting((0.0, 0.0, -2.5))[:, :, 2].min() == pytest.approx(-20.0 - 2.5 * DRIFT_S)
    assert drifting((0.0, 0.0, 1.4)).tolist() == COLUMN
    assert drifting((1.0, 0.0, 1.4))[:, :, 2].min() == -20.0


def test_returning_after_a_drift_starts_anywhere_along_it() -> None:
    swept = drifting((4.0, 0.0, 0.0), "return")
    for share in (0.0, 1.0):
        corner = np.array([30.0 + share * 4.0 * DRIFT_S, 40.0, -29.5])
        assert distance_m(corner, swept) < 1e-6
        assert distance_m((corner + np.array([1.0, 2.0, -29.5])) / 2.0, swept) < 1e-6
    assert distance_m(HOME, swept) < 1e-6


@pytest.mark.parametrize("velocity", [None, np.full(3, np.nan)])
def test_unknown_velocity_is_taken_as_rest(velocity: Array | None) -> None:
    assert swept_segments_m(LAST, velocity, HOME, "descend", 30.0).tolist() == COLUMN


def test_vehicle_lost_in_its_climb_may_reach_its_takeoff_height() -> None:
    low = HOME - np.array([0.1, 0.0, 2.0])
    climbing = swept_segments_m(low, np.zeros(3), HOME, "descend", 30.0, climbing_to_m=5.0).tolist()
    assert [[1.0, 2.0, 0.5 - 5.0 - OVERSHOOT_M], [1.0, 2.0, 0.5]] in climbing
    up = swept_segments_m(LAST, np.zeros(3), HOME, "descend", 30.0, climbing_to_m=5.0)
    assert up.tolist() == COLUMN
    nowhere = swept_segments_m(low, np.zeros(3), None, "descend", 30.0, climbing_to_m=5.0)
    assert len(nowhere) == 1


def test_a_closed_pad_is_left_for_the_nearest_open_place() -> None:
    pad_m = np.array([[0.0, 0.0, 0.5], [4.0, 0.0, 0.0], [30.0, 0.0, 0.0]])
    closed = np.array([True, False, False])
    taken_m = np.array([[0.0, 5.0]])

    def are_open(place_m: Array) -> Mask:
        return np.asarray(np.hypot(place_m[:, 0], place_m[:, 1]) > 3.0)

    place_m = open_places_m(pad_m, closed, taken_m, 4.0, {}, are_open)
    assert (place_m[1:] == pad_m[1:]).all()
    assert place_m[0, 2] == 0.5
    assert 3.0 < np.hypot(*place_m[0, :2]) < 4.5
    assert np.hypot(*(pad_m[1:, :2] - place_m[0, :2]).T).min() >= 4.0
    assert np.hypot(*(taken_m - place_m[0, :2]).T).min() >= 4.0


def test_two_closed_pads_get_places_apart() -> None:
    pad_m = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])

    def are_open(place_m: Array) -> Mask:
        return np.asarray(place_m[:, 0] > 5.0)

    place_m = open_places_m(pad_m, np.ones(2, dtype=bool), np.zeros((0, 2)), 4.0, {}, are_open)
    assert np.hypot(*(place_m[0] - place_m[1])[:2]) >= 4.0
    assert (place_m[:, 0] > 5.0).all()
    nowhere_m = open_places_m(
        pad_m, np.ones(2, dtype=bool), np.zeros((0, 2)), 4.0, {}, lambda place_m: place_m[:, 0] > 1e6
    )
    assert (nowhere_m == pad_m).all()
