"""Projection, shortening and limits, whatever they are given."""

import numpy as np
import pytest
from hypothesis import assume, event, given
from hypothesis import strategies as st
from scipy.optimize import nnls

from gcs.model.state import Array, Mask
from gcs.safety.constraints import NO_ROW, TOLERANCE_M_S, Constraints
from gcs.safety.filter import cap
from tests.support.law_fleets import masks, vectors, within
from tests.support.safety_fleets import CALM, LIMITS, assert_within_limits
from tests.support.safety_world import project, shrink


@st.composite
def half_spaces(draw: st.DrawFn) -> tuple[Array, Constraints]:
    """Velocities of four vehicles and up to eight constraints over them, those that rest satisfies."""
    k = draw(st.integers(1, 8))
    raw = draw(vectors(k, 1.0))
    assume(np.linalg.norm(raw, axis=1).min() > 0.1)
    first = np.array(draw(st.lists(st.integers(0, 3), min_size=k, max_size=k)))
    step = np.array(draw(st.lists(st.integers(0, 3), min_size=k, max_size=k)))
    second = np.where(step == 0, NO_ROW, (first + step) % 4)
    bound = -np.array(draw(st.lists(within(0.0, 3.0), min_size=k, max_size=k)))
    normal = raw / np.linalg.norm(raw, axis=1, keepdims=True)
    return draw(vectors(4, 8.0)), Constraints(first, second, normal, bound, np.full(k, "c", dtype=object))


@CALM
@given(half_spaces())
def test_shrinking_only_shortens_until_all_constraints_hold(drawn: tuple[Array, Constraints]) -> None:
    velocity, constraints = drawn
    shrunk = shrink(velocity, constraints)
    before, after = np.linalg.norm(velocity, axis=1), np.linalg.norm(shrunk, axis=1)
    assert (after <= before + 1e-12).all()
    assert np.allclose(np.cross(shrunk, velocity), 0.0, atol=1e-9)
    assert ((shrunk * velocity).sum(axis=1) >= 0.0).all()
    assert (constraints.slack_m_s(shrunk) >= -1.1e-3).all()


@CALM
@given(half_spaces(), vectors(4, 1.0))
def test_no_legal_velocity_is_nearer_than_the_projection(
    drawn: tuple[Array, Constraints], other: Array
) -> None:
    desired, constraints = drawn
    projected = project(desired, constraints)
    legal = shrink(projected + other, constraints)  # any legal point near it
    assume((constraints.slack_m_s(legal) >= 0.0).all())
    assert np.linalg.norm(projected - desired) <= np.linalg.norm(legal - desired) + 0.05


@CALM
@given(vectors(5, 1e6), masks(5))
def test_velocities_not_finite_become_zero_others_keep_limits(desired: Array, bad: Mask) -> None:
    spoiled = desired.copy()
    spoiled[bad, 1] = np.nan
    capped = cap(spoiled, LIMITS)
    assert_within_limits(capped)
    assert not capped[bad].any()
    assert np.allclose(np.cross(capped[~bad], desired[~bad]) / 1e6, 0.0, atol=1e-6)


def exactly_nearest(desired: Array, constraints: Constraints) -> Array:
    """By Lawson and Hanson's least distance programming: the shortest change that keeps all of them."""
    rows = np.zeros((len(constraints), *desired.shape))
    for k in range(len(constraints)):
        rows[k, constraints.first[k]] += constraints.normal[k]
        if constraints.second[k] != NO_ROW:
            rows[k, constraints.second[k]] -= constraints.normal[k]
    held = np.column_stack([rows.reshape(len(rows), -1), -constraints.slack_m_s(desired)]).T
    unit = np.zeros(len(held))
    unit[-1] = 1.0
    residual = held @ nnls(held, unit)[0] - unit
    change: Array = -residual[:-1] / residual[-1]
    return desired + change.reshape(desired.shape)


@CALM
@given(half_spaces())
def test_projection_equals_the_least_squares_nearest_point(
    drawn: tuple[Array, Constraints],
) -> None:
    desired, constraints = drawn
    exact = exactly_nearest(desired, constraints)
    assume(np.abs(exact).max() < 1e3)
    found = project(desired, constraints)
    assume((constraints.slack_m_s(found) >= -TOLERANCE_M_S).all())  # else the sweeps ended: `shrink` follows
    event(f"changed: {not np.allclose(exact, desired)}")
    assert np.allclose(found, exact, atol=0.02)


@pytest.mark.parametrize("seed", range(6))
def test_projection_of_many_coupled_vehicles_is_nearest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first = rng.integers(0, 10, 25)
    normal = rng.normal(0.0, 1.0, (25, 3))
    constraints = Constraints(
        first,
        np.where(rng.random(25) < 0.2, NO_ROW, (first + rng.integers(1, 10, 25)) % 10),
        normal / np.linalg.norm(normal, axis=1, keepdims=True),
        -rng.uniform(0.0, 1.0, 25),
        np.full(25, "c", dtype=object),
    )
    desired = rng.normal(0.0, 4.0, (10, 3))
    assert np.allclose(project(desired, constraints), exactly_nearest(desired, constraints), atol=0.01)
