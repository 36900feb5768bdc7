"""The models of a target in loops, against the same with matrices, and of many targets at once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.estimation.targets.models import (
    AGILITY,
    LEAST_WEIGHT,
    LEAVES_PER_S,
    MODELS,
    SPREAD,
    STATES,
    TURN,
    TURN_AGILITY,
    TURN_VARIANCE,
    WIDTH,
)
from gcs.estimation.targets.motion import TargetBelief, all_foreseen, begun, corrected, foreseen, off
from gcs.model.state import Array

SEEDS = st.integers(0, 1_000_000)


def moved(mean: Array, dt_s: float, *, turns: bool) -> Array:
    """(5,) `dt_s` later, along a circle."""
    x_m, y_m, x_m_s, y_m_s, turn = mean
    turn, along = turn if turns else 0.0, complex(x_m_s, y_m_s)
    way = along * dt_s if turn == 0.0 else along * (np.exp(1j * turn * dt_s) - 1.0) / (1j * turn)
    then = along * np.exp(1j * turn * dt_s)
    return np.array([x_m + way.real, y_m + way.imag, then.real, then.imag, turn])


def grown(mean: Array, covariance: Array, model: int, dt_s: float) -> Array:
    """(5, 5) `dt_s` later, with differences in place of derivatives."""
    nudge = 1e-6
    step = np.column_stack(
        [
            (moved(mean + by, dt_s, turns=model == TURN) - moved(mean - by, dt_s, turns=model == TURN))
            / (2.0 * nudge)
            for by in nudge * np.eye(STATES)
        ]
    )
    later = step @ covariance @ step.T
    later[:4, :4] += AGILITY[model] * np.kron(
        [[dt_s**3 / 3.0, dt_s**2 / 2.0], [dt_s**2 / 2.0, dt_s]], np.eye(2)
    )
    later[4, 4] += TURN_AGILITY * dt_s if model == TURN else TURN_VARIANCE
    return later


def by_matrices(belief: TargetBelief, dt_s: float, reported: Array, variance: Array) -> Array:
    """The weights, means and covariances (3, WIDTH) after a report."""
    stays = np.exp(-LEAVES_PER_S * dt_s)
    to = np.full((MODELS, MODELS), (1.0 - stays) / (MODELS - 1)) + np.eye(MODELS) * (
        stays - (1.0 - stays) / (MODELS - 1)
    )
    weight, means = belief.values[:, 0], belief.values[:, 1:SPREAD]
    spreads = belief.values[:, SPREAD:].reshape(MODELS, STATES, STATES)
    after, fits = np.empty((MODELS, WIDTH)), np.empty(MODELS)
    for model in range(MODELS):
        share = weight * to[:, model] / (weight @ to[:, model])
        mean = share @ means
        apart = means - mean
        spread = np.tensordot(share, spreads + apart[:, :, None] * apart[:, None], 1)
        spread, mean = grown(mean, spread, model, dt_s), moved(mean, dt_s, turns=model == TURN)
        seen = spread[: len(reported), : len(reported)] + np.diag(variance)
        missed = reported - mean[: len(reported)]
        gain = spread[:, : len(reported)] @ np.linalg.inv(seen)
        fits[model] = -0.5 * (missed @ np.linalg.solve(seen, missed) + np.linalg.slogdet(seen)[1])
        after[model, 1:SPREAD] = mean + gain @ missed
        after[model, SPREAD:] = (spread - gain @ seen @ gain.T).ravel()
    weight = np.maximum(weight @ to * np.exp(fits - fits.max()), LEAST_WEIGHT)
    after[:, 0] = weight / weight.sum()
    return after


def followed(seed: int) -> tuple[TargetBelief, np.random.Generator]:
    """What is believed of a target on a circle, and what draws its next report."""
    random = np.random.default_rng(seed)
    place_m, belief = random.normal(0.0, 50.0, 2), begun(0.0, np.zeros(2), np.ones(2))
    for number in range(random.integers(3, 30)):
        angle = number / 15.0
        values = np.concatenate(
            [place_m + 20.0 * np.array([np.sin(angle), np.cos(angle)]), random.normal(size=2)]
        )
        belief = corrected(belief, number / 5.0, values[: random.choice([2, 4])], np.ones(4))
    return belief, random


@given(SEEDS)
def test_report_corrects_as_matrices_do(seed: int) -> None:
    belief, random = followed(seed)
    dt_s, many = random.uniform(0.0, 10.0), random.choice([2, 4])
    reported, variance = random.normal(0.0, 30.0, many), random.uniform(0.01, 9.0, many)
    expected = by_matrices(belief, dt_s, reported, variance)
    values = corrected(belief, belief.time_s + dt_s, reported, variance).values
    np.testing.assert_allclose(values, expected, rtol=2e-3, atol=2e-3)  # a turn of 1e-4 rad counts as none


@given(SEEDS)
def test_many_targets_are_foreseen_as_each_one(seed: int) -> None:
    beliefs = [followed(seed + number)[0] for number in range(4)]
    for motion, belief in zip(all_foreseen(beliefs, 7.0), beliefs, strict=True):
        np.testing.assert_array_equal(motion.values, foreseen(belief, 7.0).values)


@given(SEEDS)
def test_place_is_off_by_deviations_of_both(seed: int) -> None:
    belief, random = followed(seed)
    motion, (x_m, y_m) = foreseen(belief, 8.0), random.normal(0.0, 50.0, 2).tolist()
    apart_m = np.array([x_m, y_m]) - motion.position_m
    both = motion.covariance[:2, :2] + 4.0 * np.eye(2)
    deviations = np.sqrt(apart_m @ np.linalg.solve(both, apart_m))
    off_m, off_by = off(belief, 8.0, 8.0, (x_m, y_m), 4.0)
    assert off_m == pytest.approx(np.hypot(*apart_m), rel=1e-9)
    assert off_by == pytest.approx(deviations, rel=1e-9)
