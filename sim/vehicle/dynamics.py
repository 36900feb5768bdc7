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
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]
Setting: TypeAlias = float | Array

GRAVITY_M_S2 = 9.80665
FALL_M_S2 = np.array((0.0, 0.0, GRAVITY_M_S2))

KEPT_RESPONSES = 64
"""Responses whose prepared settings are cached; a response is never changed."""


class ShapeError(ValueError):
    """An array does not have one row of three per vehicle."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response:
    """Response to velocity commands. Every setting is a number, or an (n,) array: one per vehicle.

    The horizontal gains, limit, lag, delay and drag are FACTS section 3. The vertical gains were chosen
    so that a 2 m/s climb reaches 63 % in 0.34 s, as measured. drag_per_s is that of PX4's own simulator;
    real quadrotors have 0.1 to 0.3.
    """

    proportional_per_s: Setting = 1.8
    integral_per_s2: Setting = 0.4
    acceleration_limit_m_s2: Setting = 9.8
    vertical_proportional_per_s: Setting = 6.0
    vertical_integral_per_s2: Setting = 2.0
    vertical_acceleration_limit_m_s2: Setting = 9.8
    lag_s: Setting = 0.08
    delay_s: Setting = 0.10
    drag_per_s: Setting = 1.0

    def __post_init__(self) -> None:
        """Refuse settings that cannot be simulated.

        Raises:
            ValueError: a setting is negative or not finite, or the lag is zero.
        """
        for name in self.__dataclass_fields__:
            value = np.asarray(getattr(self, name), dtype=np.float64)
            if value.ndim > 1 or not np.isfinite(value).all() or (value < 0).any():
                raise ValueError(f"{name} must be a number >= 0, or an (n,) array of them, not {value}")
        if (np.asarray(self.lag_s) <= 0).any():
            raise ValueError("lag_s must be > 0")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointMasses:
    """The state of n vehicles; row i is vehicle i. Owns its arrays.

    commands_m_s holds the last commands, newest first, each (n, 3): those that the delay still needs.
    """

    position_m: Array  # (n, 3), NED
    velocity_m_s: Array  # (n, 3), over ground
    acceleration_m_s2: Array  # (n, 3), of thrust and tilt, without drag
    integral_m_s2: Array  # (n, 3), the velocity controller's integrator
    commands_m_s: tuple[Array, ...]

    def __post_init__(self) -> None:
        """Check the shapes and make the arrays read-only.

        Raises:
            ShapeError: an array is not (n, 3) with the same n.
        """
        own = (self.position_m, self.velocity_m_s, self.acceleration_m_s2, self.integral_m_s2)
        for array in (*own, *self.commands_m_s[:1]):
            if array.shape != (len(self.position_m), 3):
                raise ShapeError(f"{array.shape} where ({len(self.position_m)}, 3) is needed")
            array.setflags(write=False)

    @staticmethod
    def at(
        position_m: Array, velocity_m_s: Array | None = None, *, drag_per_s: Setting = 1.0
    ) -> "PointMasses":
        """Start at position_m (n, 3), at rest or cruising at velocity_m_s (n, 3) in still air."""
        position_m = np.array(position_m, dtype=np.float64)
        velocity_m_s = (
            np.zeros_like(position_m) if velocity_m_s is None else np.array(velocity_m_s, np.float64)
        )
        balance_m_s2 = _column(drag_per_s) * velocity_m_s
        return PointMasses(
            position_m=position_m,
            velocity_m_s=velocity_m_s,
            acceleration_m_s2=balance_m_s2,
            integral_m_s2=balance_m_s2.copy(),
            commands_m_s=(velocity_m_s.copy(),),
        )

    def __len__(self) -> int:
        """How many vehicles."""
        return len(self.position_m)


def step(
    state: PointMasses,
    command_m_s: Array,
    dt_s: float,
    response: Response,
    *,
    wind_m_s: Array | None = None,
    velocity_error_m_s: Array | None = None,
    powered: Mask | None = None,
) -> PointMasses:
    """Advance every vehicle by dt_s under its velocity command.

    Call it with the same dt_s each time, at most 0.02 s: the delay is counted in steps (between two
    steps it interpolates), and larger steps distort the lag.

    Args:
        state: n vehicles.
        command_m_s: (n, 3), NED. A row that is not finite is the caller's error and affects that vehicle
        only.
        dt_s: the step.
        response: of the vehicles.
        wind_m_s: (3,) or (n, 3), velocity of the air over ground; still air without it.
        velocity_error_m_s: (n, 3), error of the vehicle's own velocity estimate.
        powered: (n,), False where the motors stand still and the vehicle falls; all powered without it.

    Returns: the state dt_s later. There is no ground here: see rest_on_ground.

    Raises:
        ShapeError: command_m_s is not (n, 3).
    """
    if command_m_s.shape != state.position_m.shape:
        raise ShapeError(f"{command_m_s.shape} commands for {len(state)} vehicles")
    commands_m_s = (np.array(command_m_s), *state.commands_m_s)
    delayed_m_s, commands_m_s = _delayed(commands_m_s, response, dt_s)
    measured_m_s = (
        state.velocity_m_s if velocity_error_m_s is None else state.velocity_m_s + velocity_error_m_s
    )
    thrust_m_s2, integral_m_s2 = _control(delayed_m_s - measured_m_s, state.integral_m_s2, dt_s, response)

    blend, drag_per_s = _lag_and_drag(response, dt_s)
    acceleration_m_s2 = state.acceleration_m_s2 + blend * (thrust_m_s2 - state.acceleration_m_s2)
    if powered is not None and not powered.all():
        on = powered[:, np.newaxis]
        acceleration_m_s2 = np.where(on, acceleration_m_s2, FALL_M_S2)
        integral_m_s2 = np.where(on, integral_m_s2, 0.0)
    airspeed_m_s = state.velocity_m_s if wind_m_s is None else state.velocity_m_s - wind_m_s
    velocity_m_s = state.velocity_m_s + dt_s * (acceleration_m_s2 - drag_per_s * airspeed_m_s)
    return PointMasses(
        position_m=state.position_m + dt_s * 0.5 * (state.velocity_m_s + velocity_m_s),
        velocity_m_s=velocity_m_s,
        acceleration_m_s2=acceleration_m_s2,
        integral_m_s2=integral_m_s2,
        commands_m_s=commands_m_s,
    )


def rest_on_ground(state: PointMasses, *, ground_down_m: float = 0.0) -> tuple[PointMasses, Mask]:
    """Stop vehicles that have reached the ground: no descent, no sliding, and a reset integrator.

    Returns: the state, and (n,) True where a vehicle touches the ground and does not climb.
    """
    touching = (state.position_m[:, 2] >= ground_down_m) & (state.velocity_m_s[:, 2] >= 0.0)
    if not touching.any():
        return state, touching
    position_m, velocity_m_s = state.position_m.copy(), state.velocity_m_s.copy()
    acceleration_m_s2, integral_m_s2 = state.acceleration_m_s2.copy(), state.integral_m_s2.copy()
    position_m[touching, 2] = ground_down_m
    velocity_m_s[touching] = integral_m_s2[touching] = acceleration_m_s2[touching, :2] = 0.0
    acceleration_m_s2[touching, 2] = np.minimum(acceleration_m_s2[touching, 2], 0.0)
    grounded = PointMasses(
        position_m=position_m,
        velocity_m_s=velocity_m_s,
        acceleration_m_s2=acceleration_m_s2,
        integral_m_s2=integral_m_s2,
        commands_m_s=state.commands_m_s,
    )
    return grounded, touching


def _column(setting: Setting) -> Setting:
    """Turn one setting per vehicle into a column that multiplies (n, 3)."""
    return setting[:, np.newaxis] if isinstance(setting, np.ndarray) and setting.ndim == 1 else setting


@lru_cache(maxsize=KEPT_RESPONSES)
def _lag_and_drag(response: Response, dt_s: float) -> tuple[Array, Setting]:
    """Share of the difference to the desired acceleration that one step covers, and the drag; as columns."""
    return -np.expm1(-dt_s / np.asarray(_column(response.lag_s))), _column(response.drag_per_s)


@lru_cache(maxsize=KEPT_RESPONSES)
def _gains(response: Response) -> tuple[Array, Array, Array]:
    """Proportional and integral gains, and the limits, (3,) or (n, 3) each."""
    return (
        _per_axis(response.proportional_per_s, response.vertical_proportional_per_s),
        _per_axis(response.integral_per_s2, response.vertical_integral_per_s2),
        _per_axis(response.acceleration_limit_m_s2, response.vertical_acceleration_limit_m_s2),
    )


@lru_cache(maxsize=KEPT_RESPONSES)
def _delay_steps(response: Response, dt_s: float) -> tuple[int, Array, Array, Array]:
    """How many commands to keep, and between which two of them the delay lies, (n,) or () each."""
    steps = np.asarray(response.delay_s, dtype=np.float64) / dt_s
    near = np.floor(steps + 1e-9)
    return math.ceil(float(steps.max()) - 1e-9) + 1, near, near + 1.0, np.maximum(steps - near, 0.0)


def _delayed(
    commands_m_s: tuple[Array, ...], response: Response, dt_s: float
) -> tuple[Array, tuple[Array, ...]]:
    """The commands as they were `delay_s` ago, and the commands to keep, newest first."""
    count, near, far, share = _delay_steps(response, dt_s)
    kept = commands_m_s[:count]
    oldest = len(kept) - 1
    if near.ndim == 0:
        newer, older = kept[min(int(near), oldest)], kept[min(int(far), oldest)]
        return (newer if share == 0.0 else (1 - share) * newer + share * older), kept
    history_m_s = np.stack(kept)
    rows, mix = np.arange(len(near)), share[:, np.newaxis]
    newer = history_m_s[np.minimum(near, oldest).astype(np.intp), rows]
    older = history_m_s[np.minimum(far, oldest).astype(np.intp), rows]
    return (1 - mix) * newer + mix * older, kept


def _control(error_m_s: Array, integral_m_s2: Array, dt_s: float, response: Response) -> tuple[Array, Array]:
    """PI per axis, bounded; returns the bounded acceleration and the next integrator, both (n, 3)."""
    proportional_per_s, integral_per_s2, limit_m_s2 = _gains(response)
    desired_m_s2 = proportional_per_s * error_m_s + integral_m_s2
    size_m_s2 = np.abs(desired_m_s2)
    size_m_s2[:, :2] = np.hypot(desired_m_s2[:, 0], desired_m_s2[:, 1])[:, np.newaxis]
    gain_m_s2 = dt_s * integral_per_s2 * error_m_s
    if not (size_m_s2 > limit_m_s2).any():
        return desired_m_s2, integral_m_s2 + gain_m_s2
    scale = np.minimum(1.0, limit_m_s2 / np.maximum(size_m_s2, 1e-12))
    winding = (scale < 1.0) & (error_m_s * desired_m_s2 > 0.0)
    return desired_m_s2 * scale, integral_m_s2 + np.where(winding, 0.0, gain_m_s2)


def _per_axis(horizontal: Setting, vertical: Setting) -> Array:
    """(3,) or (n, 3): the horizontal setting twice, then the vertical one."""
    both = np.broadcast_arrays(horizontal, horizontal, vertical)
    return np.stack(both, axis=-1)
