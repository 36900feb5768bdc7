"""Reports of fake targets: their errors, and their bytes as independent readers understand them."""

import json
from itertools import islice, pairwise
from math import hypot, isnan, nan
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from pymavlink.dialects.v20 import common
from pynmeagps import NMEAReader

from gcs.sim.settings import Origin
from gcs.sim.targets import formats
from gcs.sim.targets.motions import State, motion
from gcs.sim.targets.reports import Errors, Report, reports

UNIX_S = 1_777_629_600.0  # 2026-05-01 10:00
STILL, SOUTH_WEST = motion("still"), Origin(-33.856784, -70.000001, 12.0)
REPORT = Report(2.5, 2.8, 2.5, 47.397742, 8.545594, 488.25, 3.0, -4.0, 0.5, 1.5)


def some(errors: Errors, count: int = 2000, seed: int = 1) -> list[Report]:
    return list(islice(reports(STILL, Origin(), errors, seed), count))


def off_m(report: Report) -> tuple[float, float]:
    return (
        (report.latitude_deg - Origin().latitude_deg) * 111_180.0,
        (report.longitude_deg - Origin().longitude_deg) * 75_460.0,
    )


def test_without_errors_reports_are_the_motion() -> None:
    made = list(islice(reports(motion("straight", course_deg=90.0), Origin(), Errors(noise_m=0.0)), 50))
    assert [report.taken_s for report in made] == pytest.approx([0.2 * number for number in range(50)])
    assert all(report.sent_s == report.clock_s == report.taken_s for report in made)
    assert [off_m(report) for report in made] == [
        pytest.approx((0.0, 10.0 * report.taken_s), abs=0.1) for report in made
    ]
    assert all((report.north_m_s, report.east_m_s) == pytest.approx((0.0, 10.0)) for report in made)


@pytest.mark.soak
def test_noise_has_the_spread_that_is_asked_for() -> None:
    """And is the same for the same seed."""
    for correlated_s in (0.0, 2.0):
        errors = Errors(noise_m=3.0, correlated_s=correlated_s)
        made = some(errors, 20_000)
        north_m = np.array([off_m(report)[0] for report in made])
        assert north_m.std() == pytest.approx(3.0, rel=0.1)
        neighbours = np.corrcoef(north_m[:-1], north_m[1:])[0, 1]
        assert neighbours == pytest.approx(np.exp(-0.2 / 2.0) if correlated_s else 0.0, abs=0.03)
        assert some(errors, 50) == made[:50]
        assert some(errors, 50, seed=2) != made[:50]


def test_delay_and_clock_are_wrong_as_asked_for() -> None:
    errors = Errors(delay_s=0.3, clock=(5.0, 1000.0), clock_step=(-2.0, 10.0))
    made = some(errors, 100)
    assert all(report.sent_s - report.taken_s == pytest.approx(0.3) for report in made)
    assert made[5].clock_s == pytest.approx(1.0 * 1.001 + 5.0)
    assert made[75].clock_s == pytest.approx(15.0 * 1.001 + 3.0)


def test_drop_outs_jumps_and_freezes_come_as_asked_for() -> None:
    gaps_s = np.diff([report.taken_s for report in some(Errors(drop_out=(0.02, 3.0)))])
    assert set(np.round(gaps_s, 6)) > {0.2}
    assert gaps_s[gaps_s > 0.3].min() == pytest.approx(3.2, abs=0.21)
    assert 10 < np.count_nonzero(gaps_s > 0.3) < 60
    jumped = [
        report.taken_s
        for report in some(Errors(noise_m=0.0, jump=(40.0, 10.0)), 300)
        if hypot(*off_m(report)) > 39
    ]
    assert jumped == pytest.approx([10.0, 20.0, 30.0, 40.0, 50.0])
    frozen = some(Errors(freeze=(10.0, 5.0)), 200)
    places = [report[3:6] for report in frozen]
    assert len(set(places[49:75])) == 1, "the last one before is repeated"
    assert len(set(places)) == 175
    assert len({report.clock_s for report in frozen}) == 200


def test_doubled_unknown_and_swapped_reports_come_as_asked_for() -> None:
    made = some(Errors(doubled=0.5))
    assert 500 < sum(before == after for before, after in pairwise(made)) < 820
    unknown = [isnan(report.latitude_deg) for report in some(Errors(unknown=0.1))]
    assert 0.07 < np.mean(unknown) < 0.13
    (swapped,) = some(Errors(noise_m=0.0, swapped=True), 1)
    assert (swapped.latitude_deg, swapped.longitude_deg) == pytest.approx((8.545594, 47.397742))


def sentences(report: Report) -> list[Any]:
    data = formats.nmea(UNIX_S)(report)
    return [NMEAReader.parse(line + b"\r\n", validate=1) for line in data.split(b"\r\n")[:-1]]


