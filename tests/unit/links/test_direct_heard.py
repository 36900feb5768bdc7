"""What the native transport reads of many vehicles at once is what the wire reads of each."""

from math import isnan, nan
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import development as dialect

from gcs.links.telemetry import VehicleTelemetry
from gcs.links.udp.telemetry import FleetTelemetry
from gcs.mavlink import codec
from gcs.mavlink.framing import PREARM_CHECK, split
from gcs.mavlink.kernels import SYSTEM

IDS = ("a", "b")


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


BEAT = dialect.MAVLink_heartbeat_message(2, 12, 1, 0, 4, 3)

STATUS = dialect.MAVLink_sys_status_message(*[PREARM_CHECK] * 3, 0, 0, 0, 80, 0, 0, 0, 0, 0, 0)

STORY = (
    (position(5000), odometry(3), gps(900, 1780)),
    (position(6000), position(5500), odometry(3), gps(0, 0, eph=100, epv=200)),  # one came late
    (BEAT, position(200), odometry(0), gps(0, 0, eph=65535, epv=65535)),  # it has restarted
    (position(300), odometry(1), gps(900, 1780, fix=1)),
    (position(900_000), odometry(1), odometry(2), gps(900, 0)),
    (BEAT, position(0), position(10), odometry(7), odometry(8)),
    (position(7000), attitude(7010), STATUS),
    (BEAT, attitude(150), odometry(9)),  # it has restarted again, and has no position yet
    (attitude(3990), position(4000), odometry(9)),
)


def both(each: VehicleTelemetry, fleet: FleetTelemetry, messages: tuple[Any, ...], time_s: float) -> None:
    sender = dialect.MAVLink(None, srcSystem=2, srcComponent=1)
    data = b"".join(bytes(message.pack(sender)) for message in messages)
    for frame in split(data).frames:
        each.take(frame, time_s)
    flat = np.frombuffer(data, np.uint8).copy()
    frames = codec.find(flat, np.array([0]), np.array([len(data)])).frames
    fleet.take(flat, frames, frames[:, SYSTEM] - 1, np.full(len(frames), time_s))


def test_accuracies_restarts_and_resets_match_the_framed_link() -> None:
    fleet, each = FleetTelemetry(IDS), VehicleTelemetry()
    for time_s, messages in enumerate(STORY):
        both(each, fleet, messages, float(time_s))
        reported = fleet.telemetry()
        assert (reported.reboot_count, reported.position_resets) == (
            (0, each.reboot_count),
            (0, each.position_resets),
        )
        assert fleet.connection_count.tolist() == [0, each.connection_count]
        assert fleet.prearm_ok.tolist() == [False, each.prearm_ok]
        accuracy_m = reported.horizontal_accuracy_m[1], reported.vertical_accuracy_m[1]
        assert accuracy_m == pytest.approx(tuple(each.accuracy), nan_ok=True)
    assert (each.reboot_count, each.position_resets, each.connection_count) == (3, 3, 4)


def test_silent_vehicle_that_returns_is_discovered_again() -> None:
    fleet, each = FleetTelemetry(IDS), VehicleTelemetry()
    for time_s, connection_count in ((1.0, 1), (3.9, 1), (7.0, 2), (8.0, 2), (20.0, 3)):
        both(each, fleet, (BEAT, BEAT), time_s)
        assert (fleet.connection_count[1], each.connection_count) == (connection_count, connection_count)


def system_time(unix_s: float) -> Any:
    return dialect.MAVLink_system_time_message(int(unix_s * 1e6), 5)


def status(enabled: int, health: int) -> Any:
    return dialect.MAVLink_sys_status_message(0x3F, enabled, health, 0, 0, 0, 80, 0, 0, 0, 0, 0, 0)


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
def test_both_readers_report_fix_unhealthy_sensors_and_clock(
    message: Any, described: str, expected: float
) -> None:
    fleet, each = FleetTelemetry(IDS), VehicleTelemetry()
    before = getattr(fleet.telemetry(), described)
    both(each, fleet, (message,), 8.0)
    for value in (getattr(each, described), float(getattr(fleet.telemetry(), described)[1])):
        assert value == pytest.approx(expected, nan_ok=True)
    assert getattr(fleet.telemetry(), described)[0] == pytest.approx(before[0], nan_ok=True), "another's"


def pack(battery_id: int, percent: int) -> Any:
    return dialect.MAVLink_battery_status_message(battery_id, 1, 1, 2500, [4000] * 10, -100, -1, -1, percent)


def total(percent: int) -> Any:
    return dialect.MAVLink_sys_status_message(0, 0, 0, 0, 16000, -100, percent, 0, 0, 0, 0, 0, 0)


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
        ((position(9000), pack(1, 15), position(100), pack(0, 100)), (nan, 0.15, nan, 1.0)),
    ],
)
def test_both_readers_report_the_emptiest_battery(
    story: tuple[Any, ...], expected: tuple[float, ...]
) -> None:
    """A vehicle with two packs never flaps between them; a restart may have brought new ones."""
    fleet, each = FleetTelemetry(IDS), VehicleTelemetry()
    read = []
    for time_s, message in enumerate(story):
        both(each, fleet, (message,), float(time_s))
        read.append((each.battery_remaining, float(fleet.telemetry().battery_remaining[1])))
    np.testing.assert_allclose(np.array(read), np.array([expected, expected]).T)
    assert isnan(fleet.telemetry().battery_remaining[0]), "another's"
