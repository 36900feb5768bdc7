"""Shares of a budget: what a sender needs, up to its share; the rest goes to those that need more."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gcs.links.fair_shares import fair_shares

ROUTER, VEHICLE, STRANGER, OTHER = 1, 2, 3, 4
VEHICLES_AT = np.array([ROUTER, ROUTER, ROUTER, VEHICLE, -1])


def passed(source: list[int], cost: list[int], budget: float) -> tuple[list[bool], int]:
    fits, heaviest = fair_shares(np.array(source), np.array(cost), VEHICLES_AT, budget)
    return fits.tolist(), int(heaviest)


def test_a_flood_gets_what_the_others_leave_the_newest_first() -> None:
    source = [STRANGER, STRANGER, VEHICLE, STRANGER, STRANGER]
    assert passed(source, [10] * 5, 30.0) == ([False, False, True, True, True], STRANGER)


def test_an_address_counts_as_often_as_vehicles_are_known_there() -> None:
    source = [ROUTER] * 8 + [VEHICLE] * 8
    fits, _ = passed(source, [1] * 16, 8.0)
    assert (sum(fits[:8]), sum(fits[8:])) == (6, 2)


def test_all_unknown_addresses_together_count_as_one_vehicle() -> None:
    source = [STRANGER, OTHER, VEHICLE] * 8
    fits, _ = passed(source, [1] * 24, 8.0)
    assert [sum(fits[sender::3]) for sender in range(3)] == [2, 2, 4]


@given(
    st.lists(st.tuples(st.integers(1, 6), st.integers(1, 50)), min_size=1, max_size=40), st.integers(0, 400)
)
def test_no_share_is_exceeded_and_small_needs_are_met(pieces: list[tuple[int, int]], budget: int) -> None:
    source, cost = (np.array(column) for column in zip(*pieces, strict=True))
    fits, heaviest = fair_shares(source, cost, VEHICLES_AT, float(budget))
    assert cost[fits].sum() <= budget
    senders, weight = np.unique(source), {ROUTER: 3.0, VEHICLE: 1.0}
    strangers = sum(sender not in weight for sender in senders.tolist())
    weights = sum(weight.get(sender, 1.0 / strangers if strangers else 0.0) for sender in senders.tolist())
    for sender in senders.tolist():
        need, its = cost[source == sender].sum(), weight.get(sender, 1.0 / max(strangers, 1))
        if need <= budget * its / weights * (1.0 - 1e-9):
            assert fits[source == sender].all()
        kept = np.flatnonzero(source == sender)[fits[source == sender]]
        assert kept.tolist() == np.flatnonzero(source == sender)[-len(kept) or len(source) :].tolist()
    if not fits.all():
        lost = {sender: cost[(source == sender) & ~fits].sum() for sender in senders.tolist()}
        assert lost[int(heaviest)] == max(lost.values())
