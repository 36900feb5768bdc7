"""Which pairs could come too close: every one that double precision says is found, and few others."""

import numpy as np
import pytest

from gcs.model.state import Array, Mask
from gcs.safety.binding_pairs import WHOLE, Worst, pairs_that_could_bind
from gcs.safety.neighbours import FEW

WORST: Worst = 0.7, 1.2, 0.8, 0.6, 2.0
"""A floor that is flatter or taller by the pair, and vehicles that stop as delivered ones do."""

ROUNDING_M = 0.2
"""More than single precision takes for fleets of these extents."""

FLEETS = pytest.mark.parametrize(
    ("count", "edge_m", "away_m"),
    [(60, 40.0, 0.0), (FEW + 50, 60.0, 0.0), (FEW + 50, 60.0, 4000.0), (WHOLE + 300, 160.0, 0.0)],
)


def fleet(count: int, edge_m: float, away_m: float) -> tuple[Array, Array, Array, Array, Array]:
    """Positions, courses and measured velocities (n, 3), parts of semi-axes, and ways kept behind (n,)."""
    random = np.random.default_rng(count)
    position_m = away_m + random.uniform(0.0, edge_m, (count, 3))
    course_m_s, measured_m_s = random.uniform(-3.0, 3.0, (2, count, 3))
    size_m, shared_m = random.uniform(1.0, 2.0, count), random.uniform(0.0, 1.5, count)
    return position_m, course_m_s, measured_m_s, size_m, shared_m


def searched(parts: tuple[Array, Array, Array, Array, Array], some: Mask) -> set[tuple[int, int]]:
    """The pairs, the smaller row first."""
    position_m, course_m_s, measured_m_s, size_m, shared_m = parts
    thin, thick, reaction_s, lead_s, deceleration_m_s2 = WORST
    spare_m_s = np.full(len(size_m), 0.25)
    fast_m_s, drift_m_s = np.linalg.norm(course_m_s, axis=1) + 0.25, np.linalg.norm(measured_m_s, axis=1)
    used_m = fast_m_s * reaction_s + fast_m_s**2 / deceleration_m_s2 + lead_s * drift_m_s + shared_m
    first, second = pairs_that_could_bind(
        some,
        np.asarray(np.isfinite(position_m).all(axis=1)),
        position_m * (1.0, 1.0, thin),
        size_m + max(thick / thin, 1.0) * used_m,
        (position_m, course_m_s, measured_m_s),
        (size_m, spare_m_s, shared_m),
        WORST,
    )
    pairs = {(min(pair), max(pair)) for pair in zip(first.tolist(), second.tolist(), strict=True)}
    assert len(pairs) == len(first), "each pair once"
    return pairs


def over_m(parts: tuple[Array, Array, Array, Array, Array]) -> Array:
    """(n, n) by how much each pair could be too close, in double precision."""
    position_m, course_m_s, measured_m_s, size_m, shared_m = parts
    thin, thick, reaction_s, lead_s, deceleration_m_s2 = WORST

    def between(values: Array) -> Array:
        return np.asarray(values[:, None] - values[None])

    off_m = between(position_m)
    level_m2, high_m2 = off_m[..., 0] ** 2 + off_m[..., 1] ** 2, off_m[..., 2] ** 2
    near_m, far_m = np.sqrt(level_m2 + thin**4 * high_m2), np.sqrt(level_m2 + thick**4 * high_m2)

    def apart(velocity_m_s: Array) -> Array:
        along = off_m * between(velocity_m_s)
        upright = np.minimum(thin**2 * along[..., 2], thick**2 * along[..., 2])
        return np.asarray(along[..., 0] + along[..., 1] + upright)

    with np.errstate(invalid="ignore", divide="ignore"):
        parting = apart(course_m_s)
        needed_m_s = np.maximum(0.5 - np.minimum(parting / far_m, parting / near_m), 0.0)
        used_m = lead_s * np.maximum(-apart(measured_m_s) / near_m, 0.0) + needed_m_s * reaction_s
    used_m += np.maximum(shared_m[:, None], shared_m[None]) + needed_m_s**2 / (2.0 * deceleration_m_s2)
    size = size_m[:, None] + size_m[None]
    return np.asarray(max(thick, 1.0) * used_m + size - np.sqrt(level_m2 + thin**2 * high_m2))


@FLEETS
def test_no_pair_that_could_bind_is_left_out(count: int, edge_m: float, away_m: float) -> None:
    parts = fleet(count, edge_m, away_m)
    pairs = searched(parts, np.ones(count, np.bool_))
    first, second = np.triu_indices(count, 1)
    exact_m = over_m(parts)[first, second]
    could = set(zip(first[exact_m >= 0.0].tolist(), second[exact_m >= 0.0].tolist(), strict=True))
    nearly = exact_m >= -ROUNDING_M
    assert 20 < len(could) < len(first) / 2
    assert could <= pairs <= set(zip(first[nearly].tolist(), second[nearly].tolist(), strict=True))


@FLEETS
def test_pairs_without_one_of_some_are_left_out(count: int, edge_m: float, away_m: float) -> None:
    parts = fleet(count, edge_m, away_m)
    some = np.arange(count) % 7 == 0
    every = searched(parts, np.ones(count, np.bool_))
    assert searched(parts, some) == {pair for pair in every if some[list(pair)].any()}


def test_a_vehicle_of_unknown_course_could_meet_all() -> None:
    parts = fleet(60, 40.0, 0.0)
    parts[1][3] = np.nan
    others = {min(pair) + max(pair) - 3 for pair in searched(parts, np.ones(60, np.bool_)) if 3 in pair}
    assert len(others) == 59


def test_a_vehicle_of_unknown_place_meets_none() -> None:
    parts = fleet(60, 40.0, 0.0)
    parts[0][3] = np.nan
    assert not any(3 in pair for pair in searched(parts, np.ones(60, np.bool_)))


def test_two_in_one_place_are_a_pair() -> None:
    parts = fleet(60, 4000.0, 0.0)
    parts[0][3] = parts[0][4]
    assert (3, 4) in searched(parts, np.ones(60, np.bool_))
