"""Agreement on the formation's centre between neighbours, without a central command (article, section 6).

Row i of every result depends on row i of the arguments alone: each vehicle could compute its own.
"""

from dataclasses import dataclass

import numpy as np

from gcs.formation.sphere import TINY
from gcs.model.settings import Positive, Settings
from gcs.model.state import Array, Mask


class ConsensusSettings(Settings):
    """Weight of a vehicle's own sighting against its neighbours' messages."""

    sighting_rate_per_s: Positive = (
        0.1  # pull of the own sighting; that of the neighbours is about 3 per second
    )


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Each vehicle's estimate of the centre and its velocity; NaN rows where unknown. Show frame."""

    center_m: Array  # (n, 3)
    velocity_m_s: Array  # (n, 3)

    @staticmethod
    def describe(center_m: Array, velocity_m_s: Array, count: int) -> "Belief":
        """The same belief for `count` vehicles: centre (3,) and velocity (3,)."""
        return Belief(np.tile(center_m, (count, 1)), np.tile(velocity_m_s, (count, 1)))

    @staticmethod
    def nothing(count: int) -> "Belief":
        """No vehicle has an estimate yet."""
        return Belief(np.full((count, 3), np.nan), np.full((count, 3), np.nan))

    def only(self, rows: Mask) -> "Belief":
        """The rows `rows` (n,)."""
        return Belief(self.center_m[rows], self.velocity_m_s[rows])


@dataclass(frozen=True, slots=True, eq=False)
class NeighbourMessages:
    """Beliefs received from each vehicle's neighbours, at most k of them. Show frame."""

    center_m: Array  # (n, k, 3), NaN where there is no neighbour
    velocity_m_s: Array  # (n, k, 3)
    degree: Array  # (n, k) number of neighbours of each of them


def agree(
    belief: Belief, received: NeighbourMessages, sighting: Belief, dt_s: float, settings: ConsensusSettings
) -> Belief:
    """One round: dead-reckon the centre, mix with the neighbours, lean towards the own sighting.

    Metropolis weights, ``1 / (1 + max(d_i, d_j))``, are the same for both of a pair, so that every vehicle
    counts alike in the result, and each needs to know its neighbours only. A lost message makes a pair's
    exchange one-sided and moves the agreed value; leaning towards the sightings takes it back to their mean.

    Args:
        belief: of n vehicles. A vehicle without one takes its own sighting, else its neighbours' mean.
        received: from their neighbours.
        sighting: what each sees for itself, NaN rows for vehicles that see nothing.
        dt_s: since the last round.
        settings: rates.

    Returns: the beliefs `dt_s` later.

    Source: Xiao, Boyd, Lall 2005, "A scheme for robust distributed sensor fusion based on average consensus".
    """
    known: Mask = np.asarray(np.isfinite(received.center_m).all(axis=2))
    degree = known.sum(axis=1)
    weight = np.where(known, 1.0 / (1.0 + np.maximum(degree[:, None], received.degree)), 0.0)
    lean = 1.0 - np.exp(-settings.sighting_rate_per_s * dt_s)

    def mixed(own: Array, others: Array, seen: Array) -> Array:
        others = np.where(known[:, :, None], others, 0.0)
        mean = others.sum(axis=1) / np.maximum(degree, TINY)[:, None]
        first = np.where(degree[:, None] > 0, mean, np.nan)
        begun = np.where(np.isfinite(own), own, np.where(np.isfinite(seen), seen, first))
        pull = (weight[:, :, None] * (others - begun[:, None])).sum(axis=1)
        later: Array = begun + pull + np.where(np.isfinite(seen), lean * (seen - begun), 0.0)
        return later

    velocity_m_s = mixed(belief.velocity_m_s, received.velocity_m_s, sighting.velocity_m_s)
    went_m = belief.center_m + dt_s * belief.velocity_m_s
    return Belief(mixed(went_m, received.center_m, sighting.center_m), velocity_m_s)
