"""Some vehicles of a fleet at one time, as the functions that compose their messages read them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gcs.sim.vehicle.dynamics import GRAVITY_M_S2, Array, Mask
from gcs.sim.vehicle.sensors import Sensors
from gcs.sim.vehicle.state import Numbers, Rows, State


@dataclass(frozen=True, eq=False)
class Snapshot:
    """m of the fleet's vehicles; every property has m rows, and values used more than once are cached."""

    rows: Rows  # (m,), rows of the fleet
    unix_s: float
    state: State
    sensors: Sensors

    @cached_property
    def boot_ms(self) -> Numbers:
        return np.maximum(np.floor(self.state.boot_clock_s()[self.rows] * 1e3), 0).astype(np.int64)

    @property
    def boot_us(self) -> Numbers:
        return self.boot_ms * 1000

    @property
    def has_fix(self) -> Mask:
        return self.state.home_set[self.rows]

    @property
    def powered(self) -> Mask:
        return self.state.powered[self.rows]

    @property
    def position_m(self) -> Array:
        return self.sensors.position_m[self.rows]

    @property
    def velocity_m_s(self) -> Array:
        return self.sensors.velocity_m_s[self.rows]

    @property
    def ground_speed_m_s(self) -> Array:
        return self.sensors.ground_speed_m_s[self.rows]

    @cached_property
    def place(self) -> Array:
        """(m, 3): latitude and longitude in degrees, altitude AMSL in metres."""
        return self.sensors.place(self.rows)

    @property
    def yaw_rad(self) -> Array:
        return self.state.yaw_rad[self.rows]

    @property
    def heading_cdeg(self) -> Array:
        heading_cdeg: Array = np.rint(np.degrees(self.yaw_rad) % 360.0 * 100.0) % 36000
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
        """Roll and pitch that push a point mass in the direction of its acceleration, after its yaw."""
        forward_m_s2, right_m_s2, down_m_s2 = self.body_acceleration_m_s2
        lift_m_s2 = np.maximum(GRAVITY_M_S2 - down_m_s2, 1.0)
        pitch_rad = -np.arctan2(forward_m_s2, lift_m_s2)
        return np.arctan2(right_m_s2 * np.cos(pitch_rad), lift_m_s2), pitch_rad
