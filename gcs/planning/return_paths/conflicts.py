"""Selects path and time of each vehicle, one after the other, the earliest without conflict. Compiled."""

import numpy as np

from gcs.model.jit import kernel, kernel_apart
from gcs.model.state import Array, Mask
from gcs.planning.return_paths.paths import STEP_S
from gcs.safety.neighbours import Rows

NEARLY_M = 0.05
"""A pair that began at its kept distance may be closer by this much."""

FAR_M = 25.0
"""Beyond this distance no vehicle is met within a stop's time."""

STEP_MAX_M = 2.5
"""Upper bound on how much closer two vehicles come in one step."""


@kernel_apart
def chosen_paths(
    order: Rows,
    place_m: Array,
    first: Rows,
    free: Mask,
    spared: Mask,
    kept_m: Array,
    reaction_s: float,
    deceleration_m_s2: float,
    low_m: float,
    count: int,
) -> tuple[Rows, Rows]:
    """Select for each vehicle the path that ends soonest without a conflict with those planned before.

    Args:
        order: (n,) rows in the order of planning.
        place_m: (m, 3) the positions of all paths, scaled so that the minimum separation is a sphere.
        first: (k + 1,) index where each path begins; every vehicle has equally many.
        free: (k,) which paths may be taken.
        spared: (n,) vehicles whose starts the others pass only if there is no alternative.
        kept_m: (n, n) distance that each pair keeps, scaled.
        reaction_s: a pair closes no faster than it can stop within its gap, after this delay
        deceleration_m_s2: and with this braking.
        low_m: pairs that are both lower, scaled, do not count.
        count: steps within which all must be down.

    Returns: (n,) the path taken, -1 where none is free, and (n,) the steps it waits before.
    """
    n, each = len(order), len(free) // len(order)
    way, wait = np.full(n, -1, np.intp), np.zeros(n, np.intp)
    path_m = np.empty((n, count, 3))
    for i in range(n):
        path_m[i] = place_m[first[i * each]]
    numbers = reaction_s, deceleration_m_s2, low_m
    others, known = np.empty(n, np.intp), 0
    for i in order:
        met = known
        for j in range(n):
            if spared[j] and way[j] < 0 and j != i:
                others[met] = j
                met += 1
        found, begins = _soonest(i, each, place_m, first, free, path_m, others[:met], kept_m, numbers)
        if found < 0 and met > known:
            found, begins = _soonest(i, each, place_m, first, free, path_m, others[:known], kept_m, numbers)
        if found < 0:
            continue
        way[i], wait[i] = found, begins
        way_m = place_m[first[found] : first[found + 1]]
        path_m[i, begins : begins + len(way_m)] = way_m
        path_m[i, begins + len(way_m) :] = way_m[-1]
        others[known] = i
        known += 1
    return way, wait


@kernel
def _soonest(
    i: int,
    each: int,
    place_m: Array,
    first: Rows,
    free: Mask,
    path_m: Array,
    others: Rows,
    kept_m: Array,
    numbers: tuple[float, float, float],
) -> tuple[int, int]:
    """Return the path of vehicle i that ends soonest, and the steps it waits before; -1: none is free."""
    own, count = i * each, path_m.shape[1]
    latest, shortest = count, count
    for j in others:
        latest = min(latest, _stays_free(place_m[first[own]], path_m[j], kept_m[i, j], latest, numbers))
    for k in range(own, own + each):
        shortest = min(shortest, first[k + 1] - first[k])
    blocker = np.full(each, -1, np.intp)
    for end in range(shortest, count):
        for k in range(own, own + each):
            begins = end - (first[k + 1] - first[k])
            if begins < 0 or begins > latest or not free[k]:
                continue
            way_m = place_m[first[k] : first[k + 1]]
            if _is_free(way_m, begins, i, path_m, others, kept_m, blocker, k - own, numbers):
                return k, begins
    return -1, 0


@kernel
def _is_free(
    way_m: Array,
    begins: int,
    i: int,
    path_m: Array,
    others: Rows,
    kept_m: Array,
    blocker: Rows,
    mine: int,
    numbers: tuple[float, float, float],
) -> bool:
    """Whether a path conflicts with none of the others; tests the last blocker first."""
    last = blocker[mine]
    if last >= 0 and _meets(way_m, begins, path_m[last], kept_m[i, last], numbers):
        return False
    for j in others:
        if j != last and _meets(way_m, begins, path_m[j], kept_m[i, j], numbers):
            blocker[mine] = j
            return False
    return True


@kernel
def _stays_free(
    start_m: Array, other_m: Array, kept_m: float, until: int, numbers: tuple[float, float, float]
) -> int:
    """Return the steps that a vehicle may stay at its start until another comes, at most `until`."""
    t, last = 0, min(until, len(other_m) - 1)
    while t < last:
        step = _step(start_m, start_m, other_m[t], other_m[t + 1], kept_m, numbers)
        if step == 0:
            return t
        t += step
    return until


@kernel
def _meets(
    way_m: Array, begins: int, other_m: Array, kept_m: float, numbers: tuple[float, float, float]
) -> bool:
    """Whether a path (k, 3) begun after `begins` steps conflicts with another's path (t, 3)."""
    k = 0
    while k < len(way_m) - 1:
        t = begins + k
        step = _step(way_m[k], way_m[k + 1], other_m[t], other_m[t + 1], kept_m, numbers)
        if step == 0:
            return True
        k += step
    return False


@kernel
def _step(
    own_m: Array,
    own_next_m: Array,
    other_m: Array,
    other_next_m: Array,
    kept_m: float,
    numbers: tuple[float, float, float],
) -> int:
    """Return 0 if two are too close, or too fast for their distance; else the steps until the next test."""
    reaction_s, deceleration_m_s2, low_m = numbers
    if -own_m[2] < low_m and -other_m[2] < low_m:
        return 1
    before2, after2 = 0.0, 0.0
    for axis in range(3):
        before2 += (other_m[axis] - own_m[axis]) ** 2
        after2 += (other_next_m[axis] - own_next_m[axis]) ** 2
    if before2 > FAR_M * FAR_M:
        return 1 + int((np.sqrt(before2) - FAR_M) / STEP_MAX_M)
    distance_m = np.sqrt(before2)
    gap_m = distance_m - kept_m
    if gap_m >= 0.0 and after2 >= before2:
        return 1
    closing_m_s = (distance_m - np.sqrt(after2)) / STEP_S
    if gap_m < 0.0 and (closing_m_s > 0.0 or gap_m < -NEARLY_M):
        return 0
    needed_m = closing_m_s * reaction_s + closing_m_s**2 / (2.0 * deceleration_m_s2)
    return 0 if closing_m_s > 0.0 and needed_m > gap_m else 1
