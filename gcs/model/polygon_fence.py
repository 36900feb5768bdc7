"""Fences of polygons as autopilots keep them: areas by latitude and longitude, without heights. Pure."""

from dataclasses import dataclass
from math import cos, hypot, inf, isfinite, radians
from typing import Final, TypeAlias

from gcs.model.errors import InvalidError

Corner: TypeAlias = tuple[float, float]
"""Latitude and longitude, degrees."""

CORNERS_MIN: Final = 3
WIDEST_DEG: Final = 1.0
"""Of a polygon: also keeps it on one side of the antimeridian."""

M_PER_DEG: Final = 111_319.5


@dataclass(frozen=True, slots=True)
class KeptArea:
    """One area that vehicles stay in, or stay out of. Its corners in either direction, the last one open."""

    inclusion: bool
    corners_deg: tuple[Corner, ...]

    def __post_init__(self) -> None:
        """Raises: InvalidError."""
        if len(self.corners_deg) < CORNERS_MIN:
            raise InvalidError("corners_deg", len(self.corners_deg), f"at least {CORNERS_MIN} corners")
        for latitude_deg, longitude_deg in self.corners_deg:
            if not (isfinite(latitude_deg) and isfinite(longitude_deg)):
                raise InvalidError("corners_deg", (latitude_deg, longitude_deg), "finite numbers")
            if abs(latitude_deg) > 90.0 or abs(longitude_deg) > 180.0:
                at = (latitude_deg, longitude_deg)
                raise InvalidError("corners_deg", at, "a latitude up to 90, a longitude up to 180 degrees")
        for values_deg in zip(*self.corners_deg, strict=True):
            wide_deg = max(values_deg) - min(values_deg)
            if wide_deg > WIDEST_DEG:
                raise InvalidError("corners_deg", wide_deg, f"an area at most {WIDEST_DEG:g} degrees wide")

    def contains(self, at_deg: Corner) -> bool:
        """Whether the place is inside, by the count of edges that a line from it crosses."""
        latitude_deg, longitude_deg = at_deg
        inside = False
        before = self.corners_deg[-1]
        for corner in self.corners_deg:
            if (corner[1] >= longitude_deg) != (before[1] >= longitude_deg):
                share = (longitude_deg - corner[1]) / (before[1] - corner[1])
                inside ^= latitude_deg <= corner[0] + share * (before[0] - corner[0])
            before = corner
        return inside

    def edge_m(self, at_deg: Corner) -> float:
        """Distance of the place from the nearest edge, on a plane."""
        per_deg = M_PER_DEG, M_PER_DEG * cos(radians(at_deg[0]))
        corners_m = [
            ((latitude - at_deg[0]) * per_deg[0], (longitude - at_deg[1]) * per_deg[1])
            for latitude, longitude in self.corners_deg
        ]
        nearest_m, before_m = inf, corners_m[-1]
        for corner_m in corners_m:
            nearest_m = min(nearest_m, _from_origin_m(before_m, corner_m))
            before_m = corner_m
        return nearest_m


def _from_origin_m(begin_m: Corner, end_m: Corner) -> float:
    """Distance of a straight edge from (0, 0)."""
    along = end_m[0] - begin_m[0], end_m[1] - begin_m[1]
    length2 = along[0] ** 2 + along[1] ** 2
    share = 0.0 if length2 == 0.0 else -(begin_m[0] * along[0] + begin_m[1] * along[1]) / length2
    share = min(1.0, max(0.0, share))
    return hypot(begin_m[0] + share * along[0], begin_m[1] + share * along[1])


@dataclass(frozen=True, slots=True)
class PolygonFence:
    """Areas that all hold at once: inside every inclusion, outside every exclusion."""

    polygons: tuple[KeptArea, ...]

    @property
    def vertex_count(self) -> int:
        return sum(len(each.corners_deg) for each in self.polygons)

    def why_outside(self, at_deg: Corner, margin_m: float = 0.0) -> str:
        """Why a vehicle must not be at this place, nor so near to an edge, in words; empty: it may."""
        for number, polygon in enumerate(self.polygons, 1):
            kind = "the inclusion" if polygon.inclusion else "the exclusion"
            edge_m, inside = polygon.edge_m(at_deg), polygon.contains(at_deg)
            if inside != polygon.inclusion:
                side = "outside" if polygon.inclusion else "inside"
                return f"{edge_m:.1f} m {side} {kind} (polygon {number} of its fence)"
            if edge_m < margin_m:
                return f"{edge_m:.1f} m from the edge of {kind} (polygon {number} of its fence)"
        return ""
