"""Paths home for a whole fleet: no two vehicles meet, all land; a fleet without a path is reported."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.model.errors import ShapeError
from gcs.model.state import Array, Mask
from gcs.planning.return_paths.candidates import Closed
from gcs.planning.return_paths.paths import STEP_S, ReturnPaths
from gcs.planning.return_paths.planner import Planner, plan_return_paths
from gcs.safety.floor import Floor
from gcs.safety.surroundings import Limits

FLOOR = Floor()
UNSURE_M = 0.7
OVER_M, HANDOVER_M = 5.0, 1.5


def planner_of(start_m: Array, pad_m: Array, **changes: object) -> Planner:
    usual = {
        "speed_m_s": 4.0,
        "goal_rate_per_s": 0.8,
        "limits": Limits(),
        "floor": FLOOR,
        "reserve_m": UNSURE_M,
    }
    return Planner(start_m, pad_m, OVER_M, HANDOVER_M, **{**usual, **changes})  # type: ignore[arg-type]


def planned(start_m: Array, pad_m: Array, **changes: object) -> ReturnPaths:
    return plan_return_paths(planner_of(start_m, pad_m, **changes))


def fleet(count: int, seed: int) -> tuple[Array, Array]:
    """Hovering 9 m apart at random heights, each with a pad that lies anywhere on a grid."""
    random = np.random.default_rng(seed)
    side = int(np.ceil(np.sqrt(count)))
    index = np.arange(count)
    cells = np.stack([index // side, index % side], axis=1).astype(float)
    start_m = np.column_stack([9.0 * (cells - side / 2), -random.uniform(8.0, 30.0, count)])
    pad_m = np.column_stack([4.0 * (cells - side / 2), np.zeros(count)])[random.permutation(count)]
    return start_m, pad_m


def flown(return_paths: ReturnPaths, start_m: Array) -> Array:
    """(t, n, 3) of points that are drawn to their goals at the law's rate."""
    here_m, found = start_m.copy(), []
    for step in range(int(return_paths.down_s.max() / STEP_S) + 1):
        goal_m = return_paths.goal_m(step * STEP_S)
        desired = 0.8 * (goal_m - here_m)
        size = np.linalg.norm(desired, axis=1, keepdims=True)
        here_m = here_m + STEP_S * desired * np.minimum(1.0, 4.0 / np.maximum(size, 1e-9))
        found.append(here_m)
    return np.array(found)


@pytest.mark.parametrize("seed", range(6))
def test_fleet_with_crossing_paths_descends_above_the_floor(seed: int) -> None:
    start_m, pad_m = fleet(25, seed)
    return_paths = planned(start_m, pad_m)
    assert return_paths.unplanned == ()
    path_m = flown(return_paths, start_m)
    scaled = path_m * FLOOR.scale
    for t, here in enumerate(scaled):
        apart_m = np.linalg.norm(here[:, None] - here[None], axis=2) + 1e9 * np.eye(len(here))
        low = -path_m[t, :, 2] < FLOOR.pad_height_m
        apart_m[low[:, None] & low[None]] = 1e9
        assert apart_m.min() > FLOOR.horizontal_m + FLOOR.margin_m
    assert np.hypot(*(path_m[-1] - pad_m)[:, :2].T).max() < 0.5
    assert (-path_m[-1, :, 2]).max() < HANDOVER_M


@given(st.integers(2, 12), st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_no_two_paths_conflict_and_all_end_on_pads_in_time(count: int, seed: int) -> None:
    start_m, pad_m = fleet(count, seed)
    return_paths = planned(start_m, pad_m)
    assert return_paths.unplanned == ()
    assert return_paths.path_m[:, 0] == pytest.approx(start_m)
    first, second = np.triu_indices(count, 1)
    for moment_m in return_paths.path_m.swapaxes(0, 1):
        apart_m = np.linalg.norm((moment_m[first] - moment_m[second]) * FLOOR.scale, axis=1)
        low = (-moment_m[first, 2] < FLOOR.pad_height_m) & (-moment_m[second, 2] < FLOOR.pad_height_m)
        assert apart_m[~low].min(initial=np.inf) > FLOOR.horizontal_m
    assert return_paths.path_m[:, -1] == pytest.approx(pad_m, abs=0.3)
    way_m = pad_m - start_m
    longest_s = max(np.hypot(*way_m[:, :2].T).max() / 4.0, way_m[:, 2].max() / Limits().down_m_s)
    assert return_paths.down_s.max() < 1.5 * longest_s + 10.0


def test_the_same_fleet_gets_the_same_plan() -> None:
    start_m, pad_m = fleet(16, 3)
    once, again = planned(start_m, pad_m), planned(start_m, pad_m)
    assert (once.path_m == again.path_m).all()


def test_planning_stops_with_the_best_plan_so_far() -> None:
    start_m = np.array([[0.0, 0.0, -10.0], [2.0, 0.0, -10.0], [20.0, 0.0, -10.0]])
    pad_m = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [20.0, 0.0, 0.0]])  # two pads too close to each other
    asked: list[bool] = []

    def enough() -> bool:
        asked.append(True)
        return True

    return_paths = plan_return_paths(planner_of(start_m, pad_m), enough)
    assert len(asked) == 1
    assert len(return_paths.unplanned) == 1


