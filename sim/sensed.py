"""What the vehicles' estimators and sensors tell their autopilots."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim.dynamics import Array, Mask
    from sim.state import Rows


@dataclass(frozen=True, eq=False)
class Sensed:
    """A fleet's estimates. Local NED is each vehicle's own: its origin is its first position fix."""

    position_m: Array  # (n, 3), local NED; NaN before the first fix
    velocity_m_s: Array  # (n, 3), NED
    acceleration_m_s2: Array  # (n, 3), NED, of thrust and tilt
    height_m: Array  # (n,), over ground, as a rangefinder sees it
    contact: Mask  # (n,), something stands on the ground
    locate: Callable[[Rows], Array]  # of these rows: latitude, longitude (deg), altitude AMSL (m)

    def place(self, rows: Rows) -> Array:
        """(len(rows), 3): estimated latitude and longitude in degrees, altitude AMSL in metres."""
        return self.locate(rows)

    @cached_property
    def ground_speed_m_s(self) -> Array:
        """(n,), horizontal."""
        speed_m_s: Array = np.hypot(self.velocity_m_s[:, 0], self.velocity_m_s[:, 1])
        return speed_m_s
