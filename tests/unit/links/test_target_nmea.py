"""NMEA 0183 of receivers becomes fixes: one of each time, with what its sentences say of it."""

from collections.abc import Sequence
from math import isnan, nan

import pytest

from gcs.links.targets.nmea import NmeaStream
from gcs.model.target_fix import TargetFix
from tests.support.target_bytes import LATITUDE_DEG, LONGITUDE_DEG, PLACE, gga, gst, rmc, sentence

NOON_S = 1_795_953_600.0  # 2026-11-29 12:00 UTC


def taken(*parts: bytes, stream: NmeaStream | None = None) -> list[TargetFix]:
    """The fixes of parts that arrive one second after the other."""
    read = stream or NmeaStream()
    return [fix for at, part in enumerate(parts) for fix in read.take(part, float(at))]


def seconds(count: int, *sentences: object) -> list[bytes]:
    """The same sentences in each second from noon on."""
    made: Sequence[object] = sentences
    return [b"".join(one(f"1200{at:02d}.00") for one in made if callable(one)) for at in range(count)]


def test_sentences_of_one_time_are_one_fix() -> None:
    fixes = taken(*seconds(3, rmc, gga, gst))
    assert [fix.source_s for fix in fixes] == [NOON_S, NOON_S + 1.0, NOON_S + 2.0]
    fix = fixes[-1]
    assert (fix.latitude_deg, fix.longitude_deg) == pytest.approx((LATITUDE_DEG, LONGITUDE_DEG))
    assert fix.altitude_amsl_m == 488.2
    assert (fix.north_m_s, fix.east_m_s) == pytest.approx((0.0, 5.1444), abs=1e-4)
    assert (fix.deviation_m, fix.height_deviation_m) == (1.3, 2.2)
    assert isnan(fix.down_m_s)


def test_a_fix_comes_with_the_last_sentence_of_its_time() -> None:
    """Only the first waits for the next second: then it is known which sentences the receiver sends."""
    stream = NmeaStream()
    assert taken(*seconds(1, rmc, gga), stream=stream) == []
    fixes = stream.take(rmc("120001.00"), 1.0)
    assert [(fix.arrived_s, fix.source_s) for fix in fixes] == [(0.0, NOON_S)]
    assert [fix.arrived_s for fix in stream.take(gga("120001.00"), 1.1)] == [1.0]


def test_a_sentence_that_is_missing_once_costs_no_fix() -> None:
    parts = seconds(4, rmc, gga)
    parts[1] = gga("120001.00")
    assert [fix.source_s - NOON_S for fix in taken(*parts, rmc("120004.00"))] == [0.0, 1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("quality", "deviation_m"),
    [("1", 2.7), ("2", 0.9), ("3", 2.7), ("4", 0.045), ("5", 0.27), ("6", 9.0)],
)
def test_deviation_is_hdop_times_the_range_error(quality: str, deviation_m: float) -> None:
    fixes = taken(gga("120000", quality), gga("120001", quality))
    assert fixes[0].deviation_m == pytest.approx(deviation_m)
    assert isnan(fixes[0].height_deviation_m)


@pytest.mark.parametrize(
    ("sentences", "why"),
    [
        (gga("120000", "0"), "no fix: GGA quality 0 (no fix)"),
        (gga("120000", "7"), "no fix: GGA quality 7 (typed in)"),
        (gga("120000", "8"), "no fix: GGA quality 8 (simulated)"),
        (gga("120000", ""), "no fix: GGA quality (no fix)"),
        (gga("", "0", ",,,"), "no fix: GGA quality 0 (no fix)"),
        (rmc("120000", "V"), "no fix: RMC status V"),
        (rmc("120000", mode="N"), "no fix: RMC mode N (no fix)"),
        (sentence(f"GNGNS,120000,{PLACE},NN,12,0.9,488.2,47.1,,"), "no fix: GNS mode NN (no fix)"),
        (sentence(f"GNGNS,120000,{PLACE},AM,12,0.9,488.2,47.1,,"), "no fix: GNS mode AM (typed in)"),
        (gga("120000", place="9123.8637,N,00832.7352,E"), "latitude 91.397"),
        (gga("120000", place="4723.8637,N,18100.0000,W"), "longitude -181.0"),
        (gga("120000", place="4799.8637,N,00832.7352,E"), "latitude nan is not within 90 degrees"),
        (gga("120000", place="4723.8637,X,00832.7352,E"), "latitude nan is not within 90 degrees"),
        (gga("120000", place="nan,N,inf,E"), "latitude nan is not within 90 degrees"),
        (gga("120000", place=",,,"), "no position in GGA"),
        (gga("250000"), "GGA without a time"),
        (gst("120000"), "no position in GST"),
        (gga("120000").replace(b"488", b"489"), "the checksum of GGA is wrong"),
    ],
)
def test_what_is_no_fix_says_why(sentences: bytes, why: str) -> None:
    stream = NmeaStream()
    stream.take(gga("115959"), 0.0)  # of another second, so that a single sentence is complete
    fixes = stream.take(sentences, 1.0)
    first, ended = stream.why, stream.take(gga("120001"), 2.0)
    assert why in first + stream.why
    assert {fix.source_s % 60 for fix in [*fixes, *ended]} <= {59.0, 1.0}


