"""Answers: whether each vehicle follows its setpoints as fast as its autopilot's profile says.

Beside every vehicle a laggard is computed, which does so just fast enough:

    f' = (allowed - f) / late_s              the allowed velocity, late
    g' = towards f, |g'| <= LAGGARD a        a: the acceleration that the profile names
    behind = the least of |f - measured| - |f - g|, |allowed - measured| - |allowed - g|,
             and |newly - measured|: newly is the nearest of what was allowed within the last late_s

So a vehicle is behind if it is farther than its laggard from both, and flies nothing that was allowed lately.
One that answers sooner than f is nearer to the allowed velocity, one that answers later over its link is
nearer to f; and where velocities go to and fro, f has smoothed them and a vehicle that is only late has not.
"""

from dataclasses import dataclass

import numpy as np

from gcs.model.jit import kernel
from gcs.model.response import FleetResponse
from gcs.model.state import TINY, Array, Mask

LATE_S = 0.5
"""Lag of the laggard's setpoint."""

LAGGARD, UNNAMED_M_S2 = 0.7, 3.0
"""Its share of the profile's acceleration, and the acceleration where the profile names none."""

BEHIND_M_S, BEHIND_OF_ALL = 1.0, 2.0
"""Behind by more than this, and this many times the common lack of all (wind), a vehicle is too slow."""

NEWLY, SPACING_S = 16, 0.1
"""Velocities that were allowed lately, and the time from one to the next."""

COUNTS_S, KEPT_S = 1.0, 30.0
"""After this time it counts, and then for that long."""


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """The laggards, and how long vehicles were behind them. Rows as in FleetState. Owns its arrays."""

    late_m_s: Array  # (n, 3) allowed velocity that a laggard follows, NaN: not commanded
    laggard_m_s: Array  # (n, 3) its velocity, NaN: not commanded
    behind_s: Array  # (n,) how long the vehicle has been behind; from COUNTS_S on what is left of KEPT_S
    newly_m_s: Array  # (n, NEWLY, 3) velocities allowed lately, the newest first, NaN: none
    since_s: float = 0.0  # of the last one but the newest

    @staticmethod
    def none(count: int) -> "Answers":
        """Nothing is commanded yet."""
        nothing = np.full((count, 3), np.nan)
        return Answers(nothing, nothing, np.zeros(count), np.full((count, NEWLY, 3), np.nan))

    def first(self, count: int) -> "Answers":
        """Of the first `count` vehicles."""
        rows = self.late_m_s[:count], self.laggard_m_s[:count], self.behind_s[:count], self.newly_m_s[:count]
        return Answers(*rows, self.since_s)

    @property
    def slow(self) -> Mask:
        """(n,) answers slower than its profile says, or did so of late."""
        return np.asarray(self.behind_s >= COUNTS_S)


def slowest_m_s2(response: FleetResponse) -> Array:
    """(n,) accelerations below which vehicles do not follow their setpoints as their profiles say."""
    return LAGGARD * np.minimum(UNNAMED_M_S2, response.acceleration_m_s2)


def compared(
    before: Answers,
    allowed_m_s: Array,
    velocity_m_s: Array,
    commanded: Mask,
    lack_m_s: Array,
    response: FleetResponse,
    *,
    dt_s: float,
    link_delay_s: float,
) -> Answers:
    """What is known after the newest telemetry.

    Args:
        before: of the previous tick.
        allowed_m_s: (n, 3) that the previous tick commanded, NaN: none.
        velocity_m_s: (n, 3) measured.
        commanded: (n,) has a task and fresh telemetry now.
        lack_m_s: (n, 3) as of `Authority`.
        response: as the profiles say.
        dt_s: since the previous tick.
        link_delay_s: one way: answers may be later by a round trip.
    """
    late_s, since_s = LATE_S + 2.0 * link_delay_s, before.since_s + dt_s
    newly_m_s = np.empty_like(before.newly_m_s)
    if since_s > SPACING_S - TINY:
        newly_m_s[:, 1:], since_s = before.newly_m_s[:, :-1], 0.0
    else:
        newly_m_s[:, 1:] = before.newly_m_s[:, 1:]
    newly_m_s[:, 0] = allowed_m_s
    return Answers(
        *_compared(
            (np.array(before.late_m_s), np.array(before.laggard_m_s), np.array(before.behind_s)),
            newly_m_s,
            velocity_m_s,
            commanded,
            lack_m_s,
            slowest_m_s2(response),
            dt_s,
            late_s,
        ),
        newly_m_s,
        since_s,
    )


