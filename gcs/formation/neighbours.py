"""The law of a vehicle that sees only its neighbours: their positions, and a commanded or agreed centre.

Row i of every result depends on row i of the arguments alone: each vehicle could compute its own.
"""

from dataclasses import dataclass

import numpy as np

from gcs.formation.consensus import Belief
from gcs.formation.orbit import Center
from gcs.formation.sphere import TINY, sphere_velocity
from gcs.model.jit import kernel
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import Array, Mask, freeze

AHEAD = 2.0
"""Factor by which a vehicle aims beyond the point where it would rest among neighbours at rest.

No vehicle can compute the repulsion ahead for all the others, as `gcs.formation.law` does, so soft modes
settle along the plain force: the larger the factor, the faster. Measured (N = 20 and 50, PX4's response, 10 %
loss): settled after 36 to 60 s with 0.5, 13 to 25 s with 2; 3 is no faster, with 4 the stiff modes never come
to rest.
"""


class NeighboursSettings(Settings):
    """Rates of vehicles that see only their neighbours; docs/decisions/0001 has those of the flown law."""

    sphere_rate_per_s: Positive = 0.8  # at which the distance from the sphere decays
    spreading_rate_per_s: Positive = 0.8  # at which a vehicle goes to its place among its neighbours
    symmetry_speed_m_s: NotNegative = 0.3  # of the offset that breaks symmetries when a vehicle joins
    symmetry_decay_s: Positive = 4.0  # after which a third of it is left


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What every vehicle sees: at most k neighbours, in any order. Show frame. Owns its arrays."""

    inbox_m: Array  # (n, k, 3) neighbours' positions, NaN where there is none
    inbox_charge: Array  # (n, k) their charges; only those with a position count
    range_m: float  # neighbours farther away are not received
    belief: Belief | None = None  # each vehicle's own centre; None: all use the commanded centre

    def __post_init__(self) -> None:
        n, k = self.inbox_charge.shape
        freeze(self.inbox_m, (n, k, 3), "inbox_m")
        freeze(self.inbox_charge, (n, k), "inbox_charge")

    def only(self, rows: Mask) -> "Sight":
        """What the vehicles of `rows` (n,) see."""
        belief = None if self.belief is None else self.belief.only(rows)
        return Sight(self.inbox_m[rows], self.inbox_charge[rows], self.range_m, belief)


@kernel
def step_aside(
    position_m: Array, center_m: Array, inbox_m: Array, inbox_charge: Array, range_m: float
) -> Array:
    """The step along the unit sphere to where each vehicle would rest among its neighbours at rest.

    The article's repulsion between directions, times ``1 - (d / range)^2``: it ends smoothly, because a
    repulsion that breaks off at the range has its rest where neighbours are just outside it (the nearest
    ratio is then 0.85 instead of 1.00). Divided by the mean stiffness of the same sum, so that neither N nor
    the radius nor the range matter.

    Args:
        position_m: (n, 3).
        center_m: (n, 3), each vehicle's own.
        inbox_m: (n, k, 3), rows not finite do not count.
        inbox_charge: (n, k).
        range_m: where the repulsion ends.

    Returns: (n, 3) in radians, at right angles to the vehicle's radius. 0 without neighbours, or without a
        direction of its own.

    Source: article, section 2.2; Newton's method for one vehicle.
    """
    aside = np.zeros((len(position_m), 3))
    here, away, push = np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(position_m)):
        here[:] = position_m[i] - center_m[i]
        length = np.sqrt((here**2).sum())
        if not length > 1e-9:
            continue
        here /= length
        push[:] = 0.0
        stiffness = 0.0
        for k in range(inbox_m.shape[1]):
            share = np.sqrt(((position_m[i] - inbox_m[i, k]) ** 2).sum()) / range_m
            away[:] = inbox_m[i, k] - center_m[i]
            length = np.sqrt((away**2).sum())
            if not (share < 1.0 and length > 1e-9):  # False for NaN
                continue
            away[:] = here - away / length
            chord = np.sqrt((away**2).sum())
            if chord < 1e-6:
                continue
            window = 1.0 - share * share
            strength = inbox_charge[i, k] / chord**3
            push += strength * window * away
            stiffness += strength * (0.5 * window + share * share)
        if stiffness > 0.0:
            aside[i] = (push - here * (push * here).sum()) / stiffness
    return aside


def sighted_velocity(
    position_m: Array,
    symmetry_offset: Array,
    engaged_s: Array,
    sight: Sight,
    center: Center,
    *,
    radius_m: float,
    speed_max_m_s: float,
    settings: NeighboursSettings,
) -> Array:
    """Velocity of each vehicle from its own inbox alone: onto the sphere, and away from its neighbours.

    `gcs.formation.law` moves all slots together; here each vehicle knows its neighbours only.

    Args:
        position_m: (n, 3), show frame; each vehicle knows its own.
        symmetry_offset: (n, 3) no longer than 1, which break symmetry; they decay.
        engaged_s: (n,) seconds since each vehicle joined.
        sight: rows as `position_m`.
        center: commanded; counts only where no beliefs are given.
        radius_m: of the sphere now.
        speed_max_m_s: limit of either part.
        settings: rates.

    Returns: (n, 3) in m/s. A vehicle without a centre rests.

    Source: article, section 2.3: "using only the position of the formation center and its neighbors".
    """
    reported = Belief.describe(center.position_m, center.velocity_m_s, len(position_m))
    belief = reported if sight.belief is None else sight.belief
    drawn_m_s = sphere_velocity(
        position_m,
        belief.center_m,
        radius_m=radius_m,
        rate_per_s=settings.sphere_rate_per_s,
        speed_max_m_s=speed_max_m_s,
    )
    aside = step_aside(position_m, belief.center_m, sight.inbox_m, sight.inbox_charge, sight.range_m)
    along_m_s = settings.spreading_rate_per_s * AHEAD * radius_m * aside
    speed_m_s = np.linalg.norm(along_m_s, axis=1, keepdims=True)
    along_m_s *= np.minimum(1.0, speed_max_m_s / np.maximum(speed_m_s, TINY))
    symmetry_m_s = (
        settings.symmetry_speed_m_s
        * np.exp(-engaged_s / settings.symmetry_decay_s)[:, None]
        * symmetry_offset
    )
    velocity = drawn_m_s + along_m_s + symmetry_m_s + belief.velocity_m_s
    return np.where(np.isfinite(belief.center_m).all(axis=1, keepdims=True), velocity, 0.0)
