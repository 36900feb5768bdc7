from math import inf, isnan, nan
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as dialect

from gcs.links.telemetry import VehicleTelemetry
from gcs.mavlink.framing import PREARM_CHECK, split
from gcs.model.state import Mode


def take(telemetry: VehicleTelemetry, time_s: float, *messages: Any, component: int = 1) -> None:
    packer = dialect.MAVLink(None, srcSystem=1, srcComponent=component)
    for message in messages:
        for frame in split(bytes(message.pack(packer))).frames:
            telemetry.take(frame, time_s)


def beat(autopilot: int = 12) -> Any:
    return dialect.MAVLink_heartbeat_message(2, autopilot, 0x81, 6 << 16, 4, 3)


def position() -> Any:
    return dialect.MAVLink_global_position_int_message(0, 1, 2, 3, 4, 5, 6, 7, 8)


def text(part: bytes, text_id: int = 0, chunk: int = 0) -> Any:
    return dialect.MAVLink_statustext_message(4, part, text_id, chunk)


def test_nothing_is_received_before_the_first_frame() -> None:
    telemetry = VehicleTelemetry()
    assert (telemetry.time_s, telemetry.heartbeat_time_s, telemetry.position_time_s) == (-inf, -inf, -inf)
    assert (telemetry.armed, telemetry.mode, telemetry.prearm_ok) == (False, Mode.UNKNOWN, False)


def test_heartbeats_and_positions_have_separate_times() -> None:
    telemetry = VehicleTelemetry()
    take(telemetry, 1.0, beat())
    take(telemetry, 2.0, position())
    assert (telemetry.time_s, telemetry.heartbeat_time_s, telemetry.position_time_s) == (2.0, 1.0, 2.0)
    assert (telemetry.armed, telemetry.mode) == (True, Mode.OFFBOARD)


def test_onboard_camera_does_not_count_as_the_autopilot() -> None:
    telemetry = VehicleTelemetry()
    take(telemetry, 1.0, beat(), position(), component=100)
    take(telemetry, 1.5, beat(autopilot=8))
    assert (telemetry.heartbeat_time_s, telemetry.position_time_s) == (-inf, -inf)
    assert telemetry.mode is Mode.UNKNOWN
    assert telemetry.time_s == 1.5


def test_heartbeat_counts_as_telemetry() -> None:
    telemetry = VehicleTelemetry()
    waiting = telemetry.news
    take(telemetry, 1.0, position())
    assert not waiting.is_set()
    take(telemetry, 1.0, beat())
    assert waiting.is_set()
    assert not telemetry.news.is_set()


def test_long_text_is_joined_from_its_chunks() -> None:
    telemetry = VehicleTelemetry()
    take(telemetry, 1.0, text(b"a" * 50, 9, 0), text(b"b" * 50, 9, 1), text(b"end", 9, 2))
    assert telemetry.text == "a" * 50 + "b" * 50 + "end"
    take(telemetry, 2.0, text(b"next"))
    assert (telemetry.text, telemetry.text_time_s) == ("next", 2.0)


def test_endless_chunks_stay_bounded() -> None:
    telemetry = VehicleTelemetry()
    for chunk in range(200):
        take(telemetry, 1.0, text(b"a" * 50, 9, chunk))
    assert len(telemetry.text) == 8 * 50


def gps(h_acc_mm: int, v_acc_mm: int, *, fix: int = 3, eph: int = 70, epv: int = 110) -> Any:
    return dialect.MAVLink_gps_raw_int_message(
        0, fix, 1, 2, 3, eph, epv, 0, 0, 10, 0, h_acc_mm, v_acc_mm, 0, 0, 0
    )


def odometry(counter: int) -> Any:
    nothing, covariance = (0.0, 0.0, 0.0), [nan] * 21
    q = (1.0, 0.0, 0.0, 0.0)
    return dialect.MAVLink_odometry_message(
        0, 1, 1, *nothing, q, *nothing, *nothing, covariance, covariance, counter, 8, 0
    )


def test_accuracy_is_reported_or_by_dilution_and_needs_a_fix() -> None:
    telemetry = VehicleTelemetry()
    assert all(isnan(value) for value in telemetry.accuracy)
    take(telemetry, 1.0, gps(900, 1780))
    assert telemetry.accuracy == (0.9, 1.78)
    take(telemetry, 2.0, gps(0, 0, eph=100, epv=200))
    assert telemetry.accuracy == pytest.approx((1.3, 3.2))
    take(telemetry, 3.0, gps(0, 0, eph=65535, epv=65535))
    assert all(isnan(value) for value in telemetry.accuracy)
    take(telemetry, 4.0, gps(900, 1780, fix=1))
    assert telemetry.accuracy == (inf, inf)


def test_boot_clock_going_back_is_a_reboot_unless_late() -> None:
    telemetry = VehicleTelemetry()
    for clock_ms, reboot_count in ((5000, 0), (6000, 0), (5500, 0), (200, 1), (300, 1), (900_000, 1), (0, 2)):
        take(telemetry, 1.0, dialect.MAVLink_global_position_int_message(clock_ms, 1, 2, 3, 4, 5, 6, 7, 8))
        assert telemetry.reboot_count == reboot_count, clock_ms


def test_reboot_shows_in_messages_before_the_first_position() -> None:
    telemetry = VehicleTelemetry()
    ok = PREARM_CHECK
    take(telemetry, 0.9, dialect.MAVLink_sys_status_message(ok, ok, ok, 0, 0, 0, 80, 0, 0, 0, 0, 0, 0))
    assert (telemetry.reboot_count, telemetry.prearm_ok) == (0, True)
    take(telemetry, 1.0, dialect.MAVLink_global_position_int_message(60_000, 1, 2, 3, 4, 5, 6, 7, 8))
    take(telemetry, 1.2, dialect.MAVLink_attitude_message(400, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert (telemetry.reboot_count, telemetry.connection_count, telemetry.position_time_s) == (1, 1, 1.0)
    assert (telemetry.reboot_count, telemetry.prearm_ok) == (1, False), "what it said before counts no more"
    take(telemetry, 1.3, dialect.MAVLink_local_position_ned_message(410, 0, 0, 0, 0, 0, 0))
    take(telemetry, 4.0, dialect.MAVLink_global_position_int_message(3100, 1, 2, 3, 4, 5, 6, 7, 8))
    assert (telemetry.reboot_count, telemetry.connection_count) == (1, 1)


def test_a_reset_counter_that_changes_is_a_reset_of_the_position() -> None:
    telemetry = VehicleTelemetry()
    for counter, resets in ((3, 0), (3, 0), (4, 1), (4, 1), (0, 2)):
        take(telemetry, 1.0, odometry(counter))
        assert telemetry.position_resets == resets
