"""Arithmetic of the interacting models of `gcs.estimation.targets.motion`, for one target or many at once.

What is believed of a target is an array (MODELS, WIDTH): of each model its weight, its mean (x, y, their
velocities, rate of turn), and its covariance (5, 5), row after row. Loops in place of matrices: these are
small, and one target costs a microsecond.
"""

from typing import Final

import numpy as np

from gcs.model.jit import kernel, kernel_within
from gcs.model.state import Array

STEADY, BRISK, TURN, MODELS, STATES = 0, 1, 2, 3, 5
MEAN, SPREAD = 1, 1 + STATES
WIDTH: Final = SPREAD + STATES * STATES
"""Columns of a model: its mean begins at `MEAN`, its covariance at `SPREAD`."""

MOVES: Final = 4
FORESEEN: Final = 6 + MOVES * MOVES
"""Columns of what is foreseen: position, velocity, acceleration of the turn, covariance of the first two."""

AGILITY: Final = (0.01, 4.0, 0.05)
"""Power of the random acceleration of each model, in m^2/s^3."""

TURN_AGILITY, TURN_VARIANCE = 0.02, 0.16
"""Power of the random change of the rate of turn, in rad^2/s^3, and its variance before a turn is seen."""

LEAVES_PER_S: Final = 0.08
"""How often a target changes from one model to another."""

LEAST_WEIGHT: Final = 1e-3

STRAIGHT_RAD: Final = 1e-4
"""A smaller turn in one step counts as none."""


@kernel
def foreseen_rows(beliefs: Array, time_s: Array, then_s: float) -> Array:
    """(n, FORESEEN) of all models together at `then_s`, from (n, MODELS, WIDTH) at (n,) or later."""
    rows = np.zeros((len(beliefs), FORESEEN))
    later, step = np.empty((MODELS, WIDTH)), np.empty((2, STATES, STATES))
    for n in range(len(beliefs)):
        later[:] = beliefs[n]
        _move(later, max(then_s - time_s[n], 0.0), step)
        row = rows[n]
        for model in range(MODELS):
            for axis in range(MOVES):
                row[axis] += later[model, 0] * later[model, MEAN + axis]
        for model in range(MODELS):
            weight = later[model, 0]
            for i in range(MOVES):
                off = later[model, MEAN + i] - row[i]
                for j in range(MOVES):
                    apart = off * (later[model, MEAN + j] - row[j])
                    row[6 + MOVES * i + j] += weight * (later[model, SPREAD + STATES * i + j] + apart)
        turn = later[TURN, 0] * later[TURN, MEAN + 4]
        row[4], row[5] = -turn * later[TURN, MEAN + 3], turn * later[TURN, MEAN + 2]
    return rows


@kernel
def off_by(
    belief: Array, dt_s: float, known_s: float, x_m: float, y_m: float, variance_m2: float
) -> tuple[float, float]:
    """How far a place is from where the target is after `dt_s`, in m and in standard deviations of both.

    The target's standard deviation is that after `known_s`.
    """
    row = foreseen_rows(belief.reshape(1, MODELS, WIDTH), np.zeros(1), dt_s)[0]
    x, y = x_m - row[0], y_m - row[1]
    if known_s != dt_s:
        row = foreseen_rows(belief.reshape(1, MODELS, WIDTH), np.zeros(1), known_s)[0]
    a, b, c = row[6] + variance_m2, row[7], row[7 + MOVES] + variance_m2
    squared = (c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b)
    return np.hypot(x, y), np.sqrt(max(squared, 0.0))


@kernel
def corrected_by(belief: Array, dt_s: float, reported: Array, variance: Array) -> Array:
    """Mix the models, move them `dt_s` on, and correct each by the report (k,) with its variances (k,)."""
    later, step = np.zeros((MODELS, WIDTH)), np.empty((2, STATES, STATES))
    _mix(belief, np.exp(-LEAVES_PER_S * dt_s), later)
    _move(later, dt_s, step)
    fits, gain, kept = np.zeros(MODELS), np.empty(STATES), step[0]
    for model in range(MODELS):
        for axis in range(len(reported)):  # errors along the axes are independent: one after the other
            seen = later[model, SPREAD + (STATES + 1) * axis] + variance[axis]
            missed = reported[axis] - later[model, MEAN + axis]
            fits[model] -= 0.5 * (missed * missed / seen + np.log(seen))
            for i in range(STATES):
                gain[i] = later[model, SPREAD + STATES * i + axis] / seen
                later[model, MEAN + i] += gain[i] * missed
            left = variance[axis] / seen  # 1 minus the gain of what is reported, without its rounding
            for i in range(STATES):
                for j in range(STATES):
                    value = later[model, SPREAD + STATES * i + j]
                    along = later[model, SPREAD + STATES * axis + j]
                    kept[i, j] = left * value if i == axis else value - gain[i] * along
            for i in range(STATES):
                for j in range(STATES):
                    value = left * kept[i, j] if j == axis else kept[i, j] - gain[j] * kept[i, axis]
                    later[model, SPREAD + STATES * i + j] = value + variance[axis] * gain[i] * gain[j]
    best = fits.max()
    for model in range(MODELS):
        later[model, 0] = max(later[model, 0] * np.exp(fits[model] - best), LEAST_WEIGHT)
    later[:, 0] /= later[:, 0].sum()
    return later


