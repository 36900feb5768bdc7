"""Authority: how far each vehicle still answers its setpoints, measured, and what can be promised with it.

    missing = from the measured velocity to the span of the allowed ones of about the last `answer_s`, by axis
    lack'   = (missing - lack) / lack_s                          what the vehicle does not reach, lasting
    wander^2: average of the square of missing - its mean of the fleet, up in 1 s and down in 10 s

A fleet in order has neither, whether its answers are immediate or late. Wind beyond the tilt or thrust of
the vehicles, gusts, and a speed limit that this station does not know show as both or one of them.
"""

from dataclasses import dataclass, fields, replace
from math import sqrt

import numpy as np

from gcs.model.jit import kernel
from gcs.model.response import FleetResponse
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import TINY, Array, Mask, Traits
from gcs.safety.constraints import NO_ROW, Constraints
from gcs.safety.neighbours import Rows

GROWS_PER_S, SHRINKS_PER_S = 1.0, 0.1
"""Rates of the averaged square: gusts are noticed at once, and expected again for a while."""

SLOW_M_S, SLOW_WANDER = 0.6, 2.5
"""Beyond this lack, and this many times the wander of the fleet, a vehicle may be slower than configured."""

STEADY = 0.8
"""Least cosine between the lack of a slow vehicle and its velocity: one that is blown off flies elsewhere."""

SPARE_M_S = 0.3
"""By this much the learned speed limit may be above what the vehicle reached."""

RETRY_M_S2 = 0.2
"""Growth of the learned speed limit while the vehicle reaches it."""

RECOVERED = 0.75
"""Share of the configured speed from which a learned limit ends: few flights ask for all of it."""

LOWEST_M_S = 0.5
"""Least speed limit that is learned."""

RAMPS_M_S = 2.0
"""Where an autopilot limits its acceleration, a vehicle responds later by the time of such a change."""

WALL_SHARE = 0.2
"""Cosine between a wall's normal and a lack from which the wall counts as one that demands the lack."""


class AuthoritySettings(Settings):
    """When vehicles count as short of authority, and what follows."""

    answer_s: Positive = 1.0
    """For about this time a vehicle in order may still fly what was allowed before, in s."""
    free_m_s: NotNegative = 0.3
    """Unexpected velocity that the margins cover anyway, in m/s."""
    horizon_s: NotNegative = 1.0
    """Unexpected velocity times this is a standard deviation of the position, in s; 0: none."""
    wander_max_m: NotNegative = 1.5
    """Most that the standard deviation of `horizon_s` may be, in m."""
    lack_s: Positive = 0.7
    """Averaging time of the velocity that a vehicle lacks, in s."""
    lack_m_s: Positive = 0.5
    """A vehicle that lacks more is yielded to, in m/s."""
    reserve_m_s: NotNegative = 0.5
    """So much more than it reaches is still asked of a vehicle that lacks velocity, in m/s."""
    slow_s: Positive = 3.0
    """A lack along its own way for this time lowers its speed limit, in s."""


