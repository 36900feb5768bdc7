"""What becomes of a fleet that has lost control, against ways flown in many small steps."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import event, given
from hypothesis import strategies as st

from gcs.model.state import Array
from gcs.planning.setpoint_loss import Action, clashes, turned_upright
from gcs.safety.floor import Floor
from tests.support.law_fleets import places, vectors
from tests.support.safety_fleets import CALM

FLOOR = Floor(uncertainty_m=0.0)
ANY_DISTANCE = Floor(horizontal_m=1000.0, vertical_m=1000.0)
"""So wide that every pair clashes, and tells how near its ways come."""

STEPS = 200
SHARES = np.linspace(0.0, 1.0, STEPS + 1)[:, None]


def found(position_m: Array, home_m: Array, action: Action, floor: Floor) -> dict[tuple[int, int], float]:
    return {
        (clash.first, clash.second): clash.sideways_m
        for clash in clashes(
            position_m,
            home_m,
            action,
            floor=floor,
            uncertainty_m=np.zeros(len(position_m)),
            speed_m_s=0.0,
            return_height_m=30.0,
        )
    }


def flown(start_m: Array, end_m: Array) -> Array:
    """(steps, 2) seen from above."""
    way_m: Array = start_m[:2] + SHARES * (end_m - start_m)[:2]
    return way_m


@CALM
@given(vectors(4, 10.0), vectors(4, 10.0), st.booleans())
def test_predicted_approach_on_return_paths_equals_the_flown(
    spread: Array, home: Array, whole_metres: bool
) -> None:
    if whole_metres:  # many begin where others end, and in one line with them
        spread, home = np.round(spread / 5.0) * 5.0, np.round(home / 5.0) * 5.0
    position = spread - (0.0, 0.0, 20.0)
    nearest = found(position, home, "return", ANY_DISTANCE)
    assert set(nearest) == set(combinations(range(4), 2))
    for (i, j), sideways_m in nearest.items():
        one, other = flown(position[i], home[i]), flown(position[j], home[j])
        seen_m = float(np.linalg.norm(one[:, None] - other[None], axis=2).min())
        step_m = np.linalg.norm((home - position)[[i, j], :2], axis=1).sum() / STEPS
        event(f"ways cross: {sideways_m == 0.0}")
        assert sideways_m - 1e-9 <= seen_m <= sideways_m + step_m + 1e-9


def whole_way(position_m: Array, home_m: Array) -> Array:
    """(steps, 3) the whole way home: up to 30 m, level, down."""
    level_m = max(-position_m[2], 30.0 - home_m[2])
    above_m, there_m = (np.array([*place_m[:2], -level_m]) for place_m in (position_m, home_m))
    ends_m = (position_m, above_m), (above_m, there_m), (there_m, home_m)
    return np.concatenate([begin_m + SHARES * (end_m - begin_m) for begin_m, end_m in ends_m])


@CALM
@given(vectors(3, 6.0), vectors(3, 6.0), st.booleans())
def test_return_path_conflicts_are_reported_at_any_progress(spread: Array, home: Array, high: bool) -> None:
    position = spread * (1.0, 1.0, 2.0) - (0.0, 0.0, 40.0 if high else 20.0)
    home = home * (1.0, 1.0, 2.0)  # on slopes
    reported = set(found(position, home, "return", FLOOR))
    ways = [whole_way(position[i], home[i]) for i in range(3)]
    semi_m = np.array([FLOOR.horizontal_m, FLOOR.horizontal_m, FLOOR.vertical_m])
    nearest = {
        (i, j): float(np.linalg.norm((ways[i][:, None] - ways[j][None]) / semi_m, axis=2).min())
        for i, j in combinations(range(3), 2)
    }
    event(f"clashes: {len(reported)}")
    assert {pair for pair, share in nearest.items() if share < 1.0} <= reported
    beside = {
        (i, j)
        for i, j in nearest
        if np.hypot(*(position[i] - position[j])[:2]) < FLOOR.horizontal_m  # they may climb past each other
    }
    assert reported <= beside | {pair for pair, share in nearest.items() if share < 1.1}


def come_inside(position_m: Array, shrunk: float) -> set[tuple[int, int]]:
    """Who comes inside a floor of that share while all sink alike, until they stand on the ground."""
    height_m = np.maximum(-position_m[:, 2] - np.arange(0.0, 60.0, 0.02)[:, None], 0.0)
    inside = set()
    for i, j in combinations(range(len(position_m)), 2):
        aside = np.hypot(*(position_m[i] - position_m[j])[:2]) / (shrunk * FLOOR.horizontal_m)
        above = (height_m[:, i] - height_m[:, j]) / (shrunk * FLOOR.vertical_m)
        counts = np.maximum(height_m[:, i], height_m[:, j]) >= FLOOR.pad_height_m
        if (counts & (aside**2 + above**2 < 1.0)).any():
            inside.add((i, j))
    return inside


@CALM
@given(places(5), st.sampled_from(["descend", "land"]))
def test_descending_vehicles_conflict_where_they_descend(spread: Array, action: Action) -> None:
    position = spread * (0.05, 0.05, 1.0)
    reported = set(found(position, np.zeros((5, 3)), action, FLOOR))
    event(f"clashes: {len(reported)}")
    assert come_inside(position, 0.97) <= reported <= come_inside(position, 1.03)


@CALM
@given(places(5))
def test_upright_formation_is_congruent_with_nearest_two_stacked(
    position: Array,
) -> None:
    center = position.mean(axis=0)
    turned = turned_upright(position, center)
    away, before = turned - center, position - center
    assert away @ away.T == pytest.approx(before @ before.T, abs=1e-6)
    pairs = list(combinations(range(5), 2))
    apart_m = [float(np.linalg.norm(position[i] - position[j])) for i, j in pairs]
    upright = [
        np.hypot(*(turned[i] - turned[j])[:2]) < 1e-6 * (1.0 + distance_m)
        for (i, j), distance_m in zip(pairs, apart_m, strict=True)
        if distance_m < min(apart_m) + 1e-9
    ]
    assert any(upright)