@pytest.mark.parametrize("seed", range(3))
def test_paths_lead_round_the_space_that_lost_vehicles_sweep(seed: int) -> None:
    start_m, pad_m = fleet(25, seed)
    random = np.random.default_rng(seed)
    column_m = np.array([[random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0), -60.0]])
    kept_m = 3.0
    away_m = np.minimum(*(np.hypot(*(place_m - column_m)[:, :2].T) for place_m in (start_m, pad_m)))
    rows = np.flatnonzero(away_m > kept_m + 1.0)
    segment_m = np.concatenate([column_m, column_m * (1.0, 1.0, 0.0)])[None]
    closed = Closed(segment_m * FLOOR.scale, np.array([kept_m]), FLOOR.scale)
    return_paths = planned(start_m[rows], pad_m[rows], closed=closed)
    assert return_paths.unplanned == ()
    assert np.hypot(*(return_paths.path_m - column_m)[..., :2].reshape(-1, 2).T).min() >= kept_m - 1e-9


@pytest.mark.parametrize("name", ["start_m", "pad_m"])
def test_plan_with_an_unknown_position_is_refused(name: str) -> None:
    place_m = {"start_m": np.array([[0.0, 0.0, -10.0], [9.0, 0.0, -10.0]]), "pad_m": np.zeros((2, 3))}
    place_m[name][1, 2] = np.nan
    with pytest.raises(ShapeError, match=rf"{name} must be finite .* rows \[1\]"):
        planner_of(**place_m)


def test_plan_without_vehicles_is_refused() -> None:
    with pytest.raises(ShapeError, match="without vehicles"):
        planned(np.zeros((0, 3)), np.zeros((0, 3)))


def test_single_vehicle_flies_straight() -> None:
    start_m, pad_m = np.array([[20.0, 0.0, -15.0]]), np.zeros((1, 3))
    return_paths = planned(start_m, pad_m)
    assert return_paths.down_s[0] < 1.5 * (15.0 / 1.4) + 10.0
    assert np.linalg.norm(return_paths.goal_m(1.0)[0] - start_m[0]) > 1.0
    assert return_paths.goal_m(1e6)[0] == pytest.approx(pad_m[0])
    assert return_paths.goal_m(-1.0) == pytest.approx(return_paths.goal_m(0.0))


def test_two_above_each_others_pads_both_land() -> None:
    pad_m = np.array([[0.0, 0.0, 0.0], [14.0, 0.0, 0.0]])
    start_m = pad_m[::-1] - (0.0, 0.0, 6.0)
    return_paths = planned(start_m, pad_m)
    assert return_paths.unplanned == ()
    apart_m = np.linalg.norm(
        (flown(return_paths, start_m)[:, 0] - flown(return_paths, start_m)[:, 1]) * FLOOR.scale, axis=1
    )
    high = flown(return_paths, start_m)[:, :, 2].min(axis=1) < -FLOOR.pad_height_m
    assert apart_m[high].min() > FLOOR.horizontal_m + FLOOR.margin_m


def test_paths_keep_clear_of_occupied_places() -> None:
    start_m, pad_m = np.array([[30.0, 0.0, -10.0]]), np.zeros((1, 3))

    def are_free(place_m: Array, _: Array) -> Mask:
        return np.asarray(np.hypot(place_m[:, 0] - 15.0, place_m[:, 1]) > 3.0)

    path_m = planned(start_m, pad_m, are_free=are_free).path_m[0]
    assert np.hypot(path_m[:, 0] - 15.0, path_m[:, 1]).min() > 2.9


def test_vehicle_without_a_path_is_named_and_returns_last() -> None:
    start_m = np.array([[0.0, 0.0, -10.0], [2.0, 0.0, -10.0], [20.0, 0.0, -10.0]])
    pad_m = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [20.0, 0.0, 0.0]])  # two pads too close to each other
    return_paths = planned(start_m, pad_m)
    assert len(return_paths.unplanned) == 1
    last = return_paths.unplanned[0]
    others = [row for row in range(3) if row != last]
    assert return_paths.down_s[last] > return_paths.down_s[others].max()
    assert return_paths.goal_m(return_paths.down_s[others].max() - 0.5)[last] == pytest.approx(
        start_m[last], abs=0.5
    )