@dataclass(frozen=True, slots=True, eq=False)
class Authority:
    """What is known of every vehicle's answers. Rows as in FleetState. Owns its arrays."""

    least_m_s: Array  # (n, 3) allowed of late, NaN: not commanded
    most_m_s: Array  # (n, 3) likewise
    lack_m_s: Array  # (n, 3) lasting part of the velocity that is missing
    square_m2_s2: Array  # (n,) averaged square of the changing part, along each axis
    slow_for_s: Array  # (n,) for how long it has lacked speed along its own way
    speed_max_m_s: Array  # (n,) learned limit, inf: as configured

    @staticmethod
    def full(count: int) -> "Authority":
        """Nothing is known to be missing."""
        still = np.zeros((count, 3))
        nothing = np.full((count, 3), np.nan)
        return Authority(nothing, nothing, still, np.zeros(count), np.zeros(count), np.full(count, np.inf))

    def first(self, count: int) -> "Authority":
        """Of the first `count` vehicles."""
        columns = (getattr(self, field.name)[:count] for field in fields(self))
        return Authority(*columns)

    def wander_m(self, settings: AuthoritySettings, others: int = 0) -> Array:
        """(n + others,) standard deviations of where unexpected velocities lead.

        At least the fleet's common one; of vehicles that other stations command, the last, that one.
        """
        together_m2_s2 = self.fleet_wander_m_s**2
        numbers = settings.free_m_s, settings.horizon_s, settings.wander_max_m
        return _wander_m(self.lack_m_s, self.square_m2_s2, others, together_m2_s2, *numbers)

    @property
    def fleet_wander_m_s(self) -> float:
        """Root mean square of the unexpected velocities of the commanded vehicles, along each axis."""
        of_commanded = self.square_m2_s2[np.isfinite(self.least_m_s[:, 0])]
        return sqrt(float(np.add.reduce(of_commanded)) / len(of_commanded)) if len(of_commanded) else 0.0

    @property
    def slow(self) -> Mask:
        """(n,) has a learned speed limit."""
        return np.asarray(np.isfinite(self.speed_max_m_s))

    def limit(self, traits: Traits) -> Traits:
        """The traits with the learned speed limits of the first n of them."""
        if not np.count_nonzero(self.slow):
            return traits
        speed_max_m_s, n = traits.speed_max_m_s.copy(), len(self.speed_max_m_s)
        speed_max_m_s[:n] = np.minimum(speed_max_m_s[:n], self.speed_max_m_s)
        return replace(traits, speed_max_m_s=speed_max_m_s)


@kernel
def _wander_m(
    lack_m_s: Array,
    square_m2_s2: Array,
    others: int,
    together_m2_s2: float,
    free_m_s: float,
    horizon_s: float,
    most_m: float,
) -> Array:
    """As `Authority.wander_m`; `together_m2_s2` is the fleet's common square."""
    n = len(lack_m_s)
    common_m = horizon_s * np.sqrt(max(together_m2_s2 - free_m_s**2, 0.0))
    wander_m = np.full(n + others, min(common_m, most_m))
    for i in range(n):
        lost = 0.0
        for k in range(3):
            lost += lack_m_s[i, k] ** 2
        gust_m2_s2 = max(square_m2_s2[i], together_m2_s2) + lost / 3.0 - free_m_s**2
        wander_m[i] = min(horizon_s * np.sqrt(max(gust_m2_s2, 0.0)), most_m)
    return wander_m


def measured(
    before: Authority,
    allowed_m_s: Array,
    velocity_m_s: Array,
    commanded: Mask,
    fastest_m_s: Array,
    *,
    dt_s: float,
    link_delay_s: float,
    settings: AuthoritySettings,
    response: FleetResponse | None = None,
) -> Authority:
    """What is known after the newest telemetry.

    Args:
        before: of the previous tick.
        allowed_m_s: (n, 3) that the previous tick commanded, NaN: none.
        velocity_m_s: (n, 3) measured.
        commanded: (n,) has a task and fresh telemetry now.
        fastest_m_s: (n,) configured speed of each vehicle sideways; a learned limit near it ends.
        dt_s: since the previous tick.
        link_delay_s: one way: answers may be later by a round trip.
        settings: thresholds and times.
        response: (n,) by how much vehicles may answer later than `settings` have it; None: not at all.
    """
    ramps_s = np.zeros(len(commanded)) if response is None else RAMPS_M_S / response.acceleration_m_s2
    answer_s = settings.answer_s + 4.0 * link_delay_s + ramps_s
    return Authority(
        *_measured(
            np.array(before.least_m_s),
            np.array(before.most_m_s),
            np.array(before.lack_m_s),
            np.array(before.square_m2_s2),
            np.array(before.slow_for_s),
            np.array(before.speed_max_m_s),
            np.array(allowed_m_s),
            velocity_m_s,
            commanded,
            fastest_m_s,
            answer_s,
            dt_s,
            (settings.lack_s + 2.0 * link_delay_s, settings.slow_s),
        )
    )


