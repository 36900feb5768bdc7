"""A target's positions out of MAVLink, and in words why there are none."""

from dataclasses import asdict
from math import isnan, nan

import pytest
from pymavlink.dialects.v20 import common

from gcs.links.targets.mavlink import REMEMBERED_MAX, SILENT_S, BootClock
from gcs.model.target_fix import TargetFix
from tests.support.target_fakes import (
    LATITUDE,
    LONGITUDE,
    aircraft,
    followed,
    packed,
    position,
    taken,
    vessel,
)

UNKNOWN = 2**31 - 1
HEARTBEAT = common.MAVLink_heartbeat_message(10, 12, 0, 0, 4, 3)


def receiver(accuracy_mm: int) -> common.MAVLink_gps_raw_int_message:
    return common.MAVLink_gps_raw_int_message(
        0, 3, LATITUDE, LONGITUDE, 488_000, 80, 120, 100, 0, 12,
        h_acc=accuracy_mm, v_acc=2 * accuracy_mm, vel_acc=accuracy_mm // 10,
    )  # fmt: skip


def approximately(**expected: object) -> dict[str, object]:
    """All fields of a report; those that are not named are not known."""
    usual = asdict(TargetFix(nan, nan, nan)) | {"latitude_deg": 47.397742, "longitude_deg": 8.545594}
    return usual | expected


def test_position_is_read_with_velocity_and_clock() -> None:
    (fix,), _, _ = taken(packed(position()))
    assert asdict(fix) == pytest.approx(
        approximately(
            arrived_s=0.25, altitude_amsl_m=488.0, north_m_s=1.0, east_m_s=-2.0, down_m_s=0.3, source_s=5.0
        ),
        nan_ok=True,
    )


def test_accuracy_of_the_receiver_is_the_deviation_while_new() -> None:
    """0 and 4294967295 mean that none is reported."""
    fixes, _, _ = taken(packed(receiver(1200)), packed(position()), *[packed(position())] * 14)
    assert (fixes[0].deviation_m, fixes[0].height_deviation_m) == pytest.approx((1.2, 2.4))
    assert fixes[0].velocity_deviation_m_s == pytest.approx(0.12)
    assert isnan(fixes[-1].deviation_m)
    (unknown,), _, _ = taken(packed(receiver(0), position()))
    assert isnan(unknown.deviation_m)


def test_follow_target_is_read_with_what_it_has() -> None:
    (fix,), _, _ = taken(packed(followed()))
    expected = approximately(
        arrived_s=0.25, altitude_amsl_m=488.0, north_m_s=1.0, east_m_s=-2.0, down_m_s=0.25, source_s=5.0,
        deviation_m=2.0, height_deviation_m=3.0,
    )  # fmt: skip
    assert asdict(fix) == pytest.approx(expected, nan_ok=True)
    (fix,), _, _ = taken(packed(followed(0, 1, spread=(0.0, nan, 0.0), altitude_m=nan)))
    assert asdict(fix) == pytest.approx(approximately(arrived_s=0.25), nan_ok=True)


def test_one_message_of_one_component_is_followed() -> None:
    """Two clocks of one system would contradict each other; another counts after a silence."""
    both = packed(position(1000), followed(9_000_000)) + packed(position(70_000), component_id=100)
    fixes, reports, now_s = taken(both, both)
    assert [fix.source_s for fix in fixes] == [1.0, 1.0]
    late_s = now_s + SILENT_S
    assert [fix.source_s for fix in reports.take(packed(followed(9_000_000)), late_s)] == [9000.0]


def test_aircraft_of_the_system_is_a_track() -> None:
    (fix,), _, _ = taken(packed(aircraft(), aircraft(0xABCDEF)), track="4ca1b2")
    expected = approximately(
        arrived_s=0.25, altitude_amsl_m=900.0, north_m_s=0.0, east_m_s=50.0, down_m_s=-1.5, source_s=-0.75,
        track="4CA1B2", kind="manned",
    )  # fmt: skip
    assert asdict(fix) == pytest.approx(expected, nan_ok=True, abs=1e-9)


@pytest.mark.parametrize(
    ("message", "pressure_m"),
    [(aircraft(flags=1), nan), (aircraft(altitude_type=0, course=65_535, climb=32_767), 900.0)],
    ids=["flags", "values"],
)
def test_what_an_aircraft_does_not_say_is_unknown(
    message: common.MAVLink_adsb_vehicle_message, pressure_m: float
) -> None:
    """A pressure is no height above mean sea level."""
    (fix,), _, _ = taken(packed(message), track="4CA1B2")
    expected = approximately(
        arrived_s=0.25, source_s=-0.75, track="4CA1B2", kind="manned", pressure_altitude_m=pressure_m
    )
    assert asdict(fix) == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize(
    ("flags", "velocity_m_s", "deviation_m"), [(7, -4.0, 5.0), (6, -4.0, 20.0), (15, nan, 5.0)]
)
def test_vessel_is_a_track(flags: int, velocity_m_s: float, deviation_m: float) -> None:
    (fix,), _, _ = taken(packed(vessel(flags=flags), vessel(1)), track="211234560")
    assert fix.track == "211234560"
    assert fix.source_s == pytest.approx(0.25 - 3)
    assert fix.north_m_s == pytest.approx(velocity_m_s, nan_ok=True)
    assert fix.deviation_m == deviation_m


