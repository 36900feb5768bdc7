"""North, east, down from an origin to latitude, longitude and altitude, on the WGS 84 ellipsoid."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from gcs.sim.vehicle.dynamics import Array

MAJOR_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
MINOR_M = MAJOR_M * (1.0 - FLATTENING)
SQUARED = FLATTENING * (2.0 - FLATTENING)  # first eccentricity
SECOND_SQUARED = SQUARED / (1.0 - SQUARED)


class Tangent:
    """The plane that touches the earth at an origin."""

    def __init__(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> None:
        """Place the origin of north, east, down."""
        sin, cos = math.sin(math.radians(latitude_deg)), math.cos(math.radians(latitude_deg))
        east, ahead = math.sin(math.radians(longitude_deg)), math.cos(math.radians(longitude_deg))
        normal_m = MAJOR_M / math.sqrt(1.0 - SQUARED * sin * sin)
        out_m = (normal_m + altitude_m) * cos
        self._center_m = np.array(
            [out_m * ahead, out_m * east, (normal_m * (1.0 - SQUARED) + altitude_m) * sin]
        )
        self._turn = np.array(
            [
                [-sin * ahead, -sin * east, cos],
                [-east, ahead, 0.0],
                [-cos * ahead, -cos * east, -sin],
            ]
        )

    def geodetic(self, position_m: Array) -> Array:
        """(n, 3) NED to (n, 3): latitude and longitude in degrees, altitude in metres.

        Source: B. R. Bowring, Transformation from spatial to geographical coordinates, Survey Review 23
        (1976); better than a micrometre below 10 km.
        """
        x_m, y_m, z_m = (self._center_m + position_m @ self._turn).T
        out_m = np.hypot(x_m, y_m)
        reduced = np.arctan2(z_m * MAJOR_M, out_m * MINOR_M)
        latitude = np.arctan2(
            z_m + SECOND_SQUARED * MINOR_M * np.sin(reduced) ** 3,
            out_m - SQUARED * MAJOR_M * np.cos(reduced) ** 3,
        )
        sin = np.sin(latitude)
        curve_m = MAJOR_M * np.sqrt(1.0 - SQUARED * sin * sin)
        altitude_m = out_m * np.cos(latitude) + z_m * sin - curve_m
        return np.stack([np.degrees(latitude), np.degrees(np.arctan2(y_m, x_m)), altitude_m], axis=1)
