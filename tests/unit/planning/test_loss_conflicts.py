"""Vehicles that would come closer than the floor if all lost the ground station at once, computed by hand."""

import numpy as np
import pytest

from gcs.planning.setpoint_loss import ACTIONS, Action, Clash, clashes, turned_upright
from gcs.safety.floor import Floor

FLOOR = Floor(horizontal_m=2.0, vertical_m=3.0, margin_m=5.0, uncertainty_m=5.0, deviations=1.0)
"""Margin and general uncertainty are greater than everything here: they do not count."""

Place = tuple[float, float, float]


def clashing(
    position_m: list[Place],
    action: Action,
    *,
    home_m: list[Place] | None = None,
    uncertainty_m: list[float] | None = None,
    speed_m_s: float = 0.0,
    flies_on_s: list[float] | None = None,
) -> list[Clash]:
    n = len(position_m)
    far_apart_m = [(50.0 * i, 0.0, 0.0) for i in range(n)]
    return clashes(
        np.array(position_m),
        np.array(far_apart_m if home_m is None else home_m),
        action,
        floor=FLOOR,
        uncertainty_m=np.zeros(n) if uncertainty_m is None else np.array(uncertainty_m),
        speed_m_s=speed_m_s,
        return_height_m=30.0,
        flies_on_s=0.0 if flies_on_s is None else np.array(flies_on_s),
    )


def test_vehicles_that_fly_on_for_different_times_need_room() -> None:
    """One stops 2 s before the other, which flies on at their common speed."""
    places_m: list[Place] = [(0.0, 0.0, -10.0), (6.0, 0.0, -10.0)]

    def found(flies_on_s: list[float]) -> list[Clash]:
        return clashing(places_m, "hold", speed_m_s=2.5, flies_on_s=flies_on_s)

    assert found([2.0, 2.0]) == []
    assert [(one.first, one.second) for one in found([2.0, 4.0])] == [(0, 1)]


def sideways_m(found: list[Clash]) -> list[float]:
    return [clash.sideways_m for clash in found]


@pytest.mark.parametrize(
    ("away_m", "clash"),
    [
        ((1.9, 0.0, 0.0), True),
        ((0.0, 1.9, 0.0), True),
        ((2.0, 0.0, 0.0), False),  # not closer than the floor
        ((1.5, 1.5, 0.0), False),
        ((0.0, 0.0, -2.9), True),
        ((0.0, 0.0, 2.9), True),
        ((0.0, 0.0, 3.0), False),
        ((1.6, 0.0, 1.7), True),  # 0.64 + 0.32
        ((1.6, 0.0, 1.9), False),  # 0.64 + 0.40
    ],
)
def test_holding_vehicle_conflicts_only_inside_the_floor(away_m: Place, clash: bool) -> None:
    x_m, y_m, z_m = away_m
    assert bool(clashing([(7.0, -4.0, -20.0), (7.0 + x_m, -4.0 + y_m, -20.0 + z_m)], "hold")) is clash


@pytest.mark.parametrize(
    ("away_m", "clash"),
    [
        ((2.35, 0.0, 0.0), True),
        ((2.45, 0.0, 0.0), False),
        ((0.0, 0.0, 3.7), True),  # up and down it counts twice
        ((0.0, 0.0, 3.9), False),
    ],
)
def test_variances_of_both_are_added_to_the_separation(away_m: Place, clash: bool) -> None:
    x_m, _, z_m = away_m
    both = clashing([(0.0, 0.0, -20.0), (x_m, 0.0, -20.0 + z_m)], "hold", uncertainty_m=[0.24, 0.32])
    assert bool(both) is clash


@pytest.mark.parametrize(
    ("away_m", "clash"),
    [((2.55, 0.0, 0.0), True), ((2.65, 0.0, 0.0), False), ((0.0, 0.0, 3.1), False)],
)
def test_late_failsafe_flies_on_a_third_of_a_second_sideways(away_m: Place, clash: bool) -> None:
    x_m, _, z_m = away_m
    assert bool(clashing([(0.0, 0.0, -20.0), (x_m, 0.0, -20.0 + z_m)], "hold", speed_m_s=2.0)) is clash


@pytest.mark.parametrize("action", ["descend", "land"])
@pytest.mark.parametrize(
    ("apart_m", "above_m", "clash"),
    [
        (1.45, 10.0, True),  # beside one that stands: 2 sqrt(1 - (2/3)^2) = 1.49
        (1.55, 10.0, False),
        (1.45, -10.0, True),
        (1.8, 1.0, True),  # 1 m apart in height they stay: 2 sqrt(1 - (1/3)^2) = 1.89
        (1.95, 1.0, False),
    ],
)
def test_upper_vehicle_descends_beside_a_standing_one(
    action: Action, apart_m: float, above_m: float, clash: bool
) -> None:
    found = clashing([(0.0, 0.0, -20.0), (apart_m, 0.0, -20.0 - above_m)], action)
    assert bool(found) is clash


