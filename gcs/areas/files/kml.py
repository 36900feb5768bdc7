"""Sites as KML 2.2: one polygon for each placemark, longitude first. Pure.

Kind and heights stand in ExtendedData; where they are missing, the placemark's name says the kind, and an
altitude relative to the ground that all corners share is the greatest height. Source: OGC 07-147r2.
"""

from collections.abc import Iterator, Mapping
from typing import Final
from xml.sax.saxutils import escape, quoteattr

from gcs.areas.files.reading import (
    AREAS_READ_MAX,
    CORNERS_READ_MAX,
    DEGREES_MAX,
    Heights,
    ReadArea,
    site_of,
    without_last,
)
from gcs.areas.files.xml_tree import Element, parsed_xml
from gcs.areas.site import NAME_MAX, AreaKind, FlightSite, SiteArea
from gcs.model.errors import SiteError, cut

OTHER_SHAPES: Final = ("Point", "LineString", "LinearRing", "MultiGeometry", "Model", "Track", "MultiTrack")
COLOURS: Final = {  # aabbggrr
    AreaKind.FLIGHT_GEOGRAPHY: "6600c000",
    AreaKind.CONTINGENCY: "4d00d7ff",
    AreaKind.GROUND_RISK: "4d0050ff",
    AreaKind.AUDIENCE: "66ff9000",
    AreaKind.NO_FLY: "660000c0",
}


def read(data: bytes, file: str, heights: Heights) -> FlightSite:
    """Read a site. Raises: SiteError that names file, line and corner."""
    root = parsed_xml(data, file).child("kml")
    if root is None:
        raise SiteError(file, "its outermost element is not <kml>: export it as KML")
    if link := next(root.everywhere("NetworkLink"), None):
        text = "a NetworkLink leads to another file: save the areas themselves in this one"
        raise SiteError(f"{file}: line {link.line}", text)
    placemarks = list(root.everywhere("Placemark"))
    if len(placemarks) > AREAS_READ_MAX:
        raise SiteError(file, f"{len(placemarks)} placemarks: at most {AREAS_READ_MAX}")
    name = root.text_of("Document", "name") or file.rpartition("/")[2].rpartition(".")[0]
    return site_of(file, name[:NAME_MAX], [_area(each, file) for each in placemarks], heights)


def _area(placemark: Element, file: str) -> ReadArea:
    name = placemark.text_of("name")
    place = f"line {placemark.line}, placemark '{cut(name)}'"
    polygons = list(placemark.children("Polygon"))
    other = [shape for shape in OTHER_SHAPES if placemark.child(shape) is not None]
    if len(polygons) != 1 or other:
        has = ", ".join(other) or f"{len(polygons)} polygons"
        raise SiteError(
            f"{file}: {place}", f"it has {has}: one Polygon is needed; remove it, or draw it as one"
        )
    polygon = polygons[0]
    if polygon.child("innerBoundaryIs") is not None:
        raise SiteError(
            f"{file}: {place}", "it has a hole: draw that as a placemark of its own, of kind no-fly"
        )
    outlines = [ring for each in polygon.children("outerBoundaryIs") for ring in each.children("LinearRing")]
    if len(outlines) > 1:
        raise SiteError(f"{file}: {place}", f"it has {len(outlines)} outlines: one is needed")
    ring = polygon.text_of("outerBoundaryIs", "LinearRing", "coordinates")
    places = list(_coordinates(ring, f"{file}: {place}"))
    least_m, greatest_m = (
        _height_m(placemark, key, f"{file}: {place}") for key in ("height_min_m", "height_max_m")
    )
    if least_m is None and greatest_m is None and polygon.text_of("altitudeMode") == "relativeToGround":
        greatest_m = _common([altitude_m for _, _, altitude_m in places])
    corners = without_last(f"{file}: {place}", [(latitude, longitude) for longitude, latitude, _ in places])
    return ReadArea(place, _data(placemark, "kind"), name, corners, least_m, greatest_m)


