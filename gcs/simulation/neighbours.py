"""Vehicles that see only their neighbours: messages, agreement on the centre, and the law.

Messages have limited range, delay and loss. The centre is commanded or agreed (article, section 6). Row i of
every result of the law depends on row i of the arguments alone: each vehicle could compute its own.
"""

from collections import deque
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from gcs.control.center import Lead
from gcs.control.desired_velocity import Spread
from gcs.control.inputs import Memory, TickInputs
from gcs.formation.law import directions_from, symmetry_offsets
from gcs.formation.orbit import Center
from gcs.model.jit import kernel
from gcs.model.state import TINY, Array, Mask, freeze
from gcs.simulation.scenario import ConsensusSettings, NeighboursSettings, Radio


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


def sphere_velocity(
    position_m: Array, center_m: Array, *, radius_m: float, rate_per_s: float, speed_max_m_s: float
) -> Array:
    """The same pull as a velocity: `rate_per_s` near the shell, limited away from it.

    Args:
        position_m: (n, 3), show frame.
        center_m: (3,), show frame.
        radius_m: of the sphere, above 0.
        rate_per_s: how fast a small radial error decays.
        speed_max_m_s: no row is faster.

    Returns: (n, 3) in m/s along the radius. A vehicle at the centre itself is sent up, so that it is not
    stuck.

    Source: article, section 2.1, divided by ``2 r r_d`` near the shell, so that the gain is a rate.
    """
    offset_m = position_m - center_m
    distance_m = np.linalg.norm(offset_m, axis=1, keepdims=True)
    outward = np.where(distance_m > TINY, offset_m / np.maximum(distance_m, TINY), (0.0, 0.0, -1.0))
    excess_m = (distance_m**2 - radius_m**2) / (2 * radius_m)
    velocity: Array = -outward * np.clip(rate_per_s * excess_m, -speed_max_m_s, speed_max_m_s)
    return velocity


AHEAD = 2.0
"""Factor by which a vehicle aims beyond the point where it would rest among neighbours at rest.

No vehicle can compute the repulsion ahead for all the others, as `gcs.formation.law` does, so soft modes
settle along the plain force: the larger the factor, the faster. Measured (N = 20 and 50, PX4's response, 10 %
loss): settled after 36 to 60 s with 0.5, 13 to 25 s with 2; 3 is no faster, with 4 the stiff modes never come
to rest.
"""


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


@dataclass(frozen=True, slots=True, eq=False)
class NeighboursLaw:
    """The law of `gcs.control.tick` for vehicles with that sight, one row for each vehicle of the fleet."""

    sight: Sight
    settings: NeighboursSettings

    def __call__(self, now: TickInputs, lead: Lead, _memory: Memory) -> Spread:
        """The velocities of the vehicles in formation, without slots; see `gcs.control.desired_velocity`."""
        nowhere, still = np.full_like(now.position_m, np.nan), np.zeros_like(now.position_m)
        if lead.center is None or len(now.rows) == 0:
            return Spread(nowhere, still, np.zeros((len(now.rows), 3)))
        position_m = now.of_formed(now.position_m)
        direction, _ = directions_from(position_m, lead.center.position_m)
        velocity_m_s = sighted_velocity(
            position_m,
            symmetry_offsets(direction, now.fleet.ids, now.rows),
            now.fleet.time_s - lead.engaged_time_s[now.rows],
            self.sight.only(now.formed),
            lead.center,
            radius_m=lead.radius_m,
            speed_max_m_s=now.settings.law.speed_m_s,
            settings=self.settings,
        )
        return Spread(nowhere, still, velocity_m_s, knows_center=self.sight.belief is None)


PLACE, PACE, CENTER, CENTER_PACE = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
DEGREE, SENT = 12, 13
WORDS = 14
"""Numbers in a message: position, velocity, estimated centre and its velocity, number of neighbours, time."""


def range_m(neighbours: int, count: int, radius_m: float) -> float:
    """Range that includes about `neighbours` of `count` vehicles, spread evenly over the sphere.

    The cap of the sphere within a chord d has the share (d / 2R)^2 of its area.
    """
    return 2.0 * radius_m * min(1.0, sqrt(neighbours / max(count - 1, 1)))