@pytest.mark.parametrize("action", ["hold", "return"])
def test_holding_or_returning_does_not_descend_onto_another(action: Action) -> None:
    # ways home at 60 m and 50 m
    assert clashing([(0.0, 0.0, -50.0), (0.0, 2.1, -60.0)], action) == []


def test_closest_conflicts_are_reported_first_with_distance() -> None:
    found = clashing([(0.0, 0.0, -20.0), (1.5, 0.0, -20.0), (2.5, 0.0, -20.0), (9.0, 0.0, -20.0)], "hold")
    assert found == [Clash(1, 2, 1.0), Clash(0, 1, 1.5)]


@pytest.mark.parametrize("action", ACTIONS)
def test_one_vehicle_has_no_conflict(action: Action) -> None:
    assert clashing([(0.0, 0.0, -20.0)], action) == []


def crossing(first_height_m: float, second_height_m: float, second_home_m: float) -> list[Clash]:
    """The ways home are the diagonals of a square."""
    here: list[Place] = [(0.0, 0.0, -first_height_m), (0.0, 40.0, -second_height_m)]
    return clashing(here, "return", home_m=[(40.0, 40.0, 0.0), (40.0, 0.0, -second_home_m)])


@pytest.mark.parametrize(
    ("first_m", "second_m", "second_home_m", "clash"),
    [
        (10.0, 20.0, 0.0, True),  # both climb to 30 m
        (40.0, 42.9, 0.0, True),  # both are higher, and stay there
        (40.0, 43.1, 0.0, False),
        (43.1, 40.0, 0.0, False),
        (10.0, 20.0, 2.9, True),  # one climbs to 32.9 m, for its home is higher
        (10.0, 20.0, 3.1, False),
        (10.0, 20.0, -3.1, False),
        (35.0, 20.0, 5.0, True),  # one is at 35 m, the other climbs there
        (35.0, 20.0, 0.0, False),
        (30.5, 36.0, 5.0, False),
    ],
)
def test_crossing_return_paths_conflict_at_one_height(
    first_m: float, second_m: float, second_home_m: float, clash: bool
) -> None:
    assert crossing(first_m, second_m, second_home_m) == ([Clash(0, 1, 0.0)] if clash else [])


@pytest.mark.parametrize(("beside_m", "clash"), [(1.9, True), (2.1, False)])
def test_parallel_return_paths_conflict_within_the_floor(beside_m: float, clash: bool) -> None:
    # one flies north along y = 0, the other follows it 20 m behind, and ends 20 m before it
    here: list[Place] = [(0.0, 0.0, -20.0), (-20.0, beside_m, -20.0)]
    found = clashing(here, "return", home_m=[(40.0, 0.0, 0.0), (20.0, beside_m, 0.0)])
    assert sideways_m(found) == pytest.approx([beside_m] if clash else [])


@pytest.mark.parametrize(("apart_m", "clash"), [(1.9, True), (2.1, False)])
def test_adjacent_vehicle_may_climb_past_at_any_height(apart_m: float, clash: bool) -> None:
    # uncrossed ways at 40 m and 50 m, away from each other
    here: list[Place] = [(0.0, 0.0, -40.0), (0.0, apart_m, -50.0)]
    found = clashing(here, "return", home_m=[(0.0, -30.0, 0.0), (0.0, 30.0, 0.0)])
    assert sideways_m(found) == pytest.approx([apart_m] if clash else [])


@pytest.mark.parametrize(("apart_m", "clash"), [(1.9, True), (2.1, False)])
def test_descending_meets_a_vehicle_arriving_lower_beside_it(apart_m: float, clash: bool) -> None:
    here: list[Place] = [(0.0, -30.0, -40.0), (0.0, 30.0, -50.0)]
    found = clashing(here, "return", home_m=[(0.0, 0.0, 0.0), (0.0, apart_m, 0.0)])
    assert sideways_m(found) == pytest.approx([apart_m] if clash else [])


@pytest.mark.parametrize("turned_round", [False, True])
@pytest.mark.parametrize(
    ("past_m", "comes_from_m", "roof_m", "passes_m", "clash"),
    [
        (1.9, 50.0, 0.0, 20.0, True),  # the other passes at 30 m
        (2.1, 50.0, 0.0, 20.0, False),
        (1.9, 50.0, 0.0, 60.0, False),  # it passes above
        (0.0, 50.0, 0.0, 52.9, True),
        (0.0, 50.0, 0.0, 53.1, False),
        (0.0, 50.0, 32.9, 20.0, True),  # a pad on a roof: no vehicle comes down farther
        (0.0, 50.0, 33.1, 20.0, False),
    ],
)
def test_descending_meets_a_vehicle_passing_above_its_pad(
    past_m: float, comes_from_m: float, roof_m: float, passes_m: float, clash: bool, turned_round: bool
) -> None:
    here: list[Place] = [(0.0, -30.0, -max(comes_from_m, 30.0 + roof_m)), (-20.0, past_m, -passes_m)]
    home: list[Place] = [(0.0, 0.0, -roof_m), (20.0, past_m, 0.0)]
    if turned_round:
        here, home = here[::-1], home[::-1]
    found = clashing(here, "return", home_m=home)
    assert sideways_m(found) == pytest.approx([past_m] if clash else [])


