"""Who is near whom, and how near the nearest."""

import numpy as np
import pytest

from gcs.model.state import Array, Mask
from gcs.safety.filter import filter_velocities
from gcs.safety.floor import minimum_separation, pairs_that_count, scaled_distance_m
from gcs.safety.neighbours import FEW, ROOM, near_pairs
from gcs.safety.separation import Pairs
from tests.support.safety_world import FLOOR, SETTINGS, surroundings


@pytest.mark.parametrize("count", [0, 1, 2, 60, 400])
def test_the_grid_finds_every_near_pair_once(count: int) -> None:
    rng = np.random.default_rng(count)
    position = rng.normal(0.0, 15.0, (count, 3))
    position[: count // 10] *= 40.0  # far out
    takes_part = rng.random(count) < 0.9
    radius = rng.uniform(0.1, 4.0, count)
    first, second = near_pairs(
        takes_part, np.where(takes_part[:, None], position, np.nan), takes_part, radius
    )
    i, j = np.triu_indices(count, 1)
    near = np.linalg.norm(position[i] - position[j], axis=1) < radius[i] + radius[j]
    near &= takes_part[i] & takes_part[j]
    found = [tuple(sorted(pair)) for pair in zip(first.tolist(), second.tolist(), strict=True)]
    assert sorted(found) == list(zip(i[near].tolist(), j[near].tolist(), strict=True))


def test_minimum_is_the_true_distance_and_the_floor_ellipsoidal() -> None:
    airborne = np.ones(2, dtype=bool)
    beside = np.array([[0.0, 0.0, -9.0], [2.1, 0.0, -9.0]])
    above = np.array([[0.0, 0.0, -9.0], [0.0, 0.0, -11.9]])
    assert minimum_separation(beside, airborne, FLOOR) == pytest.approx((2.1, 0))
    assert minimum_separation(above, airborne, FLOOR) == pytest.approx((2.9, 1))
    assert minimum_separation(beside, ~airborne, FLOOR) == (np.inf, 0)


def test_the_minimum_separation_of_a_crowd_and_of_two_far_apart() -> None:
    rng = np.random.default_rng(1)
    crowd = rng.normal(0.0, 30.0, (300, 3)) - (0.0, 0.0, 200.0)
    first, second = pairs_that_count(crowd, np.ones(300, bool), FLOOR)
    least = np.linalg.norm(crowd[first] - crowd[second], axis=1).min()
    inside = int((scaled_distance_m(crowd, first, second, FLOOR) < FLOOR.horizontal_m).sum())
    assert minimum_separation(crowd, np.ones(300, bool), FLOOR) == pytest.approx((least, inside))
    far = np.array([[0.0, 0.0, -9.0], [5e4, 0.0, -9.0]])
    assert minimum_separation(far, np.ones(2, bool), FLOOR) == pytest.approx((5e4, 0))
    assert minimum_separation(np.full((2, 3), np.nan), np.ones(2, bool), FLOOR) == (np.inf, 0)


@pytest.mark.parametrize("seed", range(4))
def test_the_minimum_separation_is_that_of_the_pairs_that_count(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for count in (2, 3, 5, 12):
        position = rng.uniform(-6.0, 6.0, (count, 3)) * (1.0, 1.0, 0.5) - (0.0, 0.0, 3.0)
        position[rng.random(count) < 0.2, rng.integers(3)] = np.nan
        airborne = rng.random(count) < 0.5
        pairs = pairs_that_count(position, airborne, FLOOR)
        for own in range(1, count + 1):  # the others belong to other stations
            first, second = (rows[pairs[0] < own] for rows in pairs)
            least = np.linalg.norm(position[first] - position[second], axis=1).min(initial=np.inf)
            inside = int((scaled_distance_m(position, first, second, FLOOR) < FLOOR.horizontal_m).sum())
            assert minimum_separation(position, airborne, FLOOR, own) == pytest.approx((least, inside))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_minimum_separation_is_found_at_any_distance(axis: int) -> None:
    for apart_m in (5.0, 50.0, 7000.0):
        position = np.zeros((2, 3)) - (0.0, 0.0, 10.0)
        position[1, axis] -= apart_m
        assert minimum_separation(position, np.ones(2, bool), FLOOR) == pytest.approx((apart_m, 0))
    corners = np.array([[1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]) * 1e3
    assert minimum_separation(corners, np.ones(2, bool), FLOOR)[0] == pytest.approx(2e3 * np.sqrt(3.0))


def test_unknown_positions_are_ignored_in_a_crowd() -> None:
    rng = np.random.default_rng(2)
    crowd = rng.normal(0.0, 20.0, (FEW + 20, 3)) - (0.0, 0.0, 200.0)
    for axis in range(3):
        crowd[axis, axis] = np.nan
    airborne = np.ones(len(crowd), dtype=bool)
    first, second = pairs_that_count(crowd, airborne, FLOOR)
    least = np.linalg.norm(crowd[first] - crowd[second], axis=1).min()
    assert minimum_separation(crowd, airborne, FLOOR)[0] == pytest.approx(least)


def assert_each_near_pair_once(position: Array, radius: Array, takes_part: Mask) -> None:
    found = np.sort(np.column_stack(near_pairs(takes_part, position, takes_part, radius)), axis=1)
    i, j = np.triu_indices(len(position), 1)
    near = np.linalg.norm(position[i] - position[j], axis=1) < radius[i] + radius[j]
    near &= takes_part[i] & takes_part[j]
    assert near.any()
    assert sorted(map(tuple, found.tolist())) == list(zip(i[near].tolist(), j[near].tolist(), strict=True))


MANY = FEW + 40


@pytest.mark.parametrize("look_m", [4.0, 3.0, 2.0], ids=["two cells", "three cells", "four cells"])
def test_wide_look_finds_each_vehicle_of_the_crowd_once(look_m: float) -> None:
    rng = np.random.default_rng(3)
    radius = rng.uniform(0.9 * look_m, look_m, MANY)
    assert_each_near_pair_once(rng.uniform(-4.0, 4.0, (MANY, 3)), radius, np.arange(MANY) % 4 == 0)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_stragglers_on_both_sides_of_a_crowd_find_each_other(axis: int) -> None:
    # so many of them that the outermost cells begin among them
    rng = np.random.default_rng(axis)
    position = rng.uniform(-0.5, 0.5, (MANY, 3))
    position[:, axis] = rng.uniform(-8.0, 8.0, MANY)
    position[:30, axis] *= 8.0
    assert_each_near_pair_once(position, rng.uniform(3.0, 4.0, MANY), np.ones(MANY, dtype=bool))


def test_more_pairs_than_there_is_memory_for_at_first() -> None:
    position = np.random.default_rng(4).uniform(-1.0, 1.0, (MANY, 3))
    assert MANY * (MANY - 1) / 2 > 2 * ROOM * MANY
    assert_each_near_pair_once(position, np.full(MANY, 4.0), np.ones(MANY, dtype=bool))


@pytest.mark.parametrize("seed", range(5))
def test_pairs_are_known_in_either_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    i, j = np.triu_indices(9, 1)
    flipped = rng.random(len(i)) < 0.5
    first, other = np.where(flipped, j, i), np.where(flipped, i, j)
    normal, bound_m_s = rng.normal(size=(len(i), 3)), rng.normal(size=len(i))
    order, flipped = rng.permutation(len(i)), rng.random(len(i)) < 0.5
    some, known = order[:20], order[12 : rng.integers(12, len(i))]
    turned = np.where(flipped, other, first), np.where(flipped, first, other)
    own = Pairs(first[some], other[some], other[some], normal[some], bound_m_s[some])
    others = Pairs(turned[0][known], turned[1][known], turned[1][known], normal[known], bound_m_s[known])
    new = own.not_in(others, 9)
    kept = some[~np.isin(some, known)]
    assert new.first.tolist() == first[kept].tolist()
    assert new.other.tolist() == other[kept].tolist()
    assert new.bound_m_s.tolist() == bound_m_s[kept].tolist()


def test_two_in_one_place_are_a_pair_with_all_others_unknown() -> None:
    position = np.full((MANY, 3), np.nan)
    position[[7, 90]] = 0.0
    known = np.isfinite(position[:, 0])
    first, second = near_pairs(known, position, known, np.ones(MANY))
    assert sorted([*first.tolist(), *second.tolist()]) == [7, 90]


def test_no_pair_with_all_positions_unknown() -> None:
    nowhere = np.full((MANY, 3), np.nan)
    none = np.zeros(MANY, dtype=bool)
    first, second = near_pairs(none, nowhere, none, np.ones(MANY))
    assert (len(first), len(second)) == (0, 0)
    assert minimum_separation(nowhere, np.ones(MANY, dtype=bool), FLOOR) == (np.inf, 0)


def test_all_pairs_inside_the_floor_are_counted() -> None:
    position = np.array([[0.0, 0.0, -9.0], [0.5, 0.0, -9.0], [50.0, 0.0, -9.0], [50.0, 0.0, -11.9]])
    assert minimum_separation(position, np.ones(4, dtype=bool), FLOOR) == pytest.approx((0.5, 2))


@pytest.mark.parametrize("apart_m", [99.0, 150.0, 195.0, 387.0])
def test_opposite_corners_are_found_with_a_barely_wide_look(apart_m: float) -> None:
    corner = np.full(3, apart_m / np.sqrt(12.0))
    position = np.array([corner, -corner])
    assert minimum_separation(position, np.ones(2, dtype=bool), FLOOR)[0] == pytest.approx(apart_m)


@pytest.mark.parametrize("heights", [(2.0, 1.0), (1.0, 2.0), (2.0, 2.0)])
def test_at_pad_height_no_pair_is_exempt(heights: tuple[float, float]) -> None:
    position = np.array([[0.0, 0.0, -heights[0]], [1.0, 0.0, -heights[1]]])
    airborne = np.ones(2, dtype=bool)
    assert minimum_separation(position, airborne, FLOOR)[1] == 1
    assert len(pairs_that_count(position, airborne, FLOOR)[0]) == 1
    assert reason_of(position) == "separation from d1"


def reason_of(position: Array) -> str:
    desired = np.array([[0.5, 0.0, 0.0], [0.0, 0.0, 0.0]])
    return filter_velocities(desired, surroundings(position, descending=True), SETTINGS)[1][0]
