"""Pairs on the level of which one stops by itself, or both: with HOLD, as the fake autopilot flies it."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.model.state import Array, Mask
from gcs.safety.filter import filter_velocities
from gcs.sim.vehicle.dynamics import PointMasses, Response
from tests.properties.test_passing_on_slopes import PAIRS, STEPS, TOGETHER_M, pairs_that_meet, to_goals
from tests.support.safety_fleets import OPEN, SAFETY, TICK_S, around

SECONDS = 14.0
STEP_S = TICK_S / STEPS

BRAKES_M_S2, PLACE_PER_S = 3.0, 0.95
"""MPC_ACC_HOR and MPC_XY_P, as delivered."""


class Holding:
    """The velocity setpoints of HOLD, of n vehicles: to where each stops with MPC_ACC_HOR."""

    def __init__(self, count: int) -> None:
        self._place_m, self._last_m_s = np.full((count, 3), np.nan), np.zeros((count, 3))

    def setpoints_m_s(self, holds: Mask, bodies: PointMasses) -> Array:
        """(n, 3) for the rows of `holds` (n,)."""
        here_m, velocity_m_s = bodies.position_m, bodies.velocity_m_s
        begins = holds & np.isnan(self._place_m[:, 0])
        stop_s = np.linalg.norm(velocity_m_s, axis=1, keepdims=True) / (2.0 * BRAKES_M_S2)
        self._place_m[begins] = (here_m + stop_s * velocity_m_s)[begins]
        self._last_m_s[begins] = velocity_m_s[begins]
        change_m_s = PLACE_PER_S * (self._place_m - here_m) - self._last_m_s
        most_m_s = BRAKES_M_S2 * STEP_S
        self._last_m_s[holds] += np.clip(change_m_s, -most_m_s, most_m_s)[holds]
        return self._last_m_s


def on_the_level(random: np.random.Generator) -> tuple[Array, Array]:
    """Starts and goals (2 PAIRS, 3), any courses; row i meets i + PAIRS 5.5 s from both."""
    start_m, goal_m = pairs_that_meet(random)
    middle_m, turn_rad = (start_m + goal_m) / 2.0, random.uniform(-np.pi, np.pi, 2 * PAIRS)
    way = np.stack([np.cos(turn_rad), np.sin(turn_rad), np.zeros(2 * PAIRS)], axis=1)
    half_m = 5.5 * to_goals(np.zeros_like(way), 1e3 * way)
    half_m[:, 2] = 0.0
    return middle_m - half_m, middle_m + half_m


def nearest_m(seed: int, response: Response, which: str, *, seen_after_s: float = 0.0) -> Array:
    """(k,) the least distances of pairs that meet, in the floor's metric.

    The station knows at most `seen_after_s` after a vehicle stopped that it does not command it.
    """
    random = np.random.default_rng(seed)
    start_m, goal_m = on_the_level(random)
    bodies, holding = PointMasses(start_m, STEP_S, response), Holding(2 * PAIRS)
    stop_s, second_s = random.uniform(3.0, 10.0, (2, PAIRS))
    stops_s = np.append(stop_s, {"one": np.full(PAIRS, np.inf), "both": second_s, "at once": stop_s}[which])
    seen_s = stops_s + random.uniform(0.0, seen_after_s, 2 * PAIRS)
    apart_m = np.full(PAIRS, np.inf)
    for tick in range(round(SECONDS / TICK_S)):
        obeys, commanded = tick * TICK_S < stops_s, tick * TICK_S < seen_s
        here = around(bodies.position_m, commanded=commanded)
        here = replace(here, velocity_m_s=bodies.velocity_m_s, goes=commanded)
        allowed_m_s, _ = filter_velocities(to_goals(bodies.position_m, goal_m), here, OPEN)
        for _ in range(STEPS):
            held_m_s = holding.setpoints_m_s(~obeys, bodies)
            bodies.step(np.where(obeys[:, None], allowed_m_s, held_m_s))
        off_m = (bodies.position_m[:PAIRS] - bodies.position_m[PAIRS:]) * SAFETY.floor.scale
        apart_m = np.minimum(apart_m, np.linalg.norm(off_m, axis=1))
    begin_m = np.linalg.norm((start_m[:PAIRS] - start_m[PAIRS:]) * SAFETY.floor.scale, axis=1)
    return np.asarray(apart_m[begin_m > TOGETHER_M])


REAL = Response(drag_per_s=0.2)
"""Of real quadrotors; `Response()` has the drag of PX4's own simulator."""


@pytest.mark.parametrize(
    ("seed", "response"),
    [
        (2, REAL),
        *(
            pytest.param(seed, each, marks=pytest.mark.soak)
            for seed in range(6)
            for each in (REAL, Response())
        ),
    ],
)
def test_when_one_of_two_stops_the_floor_is_kept(seed: int, response: Response) -> None:
    """The one behind had followed the other too near: 3 of 413 pairs came inside, at worst 1.5 m."""
    apart_m = nearest_m(seed, response, "one")
    assert np.count_nonzero(apart_m < 2.5 * SAFETY.floor.horizontal_m) > 20
    assert apart_m.min() >= SAFETY.floor.horizontal_m


@pytest.mark.soak
@pytest.mark.parametrize("which", ["both", "at once"])
@pytest.mark.parametrize("response", [REAL, Response()], ids=["real", "simulator"])
def test_when_both_stop_hardly_a_pair_comes_inside(response: Response, which: str) -> None:
    """They had come to 0.5 m: in 14 s each lost its link, and one of 100 pairs met at that moment."""
    apart_m = np.concatenate([nearest_m(seed, response, which) for seed in range(6)])
    assert len(apart_m) > 700
    assert np.mean(apart_m < SAFETY.floor.horizontal_m) <= 0.005
    assert apart_m.min() >= 0.75 * SAFETY.floor.horizontal_m


@pytest.mark.soak
@pytest.mark.parametrize("response", [REAL, Response()], ids=["real", "simulator"])
def test_a_stop_that_is_seen_a_second_late_is_braked_for(response: Response) -> None:
    """Modes arrive once a second: by then the one in front has slowed down, and its velocity shows it."""
    late = [nearest_m(seed, response, "one", seen_after_s=1.0) for seed in range(6)]
    apart_m = np.concatenate(late)
    assert np.mean(apart_m < SAFETY.floor.horizontal_m) <= 0.005
    assert apart_m.min() >= 0.75 * SAFETY.floor.horizontal_m
