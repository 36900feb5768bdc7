"""Files of sites: what others write is read, what is wrong is refused with its place."""

import json
from pathlib import Path
from typing import Any

import pytest

from gcs.areas.files.reading import Heights
from gcs.areas.files.site_files import FORMATS, SIZE_MAX_BYTES, read_site, written
from gcs.areas.site import FlightSite
from gcs.model.errors import SiteError
from tests.support.fields import CONTINGENCY, ELL, GROUND_RISK, field, places

SITE = field(CONTINGENCY, GROUND_RISK)
RING = [[longitude, latitude] for latitude, longitude in (*places(ELL), places(ELL)[0])]
KML = (
    '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>'
    "<name>Flight geography of the field</name><Polygon>{mode}<outerBoundaryIs><LinearRing><coordinates>"
    "{ring}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>"
)


def saved(folder: Path, name: str, content: object) -> Path:
    path = folder / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def geojson(**changes: object) -> dict[str, Any]:
    properties = {"kind": "flight-geography", "name": "field", "height_max_m": 45}
    feature = {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": "Polygon", "coordinates": [RING]},
    }
    return {"type": "FeatureCollection", "features": [feature | changes]}


def plan(*polygons: dict[str, Any], circles: object = ()) -> dict[str, Any]:
    return {"fileType": "Plan", "geoFence": {"polygons": polygons, "circles": circles}, "version": 1}


def polygon(inclusion: object = True, ring: object = places(ELL)) -> dict[str, Any]:
    return {"inclusion": inclusion, "polygon": ring, "version": 1}


HEIGHT = '<Data name="height_max_m"><value>40</value></Data>'


def kml(altitude: str = ",60", mode: str = "<altitudeMode>relativeToGround</altitudeMode>") -> str:
    return KML.format(ring=" ".join(f"{lon},{lat}{altitude}" for lon, lat in RING), mode=mode)


