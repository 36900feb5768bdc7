"""Half-spaces of velocities, ``normal . (v_i - v_j) >= bound``, and the nearest velocities that keep them."""

from dataclasses import dataclass
from functools import cache, lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.model.errors import ShapeError
from gcs.model.jit import kernel, kernel_within
from gcs.model.response import FleetResponse
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import Array, Mask
from gcs.safety.neighbours import Rows

NO_ROW = -1
"""In place of j: the constraint concerns vehicle i alone."""


NEARLY_M_S = 1e-6
"""A constraint broken by less than this does not take part; a row changed by less counts as at rest."""

TOLERANCE_M_S = 1e-3
"""Violation that the projection may leave before rows are shortened."""

SETTLED_M_S = 1e-4
"""The sweeps end when none of them changes a velocity by more."""

ROUGHLY_M_S = 0.03
"""As SETTLED_M_S, while constraints still become active: they need not wait for the last digits."""

FIRST_SWEEPS, SWEEPS = 10, 100
"""Most plain sweeps over the active constraints, before those that are over-relaxed, and after them if these
did not settle. Shortening resolves what they leave.
"""

RELAXATION = 1.5
"""Factor of each push in over-relaxed sweeps. Below 2 they converge to the same point (projected SOR,
Mangasarian 1977), and sooner: in a crowd that crosses with a third of the visits.
"""

RELAXED_SWEEPS, RELAXED_VISITS = 300, 100_000
"""Most of these sweeps in a round, and of their visits of constraints."""

ROUNDS = 8
"""Most rounds in which constraints broken by the sweeps become active, or settle finely."""

SHRINKS = 60
"""Most shortenings by the required factors; after that, rows that still approach come to rest."""

VISITS = 1_000_000
"""Most visits of constraints, by all plain sweeps and by shortening, beyond `FEWEST` of each: a tick must end
in time even with contradictions.
"""

FEWEST = 4
"""Least number of sweeps in a round, and of shortenings."""


@dataclass(frozen=True, slots=True, eq=False)
class Constraints:
    """k half-spaces over the velocities of n vehicles. Owns its arrays."""

    first: np.ndarray[tuple[int], np.dtype[np.intp]]  # (k,) row i
    second: np.ndarray[tuple[int], np.dtype[np.intp]]  # (k,) row j, or NO_ROW
    normal: Array  # (k, 3)
    bound_m_s: Array  # (k,)
    reason: NDArray[np.object_]  # (k,) in words, for the operator; an array, because there may be thousands

    def __post_init__(self) -> None:
        k = len(self.reason)
        shapes = (self.first.shape, self.second.shape, self.normal.shape, self.bound_m_s.shape)
        if shapes != ((k,), (k,), (k, 3), (k,)):
            raise ShapeError(f"constraints: {shapes} for {k} of them")

    def __len__(self) -> int:
        return len(self.reason)

    def slack_m_s(self, velocity_m_s: Array) -> Array:
        """(k,) distance of each constraint from being broken by velocities (n, 3); negative: broken."""
        relative = velocity_m_s[self.first] - np.where(
            (self.second == NO_ROW)[:, None], 0.0, velocity_m_s[self.second]
        )
        slack: Array = (self.normal * relative).sum(axis=1) - self.bound_m_s
        return slack

    @staticmethod
    @cache
    def none() -> "Constraints":
        no_rows = np.zeros(0, dtype=np.intp)
        return Constraints(no_rows, no_rows, np.zeros((0, 3)), np.zeros(0), no_rows.astype(object))

    @staticmethod
    def joined(*parts: "Constraints") -> "Constraints":
        parts = tuple(part for part in parts if len(part) > 0)
        if len(parts) < 2:
            return parts[0] if parts else Constraints.none()
        return Constraints(
            np.concatenate([part.first for part in parts]),
            np.concatenate([part.second for part in parts]),
            np.concatenate([part.normal for part in parts]),
            np.concatenate([part.bound_m_s for part in parts]),
            np.concatenate([part.reason for part in parts]),
        )