@pytest.mark.parametrize("turned_round", [False, True])
@pytest.mark.parametrize(
    ("past_m", "begins_m", "clash"),
    [
        (1.9, 10.0, True),  # it climbs to 30 m, and meets the other at 15 m
        (2.1, 10.0, False),
        (0.0, 17.9, True),
        (0.0, 18.1, False),  # it begins above the other
    ],
)
def test_climbing_meets_a_vehicle_returning_into_a_valley(
    past_m: float, begins_m: float, clash: bool, turned_round: bool
) -> None:
    here: list[Place] = [(0.0, 0.0, -begins_m), (-20.0, past_m, -12.0)]
    home: list[Place] = [(0.0, -30.0, 0.0), (20.0, past_m, 15.0)]  # 15 m below: flown to at 15 m
    if turned_round:
        here, home = here[::-1], home[::-1]
    found = clashing(here, "return", home_m=home)
    assert sideways_m(found) == pytest.approx([past_m] if clash else [])


def test_vehicle_above_its_home_is_met_there() -> None:
    here: list[Place] = [(0.0, 0.0, -20.0), (-20.0, 1.0, -20.0)]
    found = clashing(here, "return", home_m=[(0.0, 0.0, 0.0), (20.0, 1.0, 0.0)])
    assert sideways_m(found) == pytest.approx([1.0])


def test_return_path_below_a_metre_is_flown_completely() -> None:
    # it leads past the other, which comes down beside the middle of it
    here: list[Place] = [(0.0, 0.0, -20.0), (0.4, 1.0, -20.0)]
    found = clashing(here, "return", home_m=[(0.8, 0.0, 0.0), (0.4, 1.0, 0.0)])
    assert sideways_m(found) == pytest.approx([1.0])


CENTER_M = np.array([3.0, -2.0, -30.0])


@pytest.mark.parametrize(
    "chord_m",
    [
        (4.0, 0.0, 0.0),
        (0.0, -1.0, 0.0),
        (1.0, 2.0, 2.0),
        (2.0, -1.0, -2.0),
        (0.6, 0.0, 0.8),
        (0.3, 0.0, -0.4),
    ],
)
def test_two_are_turned_about_the_centre_until_stacked(chord_m: Place) -> None:
    before_m = CENTER_M + np.outer([0.5, -0.5], chord_m)
    after_m = turned_upright(before_m, CENTER_M)
    length_m = float(np.linalg.norm(chord_m))
    assert after_m.mean(axis=0) == pytest.approx(CENTER_M)
    assert np.abs(after_m[0] - after_m[1]) == pytest.approx([0.0, 0.0, length_m], abs=1e-9)


@pytest.mark.parametrize("above_m", [0.5, -0.5, 4.0, -4.0])
def test_vehicle_already_above_another_stays_there(above_m: float) -> None:
    before_m = CENTER_M + np.array([[1.0, 1.0, above_m], [1.0, 1.0, 0.0], [-9.0, 0.0, 0.0]])
    after_m = turned_upright(before_m, CENTER_M)
    assert after_m[0] - after_m[1] == pytest.approx([0.0, 0.0, above_m])
    assert np.linalg.norm(after_m[2] - CENTER_M) == pytest.approx(9.0)


@pytest.mark.parametrize("nearest", [(0, 1), (1, 2), (0, 2), (2, 3)])
def test_nearest_two_are_turned_and_all_others_with_them(nearest: tuple[int, int]) -> None:
    offset_m = np.array([[9.0, 0.0, 1.0], [0.0, 9.0, 2.0], [-9.0, 0.0, 3.0], [0.0, -9.0, -4.0]])
    first, second = nearest
    offset_m[second] = offset_m[first] + (1.0, 2.0, 2.0)
    after_m = turned_upright(CENTER_M + offset_m, CENTER_M) - CENTER_M
    assert after_m[second] - after_m[first] == pytest.approx([0.0, 0.0, 3.0], abs=1e-9)
    assert after_m @ after_m.T == pytest.approx(offset_m @ offset_m.T), "turned, not bent"
    assert np.linalg.det(after_m[[0, 1, 2]]) == pytest.approx(np.linalg.det(offset_m[[0, 1, 2]])), "no mirror"


@pytest.mark.parametrize("offset_m", [[], [(5.0, 0.0, 0.0)], [(5.0, 0.0, 0.0), (5.0, 0.0, 0.0)]])
def test_without_two_distinct_positions_nothing_is_turned(offset_m: list[Place]) -> None:
    before_m = CENTER_M + np.array(offset_m).reshape(-1, 3)
    after_m = turned_upright(before_m, CENTER_M)
    assert after_m.tolist() == before_m.tolist()
    assert not np.shares_memory(after_m, before_m)
