"""What all readers of sites share: names that say a kind, and areas before they are checked. Pure."""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

from gcs.areas.site import AreaKind, FlightSite, GeodeticCorner, SiteArea
from gcs.model.errors import SiteError, cut
from gcs.model.json_values import Value, parsed

AREAS_READ_MAX: Final = 100
CORNERS_READ_MAX: Final = 1000
"""Read before they are counted by the site itself."""

DEGREES_MAX: Final = 1e6

_WORDS: Final = (
    (AreaKind.FLIGHT_GEOGRAPHY, r"flight[ _-]?(geography|area|volume)"),
    (AreaKind.CONTINGENCY, r"contingency([ _-]?volume)?"),
    (AreaKind.GROUND_RISK, r"ground[ _-]?risk([ _-]?buffer)?|controlled[ _-]?ground([ _-]?area)?"),
    (AreaKind.AUDIENCE, r"audience|spectators?"),
    (AreaKind.NO_FLY, r"no[ _-]?fly([ _-]?zone)?"),
)
"""How the name of an area begins that says its kind, for files that have names only."""

KINDS: Final = ", ".join(AreaKind)


@dataclass(frozen=True, slots=True)
class ReadArea:
    """An area as a file has it."""

    place: str  # in the file, for errors
    kind: str  # empty: the name says it
    name: str
    corners: tuple[GeodeticCorner, ...]
    height_min_m: float | None = None
    height_max_m: float | None = None


@dataclass(frozen=True, slots=True)
class Heights:
    """Heights of areas for which the file has none, in m above the origin."""

    min_m: float = 0.0
    max_m: float | None = None


def kind_of(area: ReadArea, file: str) -> AreaKind:
    """The kind that the file names, else the one that the area's name begins with. Raises: SiteError."""
    written = area.kind.strip().lower()
    if written:
        if written not in set(AreaKind):
            raise SiteError(f"{file}: {area.place}", f"kind '{cut(area.kind)}': one of {KINDS}")
        return AreaKind(written)
    for kind, words in _WORDS:
        if re.match(rf"({words})(?![a-z])", area.name.strip(), re.IGNORECASE):
            return kind
    text = f"neither a kind nor a name that begins with one: give '{cut(area.name)}' a kind, one of {KINDS}"
    raise SiteError(f"{file}: {area.place}", text)


def site_of(file: str, name: str, areas: Sequence[ReadArea], heights: Heights) -> FlightSite:
    """The site of these areas. Raises: SiteError with the file's name."""
    try:
        return FlightSite(name, tuple(_areas(file, areas, heights)))
    except SiteError as error:
        if error.place.startswith(f"{file}:"):
            raise
        raise SiteError(file, *error.problems) from None


def _areas(file: str, areas: Sequence[ReadArea], heights: Heights) -> Iterator[SiteArea]:
    for area in areas:
        kind = kind_of(area, file)
        least_m = heights.min_m if area.height_min_m is None else area.height_min_m
        greatest_m = area.height_max_m
        if greatest_m is None and area.height_min_m is None:
            greatest_m = heights.max_m
        yield SiteArea(kind, area.name or kind, area.corners, least_m, greatest_m)


def without_last(place: str, ring: Sequence[GeodeticCorner]) -> tuple[GeodeticCorner, ...]:
    """The ring without the repeated first corner. Raises: SiteError where it is not repeated."""
    if len(ring) < 4 or ring[0] != ring[-1]:
        text = f"a ring of {len(ring)} corners that does not end where it begins: repeat the first at the end"
        raise SiteError(place, text)
    return tuple(ring[:-1])


def named(area: ReadArea, kind: AreaKind) -> ReadArea:
    return replace(area, kind=str(kind), name=area.name or str(kind))


def parsed_once(data: bytes, file: str) -> Value:
    """The document, without a key that stands twice in one object: readers differ in which of them counts.

    Raises: SiteError.
    """
    document = parsed(data, file, SiteError)  # bounds its depth and its size first

    def unique(pairs: list[tuple[str, object]]) -> dict[str, object]:
        once: dict[str, object] = {}
        for key, value in pairs:
            if key in once:
                raise SiteError(file, f"key '{cut(key)}' is there twice in one object: leave one of them out")
            once[key] = value
        return once

    json.loads(data.decode("utf-8-sig"), object_pairs_hook=unique)
    return document