@kernel
def _compared(
    state: tuple[Array, Array, Array],
    newly_m_s: Array,
    velocity_m_s: Array,
    commanded: Mask,
    lack_m_s: Array,
    ramp_m_s2: Array,
    dt_s: float,
    late_s: float,
) -> tuple[Array, Array, Array]:
    """As `compared`; the arrays of the state are changed. `ramp_m_s2` (n,) is that of the laggards."""
    late_m_s, laggard_m_s, behind_s = state
    allowed_m_s = newly_m_s[:, 0]
    common_m_s, many = np.zeros(3), 0
    for i in range(len(commanded)):
        if commanded[i]:
            many += 1
            for k in range(3):
                common_m_s[k] += lack_m_s[i, k]
    common = _length(common_m_s[0], common_m_s[1], common_m_s[2]) / max(many, 1)
    blend, behind_m_s = 1.0 - np.exp(-dt_s / late_s), BEHIND_M_S + BEHIND_OF_ALL * common
    for i in range(len(commanded)):
        if not commanded[i] or not np.isfinite(allowed_m_s[i, 0]):
            behind_s[i] = 0.0
            for k in range(3):
                late_m_s[i, k] = laggard_m_s[i, k] = np.nan
            continue
        for k in range(3):
            if not np.isfinite(laggard_m_s[i, k]):
                late_m_s[i, k] = laggard_m_s[i, k] = velocity_m_s[i, k]
            late_m_s[i, k] += blend * (allowed_m_s[i, k] - late_m_s[i, k])
        left_m_s = _apart(i, late_m_s, laggard_m_s)
        share = min(1.0, ramp_m_s2[i] * dt_s / max(left_m_s, TINY))
        for k in range(3):
            laggard_m_s[i, k] += share * (late_m_s[i, k] - laggard_m_s[i, k])
        late_over_m_s = _apart(i, late_m_s, velocity_m_s) - (1.0 - share) * left_m_s
        over_m_s = _apart(i, allowed_m_s, velocity_m_s) - _apart(i, allowed_m_s, laggard_m_s)
        newly_over_m_s = _nearest(i, newly_m_s, velocity_m_s, int(late_s / SPACING_S) + 2)
        over_m_s = min(over_m_s, late_over_m_s, newly_over_m_s)
        behind_s[i] = _next(behind_s[i], over_m_s > behind_m_s, dt_s)
    return late_m_s, laggard_m_s, behind_s


@kernel
def _length(x: float, y: float, z: float) -> float:
    length: float = np.sqrt(x * x + y * y + z * z)
    return length


@kernel
def _apart(i: int, one: Array, other: Array) -> float:
    """Distance of the rows i of (n, 3) and (n, 3)."""
    return _length(one[i, 0] - other[i, 0], one[i, 1] - other[i, 1], one[i, 2] - other[i, 2])


@kernel
def _nearest(i: int, newly_m_s: Array, velocity_m_s: Array, count: int) -> float:
    """Distance of row i of (n, 3) from the nearest of the first `count` of row i of (n, k, 3)."""
    nearest_m2_s2, x, y, z = np.inf, velocity_m_s[i, 0], velocity_m_s[i, 1], velocity_m_s[i, 2]
    for at in range(min(count, newly_m_s.shape[1])):
        dx, dy, dz = newly_m_s[i, at, 0] - x, newly_m_s[i, at, 1] - y, newly_m_s[i, at, 2] - z
        if np.isfinite(newly_m_s[i, at, 0]):
            nearest_m2_s2 = min(nearest_m2_s2, dx * dx + dy * dy + dz * dz)
    nearest_m_s: float = np.sqrt(nearest_m2_s2)
    return nearest_m_s


@kernel
def _next(behind_s: float, is_behind: bool, dt_s: float) -> float:
    """The next `Answers.behind_s`."""
    if not is_behind:
        return behind_s - dt_s if behind_s >= COUNTS_S else 0.0
    longer_s = behind_s + dt_s
    return KEPT_S if longer_s >= COUNTS_S else longer_s