def test_track_that_is_only_older_is_no_report() -> None:
    """Receivers repeat a position once a second, and count its age."""
    ages = [packed(vessel(age_s=age_s)) for age_s in (1, 2, 3, 0, 1)]
    fixes, _, _ = taken(
        *ages, packed(vessel(age_s=2, latitude=LATITUDE + 50)), track="211234560", every_s=1.0
    )
    assert [fix.arrived_s for fix in fixes] == [1.0, 4.0, 6.0]


REFUSED = {
    "the position is 0, 0: none is known yet": position(latitude=0, longitude=0),
    "the position is reported as unknown (2147483647)": position(latitude=UNKNOWN),
    "the position 91.0000000, 8.5455940 is out of range": position(latitude=910_000_000),
    "the altitude 99000 m is out of range; from -500 to 20000 m counts": position(altitude_mm=99_000_000),
    "FOLLOW_TARGET without a position (est_capabilities 2)": followed(capabilities=2),
    "FOLLOW_TARGET with 1e+09 m/s; at most 350 count": followed(velocity=(1e9, 0.0, 0.0)),
}
REFUSED_TRACKS = {
    "4CA1B2 without a valid position (flags 0)": aircraft(flags=0),
    "4CA1B2 was received 90 s ago (tslc); at most 60 s count": aircraft(age_s=90),
}
SILENT = {
    "nothing arrives at udp://127.0.0.1:14560": b"",
    "what arrives at udp://127.0.0.1:14560 is not MAVLink, or damaged": b"$GPGGA,1",
    "system 7 is not received; received: 1, 2": packed(HEARTBEAT, system_id=2)
    + packed(HEARTBEAT, system_id=1),
    "system 7 sends neither GLOBAL_POSITION_INT nor FOLLOW_TARGET": packed(HEARTBEAT),
}
SILENT_TRACKS = {
    "system 7 does not report 4CA1B2; reported: no track": packed(position()),
    "system 7 does not report 4CA1B2; reported: ABCDEF, 211234560": packed(vessel(), aircraft(0xABCDEF)),
}
REASONS = [
    *((f"system 7: {why}", packed(message), "") for why, message in REFUSED.items()),
    *((f"system 7: {why}", packed(message), "4CA1B2") for why, message in REFUSED_TRACKS.items()),
    *((why, datagram, "") for why, datagram in SILENT.items()),
    *((why, datagram, "4CA1B2") for why, datagram in SILENT_TRACKS.items()),
    (f"{list(SILENT)[1]}", packed(position())[:-1] + b"\x00", ""),
]


@pytest.mark.parametrize(("why", "datagram", "track"), REASONS, ids=[each[0] for each in REASONS])
def test_why_there_is_no_report_is_named(why: str, datagram: bytes, track: str) -> None:
    fixes, reports, now_s = taken(*[datagram] * 10, track=track)
    assert fixes == []
    assert reports.why_silent(now_s) == why
    assert reports.why_silent(now_s + 0.5) == "", "once a second"


def test_reports_are_no_silence() -> None:
    _, reports, now_s = taken(*[packed(position())] * 20)
    assert reports.why_silent(now_s) == ""
    assert reports.why_silent(now_s + 5.0) == "system 7 has sent nothing for 5 s"


def test_unknown_height_and_velocity_of_a_position_are_unknown() -> None:
    (fix,), _, _ = taken(packed(position(altitude_mm=UNKNOWN, velocity=(32_767, 0, 0))))
    assert asdict(fix) == pytest.approx(approximately(arrived_s=0.25, source_s=5.0), nan_ok=True)


def test_systems_and_tracks_that_are_remembered_are_few() -> None:
    """The texts name some of them."""
    datagrams = [packed(HEARTBEAT, system_id=system_id) for system_id in range(8, 256)]
    _, reports, now_s = taken(*datagrams, every_s=0.01)
    assert len(reports._systems) == REMEMBERED_MAX
    assert reports.why_silent(now_s).endswith("192, 193, 194, 195, 196, 197, 198, 199 and 56 more")
    _, reports, _ = taken(packed(*(vessel(mmsi) for mmsi in range(500))), track="211234560")
    assert len(reports._tracks) == REMEMBERED_MAX


def test_clock_of_32_bits_continues_and_begins_anew() -> None:
    clock = BootClock()
    times_ms = [2**32 - 300, 2**32 - 100, 2**32 - 200, 100, 300, 5_000_000, 1200, 1400]
    assert [clock.seconds(time_ms) for time_ms in times_ms] == pytest.approx(
        [4_294_966.996, 4_294_967.196, 4_294_967.096, 4_294_967.396, 4_294_967.596, 4_299_967.296, 1.2, 1.4]
    )