def _coordinates(text: str, place: str) -> Iterator[tuple[float, float, float | None]]:
    """Longitude, latitude and altitude of each corner."""
    tuples = text.split()
    if len(tuples) > CORNERS_READ_MAX:
        raise SiteError(place, f"{len(tuples)} corners: at most {CORNERS_READ_MAX}")
    for number, written in enumerate(tuples, 1):
        parts = written.split(",")
        numbers = [_number(part) for part in parts if part]
        if not 2 <= len(numbers) <= 3 or len(numbers) != len(parts) or None in numbers:
            text = f"coordinates, corner {number}: '{cut(written)}' is not longitude,latitude,altitude"
            raise SiteError(place, text)
        longitude, latitude, *altitude_m = (number or 0.0 for number in numbers)
        yield longitude, latitude, altitude_m[0] if altitude_m else None


def _number(text: str) -> float | None:
    """A finite number within reach; None: it is none."""
    try:
        number = float(text)
    except ValueError:
        return None
    return number if abs(number) <= DEGREES_MAX else None


def _common(altitudes_m: list[float | None]) -> float | None:
    """The altitude that all share; None: they differ, or lie on the ground."""
    return altitudes_m[0] if len(set(altitudes_m)) == 1 and altitudes_m[0] else None


def _data(placemark: Element, key: str) -> str:
    extended = placemark.child("ExtendedData")
    if extended is None:
        return ""
    values = [
        data.text_of("value") for data in extended.children("Data") if data.attributes.get("name") == key
    ]
    return values[0] if values else ""


def _height_m(placemark: Element, key: str, place: str) -> float | None:
    extended = placemark.child("ExtendedData")
    given = () if extended is None else extended.children("Data")
    if sum(data.attributes.get("name") == key for data in given) > 1:
        raise SiteError(place, f"{key} is there twice: leave one of them out")
    written = _data(placemark, key)
    if not written:
        return None
    height_m = _number(written)
    if height_m is None:
        raise SiteError(place, f"{key} = '{cut(written)}': a number of metres is needed")
    return height_m


def write(site: FlightSite) -> bytes:
    """The site as a file in UTF-8."""
    return with_data(site, {})


def with_data(site: FlightSite, about: Mapping[str, str]) -> bytes:
    """The same, with further data about the whole, by name."""
    styles = "".join(
        f'  <Style id="{kind}"><LineStyle><width>2</width></LineStyle>'
        f"<PolyStyle><color>{colour}</color></PolyStyle></Style>\n"
        for kind, colour in COLOURS.items()
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<kml xmlns="http://www.opengis.net/kml/2.2">\n <Document>\n'
        f"  <name>{escape(site.name)}</name>\n{styles}{_extended(about)}"
        f"{''.join(map(_placemark, site.areas))}"
        " </Document>\n</kml>\n"
    ).encode()


def _extended(values: Mapping[str, str]) -> str:
    data = "".join(
        f"<Data name={quoteattr(key)}><value>{escape(value)}</value></Data>" for key, value in values.items()
    )
    return f"  <ExtendedData>{data}</ExtendedData>\n" if values else ""


def _placemark(area: SiteArea) -> str:
    heights = {"height_min_m": repr(area.height_min_m)}
    if area.height_max_m is not None:
        heights["height_max_m"] = repr(area.height_max_m)
    data = _extended({"kind": str(area.kind), **heights})
    top = repr(area.height_max_m or 0.0)
    ring = " ".join(
        f"{longitude!r},{latitude!r},{top}" for latitude, longitude in (*area.corners, area.corners[0])
    )
    shape = "<extrude>1</extrude><altitudeMode>relativeToGround</altitudeMode>" if area.height_max_m else ""
    return (
        f"  <Placemark>\n   <name>{escape(area.name)}</name><styleUrl>#{area.kind}</styleUrl>\n"
        f"{data}"
        f"   <Polygon>{shape}<outerBoundaryIs><LinearRing><coordinates>{ring}</coordinates></LinearRing>"
        "</outerBoundaryIs></Polygon>\n  </Placemark>\n"
    )
