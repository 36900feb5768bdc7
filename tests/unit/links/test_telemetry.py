"""What is read of many vehicles at once: each value, and only of the vehicle that sent it."""

from math import inf, isnan, nan
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import development as dialect

from gcs.links.telemetry import FleetTelemetry, VehicleReport
from gcs.mavlink import codec
from gcs.mavlink.framing import PREARM_CHECK
from gcs.mavlink.kernels import SYSTEM
from gcs.model.state import Mode, Telemetry

IDS = ("a", "b")
ROW = 1


def take(fleet: FleetTelemetry, time_s: float, *messages: Any, component: int = 1) -> Telemetry:
    """The second vehicle sends these messages in one datagram."""
    sender = dialect.MAVLink(None, srcSystem=ROW + 1, srcComponent=component)
    data = np.frombuffer(bytearray(b"".join(bytes(each.pack(sender)) for each in messages)), np.uint8)
    frames = codec.find(data, np.array([0]), np.array([len(data)])).frames
    fleet.take(data, frames, frames[:, SYSTEM] - 1, np.full(len(frames), time_s))
    return fleet.telemetry()


def gps(h_acc_mm: int, v_acc_mm: int, *, eph: int = 70, epv: int = 110, fix: int = 3) -> Any:
    return dialect.MAVLink_gps_raw_int_message(0, fix, 1, 2, 3, eph, epv, 0, 0, 9, 0, h_acc_mm, v_acc_mm)


def odometry(counter: int) -> Any:
    nothing, covariance = (0.0, 0.0, 0.0), [nan] * 21
    q = (1.0, 0.0, 0.0, 0.0)
    return dialect.MAVLink_odometry_message(
        0, 1, 1, *nothing, q, *nothing, *nothing, covariance, covariance, counter, 8, 0
    )


def position(clock_ms: int) -> Any:
    return dialect.MAVLink_global_position_int_message(clock_ms, 1, 2, 3, 4, 5, 6, 7, 8)


def attitude(clock_ms: int) -> Any:
    return dialect.MAVLink_attitude_message(clock_ms, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0)


def beat(autopilot: int = 12) -> Any:
    return dialect.MAVLink_heartbeat_message(2, autopilot, 0x81, 6 << 16, 4, 3)


def status(enabled: int, health: int) -> Any:
    return dialect.MAVLink_sys_status_message(0x3F, enabled, health, 0, 0, 0, 80, 0, 0, 0, 0, 0, 0)


def system_time(unix_s: float) -> Any:
    return dialect.MAVLink_system_time_message(int(unix_s * 1e6), 5)


def text(part: bytes, text_id: int = 0, chunk: int = 0) -> Any:
    return dialect.MAVLink_statustext_message(4, part, text_id, chunk)


def test_nothing_is_known_before_the_first_frame() -> None:
    reported = FleetTelemetry(IDS).telemetry()
    assert (reported.heartbeat_time_s == -inf).all()
    assert (reported.position_time_s == -inf).all()
    assert (reported.armed[ROW], reported.mode[ROW], reported.ready[ROW]) == (False, Mode.UNKNOWN, False)


def test_heartbeats_and_positions_have_separate_times() -> None:
    fleet = FleetTelemetry(IDS)
    take(fleet, 1.0, beat())
    reported = take(fleet, 2.0, position(0))
    assert (reported.heartbeat_time_s[ROW], reported.position_time_s[ROW]) == (1.0, 2.0)
    assert (reported.armed, reported.mode) == ((False, True), (Mode.UNKNOWN, Mode.OFFBOARD))


def test_onboard_camera_does_not_count_as_the_autopilot() -> None:
    fleet = FleetTelemetry(IDS)
    take(fleet, 1.0, beat(), position(0), component=100)
    reported = take(fleet, 1.5, beat(autopilot=8))
    assert (reported.heartbeat_time_s[ROW], reported.position_time_s[ROW]) == (-inf, -inf)
    assert reported.mode[ROW] is Mode.UNKNOWN


def test_only_a_heartbeat_fires_the_event() -> None:
    fleet = FleetTelemetry(IDS)
    waiting = VehicleReport(fleet, ROW).next_heartbeat()
    take(fleet, 1.0, position(0))
    assert not waiting.is_set()
    take(fleet, 1.0, beat())
    assert waiting.is_set()
    assert not VehicleReport(fleet, ROW).next_heartbeat().is_set()


