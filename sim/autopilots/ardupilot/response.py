"""ArduCopter's bodies and control loops, vectorised over the fleet. Pure: no clock, no I/O.

Identified on the recorded steps of WPNAV_ACCEL 100, 250 and 500 (tests/data/ardupilot/fake). Per axis:

    w' = towards the command, |w'| <= a       the desired velocity, a ramp of WPNAV_ACCEL, PILOT_ACCEL_Z
    t' = w                                    the desired position, so that a stop ends at v^2 / 2a
    e  = w + (t - p) - v                      PSC_POSXY_P, PSC_POSZ_P are 1
    u  = proportional e + I + derivative e', I' = integral e
    a' = (b - a) / lag, b' = (u - b) / lag    attitude; one lag for the thrust
    v' = a - drag (v - wind), p' = v          the body in the air

The tilt bounds the length of the horizontal u; a descent that begins takes lift, and thus push sideways.
The inner loop of the thrust compensates vertical drag. Frame: NED, metres, metres per second.
"""

import math
from dataclasses import dataclass

import numpy as np

from gcs.sim.vehicle.dynamics import FALL_M_S2, GRAVITY_M_S2, Array, Mask, Mass

CORRECTION_M_S = 5.0
"""Fastest way back to the desired position, as the leash of WPNAV_SPEED allows."""
LIFT_SHARE = (0.3, 2.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """Gains of the recorded vehicle. The drag follows from its tilt at steady speed, and from its fall.

    One number for all vehicles, or (n,) of each; `filter_hz` and `tilt_max_m_s2` are those of all.
    """

    proportional_per_s: Array | float = 1.93
    integral_per_s2: Array | float = 1.25
    derivative: Array | float = 0.59
    lag_s: Array | float = 0.155
    vertical_proportional_per_s: Array | float = 4.94
    vertical_integral_per_s2: Array | float = 3.44
    vertical_derivative: Array | float = 0.68
    vertical_lag_s: Array | float = 0.135
    filter_hz: float = 5.0
    tilt_max_m_s2: float = GRAVITY_M_S2  # ANGLE_MAX, 45 degrees
    drag_per_s: Array | float = 0.653


class Copters(Mass):
    """The state of n vehicles; row i is vehicle i. A step replaces the arrays, and changes none in place.

    Attributes:
        desired_m_s: (n, 3), the ramp towards the command.
        target_m: (n, 3), the desired position, local NED as the vehicle measures it.
    """

    def __init__(self, position_m: Array, step_s: float, response: Response) -> None:
        """Stand at position_m (n, 3). step_s is at most 0.02 s."""
        super().__init__(position_m)
        self.desired_m_s: Array = np.zeros_like(self.position_m)
        self.target_m: Array = np.zeros_like(self.position_m)
        self._climb_change_m_s2: Array = np.zeros(len(self.position_m))  # of the vertical ramp
        self._error_m_s = self._tilt_m_s2 = np.zeros_like(self.position_m)
        self._step_s, self._response = step_s, response
        r = response
        self._gains = _axes(r.proportional_per_s, r.vertical_proportional_per_s)
        self._integral_gains = _axes(r.integral_per_s2, r.vertical_integral_per_s2)
        self._slope_gains = _axes(r.derivative, r.vertical_derivative) / step_s
        self._blend = -np.expm1(-step_s / _axes(r.lag_s, r.vertical_lag_s))
        self._pre_blend = self._blend * (1.0, 1.0, 0.0) + (0.0, 0.0, 1.0)
        self._filter = -math.expm1(-step_s * math.tau * r.filter_hz)
        self._drag_per_s = _axes(r.drag_per_s, 0.0)
        self._falling_drag_per_s = _axes(r.drag_per_s, r.drag_per_s)

    def hold_against(self, wind_m_s: Array) -> None:
        """Hover in steady wind (3,) or (n, 3): tilt and integrator compensate it."""
        held_m_s2: Array = np.zeros_like(self.position_m) - self._drag_per_s * wind_m_s
        self.acceleration_m_s2 = self.integral_m_s2 = self._tilt_m_s2 = held_m_s2

    def start(self, rows: Mask, measured_m: Array, velocity_m_s: Array) -> None:
        """Begin a mode in `rows` (n,): desired are the measured position and velocity, (n, 3)."""
        some = rows[:, np.newaxis]
        self.desired_m_s = np.where(some, velocity_m_s, self.desired_m_s)
        self.target_m = np.where(some, measured_m, self.target_m)
        self._climb_change_m_s2 = np.where(rows, 0.0, self._climb_change_m_s2)

    def step(
        self,
        command_m_s: Array,
        limit_m_s2: Array,
        measured_m: Array,
        measured_m_s: Array,
        *,
        wind_m_s: Array | float,
        resting: Mask,
        jerk_m_s3: Array | None = None,
    ) -> None:
        """Advance every vehicle by one step. There is no ground here.

        Args:
            command_m_s: (n, 3), NED.
            limit_m_s2: (n, 2), acceleration of the ramp, horizontal and vertical.
            measured_m: (n, 3), the vehicles' own positions, local NED.
            measured_m_s: (n, 3), their own velocities.
            wind_m_s: (3,) or (n, 3), velocity of the air over ground.
            resting: (n,), where the motors idle or stand still: on the ground it stays, in the air it falls.
            jerk_m_s3: (n,), of the vertical ramp; infinite, or without it, the acceleration changes at once.
        """
        dt_s, r = self._step_s, self._response
        desired_m_s = self._ramp(command_m_s, limit_m_s2 * dt_s)
        if jerk_m_s3 is not None:
            desired_m_s[:, 2] = self._shaped(
                command_m_s[:, 2], desired_m_s[:, 2], limit_m_s2[:, 1], jerk_m_s3
            )
        target_m = self.target_m + dt_s * desired_m_s
        still = resting[:, np.newaxis]
        if resting.any():
            desired_m_s = np.where(still, 0.0, desired_m_s)
            target_m = np.where(still, measured_m, target_m)
        error_m_s = desired_m_s + _bounded(target_m - measured_m, CORRECTION_M_S) - measured_m_s
        filtered_m_s = self._error_m_s + self._filter * (error_m_s - self._error_m_s)
        push_m_s2 = self._gains * error_m_s + self.integral_m_s2
        push_m_s2 += self._slope_gains * (filtered_m_s - self._error_m_s)
        bounded_m_s2 = push_m_s2.copy()
        bounded_m_s2[:, :2] = _bounded(push_m_s2[:, :2], r.tilt_max_m_s2)
        winding = (bounded_m_s2 != push_m_s2) & (error_m_s * push_m_s2 > 0.0)
        integral_m_s2 = self.integral_m_s2 + np.where(winding, 0.0, dt_s * self._integral_gains * error_m_s)
        tilt_m_s2 = self._tilt_m_s2 + self._pre_blend * (bounded_m_s2 - self._tilt_m_s2)
        acceleration_m_s2 = self.acceleration_m_s2 + self._blend * (tilt_m_s2 - self.acceleration_m_s2)
        drag_per_s: Array | float = self._drag_per_s
        if resting.any():
            filtered_m_s, integral_m_s2, tilt_m_s2 = (
                np.where(still, 0.0, values) for values in (filtered_m_s, integral_m_s2, tilt_m_s2)
            )
            acceleration_m_s2 = np.where(still, FALL_M_S2, acceleration_m_s2)
            drag_per_s = np.where(still, self._falling_drag_per_s, drag_per_s)
        moving_m_s2 = acceleration_m_s2.copy()
        share = np.clip(1.0 - acceleration_m_s2[:, 2] / GRAVITY_M_S2, *LIFT_SHARE)
        moving_m_s2[:, :2] *= share[:, np.newaxis]
        drag_m_s2 = drag_per_s * (self.velocity_m_s - wind_m_s)
        velocity_m_s = self.velocity_m_s + dt_s * (moving_m_s2 - drag_m_s2)
        self.position_m = self.position_m + dt_s * 0.5 * (self.velocity_m_s + velocity_m_s)
        self.velocity_m_s, self.acceleration_m_s2 = velocity_m_s, acceleration_m_s2
        self.integral_m_s2, self._tilt_m_s2, self._error_m_s = integral_m_s2, tilt_m_s2, filtered_m_s
        self.desired_m_s, self.target_m = desired_m_s, target_m

    def _ramp(self, command_m_s: Array, most_m_s: Array) -> Array:
        """The desired velocity, moved towards the command: north and east share one limit (habit 48)."""
        change_m_s = command_m_s - self.desired_m_s
        level_m_s = np.hypot(change_m_s[:, 0], change_m_s[:, 1])
        share = np.minimum(1.0, most_m_s[:, 0] / np.maximum(level_m_s, 1e-9))
        change_m_s[:, :2] *= share[:, np.newaxis]
        change_m_s[:, 2] = np.minimum(np.maximum(change_m_s[:, 2], -most_m_s[:, 1]), most_m_s[:, 1])
        ramp_m_s: Array = self.desired_m_s + change_m_s
        return ramp_m_s

    def _shaped(self, command_m_s: Array, ramp_m_s: Array, limit_m_s2: Array, jerk_m_s3: Array) -> Array:
        """(n,): the vertical ramp with bounded jerk; `ramp_m_s` (n,) where it is infinite.

        Source: ArduPilot's shape_vel_accel, 4.1 on: the acceleration is in proportion to what is missing,
        at jerk over acceleration, and bounded by the acceleration.
        """
        shaped, dt_s, now_m_s = np.isfinite(jerk_m_s3), self._step_s, self.desired_m_s[:, 2]
        jerk_m_s3 = np.where(shaped, jerk_m_s3, 0.0)
        aim_m_s2 = np.clip(jerk_m_s3 / limit_m_s2 * (command_m_s - now_m_s), -limit_m_s2, limit_m_s2)
        most_m_s2 = jerk_m_s3 * dt_s
        change_m_s2 = np.clip(aim_m_s2 - self._climb_change_m_s2, -most_m_s2, most_m_s2)
        self._climb_change_m_s2 = np.where(shaped, self._climb_change_m_s2 + change_m_s2, 0.0)
        shaped_m_s: Array = np.where(shaped, now_m_s + dt_s * self._climb_change_m_s2, ramp_m_s)
        return shaped_m_s


def _axes(level: Array | float, upright: Array | float) -> Array:
    """(3,) or (n, 3) values along north, east and down."""
    return np.stack(np.broadcast_arrays(level, level, upright), axis=-1)


def _bounded(vectors: Array, longest: float) -> Array:
    """The rows, none longer than that."""
    length = np.sqrt((vectors**2).sum(axis=1, keepdims=True))
    bounded: Array = vectors * np.minimum(1.0, longest / np.maximum(length, 1e-9))
    return bounded
