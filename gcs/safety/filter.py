"""The filter as a whole: every constraint, the nearest velocities that keep them, and why."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs.formation.obstacles import Ellipse
from gcs.formation.response import scale_to_limits
from gcs.formation.sphere import TINY
from gcs.safety.constraints import NOBODY, Braking, Constraints
from gcs.safety.projection import project, shrink
from gcs.safety.separation import Floor, keepout_constraints, separation_constraints
from gcs.safety.walls import Fence, fence_constraints, obstacle_constraints
from gcs.settings import Positive, Settings
from gcs.state import Array, Mask

NOTICEABLE_M_S = 0.05


class Limits(Settings):
    """What no setpoint may exceed. A vector beyond is scaled, never bent."""

    horizontal_m_s: Positive = 8.0
    up_m_s: Positive = 2.5
    down_m_s: Positive = 1.4

    @property
    def fastest_m_s(self) -> float:
        """In any direction."""
        return float(np.hypot(self.horizontal_m_s, max(self.up_m_s, self.down_m_s)))


class SafetySettings(Settings):
    """Everything the last word needs to know."""

    limits: Limits = Limits()
    floor: Floor = Floor()
    fence: Fence = Fence()
    braking: Braking = Braking()


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """What is in the air besides the velocities to be filtered. n rows, show frame."""

    position_m: Array  # (n, 3)
    velocity_m_s: Array  # (n, 3) measured
    commanded: Mask  # (n,)
    airborne: Mask  # (n,) in the air, or possibly so
    descending: Mask  # (n,) on the way to the ground
    segments_m: Array  # (m, 2, 3) paths that lost vehicles may take
    ellipses: Mapping[str, Ellipse]
    names: Sequence[str]
    uncertainty_m: Array  # (n,) of the positions, sideways
    speed_max_m_s: Array  # (n,) of each vehicle, in any direction


def filter_velocities(
    wanted_m_s: Array, surroundings: Surroundings, settings: SafetySettings
) -> tuple[Array, tuple[str, ...]]:
    """Bring the wanted velocities within every limit and constraint.

    Args:
        wanted_m_s: (n, 3), show frame; rows not finite become rest, rows not commanded are ignored.
        surroundings: the same n rows.
        settings: limits and margins.

    Returns: (n, 3) in m/s, and for each row what it was restrained for, "" when it was not.
    """
    here = surroundings
    constraints = Constraints.joined(
        separation_constraints(
            here.position_m,
            here.velocity_m_s,
            here.commanded,
            here.airborne,
            floor=settings.floor,
            braking=settings.braking,
            names=here.names,
            uncertainty_m=here.uncertainty_m,
            fastest_m_s=settings.limits.fastest_m_s,
        ),
        keepout_constraints(
            here.position_m,
            here.commanded,
            here.segments_m,
            floor=settings.floor,
            braking=settings.braking,
            uncertainty_m=here.uncertainty_m,
            fastest_m_s=settings.limits.fastest_m_s,
        ),
        fence_constraints(here.position_m, here.commanded, here.descending, settings.fence, settings.braking),
        obstacle_constraints(
            here.position_m,
            here.commanded,
            here.ellipses,
            settings.braking,
            fastest_m_s=settings.limits.fastest_m_s,
        ),
    )
    limits, fastest_m_s = settings.limits, here.speed_max_m_s
    wanted_m_s = cap(np.where(here.commanded[:, None], wanted_m_s, 0.0), limits, fastest_m_s)
    allowed_m_s = shrink(cap(project(wanted_m_s, constraints), limits, fastest_m_s), constraints)
    return allowed_m_s, _reasons(wanted_m_s, allowed_m_s, constraints)


def cap(velocity_m_s: Array, limits: Limits, speed_max_m_s: Array | float = np.inf) -> Array:
    """(n, 3) within the limits and each vehicle's own speed (n,): long rows shortened; not finite: rest."""
    finite = np.isfinite(velocity_m_s).all(axis=1, keepdims=True)
    trusted_m_s = np.where(finite, velocity_m_s, 0.0)
    speed_m_s = np.linalg.norm(trusted_m_s, axis=1)
    own = np.minimum(1.0, speed_max_m_s / np.maximum(speed_m_s, TINY))
    return scale_to_limits(
        trusted_m_s * own[:, None],
        horizontal_max_m_s=limits.horizontal_m_s,
        up_max_m_s=limits.up_m_s,
        down_max_m_s=limits.down_m_s,
    )


def _reasons(wanted_m_s: Array, allowed_m_s: Array, constraints: Constraints) -> tuple[str, ...]:
    """For each row that was changed noticeably: the constraint that the wanted velocity broke most."""
    changed = np.linalg.norm(wanted_m_s - allowed_m_s, axis=1) > NOTICEABLE_M_S
    reasons = [""] * len(wanted_m_s)
    slack_m_s = constraints.slack_m_s(wanted_m_s)
    for k in np.argsort(slack_m_s)[::-1]:  # the worst last, so that it stays
        for row in (constraints.first[k], constraints.second[k]):
            if row != NOBODY and changed[row] and slack_m_s[k] < 0.0:
                reasons[row] = constraints.reason[k]
    return tuple(reason or ("limits" if changed[row] else "") for row, reason in enumerate(reasons))
