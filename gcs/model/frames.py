"""Conversions between geodetic positions and the show frame, vectorised over the fleet.

The show frame is flat and fixed: x along the show's heading, y to its right, z down, origin given by
latitude, longitude and altitude AMSL. With heading 0 it is NED. Geodesy is pymap3d's, on WGS84.
"""

from dataclasses import dataclass
from math import cos, isfinite, radians, sin

import numpy as np
import pymap3d

from gcs.model.errors import InvalidError
from gcs.model.settings import PUBLISHED
from gcs.model.state import Array


def wrap_rad(angle_rad: Array) -> Array:
    """The same angles within [-pi, pi); any shape."""
    wrapped: Array = (angle_rad + np.pi) % (2 * np.pi) - np.pi
    return wrapped


@dataclass(frozen=True, slots=True)
class ShowFrame:
    """The show frame: its origin, and the heading of its x axis.

    Raises: InvalidError when a number is not finite or out of its range.
    """

    __pydantic_config__ = PUBLISHED

    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    heading_deg: float = 0.0

    def __post_init__(self) -> None:
        for name, limit in (("latitude_deg", 90), ("longitude_deg", 180), ("heading_deg", 360)):
            value = getattr(self, name)
            if not (isfinite(value) and abs(value) <= limit):
                raise InvalidError(name, value, f"between -{limit} and {limit} degrees")
        if not isfinite(self.altitude_amsl_m):
            raise InvalidError("altitude_amsl_m", self.altitude_amsl_m, "a finite number of metres")

    @property
    def to_ned(self) -> Array:
        """(3, 3) rotation R; a row vector v of the show frame is ``v @ R.T`` in NED."""
        c, s = cos(radians(self.heading_deg)), sin(radians(self.heading_deg))
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def position_m(self, latitude_deg: Array, longitude_deg: Array, altitude_amsl_m: Array) -> Array:
        """Geodetic positions, each (n,), as (n, 3) in the show frame; NaN stays NaN."""
        north, east, down = pymap3d.geodetic2ned(
            latitude_deg,
            longitude_deg,
            altitude_amsl_m,
            self.latitude_deg,
            self.longitude_deg,
            self.altitude_amsl_m,
        )
        return self.from_ned(np.stack([north, east, down], axis=-1))

    def geodetic(self, position_m: Array) -> tuple[Array, Array, Array]:
        """Latitude, longitude (degrees) and altitude AMSL (m), each (n,), of (n, 3) in the show frame."""
        ned = self.into_ned(position_m)
        latitude_deg, longitude_deg, altitude_amsl_m = pymap3d.ned2geodetic(
            ned[:, 0], ned[:, 1], ned[:, 2], self.latitude_deg, self.longitude_deg, self.altitude_amsl_m
        )
        return np.asarray(latitude_deg), np.asarray(longitude_deg), np.asarray(altitude_amsl_m)

    def from_ned(self, vector: Array) -> Array:
        """Rotate (n, 3) vectors from NED into the show frame."""
        return np.asarray(vector @ self.to_ned)

    def into_ned(self, vector: Array) -> Array:
        """Rotate (n, 3) vectors from the show frame into NED."""
        return np.asarray(vector @ self.to_ned.T)
