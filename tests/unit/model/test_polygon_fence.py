"""Areas of fences: inside and outside, distances, what is no area."""

from math import nan

import pytest

from gcs.links.autopilots import AUTOPILOTS
from gcs.links.autopilots.versions import Release
from gcs.mavlink.fences import EXCLUSION, INCLUSION, fence_id, vertices_of
from gcs.model.errors import InvalidError
from gcs.model.polygon_fence import KeptArea, PolygonFence
from tests.support.site_fences import at_deg, many_cornered, square

U = ((0, 0), (0, 30), (30, 30), (30, 20), (10, 20), (10, 10), (30, 10), (30, 0))
"""A concave area, north and east in m: open to the north."""


def shape(corners: tuple[tuple[float, float], ...], *, inclusion: bool = True) -> KeptArea:
    return KeptArea(inclusion, tuple(at_deg(*corner) for corner in corners))


@pytest.mark.parametrize(
    ("place_m", "inside", "edge_m"),
    [
        ((5, 15), True, 5.0),
        ((20, 15), False, 5.0),
        ((20, 5), True, 5.0),
        ((-2, 15), False, 2.0),
        ((40, 35), False, 11.18),
    ],
)
@pytest.mark.parametrize("turned", [False, True])
def test_concave_area_in_both_directions(
    place_m: tuple[float, float], inside: bool, edge_m: float, turned: bool
) -> None:
    area = shape(U[::-1] if turned else U)
    assert area.contains(at_deg(*place_m)) is inside
    assert area.edge_m(at_deg(*place_m)) == pytest.approx(edge_m, abs=0.05)


def test_all_areas_hold_at_once_and_edges_have_a_margin() -> None:
    hole = square(5.0, north_m=20.0, inclusion=False)
    fence = PolygonFence((square(50.0), hole))
    assert fence.vertex_count == 8
    assert fence.why_outside(at_deg(0, 0)) == ""
    assert fence.why_outside(at_deg(60, 0)) == "10.0 m outside the inclusion (polygon 1 of its fence)"
    assert fence.why_outside(at_deg(22, 0)) == "3.0 m inside the exclusion (polygon 2 of its fence)"
    assert fence.why_outside(at_deg(-49.5, 0)) == ""
    near = fence.why_outside(at_deg(-49.5, 0), 1.0)
    assert near == "0.5 m from the edge of the inclusion (polygon 1 of its fence)"


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        (((47.0, 8.0), (47.1, 8.0)), "at least 3 corners"),
        (((47.0, 8.0), (47.1, 8.0), (nan, 8.1)), "finite numbers"),
        (((91.0, 8.0), (90.5, 8.0), (90.5, 8.1)), "a latitude up to 90"),
        (((47.0, 181.0), (47.1, 181.0), (47.1, 180.5)), "a longitude up to 180"),
        (((47.0, 179.99), (47.0, -179.99), (47.1, 179.99)), "at most 1 degrees wide"),
    ],
)
def test_what_is_no_area_is_refused(corners: tuple[tuple[float, float], ...], words: str) -> None:
    with pytest.raises(InvalidError, match=words):
        KeptArea(True, corners)


def test_items_have_corners_in_whole_units() -> None:
    fence = PolygonFence((square(50.0), square(5.0, inclusion=False)))
    vertices = vertices_of(fence)
    assert [vertex.command for vertex in vertices] == [INCLUSION] * 4 + [EXCLUSION] * 4
    assert {vertex.corners for vertex in vertices} == {4}
    assert vertices[0].latitude_e7 == round(at_deg(-50, -50)[0] * 1e7)
    assert fence_id(()) == 0
    other = [vertices[0]._replace(latitude_e7=vertices[0].latitude_e7 + 1), *vertices[1:]]
    assert len({fence_id(vertices), fence_id(other), fence_id(vertices[:4])}) == 3


@pytest.mark.parametrize(
    ("autopilot", "release", "fits"),
    [
        ("px4", Release(1, 14), 63),
        ("px4", Release(1, 15), 64),
        ("px4", Release(1, 18), 64),
        ("ardupilot", Release(4, 1), 83),
        ("ardupilot", Release(4, 7), 83),
    ],
)
def test_an_autopilot_takes_so_many_corners(autopilot: str, release: Release, fits: int) -> None:
    habits = AUTOPILOTS[autopilot].fence
    assert habits.why_not(PolygonFence((many_cornered(fits, 50.0),)), (release,)) == ""
    why = habits.why_not(PolygonFence((many_cornered(fits + 1, 50.0),)), (release,))
    assert why == f"the fence has {fits + 1} corners, {habits.title} {release} takes {fits} in all"


def test_an_old_arducopter_takes_no_polygons() -> None:
    habits = AUTOPILOTS["ardupilot"].fence
    why = habits.why_not(PolygonFence((square(50.0),)), (Release(4, 0),))
    assert why == "ArduCopter 4.0 takes no polygons, from 4.1 on it does"
    build = (Release(4, 0), Release(4, 1))
    assert habits.why_not(PolygonFence((square(50.0),)), build) == ""  # of development: it says itself