class Braking(Settings):
    """A vehicle's ability to stop, from the recorded response (docs/decisions/filter.md)."""

    reaction_s: Positive = 0.8
    """Delay and build-up of the response, as if nothing happened meanwhile, in s."""
    lead_s: NotNegative = 0.6
    """Between vehicles, the measured closing speed continues for this time, in s."""
    deceleration_m_s2: Positive = 2.0
    """After that, on the average of the stop, in m/s^2."""
    follow_s: NotNegative = 2.0
    """Behind a vehicle that is not commanded, the speed that both share counts for so long, in s: it may
    stop. Not in a formation.
    """
    escape_rate_per_s: Positive = 1.5
    """Speed away from something already too close, per metre, in 1/s."""

    def over_link(self, delay_s: float) -> "Braking":
        """The same when telemetry and setpoints each take `delay_s`: the reaction begins a round trip later.

        Escaping is also a loop through the link; its time constant grows by two round trips, so that it does
        not oscillate.
        """
        return self if delay_s == 0.0 else _over_link(self, delay_s)

    def of_each(self, count: int, response: FleetResponse | None = None) -> Array:
        """(4, n) the reaction, lead, deceleration and escape rate of `count` vehicles, see REACTION.

        A vehicle whose autopilot swings longer, or brakes more gently, is given that. None: all as these
        settings are.
        """
        numbers = self.reaction_s, self.lead_s, self.deceleration_m_s2, self.escape_rate_per_s
        return _of_each(*numbers, count, response).copy()

    def of_slowest(self, response: FleetResponse) -> "Braking":
        """What holds for every one of these vehicles."""
        each = self.of_each(len(response), response)
        return self.model_copy(
            update={
                "reaction_s": float(each[REACTION].max(initial=self.reaction_s)),
                "deceleration_m_s2": float(each[DECELERATION].min(initial=self.deceleration_m_s2)),
            }
        )

    def speed_m_s(self, gap_m: Array) -> Array:
        """Fastest approach from which a vehicle stops within `gap_m` (any shape).

        Solves ``v t + v^2 / (2 a) = gap``. Negative for a negative gap: moving away is then required.
        """
        return stopping_speed_m_s(gap_m, self.of_each(1)[:, 0])


@lru_cache(maxsize=16)
def _over_link(braking: Braking, delay_s: float) -> Braking:
    """As `Braking.over_link`; kept for the next tick."""
    return Braking(
        reaction_s=braking.reaction_s + 2.0 * delay_s,
        lead_s=braking.lead_s + 2.0 * delay_s,
        follow_s=braking.follow_s + 2.0 * delay_s if braking.follow_s else 0.0,
        deceleration_m_s2=braking.deceleration_m_s2,
        escape_rate_per_s=1.0 / (1.0 / braking.escape_rate_per_s + 4.0 * delay_s),
    )


@lru_cache(maxsize=16)
def _of_each(
    reaction_s: float,
    lead_s: float,
    deceleration_m_s2: float,
    escape_rate_per_s: float,
    count: int,
    response: FleetResponse | None,
) -> Array:
    """As `Braking.of_each`; kept, because a tick asks several times, and so does the next."""
    each = np.empty((4, count))
    each[REACTION], each[LEAD] = reaction_s, lead_s
    each[DECELERATION], each[ESCAPE] = deceleration_m_s2, escape_rate_per_s
    if response is not None:
        np.maximum(each[REACTION], response.swings_s, out=each[REACTION])
        np.minimum(each[DECELERATION], response.acceleration_m_s2, out=each[DECELERATION])
    return each


REACTION, LEAD, DECELERATION, ESCAPE = range(4)
"""Rows of `Braking.of_each`."""


def stopping_speed_m_s(gap_m: Array, each: Array) -> Array:
    """(k,) as `Braking.speed_m_s`, for gaps (k,) of vehicles that stop as `each` (4, k) says."""
    a, t = each[DECELERATION], each[REACTION]
    stop: Array = a * (np.sqrt(t * t + 2.0 * np.maximum(gap_m, 0.0) / a) - t)
    return np.where(gap_m < 0.0, each[ESCAPE] * gap_m, stop)