@pytest.mark.parametrize(
    ("base_mode", "state", "armed", "mode", "in_failsafe"),
    [
        (0x81, 4, True, Mode.HOLD, False),
        (0x01, 5, False, Mode.HOLD, False),
        (0x80, 4, True, Mode.OTHER, False),  # its custom mode is not valid
        (0x81, 5, True, Mode.HOLD, True),
        (0x81, 6, True, Mode.HOLD, True),
        (0x81, 8, True, Mode.TERMINATED, False),  # its motors are stopped, whatever its mode is
        (0x01, 8, False, Mode.HOLD, False),  # afterwards, on the ground
    ],
)
def test_heartbeat_gives_arming_mode_and_failsafe(
    base_mode: int, state: int, armed: bool, mode: Mode, in_failsafe: bool
) -> None:
    hold = 4 << 16 | 3 << 24
    message = dialect.MAVLink_heartbeat_message(2, 12, base_mode, hold, state, 3)
    reported = take(FleetTelemetry(IDS), 1.0, message)
    assert (reported.armed[ROW], reported.mode[ROW], reported.in_failsafe[ROW]) == (armed, mode, in_failsafe)


@pytest.mark.parametrize("health", [0, 0x10000000, 0xFFFFFFFF, 0xEFFFFFFF])
def test_ready_is_the_prearm_bit(health: int) -> None:
    reported = take(FleetTelemetry(IDS), 1.0, beat(), position(0), status(0, health))
    assert reported.ready[ROW] is bool(health & PREARM_CHECK)


def test_long_text_is_joined_from_its_chunks() -> None:
    fleet = FleetTelemetry(IDS)
    take(fleet, 1.0, text(b"a" * 50, 9, 0), text(b"b" * 50, 9, 1), text(b"end", 9, 2))
    assert VehicleReport(fleet, ROW).text == ("a" * 50 + "b" * 50 + "end", 1.0)
    reported = take(fleet, 2.0, text(b"next"))
    assert VehicleReport(fleet, ROW).text == ("next", 2.0)
    assert [each.text[-4:] for each in reported.texts[ROW]] == ["bend", "next"]
    assert reported.texts[0] == ()


def test_endless_chunks_stay_bounded() -> None:
    fleet = FleetTelemetry(IDS)
    for chunk in range(200):
        take(fleet, 1.0, text(b"a" * 50, 9, chunk))
    assert len(VehicleReport(fleet, ROW).text[0]) == 8 * 50


@pytest.mark.parametrize(
    ("message", "expected_m"),
    [
        (gps(900, 1780), (0.9, 1.78)),
        (gps(0, 0, eph=100, epv=200), (1.3, 3.2)),  # by dilution
        (gps(0, 0, eph=65535, epv=65535), (nan, nan)),
        (gps(900, 1780, fix=1), (inf, inf)),
        (gps(900, 0), (0.9, 1.76)),
    ],
)
def test_accuracy_is_reported_or_by_dilution_and_needs_a_fix(
    message: Any, expected_m: tuple[float, float]
) -> None:
    reported = take(FleetTelemetry(IDS), 1.0, message)
    accuracy_m = reported.horizontal_accuracy_m[ROW], reported.vertical_accuracy_m[ROW]
    assert accuracy_m == pytest.approx(expected_m, nan_ok=True)
    assert isnan(reported.horizontal_accuracy_m[0])


def test_reboot_shows_in_messages_before_the_first_position() -> None:
    fleet = FleetTelemetry(IDS)
    take(fleet, 0.9, status(PREARM_CHECK, PREARM_CHECK))
    assert (fleet.reboot_count[ROW], fleet.prearm_ok[ROW]) == (0, True)
    take(fleet, 1.0, position(60_000))
    for time_s, clock_ms in ((1.2, 100), (1.3, 200)):
        assert take(fleet, time_s, attitude(clock_ms)).reboot_count == (0, 0), "not one message alone"
    reported = take(fleet, 1.5, attitude(400))
    assert (reported.reboot_count[ROW], fleet.connection_count[ROW]) == (1, 1)
    assert (reported.position_time_s[ROW], fleet.prearm_ok[ROW]) == (1.0, False), "of the time before"
    take(fleet, 1.6, dialect.MAVLink_local_position_ned_message(510, 0, 0, 0, 0, 0, 0))
    take(fleet, 4.0, position(2900))
    assert (fleet.reboot_count[ROW], fleet.connection_count[ROW]) == (1, 1)