@kernel
def _measured(
    least_m_s: Array,
    most_m_s: Array,
    lack_m_s: Array,
    square_m2_s2: Array,
    slow_for_s: Array,
    speed_max_m_s: Array,
    allowed_m_s: Array,
    velocity_m_s: Array,
    commanded: Mask,
    fastest_m_s: Array,
    answer_s: Array,
    dt_s: float,
    times: tuple[float, float],
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """As `measured`; the arrays of the state are changed."""
    lack_s, slow_s = times
    n = len(commanded)
    missing_m_s, mean_m_s, many = np.zeros((n, 3)), np.zeros(3), 0
    lasts, fades = 1.0 - np.exp(-dt_s / lack_s), np.exp(-dt_s * SHRINKS_PER_S)
    grows, shrinks = 1.0 - np.exp(-dt_s * GROWS_PER_S), 1.0 - np.exp(-dt_s * SHRINKS_PER_S)
    for i in range(n):
        if not commanded[i] or not np.isfinite(allowed_m_s[i, 0]):
            for k in range(3):
                least_m_s[i, k] = most_m_s[i, k] = np.nan
                lack_m_s[i, k] = 0.0
            slow_for_s[i] = 0.0
            square_m2_s2[i] *= fades
            continue
        many += 1
        blend = 1.0 - np.exp(-dt_s / answer_s[i])
        for k in range(3):
            missing_m_s[i, k] = _missing(i, k, least_m_s, most_m_s, allowed_m_s, velocity_m_s, blend)
            lack_m_s[i, k] += lasts * (missing_m_s[i, k] - lack_m_s[i, k])
            mean_m_s[k] += missing_m_s[i, k]
    together = 0.0
    for i in range(n):
        if np.isfinite(least_m_s[i, 0]):
            square = 0.0
            for k in range(3):
                square += (missing_m_s[i, k] - mean_m_s[k] / many) ** 2 / 3.0
            share = grows if square > square_m2_s2[i] else shrinks
            square_m2_s2[i] += share * (square - square_m2_s2[i])
            together += square_m2_s2[i] / many
    slow_m_s = max(SLOW_M_S, SLOW_WANDER * np.sqrt(together))
    for i in range(n):
        if np.isfinite(least_m_s[i, 0]):
            _learn_limit(
                i, lack_m_s, velocity_m_s, allowed_m_s, slow_for_s, speed_max_m_s, dt_s, slow_s, slow_m_s
            )
    unlimited = speed_max_m_s >= RECOVERED * fastest_m_s
    return least_m_s, most_m_s, lack_m_s, square_m2_s2, slow_for_s, np.where(unlimited, np.inf, speed_max_m_s)


@kernel
def _missing(
    i: int, k: int, least_m_s: Array, most_m_s: Array, allowed_m_s: Array, velocity_m_s: Array, blend: float
) -> float:
    """Move the span of row i along axis k on by the share `blend`, in place. Returns: what is missing."""
    new_m_s, now_m_s = allowed_m_s[i, k], velocity_m_s[i, k]
    if not np.isfinite(least_m_s[i, k]):
        least_m_s[i, k] = most_m_s[i, k] = now_m_s
    least_m_s[i, k] = min(new_m_s, least_m_s[i, k] + blend * (new_m_s - least_m_s[i, k]))
    most_m_s[i, k] = max(new_m_s, most_m_s[i, k] + blend * (new_m_s - most_m_s[i, k]))
    missing_m_s: float = min(max(now_m_s, least_m_s[i, k]), most_m_s[i, k]) - now_m_s
    return missing_m_s


@kernel
def _learn_limit(
    i: int,
    lack_m_s: Array,
    velocity_m_s: Array,
    allowed_m_s: Array,
    slow_for_s: Array,
    speed_max_m_s: Array,
    dt_s: float,
    slow_s: float,
    slow_m_s: float,
) -> None:
    """Lower or raise the speed limit of row i, in place, from its motion over the ground."""
    lack, speed, asked, along = 0.0, 0.0, 0.0, 0.0
    for k in range(2):
        lack += lack_m_s[i, k] ** 2
        speed += velocity_m_s[i, k] ** 2
        asked += allowed_m_s[i, k] ** 2
        along += lack_m_s[i, k] * velocity_m_s[i, k]
    lack, speed, asked = np.sqrt(lack), np.sqrt(speed), np.sqrt(asked)
    too_slow = lack > slow_m_s and along > STEADY * lack * speed and speed > LOWEST_M_S / 2.0
    slow_for_s[i] = slow_for_s[i] + dt_s if too_slow else 0.0
    if slow_for_s[i] >= slow_s:
        speed_max_m_s[i] = min(speed_max_m_s[i], max(speed + SPARE_M_S, LOWEST_M_S))
    elif np.isfinite(speed_max_m_s[i]) and asked > 0.9 * speed_max_m_s[i] and speed > 0.8 * asked:
        speed_max_m_s[i] += RETRY_M_S2 * dt_s


def reach_constraints(
    velocity_m_s: Array,
    commanded: Mask,
    lack_m_s: Array,
    walls: Constraints,
    threshold_m_s: float,
    reserve_m_s: float,
) -> Constraints:
    """Bound each velocity along a large lack to what the vehicle does, plus a reserve.

    Large is twice the threshold and more. Of a pair, the other vehicle then has to do all of it. Where a wall
    demands more, it is demanded.

    Args:
        velocity_m_s: (n, 3) measured.
        commanded: (n,).
        lack_m_s: (n, 3).
        walls: of the same rows.
        threshold_m_s: as of `yielding`.
        reserve_m_s: as of `yielding`.
    """
    rows, size_m_s = _lacking(np.array(commanded), np.array(lack_m_s), 2.0 * threshold_m_s)
    if len(rows) == 0:
        return Constraints.none()
    along = np.zeros_like(lack_m_s)
    along[rows] = lack_m_s[rows] / size_m_s[:, None]
    reach_m_s = (along * velocity_m_s).sum(axis=1) + reserve_m_s
    towards = (walls.normal * along[walls.first]).sum(axis=1)
    demanded = towards > WALL_SHARE
    needed_m_s = walls.bound_m_s[demanded] / towards[demanded]
    np.maximum.at(reach_m_s, walls.first[demanded], needed_m_s)
    reasons = np.full(len(rows), "authority", dtype=object)
    return Constraints(rows, np.full(len(rows), NO_ROW), -along[rows], -reach_m_s[rows], reasons)


@kernel
def _lacking(commanded: Mask, lack_m_s: Array, least_m_s: float) -> tuple[Rows, Array]:
    """Rows (k,) of the commanded vehicles that lack at least so much, and (k,) how much."""
    rows, size_m_s, lacking = np.empty(len(commanded), np.intp), np.empty(len(commanded)), 0
    for i in range(len(commanded)):
        square = 0.0
        for k in range(3):
            square += lack_m_s[i, k] ** 2
        if commanded[i] and np.sqrt(square) >= least_m_s:
            rows[lacking], size_m_s[lacking] = i, np.sqrt(square)
            lacking += 1
    return rows[:lacking], size_m_s[:lacking]


@kernel
def yielding(
    desired_m_s: Array, velocity_m_s: Array, lack_m_s: Array, threshold_m_s: float, reserve_m_s: float
) -> tuple[Array, Mask]:
    """Velocities (n, 3) that no longer ask for what the vehicles do not reach, and the rows (n,) that yield.

    A vehicle that is asked for more than it has gives all of its thrust for that, and nothing is left to keep
    it apart from others. Along its lack it is asked for `reserve_m_s` more than it does. The safety filter
    comes after this: walls and pairs may demand everything.

    Args:
        desired_m_s: (n, 3).
        velocity_m_s: (n, 3) measured.
        lack_m_s: (n, 3).
        threshold_m_s: a lack of this size begins to count; one of twice this size counts completely.
        reserve_m_s: as above.
    """
    yielded_m_s, yields = desired_m_s.copy(), np.zeros(len(desired_m_s), np.bool_)
    for i in range(len(desired_m_s)):
        square = 0.0
        for k in range(3):
            square += lack_m_s[i, k] ** 2
        lack = np.sqrt(square)
        share = min((lack - threshold_m_s) / threshold_m_s, 1.0)
        if not share > 0.0:
            continue
        yields[i] = True
        over = -reserve_m_s
        for k in range(3):
            over += (desired_m_s[i, k] - velocity_m_s[i, k]) * lack_m_s[i, k] / max(lack, TINY)
        if over > 0.0:
            for k in range(3):
                yielded_m_s[i, k] -= share * over * lack_m_s[i, k] / max(lack, TINY)
    return yielded_m_s, yields