def test_another_doubtful_sentence_of_that_time_refuses_the_fix() -> None:
    assert taken(*seconds(2, gga, lambda time: rmc(time, "V"))) == []


def test_the_worst_constellation_of_gns_counts() -> None:
    def gns(time: str, modes: str) -> bytes:
        return sentence(f"GNGNS,{time},{PLACE},{modes},12,1.0,488.2,47.1,,")

    assert [
        fix.deviation_m for fix in taken(gns("120000", "RA"), gns("120001", "RN"), gns("120002", "RN"))
    ] == [
        3.0,
        0.05,
        0.05,
    ]
    empty = sentence("GLGNS,120000,,,,,,7,,,,,")
    assert len(taken(gns("120000", "AA") + empty, gns("120001", "AA") + empty)) == 2


def test_midnight_and_a_missing_date_are_no_jump() -> None:
    times = ("235959.50", "000000.00", "000000.50")
    dates = ("291126", "301126", "301126")
    with_dates = taken(*(rmc(time, date=date) for time, date in zip(times, dates, strict=True)))
    without = taken(*(gga(time) for time in times))
    late = taken(*(gga(time) + rmc(time, date=date) for time, date in zip(times, dates, strict=True)))
    for fixes in (with_dates, without, late):
        assert [fix.source_s - fixes[0].source_s for fix in fixes] == [0.0, 0.5, 1.0]
    assert with_dates[1].source_s == NOON_S + 43_200.0


def test_late_and_repeated_sentences_are_no_fix() -> None:
    fixes = taken(gga("120000"), gga("120001"), gga("120000") + gga("120001"), gga("120002"))
    assert [fix.source_s for fix in fixes] == [43_200.0, 43_201.0, 43_202.0]


def test_a_clock_that_is_set_back_goes_on() -> None:
    fixes = taken(gga("120000"), gga("120001"), gga("110000"), gga("110001"))
    assert [fix.source_s for fix in fixes] == [43_200.0, 43_201.0, 39_600.0, 39_601.0]


def test_speed_without_course_is_no_velocity() -> None:
    def moving(time: str, speed: str, course: str) -> bytes:
        return gga(time) + sentence(f"GPVTG,{course},T,,M,{speed},N,,K,A")

    fixes = taken(moving("120000", "1.0", ""), moving("120001", "0.0", ""), moving("120002", "2.0", "180.0"))
    assert isnan(fixes[0].north_m_s)
    assert (fixes[1].north_m_s, fixes[1].east_m_s) == (0.0, 0.0)
    assert (fixes[2].north_m_s, fixes[2].east_m_s) == pytest.approx((-1.0289, 0.0), abs=1e-4)


@pytest.mark.parametrize("value", ["1e999", "nan", "-5", "", "99999999", "0", "0x10"])
def test_impossible_errors_are_not_known(value: str) -> None:
    fixes = taken(gga("120000", hdop=value), gga("120001", hdop=value))
    assert isnan(fixes[0].deviation_m)


@pytest.mark.parametrize(
    ("place", "latitude_deg", "longitude_deg"),
    [
        ("0000.0001,S,00000.0001,W", -0.0001 / 60, -0.0001 / 60),
        ("8959.99999,S,17959.99999,E", -90 + 0.00001 / 60, 180 - 0.00001 / 60),
        ("4717,N,00833,E", 47 + 17 / 60, 8 + 33 / 60),
    ],
)
def test_degrees_and_minutes_are_a_place(place: str, latitude_deg: float, longitude_deg: float) -> None:
    (fix,) = taken(gga("120000", place=place), gga("120001", "0"))
    assert (fix.latitude_deg, fix.longitude_deg) == pytest.approx((latitude_deg, longitude_deg), abs=1e-11)


def test_endless_lines_and_junk_keep_no_memory() -> None:
    stream = NmeaStream()
    for _ in range(100):
        stream.take(b"$GPGGA," + b"1" * 10_000, 0.0)
    assert len(stream._waiting) <= 130
    assert stream.messages == 0
    assert [fix.source_s for fix in taken(gga("120000"), gga("120001"), stream=stream)] == [
        43_200.0,
        43_201.0,
    ]


def test_nothing_is_made_up() -> None:
    (fix,) = taken(rmc("120000", date=""), rmc("120001", "V"))
    assert repr(fix) == repr(
        TargetFix(0.0, LATITUDE_DEG, LONGITUDE_DEG, nan, fix.north_m_s, fix.east_m_s, source_s=43_200.0)
    )