def test_a_reset_counter_that_changes_is_a_reset_of_the_position() -> None:
    fleet = FleetTelemetry(IDS)
    for counter, resets in ((3, 0), (3, 0), (4, 1), (4, 1), (0, 2)):
        assert take(fleet, 1.0, odometry(counter)).position_resets == (0, resets)
    take(fleet, 2.0, position(9000))
    for time_s, clock_ms in ((3.0, 100), (3.1, 200), (3.2, 300)):
        take(fleet, time_s, position(clock_ms))
    assert take(fleet, 3.3, odometry(7)).position_resets == (0, 2), "a restart is no reset"


def test_silent_vehicle_that_returns_is_discovered_again() -> None:
    fleet = FleetTelemetry(IDS)
    for time_s, connection_count in ((1.0, 1), (3.9, 1), (7.0, 2), (8.0, 2), (20.0, 3)):
        take(fleet, time_s, beat(), beat())
        assert fleet.connection_count.tolist() == [0, connection_count]


RECORDED = 0x301402F, 0x320C83F  # of PX4 SITL, which has no remote control


@pytest.mark.parametrize(
    ("message", "described", "expected"),
    [
        (gps(900, 1780, fix=6), "fix_type", 6.0),
        (gps(900, 1780, fix=0), "fix_type", 0.0),
        (status(*RECORDED), "unhealthy_sensors", 0),
        (status(RECORDED[0], RECORDED[1] & ~0x24), "unhealthy_sensors", 0x24),
        (status(RECORDED[0], RECORDED[1] & ~0x200000), "unhealthy_sensors", 0x200000),
        (status(RECORDED[0] & ~0x4, RECORDED[1] & ~0x4), "unhealthy_sensors", 0),  # not enabled
        (system_time(1.7e9), "clock_base_s", 1.7e9 - 8.0),
        (system_time(0.0), "clock_base_s", nan),  # PX4 does not know yet
        (system_time(1e9), "clock_base_s", nan),  # nor does it now
    ],
)
def test_fix_unhealthy_sensors_and_clock_are_read(message: Any, described: str, expected: float) -> None:
    fleet = FleetTelemetry(IDS)
    before = getattr(fleet.telemetry(), described)
    reported = getattr(take(fleet, 8.0, message), described)
    assert reported[ROW] == pytest.approx(expected, nan_ok=True)
    assert reported[0] == pytest.approx(before[0], nan_ok=True)


ALL, PROPULSION, AVIONICS, PAYLOAD, UNKNOWN = 1, 2, 3, 4, 0  # MAV_BATTERY_FUNCTION


def pack(battery_id: int, percent: int, function: int = ALL) -> Any:
    volts = [4000] * 10
    return dialect.MAVLink_battery_status_message(battery_id, function, 1, 2500, volts, -100, -1, -1, percent)


def total(percent: int) -> Any:
    return dialect.MAVLink_sys_status_message(0, 0, 0, 0, 16000, -100, percent, 0, 0, 0, 0, 0, 0)


def remaining(fleet: FleetTelemetry, time_s: float, *messages: Any) -> float:
    return float(take(fleet, time_s, *messages).battery_remaining[ROW])


@pytest.mark.parametrize(
    ("story", "expected"),
    [
        ((pack(0, 80), pack(1, 15)), (0.80, 0.15)),
        ((pack(1, 15), pack(0, 80)), (0.15, 0.15)),
        ((pack(0, 80), total(15), pack(0, 79), total(14)), (0.80, 0.15, 0.15, 0.14)),
        ((pack(0, 80), pack(1, 15), pack(0, 79), pack(1, 14)), (0.80, 0.15, 0.15, 0.14)),
        ((pack(0, 80), pack(1, -1), pack(1, 70), pack(1, -1)), (0.80, 0.80, 0.70, 0.80)),
        ((pack(126, 33), pack(0, 80)), (0.33, 0.33)),  # of CAN, where the id is the node's
        ((pack(0, -1), total(-1)), (nan, nan)),
    ],
)
def test_the_emptiest_battery_counts(story: tuple[Any, ...], expected: tuple[float, ...]) -> None:
    """A vehicle with two packs never flaps between them."""
    fleet = FleetTelemetry(IDS)
    read = [
        take(fleet, float(time_s), message).battery_remaining.tolist() for time_s, message in enumerate(story)
    ]
    np.testing.assert_allclose(np.array(read)[:, ROW], expected)
    assert np.isnan(np.array(read)[:, 0]).all()


