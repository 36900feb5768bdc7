"""How the centre follows a target that moves: as fast as its vehicles can, and as smoothly as it is known.

The centre's acceleration is that of the target and a share of what its velocity lacks. The desired velocity
is the target's, and one that closes the distance, no faster than can still be braked. Measured: decision page
Targets.
"""

from dataclasses import dataclass, replace
from math import hypot, sqrt
from typing import Final

import numpy as np

from gcs.model.plan import Target
from gcs.model.state import Array

SPEED_SHARE: Final = 0.8
"""Share of its vehicles' speed with which the formation follows; the rest keeps the shape."""

BEHIND_SHARE: Final = 0.95
"""The same where it is far behind: straight on, the shape needs little."""

NEAR_M, FAR_M = 2.0, 8.0
"""From the one distance from its target to the other the share grows."""

ANSWER_PER_S, ANSWER_LEAST_PER_S = 4.0, 1.0
"""Rate at which the centre takes on a velocity that is known well, and one that is known badly."""

DAMPED: Final = 4.0
"""A small distance decays with the rate of the answer divided by this: the two together do not swing."""

KNOWN_M_S: Final = 0.3
"""A velocity with a smaller standard deviation than this is known well."""

BRAKING_SHARE, BESIDE_TRAFFIC = 0.6, 0.9
"""Shares of the acceleration with which the distance is closed, and beside traffic; the rest corrects."""


INSIDE_SPEED, INSIDE_ACCELERATION = 0.95, 0.85
"""Shares of what the centre can on a circle inside that of its target; the rest corrects."""

JERK_M_S3: Final = 16.0
"""The centre's acceleration changes no faster: it is in every setpoint, and none is to jump."""


@dataclass(frozen=True, slots=True)
class CenterLimits:
    """The fastest that the centre flies over the ground, and its greatest acceleration."""

    speed_m_s: float
    acceleration_m_s2: float


def fleet_limits(
    fastest_m_s: Array, hardest_m_s2: Array, rim_m_s: float, *, behind_m: float = 0.0
) -> CenterLimits:
    """Limits of a centre with vehicles (k,), at least one, that fly so fast and accelerate so hard.

    `rim_m_s` is how fast the spin moves them, `behind_m` how far the centre is from its target.
    """
    far = min(max((behind_m - NEAR_M) / (FAR_M - NEAR_M), 0.0), 1.0)
    share = SPEED_SHARE + (BEHIND_SHARE - SPEED_SHARE) * far
    return CenterLimits(share * float(fastest_m_s.min()) - rim_m_s, float(hardest_m_s2.min()))


def answer_per_s(deviation_m_s: float) -> float:
    """Rate at which the centre takes on a velocity with this standard deviation along an axis."""
    return max(ANSWER_PER_S / max(deviation_m_s / KNOWN_M_S, 1.0), ANSWER_LEAST_PER_S)


def inside_circle(target: Target, limits: CenterLimits) -> Target:
    """A target that circles too fast for the centre: the place nearest to it that the centre can keep to.

    That is on a smaller circle around the same point, always beside the target. A centre that trails goes
    round as small a circle, but up to a quarter of it behind. One that can be followed stays as it is.
    """
    turning_m_s2 = hypot(target.acceleration_x_m_s2, target.acceleration_y_m_s2)
    speed_m_s = hypot(target.velocity_x_m_s, target.velocity_y_m_s)
    if turning_m_s2 == 0.0 or speed_m_s == 0.0:
        return target
    slower = INSIDE_SPEED * limits.speed_m_s / speed_m_s
    share = min(1.0, slower, INSIDE_ACCELERATION * limits.acceleration_m_s2 / turning_m_s2)
    inwards_s2 = (1.0 - share) * (speed_m_s / turning_m_s2) ** 2
    return replace(
        target,
        x_m=target.x_m + inwards_s2 * target.acceleration_x_m_s2,
        y_m=target.y_m + inwards_s2 * target.acceleration_y_m_s2,
        velocity_x_m_s=share * target.velocity_x_m_s,
        velocity_y_m_s=share * target.velocity_y_m_s,
        acceleration_x_m_s2=share * target.acceleration_x_m_s2,
        acceleration_y_m_s2=share * target.acceleration_y_m_s2,
    )


def closing_velocity(off_m: Array, braking_m_s2: float, deviation_m_s: float) -> Array:
    """(2,) velocity relative to the target that closes the distance (2,) to it, and can still be braked."""
    away_m = hypot(off_m[0], off_m[1])
    closing_per_s = answer_per_s(deviation_m_s) / DAMPED
    near_m = braking_m_s2 / closing_per_s**2
    if away_m <= near_m:
        return closing_per_s * off_m
    closing: Array = off_m / away_m * sqrt(2.0 * braking_m_s2 * (away_m - near_m / 2.0))
    return closing


def following_velocity(
    velocity_m_s: Array,
    acceleration_m_s2: Array,
    target_m_s: Array,
    target_m_s2: Array,
    relative_m_s: Array,
    limits: CenterLimits,
    *,
    deviation_m_s: float,
    dt_s: float,
) -> Array:
    """(2,) velocity of the centre after `dt_s`.

    Args:
        velocity_m_s: (2,) of the centre now.
        acceleration_m_s2: (2,) of the centre until now.
        target_m_s: (2,) of the target.
        target_m_s2: (2,) its acceleration.
        relative_m_s: (2,) desired relative to it: towards it (`closing_velocity`), or along its orbit.
        limits: of the centre.
        deviation_m_s: standard deviation of the target's velocity along an axis.
        dt_s: of the step.
    """
    desired_m_s = target_m_s + relative_m_s
    desired_m_s = desired_m_s * min(1.0, limits.speed_m_s / max(hypot(*desired_m_s), 1e-9))
    asked_m_s2 = target_m_s2 + answer_per_s(deviation_m_s) * (desired_m_s - velocity_m_s)
    asked_m_s2 = asked_m_s2 * min(1.0, limits.acceleration_m_s2 / max(hypot(*asked_m_s2), 1e-9))
    change_m_s2 = asked_m_s2 - acceleration_m_s2
    asked_m_s2 = acceleration_m_s2 + change_m_s2 * min(1.0, JERK_M_S3 * dt_s / max(hypot(*change_m_s2), 1e-9))
    reached: Array = np.asarray(velocity_m_s + dt_s * asked_m_s2)
    return reached
