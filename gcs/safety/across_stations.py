"""Pairs of two stations' vehicles: how far each station may count on the other to give way.

Both stations project the velocities of both vehicles, from what their filters were given, and each sends its
own. Each may know something that keeps its vehicle from giving way, and that the other does not know: a
slower autopilot, late links, a passage. It shows in what its filter allowed at its last tick.
"""

import numpy as np

from gcs.model.jit import kernel
from gcs.model.state import Array, Mask
from gcs.safety.constraints import NO_ROW
from gcs.safety.neighbours import Rows
from gcs.safety.separation import Pairs

CHANGE_M_S = 0.3
"""By so much more another station's vehicle may give way than when it was reported: 3 m/s2 for 0.1 s."""


def with_reports(pairs: Pairs, own: Mask, shared_m_s: Array | None) -> Pairs:
    """These pairs, and own vehicles alone against those of other stations at their reported velocities.

    Args:
        pairs: k constraints of n vehicles.
        own: (n,) commanded by this station.
        shared_m_s: (n, 3) what other stations' filters allowed, NaN: of no vehicle that they share; None:
            of none.
    """
    if shared_m_s is None:
        return pairs
    columns = pairs.first, pairs.second, pairs.other, pairs.normal, pairs.bound_m_s
    return pairs.joined(Pairs(*_against_reports(*columns, own, shared_m_s)))


@kernel
def _against_reports(
    first: Rows, second: Rows, other: Rows, normal: Array, bound_m_s: Array, own: Mask, shared_m_s: Array
) -> tuple[Rows, Rows, Rows, Array, Array]:
    """The constraints that `with_reports` adds; the first arguments are those of `Pairs`."""
    mixed = np.empty(len(first), np.intp)
    count = 0
    for k in range(len(first)):
        mixed[count] = k
        count += own[first[k]] != own[other[k]] and second[k] != NO_ROW
    mine, reported = np.empty(count, np.intp), np.empty(count, np.intp)
    normals, bounds_m_s = np.empty((count, 3)), np.empty(count)
    for a in range(count):
        k = mixed[a]
        mine_first = own[first[k]]
        mine[a], reported[a] = (first[k], other[k]) if mine_first else (other[k], first[k])
        bounds_m_s[a] = bound_m_s[k] - CHANGE_M_S
        for axis in range(3):
            normals[a, axis] = normal[k, axis] if mine_first else -normal[k, axis]
            bounds_m_s[a] += normals[a, axis] * shared_m_s[reported[a], axis]
    return mine, np.full(count, NO_ROW), reported, normals, bounds_m_s
