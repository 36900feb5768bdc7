"""Shares of what a link may read, by sender, where more has arrived. Compiled; no I/O."""

import numpy as np

from gcs.mavlink.kernels import Whole
from gcs.model.jit import kernel
from gcs.model.state import Mask


@kernel
def fair_shares(source: Whole, cost: Whole, vehicles_at: Whole, budget: float) -> tuple[Mask, np.int64]:
    """What may be read of what arrived, when not all of it may: max-min fair by sender, the newest first.

    An address counts as often as vehicles are known there; all unknown addresses together count as one.

    Args:
        source: (m,) of each piece, in order of arrival; at least one.
        cost: (m,) above 0.
        vehicles_at: (n,) the source of each vehicle.
        budget: the sum of what may be read.

    Returns: (m,) which pieces; the source that lost most.
    """
    count = len(source)
    order = np.argsort(source)
    sender, senders = np.empty(count, np.int64), np.empty(count, np.int64)
    sender_count = 0
    for at in range(count):
        if at == 0 or source[order[at]] != source[order[at - 1]]:
            senders[sender_count] = source[order[at]]
            sender_count += 1
        sender[order[at]] = sender_count - 1
    need, weight, lost = np.zeros(sender_count), np.zeros(sender_count), np.zeros(sender_count)
    for at in range(count):
        need[sender[at]] += cost[at]
    strangers = 0
    for number in range(sender_count):
        weight[number] = np.sum(vehicles_at == senders[number])
        strangers += weight[number] == 0
    for number in range(sender_count):
        if weight[number] == 0:
            weight[number] = 1.0 / strangers
    share, weights = np.zeros(sender_count), weight.sum()
    for number in np.argsort(need / weight):  # those that need least leave the rest to the others
        share[number] = min(need[number], budget * weight[number] / weights)
        budget -= share[number]
        weights -= weight[number]
    fits = np.ones(count, np.bool_)
    for at in range(count - 1, -1, -1):
        number = sender[at]
        if share[number] >= cost[at]:
            share[number] -= cost[at]
        else:
            share[number] = -1.0  # nothing older either
            fits[at] = False
            lost[number] += cost[at]
    return fits, senders[np.argmax(lost)]
