"""Agreeing on a centre: what a round does by hand, and where many rounds lead."""

import numpy as np
import pytest

from gcs.formation.neighbours import Belief, NeighbourMessages, agree
from gcs.model.state import Array, Mask

DT_S = 0.05
RATE_PER_S = 0.1


def received_by(belief: Belief, receives: Mask) -> NeighbourMessages:
    """(n, n) True where the row receives the column: all_others a column, NaN where it is not received.

    Brought forward, as a receiver does with what was said a round ago.
    """
    n = len(receives)
    silent = np.where(receives, 0.0, np.nan)[:, :, None]
    degree = receives.sum(axis=1).astype(float)
    forward_m = belief.center_m + DT_S * belief.velocity_m_s
    center, velocity = (np.tile(part, (n, 1, 1)) + silent for part in (forward_m, belief.velocity_m_s))
    return NeighbourMessages(center, velocity, np.tile(degree, (n, 1)))


def ring(count: int) -> Mask:
    away = np.abs(np.arange(count)[:, None] - np.arange(count)) % count
    return np.isin(away, (1, 2, count - 1, count - 2))


def at(*x_m: float) -> Array:
    return np.array([[x, 0.0, 0.0] for x in x_m])


def test_round_uses_metropolis_weights_and_its_own_sighting() -> None:
    # in a row 0 - 1 - 2 the middle has two neighbours: every weight is 1/3
    receives = np.array([[False, True, False], [True, False, True], [False, True, False]])
    belief = Belief(at(0.0, 3.0, 9.0), np.zeros((3, 3)))
    blind = Belief.nothing(3)
    once = agree(belief, received_by(belief, receives), blind, DT_S, RATE_PER_S)
    assert once.center_m == pytest.approx(at(1.0, 4.0, 7.0))
    sighting = Belief(at(0.0, 13.0, 9.0), np.zeros((3, 3)))
    lean = 1.0 - np.exp(-RATE_PER_S * DT_S)
    leaning = agree(belief, received_by(belief, receives), sighting, DT_S, RATE_PER_S)
    assert leaning.center_m == pytest.approx(at(1.0, 4.0 + 10.0 * lean, 7.0))


def test_unknown_belief_takes_own_sighting_or_neighbour_mean() -> None:
    receives = np.array([[False, False, False], [True, False, False], [False, False, False]])
    nothing = np.full(3, np.nan)
    known = Belief(
        np.array([[4.0, 0.0, 0.0], nothing, nothing]), np.array([[1.0, 0.0, 0.0], nothing, nothing])
    )
    seen = Belief(np.array([nothing, nothing, [7.0, 0.0, 0.0]]), np.array([nothing, nothing, np.zeros(3)]))
    later = agree(known, received_by(known, receives), seen, DT_S, RATE_PER_S)
    assert later.center_m == pytest.approx(at(4.0 + DT_S, 4.0 + DT_S, 7.0))
    lonely = agree(
        Belief.nothing(1),
        received_by(Belief.nothing(1), ~np.ones((1, 1), bool)),
        Belief.nothing(1),
        DT_S,
        RATE_PER_S,
    )
    assert np.isnan(lonely.center_m).all()


def test_all_agree_on_the_mean_sighting_despite_lost_messages() -> None:
    random = np.random.default_rng(1)
    n = 20
    seen = Belief(random.normal(0.0, 1.0, (n, 3)), np.zeros((n, 3)))
    belief = seen
    for _ in range(2000):
        receives = ring(n) & (random.random((n, n)) >= 0.1)
        belief = agree(belief, received_by(belief, receives), seen, DT_S, RATE_PER_S)
    assert np.ptp(belief.center_m, axis=0).max() < 0.15 * np.ptp(seen.center_m, axis=0).max()
    assert belief.center_m.mean(axis=0) == pytest.approx(seen.center_m.mean(axis=0), abs=0.05)


def test_vehicles_with_sightings_lead_all_to_a_moving_centre() -> None:
    n, speed = 20, 1.0
    belief = Belief.nothing(n)
    unseen = np.where(np.arange(n) < 2, 0.0, np.nan)[:, None]
    for round_ in range(2400):
        seen = Belief(at(speed * DT_S * round_) + unseen, at(speed) + unseen)
        belief = agree(belief, received_by(belief, ring(n)), seen, DT_S, 5.0)
    assert belief.velocity_m_s == pytest.approx(np.tile(at(speed), (n, 1)), abs=1e-3)
    assert np.ptp(belief.center_m, axis=0).max() < 1e-3
