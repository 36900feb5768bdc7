"""What one vehicle's estimator and sensors tell its autopilot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

Triple: TypeAlias = tuple[float, float, float]


@dataclass(slots=True, frozen=True)
class Sensed:
    """Local NED is the vehicle's own: its origin is its first position fix."""

    position_m: Triple  # local NED, estimated
    velocity_m_s: Triple  # NED, estimated
    acceleration_m_s2: Triple  # NED, of thrust and tilt
    latitude_deg: float  # estimated
    longitude_deg: float
    altitude_amsl_m: float
    height_m: float  # over ground, as a rangefinder sees it
    contact: bool  # something stands on the ground

    @property
    def ground_speed_m_s(self) -> float:
        """Horizontal speed."""
        north, east, _ = self.velocity_m_s
        return float((north * north + east * east) ** 0.5)
