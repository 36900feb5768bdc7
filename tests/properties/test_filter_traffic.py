"""Who meets whom, against ways flown in many small steps."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import event, given
from hypothesis import strategies as st

from gcs.model.state import Array, Mask
from gcs.safety.meetings import FAR_S, SOON_S, count_meetings
from gcs.safety.traffic import give_way, keep_right, turn_early
from tests.support.law_fleets import masks, places, vectors, within
from tests.support.safety_fleets import CALM, SAFETY

PASSING_M = SAFETY.traffic.passing_m
SHARES = np.linspace(0.0, 1.0, 4001)[:, None]


def durations(count: int) -> st.SearchStrategy[Array]:
    return st.lists(within(0.0, 20.0), min_size=count, max_size=count).map(np.array)


def nearest(place_m: Array, course_m_s: Array, i: int, j: int, lasts_s: float) -> tuple[float, float]:
    """How near they come to each other on their ways, and when; infinite where they part at once."""
    away_m, relative_m_s = place_m[j] - place_m[i], course_m_s[j] - course_m_s[i]
    if away_m @ relative_m_s >= 0.0:
        return np.inf, 0.0
    distance_m = np.linalg.norm(away_m + SHARES * lasts_s * relative_m_s, axis=1)
    return float(distance_m.min()), float(SHARES[distance_m.argmin(), 0] * lasts_s)


def meetings(position: Array, course: Array, lasts: Array, turned: Mask, takes_part: Mask) -> Array:
    """(n,) what is to be counted."""
    expected = np.zeros(len(position))
    for i, j in permutations(range(len(position)), 2):
        if takes_part[i] and takes_part[j] and (turned[i] or turned[j]):
            near_m, when_s = nearest(position, course, i, j, min(lasts[i], lasts[j]))
            soon = np.clip((FAR_S - when_s) / (FAR_S - SOON_S), 0.0, 1.0)
            expected[i] += soon * max(0.0, 1.0 - (near_m / PASSING_M) ** 2)
    return expected


@CALM
@given(places(4), vectors(4, 5.0), durations(4), masks(4), masks(4))
def test_encounter_weight_grows_as_straight_paths_come_nearer(
    spread: Array, course: Array, lasts: Array, turned: Mask, takes_part: Mask
) -> None:
    position = spread * (0.5, 0.5, 0.5)
    turned = turned & takes_part
    expected = meetings(position, course, lasts, turned, takes_part)
    found = count_meetings(np.flatnonzero(takes_part), turned, position, course, lasts, PASSING_M)
    event(f"meetings: {expected.any()}")
    assert np.allclose(found, expected, atol=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_in_a_crowd_every_crossing_pair_is_an_encounter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    position, course = rng.uniform(-8.0, 8.0, (20, 3)), rng.normal(0.0, 1.0, (20, 3))
    lasts, takes_part = rng.uniform(0.0, 10.0, 20), rng.random(20) < 0.8
    turned = takes_part & (rng.random(20) < 0.4)
    expected = meetings(position, course, lasts, turned, takes_part)
    assert np.count_nonzero(expected) > 5
    found = count_meetings(np.flatnonzero(takes_part), turned, position, course, lasts, PASSING_M)
    assert np.allclose(found, expected, atol=1e-3)


@CALM
@given(places(4), vectors(4, 5.0), places(4), masks(4))
def test_keeping_right_turns_within_its_angle_and_never_left(
    position: Array, desired: Array, goal: Array, to_goal: Mask
) -> None:
    way = (goal - position) * (1.0, 1.0, 0.0)
    desired = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9) * 3.0  # level, to the goal
    all_vehicles = np.ones(4, dtype=bool)
    turned = keep_right(
        desired,
        position,
        np.zeros((4, 3)),
        goal,
        to_goal=to_goal,
        commanded=all_vehicles,
        airborne=all_vehicles,
        flatness=2.0 / 3.0,
        settings=SAFETY.traffic,
    )
    assert np.allclose(np.linalg.norm(turned, axis=1), np.linalg.norm(desired, axis=1))
    assert turned[~to_goal].tolist() == desired[~to_goal].tolist()
    right = np.stack([-desired[:, 1], desired[:, 0]], axis=1)
    sideways, ahead = (turned[:, :2] * right).sum(axis=1), (turned * desired).sum(axis=1)
    assert (sideways >= -1e-9).all()
    assert (ahead >= 9.0 * np.cos(np.radians(SAFETY.traffic.angle_max_deg)) * (way.any(axis=1)) - 1e-9).all()


@CALM
@given(places(5), places(5), masks(5), st.permutations(range(5)))
def test_turning_early_keeps_speed_and_angle_and_ignores_order(
    position: Array, goal: Array, to_goal: Mask, order: list[int]
) -> None:
    flatness, traffic = 2.0 / 3.0, SAFETY.traffic
    way = goal - position
    desired = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9) * 0.5
    turned = turn_early(desired, position, goal, to_goal=to_goal, flatness=flatness, settings=traffic)
    event(f"turned: {(turned != desired).any()}")
    assert turned[~to_goal].tolist() == desired[~to_goal].tolist()
    assert np.allclose(np.linalg.norm(turned, axis=1), np.linalg.norm(desired, axis=1))
    least = 0.25 * np.cos(np.radians(traffic.angle_max_deg)) * way.any(axis=1)
    assert ((turned * desired).sum(axis=1) >= least - 1e-9).all()
    other = turn_early(
        desired[order],
        position[order],
        goal[order],
        to_goal=to_goal[order],
        flatness=flatness,
        settings=traffic,
    )
    assert np.allclose(other, turned[order], atol=1e-3)  # the root of what single precision leaves


@CALM
@given(places(5), vectors(5, 5.0), places(5), masks(5), st.permutations(range(5)))
def test_giving_way_never_closes_faster_and_ignores_order(
    position: Array, desired: Array, goal: Array, to_goal: Mask, order: list[int]
) -> None:
    flatness, traffic = 2.0 / 3.0, SAFETY.traffic
    given_m_s = give_way(desired, position, goal, to_goal=to_goal, flatness=flatness, settings=traffic)
    assert given_m_s[~to_goal].tolist() == desired[~to_goal].tolist()
    changed = np.flatnonzero((given_m_s != desired).any(axis=1))
    for i in changed.tolist():  # it gives up some of its approach to one, and nothing besides
        step = given_m_s[i] - desired[i]
        away = position[i] - position
        cosine = (away @ step) / np.maximum(np.linalg.norm(away, axis=1) * np.linalg.norm(step), 1e-12)
        assert cosine.max() > 0.999
    other = give_way(
        desired[order],
        position[order],
        goal[order],
        to_goal=to_goal[order],
        flatness=flatness,
        settings=traffic,
    )
    scale = (1.0, 1.0, flatness)
    given_up_m_s = np.linalg.norm((given_m_s - desired) * scale, axis=1)[order]
    assert np.allclose(np.linalg.norm((other - desired[order]) * scale, axis=1), given_up_m_s, atol=1e-6)