@pytest.mark.parametrize("ending", FORMATS)
def test_each_format_returns_what_was_written(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"corner{ending}"
    path.write_bytes(written(SITE, path))
    assert read_site(path) == SITE


def test_a_kml_of_names_alone_is_understood(tmp_path: Path) -> None:
    """Google Earth knows neither kinds nor heights: the name begins with the kind, the altitude is common."""
    site = read_site(saved(tmp_path, "field.kml", kml()))
    assert site.flight_geography.top_m == 60.0
    assert site.flight_geography.corners == places(ELL)
    assert site.name == "field"


def test_a_plan_drawn_in_qgroundcontrol_is_understood(tmp_path: Path) -> None:
    """Inclusions inside each other are the kinds from the smallest on, exclusions are no-fly areas."""
    wide = CONTINGENCY.corners
    circle = {"inclusion": False, "circle": {"center": places([(0, 50)])[0], "radius": 10.0}, "version": 1}
    drawn = plan(polygon(ring=wide), polygon(), circles=[circle])
    site = read_site(saved(tmp_path, "a.plan", drawn), Heights(0.0, 50.0))
    assert [area.kind for area in site.areas] == ["contingency", "flight-geography", "no-fly"]
    assert site.flight_geography.corners == places(ELL)
    assert site.flight_geography.top_m == 50.0
    assert len(site.areas[2].corners) == 16


WRONG: dict[str, tuple[str, object, tuple[str, ...]]] = {
    "unknown ending": ("a.shp", "", ("a name that ends in .geojson, .json, .kml, .plan is needed",)),
    "too large": ("a.kml", b" " * (SIZE_MAX_BYTES + 1), ("larger than 1000000 bytes",)),
    "no json": ("a.geojson", "{", ("a.geojson: not JSON",)),
    "not utf-8": ("a.geojson", b'{"type": "\xff"}', ("a.geojson: not JSON",)),
    "deep json": ("a.geojson", "[" * 1000, ("nested deeper than 32 levels",)),
    "no collection": ("a.geojson", {"type": "Polygon"}, ("a.geojson: type", "FeatureCollection")),
    "another reference": (
        "a.geojson",
        geojson() | {"crs": {"properties": {"name": "EPSG:2056"}}},
        ("crs.properties.name", "EPSG:2056", "WGS 84"),
    ),
    "a line": (
        "a.geojson",
        geojson(geometry={"type": "LineString", "coordinates": RING}),
        ("features[0].geometry.type", "LineString", "a Polygon, one for each feature"),
    ),
    "a hole": (
        "a.geojson",
        geojson(geometry={"type": "Polygon", "coordinates": [RING, RING]}),
        ("features[0].geometry.coordinates: 2 rings", "a hole is a feature of its own"),
    ),
    "an open ring": (
        "a.geojson",
        geojson(geometry={"type": "Polygon", "coordinates": [RING[:-1]]}),
        ("coordinates[0]: a ring of 6 corners", "repeat the first at the end"),
    ),
    "a word for a number": (
        "a.geojson",
        geojson(geometry={"type": "Polygon", "coordinates": [[["8.5", 47.3]]]}),
        ("features[0].geometry.coordinates[0][0][0]: '8.5'", "a number"),
    ),
    "no kind": (
        "a.geojson",
        geojson(properties={"name": "meadow"}),
        ("features[0]: neither a kind nor", "'meadow'", "flight-geography, contingency"),
    ),
    "unknown kind": ("a.geojson", geojson(properties={"kind": "zone"}), ("kind 'zone': one of flight-",)),
    "no xml": ("a.kml", "<kml><Document>", ("a.kml: line 1: not XML",)),
    "no kml": ("a.kml", "<gpx/>", ("its outermost element is not <kml>",)),
    "a bomb": (
        "a.kml",
        '<!DOCTYPE k [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><kml>&b;</kml>',
        ("a document type (<!DOCTYPE) is not read",),
    ),
    "deep xml": ("a.kml", "<a>" * 1000, ("20000 elements, or 32 levels",)),
    "many elements": ("a.kml", f"<kml>{'<a/>' * 20_001}</kml>", ("more than 20000 elements",)),
    "a link": ("a.kml", "<kml><NetworkLink/></kml>", ("a NetworkLink leads to another file",)),
    "a pin": (
        "a.kml",
        "<kml><Placemark><name>gate</name><Point/></Placemark></kml>",
        ("line 1, placemark 'gate'", "it has Point: one Polygon is needed"),
    ),
    "words for coordinates": (
        "a.kml",
        kml(altitude=",high"),
        ("coordinates, corner 1", "is not longitude,latitude,altitude"),
    ),
    "a height twice": (
        "a.geojson",
        '{"type": "FeatureCollection", "features": [{"height_max_m": 40, "height_max_m": 400}]}',
        ("a.geojson: key 'height_max_m' is there twice in one object",),
    ),
    "a fence twice": (
        "a.plan",
        '{"fileType": "Plan", "geoFence": {}, "geoFence": {}}',
        ("key 'geoFence' is there twice",),
    ),
    "two outlines": (
        "a.kml",
        kml().replace("</outerBoundaryIs>", "<LinearRing/></outerBoundaryIs>"),
        ("it has 2 outlines: one is needed",),
    ),
    "a height of data twice": (
        "a.kml",
        kml().replace("<Polygon>", f"<ExtendedData>{HEIGHT * 2}</ExtendedData><Polygon>"),
        ("height_max_m is there twice",),
    ),
    "a kml without heights": ("a.kml", kml(altitude="", mode=""), ("height_max_m is missing",)),
    "another plan": ("a.plan", {"fileType": "Mission"}, ("fileType", "a plan, 'Plan'")),
    "an empty fence": ("a.plan", plan(), ("neither polygons nor circles", "Plan, GeoFence")),
    "a plan without heights": ("a.plan", plan(polygon()), ("height_max_m is missing",)),
    "no word of in or out": ("a.plan", plan(polygon(inclusion="yes")), ("polygons[0].inclusion", "true or")),
    "four inclusions": ("a.plan", plan(*[polygon()] * 4), ("4 inclusions without a kind: at most 3",)),
    "longitude first": (
        "a.plan",
        plan(polygon(ring=[[100.0 + lon, lat] for lon, lat in RING[:-1]])),
        ("corner 1: latitude 108.5", "swapped", "QGroundControl the latitude"),
    ),
    "a huge circle": (
        "a.plan",
        plan(circles=[{"inclusion": True, "circle": {"center": [47, 8], "radius": 1e9}}]),
        ("circles[0].circle.radius", "a number from 1 to 10000"),
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_file_is_refused_with_its_place(tmp_path: Path, case: str) -> None:
    name, content, words = WRONG[case]
    with pytest.raises(SiteError) as error:
        read_site(saved(tmp_path, name, content))
    assert [word for word in words if word not in str(error.value)] == [], str(error.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(SiteError, match=r"none\.kml: cannot be read: No such file"):
        read_site(tmp_path / "none.kml")


def test_an_inclusion_is_no_audience(tmp_path: Path) -> None:
    path = tmp_path / "a.plan"
    document = json.loads(written(SITE, path))
    document["geoFence"]["polygons"][1]["inclusion"] = True
    with pytest.raises(SiteError, match=r"polygons\[1\]\.inclusion: true, but its kind is audience"):
        read_site(saved(tmp_path, "a.plan", document))


def test_formats_keep_the_hash(tmp_path: Path) -> None:
    site: FlightSite = SITE
    for name in ("a.kml", "b.plan", "c.geojson"):
        path = tmp_path / name
        path.write_bytes(written(site, path))
        site = read_site(path)
        assert site.digest == SITE.digest
