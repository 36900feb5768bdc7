"""The law of vehicles that know only their neighbours, and the agreement on the centre between them.

The centre is commanded or agreed (article, section 6). Row i of every result depends only on row i of the
arguments, and on the neighbours of vehicle i: each vehicle could compute its own.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from gcs.formation.article import ForceSettings, no_faster, outward_of, virtual_velocity
from gcs.model.jit import kernel
from gcs.model.settings import Positive
from gcs.model.state import TINY, Array, Mask, freeze


class NeighboursSettings(ForceSettings):
    """Rates of vehicles that know only their neighbours."""

    spreading_rate_per_s: Positive = 0.45
    """Rate at which a vehicle goes to its place among neighbours at rest, in 1/s."""
    neighbours: Annotated[int, Field(ge=1)] = 12
    """About so many are in range on the finished sphere."""
    sighting_rate_per_s: Positive = 5.0
    """Pull of the own sighting of the centre, in 1/s; the neighbours' is about 3."""


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
    belief: Belief, received: NeighbourMessages, sighting: Belief, dt_s: float, sighting_rate_per_s: float
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
        sighting_rate_per_s: pull of the own sighting.

    Returns: the beliefs `dt_s` later.

    Source: Xiao, Boyd, Lall 2005, "A scheme for robust distributed sensor fusion based on average consensus".
    """
    received_center: Mask = np.asarray(np.isfinite(received.center_m).all(axis=2))
    degree = received_center.sum(axis=1)
    weight = np.where(received_center, 1.0 / (1.0 + np.maximum(degree[:, None], received.degree)), 0.0)
    lean = 1.0 - np.exp(-sighting_rate_per_s * dt_s)

    def mixed(own: Array, others: Array, seen: Array) -> Array:
        others = np.where(received_center[:, :, None], others, 0.0)
        mean = others.sum(axis=1) / np.maximum(degree, TINY)[:, None]
        first = np.where(degree[:, None] > 0, mean, np.nan)
        begun = np.where(np.isfinite(own), own, np.where(np.isfinite(seen), seen, first))
        pull = (weight[:, :, None] * (others - begun[:, None])).sum(axis=1)
        later: Array = begun + pull + np.where(np.isfinite(seen), lean * (seen - begun), 0.0)
        return later

    velocity_m_s = mixed(belief.velocity_m_s, received.velocity_m_s, sighting.velocity_m_s)
    went_m = belief.center_m + dt_s * belief.velocity_m_s
    return Belief(mixed(went_m, received.center_m, sighting.center_m), velocity_m_s)


def sphere_velocity(
    position_m: Array, center_m: Array, *, radius_m: float, rate_per_s: float, speed_max_m_s: float
) -> Array:
    """The pull onto the sphere as a velocity: `rate_per_s` near the shell, limited away from it.

    Args:
        position_m: (n, 3), show frame.
        center_m: (3,), or (n, 3) if each vehicle has its own estimate; show frame.
        radius_m: of the sphere, above 0.
        rate_per_s: how fast a small radial error decays.
        speed_max_m_s: no row is faster.

    Returns: (n, 3) in m/s along the radius. A vehicle at the centre itself is sent up, so that it is not
    stuck.

    Source: article, section 2.1, divided by ``2 r r_d`` near the shell, so that the gain is a rate.
    """
    outward, distance_m = outward_of(position_m - center_m)
    excess_m = (distance_m**2 - radius_m**2) / (2 * radius_m)
    velocity: Array = -outward * np.clip(rate_per_s * excess_m, -speed_max_m_s, speed_max_m_s)
    return velocity


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What every vehicle knows: at most k neighbours, in any order. Show frame. Owns its arrays."""

    inbox_m: Array  # (n, k, 3) neighbours' positions now, NaN where there is none
    inbox_charge: Array  # (n, k) their charges; only those with a position count
    range_m: float  # neighbours farther away are not received
    belief: Belief | None  # each vehicle's own centre; None: all know the commanded centre

    def __post_init__(self) -> None:
        n, k = self.inbox_charge.shape
        freeze(self.inbox_m, (n, k, 3), "inbox_m")
        freeze(self.inbox_charge, (n, k), "inbox_charge")

    def only(self, rows: Mask) -> "Sight":
        """What the vehicles of `rows` (n,) see."""
        belief = None if self.belief is None else self.belief.only(rows)
        return Sight(self.inbox_m[rows], self.inbox_charge[rows], self.range_m, belief)