def test_a_restart_forgets_the_packs() -> None:
    fleet = FleetTelemetry(IDS)
    assert remaining(fleet, 1.0, position(9000), pack(1, 15)) == 0.15
    for time_s, clock_ms in ((3.0, 100), (3.1, 200), (3.2, 300)):
        take(fleet, time_s, position(clock_ms))
    assert isnan(remaining(fleet, 3.3))
    assert remaining(fleet, 3.4, pack(0, 100)) == 1.0


@pytest.mark.parametrize(
    ("function", "expected"),
    [(UNKNOWN, 0.03), (ALL, 0.03), (PROPULSION, 0.03), (AVIONICS, 0.80), (PAYLOAD, 0.80)],
)
def test_only_packs_that_may_feed_the_motors_count(function: int, expected: float) -> None:
    fleet = FleetTelemetry(IDS)
    assert remaining(fleet, 1.0, beat(), total(80), pack(0, 80), pack(1, 3, function)) == expected
    assert remaining(fleet, 2.0, pack(0, 79)) == min(expected, 0.79)


def on_ground() -> Any:
    return dialect.MAVLink_heartbeat_message(2, 12, 0x01, 6 << 16, 3, 3)


@pytest.mark.parametrize(("heartbeat", "left"), [(beat(), 0.03), (on_ground(), 0.80)])
def test_silent_pack_is_forgotten_only_on_the_ground(
    heartbeat: Any, left: float, caplog: pytest.LogCaptureFixture
) -> None:
    fleet = FleetTelemetry(IDS)
    assert remaining(fleet, 0.0, heartbeat, pack(0, 80), pack(1, 3)) == 0.03
    charges = [remaining(fleet, 1.0 + second, heartbeat, pack(0, 80)) for second in range(20)]
    assert charges[:10] == [0.03] * 10
    assert charges[-1] == left
    forgotten = [record for record in caplog.records if record.msg == "battery_forgotten"]
    assert [(record.__dict__["vehicle"], record.__dict__["pack"]) for record in forgotten] == (
        [("b", 1)] if left == 0.80 else []
    )


def test_a_broken_link_forgets_no_pack() -> None:
    """After a pause the packs report one after the other: none of them fell silent by itself."""
    fleet = FleetTelemetry(IDS)
    assert remaining(fleet, 0.0, on_ground(), pack(0, 80), pack(1, 3)) == 0.03
    assert remaining(fleet, 60.0, on_ground(), pack(0, 80)) == 0.03


def test_an_attitude_has_its_time_and_its_three_angles() -> None:
    fleet = FleetTelemetry(IDS)
    reported = take(fleet, 2.0, attitude(5))
    assert reported.attitude_rad[ROW] == pytest.approx([0.1, 0.2, 0.3], abs=1e-7)
    assert (reported.attitude_time_s[ROW], reported.attitude_time_s[1 - ROW]) == (2.0, -inf)
    assert np.isnan(reported.attitude_rad[1 - ROW]).all()
    assert reported.position_time_s[ROW] == -inf


@pytest.mark.parametrize("angle", [0.0, -0.0, -1.5, 3.1, 1e-40, -1e-45, 3.4e38, inf, -inf, nan])
def test_every_number_of_single_precision_is_read_as_it_is(angle: float) -> None:
    sent = dialect.MAVLink_attitude_message(5, angle, angle, angle, 0.0, 0.0, 0.0)
    reported = take(FleetTelemetry(IDS), 2.0, sent).attitude_rad[ROW]
    expected = np.float64(np.float32(angle)) if np.isfinite(angle) else np.nan
    np.testing.assert_array_equal(reported, np.full(3, expected))


def test_a_late_attitude_changes_nothing() -> None:
    fleet = FleetTelemetry(IDS)
    take(fleet, 2.0, attitude(5000))
    late = dialect.MAVLink_attitude_message(4000, 0.5, 0.5, 0.5, 0.0, 0.0, 0.0)
    assert take(fleet, 2.1, late).attitude_rad[ROW] == pytest.approx([0.1, 0.2, 0.3], abs=1e-7)
