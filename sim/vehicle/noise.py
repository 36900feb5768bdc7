"""Errors of the vehicles' own position estimates: seeded, correlated in time, vectorised.

Measured while holding for 60 s (FACTS, section 3): estimate minus truth has sd 0.09, 0.19, 0.41 m
(north, east, down), correlated over 3 to 6 s. The errors of two vehicles are independent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.sim.vehicle.dynamics import ShapeError

if TYPE_CHECKING:
    from gcs.sim.vehicle.dynamics import Array

POSITION_SD_M = np.array((0.09, 0.19, 0.41))
VELOCITY_SD_M_S = np.array((0.04, 0.04, 0.03))
# The position error is a wandering target followed with a lag: an estimator's error moves smoothly.
# The two times add up to the correlation time.
WANDER_S, FOLLOW_S = 3.5, 1.0
VELOCITY_CORRELATION_S = 0.4
TARGET_SD_M = POSITION_SD_M * math.sqrt((WANDER_S + FOLLOW_S) / WANDER_S)


@dataclass(frozen=True, slots=True, eq=False)
class EstimateError:
    """Estimate minus truth, (n, 3) each, NED, and the position error's target. Owns its arrays."""

    position_m: Array
    velocity_m_s: Array
    target_m: Array

    def __post_init__(self) -> None:
        """Check the shapes and make the arrays read-only.

        Raises:
            ShapeError: an array is not (n, 3).
        """
        for array in (self.position_m, self.velocity_m_s, self.target_m):
            if array.shape != (len(self.position_m), 3):
                raise ShapeError(f"{array.shape} where (n, 3) is needed")
            array.setflags(write=False)


def draw(count: int, scale: float, random: np.random.Generator) -> EstimateError:
    """Errors of vehicles that have been running for long; scale 1 is as measured, 0 is none."""
    position_m = scale * random.normal(0.0, POSITION_SD_M, (count, 3))
    ahead_m = math.sqrt(FOLLOW_S / WANDER_S) * scale * random.normal(0.0, POSITION_SD_M, (count, 3))
    velocity_m_s = scale * random.normal(0.0, VELOCITY_SD_M_S, (count, 3))
    return EstimateError(position_m, velocity_m_s, position_m + ahead_m)


def step(error: EstimateError, dt_s: float, scale: float, random: np.random.Generator) -> EstimateError:
    """Advance the errors by dt_s (well below a second); scale as in draw."""
    fresh = scale * random.standard_normal((2, *error.position_m.shape))
    follow = -math.expm1(-dt_s / FOLLOW_S)
    return EstimateError(
        error.position_m + follow * (error.target_m - error.position_m),
        _wander(error.velocity_m_s, dt_s / VELOCITY_CORRELATION_S, fresh[0] * VELOCITY_SD_M_S),
        _wander(error.target_m, dt_s / WANDER_S, fresh[1] * TARGET_SD_M),
    )


def _wander(value: Array, share: float, fresh: Array) -> Array:
    """First-order Gauss-Markov, exact for any step; fresh has the stationary spread."""
    keep = math.exp(-share)
    moved: Array = keep * value + math.sqrt(1.0 - keep * keep) * fresh
    return moved
