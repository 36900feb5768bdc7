"""Selects path and time of each vehicle, one after the other, the earliest without conflict. Compiled."""

import numpy as np

from gcs.model.jit import kernel, kernel_apart
from gcs.model.state import Array, Mask
from gcs.planning.return_paths.paths import STEP_S
from gcs.safety.neighbours import Rows

NEARLY_M = 0.05
"""A pair that began at its kept distance may be closer by this much."""

BLOCK = 16
"""Steps for which the greatest speed of a planned path is known: slow pairs need few tests."""


@kernel_apart
def chosen_paths(
    order: Rows,
    place_m: Array,
    first: Rows,
    free: Mask,
    spared: Mask,
    kept_m: Array,
    numbers: tuple[float, float, float],
    counts: tuple[int, int, int, int],
    halted: Mask,
) -> tuple[Rows, Rows, Mask]:
    """Select for each vehicle the path that ends soonest without a conflict with those planned before.

    A vehicle without one is planned again after all others: it waits until the last that passes its start has
    passed. The filter moves it aside for them.

    Args:
        order: (n,) rows in the order of planning.
        place_m: (m, 3) the positions of all paths, scaled so that the minimum separation is a sphere.
        first: (k + 1,) index where each path begins; every vehicle has equally many.
        free: (k, w) which paths may be taken: the columns after so long a wait, the last also after longer.
        spared: (n,) vehicles whose starts the others pass only if there is no alternative.
        kept_m: (n, n) distance that each pair keeps, scaled.
        numbers: a pair closes no faster than it can stop within its gap, after this delay, s, and with this
            braking, m/s^2; and pairs that are both lower than this, scaled, m, do not count.
        counts: steps within which all must be down, those planned again, between two waits, and of a column.
        halted: (1,) set by another thread: the rest is left without paths.

    Returns: (n,) the path taken, -1 where none is free, (n,) the steps it waits before, and (n,) which were
        planned again.
    """
    n, each = len(order), len(free) // len(order)
    count, later = counts[:2]
    way, wait, again = np.full(n, -1, np.intp), np.zeros(n, np.intp), np.zeros(n, np.bool_)
    path_m = np.empty((n, later, 3))
    paces_m = np.zeros((n, 2 + later // BLOCK))
    for i in range(n):
        path_m[i] = place_m[first[i * each]]
    pace_m = _fastest(place_m, first)
    others, other_count = np.empty(n, np.intp), 0
    for turn in range(2):
        for i in order:
            if way[i] >= 0 or halted[0]:
                continue
            met = other_count
            for j in range(n):
                if turn == 0 and spared[j] and way[j] < 0 and j != i:
                    others[met] = j
                    met += 1
            limits = (0, count) if turn == 0 else (1, later)
            chosen, begins = _soonest(
                i,
                each,
                (place_m, pace_m),
                first,
                free,
                (path_m, paces_m),
                others[:met].copy(),
                kept_m,
                numbers,
                limits,
                counts[2:],
            )
            if chosen < 0 and met > other_count:
                chosen, begins = _soonest(
                    i,
                    each,
                    (place_m, pace_m),
                    first,
                    free,
                    (path_m, paces_m),
                    others[:other_count],
                    kept_m,
                    numbers,
                    limits,
                    counts[2:],
                )
            if chosen < 0:
                continue
            way[i], wait[i], again[i] = chosen, begins, turn > 0
            way_m = place_m[first[chosen] : first[chosen + 1]]
            path_m[i, begins : begins + len(way_m)] = way_m
            path_m[i, begins + len(way_m) :] = way_m[-1]
            _note_paces(path_m[i], paces_m[i])
            others[other_count] = i
            other_count += 1
    return way, wait, again


@kernel
def _fastest(place_m: Array, first: Rows) -> Array:
    """(k,) Longest step of each path, scaled."""
    pace_m = np.zeros(len(first) - 1)
    for k in range(len(pace_m)):
        for at in range(first[k], first[k + 1] - 1):
            pace_m[k] = max(pace_m[k], _apart_m(place_m[at], place_m[at + 1]))
    return pace_m


@kernel
def _note_paces(path_m: Array, paces_m: Array) -> None:
    """Write the longest step of each block of a path (t, 3), and of the whole path last."""
    paces_m[:] = 0.0
    for t in range(len(path_m) - 1):
        step_m = _apart_m(path_m[t], path_m[t + 1])
        paces_m[t // BLOCK] = max(paces_m[t // BLOCK], step_m)
        paces_m[-1] = max(paces_m[-1], step_m)


@kernel
def _apart_m(one_m: Array, other_m: Array) -> float:
    x, y, z = one_m[0] - other_m[0], one_m[1] - other_m[1], one_m[2] - other_m[2]
    apart_m: float = np.sqrt(x * x + y * y + z * z)
    return apart_m


@kernel
def _soonest(
    i: int,
    each: int,
    places: tuple[Array, Array],
    first: Rows,
    free: Mask,
    paths: tuple[Array, Array],
    others: Rows,
    kept_m: Array,
    numbers: tuple[float, float, float],
    limits: tuple[int, int],
    stride: tuple[int, int],
) -> tuple[int, int]:
    """Return the path of vehicle i that ends soonest, and the steps it waits before; -1: none is free.

    `places` and `paths` are positions and longest steps, of all candidates and of the others. `limits`: 1 if
    others may pass its start before it begins, and the steps within which it must be down. `stride`: steps
    between two waits, and of a column of `free`.
    """
    step, later_steps = stride
    place_m, pace_m = places
    path_m, paces_m = paths
    own, (waits, count) = i * each, limits
    earliest, latest, shortest = 0, count, count
    for j in others:
        if waits:
            until = _is_passed_until(place_m[first[own]], path_m[j], paces_m[j], kept_m[i, j], numbers)
            earliest = max(earliest, until)
        else:
            until = _stays_free(place_m[first[own]], path_m[j], paces_m[j], kept_m[i, j], latest, numbers)
            latest = min(latest, until)
    for k in range(own, own + each):
        shortest = min(shortest, first[k + 1] - first[k])
    blocker, blocked_at = np.full(each, -1, np.intp), np.zeros(each, np.intp)
    for end in range(shortest + earliest, count, step):
        for k in range(own, own + each):
            begins = end - (first[k + 1] - first[k])
            if begins < earliest or begins > latest:
                continue
            if not free[k, min(begins // later_steps, free.shape[1] - 1)]:
                continue
            way_m = place_m[first[k] : first[k + 1]]
            if _is_free(
                way_m, pace_m[k], begins, i, paths, others, kept_m, blocker, blocked_at, k - own, numbers
            ):
                return k, begins
    return -1, 0


AGAIN_STEPS = 12
"""A path that was blocked is first tested this many steps about where it was blocked before."""


@kernel
def _is_free(
    way_m: Array,
    pace_m: float,
    begins: int,
    i: int,
    paths: tuple[Array, Array],
    others: Rows,
    kept_m: Array,
    blocker: Rows,
    blocked_at: Rows,
    mine: int,
    numbers: tuple[float, float, float],
) -> bool:
    """Whether a path conflicts with none of the others; tests first where the last blocker was met."""
    path_m, paces_m = paths
    last, end = blocker[mine], len(way_m) - 1
    if last >= 0:
        near = max(blocked_at[mine] - AGAIN_STEPS, 0)
        until = min(blocked_at[mine] + AGAIN_STEPS, end)
        met = _meets(
            way_m, pace_m, begins, path_m[last], paces_m[last], kept_m[i, last], near, until, numbers
        )
        if met >= 0:
            blocked_at[mine] = met
            return False
    for k in range(len(others)):
        j = others[k]
        met = _meets(way_m, pace_m, begins, path_m[j], paces_m[j], kept_m[i, j], 0, end, numbers)
        if met >= 0:
            blocker[mine], blocked_at[mine] = j, met
            others[k], others[k // 2] = others[k // 2], j  # what blocks often is tested early
            return False
    return True


@kernel
def _is_passed_until(
    start_m: Array, other_m: Array, paces_m: Array, kept_m: float, numbers: tuple[float, float, float]
) -> int:
    """Return the steps until another has passed a vehicle that stays at its start, for the last time."""
    t, until = 0, 0
    while t < len(other_m) - 1:
        step = _step(start_m, start_m, 0.0, other_m, paces_m, t, kept_m, numbers)
        if step == 0:
            until = t + 1
        t += max(step, 1)
    return until


@kernel
def _stays_free(
    start_m: Array,
    other_m: Array,
    paces_m: Array,
    kept_m: float,
    until: int,
    numbers: tuple[float, float, float],
) -> int:
    """Return the steps that a vehicle may stay at its start until another comes, at most `until`."""
    t, last = 0, min(until, len(other_m) - 1)
    while t < last:
        step = _step(start_m, start_m, 0.0, other_m, paces_m, t, kept_m, numbers)
        if step == 0:
            return t
        t += step
    return until


@kernel
def _meets(
    way_m: Array,
    pace_m: float,
    begins: int,
    other_m: Array,
    paces_m: Array,
    kept_m: float,
    first: int,
    end: int,
    numbers: tuple[float, float, float],
) -> int:
    """Return the step from `first` to before `end` at which a path (k, 3) meets another; -1: none."""
    k = first
    while k < end:
        step = _step(way_m[k], way_m[k + 1], pace_m, other_m, paces_m, begins + k, kept_m, numbers)
        if step == 0:
            return k
        k += step
    return -1


@kernel
def _step(
    own_m: Array,
    own_next_m: Array,
    pace_m: float,
    other_m: Array,
    paces_m: Array,
    t: int,
    kept_m: float,
    numbers: tuple[float, float, float],
) -> int:
    """Return 0 if two are too close, or too fast for their distance; else the steps until the next test.

    No test is needed while they are farther apart than the fastest that they may be until then could close.
    """
    reaction_s, deceleration_m_s2, low_m = numbers
    distance_m = _apart_m(other_m[t], own_m)
    gap_m = distance_m - kept_m
    closing_m = pace_m + paces_m[-1]
    spare_m = gap_m - _needed_m(closing_m / STEP_S, reaction_s, deceleration_m_s2)
    if spare_m > 0.0:
        return 1 + int(min(spare_m / max(closing_m, 1e-6), LONG))
    closing_m = pace_m + paces_m[t // BLOCK]
    spare_m = gap_m - _needed_m(closing_m / STEP_S, reaction_s, deceleration_m_s2)
    if spare_m > 0.0:
        return min(1 + int(min(spare_m / max(closing_m, 1e-6), LONG)), BLOCK - t % BLOCK)
    closing_m_s = (distance_m - _apart_m(other_m[t + 1], own_next_m)) / STEP_S
    if gap_m >= 0.0 and closing_m_s <= 0.0:
        return 1
    if -own_m[2] < low_m and -other_m[t, 2] < low_m:
        return 1
    if gap_m < 0.0 and (closing_m_s > 0.0 or gap_m < -NEARLY_M):
        return 0
    needed_m = _needed_m(closing_m_s, reaction_s, deceleration_m_s2)
    return 0 if closing_m_s > 0.0 and needed_m > gap_m else 1


LONG = 1e6
"""Steps, more than any plan has."""


@kernel
def _needed_m(closing_m_s: float, reaction_s: float, deceleration_m_s2: float) -> float:
    """Distance within which two that close in stop."""
    return closing_m_s * reaction_s + closing_m_s**2 / (2.0 * deceleration_m_s2)
