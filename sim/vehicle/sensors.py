"""Estimates of the vehicles' estimators and sensors, as their autopilots receive them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from gcs.sim.vehicle.dynamics import Array, Mask
    from gcs.sim.vehicle.state import Rows

MANY = 8


@dataclass(frozen=True, eq=False)
class Sensors:
    """A fleet's estimates. Local NED is each vehicle's own: its origin is its first position fix."""

    position_m: Array  # (n, 3), local NED; NaN before the first fix
    velocity_m_s: Array  # (n, 3), NED
    acceleration_m_s2: Array  # (n, 3), NED, of thrust and tilt
    height_m: Array  # (n,), over ground, as a rangefinder measures it
    contact: Mask  # (n,), on the ground
    estimate_m: Array  # (n, 3), the position in the fleet's common NED
    locate: Callable[[Array], Array]  # any rows of it to latitude, longitude (deg), altitude AMSL (m)

    def place(self, rows: Rows) -> Array:
        """(len(rows), 3): estimated latitude and longitude in degrees, altitude AMSL in metres."""
        if MANY * len(rows) < len(self.height_m):
            return self.locate(self.estimate_m[rows])
        return self._places[rows]

    @cached_property
    def _places(self) -> Array:
        """Positions of all vehicles, once for all messages of a small fleet."""
        return self.locate(self.estimate_m)

    @cached_property
    def ground_speed_m_s(self) -> Array:
        """(n,), horizontal."""
        speed_m_s: Array = np.hypot(self.velocity_m_s[:, 0], self.velocity_m_s[:, 1])
        return speed_m_s
