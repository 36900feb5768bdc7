"""Pairs that pass on slopes, each axis at its limit, with vehicles that answer as PX4 does."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.formation.law import LawSettings, goal_velocity
from gcs.model.state import Array
from gcs.safety.filter import filter_velocities
from gcs.sim.vehicle.dynamics import PointMasses, Response
from tests.support.safety_fleets import LIMITS, OPEN, SAFETY, TICK_S, around

LAW, PAIRS, STEPS, SECONDS = LawSettings(), 150, 3, 14.0

APART_M = 200.0
"""Of the places where the pairs meet."""

TOGETHER_M = 5.0
"""A pair that begins nearer flies side by side, and does not meet."""

SLOWER = Response(proportional_per_s=0.8 * 1.8, vertical_proportional_per_s=0.8 * 6.0, delay_s=0.12)
"""The recorded answer, 20 % slower and later."""


def to_goals(position_m: Array, goal_m: Array) -> Array:
    return goal_velocity(position_m, goal_m, settings=LAW, limits_m_s=LIMITS.each_m_s)


def pairs_that_meet(random: np.random.Generator) -> tuple[Array, Array]:
    """Starts and goals (2 PAIRS, 3) on slopes of up to 80 degrees; row i meets i + PAIRS 5.5 s from both."""
    middle_m = np.arange(PAIRS)[:, None] * (APART_M, 0.0, 0.0) - (0.0, 0.0, 100.0)
    middle_m = np.tile(middle_m, (2, 1)) + random.uniform(-1.5, 1.5, (2 * PAIRS, 3))
    turn_rad = random.uniform(-np.pi, np.pi, 2 * PAIRS)
    slope_rad = np.radians(random.uniform(-80.0, 80.0, 2 * PAIRS))
    way = np.stack([np.cos(turn_rad), np.sin(turn_rad), -np.tan(slope_rad)], axis=1)
    half_m = 5.5 * to_goals(np.zeros_like(way), 1e3 * way)
    return middle_m - half_m, middle_m + half_m


@pytest.mark.parametrize(
    "response",
    [
        Response(),
        pytest.param(Response(drag_per_s=0.2), marks=pytest.mark.soak),
        pytest.param(SLOWER, marks=pytest.mark.soak),
    ],
    ids=["px4", "little drag", "slower"],
)
def test_pairs_on_slopes_keep_the_floor_when_either_stops(response: Response) -> None:
    random = np.random.default_rng(48)
    start_m, goal_m = pairs_that_meet(random)
    bodies = PointMasses(start_m, TICK_S / STEPS, response)
    stop_s = np.full(2 * PAIRS, np.inf)
    stop_s[:PAIRS] = random.uniform(
        3.0, 10.0, PAIRS
    )  # by its autopilot, at any moment; some are past by then
    apart_m, fastest_m_s = np.full(PAIRS, np.inf), np.zeros(3)
    for tick in range(round(SECONDS / TICK_S)):
        commanded = tick * TICK_S < stop_s
        here = replace(around(bodies.position_m, commanded=commanded), velocity_m_s=bodies.velocity_m_s)
        allowed_m_s, _ = filter_velocities(to_goals(bodies.position_m, goal_m), here, OPEN)
        for _ in range(STEPS):
            bodies.step(allowed_m_s)
        off_m = (bodies.position_m[:PAIRS] - bodies.position_m[PAIRS:]) * SAFETY.floor.scale
        apart_m = np.minimum(apart_m, np.linalg.norm(off_m, axis=1))
        x_m_s, y_m_s, z_m_s = bodies.velocity_m_s.T
        each_m_s = np.hypot(x_m_s, y_m_s).max(), -z_m_s.min(), z_m_s.max()
        fastest_m_s = np.maximum(fastest_m_s, each_m_s)
    meets = np.linalg.norm((start_m[:PAIRS] - start_m[PAIRS:]) * SAFETY.floor.scale, axis=1) > TOGETHER_M
    assert (fastest_m_s > 0.9 * np.array([LAW.speed_m_s, LIMITS.up_m_s, LIMITS.down_m_s])).all()
    assert np.count_nonzero(apart_m[meets] < 2.0 * SAFETY.floor.horizontal_m) > 20
    assert apart_m[meets].min() >= SAFETY.floor.horizontal_m