def range_m(neighbours: int, count: int, radius_m: float) -> float:
    """Range that includes about `neighbours` of `count` vehicles, spread evenly over the sphere.

    The cap of the sphere within a chord d has the share (d / 2R)^2 of its area.
    """
    return 2.0 * radius_m * min(1.0, sqrt(neighbours / max(count - 1, 1)))


@kernel
def _in_range(position_m: Array, range_m: float) -> NDArray[np.intp]:
    """(n, k) rows of each vehicle's neighbours within the range, -1 where there are fewer than k."""
    n, most = len(position_m), 1
    square = range_m * range_m
    for counting in (True, False):
        if not counting:
            columns = np.full((n, most), -1)
        for i in range(n):
            count = 0
            for j in range(n):
                dx = position_m[i, 0] - position_m[j, 0]
                dy = position_m[i, 1] - position_m[j, 1]
                dz = position_m[i, 2] - position_m[j, 2]
                if j != i and dx * dx + dy * dy + dz * dz < square:
                    if not counting:
                        columns[i, count] = j
                    count += 1
            most = max(most, count)
    return columns


def sight_of(
    position_m: Array,
    charge: Array,
    belief: Belief,
    sighting: Belief,
    *,
    range_m: float,
    dt_s: float,
    sighting_rate_per_s: float,
) -> Sight:
    """What vehicles that exchange messages without loss know of each other; arrays (n, 3), charge (n,).

    Args:
        position_m: now.
        charge: of each.
        belief: of the previous round, `dt_s` ago.
        sighting: of the centre, now.
        range_m: of the messages.
        dt_s: since the previous round.
        sighting_rate_per_s: as in `agree`.
    """
    columns = _in_range(position_m, range_m)
    near = columns >= 0

    def of_neighbours(values: Array) -> Array:
        near_values: Array = values[columns]
        near_values[~near] = np.nan
        return near_values

    went = Belief(belief.center_m + dt_s * belief.velocity_m_s, belief.velocity_m_s)
    degree = near.sum(axis=1).astype(np.float64)
    received = NeighbourMessages(
        of_neighbours(went.center_m), of_neighbours(went.velocity_m_s), of_neighbours(degree)
    )
    agreed = agree(belief, received, sighting, dt_s, sighting_rate_per_s)
    return Sight(of_neighbours(position_m), of_neighbours(charge), range_m, agreed)


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


def neighbours_velocity(
    position_m: Array,
    momentum_m_s: Array,
    sight: Sight,
    belief: Belief,
    *,
    radius_m: float,
    dt_s: float,
    speed_max_m_s: float,
    settings: NeighboursSettings,
) -> tuple[Array, Array]:
    """Velocity of each vehicle from its own inbox alone: onto the sphere, and away from its neighbours.

    Args:
        position_m: (n, 3), show frame; each vehicle knows its own.
        momentum_m_s: (n, 3) virtual velocity of the previous tick.
        sight: of its neighbours; rows as `position_m`.
        belief: of the centre.
        radius_m: of the sphere now.
        dt_s: since the previous tick.
        speed_max_m_s: limit of either part.
        settings: rates.

    Returns: (n, 3) velocity in m/s, relative to each vehicle's own centre, and (n, 3) the next virtual
    velocity. A vehicle without a centre rests.

    Source: article, section 2.3: "using only the position of the formation center and its neighbors".
    """
    pull_m_s = sphere_velocity(
        position_m,
        belief.center_m,
        radius_m=radius_m,
        rate_per_s=settings.sphere_rate_per_s,
        speed_max_m_s=speed_max_m_s,
    )
    inboxes = np.array(sight.inbox_m), np.array(sight.inbox_charge)
    aside = step_aside(position_m, belief.center_m, *inboxes, sight.range_m)
    push_m_s = no_faster(settings.spreading_rate_per_s * radius_m * aside, speed_max_m_s)
    outward, _ = outward_of(position_m - belief.center_m)
    later_m_s = virtual_velocity(momentum_m_s, push_m_s, outward, dt_s, settings)
    has_center = np.isfinite(belief.center_m).all(axis=1, keepdims=True)
    return np.where(has_center, pull_m_s + push_m_s + later_m_s, 0.0), np.where(has_center, later_m_s, 0.0)
