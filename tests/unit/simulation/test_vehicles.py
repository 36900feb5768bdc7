"""Both simulated vehicles respond as the recorded PX4; the fitted one is the fake fleet's, compiled."""

import gzip
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from scipy.optimize import least_squares

from gcs.model.state import Array
from gcs.sim.vehicle.dynamics import GRAVITY_M_S2, PointMasses, Response
from gcs.simulation.scenario import Wind, World
from gcs.simulation.vehicles import CASCADE, Vehicles

PX4_DATA = Path(__file__).parents[2] / "data" / "px4"
DT_S = 0.01

Model = Literal["fitted", "cascade"]


def vehicles(
    model: Model, count: int, *, spread: float = 0.0, seed: int = 1, wind_m_s: float = 0.0
) -> Vehicles:
    world = World(vehicle=model, response_spread=spread, wind=Wind(mean_x_m_s=wind_m_s))
    return Vehicles(np.zeros((count, 3)), world, DT_S, np.random.default_rng(seed))


def still(count: int) -> Array:
    return np.zeros((count, 3))


def recorded_step(name: str, axis: int) -> tuple[Array, Array]:
    """Time and velocity along the stepped axis."""
    with gzip.open(PX4_DATA / f"step_{name}.csv.gz", "rt") as file:
        table = np.loadtxt(file, delimiter=",", skiprows=1)
    return table[:, 0], table[:, 4 + axis]


def answer(model: Model, start_m_s: float, size_m_s: float, tried: Array, time_s: Array, axis: int) -> Array:
    """(k, len(time_s)): responses to a step, for k candidates of first edge, last edge, integrator."""
    count = len(tried)
    bodies = vehicles(model, count)
    bodies.velocity_m_s[:, axis] = start_m_s
    bodies.integral_m_s2[:, axis] = bodies.acceleration_m_s2[:, axis] = tried[:, 2]
    grid_s = np.arange(0.0, time_s[-1] + DT_S, DT_S)
    velocity = np.empty((count, len(grid_s)))
    for index, now_s in enumerate(grid_s):
        velocity[:, index] = bodies.velocity_m_s[:, axis]
        since_s, left_s = now_s + DT_S - tried[:, 0], now_s + DT_S - tried[:, 1]
        command = still(count)
        command[:, axis] = size_m_s * (np.clip(since_s, 0, DT_S) - np.clip(left_s, 0, DT_S)) / DT_S
        bodies.step(command, still(count), still(count))
    return np.array([np.interp(time_s, grid_s, row) for row in velocity])


@pytest.mark.alternates(0)
@pytest.mark.parametrize("model", ["fitted", "cascade"])
@pytest.mark.parametrize(
    ("name", "axis", "size_m_s", "edges_s"),
    [
        ("vx1", 0, 1.0, (2.97, 7.9)),
        ("vx5", 0, 5.0, (2.97, 10.85)),
        ("vx10", 0, 10.0, (2.97, 12.95)),
        ("vy5", 1, 5.0, (2.97, 10.85)),
        ("vx-5", 0, -5.0, (2.97, 10.85)),
    ],
)
def test_velocity_step_response_within_0_25_m_s_rms(
    model: Model, name: str, axis: int, size_m_s: float, edges_s: tuple[float, float]
) -> None:
    time_s, velocity = recorded_step(name, axis)

    def error(x: Array) -> Array:
        fitted = answer(model, velocity[0], size_m_s, x[np.newaxis], time_s, axis)[0]
        difference: Array = fitted - velocity
        return difference

    def jacobian(x: Array) -> Array:
        nudge = np.array([0.01, 0.01, 0.05])
        rows = answer(model, velocity[0], size_m_s, np.vstack([x, x + np.diag(nudge)]), time_s, axis)
        slope: Array = ((rows[1:] - rows[0]) / nudge[:, np.newaxis]).T
        return slope

    fit = least_squares(error, np.array([*edges_s, 0.0]), jac=jacobian, xtol=1e-4, ftol=1e-4, max_nfev=12)
    assert float(np.sqrt(np.mean(fit.fun**2))) < 0.25
    assert fit.x[0] == pytest.approx(edges_s[0], abs=0.15)  # the fit may not buy its rms with a shifted edge
    assert fit.x[1] == pytest.approx(edges_s[1], abs=0.15)


def test_the_fitted_vehicle_is_the_fake_fleets() -> None:
    random = np.random.default_rng(3)
    bodies = vehicles("fitted", 6, wind_m_s=3.0)
    wind = np.tile([3.0, 0.0, 0.0], (6, 1))
    state = PointMasses(still(6), DT_S, Response())
    state.acceleration_m_s2 = state.integral_m_s2 = bodies.acceleration_m_s2.copy()
    for index in range(400):
        if index % 40 == 0:
            command = random.uniform(-12.0, 12.0, (6, 3))
        error = random.normal(0.0, 0.1, (6, 3))
        state.step(command, wind_m_s=wind, velocity_error_m_s=error)
        bodies.step(command, wind, error)
    assert bodies.position_m == pytest.approx(state.position_m, abs=1e-9)
    assert bodies.velocity_m_s == pytest.approx(state.velocity_m_s, abs=1e-9)


def test_the_cascade_keeps_its_limits_of_tilt_thrust_and_jerk() -> None:
    random = np.random.default_rng(5)
    bodies = vehicles("cascade", 20, seed=6)
    before = bodies.acceleration_m_s2.copy()
    for index in range(600):
        if index % 60 == 0:
            command = random.uniform(-12.0, 12.0, (20, 3))
        bodies.step(command, still(20), still(20))
        level = np.linalg.norm(bodies.acceleration_m_s2[:, :2], axis=1)
        assert level.max() <= GRAVITY_M_S2 + 1e-6  # 45 degrees
        thrust = np.hypot(level, GRAVITY_M_S2 - bodies.acceleration_m_s2[:, 2])
        assert thrust.max() <= 2.1 * GRAVITY_M_S2  # sideways and up lag differently
        jerk = np.linalg.norm((bodies.acceleration_m_s2 - before)[:, :2], axis=1) / DT_S
        assert jerk.max() <= CASCADE["jerk_m_s3"] + 1e-6
        before = bodies.acceleration_m_s2.copy()


@pytest.mark.parametrize("model", ["fitted", "cascade"])
def test_a_vehicle_in_steady_wind_hovers_in_place(model: Model) -> None:
    bodies = vehicles(model, 4, spread=0.2, wind_m_s=5.0)
    wind = np.tile([5.0, 0.0, 0.0], (4, 1))
    for _ in range(300):
        bodies.step(still(4), wind, still(4))
    assert np.abs(bodies.position_m).max() < 1e-6
