"""Whatever the pattern, its rotation and shift are found again, also where some stand elsewhere."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gcs.model.state import Array
from gcs.preflight.fleet import assigned, fit

WITHIN_M = 1.5
SEEDS = st.integers(0, 2**32 - 1)


def grid_m(random: np.random.Generator, count: int) -> Array:
    """Places 4 m apart on a grid, not all of them taken, anywhere."""
    cells = random.permutation(np.argwhere(np.ones((count, count))))[:count]
    place_m: Array = 4.0 * cells + random.uniform(-100.0, 100.0, 2)
    return place_m


def moved(place_m: Array, turn_rad: float, shift_m: Array) -> Array:
    """Turned about its middle, clockwise from above, then shifted."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    middle_m = place_m.mean(axis=0)
    lies_m: Array = (place_m - middle_m) @ np.array([[c, s], [-s, c]]) + middle_m + shift_m
    return lies_m


@given(
    SEEDS,
    st.integers(3, 60),
    st.floats(-np.pi + 1e-3, np.pi - 1e-3),
    st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0)),
)
@settings(max_examples=150, deadline=None)
def test_rotation_and_shift_are_found_again(
    seed: int, count: int, turn_rad: float, shift: tuple[float, float]
) -> None:
    expected_m = grid_m(np.random.default_rng(seed), count)
    shift_m = np.array(shift)
    found = fit(expected_m, moved(expected_m, turn_rad, shift_m), np.zeros(count), WITHIN_M)
    assert found.stands.all()
    assert np.angle(np.exp(1j * (found.rotation_rad - turn_rad))) == pytest.approx(0.0, abs=1e-6)
    assert found.shift_m == pytest.approx(shift_m, abs=1e-6)
    assert found.placed_m(expected_m) == pytest.approx(moved(expected_m, turn_rad, shift_m), abs=1e-6)


@given(SEEDS, st.integers(8, 60), st.floats(-0.5, 0.5))
@settings(max_examples=150, deadline=None)
def test_noise_rotates_the_fit_by_no_more_than_reported(seed: int, count: int, turn_rad: float) -> None:
    random = np.random.default_rng(seed)
    expected_m, off_m = grid_m(random, count), 0.3
    noise_m = random.uniform(-off_m, off_m, (count, 2))
    measured_m = moved(expected_m, turn_rad, np.array([3.0, -2.0])) + noise_m
    found = fit(expected_m, measured_m, np.full(count, 2.0 * off_m), WITHIN_M)
    assert found.stands.all()
    assert abs(found.rotation_rad - turn_rad) <= 2.0 * found.reported_rad
    assert np.linalg.norm(found.shift_m - (3.0, -2.0)) <= 2.0 * off_m


@given(SEEDS, st.integers(9, 60), st.floats(-0.5, 0.5))
@settings(max_examples=150, deadline=None)
def test_a_displaced_quarter_is_named_and_changes_nothing(seed: int, count: int, turn_rad: float) -> None:
    random = np.random.default_rng(seed)
    expected_m = grid_m(random, count)
    measured_m = moved(expected_m, turn_rad, np.array([1.0, 2.0]))
    astray = random.permutation(count)[: count // 4]
    measured_m[astray] += random.uniform(10.0, 40.0, (len(astray), 2))
    found = fit(expected_m, measured_m, np.zeros(count), WITHIN_M)
    assert set(np.flatnonzero(~found.stands).tolist()) == set(astray.tolist())
    assert found.rotation_rad == pytest.approx(turn_rad, abs=1e-6)


@given(SEEDS, st.integers(2, 40), st.integers(0, 5))
@settings(max_examples=100, deadline=None)
def test_each_vehicle_gets_its_own_place_while_there_are_any(seed: int, count: int, spares: int) -> None:
    random = np.random.default_rng(seed)
    expected_m = grid_m(random, count)
    assume(spares <= count)
    own = np.arange(count, dtype=np.intp)
    own[random.permutation(count)[:spares]] = -1
    measured_m = moved(expected_m, 0.02, np.array([0.5, 0.0]))
    place = assigned(expected_m, measured_m, own, WITHIN_M)
    assert sorted(place.tolist()) == list(range(count))
    if count - spares >= 2:
        assert place.tolist() == list(range(count)), "each spare is nearest to the place that it stands on"
