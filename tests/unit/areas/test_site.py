"""A site refuses what cannot be flown, and says where and what would be right."""

from dataclasses import replace
from math import nan

import pytest

from gcs.areas.site import AreaKind, FlightSite, SiteArea
from gcs.model.errors import SiteError
from tests.support.fields import (
    AUDIENCE,
    CONTINGENCY,
    ELL,
    GROUND_RISK,
    area,
    field,
    geography,
    grown,
    places,
)

NO_FLY = area(AreaKind.NO_FLY, ((-20, 60), (-20, 70), (-10, 70), (-10, 60)), (0.0, 12.0), "oak")


def refused(*areas: SiteArea) -> str:
    with pytest.raises(SiteError) as error:
        FlightSite("corner field", areas)
    return str(error.value)


def test_a_concave_field_with_all_kinds_of_areas_is_accepted() -> None:
    site = field(CONTINGENCY, GROUND_RISK, NO_FLY)
    assert [area.kind for area in site.fenced] == ["flight-geography", "audience", "no-fly"]
    assert [area.kind for area in site.uploaded] == ["contingency", "audience"]
    assert [area.kind for area in field().uploaded] == ["flight-geography", "audience"]
    high = replace(NO_FLY, height_max_m=44.0)  # nothing flies over it: the autopilots keep out of it
    assert [area.kind for area in field(high).uploaded] == ["flight-geography", "audience", "no-fly"]


def test_rings_are_kept_counterclockwise() -> None:
    """Seen from above, whichever way they were drawn: GeoJSON demands it."""
    first, *others = geography().corners
    turned = replace(geography(), corners=(first, *others[::-1]))
    kept = FlightSite("a", (turned,)).flight_geography.corners
    assert kept == FlightSite("a", (geography(),)).flight_geography.corners
    assert kept[0] == first
    twice = sum(
        (lon + next_lon) * (next_lat - lat)
        for (lat, lon), (next_lat, next_lon) in zip(kept, (*kept[1:], kept[0]), strict=True)
    )
    assert twice > 0.0


def test_the_hash_is_that_of_what_is_flown() -> None:
    site = field(NO_FLY)
    first, *others = site.areas
    turned = replace(first, corners=(*first.corners[2:], *first.corners[:2]), name="another name")
    assert FlightSite("elsewhere", (*others, turned)).digest == site.digest
    moved = replace(first, corners=((first.corners[0][0] + 2e-7, first.corners[0][1]), *first.corners[1:]))
    for changed in (
        moved,
        replace(first, height_max_m=45.01),
        replace(first, height_min_m=0.5),
    ):
        assert FlightSite(site.name, (changed, *others)).digest != site.digest
    other_kind = replace(others[1], kind=AreaKind.AUDIENCE, height_max_m=None)
    assert refused(first, other_kind)  # the oak stands inside
    assert FlightSite(site.name, (first, others[0])).digest != site.digest


def with_corner(at: int, latitude: float, longitude: float) -> SiteArea:
    ring = list(geography().corners)
    ring[at] = latitude, longitude
    return replace(geography(), corners=tuple(ring))


BOW = ((-40, -40), (-40, 40), (40, -40), (40, 40))
SPIKE = ((-40, -40), (-40, 40), (40, 40), (40, 0), (40, 60), (40, -40))

FAR_FAN = ((200.0, 200.0), *((210.0 + at, 200.0 + at - 0.1 * at**2) for at in range(30)))

