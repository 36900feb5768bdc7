"""ArduCopter's own fence: a circle around home, a height (habit 53), polygons. Pure, for many vehicles.

Polygons are not avoided here: AVOID_ENABLE bends at the circle and the height only.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.parameters import Columns
from gcs.sim.vehicle.polygons import Fenced, outside
from gcs.sim.vehicle.sensors import Sensors
from gcs.sim.vehicle.state import Numbers, Rows

HEIGHT, CIRCLE, POLYGON = 1, 2, 4
"""Bits of FENCE_TYPE."""
UNION = 2
"""Bit of FENCE_OPTIONS: one inclusion area is enough; Copter has it from 4.6 on."""
CHECK_S, CHECK_S_4_6 = 0.3, 0.04
"""Period of the check of polygons: in the loop of 3.3 Hz, from 4.6 on at 25 Hz (ArduCopter/fence.cpp)."""
AVOIDS_FENCE = 1
"""Bit of AVOID_ENABLE."""
SLOWS_PER_S = 1.0
"""PSC_POSXY_P: the last part of an approach is exponential."""


@dataclass(eq=False)
class Fence:
    """The fences of a fleet, as its parameters have them."""

    parameters: Columns
    areas: Sequence[Fenced] = ()  # by row
    release: tuple[int, int] = (4, 1)
    _outside: Mask = field(init=False)
    _next_s: float = field(default=-math.inf, init=False)

    def __post_init__(self) -> None:
        self._outside = np.zeros(max(1, len(self.areas)), dtype=np.bool_)

    def look(self, sensors: Sensors, awake: Mask, now_s: float) -> None:
        """Look which vehicles with a position (n,) are outside of their polygons, if it is time."""
        if now_s < self._next_s:
            return
        self._next_s = now_s + (CHECK_S_4_6 if self.release >= (4, 6) else CHECK_S)
        enabled, p = self.enabled(POLYGON), self.parameters
        self._outside = np.zeros(len(enabled), dtype=np.bool_)
        rows = [row for row, each in enumerate(self.areas) if each.in_force and enabled[row] and awake[row]]
        if not rows:
            return
        union = (
            p["FENCE_OPTIONS"].astype(np.int64) & UNION if self.release >= (4, 6) else np.zeros_like(awake)
        )
        for row, place in zip(rows, sensors.place(np.array(rows)).tolist(), strict=True):
            self._outside[row] = outside(self.areas[row].in_force, place, union=bool(union[row]))

    def enabled(self, kind: int) -> Mask:
        """(n,): whether this bit of FENCE_TYPE is in force."""
        p = self.parameters
        enabled: Mask = (p["FENCE_ENABLE"] > 0) & (p["FENCE_TYPE"].astype(np.int64) & kind > 0)
        return enabled

    def breach(self, from_home_m: Array) -> Numbers:
        """(n,): the bits of FENCE_TYPE that are broken at from_home_m (n, 3), local NED."""
        p = self.parameters
        far = np.hypot(from_home_m[:, 0], from_home_m[:, 1]) > p["FENCE_RADIUS"]
        high = -from_home_m[:, 2] > p["FENCE_ALT_MAX"]
        breached: Numbers = CIRCLE * (far & self.enabled(CIRCLE)) + HEIGHT * (high & self.enabled(HEIGHT))
        return breached + POLYGON * self._outside

    def bent(self, rows: Rows, velocity_m_s: Array, from_home_m: Array, limit_m_s2: Array) -> Array:
        """(k, 3): the velocities (k, 3) of these rows, slowed so that they stop at the fence's margin.

        Args:
            rows: (k,).
            velocity_m_s: (k, 3), NED.
            from_home_m: (k, 3), where the control loops are.
            limit_m_s2: (k, 2), accelerations, horizontal and vertical.
        """
        p = self.parameters
        avoids = p["AVOID_ENABLE"][rows].astype(np.int64) & AVOIDS_FENCE > 0
        level, high = avoids & self.enabled(CIRCLE)[rows], avoids & self.enabled(HEIGHT)[rows]
        if not (level | high).any():
            return velocity_m_s
        bent_m_s = velocity_m_s.copy()
        margin_m = p["FENCE_MARGIN"][rows]
        distance_m = np.hypot(from_home_m[:, 0], from_home_m[:, 1])
        outward = from_home_m[:, :2] / np.maximum(distance_m, 1e-9)[:, np.newaxis]
        out_m_s = (velocity_m_s[:, :2] * outward).sum(axis=1)
        most_m_s = approach_m_s(p["FENCE_RADIUS"][rows] - margin_m - distance_m, limit_m_s2[:, 0])
        over_m_s = np.where(level, np.maximum(out_m_s - most_m_s, 0.0), 0.0)
        bent_m_s[:, :2] -= over_m_s[:, np.newaxis] * outward
        climb_m_s = approach_m_s(p["FENCE_ALT_MAX"][rows] - margin_m + from_home_m[:, 2], limit_m_s2[:, 1])
        bent_m_s[:, 2] = np.where(high, np.maximum(bent_m_s[:, 2], -climb_m_s), bent_m_s[:, 2])
        return bent_m_s


def approach_m_s(distance_m: Array, limit_m_s2: Array) -> Array:
    """(k,): the speed at that distance (k,) from a stop, braking no harder than limit_m_s2 (k,).

    Source: ArduPilot's sqrt_controller: exponential near the end, a parabola before.
    """
    linear_m = limit_m_s2 / SLOWS_PER_S**2
    far_m = np.maximum(distance_m, 0.0)
    fast_m_s = np.sqrt(2.0 * limit_m_s2 * np.maximum(far_m - 0.5 * linear_m, 0.0))
    speed_m_s: Array = np.where(far_m > linear_m, fast_m_s, SLOWS_PER_S * far_m)
    return speed_m_s
