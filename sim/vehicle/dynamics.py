"""Point masses behind an autopilot's velocity loop, vectorised over the fleet. Pure: no clock, no I/O.

Each vehicle responds to a velocity command as PX4 v1.16 was measured to (FACTS, section 3). Per axis, with
the error e between the delayed command and the measured velocity:

    u = proportional e + I,   I' = integral e,   |u| < limit       the autopilot's controller
    a' = (u - a) / lag                                             attitude and thrust
    v' = a - drag (v - wind),   p' = v                             the body in the air

The horizontal limit bounds the length of the vector, as a tilt limit does. The integrator stops in a
direction in which u is saturated. Frame: NED, metres, metres per second.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]

GRAVITY_M_S2 = 9.80665
FALL_M_S2 = np.array((0.0, 0.0, GRAVITY_M_S2))
LONGEST_STEP_S = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """Response to velocity commands.

    The horizontal gains, limit, lag, delay and drag are FACTS section 3. The vertical gains were chosen
    so that a 2 m/s climb reaches 63 % in 0.34 s, as measured. drag_per_s is that of PX4's own simulator;
    real quadrotors have 0.1 to 0.3.
    """

    proportional_per_s: float = 1.8
    integral_per_s2: float = 0.4
    acceleration_limit_m_s2: float = 9.8
    vertical_proportional_per_s: float = 6.0
    vertical_integral_per_s2: float = 2.0
    vertical_acceleration_limit_m_s2: float = 9.8
    lag_s: float = 0.08
    delay_s: float = 0.10
    drag_per_s: float = 1.0


class Mass:
    """Bodies of n vehicles at rest, and the ground. A step replaces the arrays, and changes none in place.

    Attributes:
        position_m: (n, 3), NED.
        velocity_m_s: (n, 3), over ground.
        acceleration_m_s2: (n, 3), of thrust and tilt, without drag.
        integral_m_s2: (n, 3), the velocity controller's integrator.
    """

    def __init__(self, position_m: Array) -> None:
        self.position_m = np.array(position_m, dtype=np.float64)
        self.velocity_m_s: Array = np.zeros_like(self.position_m)
        self.acceleration_m_s2: Array = np.zeros_like(self.position_m)
        self.integral_m_s2: Array = np.zeros_like(self.position_m)

    def rest_on_ground(self) -> Mask:
        """Stop vehicles that have reached the ground: no descent, no sliding, and a reset integrator.

        Returns: (n,) True where a vehicle touches the ground and does not climb.
        """
        touching: Mask = (self.position_m[:, 2] >= 0.0) & (self.velocity_m_s[:, 2] >= 0.0)
        if np.count_nonzero(touching):
            down = touching[:, np.newaxis]
            self.position_m = np.where(down, self.position_m * (1.0, 1.0, 0.0), self.position_m)
            self.velocity_m_s = np.where(down, 0.0, self.velocity_m_s)
            self.integral_m_s2 = np.where(down, 0.0, self.integral_m_s2)
            lifting_m_s2 = np.minimum(self.acceleration_m_s2, 0.0) * (0.0, 0.0, 1.0)
            self.acceleration_m_s2 = np.where(down, lifting_m_s2, self.acceleration_m_s2)
        return touching


class PointMasses(Mass):
    """The state of n vehicles with PX4; row i is vehicle i."""

    def __init__(
        self,
        position_m: Array,
        step_s: float,
        response: Response,
        velocity_m_s: Array | None = None,
    ) -> None:
        """Start at position_m (n, 3), at rest or cruising at velocity_m_s (n, 3) in still air.

        A step_s above LONGEST_STEP_S, which would distort the lag, is divided.
        """
        super().__init__(position_m)
        if velocity_m_s is not None:
            self.velocity_m_s = velocity_m_s
        self.acceleration_m_s2 = self.integral_m_s2 = response.drag_per_s * self.velocity_m_s
        self._parts = max(1, math.ceil(step_s / LONGEST_STEP_S - 1e-9))
        step_s /= self._parts
        self._step_s, self._response = step_s, response
        self._blend = -math.expm1(-step_s / response.lag_s)  # share of the way to the desired acceleration
        self._gains, integral_gains, self._limits = (
            np.array((level, level, upright))
            for level, upright in (
                (response.proportional_per_s, response.vertical_proportional_per_s),
                (response.integral_per_s2, response.vertical_integral_per_s2),
                (response.acceleration_limit_m_s2, response.vertical_acceleration_limit_m_s2),
            )
        )
        self._step_gains = step_s * integral_gains  # of the integrator
        steps = response.delay_s / step_s  # between two steps the delay interpolates
        self._late = math.floor(steps + 1e-9)
        self._share = max(steps - self._late, 0.0)
        self._commands_m_s = deque([self.velocity_m_s], maxlen=math.ceil(steps - 1e-9) + 1)  # newest first

    def step(
        self,
        command_m_s: Array,
        *,
        wind_m_s: Array | float = 0.0,
        velocity_error_m_s: Array | float = 0.0,
        powered: Mask | None = None,
    ) -> None:
        """Advance every vehicle by one step under its velocity command. There is no ground here.

        Args:
            command_m_s: (n, 3), NED. A row that is not finite is the caller's error and affects that vehicle
                only.
            wind_m_s: (3,) or (n, 3), velocity of the air over ground.
            velocity_error_m_s: (n, 3), error of the vehicle's own velocity estimate.
            powered: (n,), False where the motors stand still and the vehicle falls; all powered without it.
        """
        if powered is not None and np.count_nonzero(powered) == len(powered):
            powered = None
        for _ in range(self._parts):
            self._advance(command_m_s, wind_m_s, velocity_error_m_s, powered)

    def _advance(
        self,
        command_m_s: Array,
        wind_m_s: Array | float,
        velocity_error_m_s: Array | float,
        powered: Mask | None,
    ) -> None:
        self._commands_m_s.appendleft(np.array(command_m_s))
        kept, oldest = self._commands_m_s, len(self._commands_m_s) - 1
        newer, older = kept[min(self._late, oldest)], kept[min(self._late + 1, oldest)]  # `delay_s` ago
        delayed_m_s = newer if self._share == 0.0 else (1 - self._share) * newer + self._share * older
        measured_m_s = self.velocity_m_s + velocity_error_m_s
        thrust_m_s2, integral_m_s2 = self._control(delayed_m_s - measured_m_s)
        acceleration_m_s2 = self.acceleration_m_s2 + self._blend * (thrust_m_s2 - self.acceleration_m_s2)
        if powered is not None:
            on = powered[:, np.newaxis]
            acceleration_m_s2 = np.where(on, acceleration_m_s2, FALL_M_S2)
            integral_m_s2 = np.where(on, integral_m_s2, 0.0)
        drag_m_s2 = self._response.drag_per_s * (self.velocity_m_s - wind_m_s)
        velocity_m_s = self.velocity_m_s + self._step_s * (acceleration_m_s2 - drag_m_s2)
        self.position_m = self.position_m + self._step_s * 0.5 * (self.velocity_m_s + velocity_m_s)
        self.velocity_m_s = velocity_m_s
        self.acceleration_m_s2, self.integral_m_s2 = acceleration_m_s2, integral_m_s2

    def _control(self, error_m_s: Array) -> tuple[Array, Array]:
        """PI per axis, bounded; returns the bounded acceleration and the next integrator, both (n, 3)."""
        desired_m_s2 = self._gains * error_m_s + self.integral_m_s2
        size_m_s2 = np.abs(desired_m_s2)
        size_m_s2[:, :2] = np.hypot(desired_m_s2[:, 0], desired_m_s2[:, 1])[:, np.newaxis]
        gain_m_s2 = self._step_gains * error_m_s
        if not np.count_nonzero(size_m_s2 > self._limits):
            return desired_m_s2, self.integral_m_s2 + gain_m_s2
        scale = np.minimum(1.0, self._limits / np.maximum(size_m_s2, 1e-12))
        winding = (scale < 1.0) & (error_m_s * desired_m_s2 > 0.0)
        return desired_m_s2 * scale, self.integral_m_s2 + np.where(winding, 0.0, gain_m_s2)
