"""Reports of gpsd become fixes; whatever else it sends is named or passed over."""

from math import isnan, nan

import pytest

from gcs.links.targets.gpsd import LONGEST_BYTES, GpsdStream
from gcs.model.target_fix import TargetFix
from tests.support.target_bytes import tpv

VERSION = b'{"class":"VERSION","release":"3.22","rev":"3.22","proto_major":3,"proto_minor":14}\r\n'
GST = (
    b'{"class":"GST","device":"/dev/ttyUSB0","time":"2026-11-29T12:00:00.000Z",'
    b'"lat":1.100,"lon":1.300,"alt":2.200}\r\n'
)
OF_GPSD_3_22 = (
    b'{"class":"TPV","device":"/dev/pts/0","mode":3,"time":"2026-11-29T18:48:57.000Z","ept":0.005,'
    b'"lat":47.397728333,"lon":8.545586667,"altHAE":535.3000,"altMSL":488.2000,"alt":488.2000,"epv":25.300,'
    b'"track":45.0000,"magtrack":47.5737,"magvar":2.6,"speed":1.286,"climb":0.000,"epc":50.60,'
    b'"geoidSep":47.100,"eph":17.100,"sep":26.600}\r\n'
)


def taken(*parts: bytes, device: str = "") -> tuple[list[TargetFix], str]:
    """The fixes of parts that arrive one second after the other, and what is said of the last part."""
    stream = GpsdStream(device)
    return [fix for at, part in enumerate(parts) for fix in stream.take(part, float(at))], stream.why


def test_a_report_is_a_fix_with_all_that_it_says() -> None:
    (fix,), why = taken(VERSION + tpv())
    assert why == ""
    place = (fix.latitude_deg, fix.longitude_deg, fix.altitude_amsl_m, fix.source_s)
    assert place == (47.4, 8.5, 488.0, 1_795_953_600.5)
    assert (fix.north_m_s, fix.east_m_s, fix.down_m_s) == pytest.approx((0.0, 5.0, -0.5))
    errors = (fix.deviation_m, fix.height_deviation_m, fix.velocity_deviation_m_s)
    assert errors == pytest.approx((2.0, 4.0, 0.5)), "a standard deviation of what has 95 %"


def test_a_report_of_two_dimensions_has_no_height() -> None:
    (fix,), _ = taken(tpv(mode=2))
    assert fix.latitude_deg == 47.4
    assert isnan(fix.altitude_amsl_m + fix.down_m_s)
    assert isnan(fix.height_deviation_m)


def test_a_report_as_gpsd_3_22_sends_it() -> None:
    """Of NMEA: one error around, and a climb that gpsd has computed of heights."""
    (fix,), _ = taken(OF_GPSD_3_22)
    assert fix.deviation_m == pytest.approx(6.985, abs=1e-3)
    assert isnan(fix.down_m_s)
    assert fix.altitude_amsl_m == 488.2


def test_standard_deviations_count_before_guesses() -> None:
    fixes, _ = taken(
        tpv() + GST, tpv(time="2026-11-29T12:00:01Z"), *[b"\n"] * 6, tpv(time="2026-11-29T12:00:08Z")
    )
    sideways = [fix.deviation_m for fix in fixes]
    assert sideways == pytest.approx([2.0, 1.3, 2.0]), "none, one second old, eight seconds old"
    assert [fix.height_deviation_m for fix in fixes] == pytest.approx([4.0, 2.2, 4.0])


def test_a_report_that_is_repeated_counts_once() -> None:
    fixes, _ = taken(tpv(speed=None) + tpv() + tpv() + tpv(epv=None), tpv(device="/dev/ttyACM1"))
    assert [isnan(fix.north_m_s) for fix in fixes] == [True, False, False], "its rest follows"


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (tpv(mode=1), "no fix: mode 1 of /dev/ttyUSB0"),
        (tpv(mode=0), "no fix: mode 0 of /dev/ttyUSB0"),
        (tpv(mode=None), "no fix: mode None"),
        (tpv(lat=None), "latitude None is not within 90 degrees"),
        (tpv(lat=nan), "latitude nan is not within 90 degrees"),
        (tpv(lon=float("inf")), "longitude inf is not within 180 degrees"),
        (tpv(lat=91.0), "latitude 91.0 is not within 90 degrees"),
        (tpv(lat=True), "latitude True is not within 90 degrees"),
        (b'{"class":"ERROR","message":"Unrecognized request"}\n', "gpsd answers: Unrecognized request"),
        (b'{"class":"DEVICES","devices":[]}\n', "gpsd has no receiver"),
        (VERSION.replace(b'major":3', b'major":4'), "protocol 4 of gpsd is not known, 3 is"),
        (b'{"class":"TPV"' + b" " * LONGEST_BYTES, f"a line of more than {LONGEST_BYTES} bytes"),
    ],
)
def test_what_is_no_fix_says_why(line: bytes, why: str) -> None:
    fixes, reason = taken(line)
    assert fixes == []
    assert why in reason


@pytest.mark.parametrize(
    "line",
    [
        b'{"class":"TPV","mode":3,"lat":' + b"[" * 5000 + b"\n",
        b'{"class":"TPV","mode":3,"lat":' + b'{"a":' * 2000 + b"\n",
        b'{"class":"TPV","mode":3,"lat":' + b"9" * 5000 + b',"lon":1}\n',
        b'{"class":"TPV","mode":3,"lat":1e99999,"lon":1}\n',
        b'{"class":"TPV","mode":3,"lat":"47\xe2\x82","lon":1}\n',
        b'"TPV"\n',
        b'{"TPV":3}\n',
        b'{"class":"TPV",\n',
        b'{"class":"SKY","device":"TPV","satellites":[{"PRN":1}]}\n',
        b"\xff\xfe\x00\n",
    ],
    ids=range(10),
)
def test_hostile_lines_are_passed_over(line: bytes) -> None:
    fixes, _ = taken(line + tpv())
    assert len(fixes) == 1


def test_another_device_is_named_and_does_not_count() -> None:
    fixes, why = taken(*(tpv(device=f"/dev/tty{at}") for at in range(5)), device="/dev/ttyUSB0")
    assert (fixes, why) == (
        [],
        "unknown device /dev/ttyUSB0, seen: /dev/tty0, /dev/tty1, /dev/tty2 (and 2 more)",
    )
    assert len(taken(tpv(device="/dev/ttyACM1"), tpv(), device="/dev/ttyUSB0")[0]) == 1


@pytest.mark.parametrize(
    "time", [None, 3, "now", "2026-13-40T00:00:00Z", "9" * 100, "0001-01-01T00:00:00+23:59"]
)
def test_a_time_that_is_none_is_not_known(time: object) -> None:
    (fix,), _ = taken(tpv(time=time))
    assert isnan(fix.source_s) or fix.source_s < 0.0


def test_a_line_without_end_keeps_no_memory() -> None:
    stream = GpsdStream()
    for _ in range(100):
        stream.take(b'{"class":"TPV",' * 1000, 0.0)
        assert len(stream._waiting) <= LONGEST_BYTES
    assert len(stream.take(b"\n" + tpv(), 1.0)) == 1
