"""Samples that arrive late, twice or in another order, and clocks that jump: none goes back, none ends it."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest
from pymavlink.dialects.v20 import development as dialect

from gcs.links.telemetry import FleetTelemetry
from gcs.mavlink import codec
from gcs.mavlink.framing import PREARM_CHECK
from gcs.model.state import Mode, Telemetry

PERIOD_MS = 100
START_MS = 600_000
OFFBOARD, HOLD = 6 << 16, 4 << 16 | 3 << 24
CLOCK_END_MS = 1 << 32


class Sent(NamedTuple):
    """A message as sent."""

    number: int
    message: Any


class Vehicle:
    """One vehicle that flies north at 10 m/s, and the telemetry of it."""

    def __init__(self) -> None:
        self.fleet = FleetTelemetry(["d1"])
        self.number = 0

    def sent(self, message: Any) -> Sent:
        self.number += 1
        return Sent(self.number - 1, message)

    def take(self, time_s: float, *messages: Any) -> Telemetry:
        """What arrives at that time, in one datagram; messages not `Sent` before are sent now."""
        raw = b""
        for each in messages:
            number, message = each if isinstance(each, Sent) else self.sent(each)
            sender = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
            sender.seq = number & 0xFF
            raw += bytes(message.pack(sender))
        data = np.frombuffer(bytearray(raw), np.uint8)
        frames = codec.find(data, np.array([0]), np.array([len(data)])).frames
        none, times_s = np.zeros(len(frames), np.int64), np.full(len(frames), time_s)
        self.fleet.take(data, frames, none, times_s)
        return self.fleet.telemetry()

    def fly(self, clocks_ms: Iterable[int], time_s: float, period_s: float = 0.1) -> Telemetry:
        """Positions at these clocks, one after the other, the first at `time_s`."""
        reported = self.fleet.telemetry()
        for at, clock_ms in enumerate(clocks_ms):
            reported = self.take(time_s + at * period_s, position(clock_ms))
        return reported


def position(clock_ms: int) -> Any:
    """At 1e-7 degrees of latitude for each millisecond of the clock, about 10 m/s."""
    latitude = clock_ms & 0x3FFFFFFF
    return dialect.MAVLink_global_position_int_message(clock_ms, latitude, 2, 3, 4, 1000, 0, 0, 0)


def beat(custom_mode: int = OFFBOARD) -> Any:
    return dialect.MAVLink_heartbeat_message(2, 12, 0x81, custom_mode, 4, 3)


def status(percent: int = 80) -> Any:
    return dialect.MAVLink_sys_status_message(0, 0, PREARM_CHECK, 0, 0, 0, percent, 0, 0, 0, 0, 0, 0)


def latitude(reported: Telemetry) -> int:
    return round(float(reported.latitude_deg[0]) * 1e7)


def clocks(first_ms: int, count: int) -> Sequence[int]:
    return range(first_ms, first_ms + count * PERIOD_MS, PERIOD_MS)


def flying() -> Vehicle:
    """Flies for 2 s until 0 s: its newest clock is START_MS."""
    vehicle = Vehicle()
    vehicle.take(-2.1, beat(), status())
    vehicle.fly(clocks(START_MS - 1900, 20), -1.9)
    return vehicle


@pytest.mark.parametrize("late_ms", [200, 800, 2_000, 10_000, 60_000])
def test_late_position_is_dropped_and_counted(late_ms: int) -> None:
    vehicle = flying()
    late = position(START_MS - late_ms)
    lost = Sent(vehicle.number - late_ms // PERIOD_MS, late)
    reported = vehicle.take(0.05, lost, lost)
    assert latitude(reported) == START_MS
    assert reported.position_time_s[0] == pytest.approx(0.0)
    assert reported.reboot_count == (0,)
    assert vehicle.fleet.prearm_ok[0]
    assert reported.battery_remaining[0] == 0.80
    assert vehicle.fleet.late_samples == 2
    assert latitude(vehicle.take(0.1, position(START_MS + 100))) == START_MS + 100


def test_positions_never_go_back_in_any_order() -> None:
    """A tenth is late by up to 10 s, each is doubled, for ten minutes."""
    random = np.random.default_rng(47)
    vehicle, arrivals = Vehicle(), list[tuple[float, int, tuple[Sent, ...]]]()
    for tick in range(6000):
        clock_ms = START_MS + tick * PERIOD_MS
        messages = [position(clock_ms)]
        if tick % 10 == 0:
            messages.append(beat())
        datagram = tuple(map(vehicle.sent, messages))
        for _ in range(2):
            late_s = random.uniform(0.1, 10.0) if random.random() < 0.1 else random.uniform(0.0, 0.02)
            arrivals.append((0.1 * tick + late_s, len(arrivals), datagram))
    arrivals = [each for each in arrivals if each[0] < 600.0]
    newest, latitudes, gaps_s, arrived_s = 0, list[int](), list[float](), 0.0
    for time_s, _, datagram in sorted(arrivals, key=lambda each: each[:2]):
        reported = vehicle.take(time_s, *datagram)
        latitudes.append(latitude(reported))
        if latitudes[-1] > newest:
            newest = latitudes[-1]
            gaps_s.append(time_s - arrived_s)
            arrived_s = time_s
    assert (np.diff(latitudes) >= 0).all()
    assert newest >= START_MS + 5998 * PERIOD_MS
    assert max(gaps_s) < 0.5, "as often as they are sent"
    assert reported.reboot_count == (0,)
    assert vehicle.fleet.connection_count[0] == 1
    assert vehicle.fleet.late_samples > 0


def test_late_heartbeat_does_not_change_the_mode() -> None:
    vehicle = flying()
    held = vehicle.sent(beat(HOLD))
    vehicle.fly(clocks(START_MS + 100, 5), 0.1)
    assert vehicle.take(0.6, beat(OFFBOARD)).mode == (Mode.OFFBOARD,)
    assert vehicle.take(0.7, held).mode == (Mode.OFFBOARD,)
    assert vehicle.take(0.8, beat(HOLD)).mode == (Mode.HOLD,)


def test_heartbeats_count_again_after_a_silence() -> None:
    vehicle = flying()
    vehicle.number += 200  # lost
    assert vehicle.take(20.0, beat(HOLD)).mode == (Mode.HOLD,)


def test_senders_that_number_nothing_are_believed() -> None:
    vehicle = flying()
    for at, mode in enumerate((HOLD, OFFBOARD, HOLD)):
        vehicle.fly(clocks(START_MS + 100 + 500 * at, 5), 0.1 + 0.5 * at)
        vehicle.take(0.55 + 0.5 * at, Sent(7, beat(mode)))
    for at, mode in enumerate((OFFBOARD, HOLD)):
        reported = vehicle.take(2.0 + 0.1 * at, Sent(7, beat(mode)))
        assert reported.mode == ((Mode.OFFBOARD, Mode.HOLD)[at],)


@pytest.mark.parametrize("off_s", [0.0, 1.0, 30.0])
def test_clock_that_begins_anew_is_a_restart(off_s: float) -> None:
    vehicle = flying()
    vehicle.number = 0
    first = vehicle.fly(clocks(0, 2), off_s)
    assert (first.reboot_count, latitude(first)) == ((0,), START_MS), "two messages do not suffice"
    reported = vehicle.fly(clocks(200, 8), off_s + 0.2)
    assert (reported.reboot_count, latitude(reported)) == ((1,), 900)
    assert not vehicle.fleet.prearm_ok[0]
    assert np.isnan(reported.battery_remaining[0])


def test_restart_soon_after_the_start_is_noticed() -> None:
    vehicle = Vehicle()
    vehicle.fly(clocks(0, 50), 0.0)
    vehicle.number = 0
    assert vehicle.fly(clocks(0, 5), 5.5).reboot_count == (1,)


def test_late_messages_are_no_restart() -> None:
    """Of the time when the vehicle started, beside those of now."""
    vehicle = Vehicle()
    early = [vehicle.sent(position(clock_ms)) for clock_ms in clocks(0, 10)]
    for at in range(100):
        vehicle.take(1.0 + 0.1 * at, position(1000 + at * PERIOD_MS))
        reported = vehicle.take(1.05 + 0.1 * at, early[at % 10])
    assert (reported.reboot_count, latitude(reported)) == ((0,), 10_900)


@pytest.mark.parametrize("ahead_ms", [5_000, 60_000, 1 << 31, CLOCK_END_MS - 1 - START_MS])
def test_one_message_from_the_future_shuts_out_nothing(ahead_ms: int) -> None:
    vehicle = flying()
    vehicle.take(0.05, position(START_MS + ahead_ms))
    reported = vehicle.fly(clocks(START_MS + 100, 6), 0.1)
    assert latitude(reported) == START_MS + 600
    assert reported.reboot_count == (0,)


@pytest.mark.parametrize("by_ms", [-300_000, -10_000, -3_000, 60_000, 3_600_000])
def test_clock_that_was_set_is_followed_within_half_a_second(by_ms: int) -> None:
    vehicle = flying()
    reported = vehicle.fly(clocks(START_MS + by_ms, 4), 0.1)
    assert latitude(reported) == START_MS + by_ms + 300
    assert reported.reboot_count == (0,)
    assert vehicle.fleet.prearm_ok[0]


def test_clock_of_32_bits_that_ends_goes_on() -> None:
    """After 49.7 days."""
    vehicle = Vehicle()
    vehicle.take(0.0, beat(), status())
    passed = [clock_ms % CLOCK_END_MS for clock_ms in clocks(CLOCK_END_MS - 950, 20)]
    times_s = []
    for at, clock_ms in enumerate(passed):
        times_s.append(vehicle.take(0.1 * at, position(clock_ms)).position_time_s[0])
    assert times_s == pytest.approx(0.1 * np.arange(20))
    late = vehicle.take(2.0, Sent(vehicle.number - 15, position(passed[5])))
    assert late.position_time_s[0] == times_s[-1]
    assert late.reboot_count == (0,)
    assert vehicle.fleet.prearm_ok[0]


def test_restart_after_a_month_is_noticed() -> None:
    vehicle = Vehicle()
    vehicle.fly(clocks(30 * 86_400_000, 20), 0.0)
    vehicle.number = 0
    reported = vehicle.fly(clocks(500, 5), 5.0)
    assert (reported.reboot_count, latitude(reported)) == ((1,), 900)


def test_link_that_becomes_slower_only_pauses() -> None:
    """Each message is 2 s late from now on, and later prompt again."""
    vehicle = flying()
    reported = vehicle.fly(clocks(START_MS + 100, 50), 2.1)
    assert (latitude(reported), reported.reboot_count) == (START_MS + 5000, (0,))
    reported = vehicle.fly(clocks(START_MS + 7100, 5), 7.1)
    assert (latitude(reported), reported.reboot_count) == (START_MS + 7500, (0,))
    assert vehicle.fleet.late_samples == 0


def test_kinds_with_older_stamps_than_others_are_read() -> None:
    """A position of the estimator is older than the attitude beside it."""
    vehicle = flying()
    for at in range(1, 20):
        clock_ms = START_MS + at * PERIOD_MS
        attitude = dialect.MAVLink_attitude_message(clock_ms, 0, 0, 0, 0, 0, 0)
        reported = vehicle.take(0.1 * at, attitude, position(clock_ms - 300))
    assert latitude(reported) == START_MS + 1900 - 300
