"""What is sent to TAK is an event as the schema has it, and is read as it was meant."""

from math import inf, isnan, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.links.tak.events import FUSED, MEASURED, STALE_S, TYPE, OwnTrack, event
from gcs.links.targets.cot import CotStream, CotTraffic
from tests.support.tak_listener import read

UNIX_S = 1_795_953_600.25
TRACK = OwnTrack(
    "gcs-0000beef.d1", "LUCERNE d1", MEASURED, 47.3977421, 8.5455941, 535.25, "formation, 488 m AMSL",
    -3.0, -4.0, 0.9, 1.5, 0.874,
)  # fmt: skip
UNKNOWN = "9999999.0"


def test_event_has_all_that_is_known() -> None:
    sent = read(event(TRACK, UNIX_S))
    head = {name: sent.of(".", name) for name in ("version", "uid", "type", "how")}
    assert head == {"version": "2.0", "uid": "gcs-0000beef.d1", "type": "a-f-A-M-H-Q", "how": "m-g"}
    assert sent.of(".", "time") == sent.of(".", "start") == "2026-11-29T12:00:00.250Z"
    assert (sent.unix_s("time"), sent.unix_s("stale")) == (UNIX_S, UNIX_S + STALE_S)
    assert sent.event.find("point").attrib == {  # type: ignore[union-attr]
        "lat": "47.3977421", "lon": "8.5455941", "hae": "535.25", "ce": "0.90", "le": "1.50"
    }  # fmt: skip
    assert sent.callsign == "LUCERNE d1"
    assert (sent.of("detail/track", "course"), sent.of("detail/track", "speed")) == ("233.1", "5.00")
    assert sent.of("detail/status", "battery") == "87"
    assert sent.event.findtext("detail/remarks") == "formation, 488 m AMSL"


def test_what_is_unknown_is_sent_as_unknown_or_left_out() -> None:
    track = TRACK._replace(height_m=nan, north_m_s=nan, east_m_s=nan, deviation_m=inf, battery=nan)
    sent = read(event(track, UNIX_S))
    assert [sent.of("point", name) for name in ("hae", "ce", "le")] == [UNKNOWN] * 3
    assert sent.event.find("detail/track") is None
    assert sent.event.find("detail/status") is None
    zero = read(event(TRACK._replace(deviation_m=0.0, height_deviation_m=nan), UNIX_S))
    assert [zero.of("point", name) for name in ("ce", "le")] == [UNKNOWN] * 2


def test_centre_is_no_manned_aircraft_to_other_stations() -> None:
    (fix,) = CotTraffic(47.0).take(event(TRACK._replace(how=FUSED), UNIX_S), 0.0)
    assert (TYPE, fix.kind) == ("a-f-A-M-H-Q", "unmanned")


@given(
    st.floats(-90.0, 90.0), st.floats(-180.0, 180.0), st.floats(-900.0, 9000.0),
    st.floats(-60.0, 60.0), st.floats(-60.0, 60.0), st.floats(0.0, 2e9),
)  # fmt: skip
def test_own_parser_reads_what_was_written(
    latitude_deg: float,
    longitude_deg: float,
    height_m: float,
    north_m_s: float,
    east_m_s: float,
    unix_s: float,
) -> None:
    track = TRACK._replace(
        latitude_deg=latitude_deg, longitude_deg=longitude_deg, height_m=height_m,
        north_m_s=north_m_s, east_m_s=east_m_s,
    )  # fmt: skip
    (fix,) = CotStream("LUCERNE d1", 47.0).take(event(track, unix_s), 0.0)
    assert (fix.latitude_deg, fix.longitude_deg) == pytest.approx((latitude_deg, longitude_deg), abs=1e-7)
    assert fix.altitude_amsl_m == pytest.approx(height_m - 47.0, abs=0.006)
    assert (fix.north_m_s, fix.east_m_s) == pytest.approx((north_m_s, east_m_s), abs=0.1)
    assert fix.source_s == pytest.approx(unix_s, abs=0.0011)
    assert (fix.deviation_m, fix.height_deviation_m, fix.track) == (0.9, 1.5, "LUCERNE d1")
    assert isnan(fix.down_m_s)
