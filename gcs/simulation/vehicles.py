"""The simulated vehicles, compiled, because they take most of a simulation's time.

`fitted` is `sim.vehicle.dynamics`, row by row; a test compares the two. `cascade` follows PX4's control
structure with PX4's default gains, so that nothing is tuned to the fitted model alone:

    u = P e + I - D v',   I' = i e                 velocity controller, sideways and up
    |u| <= g tan(tilt), |u + g| <= thrust          tilt and thrust limits; height goes first
    a' = (u - a) / lag,   |a'| <= jerk             attitude controller and rate limit (up: the motors)
    v' = a - drag (v - wind),   p' = v             the body in the air

Frame: show frame (as NED), metres, seconds.
"""

from dataclasses import asdict
from math import ceil
from typing import Final

import numpy as np

from gcs.model.jit import kernel
from gcs.model.state import Array, Mask
from gcs.sim.vehicle.dynamics import GRAVITY_M_S2, Response
from gcs.simulation.scenario import World

LIMITS: Final = ("acceleration_limit_m_s2", "vertical_acceleration_limit_m_s2", "jerk_m_s3")
"""Settings in which the vehicles do not differ."""

FITTED: Final[dict[str, float]] = asdict(Response())

CASCADE: Final = {
    "proportional_per_s": 1.8,  # MPC_XY_VEL_P_ACC
    "integral_per_s2": 0.4,  # MPC_XY_VEL_I_ACC
    "acceleration_limit_m_s2": GRAVITY_M_S2,  # MPC_TILTMAX_AIR 45 degrees
    "vertical_proportional_per_s": 4.0,  # MPC_Z_VEL_P_ACC
    "vertical_integral_per_s2": 2.0,  # MPC_Z_VEL_I_ACC
    "vertical_acceleration_limit_m_s2": 7.5,  # MPC_THR_MIN over MPC_THR_HOVER
    "lag_s": 0.15,  # 1 / MC_ROLL_P
    "delay_s": 0.03,
    "drag_per_s": 1.0,
    "damping": 0.2,  # MPC_XY_VEL_D_ACC
    "vertical_lag_s": 0.05,  # motors
    "jerk_m_s3": 37.0,  # MC_ROLLRATE_MAX 220 degrees/s
}

THRUST_MAX_M_S2: Final = 2.0 * GRAVITY_M_S2  # MPC_THR_HOVER 0.5

P_XY, I_XY, LIMIT_XY, P_Z, I_Z, LIMIT_Z, LAG, DELAY, DRAG, DAMPING, LAG_Z, JERK = range(len(CASCADE))
"""Columns of `Vehicles.settings`, in the order of CASCADE."""


class Vehicles:
    """True states of n vehicles, changed in place."""

    def __init__(self, start_m: Array, world: World, step_s: float, random: np.random.Generator) -> None:
        """All hover at `start_m` (n, 3): their integrators compensate the mean wind."""
        n = len(start_m)
        self.is_cascade = world.vehicle == "cascade"
        values = (CASCADE if self.is_cascade else FITTED) | {"drag_per_s": world.drag_per_s}
        self.settings = np.zeros((n, len(CASCADE)))  # (n, 12) of each vehicle
        for column, name in enumerate(values):
            spread = 0.0 if name in LIMITS else world.response_spread * random.uniform(-1.0, 1.0, n)
            self.settings[:, column] = values[name] * (1.0 + spread)
        if not self.is_cascade:
            self.settings[:, LAG_Z] = self.settings[:, LAG]
        self.step_s = step_s
        self._blend = _blends(self.settings[:, [LAG, LAG_Z]].copy(), step_s)
        self.position_m = np.array(start_m, dtype=np.float64)  # (n, 3)
        self.velocity_m_s = np.zeros((n, 3))  # over ground
        mean_m_s = np.array([world.wind.mean_x_m_s, world.wind.mean_y_m_s, 0.0])
        mean_m_s *= world.wind.rise_s == 0.0  # else calm at first
        self.acceleration_m_s2 = -self.settings[:, DRAG, None] * mean_m_s  # of thrust and tilt, without drag
        self.integral_m_s2 = self.acceleration_m_s2.copy()
        self._commands_m_s = np.zeros((ceil(self.settings[:, DELAY].max() / step_s - 1e-9) + 2, n, 3))
        self._newest = 0

    def step(self, command_m_s: Array, wind_m_s: Array, error_m_s: Array) -> Array:
        """Advance by `step_s`. Returns: a copy of the positions (n, 3).

        Args:
            command_m_s: (n, 3) velocity setpoints that reach the vehicles now.
            wind_m_s: (n, 3) velocity of the air over ground.
            error_m_s: (n, 3) of the vehicles' own velocity estimates.
        """
        self._newest = (self._newest + 1) % len(self._commands_m_s)
        self._commands_m_s[self._newest] = command_m_s
        _step(
            self.is_cascade,
            (self.position_m, self.velocity_m_s, self.acceleration_m_s2, self.integral_m_s2),
            (self._commands_m_s, wind_m_s, error_m_s),
            self._newest,
            self.settings,
            self._blend,
            self.step_s,
        )
        return self.position_m.copy()

    def rest(self, rows: Mask, place_m: Array) -> None:
        """Keep the vehicles of `rows` (n,) at rest, at `place_m` (n, 3)."""
        self.position_m[rows] = place_m[rows]
        for state in (self.velocity_m_s, self.acceleration_m_s2, self.integral_m_s2):
            state[rows] = 0.0


