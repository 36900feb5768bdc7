"""The filter as a whole: every constraint, the nearest velocities that keep them, and why."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from gcs.compiled import kernel
from gcs.formation.obstacles import Ellipse
from gcs.formation.sphere import TINY
from gcs.safety.constraints import NOBODY, Braking, Constraints
from gcs.safety.neighbours import Rows
from gcs.safety.projection import nearest, shortened, tightest
from gcs.safety.separation import Floor, Pairs, keepout_constraints, separation_constraints
from gcs.safety.traffic import Traffic
from gcs.safety.walls import Fence, fence_constraints, obstacle_constraints
from gcs.settings import NotNegative, Positive, Settings
from gcs.state import Array, Mask

NOTICEABLE_M_S = 0.05

SPARE_M_S = 0.5
"""Pairs are looked for as if everybody could be led to a velocity that far from the wanted one."""

ATTEMPTS = 3
"""At the last, everybody is looked at as if it could be led to any velocity within the limits."""


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
    traffic: Traffic = Traffic()
    link_delay_s: NotNegative = 0.0  # one way, of telemetry and of setpoints alike, as far as it is known


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
    here, limits = surroundings, settings.limits
    braking = settings.braking.over_link(settings.link_delay_s)
    moving_m_s = np.where(np.isfinite(here.velocity_m_s), here.velocity_m_s, 0.0)
    position_m = here.position_m + settings.link_delay_s * moving_m_s
    wanted_m_s = cap(np.where(here.commanded[:, None], wanted_m_s, 0.0), limits, here.speed_max_m_s)
    walls = _walls(position_m, here, settings, braking)
    spare_m_s = np.full(len(wanted_m_s), SPARE_M_S)
    for attempt in range(ATTEMPTS):
        if attempt == ATTEMPTS - 1:  # no velocity within the limits differs by more
            spare_m_s = limits.fastest_m_s + np.linalg.norm(wanted_m_s, axis=1)
        pairs = separation_constraints(
            position_m,
            here.velocity_m_s,
            here.commanded,
            here.airborne,
            floor=settings.floor,
            braking=braking,
            uncertainty_m=here.uncertainty_m,
            course_m_s=wanted_m_s,
            spare_m_s=spare_m_s,
        )
        joined = _joined(walls, pairs)
        allowed_m_s = shortened(cap(nearest(wanted_m_s, *joined), limits, here.speed_max_m_s), *joined)
        changed_m_s = np.linalg.norm(allowed_m_s - wanted_m_s, axis=1)
        if (changed_m_s <= spare_m_s).all():
            break  # nobody was led to where nobody had looked
        spare_m_s = np.maximum(spare_m_s, 1.5 * changed_m_s)
    return allowed_m_s, _reasons(wanted_m_s, allowed_m_s, walls, pairs, joined, here.names)


Joined: TypeAlias = tuple[Rows, Rows, Array, Array]
"""Rows (k,), rows or NOBODY (k,), normals (k, 3) and bounds (k,): the walls first, then the pairs."""


def _joined(walls: Constraints, pairs: Pairs) -> Joined:
    if len(walls) == 0:
        return pairs.first, pairs.second, pairs.normal, pairs.bound_m_s
    return (
        np.concatenate([walls.first, pairs.first]),
        np.concatenate([walls.second, pairs.second]),
        np.concatenate([walls.normal, pairs.normal]),
        np.concatenate([walls.bound_m_s, pairs.bound_m_s]),
    )


def _walls(position_m: Array, here: Surroundings, settings: SafetySettings, braking: Braking) -> Constraints:
    """All that concerns each vehicle alone: paths of lost vehicles, the fence, obstacles."""
    fastest_m_s = settings.limits.fastest_m_s
    return Constraints.joined(
        keepout_constraints(
            position_m,
            here.commanded,
            here.segments_m,
            floor=settings.floor,
            braking=braking,
            uncertainty_m=here.uncertainty_m,
            fastest_m_s=fastest_m_s,
        ),
        fence_constraints(
            position_m, here.commanded, here.descending, settings.fence, braking, fastest_m_s=fastest_m_s
        ),
        obstacle_constraints(position_m, here.commanded, here.ellipses, braking, fastest_m_s=fastest_m_s),
    )


def cap(velocity_m_s: Array, limits: Limits, speed_max_m_s: Array | float = np.inf) -> Array:
    """(n, 3) within the limits and each vehicle's own speed (n,): long rows shortened; not finite: rest."""
    own_m_s = np.full(len(velocity_m_s), speed_max_m_s) if np.ndim(speed_max_m_s) == 0 else speed_max_m_s
    return _capped(
        np.array(velocity_m_s), np.array(own_m_s), limits.horizontal_m_s, limits.up_m_s, limits.down_m_s
    )


@kernel
def _capped(
    velocity_m_s: Array, own_m_s: Array, horizontal_m_s: float, up_m_s: float, down_m_s: float
) -> Array:
    """As `cap`, for (n, 3) and (n,)."""
    capped = np.zeros_like(velocity_m_s)
    for i in range(len(velocity_m_s)):
        x, y, z = velocity_m_s[i, 0], velocity_m_s[i, 1], velocity_m_s[i, 2]
        if not (np.isfinite(x) and np.isfinite(y) and np.isfinite(z)):
            continue
        share = min(1.0, own_m_s[i] / max(np.sqrt(x * x + y * y + z * z), TINY))
        share = min(share, horizontal_m_s / max(np.hypot(x, y), TINY))
        share = min(share, (up_m_s if z < 0.0 else down_m_s) / max(abs(z), TINY))
        capped[i, 0], capped[i, 1], capped[i, 2] = share * x, share * y, share * z
    return capped


def _reasons(
    wanted_m_s: Array,
    allowed_m_s: Array,
    walls: Constraints,
    pairs: Pairs,
    joined: Joined,
    names: Sequence[str],
) -> tuple[str, ...]:
    """For each row that was changed noticeably: the constraint that the wanted velocity broke most.

    Who broke none was pushed by others: the constraint it came nearest to breaking.
    """
    reasons = [""] * len(wanted_m_s)
    changed = np.flatnonzero(np.linalg.norm(wanted_m_s - allowed_m_s, axis=1) > NOTICEABLE_M_S)
    if len(changed) == 0:
        return tuple(reasons)
    which = tightest(wanted_m_s, *joined)
    for row in changed:
        k = which[row]
        if k == NOBODY:
            reasons[row] = "limits"
        elif k < len(walls):
            reasons[row] = walls.reason[k]
        else:
            first, other = pairs.first[k - len(walls)], pairs.other[k - len(walls)]
            reasons[row] = f"separation from {names[other if first == row else first]}"
    return tuple(reasons)
