"""Any bytes of a source of targets, cut anywhere: nothing raises, and the fixes are those of the whole."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import isfinite

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.links.targets.cot import CotStream
from gcs.links.targets.gpsd import GpsdStream
from gcs.links.targets.nmea import NmeaStream
from gcs.links.targets.numbers import utc_s, velocity, why_nowhere, within
from gcs.links.targets.receive import TargetStream
from gcs.model.errors import UNSEEN
from gcs.model.target_fix import TargetFix
from tests.support.target_bytes import PLACE, cot, gga, gst, rmc, sentence, tpv

TIMES = [f"1200{at:02d}" for at in range(4)]
FIELD = st.text(st.characters(min_codepoint=32, max_codepoint=126, exclude_characters="$*"), max_size=12)
NMEA = [
    *(make(time) for make in (gga, rmc, gst) for time in TIMES),
    *(gga(TIMES[0], "0"), rmc(TIMES[1], "V"), sentence("GPVTG,90.0,T,,M,3.0,N,,K,A")),
    sentence(f"GNGNS,{TIMES[2]},{PLACE},AA,12,0.9,488.2,47.1,,"),
]
GPSD = [tpv(), tpv(time="2026-11-29T12:00:01Z"), tpv(mode=1), b'{"class":"GST","lat":1,"lon":2,"alt":3}\n']
COT = [
    cot(),
    cot("X2"),
    cot("X3", "OTHER"),
    cot(lat="99"),
    cot()[:150],
    b"<event ",
    b"</event>",
    b"\xbf\x01\xbf",
]
MADE: dict[str, Callable[[], TargetStream]] = {
    "nmea": NmeaStream,
    "gpsd": GpsdStream,
    "cot": lambda: CotStream("BOAT", 47.0),
}


def of_any_sentence(kind: str, fields: Sequence[str]) -> bytes:
    return sentence(",".join((kind, *fields)))


ANY_SENTENCE = st.builds(
    of_any_sentence,
    st.sampled_from(["GPGGA", "GNGNS", "GNRMC", "GPVTG", "GNGST"]),
    st.lists(FIELD, max_size=14),
)
ANY_TPV = st.builds(
    lambda fields: tpv(**fields),
    st.dictionaries(
        st.sampled_from(["mode", "time", "lat", "lon", "altMSL", "track", "speed", "climb", "epx", "device"]),
        st.one_of(
            st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=9), st.lists(st.none())
        ),
    ),
)
ANY_EVENT = st.builds(
    lambda fields: cot(**fields),
    st.dictionaries(
        st.sampled_from(["type", "time", "lat", "lon", "hae", "ce", "le", "detail"]), st.text(max_size=9)
    ),
)
JUNK = st.one_of(
    st.binary(max_size=60), st.sampled_from([b"$", b"*", b"\r\n", b"{", b'{"class":"TPV"', b"<!"])
)
STREAMS = {
    "nmea": st.lists(st.one_of(st.sampled_from(NMEA), ANY_SENTENCE, JUNK), max_size=12).map(b"".join),
    "gpsd": st.lists(st.one_of(st.sampled_from(GPSD), ANY_TPV, JUNK), max_size=8).map(b"".join),
    "cot": st.lists(st.one_of(st.sampled_from(COT), ANY_EVENT, JUNK), max_size=6).map(b"".join),
}


def credible(fix: TargetFix) -> bool:
    """Whether a fix has a place on Earth, and no number that is infinite or beyond its bounds."""
    numbers = (fix.altitude_amsl_m, fix.north_m_s, fix.east_m_s, fix.down_m_s, fix.deviation_m, fix.source_s)
    return why_nowhere(fix.latitude_deg, fix.longitude_deg) == "" and not any(map(is_infinite, numbers))


def is_infinite(number: float) -> bool:
    return not isfinite(number) and number == number  # noqa: PLR0124  NaN alone differs from itself


@pytest.mark.parametrize("kind", MADE)
@given(st.data())
def test_any_cut_of_a_stream_gives_its_fixes(kind: str, data: st.DataObject) -> None:
    stream = data.draw(STREAMS[kind])
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    whole, parts = MADE[kind](), MADE[kind]()
    fixes = whole.take(stream, 1.0)
    in_parts = [
        fix for begin, end in pairwise((0, *cuts, len(stream))) for fix in parts.take(stream[begin:end], 1.0)
    ]
    assert repr(in_parts) == repr(fixes)
    assert parts.messages == whole.messages
    assert all(map(credible, fixes))


@pytest.mark.parametrize("kind", MADE)
@given(st.lists(st.binary(max_size=300), max_size=8))
def test_random_bytes_never_raise(kind: str, pieces: list[bytes]) -> None:
    stream = MADE[kind]()
    for at, piece in enumerate(pieces):
        assert all(map(credible, stream.take(piece, float(at))))
        assert UNSEEN.search(stream.why) is None


VALUES = st.one_of(
    st.floats(), st.integers(), st.text(max_size=50), st.none(), st.booleans(), st.binary(max_size=5)
)


@given(VALUES, VALUES)
def test_any_value_is_a_number_within_its_bounds_or_none(value: object, other: object) -> None:
    assert not abs(within(value, -90.0, 90.0)) > 90.0
    assert not any(map(is_infinite, (*velocity(value, other), utc_s(value))))
    assert UNSEEN.search(why_nowhere(value, other)) is None


@given(
    st.datetimes().map(lambda time: time.isoformat()),
    st.sampled_from(["", "Z", "+14:00", "-23:59", "+23:59:59"]),
)
def test_every_time_of_the_calendar_is_read(time: str, zone: str) -> None:
    assert isfinite(utc_s(time + zone))
