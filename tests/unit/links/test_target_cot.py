"""Events of Cursor on Target become fixes of one track; hostile ones cost nothing, and are named."""

import tracemalloc
from math import isnan

import pytest

from gcs.links.targets.cot import LONGEST_BYTES, NAMED_S, CotStream, CotTraffic
from gcs.model.target_fix import TargetFix
from tests.support.target_bytes import cot

GEOID_M = 47.0
BOMB = (
    b'<!DOCTYPE event [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    b'<event uid="X1" type="a-f-S" time="2026-11-29T12:00:00Z"><point lat="47" lon="8" hae="0"/>&b;</event>'
)


def taken(*parts: bytes, track: str = "BOAT", every_s: float = 1.0) -> tuple[list[TargetFix], str]:
    """The fixes of parts that arrive one after the other, and what is said of the last part."""
    stream = CotStream(track, GEOID_M)
    return [fix for at, part in enumerate(parts) for fix in stream.take(part, every_s * at)], stream.why


def test_an_event_is_a_fix_with_all_that_it_says() -> None:
    for track in ("BOAT", "X1"):
        (fix,), why = taken(cot(), track=track)
        assert why == ""
        place = (fix.latitude_deg, fix.longitude_deg, fix.altitude_amsl_m, fix.source_s)
        assert place == (47.4, 8.5, 488.0, 1_795_953_600.5)
        assert (fix.north_m_s, fix.east_m_s) == pytest.approx((0.0, 5.0))
        assert (fix.deviation_m, fix.height_deviation_m) == (4.5, 9.0)
        assert isnan(fix.down_m_s + fix.velocity_deviation_m_s)
        assert fix.track == "BOAT"


def test_without_a_geoid_no_height_is_used() -> None:
    (fix,) = CotStream("BOAT").take(cot(), 0.0)
    assert isnan(fix.altitude_amsl_m)


@pytest.mark.parametrize(
    "unknown", ["9999999", "9999999.0", "999999", "0", "0.0", "-1", "nan", "inf", "", "x"]
)
def test_errors_and_heights_that_are_unknown_are_not_used(unknown: str) -> None:
    (fix,), _ = taken(cot(ce=unknown, le=unknown))
    assert isnan(fix.deviation_m)
    assert isnan(fix.height_deviation_m)
    (fix,), _ = taken(cot(hae="9999999.0"))
    assert isnan(fix.altitude_amsl_m)


def test_tracks_beside_the_selected_one_are_named() -> None:
    others = [cot(f"U{at}", f"C{at}") for at in range(5)]
    assert taken(*others) == ([], "unknown track BOAT, seen: C0, C1, C2 (and 2 more)")
    assert taken(cot("U9", detail="")) == ([], "unknown track BOAT, seen: U9")
    fixes, why = taken(*others, cot(), *others)
    assert ([fix.track for fix in fixes], why) == (["BOAT"], "")


def test_a_callsign_of_two_is_followed_as_the_first() -> None:
    fixes, why = taken(cot("X1", lat="1"), cot("X2", lat="2"))
    assert [fix.latitude_deg for fix in fixes] == [1.0]
    assert why == "BOAT is the callsign of X1 and X2: name a uid"
    fixes, _ = taken(cot("X1", lat="1"), cot("X2", lat="2"), every_s=NAMED_S + 1.0)
    assert [fix.latitude_deg for fix in fixes] == [1.0, 2.0], "the first is silent"
    fixes, _ = taken(cot("X1"), cot("X2", "X1", lat="2"), track="X1")
    assert [fix.latitude_deg for fix in fixes] == [47.4], "a uid counts before a callsign"


@pytest.mark.parametrize("kind", ["b-t-f", "t-x-c-t-r", "b-m-p-s-p-loc", ""])
def test_only_things_are_tracks(kind: str) -> None:
    assert taken(cot(type=kind)) == ([], "")


