"""Sites as GeoJSON (RFC 7946): one polygon for each feature, longitude first. Pure."""

import json
from typing import Final

from gcs.areas.files.reading import (
    AREAS_READ_MAX,
    CORNERS_READ_MAX,
    DEGREES_MAX,
    Heights,
    ReadArea,
    parsed_once,
    site_of,
    without_last,
)
from gcs.areas.site import NAME_MAX, FlightSite, GeodeticCorner, SiteArea
from gcs.model.errors import SiteError
from gcs.model.json_values import Value

TEXT_MAX: Final = 1000
WGS84: Final = ("urn:ogc:def:crs:OGC:1.3:CRS84", "urn:ogc:def:crs:EPSG::4326", "EPSG:4326")
"""Names of the only reference system, in the member `crs` of files before RFC 7946."""


def read(data: bytes, file: str, heights: Heights) -> FlightSite:
    """Read a site. Raises: SiteError that names file, feature and corner."""
    document = parsed_once(data, file)
    if document.need("type").raw != "FeatureCollection":
        raise document.need("type").wrong("a FeatureCollection, with a feature for each area,")
    _check_reference(document)
    features = document.need("features").values(AREAS_READ_MAX)
    name = document.get("name")
    title = file.rpartition("/")[2].rpartition(".")[0] if name is None else name.text(TEXT_MAX)
    return site_of(file, title[:NAME_MAX], list(map(_area, features)), heights)


def _check_reference(document: Value) -> None:
    reference = document.get("crs")
    if reference is not None:
        named = reference.need("properties").need("name")
        if named.raw not in WGS84:
            raise named.wrong("WGS 84, in degrees (CRS84),")


def _area(feature: Value) -> ReadArea:
    shape, properties = feature.need("geometry"), feature.get("properties")
    kind = shape.need("type")
    if kind.raw != "Polygon":
        raise kind.wrong("a Polygon, one for each feature,")
    rings = shape.need("coordinates")
    outlines = list(rings.values(CORNERS_READ_MAX))
    if len(outlines) != 1:
        text = f"{len(outlines)} rings, one is needed: a hole is a feature of its own, of kind no-fly"
        raise SiteError(rings.place, text)
    corners = [_corner(position) for position in outlines[0].values(CORNERS_READ_MAX)]
    return ReadArea(
        feature.path,
        _text(properties, "kind"),
        _text(properties, "name"),
        without_last(outlines[0].place, corners),
        _height_m(properties, "height_min_m"),
        _height_m(properties, "height_max_m"),
    )


def _corner(position: Value) -> GeodeticCorner:
    numbers = [number.number(-DEGREES_MAX, DEGREES_MAX) for number in position.values(3)]
    if len(numbers) < 2:
        raise position.wrong("[longitude, latitude]")
    return numbers[1], numbers[0]


def _text(properties: Value | None, key: str) -> str:
    value = None if properties is None else properties.get(key)
    return "" if value is None else value.text(TEXT_MAX)


def _height_m(properties: Value | None, key: str) -> float | None:
    value = None if properties is None else properties.get(key)
    return None if value is None else value.number(-DEGREES_MAX, DEGREES_MAX)


def write(site: FlightSite) -> bytes:
    """The site as a file in UTF-8."""
    features = [_feature(area) for area in site.areas]
    document = {"type": "FeatureCollection", "name": site.name, "features": features}
    return (json.dumps(document, indent=1, ensure_ascii=False) + "\n").encode()


def _feature(area: SiteArea) -> dict[str, object]:
    ring = [[longitude, latitude] for latitude, longitude in (*area.corners, area.corners[0])]
    heights_m = {"height_min_m": area.height_min_m}
    if area.height_max_m is not None:
        heights_m["height_max_m"] = area.height_max_m
    return {
        "type": "Feature",
        "properties": {"kind": str(area.kind), "name": area.name, **heights_m},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
