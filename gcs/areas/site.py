"""The site of a flight: areas on the globe with heights, checked where they are made. Pure.

A ring is kept counterclockwise seen from above (RFC 7946), its first corner once. Heights are above the
origin of the show frame. shapely judges the shapes; nothing here runs in a tick.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from hashlib import sha256
from itertools import combinations, pairwise
from math import cos, hypot, inf, isfinite, radians
from typing import Final, TypeAlias

import numpy as np
from pydantic import ConfigDict
from shapely import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from gcs.model.errors import UNSEEN_IN_LINE, SiteError, cut
from gcs.model.frames import ShowFrame
from gcs.model.state import Array
from gcs.safety.fenced_areas import PASSES_M

GeodeticCorner: TypeAlias = tuple[float, float]
"""Latitude and longitude in degrees."""

AS_SETTINGS: Final = ConfigDict(extra="forbid", use_attribute_docstrings=True)
"""Sites are part of configurations."""

AREAS_MAX: Final = 12
"""Areas of a site. The safety filter keeps more: those of a drawing are added."""

CORNERS_MAX: Final = 60
VERTICES_MAX: Final = 64
"""Corners of all areas that are sent to the autopilots: PX4 keeps no more."""

NAME_MAX: Final = 60
SIDE_MIN_M: Final = 0.1
AREA_MIN_M2: Final = 25.0
EXTENT_MAX_M: Final = 20_000.0
"""A site is flat; it reaches no farther from its first corner."""

LATITUDE_MAX_DEG: Final = 85.0
HEIGHT_RANGE_M: Final = (-500.0, 10_000.0)
NEARLY_M: Final = 0.02
"""Corners of files are rounded to centimetres."""

PROBLEMS_NAMED: Final = 12


class AreaKind(StrEnum):
    """What an area of a site is for, in the words of SORA."""

    FLIGHT_GEOGRAPHY = "flight-geography"
    """Where the flight is planned: vehicles stay inside."""
    CONTINGENCY = "contingency"
    """The contingency volume: what may be reached when something goes wrong, before the flight is ended."""
    GROUND_RISK = "ground-risk"
    """The ground risk buffer: where vehicles may fall, and only people who take part are."""
    AUDIENCE = "audience"
    """Where people stand: vehicles stay outside."""
    NO_FLY = "no-fly"
    """Vehicles stay outside."""


INSIDE: Final = (AreaKind.FLIGHT_GEOGRAPHY, AreaKind.CONTINGENCY, AreaKind.GROUND_RISK)
"""Each contains those before it."""

OUTSIDE: Final = (AreaKind.AUDIENCE, AreaKind.NO_FLY)
WITH_HEIGHT: Final = (AreaKind.FLIGHT_GEOGRAPHY, AreaKind.CONTINGENCY)
"""They are volumes: a greatest height is needed."""


@dataclass(frozen=True, slots=True)
class SiteArea:
    """A polygon with heights; `FlightSite` checks it."""

    __pydantic_config__ = AS_SETTINGS

    kind: AreaKind
    """What it is for."""
    name: str
    """For people."""
    corners: tuple[GeodeticCorner, ...]
    """Latitude and longitude of each, in degrees, in order."""
    height_min_m: float = 0.0
    """Least height above the origin of the show frame, in m."""
    height_max_m: float | None = None
    """Greatest height above the origin, in m; null: without a limit."""

    @property
    def top_m(self) -> float:
        return inf if self.height_max_m is None else self.height_max_m

    @property
    def label(self) -> str:
        return f"{self.kind} '{cut(self.name)}'"


@dataclass(frozen=True)
class FlightSite:
    """A whole site.

    Raises: SiteError with everything that is wrong with its areas.
    """

    __pydantic_config__ = AS_SETTINGS

    name: str
    """For people."""
    areas: tuple[SiteArea, ...]
    """The flight geography at least."""

    def __post_init__(self) -> None:
        areas = self.areas
        problems = [*_name_problems("the site", self.name), *_count_problems(areas)]
        for number, area in enumerate(areas, 1):
            problems += [f"area {number}, {area.label}: {text}" for text in _area_problems(area)]
        if not problems:
            problems = [*_relations(areas)]
        if problems:
            raise SiteError(f"site '{cut(self.name)}'", *problems[:PROBLEMS_NAMED])
        object.__setattr__(self, "areas", tuple(map(_normalised, areas)))

    def of(self, *kinds: AreaKind) -> tuple[SiteArea, ...]:
        """Its areas of these kinds, in the order of the kinds."""
        return tuple(area for kind in kinds for area in self.areas if area.kind is kind)

    @property
    def flight_geography(self) -> SiteArea:
        return self.of(AreaKind.FLIGHT_GEOGRAPHY)[0]

    @property
    def contingency_top_m(self) -> float:
        """How high its contingency volume reaches above the origin; inf: none is drawn."""
        return max((area.top_m for area in self.of(AreaKind.CONTINGENCY)), default=inf)

    @property
    def fenced(self) -> tuple[SiteArea, ...]:
        """What vehicles are kept in and out of by the safety filter."""
        return self.of(AreaKind.FLIGHT_GEOGRAPHY, *OUTSIDE)

    @property
    def uploaded(self) -> tuple[SiteArea, ...]:
        """What the autopilots keep by themselves: the outer line of the flight, and what it leaves out.

        Their polygons have no heights: what may be flown over or under is left to the safety filter.
        """
        return tuple(_sent(self.areas))

    @cached_property
    def digest(self) -> str:
        """SHA-256, hexadecimal, of kinds, corners and heights: not of names, nor of the file's format.

        Corners count in 1e-7 degrees and heights in centimetres, as autopilots receive them.
        """
        content = sorted(
            [str(area.kind), _from_least(_whole(area.corners)), _whole_cm(area)] for area in self.areas
        )
        return sha256(json.dumps(content).encode()).hexdigest()

    @property
    def middle(self) -> GeodeticCorner:
        """A place inside the flight geography."""
        frame = frame_at(self.flight_geography.corners[0])
        point = polygon_m(frame, self.flight_geography).representative_point()
        latitude, longitude, _ = frame.geodetic(np.array([[point.x, point.y, 0.0]]))
        return round(float(latitude[0]), 7), round(float(longitude[0]), 7)


def frame_at(corner: GeodeticCorner) -> ShowFrame:
    """A frame in which areas near that corner are measured: x is north."""
    return ShowFrame(corner[0], corner[1], 0.0)


def corners_m(frame: ShowFrame, area: SiteArea) -> Array:
    """(k, 2) x and y of the corners, to a millimetre, in a show frame."""
    latitude, longitude = np.array(area.corners).T
    place_m = frame.position_m(latitude, longitude, np.full(len(latitude), frame.altitude_amsl_m))
    return np.round(place_m[:, :2], 3)


def polygon_m(frame: ShowFrame, area: SiteArea) -> Polygon:
    """The polygon in a show frame."""
    return Polygon(corners_m(frame, area))


def _normalised(area: SiteArea) -> SiteArea:
    """The same with its ring counterclockwise seen from above, from its first corner on."""
    ring = area.corners
    twice = sum(
        (lon + next_lon) * (next_lat - lat)
        for (lat, lon), (next_lat, next_lon) in zip(ring, (*ring[1:], *ring[:1]), strict=True)
    )
    return replace(area, corners=(ring[0], *ring[:0:-1])) if twice < 0.0 else area


def _whole(corners: Sequence[GeodeticCorner]) -> list[list[int]]:
    return [[round(1e7 * latitude), round(1e7 * longitude)] for latitude, longitude in corners]


def _whole_cm(area: SiteArea) -> list[int]:
    heights_m = [area.height_min_m] + ([] if area.height_max_m is None else [area.height_max_m])
    return [round(100.0 * height_m) for height_m in heights_m]


def _from_least(ring: list[list[int]]) -> list[list[int]]:
    """The same ring, from its least corner on."""
    first = ring.index(min(ring))
    return ring[first:] + ring[:first]


# what is wrong with one area


def _name_problems(what: str, name: str) -> Iterator[str]:
    if not 0 < len(name) <= NAME_MAX or UNSEEN_IN_LINE.search(name):
        yield f"name '{cut(name)}' of {what}: 1 to {NAME_MAX} characters on one line are needed"


def _count_problems(areas: Sequence[SiteArea]) -> Iterator[str]:
    if len(areas) > AREAS_MAX:
        yield f"{len(areas)} areas: at most {AREAS_MAX}"
    for kind in INSIDE:
        count = sum(area.kind is kind for area in areas)
        if count > 1:
            yield f"{count} areas of kind {kind}: draw one polygon around them"
    if not any(area.kind is AreaKind.FLIGHT_GEOGRAPHY for area in areas):
        yield f"no area of kind {AreaKind.FLIGHT_GEOGRAPHY}: a site says where vehicles fly"


def _area_problems(area: SiteArea) -> list[str]:
    problems = [*_name_problems("the area", area.name), *_height_problems(area), *_corner_problems(area)]
    return problems or [*_shape_problems(area)]


def _height_problems(area: SiteArea) -> Iterator[str]:
    low_m, high_m = HEIGHT_RANGE_M
    for key in ("height_min_m", "height_max_m"):
        value_m = getattr(area, key)
        if value_m is None:
            if area.kind in WITH_HEIGHT:
                yield f"{key} is missing: a {area.kind} has a greatest height above the origin, in m"
        elif not low_m <= value_m <= high_m:
            yield f"{key} = {value_m:g}: from {low_m:g} to {high_m:g} m above the origin"
    if area.top_m <= area.height_min_m:
        yield f"height_max_m = {area.top_m:g}: above height_min_m = {area.height_min_m:g}"


def _corner_problems(area: SiteArea) -> Iterator[str]:
    ring = area.corners
    if not 3 <= len(ring) <= CORNERS_MAX:
        yield f"{len(ring)} corners: 3 to {CORNERS_MAX} are possible"
        return
    for number, (latitude, longitude) in enumerate(ring, 1):
        if text := _place_problem(latitude, longitude):
            yield f"corner {number}: {text}"
            return
    longitudes = [longitude for _, longitude in ring]
    if max(longitudes) - min(longitudes) > 180.0:
        text = f"its longitudes are from {min(longitudes):g} to {max(longitudes):g}"
        yield f"it crosses the antimeridian ({text}): draw it on one side of 180 degrees"
        return
    yield from _distance_problems(ring)


def _place_problem(latitude: float, longitude: float) -> str:
    """What is wrong with a place; empty: nothing."""
    if not (isfinite(latitude) and isfinite(longitude)):
        return f"latitude {latitude}, longitude {longitude}: finite degrees are needed"
    if abs(latitude) > 90.0 and abs(latitude) <= 180.0 and abs(longitude) <= 90.0:
        orders = "GeoJSON and KML have the longitude first, QGroundControl the latitude"
        return f"latitude {latitude:g} is beyond 90: latitude and longitude are swapped; {orders}"
    if abs(latitude) > 90.0 or abs(longitude) > 180.0:
        return f"latitude {latitude:g}, longitude {longitude:g}: at most 90 and 180 degrees"
    if abs(latitude) > LATITUDE_MAX_DEG:
        return f"latitude {latitude:g}: no site is nearer to a pole than {LATITUDE_MAX_DEG:g} degrees"
    return ""


def _distance_problems(ring: Sequence[GeodeticCorner]) -> Iterator[str]:
    """What is wrong with distances between corners of valid degrees."""
    for number, corner in enumerate(ring[1:], 2):
        away_m = _apart_m(ring[0], corner)
        if away_m > EXTENT_MAX_M:
            near_m = _apart_m(ring[0], corner[::-1])
            swapped = "; latitude and longitude are swapped" if near_m < min(EXTENT_MAX_M, away_m) else ""
            yield (
                f"corner {number} is {away_m / 1000.0:.0f} km from corner 1: at most"
                f" {EXTENT_MAX_M / 1000.0:g} km{swapped}"
            )
            return
    for number, (corner, following) in enumerate(zip(ring, (*ring[1:], *ring[:1]), strict=True), 1):
        if _apart_m(corner, following) < SIDE_MIN_M:
            after = number % len(ring) + 1
            yield f"corners {number} and {after} are the same place: leave one of them out"


def _apart_m(here: GeodeticCorner, there: GeodeticCorner) -> float:
    """How far two places are apart, on a sphere, for places near each other; far ones: roughly."""
    meridian_m = 111_320.0
    return meridian_m * hypot(there[0] - here[0], (there[1] - here[1]) * cos(radians(here[0])))


def _shape_problems(area: SiteArea) -> Iterator[str]:
    frame = frame_at(area.corners[0])
    shape, ring_m = polygon_m(frame, area), corners_m(frame, area).tolist()
    if not shape.is_valid:
        crossed = _crossing(ring_m)
        yield f"its sides cross or touch each other{crossed}: give it a simple outline"
    elif shape.area < AREA_MIN_M2:
        yield f"it has {shape.area:.1f} m^2: at least {AREA_MIN_M2:g} m^2"


def _crossing(ring_m: list[list[float]]) -> str:
    """Name the first two sides that meet where they must not, by their corners."""
    count = len(ring_m)
    sides = [LineString([ring_m[at], ring_m[(at + 1) % count]]) for at in range(count)]
    for one, other in combinations(range(count), 2):
        neighbours = other - one in {1, count - 1}
        if neighbours:
            meets = sides[one].intersection(sides[other]).length > 0.0
        else:
            meets = sides[one].intersects(sides[other])
        if meets:
            first, second = (f"{at + 1}-{(at + 1) % count + 1}" for at in (one, other))
            return f", side {first} and side {second}"
    return ""


# what is wrong between areas


def _relations(areas: Sequence[SiteArea]) -> Iterator[str]:
    first = areas[0].corners[0]
    if far := next((area for area in areas if _apart_m(first, area.corners[0]) > EXTENT_MAX_M), None):
        away_m = _apart_m(first, far.corners[0])
        text = f"{far.label} is {away_m / 1000.0:.0f} km from {areas[0].label}"
        yield f"{text}: at most {EXTENT_MAX_M / 1000.0:g} km"
        return
    frame = frame_at(first)
    shapes = [(area, polygon_m(frame, area)) for area in areas]
    nested = [each for kind in INSIDE for each in shapes if each[0].kind is kind]
    for (inner, small), (outer, large) in pairwise(nested):
        yield from _not_within(inner, small, outer, large)
    yield from _over_people(shapes, nested)
    yield from _nowhere_to_fly(shapes)
    uploaded = sum(len(area.corners) for area in _sent(areas))
    if uploaded > VERTICES_MAX:
        text = f"{uploaded} corners in all go to the autopilots: at most {VERTICES_MAX}, the most of PX4"
        yield f"{text}; leave corners out of {max(_sent(areas), key=lambda area: len(area.corners)).label}"


def _sent(areas: Sequence[SiteArea]) -> list[SiteArea]:
    """As `FlightSite.uploaded`."""
    fly = next(area for area in areas if area.kind is AreaKind.FLIGHT_GEOGRAPHY)
    within = [area for area in areas if area.kind is AreaKind.CONTINGENCY] or [fly]
    return [
        *within,
        *(
            area
            for kind in OUTSIDE
            for area in areas
            if area.kind is kind
            and area.top_m > fly.top_m - PASSES_M
            and area.height_min_m < fly.height_min_m + PASSES_M
        ),
    ]


def _not_within(inner: SiteArea, small: Polygon, outer: SiteArea, large: Polygon) -> Iterator[str]:
    out = small.difference(large.buffer(NEARLY_M))
    if not out.is_empty:
        over_m, number = _farthest(small, large)
        text = f"{inner.label} reaches {over_m:.1f} m out of {outer.label} at its corner {number}"
        yield f"{text}: it must lie inside"
    if inner.top_m > outer.top_m:
        text = f"{inner.label} is {inner.top_m:g} m high, {outer.label} only {outer.top_m:g} m"
        yield f"{text}: it must lie inside"
    if outer.kind is AreaKind.CONTINGENCY and inner.height_min_m < outer.height_min_m:
        text = f"{inner.label} begins at {inner.height_min_m:g} m, {outer.label} at {outer.height_min_m:g} m"
        yield f"{text}: it must lie inside"


def _farthest(small: Polygon, large: Polygon) -> tuple[float, int]:
    """How far `small` reaches out of `large`, and its corner that is farthest out, or nearest to that."""
    out = small.difference(large)
    ring = [Point(place) for place in list(small.exterior.coords)[:-1]]
    away_m = [large.distance(corner) for corner in ring]
    if max(away_m) > 0.0:
        worst = int(np.argmax(away_m))
        return away_m[worst], worst + 1
    nearest = int(np.argmin([out.distance(corner) for corner in ring]))
    return max(large.boundary.distance(Point(place)) for part in _parts(out) for place in part), nearest + 1


def _parts(shape: BaseGeometry) -> list[list[tuple[float, ...]]]:
    """The outlines of all polygons of a shape."""
    parts = getattr(shape, "geoms", [shape])
    return [list(part.exterior.coords) for part in parts if isinstance(part, Polygon)]


def _over_people(
    shapes: Sequence[tuple[SiteArea, Polygon]], nested: Sequence[tuple[SiteArea, Polygon]]
) -> Iterator[str]:
    """Yield audiences that lie in what may be flown over, or fallen on."""
    for area, people in shapes:
        if area.kind is not AreaKind.AUDIENCE:
            continue
        for outer, shape in nested[-1:]:
            common = people.intersection(shape.buffer(-NEARLY_M))
            if not common.is_empty:
                text = f"{area.label} has {common.area:.0f} m^2 in common with {outer.label}"
                yield f"{text}: an audience lies outside; draw {outer.label} round it"


def _nowhere_to_fly(shapes: Sequence[tuple[SiteArea, Polygon]]) -> Iterator[str]:
    fly = next(shape for area, shape in shapes if area.kind is AreaKind.FLIGHT_GEOGRAPHY)
    closed = unary_union([shape for area, shape in shapes if area.kind is AreaKind.NO_FLY])
    if fly.difference(closed).is_empty:
        yield "the areas of kind no-fly cover the whole flight geography"
