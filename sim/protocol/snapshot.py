"""Some vehicles at one moment: the values that messages are made from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gcs.sim.vehicle.dynamics import GRAVITY_M_S2

if TYPE_CHECKING:
    from gcs.sim.vehicle.battery import Batteries
    from gcs.sim.vehicle.dynamics import Array, Mask
    from gcs.sim.vehicle.sensors import Sensors
    from gcs.sim.vehicle.state import Numbers, Rows, State
    from gcs.sim.vehicle.transitions import Transitions


@dataclass(frozen=True, eq=False)
class Snapshot:
    """m of the fleet's vehicles; every property has m rows, and values used more than once are cached."""

    rows: Rows  # (m,), rows of the fleet
    unix_s: float
    state: State
    sensors: Sensors
    transitions: Transitions
    batteries: Batteries

    @cached_property
    def boot_ms(self) -> Numbers:
        """The boot clocks in milliseconds."""
        return np.maximum(np.floor(self.state.boot_clock_s()[self.rows] * 1e3), 0).astype(np.int64)

    @property
    def boot_us(self) -> Numbers:
        """The boot clocks in microseconds."""
        return self.boot_ms * 1000

    @property
    def has_fix(self) -> Mask:
        """Which vehicles know their position."""
        fixed: Mask = self.state.home_set[self.rows]
        return fixed

    @property
    def powered(self) -> Mask:
        """Which vehicles are carried by their motors."""
        return self.state.powered[self.rows]

    @property
    def can_arm(self) -> Mask:
        """Which vehicles pass the prearm check."""
        return self.transitions.can_arm()[self.rows]

    @property
    def position_m(self) -> Array:
        """Local NED."""
        return self.sensors.position_m[self.rows]

    @property
    def velocity_m_s(self) -> Array:
        """NED."""
        return self.sensors.velocity_m_s[self.rows]

    @property
    def ground_speed_m_s(self) -> Array:
        """Horizontal."""
        return self.sensors.ground_speed_m_s[self.rows]

    @cached_property
    def place(self) -> Array:
        """(m, 3): latitude and longitude in degrees, altitude AMSL in metres."""
        return self.sensors.place(self.rows)

    @property
    def yaw_rad(self) -> Array:
        """From north, clockwise."""
        return self.state.yaw_rad[self.rows]

    @property
    def heading_cdeg(self) -> Array:
        """The same in hundredths of a degree, from 0 to 35999."""
        heading_cdeg: Array = np.round(np.degrees(self.yaw_rad) % 360.0 * 100.0) % 36000
        return heading_cdeg

    @cached_property
    def body_acceleration_m_s2(self) -> tuple[Array, Array, Array]:
        """Forward, right (by yaw only) and down; zero where the motors stand still."""
        felt = (self.powered & self.has_fix)[:, np.newaxis]
        north, east, down = np.where(felt, self.sensors.acceleration_m_s2[self.rows], 0.0).T
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return cos * north + sin * east, cos * east - sin * north, down

    @cached_property
    def tilt_rad(self) -> tuple[Array, Array]:
        """Roll and pitch that push a point mass in the direction of its acceleration."""
        forward_m_s2, right_m_s2, down_m_s2 = self.body_acceleration_m_s2
        lift_m_s2 = np.maximum(GRAVITY_M_S2 - down_m_s2, 1.0)
        return np.arctan2(right_m_s2, lift_m_s2), -np.arctan2(forward_m_s2, lift_m_s2)