@pytest.mark.parametrize(
    ("event", "why"),
    [
        (BOMB.partition(b"]>")[2].replace(b"&b;", b"<![CDATA[x]]>"), "document type, an entity or a comment"),
        (BOMB, "an event cannot be read: undefined entity"),
        (cot().replace(b"<detail>", b'<!DOCTYPE x SYSTEM "file:///etc/passwd"><detail>'), "a document type"),
        (cot().replace(b"</detail>", b""), "an event cannot be read: mismatched tag"),
        (cot(callsign="caf\u00e9").replace(b"\xc3\xa9", b"\xc3"), "an event cannot be read"),
        (cot(detail="<a>" * 100 + "</a>" * 100), "an event of more than 1000 elements, or 16 levels"),
        (cot(detail="<a/>" * 2000), "an event of more than 1000 elements, or 16 levels"),
        (cot(detail="<a/>" * 20_000), ""),
        (cot()[:-8] + b" " * 70_000, f"an event of more than {LONGEST_BYTES} bytes"),
        (cot(lat="91"), "latitude 91 is not within 90 degrees"),
        (cot(lat="nan"), "latitude nan is not within 90 degrees"),
        (cot(lon="inf"), "longitude inf is not within 180 degrees"),
        (cot(lat="9" * 1000), "is not within 90 degrees"),
        (cot().replace(b"<point", b"<pint"), "latitude  is not within 90 degrees"),
        (b"\xbf\x01\xbf\x12\x20\x0a\x05a-f-G", "TAK protocol version 1 is not read"),
    ],
    ids=range(15),
)
def test_what_is_no_fix_says_why(event: bytes, why: str) -> None:
    fixes, reason = taken(event)
    assert fixes == []
    assert why in reason


def test_what_was_cut_off_or_is_hostile_spoils_no_event_after_it() -> None:
    for before in (
        cot()[:200],
        BOMB,
        b"<event " * 5000,
        b"\xbf\x01\xbf" * 100,
        b"<event uid='" + b"x" * 70_000,
    ):
        fixes, _ = taken(before + cot())
        assert len(fixes) == 1, before[:40]
        fixes, _ = taken(before, cot())
        assert len(fixes) == 1, before[:40]


@pytest.mark.soak
def test_a_million_tracks_keep_no_memory() -> None:
    stream = CotStream("BOAT")
    event = cot("U0000000", "C0000000")
    events = [event.replace(b"0000000", b"%07d" % at) for at in range(2000)]
    for each in events[:100]:
        stream.take(each, 0.0)
    tracemalloc.start()
    begin = tracemalloc.get_traced_memory()[0]
    for each in events:
        stream.take(each, 0.0)
    for at in range(1_000_000):
        stream._others.add(str(at))
    grown = tracemalloc.get_traced_memory()[0] - begin
    tracemalloc.stop()
    assert grown < 20_000
    assert stream.why == "unknown track BOAT, seen: C0000000, C0000001, C0000002 (and at least 61 more)"


def test_an_event_without_end_keeps_no_memory() -> None:
    stream = CotStream("BOAT")
    for _ in range(100):
        stream.take(b'<event uid="' + b"x" * 10_000, 0.0)
        assert len(stream._waiting) <= LONGEST_BYTES + 1
    assert len(stream.take(cot(), 0.0)) == 1


OWN = "gcs-0000beef"
ECHO = cot(f"{OWN}.d1", "LUCERNE d1") + cot(OWN, "LUCERNE")


def test_own_tracks_that_come_back_are_no_target() -> None:
    for track in ("LUCERNE d1", "LUCERNE", OWN):
        stream = CotStream(track, GEOID_M, OWN)
        assert stream.take(ECHO, 0.0) == []
        assert (stream.messages, stream.why) == (2, f"unknown track {track}, seen: this show's own tracks")
    stream = CotStream("BOAT", GEOID_M, OWN)
    assert [fix.track for fix in stream.take(ECHO + cot() + ECHO, 0.0)] == ["BOAT"]
    assert stream.why == ""


def test_own_tracks_that_come_back_are_no_traffic() -> None:
    stream = CotTraffic(GEOID_M, OWN)
    others = cot("gcs-0000cafe.d1", "LUCERNE d1") + cot("X1", f"{OWN}.d1")
    fixes = stream.take(ECHO + others + ECHO, 0.0)
    assert [fix.track for fix in fixes] == ["gcs-0000cafe.d1", "X1"], "another show's count"
    assert (stream.messages, stream.why) == (6, "")
    assert len(CotTraffic(GEOID_M).take(ECHO, 0.0)) == 2, "a show that sends none knows none of its own"
