"""A show that leaves the areas of a service is refused with cue, time and missing metres."""

import re
from typing import Any

import pytest

from gcs.config.yaml_files import SHOWS
from gcs.formation.orbit import CLEAR_OF_FENCE_M
from gcs.safety.fenced_areas import FencedArea
from gcs.shows import load
from gcs.shows.area_checks import area_flaws
from gcs.shows.format import ShowFence
from gcs.shows.service_rules import ServiceRules
from tests.support.fields import ELL, Metres
from tests.support.show_files import loaded

HEIGHTS = ShowFence(height_min_m=3.0, height_max_m=40.0, distance_max_m=300.0)


def fenced(ring_m: Metres = ELL, *, inside: bool = True) -> FencedArea:
    return FencedArea(corners_m=tuple((float(x), float(y)) for x, y in ring_m), inside=inside)


def flaws(*cues: dict[str, Any], areas: tuple[FencedArea, ...] = (fenced(),)) -> list[str]:
    timeline = loaded(
        *cues, duration_s=90.0, fence={"height_min_m": 3.0, "height_max_m": 60.0, "distance_max_m": 200.0}
    ).timeline
    return [flaw.text for flaw in area_flaws(timeline, ServiceRules(areas=areas, fence=HEIGHTS))]


def test_a_show_inside_of_the_field_has_no_flaw() -> None:
    assert flaws({"cue": "east", "at_s": 5, "target": {"x_m": 0, "y_m": 60}, "over_s": 40}) == []
    assert flaws(areas=()) == []


def test_the_worst_time_of_a_cue_is_named_with_its_metres() -> None:
    (text,) = flaws({"cue": "east", "at_s": 5, "target": {"x_m": 0, "y_m": 110}, "over_s": 53})
    assert f"{8.0 + CLEAR_OF_FENCE_M:.1f} m are missing to area 1 of the fence" in text
    assert "('east')" in text
    assert float(re.findall(r"at ([\d.]+) s", text)[0]) >= 54.0
    assert "orbit and sphere reach 8.0 m from (0.0, 110.0) m" in text


def test_each_cue_has_its_own_flaw() -> None:
    there = {"cue": "out", "at_s": 5, "target": {"x_m": 0, "y_m": 105}, "over_s": 53}
    grows = {"cue": "grow", "at_s": 60, "radius_m": 14, "over_s": 12}
    assert [re.findall(r"'(\w+)'", text)[0] for text in flaws(there, grows)] == ["out", "grow"]


def test_an_area_to_keep_out_of_counts() -> None:
    mast = fenced(((0.0, 50.0), (0.0, 52.0), (2.0, 52.0)), inside=False)
    (text,) = flaws({"cue": "east", "at_s": 5, "target": {"x_m": 0, "y_m": 60}, "over_s": 40}, areas=(mast,))
    assert "to area 1 of the fence, which vehicles keep out of" in text


def test_heights_are_those_of_the_service() -> None:
    (text,) = flaws({"cue": "rise", "at_s": 5, "height_m": 36, "over_s": 40})
    assert "4.0 m are missing to the 40 m of the service's fence" in text


def test_pads_outside_are_counted() -> None:
    far = fenced([(x + 100.0, y) for x, y in ELL])
    texts = flaws(areas=(far,))
    assert re.search(
        r"pads: pad \d is 6\d\.\d+ m beyond an area of the service's fence, and 7 more are", texts[0]
    )


@pytest.mark.parametrize("inside", [True, False])
def test_drawn_shows_are_checked_vehicle_by_vehicle(inside: bool) -> None:
    drawn = load(SHOWS.find("drawn-30"))
    wide = ((-200.0, -200.0), (-200.0, 200.0), (200.0, 200.0), (200.0, -200.0))
    narrow = ((-500.0, -500.0), (-500.0, 2.0), (500.0, 2.0), (500.0, -500.0))
    good, bad = (wide, narrow) if inside else ([(x + 900.0, y) for x, y in wide], narrow)
    accepts, refuses = (ServiceRules(areas=(fenced(ring, inside=inside),)) for ring in (good, bad))
    assert area_flaws(drawn.timeline, accepts) == []
    texts = [flaw.text for flaw in area_flaws(drawn.timeline, refuses)]
    assert any(
        re.search(r"is [\d.]+ m beyond an area of the service's fence at [\d.]+ s", text) for text in texts
    )


def test_where_vehicles_might_fall_counts() -> None:
    """The field is wide enough to fly, and too narrow to fall from the height of the last cue."""
    small = ((-18.0, -18.0), (-18.0, 18.0), (18.0, 18.0), (18.0, -18.0))
    rules = ServiceRules(controlled_ground=fenced(small))
    timeline = loaded({"cue": "rise", "at_s": 5, "height_m": 45, "over_s": 50}).timeline
    (flaw,) = area_flaws(timeline, rules)
    assert "('rise')" in flaw.text
    assert "m are missing to the edge of the controlled ground" in flaw.text
    drawn = load(SHOWS.find("drawn-30"))
    texts = [flaw.text for flaw in area_flaws(drawn.timeline, rules)]
    assert any(re.search(r"might fall [\d.]+ m outside of the controlled ground at", text) for text in texts)