WRONG: dict[str, tuple[tuple[SiteArea, ...], tuple[str, ...]]] = {
    "no flight geography": ((area(AreaKind.NO_FLY, ELL),), ("no area of kind flight-geography",)),
    "two of them": ((geography(), geography(BOW[:2] + BOW[:1:-1])), ("2 areas of kind flight-geography",)),
    "too many areas": ((geography(), *[NO_FLY] * 12), ("13 areas: at most 12",)),
    "two corners": ((replace(geography(), corners=places(ELL)[:2]),), ("area 1", "2 corners: 3 to 60")),
    "61 corners": ((replace(geography(), corners=places(ELL) * 11),), ("66 corners: 3 to 60",)),
    "nan": ((with_corner(2, nan, 8.5),), ("corner 3", "latitude nan", "finite")),
    "beyond": ((with_corner(2, 120.0, 200.0),), ("corner 3", "at most 90 and 180")),
    "swapped beyond 90": ((with_corner(1, 151.2, -33.8),), ("corner 2", "151.2 is beyond 90", "swapped")),
    "one corner swapped": ((with_corner(3, 8.5456, 47.3977),), ("corner 4 is", "from corner 1", "swapped")),
    "pole": ((with_corner(0, 88.0, 8.5),), ("corner 1", "nearer to a pole than 85")),
    "antimeridian": (
        (replace(geography(), corners=((1.0, 179.999), (1.0, -179.999), (1.001, -179.999))),),
        ("crosses the antimeridian", "-179.999 to 179.999", "one side of 180"),
    ),
    "far corner": ((with_corner(2, 47.9, 8.5),), ("corner 3 is 56 km from corner 1: at most 20 km",)),
    "the same place twice": ((with_corner(2, *geography().corners[1]),), ("corners 2 and 3 are the same",)),
    "sides cross": ((geography(BOW),), ("sides cross or touch", "side 2-3 and side 4-1", "simple outline")),
    "a spike": ((geography(SPIKE),), ("sides cross or touch", "side 2-3 and side 4-5")),
    "too small": ((geography(((0, 0), (0, 4), (4, 4))),), ("8.0 m^2: at least 25",)),
    "no height": ((replace(geography(), height_max_m=None),), ("height_max_m is missing",)),
    "nan height": ((replace(geography(), height_max_m=nan),), ("height_max_m = nan: from -500 to 10000",)),
    "heights reversed": ((replace(geography(), height_min_m=50.0),), ("height_max_m = 45: above", "= 50")),
    "no name": ((replace(geography(), name=""),), ("name ''", "1 to 60 characters")),
    "name of two lines": ((replace(geography(), name="a\nb"),), ("1 to 60 characters on one line",)),
    "contingency too small": (
        (geography(), replace(CONTINGENCY, corners=places(grown(ELL, -5.0)))),
        ("reaches 7.1 m out of contingency", "at its corner", "it must lie inside"),
    ),
    "contingency cuts a corner": (
        (geography(), replace(CONTINGENCY, corners=places(grown(ELL, 16.0)[1:]))),
        ("out of contingency 'contingency' at its corner 1",),
    ),
    "contingency too low": (
        (geography(), replace(CONTINGENCY, height_max_m=40.0)),
        ("is 45 m high, contingency 'contingency' only 40 m",),
    ),
    "ground risk within contingency": (
        (geography(), CONTINGENCY, replace(GROUND_RISK, corners=places(grown(ELL, 10.0)))),
        ("contingency 'contingency' reaches", "out of ground-risk"),
    ),
    "audience in the way": (
        (geography(), area(AreaKind.AUDIENCE, ((0, 0), (0, 10), (10, 10), (10, 0)))),
        ("audience", "100 m^2 in common with flight-geography", "an audience lies outside"),
    ),
    "audience where vehicles fall": (
        (
            geography(),
            replace(GROUND_RISK, corners=places(grown(ELL, 100.0))),
            area(AreaKind.AUDIENCE, AUDIENCE),
        ),
        ("in common with ground-risk",),
    ),
    "nowhere to fly": ((geography(), area(AreaKind.NO_FLY, grown(ELL, 1.0))), ("cover the whole flight",)),
    "too many for an autopilot": (
        (geography(), *[area(AreaKind.AUDIENCE, FAR_FAN)] * 2),
        ("68 corners in all go to the autopilots: at most 64",),
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_site_is_refused_in_words(case: str) -> None:
    areas, words = WRONG[case]
    text = refused(*areas)
    assert [word for word in words if word not in text] == [], text


def test_all_that_is_wrong_is_named_at_once() -> None:
    text = refused(replace(geography(), height_max_m=None), replace(NO_FLY, corners=NO_FLY.corners[:2]))
    assert len(text.splitlines()) == 2
    assert "area 1, flight-geography" in text
    assert "area 2, no-fly 'oak'" in text
