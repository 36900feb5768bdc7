"""Every site that is accepted comes back from every format as it was written."""

from contextlib import suppress
from math import cos, pi, sin
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from gcs.areas.files.reading import Heights
from gcs.areas.files.site_files import FORMATS, format_of
from gcs.areas.site import AreaKind, FlightSite, SiteArea
from gcs.areas.site_fence import fence_within
from gcs.model.errors import SiteError
from gcs.model.frames import ShowFrame
from gcs.safety.walls import Fence
from tests.support.fields import places

NAMES = st.text(
    st.characters(exclude_categories=("Cc", "Cs", "Zl", "Zp", "Cn", "Co", "Cf")), min_size=1, max_size=20
)


@st.composite
def stars(draw: st.DrawFn, reach_m: float, frame: ShowFrame) -> tuple[tuple[float, float], ...]:
    """A ring round the origin, of any shape that sees it all: convex or not."""
    count = draw(st.integers(3, 12))
    shares = draw(st.lists(st.floats(0.3, 1.0), min_size=count, max_size=count))
    ring = [
        (reach_m * share * cos(2 * pi * at / count), reach_m * share * sin(2 * pi * at / count))
        for at, share in enumerate(shares)
    ]
    return places(ring[:: draw(st.sampled_from((1, -1)))], frame)


@st.composite
def sites(draw: st.DrawFn) -> FlightSite:
    frame = ShowFrame(draw(st.floats(-80.0, 80.0)), draw(st.floats(-179.0, 179.0)), 0.0)
    top_m, least_m = draw(st.floats(10.0, 120.0)), draw(st.floats(-5.0, 5.0))
    areas = [SiteArea(AreaKind.FLIGHT_GEOGRAPHY, draw(NAMES), draw(stars(100.0, frame)), least_m, top_m)]
    if draw(st.booleans()):
        wide = places([(-200, -200), (-200, 200), (200, 200), (200, -200)], frame)
        areas.append(SiteArea(AreaKind.CONTINGENCY, draw(NAMES), wide, -10.0, top_m + 10.0))
    if draw(st.booleans()):
        people = places([(300, 300), (300, 350), (350, 350)], frame)
        areas.append(SiteArea(AreaKind.AUDIENCE, draw(NAMES), people))
    if draw(st.booleans()):
        mast = places([(20, 20), (20, 30), (30, 30), (30, 20)], frame)
        areas.append(SiteArea(AreaKind.NO_FLY, draw(NAMES), mast, 0.0, draw(st.floats(5.0, 50.0))))
    return FlightSite(draw(NAMES), tuple(draw(st.permutations(areas))))


@given(sites(), st.permutations(sorted(FORMATS)))
def test_a_site_passes_through_all_formats(site: FlightSite, order: list[str]) -> None:
    passed = site
    for ending in order:
        form = format_of(Path(f"a{ending}"))
        passed = form.read(form.write(passed), f"a{ending}", Heights())
    assert passed == site
    assert passed.digest == site.digest


@given(st.sampled_from(sorted(FORMATS)), st.binary(max_size=300), st.data())
def test_damaged_files_are_refused_in_words(ending: str, junk: bytes, data: st.DataObject) -> None:
    """Whatever bytes are read: a site, or an error of ours."""
    form = format_of(Path(f"a{ending}"))
    whole = form.write(data.draw(sites()))
    at = data.draw(st.integers(0, len(whole)))
    end = data.draw(st.integers(at, len(whole)))
    for content in (junk, whole[:at] + junk + whole[end:]):
        with suppress(SiteError):
            assert form.read(content, "a", Heights()).areas


@given(sites(), st.floats(-360.0, 360.0))
def test_every_site_fits_into_its_own_frame(site: FlightSite, heading_deg: float) -> None:
    latitude, longitude = site.middle
    fence = fence_within(site, ShowFrame(latitude, longitude, 400.0, heading_deg), Fence(height_min_m=6.0))
    assert len(fence.areas) == len(site.fenced)
    assert fence.height_max_m <= site.flight_geography.top_m
