"""Interacting models of how a target moves over the ground: steadily, briskly, or in a turn.

Each model is a Kalman filter of its own with the state x, y, their velocities, and the rate of turn; they are
mixed before each report and weighed by how well they foresaw it. Units are m, m/s and rad/s, in the show
frame; a turn is positive from x towards y.

Source: Blom and Bar-Shalom 1988, "The interacting multiple model algorithm for systems with Markovian
switching coefficients"; the turn with its derivatives as in Bar-Shalom, Li and Kirubarajan 2001, chapter 11.
Compared with a single model in docs/decisions/targets.md.
"""

from collections.abc import Sequence
from math import hypot, sqrt
from typing import Final, NamedTuple

import numpy as np

from gcs.estimation.targets.height import HeightBelief
from gcs.estimation.targets.models import (
    BRISK,
    MEAN,
    MODELS,
    SPREAD,
    STATES,
    STEADY,
    TURN,
    TURN_VARIANCE,
    WIDTH,
    corrected_by,
    foreseen_rows,
    off_by,
)
from gcs.model.plan import Target
from gcs.model.state import Array

FASTEST_M_S: Final = 5.0
"""Standard deviation along each axis of the velocity of a target that was reported once, without one."""

FIRST_WEIGHTS: Final = (0.5, 0.3, 0.2)
"""Of the models, after a first report."""

SETTLES_S: Final = 1.5
"""An error of its place is taken for a velocity over so long."""


class TargetBelief(NamedTuple):
    """What is believed of one target at a time. Owns its array."""

    time_s: float
    values: Array  # (3, WIDTH) of each model, as in `models`
    way: tuple[int, bool]  # the model that fits best, and to which side it turns
    alike_s: float  # since when it has moved steadily, or in a turn to one side, as it does now

    @property
    def weight(self) -> Array:
        """(3,) of the models, together 1."""
        return self.values[:, 0]

    @property
    def turn_rad_s(self) -> float:
        """Rate of the turn, if it turns."""
        return float(self.values[TURN, MEAN + 4])

    @property
    def lasted_s(self) -> float:
        """For how long it has moved as it does now; 0 or little: briskly."""
        return self.time_s - self.alike_s

    @property
    def deviation_m_s(self) -> float:
        """Standard deviation of the velocity along an axis, at its time; an error of the place counts too."""
        now = foreseen(self, self.time_s)
        place_m = sqrt(float(np.trace(now.covariance[:2, :2])) / 2.0)
        return max(now.velocity_deviation_m_s, place_m / SETTLES_S)

    @property
    def circles(self) -> bool:
        """Whether it has gone round a whole circle, and goes on."""
        return self.way[0] == TURN and abs(self.turn_rad_s) * self.lasted_s >= 2.0 * np.pi


class TargetMotion(NamedTuple):
    """How a target moves at one time, all models together. Show frame."""

    values: Array  # (FORESEEN,) as in `models`
    belief: TargetBelief  # from which this is foreseen
    height: HeightBelief | None = None  # None: it is not reported, or does not count

    @property
    def position_m(self) -> Array:
        """(2,)."""
        return self.values[:2]

    @property
    def velocity_m_s(self) -> Array:
        """(2,)."""
        return self.values[2:4]

    @property
    def acceleration_m_s2(self) -> Array:
        """(2,) of the turn."""
        return self.values[4:6]

    @property
    def covariance(self) -> Array:
        """(4, 4) of position and velocity."""
        return self.values[6:].reshape(4, 4)

    def at(self, position_m: Array) -> "TargetMotion":
        """The same elsewhere."""
        return self._replace(values=np.concatenate([position_m, self.values[2:]]))

    def target(self, time_s: float, clearance_m: float = 0.0) -> Target:
        """The target that the formation follows, if it moves like this at `time_s`; without a height: at 0 m.

        No vehicle is to come nearer to it than `clearance_m`.
        """
        x_m, y_m, x_m_s, y_m_s, x_m_s2, y_m_s2 = self.values[:6].tolist()
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
        (xx, xy), (_, yy) = self.covariance[:2, :2].tolist()
        return sqrt((xx + yy) / 2.0 + hypot((xx - yy) / 2.0, xy))

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
    values = np.zeros((MODELS, WIDTH))
    values[:, 0] = FIRST_WEIGHTS
    values[:, MEAN : MEAN + len(reported)] = reported
    spread = np.array([0.0, 0.0, FASTEST_M_S**2, FASTEST_M_S**2, TURN_VARIANCE])
    spread[: len(variance)] = variance
    values[:, SPREAD :: STATES + 1] = spread
    return TargetBelief(time_s, values, (STEADY, False), time_s)


def foreseen(belief: TargetBelief, time_s: float) -> TargetMotion:
    """How the target moves at `time_s`; earlier than the belief counts as its time."""
    return all_foreseen((belief,), time_s)[0]


def all_foreseen(beliefs: Sequence[TargetBelief], time_s: float) -> list[TargetMotion]:
    """The same of many targets, at little more cost."""
    if not beliefs:
        return []
    values = np.concatenate([each.values for each in beliefs]).reshape(-1, MODELS, WIDTH)
    rows = foreseen_rows(values, np.array([each.time_s for each in beliefs]), time_s)
    return list(map(TargetMotion, rows, beliefs))


def off(
    belief: TargetBelief, time_s: float, known_s: float, position_m: Sequence[float], variance_m2: float
) -> tuple[float, float]:
    """How far a place (2,) is from where the target was foreseen at `time_s`, in m and in deviations of both.

    The target's standard deviation is that at `known_s`.
    """
    elapsed_s, known_s = max(time_s - belief.time_s, 0.0), max(known_s - belief.time_s, 0.0)
    return off_by(belief.values, elapsed_s, known_s, position_m[0], position_m[1], variance_m2)


def corrected(belief: TargetBelief, time_s: float, reported: Array, variance: Array) -> TargetBelief:
    """The belief after one more report, not earlier than it; the arguments are those of `begun`."""
    before_s, _, before, alike_s = belief
    time_s = max(time_s, before_s)
    values = corrected_by(belief.values, time_s - before_s, reported, variance)
    weights = values[:, 0].tolist()
    best = weights.index(max(weights))
    way = (best, best == TURN and bool(values[TURN, MEAN + 4] > 0.0))
    return TargetBelief(time_s, values, way, alike_s if way == before and best != BRISK else time_s)


def warm_up() -> None:
    """Compile or load the kernels."""
    belief = begun(0.0, np.zeros(2), np.ones(2))
    for many in (2, 4):
        belief = corrected(belief, 1.0, np.zeros(many), np.ones(many))
    foreseen(belief, 2.0)
    off(belief, 2.0, 2.0, (0.0, 0.0), 1.0)
