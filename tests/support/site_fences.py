"""Fences of polygons around the origin of virtual shows."""

from math import cos, radians

from gcs.config.schema import Config
from gcs.model.polygon_fence import M_PER_DEG, Corner, KeptArea, PolygonFence
from gcs.testing.virtual_show import ORIGIN


def at_deg(north_m: float, east_m: float) -> Corner:
    """Latitude and longitude of a place near the origin."""
    latitude_deg = ORIGIN["latitude_deg"] + north_m / M_PER_DEG
    per_deg = M_PER_DEG * cos(radians(ORIGIN["latitude_deg"]))
    return latitude_deg, ORIGIN["longitude_deg"] + east_m / per_deg


def square(half_m: float, *, north_m: float = 0.0, east_m: float = 0.0, inclusion: bool = True) -> KeptArea:
    """A square with sides to north and east."""
    corners = ((-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m))
    return KeptArea(inclusion, tuple(at_deg(north_m + x, east_m + y) for x, y in corners))


def many_cornered(count: int, half_m: float) -> KeptArea:
    """A square with corners along one side: so many in all."""
    along = [(half_m - 2.0 * half_m * at / (count - 3), half_m) for at in range(1, count - 3)]
    corners = [(-half_m, half_m), (-half_m, -half_m), (half_m, -half_m), (half_m, half_m), *along]
    return KeptArea(True, tuple(at_deg(x, y) for x, y in corners))


def fenced(config: Config, *polygons: KeptArea) -> Config:
    """The same show with a site of these areas."""
    return config.fenced(PolygonFence(polygons))
