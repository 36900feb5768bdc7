"""A drone among its neighbours: what is out of range does not count, and an even shape is at rest."""

import numpy as np
import pytest

from gcs.formation.law import LawSettings
from gcs.formation.neighbours import (
    Belief,
    NeighboursSettings,
    Sight,
    neighbours_velocity,
    range_m,
    sight_of,
    step_aside,
)
from gcs.formation.repulsion import energy, nearest_m
from gcs.model.state import Array

LAW = LawSettings()
WITHOUT_MOMENTUM = NeighboursSettings(momentum_max_m_s=0.0)
RADIUS_M = 10.0
ORIGIN = np.zeros(3)


def all_others(position_m: Array) -> Array:
    """(n, n - 1, 3) inboxes in which all_others is."""
    n = len(position_m)
    rows = np.array([[j for j in range(n) if j != i] for i in range(n)])
    inbox_m: Array = position_m[rows]
    return inbox_m


def aside_of(position_m: Array, range_m: float, center_m: Array = ORIGIN) -> Array:
    inbox_m = all_others(position_m)
    center = np.tile(center_m, (len(position_m), 1))
    return step_aside(position_m, center, inbox_m, np.ones(inbox_m.shape[:2]), range_m)


def velocity_of(position_m: Array, sight: Sight, belief: Belief | None = None) -> Array:
    return neighbours_velocity(
        position_m,
        np.zeros_like(position_m),
        sight,
        belief or Belief.describe(ORIGIN, ORIGIN, len(position_m)),
        radius_m=RADIUS_M,
        dt_s=0.05,
        speed_max_m_s=LAW.speed_m_s,
        settings=WITHOUT_MOMENTUM,
    )[0]


def random_directions(count: int, seed: int) -> Array:
    direction = np.random.default_rng(seed).normal(size=(count, 3))
    return np.asarray(direction / np.linalg.norm(direction, axis=1, keepdims=True))


def test_two_vehicles_step_apart_by_newtons_method() -> None:
    # 90 degrees apart, chord sqrt(2), range 2: share 1/2, window 1/2; the push along the tangent is
    # (1/2) / 2^1.5, the stiffness (1/4 + 1/2) / 2^1.5: a step of 2/3, and the other one the other way
    aside = aside_of(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), 2.0)
    assert aside == pytest.approx(np.array([[0.0, -2 / 3, 0.0], [-2 / 3, 0.0, 0.0]]))


def test_step_is_tangential_and_equal_on_any_sphere() -> None:
    direction = random_directions(12, 1)
    aside = aside_of(direction, 1.2)
    assert (aside * direction).sum(axis=1) == pytest.approx(np.zeros(12), abs=1e-12)
    assert aside_of(7.0 * direction + 3.0, 7.0 * 1.2, np.full(3, 3.0)) == pytest.approx(aside)


def test_out_of_range_unknown_or_coincident_is_no_neighbour() -> None:
    place = np.array([[1.0, 0.0, 0.0]])
    inbox = np.array([[[-1.0, 0.0, 0.0], [np.nan, 0.0, 0.0], [1.0, 0.0, 0.0]]])
    assert not step_aside(place, np.zeros((1, 3)), inbox, np.ones((1, 3)), 1.9).any()


def test_a_neighbour_counts_less_and_less_up_to_the_range() -> None:
    place = np.array([[1.0, 0.0, 0.0]])
    near, charge = [0.0, 1.0, 0.0], np.ones((1, 2))
    edge = [[0.0, -np.sin(a), np.cos(a)] for a in (0.1, 0.2)]
    range_m = float(np.linalg.norm(np.array(edge[0]) - place[0])) + 1e-6
    only = step_aside(place, np.zeros((1, 3)), np.array([[near, [np.nan] * 3]]), charge, 2.0)
    assert only[0, 1] < 0.0
    alone = step_aside(place, np.zeros((1, 3)), np.array([[edge[0], edge[1]]]), charge, range_m)
    assert np.linalg.norm(alone) < 1e-5  # both all but at the edge


