"""Interacting models of how a target moves over the ground: steadily, briskly, or in a turn.

Each model is a Kalman filter of its own with the state x, y, their velocities, and the rate of turn; they are
mixed before each report and weighed by how well they foresaw it. Units are m, m/s and rad/s, in the show
frame; a turn is positive from x towards y.

Source: Blom and Bar-Shalom 1988, "The interacting multiple model algorithm for systems with Markovian
switching coefficients"; the turn with its derivatives as in Bar-Shalom, Li and Kirubarajan 2001, chapter 11.
Compared with a single model in docs/decisions/targets.md.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gcs.estimation.targets.height import HeightBelief
from gcs.model.jit import kernel
from gcs.model.plan import Target
from gcs.model.state import Array

STEADY, BRISK, TURN, MODELS, STATES = 0, 1, 2, 3, 5

AGILITY: Final = (0.01, 4.0, 0.05)
"""Power of the random acceleration of each model, in m^2/s^3."""

TURN_AGILITY, TURN_VARIANCE = 0.02, 0.16
"""Power of the random change of the rate of turn, in rad^2/s^3, and its variance before a turn is seen."""

LEAVES_PER_S: Final = 0.08
"""How often a target changes from one model to another."""

LEAST_WEIGHT: Final = 1e-3

FASTEST_M_S: Final = 5.0
"""Standard deviation along each axis of the velocity of a target that was reported once, without one."""

STRAIGHT_RAD: Final = 1e-4
"""A smaller turn in one step counts as none."""


SETTLES_S: Final = 1.5
"""An error of its place is taken for a velocity over so long."""


@dataclass(frozen=True, slots=True, eq=False)
class TargetBelief:
    """What is believed of one target at a time. Owns its arrays."""

    time_s: float
    mean: Array  # (3, 5) of each model
    covariance: Array  # (3, 5, 5)
    weight: Array  # (3,) of the models, together 1
    alike_s: float  # since when it has moved steadily, or in a turn to one side, as it does now

    @property
    def lasted_s(self) -> float:
        """For how long it has moved as it does now; 0 or little: briskly."""
        return self.time_s - self.alike_s

    @property
    def deviation_m_s(self) -> float:
        """Standard deviation of the velocity along an axis, at its time; an error of the place counts too."""
        variance = np.diagonal(_together(self.mean, self.covariance, self.weight)[1])
        place_m, moves_m_s = float(np.sqrt(variance[:2].mean())), float(np.sqrt(variance[2:4].mean()))
        return max(moves_m_s, place_m / SETTLES_S)

    @property
    def circles(self) -> bool:
        """Whether it has gone round a whole circle, and goes on."""
        return self.way[0] == TURN and abs(float(self.mean[TURN, 4])) * self.lasted_s >= 2.0 * np.pi

    @property
    def way(self) -> tuple[int, bool]:
        """The model that fits best, and to which side it turns."""
        best = int(self.weight.argmax())
        return best, best == TURN and self.mean[TURN, 4] > 0.0


@dataclass(frozen=True, slots=True, eq=False)
class TargetMotion:
    """How a target moves at one time, all models together. Show frame."""

    position_m: Array  # (2,)
    velocity_m_s: Array  # (2,)
    acceleration_m_s2: Array  # (2,) of the turn
    covariance: Array  # (4, 4) of position and velocity
    belief: TargetBelief  # from which this is foreseen
    height: HeightBelief | None = None  # None: it is not reported, or does not count

    def target(self, time_s: float, clearance_m: float = 0.0) -> Target:
        """The target that the formation follows, if it moves like this at `time_s`; without a height: at 0 m.

        No vehicle is to come nearer to it than `clearance_m`.
        """
        (x_m, y_m), (x_m_s, y_m_s) = self.position_m.tolist(), self.velocity_m_s.tolist()
        x_m_s2, y_m_s2 = self.acceleration_m_s2.tolist()
        return Target(
            x_m,
            y_m,
            x_m_s,
            y_m_s,
            time_s,
            followed=True,
            acceleration_x_m_s2=x_m_s2,
            acceleration_y_m_s2=y_m_s2,
            deviation_m_s=self.belief.deviation_m_s,
            deviation_m=self.deviation_m,
            height_m=self.height.height_m if self.height else 0.0,
            climb_m_s=self.height.climb_m_s if self.height else 0.0,
            height_deviation_m=self.height.deviation_m if self.height else 0.0,
            clearance_m=clearance_m,
        )

    @property
    def deviation_m(self) -> float:
        """Standard deviation of the position along the axis on which it is largest."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:2, :2])[1]))

    @property
    def velocity_deviation_m_s(self) -> float:
        """Standard deviation of the velocity along an axis, on the average of both."""
        return float(np.sqrt(max(np.trace(self.covariance[2:, 2:]) / 2.0, 0.0)))


