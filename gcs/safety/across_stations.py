"""Pairs of two stations' vehicles: how far each station may count on the other to give way.

Both stations project the velocities of both vehicles, from what their filters were given, and each sends its
own. Each may know something that keeps its vehicle from giving way, and that the other does not know: a
slower autopilot, late links, a passage. It shows in what its filter allowed at its last tick.
"""

import numpy as np

from gcs.model.state import Array, Mask
from gcs.safety.constraints import NO_ROW
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
    mine_first = own[pairs.first]
    mixed = np.flatnonzero((mine_first != own[pairs.other]) & (pairs.second != NO_ROW))
    mine_first, first, other = mine_first[mixed], pairs.first[mixed], pairs.other[mixed]
    mine, theirs = np.where(mine_first, first, other), np.where(mine_first, other, first)
    normal = np.where(mine_first[:, None], pairs.normal[mixed], -pairs.normal[mixed])
    reported_m_s = (normal * shared_m_s[theirs]).sum(axis=1)
    bound_m_s = pairs.bound_m_s[mixed] + reported_m_s - CHANGE_M_S
    return pairs.joined(Pairs(mine, np.full(len(mine), NO_ROW), theirs, normal, bound_m_s))