@pytest.mark.parametrize("count", [20, 50])
def test_a_dozen_neighbours_are_as_even_as_all(count: int) -> None:
    least = {20: 150.881568, 50: 1055.182315}[count]
    range_m = 2.0 * np.sqrt(12 / (count - 1))
    place = random_directions(count, 3)
    for _ in range(400):
        place = place + 0.4 * np.clip(aside_of(place, range_m), -0.2, 0.2)
        place = place / np.linalg.norm(place, axis=1, keepdims=True)
    assert energy(place) / least < 1.0005
    assert nearest_m(place) > 0.95 * 3.1 / np.sqrt(count)


def test_velocity_is_the_step_at_the_law_rate_within_its_bound() -> None:
    place = RADIUS_M * np.array([[1.0, 0.0, 0.0], [np.cos(3.0), np.sin(3.0), 0.0]])
    sight = Sight(all_others(place), np.ones((2, 1)), 2.0 * RADIUS_M, None)
    aside = aside_of(place, 2.0 * RADIUS_M)
    desired = LAW.neighbours.spreading_rate_per_s * RADIUS_M * aside
    assert velocity_of(place, sight) == pytest.approx(desired, abs=1e-9)
    close = RADIUS_M * np.array([[1.0, 0.0, 0.0], [np.cos(0.7), np.sin(0.7), 0.0]])
    sight = Sight(all_others(close), np.ones((2, 1)), 2.0 * RADIUS_M, None)
    assert np.linalg.norm(velocity_of(close, sight), axis=1) == pytest.approx(LAW.speed_m_s)


def test_each_flies_about_its_believed_centre_or_rests() -> None:
    place = np.array([[12.0, 0.0, 0.0], [10.0, 5.0, 0.0]])
    alone = np.full((2, 1, 3), np.nan)
    belief = Belief(np.array([[2.0, 0.0, 0.0], [np.nan] * 3]), np.array([[0.5, 0.0, 0.0], [np.nan] * 3]))
    velocity = velocity_of(place, Sight(alone, np.ones((2, 1)), 5.0, belief), belief)
    assert velocity == pytest.approx(np.zeros((2, 3)))  # the first is on its own sphere


def test_row_depends_only_on_the_inbox_of_its_vehicle() -> None:
    place = RADIUS_M * random_directions(6, 4)
    whole = velocity_of(place, Sight(all_others(place), np.ones((6, 5)), 15.0, None))
    rows = np.array([False, True, False, False, True, False])
    part = velocity_of(place[rows], Sight(all_others(place), np.ones((6, 5)), 15.0, None).only(rows))
    assert part == pytest.approx(whole[rows])


def test_whole_law_uses_only_vehicles_within_the_range() -> None:
    """Vehicles outside the range change neither the inbox, nor the belief, nor the velocity of a vehicle."""
    random = np.random.default_rng(7)
    place = RADIUS_M * random_directions(30, 5)
    reach_m = range_m(6, 30, RADIUS_M)
    belief = Belief(random.normal(size=(30, 3)), random.normal(size=(30, 3)))
    row = 11
    near = np.linalg.norm(place - place[row], axis=1) < reach_m
    # Metropolis weights count the neighbours' neighbours, so those stay where they are.
    far = np.linalg.norm(place - place[row], axis=1) > 2.0 * reach_m
    assert near.sum() > 3
    assert far.sum() > 3
    moved = place.copy()
    moved[far] += random.normal(size=(int(far.sum()), 3))
    moved[far] = np.where(
        np.linalg.norm(moved[far] - place[row], axis=1)[:, None] > 2.0 * reach_m, moved[far], place[far]
    )

    def known(position_m: Array, charge: Array, own: Belief) -> tuple[Array, Array]:
        sight = sight_of(
            position_m, charge, own, Belief.nothing(30), range_m=reach_m, dt_s=0.05, sighting_rate_per_s=5.0
        )
        assert sight.belief is not None
        return velocity_of(position_m, sight, sight.belief)[row], sight.belief.center_m[row]

    other = Belief(np.where(far[:, None], 99.0, belief.center_m), belief.velocity_m_s)
    here = known(place, np.ones(30), belief)
    there = known(moved, np.where(far, 9.0, 1.0), other)
    assert all(np.array_equal(one, two) for one, two in zip(here, there, strict=True))