def begun(time_s: float, reported: Array, variance: Array) -> TargetBelief:
    """The belief after a first report.

    Args:
        time_s: when it was there.
        reported: (2,) position, or (4,) position and velocity.
        variance: (2,) or (4,) of these.
    """
    mean, covariance = np.zeros((MODELS, STATES)), np.zeros((MODELS, STATES, STATES))
    diagonal = np.array([0.0, 0.0, FASTEST_M_S**2, FASTEST_M_S**2, TURN_VARIANCE])
    diagonal[: len(variance)] = variance
    for model in range(MODELS):
        mean[model, : len(reported)] = reported
        covariance[model] = np.diag(diagonal)
    return TargetBelief(time_s, mean, covariance, np.array([0.5, 0.3, 0.2]), time_s)


def foreseen(belief: TargetBelief, time_s: float) -> TargetMotion:
    """How the target moves at `time_s`; earlier than the belief counts as its time."""
    mean, covariance = _moved(belief.mean, belief.covariance, max(time_s - belief.time_s, 0.0))
    together, spread, acceleration_m_s2 = _together(mean, covariance, belief.weight)
    return TargetMotion(together[:2], together[2:4], acceleration_m_s2, spread[:4, :4], belief)


def off_deviations(motion: TargetMotion, position_m: Array, variance_m2: float) -> float:
    """How far (2,) is from where the target was foreseen, in standard deviations of both together."""
    x, y = position_m[0] - motion.position_m[0], position_m[1] - motion.position_m[1]
    a, b = motion.covariance[0, 0] + variance_m2, motion.covariance[0, 1]
    c = motion.covariance[1, 1] + variance_m2
    return float(np.sqrt(max((c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b), 0.0)))


def corrected(belief: TargetBelief, time_s: float, reported: Array, variance: Array) -> TargetBelief:
    """The belief after one more report, not earlier than it; the arguments are those of `begun`."""
    mean, covariance, weight = _corrected(
        belief.mean,
        belief.covariance,
        belief.weight,
        max(time_s - belief.time_s, 0.0),
        np.array(reported, dtype=np.float64),
        np.array(variance, dtype=np.float64),
    )
    after = TargetBelief(max(time_s, belief.time_s), mean, covariance, weight, belief.alike_s)
    goes_on = after.way == belief.way and after.way[0] != BRISK
    return after if goes_on else replace(after, alike_s=after.time_s)


def warm_up() -> None:
    """Compile or load the kernels."""
    belief = begun(0.0, np.zeros(2), np.ones(2))
    for many in (2, 4):
        belief = corrected(belief, 1.0, np.zeros(many), np.ones(many))
    foreseen(belief, 2.0)