def test_nmea_is_read_by_another_reader() -> None:
    gga, rmc, gst = sentences(REPORT)
    assert [each.identity for each in (gga, rmc, gst)] == ["GNGGA", "GNRMC", "GNGST"]
    assert (gga.lat, gga.lon, gga.alt, gga.quality) == (
        pytest.approx(47.397742),
        pytest.approx(8.545594),
        488.25,
        1,
    )
    assert (rmc.lat, rmc.lon, rmc.status) == (pytest.approx(47.397742), pytest.approx(8.545594), "A")
    assert (rmc.spd * 1852 / 3600, rmc.cog) == pytest.approx((5.0, 306.87), abs=0.01)
    assert f"{rmc.date} {rmc.time} {gga.time}" == "2026-05-01 10:00:02.500000 10:00:02.500000"
    assert (gst.stdLat, gst.stdLong, gst.stdAlt) == (1.5, 1.5, 2.25)


def test_nmea_has_hemispheres_and_carries_minutes() -> None:
    """60 minutes are a degree more."""
    gga, _, _ = sentences(REPORT._replace(latitude_deg=-33.856784, longitude_deg=-70.9999999999))
    assert (gga.lat, gga.lon) == pytest.approx((-33.856784, -71.0))
    assert b",07100.000000,W," in formats.nmea(UNIX_S)(REPORT._replace(longitude_deg=-70.9999999999))
    assert b",nan,N,nan,E," in formats.nmea(UNIX_S)(REPORT._replace(latitude_deg=nan, longitude_deg=nan))


def test_tpv_of_gpsd_is_json() -> None:
    values = json.loads(formats.tpv(UNIX_S)(REPORT))
    assert (values["class"], values["mode"], values["time"]) == ("TPV", 3, "2026-05-01T10:00:02.500Z")
    assert (values["lat"], values["lon"], values["altMSL"]) == (47.397742, 8.545594, 488.25)
    assert values["altHAE"] - values["altMSL"] == pytest.approx(formats.GEOID_M)
    assert (values["speed"], values["climb"], values["epx"]) == (5.0, -0.5, 1.5)
    assert values["track"] == pytest.approx(306.87, abs=0.01)


def test_cot_is_an_event_whatever_its_name() -> None:
    name = 'a "<&> b'
    event = ET.fromstring(formats.cot(UNIX_S, name)(REPORT))  # noqa: S314 - our own
    point, contact, track = (event.find(tag) for tag in ("point", "detail/contact", "detail/track"))
    assert point is not None
    assert contact is not None
    assert track is not None
    assert (event.tag, event.get("version"), event.get("uid"), contact.get("callsign")) == (
        "event",
        "2.0",
        name,
        name,
    )
    assert (event.get("time"), event.get("stale")) == ("2026-05-01T10:00:02.500Z", "2026-05-01T10:00:12.500Z")
    place = [float(point.get(key, "")) for key in ("lat", "lon", "hae", "ce")]
    assert place == pytest.approx([47.397742, 8.545594, 488.25 + formats.GEOID_M, 1.5])
    assert (float(track.get("speed", "")), float(track.get("course", ""))) == (5.0, 306.87)


def frames(data: bytes) -> list[Any]:
    return list(common.MAVLink(None).parse_buffer(data))


def test_mavlink_is_a_system_of_its_own() -> None:
    """With a heartbeat and its receiver once a second."""
    encode = formats.Mavlink(42)
    messages = frames(encode(REPORT))
    kinds = ["HEARTBEAT", "GPS_RAW_INT", "GLOBAL_POSITION_INT"]
    assert [each.get_type() for each in messages] == kinds
    later = frames(encode(REPORT._replace(sent_s=3.0)) + encode(REPORT._replace(sent_s=3.9)))
    assert [each.get_type() for each in later] == [kinds[2], *kinds]
    assert [each.get_seq() for each in (*messages, *later)] == list(range(7))
    assert {each.get_srcSystem() for each in messages} == {42}
    fix = messages[2]
    assert (fix.lat, fix.lon, fix.alt, fix.time_boot_ms) == (473_977_420, 85_455_940, 488_250, 62_500)
    assert (fix.vx, fix.vy, fix.vz, messages[1].h_acc) == (300, -400, 50, 1500)
    (unknown,) = frames(encode(REPORT._replace(latitude_deg=nan, sent_s=4.0)))
    assert (unknown.lat, unknown.lon, unknown.alt) == (2**31 - 1,) * 3


def test_follow_target_is_read_by_another_reader() -> None:
    *_, fix = frames(formats.Mavlink(9, follow_target=True)(REPORT))
    assert (fix.get_type(), fix.lat, fix.lon, fix.alt) == ("FOLLOW_TARGET", 473_977_420, 85_455_940, 488.25)
    assert (fix.vel, fix.position_cov[:2], fix.est_capabilities) == ([3.0, -4.0, 0.5], [1.5, 2.25], 3)


@pytest.mark.parametrize(
    "encode", [formats.nmea(UNIX_S), formats.tpv(UNIX_S), formats.cot(UNIX_S, "t"), formats.Mavlink(1)]
)
def test_wild_reports_can_be_sent(encode: formats.Encoder) -> None:
    """Of a receiver that is broken: jumps, speeds and clocks that no format has room for."""
    errors = Errors(noise_m=100.0, jump=(1e6, 1.0), clock=(-3000.0, 1e5), unknown=0.3, swapped=True)
    fast = reports(lambda time_s: State(900.0 * time_s, 0.0, 0.0, 900.0, 0.0, -900.0), SOUTH_WEST, errors)
    assert all(encode(report) for report in islice(fast, 300))