@kernel
def _step(
    is_cascade: bool,
    states: tuple[Array, Array, Array, Array],
    inputs: tuple[Array, Array, Array],
    newest: int,
    settings: Array,
    blend: Array,
    dt_s: float,
) -> None:
    """Advance positions, velocities, accelerations and integrators (n, 3) in place; `blend` as of `_turn`."""
    position_m, velocity_m_s, acceleration_m_s2, integral_m_s2 = states
    commands_m_s, wind_m_s, error_m_s = inputs
    kept = len(commands_m_s)
    e, u, gain, limit, gained = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(position_m)):
        own = settings[i]
        late = own[DELAY] / dt_s
        near = int(np.floor(late + 1e-9))
        share = max(late - near, 0.0)
        newer, older = (newest - near) % kept, (newest - near - 1) % kept
        for k in range(3):
            delayed_m_s = (1.0 - share) * commands_m_s[newer, i, k] + share * commands_m_s[older, i, k]
            e[k] = delayed_m_s - (velocity_m_s[i, k] + error_m_s[i, k])
            gain[k] = own[P_Z] if k == 2 else own[P_XY]
            gained[k] = dt_s * (own[I_Z] if k == 2 else own[I_XY]) * e[k]
            u[k] = gain[k] * e[k] + integral_m_s2[i, k]
            if is_cascade and k < 2:
                moving_m_s2 = acceleration_m_s2[i, k] - own[DRAG] * (velocity_m_s[i, k] - wind_m_s[i, k])
                u[k] -= own[DAMPING] * moving_m_s2
        level_m_s2 = np.hypot(u[0], u[1])
        limit[0], limit[2] = own[LIMIT_XY], own[LIMIT_Z]
        if is_cascade:
            if u[2] < 0.0:
                limit[2] = THRUST_MAX_M_S2 - GRAVITY_M_S2
            up_m_s2 = GRAVITY_M_S2 - min(max(u[2], -limit[2]), limit[2])
            limit[0] = min(limit[0], np.sqrt(max(THRUST_MAX_M_S2**2 - up_m_s2**2, 0.0)))
        limit[1] = limit[0]
        for k in range(3):
            size_m_s2 = abs(u[k]) if k == 2 else level_m_s2
            scale = min(1.0, limit[k] / max(size_m_s2, 1e-12))
            if not (scale < 1.0 and e[k] * u[k] > 0.0):
                integral_m_s2[i, k] += gained[k]
            u[k] *= scale
        _turn(is_cascade, acceleration_m_s2[i], u, blend[i], own[JERK] * dt_s)
        for k in range(3):
            before_m_s = velocity_m_s[i, k]
            airspeed_m_s = before_m_s - wind_m_s[i, k]
            velocity_m_s[i, k] = before_m_s + dt_s * (acceleration_m_s2[i, k] - own[DRAG] * airspeed_m_s)
            position_m[i, k] += dt_s * 0.5 * (before_m_s + velocity_m_s[i, k])


@kernel
def _blends(lag_s: Array, dt_s: float) -> Array:
    """(n, 2) shares of a change that are done after `dt_s`, by time constants (n, 2)."""
    return -np.expm1(-dt_s / lag_s)


@kernel
def _turn(
    is_cascade: bool, acceleration_m_s2: Array, desired_m_s2: Array, blend: Array, most_m_s2: float
) -> None:
    """Turn thrust (3,) towards the desired acceleration (3,), in place, by the shares `blend` (2,)."""
    x_m_s2 = blend[0] * (desired_m_s2[0] - acceleration_m_s2[0])
    y_m_s2 = blend[0] * (desired_m_s2[1] - acceleration_m_s2[1])
    if is_cascade:
        slower = min(1.0, most_m_s2 / max(np.hypot(x_m_s2, y_m_s2), 1e-12))
        x_m_s2, y_m_s2 = slower * x_m_s2, slower * y_m_s2
    acceleration_m_s2[0] += x_m_s2
    acceleration_m_s2[1] += y_m_s2
    acceleration_m_s2[2] += blend[1] * (desired_m_s2[2] - acceleration_m_s2[2])