@kernel
def _moved(mean: Array, covariance: Array, dt_s: float) -> tuple[Array, Array]:
    """(3, 5) and (3, 5, 5) `dt_s` later, each model by itself."""
    later, spread = np.zeros_like(mean), np.zeros_like(covariance)
    for model in range(MODELS):
        x, y, x_m_s, y_m_s, turn = mean[model]
        step = np.eye(STATES)
        if model != TURN:
            turn = 0.0
        angle = turn * dt_s
        if abs(angle) > STRAIGHT_RAD:
            sine, cosine = np.sin(angle), np.cos(angle)
            ahead_s, aside_s = sine / turn, (1.0 - cosine) / turn
            ahead_by, aside_by = (dt_s * cosine - ahead_s) / turn, (dt_s * sine - aside_s) / turn
        else:
            sine, cosine, ahead_s, aside_s = angle, 1.0, dt_s, 0.5 * angle * dt_s
            ahead_by, aside_by = 0.0, 0.5 * dt_s * dt_s
        step[0, 2], step[0, 3], step[1, 2], step[1, 3] = ahead_s, -aside_s, aside_s, ahead_s
        step[2, 2], step[2, 3], step[3, 2], step[3, 3] = cosine, -sine, sine, cosine
        if model == TURN:
            step[0, 4], step[1, 4] = ahead_by * x_m_s - aside_by * y_m_s, aside_by * x_m_s + ahead_by * y_m_s
            step[2, 4] = -dt_s * (sine * x_m_s + cosine * y_m_s)
            step[3, 4] = dt_s * (cosine * x_m_s - sine * y_m_s)
        later[model, 0] = x + ahead_s * x_m_s - aside_s * y_m_s
        later[model, 1] = y + aside_s * x_m_s + ahead_s * y_m_s
        later[model, 2], later[model, 3] = cosine * x_m_s - sine * y_m_s, sine * x_m_s + cosine * y_m_s
        later[model, 4] = turn
        grown = step @ covariance[model] @ step.T
        power = AGILITY[model]
        for axis in range(2):
            grown[axis, axis] += power * dt_s**3 / 3.0
            grown[axis, axis + 2] += power * dt_s**2 / 2.0
            grown[axis + 2, axis] += power * dt_s**2 / 2.0
            grown[axis + 2, axis + 2] += power * dt_s
        if model == TURN:
            grown[4, 4] += TURN_AGILITY * dt_s
        else:
            grown[4, :], grown[:, 4] = 0.0, 0.0
            grown[4, 4] = TURN_VARIANCE
        spread[model] = grown
    return later, spread


@kernel
def _together(mean: Array, covariance: Array, weight: Array) -> tuple[Array, Array, Array]:
    """(5,) and (5, 5) of all models together, and (2,) the acceleration of the turn."""
    together, spread = np.zeros(STATES), np.zeros((STATES, STATES))
    for model in range(MODELS):
        together += weight[model] * mean[model]
    for model in range(MODELS):
        off = mean[model] - together
        spread += weight[model] * (covariance[model] + np.outer(off, off))
    turn = weight[TURN] * mean[TURN, 4]
    return together, spread, np.array([-turn * mean[TURN, 3], turn * mean[TURN, 2]])


@kernel
def _corrected(
    mean: Array, covariance: Array, weight: Array, dt_s: float, reported: Array, variance: Array
) -> tuple[Array, Array, Array]:
    """Mix the models, move them `dt_s` on, and correct each by the report (k,) with its variances (k,)."""
    many = len(reported)
    stays = np.exp(-LEAVES_PER_S * dt_s)
    to = np.full((MODELS, MODELS), (1.0 - stays) / (MODELS - 1))
    for model in range(MODELS):
        to[model, model] = stays
    expected = np.zeros(MODELS)
    begins, spreads = np.zeros_like(mean), np.zeros_like(covariance)
    for model in range(MODELS):
        for other in range(MODELS):
            expected[model] += weight[other] * to[other, model]
        for other in range(MODELS):
            begins[model] += weight[other] * to[other, model] / expected[model] * mean[other]
        for other in range(MODELS):
            off = mean[other] - begins[model]
            share = weight[other] * to[other, model] / expected[model]
            spreads[model] += share * (covariance[other] + np.outer(off, off))
    later, spread = _moved(begins, spreads, dt_s)
    fits = np.zeros(MODELS)
    for model in range(MODELS):
        seen = np.ascontiguousarray(spread[model, :many, :many]) + np.diag(variance)
        inverse = np.linalg.inv(seen)
        missed = reported - later[model, :many]
        gain = np.ascontiguousarray(spread[model, :, :many]) @ inverse
        fits[model] = -0.5 * missed @ (inverse @ missed) - 0.5 * np.log(np.linalg.det(seen))
        later[model] += gain @ missed
        kept = np.eye(STATES)
        kept[:, :many] -= gain
        spread[model] = kept @ spread[model] @ kept.T + gain @ np.diag(variance) @ gain.T
    weight = np.maximum(expected * np.exp(fits - fits.max()), LEAST_WEIGHT)
    return later, spread, weight / weight.sum()