class Neighbourhood:
    """Received messages of every vehicle, and its estimate of the centre."""

    def __init__(self, radio: Radio, charge: Array, radius_m: float, tick_s: float, seed: int) -> None:
        """`charge` (n,); no message has been sent yet."""
        n = len(charge)
        self._radio, self._charge, self._tick_s = radio, charge, tick_s
        self._range_m = range_m(radio.neighbours, n, radius_m)
        self._random = np.random.default_rng([seed, 2])
        self._newest = np.full((n, n, WORDS), np.nan)  # received by row from column
        self._newest[:, :, SENT] = -np.inf
        self._under_way: deque[tuple[float, Mask, Array]] = deque()  # arrival, receivers, messages
        self._belief = Belief.nothing(n)
        sees = self._random.permutation(n) < max(1, round(radio.sighting_share * n))
        error_m = radio.sighting_error_m * self._random.standard_normal((n, 3))
        self._sighting_error_m = np.where(sees[:, None], error_m, np.nan)

    def exchange(
        self, now_s: float, position_m: Array, velocity_m_s: Array, present: Mask, center: Center | None
    ) -> Sight:
        """Deliver messages, update every vehicle's estimate, and send its next message.

        Args:
            now_s: virtual time.
            position_m: (n, 3) each vehicle's own estimate.
            velocity_m_s: (n, 3) likewise.
            present: (n,) vehicles that send and receive.
            center: the commanded centre, for vehicles that observe it; None before there is one.

        Returns: what each vehicle's law knows now.
        """
        self._deliver(now_s)
        mail, columns = self._mail(now_s)
        age_s = now_s - mail[:, :, SENT, None]
        degree = np.isfinite(mail[:, :, 0]).sum(axis=1).astype(np.float64)
        belief = None
        if self._radio.center == "agreed":
            forward_m = mail[:, :, CENTER] + age_s * mail[:, :, CENTER_PACE]
            received = NeighbourMessages(forward_m, mail[:, :, CENTER_PACE], mail[:, :, DEGREE])
            self._belief = agree(
                self._belief, received, self._sighted(center), self._tick_s, self._radio.consensus
            )
            belief = self._belief
        self._send(now_s, position_m, velocity_m_s, degree, present)
        inbox_m = mail[:, :, PLACE] + age_s * mail[:, :, PACE]
        return Sight(inbox_m, self._charge[columns], self._range_m, belief)

    def _deliver(self, now_s: float) -> None:
        while self._under_way and self._under_way[0][0] <= now_s + 1e-9:
            _, gets, messages = self._under_way.popleft()
            self._newest = np.where(gets[:, :, None], messages[None], self._newest)

    def _mail(self, now_s: float) -> tuple[Array, NDArray[np.intp]]:
        """(n, k, WORDS) newest recent message of each sender, padded with NaN, and (n, k) sender columns."""
        lately = now_s - self._newest[:, :, SENT] <= self._radio.silence_max_s
        most = max(1, int(lately.sum(axis=1).max(initial=0)))
        columns = np.argsort(~lately, axis=1, kind="stable")[:, :most]
        mail: Array = np.take_along_axis(self._newest, columns[:, :, None], axis=1)
        mail[~np.take_along_axis(lately, columns, axis=1)] = np.nan
        return mail, columns

    def _sighted(self, center: Center | None) -> Belief:
        if center is None:
            return Belief.nothing(len(self._charge))
        unseen = 0.0 * self._sighting_error_m  # NaN for vehicles that do not observe the centre
        return Belief(center.position_m + self._sighting_error_m, center.velocity_m_s + unseen)

    def _send(
        self, now_s: float, position_m: Array, velocity_m_s: Array, degree: Array, present: Mask
    ) -> None:
        messages = np.column_stack(
            [
                position_m,
                velocity_m_s,
                self._belief.center_m,
                self._belief.velocity_m_s,
                degree,
                np.full(len(degree), now_s),
            ]
        )
        apart_m = np.linalg.norm(position_m[:, None] - position_m[None], axis=2)
        gets = (apart_m < self._range_m) & present[:, None] & present[None, :]
        np.fill_diagonal(gets, val=False)
        if self._radio.loss:
            gets &= self._random.random(gets.shape) >= self._radio.loss
        self._under_way.append((now_s + self._radio.delay_s, gets, messages))