@kernel
def allowed_speed_m_s(
    gap_m: float, reaction_s: float, deceleration_m_s2: float, escape_rate_per_s: float
) -> float:
    """As `Braking.speed_m_s`, for one gap."""
    if gap_m < 0.0:
        return escape_rate_per_s * gap_m
    stop_s: float = np.sqrt(reaction_s * reaction_s + 2.0 * gap_m / deceleration_m_s2)
    return deceleration_m_s2 * (stop_s - reaction_s)


@kernel_within
def along_m_s(velocity_m_s: Array, i: int, normal: Array, k: int) -> float:
    """Speed of row i along normal k."""
    speed_m_s: float = (
        normal[k, 0] * velocity_m_s[i, 0]
        + normal[k, 1] * velocity_m_s[i, 1]
        + normal[k, 2] * velocity_m_s[i, 2]
    )
    return speed_m_s


@kernel_within
def slack_m_s(velocity_m_s: Array, i: int, j: int, normal: Array, bound_m_s: Array, k: int) -> float:
    """Distance of constraint k, of rows i and j (or NO_ROW), from being broken; negative: broken."""
    other_m_s = along_m_s(velocity_m_s, j, normal, k) if j != NO_ROW else 0.0  # first: see `kernel_within`
    slack: float = along_m_s(velocity_m_s, i, normal, k) - bound_m_s[k] - other_m_s
    return slack


@kernel
def nearest(desired_m_s: Array, first: Rows, second: Rows, normal: Array, bound_m_s: Array) -> Array:
    """Change the velocities as little as possible (least squares) so that all constraints hold.

    Hildreth's method, forwards and backwards in turn, and over-relaxed if that settles sooner: the nearest
    point is unique, so the order of the constraints does not matter. Only constraints that are or were broken
    take part; they are contiguous in memory. Most rows come to rest within a few sweeps, where only few
    constraints touch each other; a sweep skips constraints of rows at rest, because they would not change.

    Args:
        desired_m_s: (n, 3), finite.
        first: (k,) rows.
        second: (k,) rows or NO_ROW.
        normal: (k, 3).
        bound_m_s: (k,).

    Returns: (n, 3) in m/s. Constraints may still be broken slightly, or where they contradict each other:
        see `shortened`.
    """
    velocity_m_s = desired_m_s.copy()
    taken = np.zeros(len(first), np.bool_)
    row, other = np.empty(len(first), np.intp), np.empty(len(first), np.intp)
    along, least_m_s, force_m_s = np.empty((len(first), 3)), np.empty(len(first)), np.zeros(len(first))
    moved_in = np.zeros(len(desired_m_s), np.int64)
    many, sweep, left, settled_m_s = 0, 0, VISITS, SETTLED_M_S
    for _ in range(ROUNDS):
        before = many
        for k in range(len(first)):
            i, j = first[k], second[k]
            if taken[k] or slack_m_s(velocity_m_s, i, j, normal, bound_m_s, k) >= -NEARLY_M_S:
                continue
            taken[k] = True
            row[many], other[many], along[many], least_m_s[many] = i, j, normal[k], bound_m_s[k]
            many += 1
            moved_in[i] = sweep
            if j != NO_ROW:
                moved_in[j] = sweep
        if many == before and settled_m_s == SETTLED_M_S:
            break
        settled_m_s = ROUGHLY_M_S if many > before else SETTLED_M_S
        in_hand = row[:many], other[:many], along[:many], least_m_s[:many]
        state = velocity_m_s, force_m_s, moved_in
        sweep, left = _settle(state, sweep, in_hand, settled_m_s, left)
    return velocity_m_s


InHand: TypeAlias = tuple[Rows, Rows, Array, Array]
"""Rows (k,), rows or NO_ROW (k,), normals (k, 3) and bounds (k,)."""

Swept: TypeAlias = tuple[Array, Array, NDArray[np.int64]]
"""Velocities (n, 3), the push of each constraint (k,), the last sweep that moved each row (n,); changed."""


