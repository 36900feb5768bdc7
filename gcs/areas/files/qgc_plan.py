"""Sites as geofences of QGroundControl's .plan files: polygons and circles, latitude first. Pure.

A polygon has `inclusion`, `polygon` and `version`, a circle has `circle` with `center` and `radius`. Kinds,
names and heights stand under a key of ours, which QGroundControl ignores, and drops when it writes.
Source: QGroundControl, `GeoFenceController.cc` and the page "Plan File Format" of its developer guide.
"""

import json
from math import cos, pi, radians, sin
from typing import Final

import numpy as np

from gcs.areas.files.reading import (
    AREAS_READ_MAX,
    CORNERS_READ_MAX,
    DEGREES_MAX,
    Heights,
    ReadArea,
    named,
    parsed_once,
    site_of,
)
from gcs.areas.site import (
    INSIDE,
    NAME_MAX,
    AreaKind,
    FlightSite,
    GeodeticCorner,
    SiteArea,
    frame_at,
)
from gcs.model.errors import SiteError
from gcs.model.json_values import Value

OURS: Final = "formation-gcs"
TEXT_MAX: Final = 1000
CIRCLE_CORNERS: Final = 16
"""Corners of a polygon in place of a circle: within it where vehicles stay inside, else around it."""

RADIUS_MAX_M: Final = 10_000.0
VERSION: Final = 1


def read(data: bytes, file: str, heights: Heights) -> FlightSite:
    """Read the geofence of a plan. Raises: SiteError that names file, polygon and corner."""
    document = parsed_once(data, file)
    if document.need("fileType").raw != "Plan":
        raise document.need("fileType").wrong("a plan, 'Plan',")
    fence = document.need("geoFence")
    areas = [_polygon(polygon) for polygon in _entries(fence, "polygons")]
    areas += [_circle(circle) for circle in _entries(fence, "circles")]
    if not areas:
        raise SiteError(fence.place, "it has neither polygons nor circles: draw them under Plan, GeoFence")
    name = _ours(fence, "name")
    title = file.rpartition("/")[2].rpartition(".")[0] if name is None else name.text(TEXT_MAX)
    return site_of(file, title[:NAME_MAX], _with_kinds(areas, file), heights)


def _entries(fence: Value, key: str) -> list[Value]:
    entries = fence.get(key)
    return [] if entries is None else list(entries.values(AREAS_READ_MAX))


def _ours(value: Value, key: str) -> Value | None:
    inside = value.get(OURS)
    return None if inside is None else inside.get(key)


def _polygon(polygon: Value) -> ReadArea:
    corners = [_corner(place) for place in polygon.need("polygon").values(CORNERS_READ_MAX)]
    return _read_area(polygon, tuple(corners))


def _read_area(entry: Value, corners: tuple[GeodeticCorner, ...]) -> ReadArea:
    kind, name = _ours(entry, "kind"), _ours(entry, "name")
    least, greatest = _ours(entry, "height_min_m"), _ours(entry, "height_max_m")
    keeps_in = _keeps_in(entry)
    area = ReadArea(
        entry.path,
        "" if kind is None else kind.text(TEXT_MAX),
        "" if name is None else name.text(TEXT_MAX),
        corners,
        None if least is None else least.number(-DEGREES_MAX, DEGREES_MAX),
        None if greatest is None else greatest.number(-DEGREES_MAX, DEGREES_MAX),
    )
    if area.kind and (area.kind in set(INSIDE)) != keeps_in:
        raise SiteError(f"{entry.place}.inclusion", f"{str(keeps_in).lower()}, but its kind is {area.kind}")
    return area if area.kind or keeps_in else named(area, AreaKind.NO_FLY)


def _keeps_in(entry: Value) -> bool:
    inclusion = entry.need("inclusion")
    if not isinstance(inclusion.raw, bool):
        raise inclusion.wrong("true or false")
    return inclusion.raw


def _circle(circle: Value) -> ReadArea:
    inside = circle.need("circle")
    centre = _corner(inside.need("center"))
    radius_m = inside.need("radius").number(1.0, RADIUS_MAX_M)
    if not (abs(centre[0]) <= 90.0 and abs(centre[1]) <= 180.0):
        raise inside.need("center").wrong("[latitude, longitude] in degrees")
    reach_m = radius_m if _keeps_in(circle) else radius_m / cos(pi / CIRCLE_CORNERS)
    frame = frame_at(centre)
    angles = [2.0 * pi * at / CIRCLE_CORNERS for at in range(CIRCLE_CORNERS)]
    ring_m = np.array([[reach_m * cos(angle), reach_m * sin(angle), 0.0] for angle in angles])
    latitude, longitude, _ = frame.geodetic(ring_m)
    return _read_area(circle, tuple(zip(latitude.tolist(), longitude.tolist(), strict=True)))


def _corner(place: Value) -> GeodeticCorner:
    numbers = [number.number(-DEGREES_MAX, DEGREES_MAX) for number in place.values(3)]
    if len(numbers) < 2:
        raise place.wrong("[latitude, longitude]")
    return numbers[0], numbers[1]


def _with_kinds(areas: list[ReadArea], file: str) -> list[ReadArea]:
    """Name inclusions that have no kind by their sizes: the smallest is the flight geography."""
    nameless = [area for area in areas if not area.kind]
    free = [kind for kind in INSIDE if all(area.kind != kind for area in areas)]
    if len(nameless) > len(free):
        text = f"{len(nameless)} inclusions without a kind: at most {len(free)}, which lie inside each other"
        raise SiteError(f"{file}: {nameless[-1].place}", text)
    in_order = sorted(nameless, key=lambda area: _size_m2(area.corners))
    kind_at = {id(area): kind for area, kind in zip(in_order, free, strict=False)}
    return [named(area, kind_at[id(area)]) if id(area) in kind_at else area for area in areas]


def _size_m2(corners: tuple[GeodeticCorner, ...]) -> float:
    """Size of a ring in square degrees, scaled at its first corner: for comparison only."""
    twice = sum(
        latitude * next_longitude - next_latitude * longitude
        for (latitude, longitude), (next_latitude, next_longitude) in zip(
            corners, (*corners[1:], *corners[:1]), strict=True
        )
    )
    return abs(twice) * cos(radians(corners[0][0])) if corners else 0.0


def write(site: FlightSite) -> bytes:
    """The site as a plan without a mission; its home is inside the flight geography."""
    latitude, longitude = site.middle
    document = {
        "fileType": "Plan",
        "geoFence": {
            "circles": [],
            "polygons": [_written(area) for area in site.areas],
            "version": 2,
            OURS: {"name": site.name},
        },
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": 15,
            "firmwareType": 12,
            "globalPlanAltitudeMode": 1,
            "hoverSpeed": 5,
            "items": [],
            "plannedHomePosition": [latitude, longitude, 0],
            "vehicleType": 2,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": VERSION,
    }
    return (json.dumps(document, indent=1, ensure_ascii=False) + "\n").encode()


def _written(area: SiteArea) -> dict[str, object]:
    ours: dict[str, object] = {"kind": str(area.kind), "name": area.name, "height_min_m": area.height_min_m}
    if area.height_max_m is not None:
        ours["height_max_m"] = area.height_max_m
    return {
        "inclusion": area.kind in INSIDE,
        "polygon": [list(corner) for corner in area.corners],
        "version": VERSION,
        OURS: ours,
    }