@kernel
def _mix(belief: Array, stays: float, mixed: Array) -> None:
    """What each model begins from, with its share of the others that may have changed to it, into `mixed`."""
    changes = (1.0 - stays) / (MODELS - 1)
    for model in range(MODELS):
        for other in range(MODELS):
            mixed[model, 0] += belief[other, 0] * (stays if other == model else changes)
        for other in range(MODELS):
            share = belief[other, 0] * (stays if other == model else changes) / mixed[model, 0]
            for i in range(STATES):
                mixed[model, MEAN + i] += share * belief[other, MEAN + i]
        for other in range(MODELS):
            share = belief[other, 0] * (stays if other == model else changes) / mixed[model, 0]
            for i in range(STATES):
                off = belief[other, MEAN + i] - mixed[model, MEAN + i]
                for j in range(STATES):
                    apart = off * (belief[other, MEAN + j] - mixed[model, MEAN + j])
                    mixed[model, SPREAD + STATES * i + j] += share * (
                        belief[other, SPREAD + STATES * i + j] + apart
                    )


@kernel
def _move(belief: Array, dt_s: float, work: Array) -> None:
    """Move each model by itself `dt_s` on, in place; `work` is (2, 5, 5)."""
    for model in range(MODELS):
        _step(belief[model], model == TURN, dt_s, work[0])
        _spread(belief[model, SPREAD:], work[0], work[1])
        _agility(belief[model, SPREAD:].reshape(STATES, STATES), model, dt_s)


@kernel_within
def _step(row: Array, turns: bool, dt_s: float, step: Array) -> None:
    """Move the mean of a model; its derivatives by the mean before (5, 5) become `step`."""
    x_m_s, y_m_s, turn = row[MEAN + 2], row[MEAN + 3], row[MEAN + 4] if turns else 0.0
    angle = turn * dt_s
    if abs(angle) > STRAIGHT_RAD:
        sine, cosine = np.sin(angle), np.cos(angle)
        ahead_s, aside_s = sine / turn, (1.0 - cosine) / turn
        ahead_by, aside_by = (dt_s * cosine - ahead_s) / turn, (dt_s * sine - aside_s) / turn
    else:
        sine, cosine, ahead_s, aside_s = angle, 1.0, dt_s, 0.5 * angle * dt_s
        ahead_by, aside_by = 0.0, 0.5 * dt_s * dt_s
    step[:] = 0.0
    step[0, 0] = step[1, 1] = step[4, 4] = 1.0
    step[0, 2], step[0, 3], step[1, 2], step[1, 3] = ahead_s, -aside_s, aside_s, ahead_s
    step[2, 2], step[2, 3], step[3, 2], step[3, 3] = cosine, -sine, sine, cosine
    if turns:
        step[0, 4], step[1, 4] = ahead_by * x_m_s - aside_by * y_m_s, aside_by * x_m_s + ahead_by * y_m_s
        step[2, 4] = -dt_s * (sine * x_m_s + cosine * y_m_s)
        step[3, 4] = dt_s * (cosine * x_m_s - sine * y_m_s)
    row[MEAN] += ahead_s * x_m_s - aside_s * y_m_s
    row[MEAN + 1] += aside_s * x_m_s + ahead_s * y_m_s
    row[MEAN + 2], row[MEAN + 3] = cosine * x_m_s - sine * y_m_s, sine * x_m_s + cosine * y_m_s
    row[MEAN + 4] = turn


@kernel_within
def _spread(covariance: Array, step: Array, half: Array) -> None:
    """The covariance (25,) after a step, in place; `half` is (5, 5) of any content."""
    for i in range(STATES):
        for j in range(STATES):
            half[i, j] = 0.0
            for k in range(STATES):
                half[i, j] += step[i, k] * covariance[STATES * k + j]
    for i in range(STATES):
        for j in range(STATES):
            value = 0.0
            for k in range(STATES):
                value += half[i, k] * step[j, k]
            covariance[STATES * i + j] = value


@kernel_within
def _agility(covariance: Array, model: int, dt_s: float) -> None:
    """Add what a model's random acceleration and turn add in `dt_s`."""
    power = AGILITY[model]
    for axis in range(2):
        covariance[axis, axis] += power * dt_s**3 / 3.0
        covariance[axis, axis + 2] += power * dt_s**2 / 2.0
        covariance[axis + 2, axis] += power * dt_s**2 / 2.0
        covariance[axis + 2, axis + 2] += power * dt_s
    if model == TURN:
        covariance[4, 4] += TURN_AGILITY * dt_s
    else:
        covariance[4, :], covariance[:, 4] = 0.0, 0.0
        covariance[4, 4] = TURN_VARIANCE