@kernel
def _settle(swept: Swept, sweep: int, in_hand: InHand, settled_m_s: float, left: int) -> tuple[int, int]:
    """Sweep until no velocity changes by `settled_m_s`; the other arguments are those of `_sweep`.

    Returns: the last sweep, and how many visits of constraints are `left`.
    """
    many = len(in_hand[0])
    for _ in range(FIRST_SWEEPS):
        sweep, left = sweep + 1, left - many
        if _sweep(swept, sweep, in_hand, 1.0) < settled_m_s:
            return sweep, left
    last = _relaxed(swept, sweep, in_hand, settled_m_s)
    if last > sweep:
        return last, left
    for _ in range(min(SWEEPS, max(FEWEST, left // many))):
        sweep, left = sweep + 1, left - many
        if _sweep(swept, sweep, in_hand, 1.0) < settled_m_s:
            break
    return sweep, left


@kernel
def _relaxed(swept: Swept, sweep: int, in_hand: InHand, settled_m_s: float) -> int:
    """Continue with over-relaxed sweeps, and keep their result if they settle. Returns: the last sweep kept.

    Contradictory constraints never settle, and over-relaxed velocities are then far off. The arguments are
    those of `_settle`.
    """
    velocity_m_s, force_m_s, moved_in = swept
    faster, last = (velocity_m_s.copy(), force_m_s.copy(), moved_in.copy()), sweep
    for _ in range(min(RELAXED_SWEEPS, RELAXED_VISITS // len(in_hand[0]))):
        last += 1
        if _sweep(faster, last, in_hand, RELAXATION) < settled_m_s:
            velocity_m_s[:], force_m_s[:], moved_in[:] = faster
            return last
    return sweep


@kernel
def _sweep(swept: Swept, sweep: int, in_hand: InHand, relaxation: float) -> float:
    """Push the rows of every constraint in turn, in place, until it just holds or is not needed.

    Args:
        swept: what the sweeps before left; changed.
        sweep: the number of this one; every other plain one goes backwards.
        in_hand: the active constraints.
        relaxation: factor of each push; 1.0: a plain sweep.

    Returns: the largest change of a velocity.
    """
    (velocity_m_s, force_m_s, moved_in), (row, other, normal, bound_m_s) = swept, in_hand
    largest_m_s = 0.0
    for place in range(len(row)):
        k = place if sweep % 2 == 1 or relaxation > 1.0 else len(row) - 1 - place
        i, j = row[k], other[k]
        if moved_in[i] < sweep - 1 and (j == NO_ROW or moved_in[j] < sweep - 1):
            continue
        x, y, z = normal[k, 0], normal[k, 1], normal[k, 2]
        lack_m_s = bound_m_s[k] - (x * velocity_m_s[i, 0] + y * velocity_m_s[i, 1] + z * velocity_m_s[i, 2])
        if j != NO_ROW:
            lack_m_s += x * velocity_m_s[j, 0] + y * velocity_m_s[j, 1] + z * velocity_m_s[j, 2]
            lack_m_s *= 0.5
        push_m_s = max(relaxation * lack_m_s, -force_m_s[k])
        if push_m_s == 0.0:
            continue
        force_m_s[k] += push_m_s
        _add(velocity_m_s, i, push_m_s * x, push_m_s * y, push_m_s * z)
        if j != NO_ROW:
            _add(velocity_m_s, j, -push_m_s * x, -push_m_s * y, -push_m_s * z)
        if abs(push_m_s) > NEARLY_M_S:
            moved_in[i] = sweep
            if j != NO_ROW:
                moved_in[j] = sweep
        largest_m_s = max(largest_m_s, abs(push_m_s))
    return largest_m_s


@kernel_within
def _add(velocity_m_s: Array, i: int, x_m_s: float, y_m_s: float, z_m_s: float) -> None:
    velocity_m_s[i, 0] += x_m_s
    velocity_m_s[i, 1] += y_m_s
    velocity_m_s[i, 2] += z_m_s


@kernel
def any_broken(velocity_m_s: Array, first: Rows, second: Rows, normal: Array, bound_m_s: Array) -> bool:
    """Whether velocities (n, 3) break one of the constraints (k,)."""
    for k in range(len(first)):
        if slack_m_s(velocity_m_s, first[k], second[k], normal, bound_m_s, k) < -TOLERANCE_M_S:
            return True
    return False


@kernel
def shortened(
    velocity_m_s: Array,
    first: Rows,
    second: Rows,
    normal: Array,
    bound_m_s: Array,
    descending: Mask,
) -> Array:
    """Scale rows (n, 3) down until every constraint holds that rest itself satisfies.

    Where rest is not enough (something else closes in), the velocity found by the projection is kept: it
    moves away. The constraints are those of `nearest`. Of rows that are `descending` (n,) walls shorten only
    the level part where the upright one does not approach them: they do not stop a descent.
    """
    shorter_m_s = velocity_m_s.copy()
    broken = True
    tries, most = 0, min(SHRINKS, max(FEWEST, VISITS // max(len(first), 1)))
    while broken:
        broken = False
        factor, level = np.ones(len(velocity_m_s)), np.ones(len(velocity_m_s))
        for k in range(len(first)):
            if bound_m_s[k] > 0.0:
                continue
            i, j = first[k], second[k]
            if not slack_m_s(shorter_m_s, i, j, normal, bound_m_s, k) < -TOLERANCE_M_S:
                continue
            broken = True
            approach_m_s = -along_m_s(shorter_m_s, i, normal, k)
            other_m_s = along_m_s(shorter_m_s, j, normal, k) if j != NO_ROW else 0.0
            is_level = descending[i] and j == NO_ROW and normal[k, 2] * shorter_m_s[i, 2] >= 0.0
            _demand(level if is_level else factor, i, j, approach_m_s, other_m_s, -bound_m_s[k])
        if tries >= most:
            factor, level = np.floor(factor), np.floor(level)
        tries += 1
        for i in range(len(factor)):
            if factor[i] < 1.0:
                shorter_m_s[i] *= factor[i]
            if level[i] < 1.0:
                shorter_m_s[i, :2] *= level[i]
    return shorter_m_s


@kernel_within
def _demand(factor: Array, i: int, j: int, approach_m_s: float, other_m_s: float, allowed_m_s: float) -> None:
    """Lower the factors of rows i and j, in place, so that the sum of their approaches is allowed."""
    if approach_m_s > 0.0 and other_m_s > 0.0:
        both = allowed_m_s / (approach_m_s + other_m_s)
        factor[i], factor[j] = min(factor[i], both), min(factor[j], both)
    elif approach_m_s > 0.0:
        factor[i] = min(factor[i], (allowed_m_s - other_m_s) / approach_m_s)
    else:
        factor[j] = min(factor[j], (allowed_m_s - approach_m_s) / other_m_s)


@kernel
def tightest(velocity_m_s: Array, first: Rows, second: Rows, normal: Array, bound_m_s: Array) -> Rows:
    """(n,) for each row the constraint that velocities (n, 3) break most, or come nearest to breaking.

    NO_ROW for a row without constraints.
    """
    least_m_s, which = np.full(len(velocity_m_s), np.inf), np.full(len(velocity_m_s), NO_ROW)
    for k in range(len(first)):
        i, j = first[k], second[k]
        slack = slack_m_s(velocity_m_s, i, j, normal, bound_m_s, k)
        if slack < least_m_s[i]:
            least_m_s[i], which[i] = slack, k
        if j != NO_ROW and slack < least_m_s[j]:
            least_m_s[j], which[j] = slack, k
    return which


def true_bound(slope: Array, scaled_gap_m: Array, each: Array) -> tuple[Array, Array]:
    """Unit normals (k, 3) and bounds (k,) in true metres a second.

    `slope` (k, 3) is the gradient of the scaled distance; the gap in true metres along it is the scaled
    gap divided by its length. `each` (4, k) is that of `Braking.of_each`.
    """
    length = np.linalg.norm(slope, axis=1)
    return slope / length[:, None], -stopping_speed_m_s(scaled_gap_m / length, each)
