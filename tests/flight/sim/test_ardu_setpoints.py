"""ArduPilot's setpoints in GUIDED (habits 36 to 44, 48, 49)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from gcs.sim.autopilots.ardupilot.modes import Mode
from tests.support.ardu_bench import IN_AIR, ArduBench, command, cruising, grounded, hovering, stop_m
from tests.support.sim_bench import ACCEPTED, POSITION_ONLY, VELOCITY_ONLY, setpoint

pytestmark = pytest.mark.soak

NAN = math.nan
YAW_AND_VELOCITY, RATE_AND_VELOCITY = 0x9C7, 0x5C7


@pytest.mark.parametrize("mask", [0xDC7, 0x9C7, 0x5C7, 0x1C7, 0xFC7, 0xDC0])
def test_masks_that_are_flown(mask: int) -> None:
    bench = hovering()
    bench.stream(3.0, 0.0, 0.0, mask)
    assert bench.run(3.0).velocity[0] == pytest.approx(2.9, abs=0.3)


@pytest.mark.parametrize("mask", [0xDE7, 0xC07, 0x000])
def test_masks_that_are_not_followed_let_the_last_one_run_out(mask: int) -> None:
    bench = cruising(3.0)
    texts, acks = len(bench.texts), bench.count("COMMAND_ACK")
    bench.stream(3.0, 0.0, 0.0, mask)
    assert bench.run(2.5).velocity[0] == pytest.approx(3.0, abs=0.2)
    assert bench.run(6.0).velocity[0] == pytest.approx(0.0, abs=0.3)
    assert (len(bench.texts), bench.count("COMMAND_ACK")) == (texts, acks)


@pytest.mark.parametrize(
    ("frame", "north_m_s", "east_m_s"),
    [(1, 2.9, 0.0), (7, 2.9, 0.0), (8, 0.0, 2.9), (9, 0.0, 2.9), (12, 0.0, 0.0)],
)
def test_frames_and_what_they_turn(frame: int, north_m_s: float, east_m_s: float) -> None:
    bench = hovering(heading_deg=90.0)
    bench.stream(3.0, 0.0, 0.0, frame=frame)
    assert bench.run(3.0).velocity[:2] == pytest.approx((north_m_s, east_m_s), abs=0.3)


def test_a_setpoint_is_never_acknowledged() -> None:
    bench = hovering()
    before = bench.count("COMMAND_ACK")
    bench.stream(1.0, 0.0, 0.0)
    assert bench.run(2.0).count("COMMAND_ACK") == before


@pytest.mark.parametrize("rate_hz", [0.4, 1.0, 2.0, 5.0])
def test_one_setpoint_in_2_5_s_is_enough(rate_hz: float) -> None:
    bench = cruising(3.0)
    bench.repeated = None
    speeds = []
    for _ in range(math.ceil(10.0 * rate_hz)):
        bench.send(setpoint(3.0, 0.0, 0.0, VELOCITY_ONLY))
        speeds.append(bench.run(1.0 / rate_hz).velocity[0])
    assert speeds == pytest.approx([3.0] * len(speeds), abs=0.2)


def test_speeds_are_not_clipped() -> None:
    bench = hovering()
    bench.stream(30.0, 0.0, 0.0)
    assert bench.run(12.0).velocity[0] == pytest.approx(11.7, abs=0.5)
    bench = hovering(30.0)
    bench.stream(0.0, 0.0, 6.0)
    assert bench.run(3.5).velocity[2] == pytest.approx(6.1, abs=0.7)
    bench.stream(0.0, 0.0, -6.0)
    assert bench.run(6.0).velocity[2] == pytest.approx(-6.0, abs=0.5)


@pytest.mark.parametrize("vector", [(NAN, 0.0, 0.0), (0.0, 0.0, NAN), (math.inf, 0.0, 0.0)])
def test_nan_in_the_air_ends_the_process(vector: tuple[float, float, float]) -> None:
    """Habit 41: at once here, within 3 s as recorded. Our links send none: test_link_of_ardupilot."""
    bench = cruising(3.0)
    bench.send(setpoint(*vector, VELOCITY_ONLY))
    bench.run(0.1)
    before = len(bench.received)
    bench.run(4.0)
    assert len(bench.received) == before
    assert bench.truth[2] == 0.0
    assert bench.command(400, 1) == []


def test_nan_on_the_ground_is_ignored() -> None:
    bench = grounded()
    bench.arm()
    bench.send(setpoint(NAN, 0.0, 0.0, VELOCITY_ONLY))
    assert bench.run(1.1).armed


def test_a_position_never_times_out_and_turns_the_nose() -> None:
    bench = hovering()
    bench.send(setpoint(0.0, 15.0, -10.0, POSITION_ONLY))
    fastest_m_s = max(bench.run(0.2).velocity[1] for _ in range(60))
    assert bench.truth == pytest.approx((0.0, 15.0, -10.0), abs=0.3)
    assert fastest_m_s <= 5.2
    assert bench.last("GLOBAL_POSITION_INT").hdg == pytest.approx(9000, abs=500)
    assert bench.run(10.0).truth == pytest.approx((0.0, 15.0, -10.0), abs=0.3)


def test_setpoint_loss_flies_on_3_s_then_hovers_for_ever() -> None:
    bench = cruising(5.0)
    texts, begin_m = len(bench.texts), bench.truth[0]
    bench.repeated = None
    assert bench.run(3.0).velocity[0] == pytest.approx(5.0, abs=0.2)
    assert bench.truth[0] - begin_m == pytest.approx(15.0, abs=0.5)
    bench.run(10.0)
    assert bench.truth[0] - begin_m == pytest.approx(27.4, abs=0.8)
    there = bench.truth
    assert bench.run(60.0).truth == pytest.approx(there, abs=0.2)
    assert (bench.custom_mode, bench.landed_state, len(bench.texts)) == (Mode.GUIDED, IN_AIR, texts)


def test_the_next_setpoint_is_obeyed_after_a_loss() -> None:
    bench = cruising(5.0)
    bench.repeated = None
    bench.run(20.0)
    bench.stream(0.0, 3.0, 0.0)
    assert bench.run(4.0).velocity[1] > 2.0


def test_any_system_may_command_unless_sysid_enforce() -> None:
    bench = hovering()
    bench.stream(3.0, 0.0, 0.0)
    assert bench.run(3.0).velocity[0] > 2.0
    bench.stream(0.0, 0.0, 0.0)
    bench.run(6.0)
    bench.set_parameter("SYSID_ENFORCE", 1)
    bench.stream(3.0, 0.0, 0.0)
    assert bench.run(3.0).velocity[0] == pytest.approx(0.0, abs=0.3)
    assert bench.kill() == []
    bench.set_parameter("SYSID_MYGCS", 245)
    assert bench.kill() == [ACCEPTED]


def test_a_kill_of_any_station_counts_unless_sysid_enforce() -> None:
    """Habit 44: also of a system that was never received before."""
    stranger = common.MAVLink(None, 254, 190)
    kill = bytes(command(400, 0, 21196).pack(stranger))
    bench = hovering()
    bench.set_parameter("SYSID_ENFORCE", 1)
    bench.send_bytes(kill)
    assert bench.run(1.1).armed
    bench.set_parameter("SYSID_ENFORCE", 0)
    bench.send_bytes(kill)
    assert not bench.run(1.1).armed


def test_setpoints_of_any_station_are_followed_the_last_one() -> None:
    """Habit 44: so that one station must be the only one that sends them."""
    other = common.MAVLink(None, 254, 190)
    bench = cruising(3.0)
    bench.repeated = None
    for _ in range(100):
        bench.send_bytes(bytes(setpoint(-3.0, 0.0, 0.0, VELOCITY_ONLY).pack(other)))
        bench.run(0.05)
    assert bench.velocity[0] < -1.0


def test_a_change_of_wpnav_accel_counts_from_the_next_entry() -> None:
    bench = cruising(5.0)
    bench.set_parameter("WPNAV_ACCEL", 500.0)
    bench.stream(0.0, 0.0, 0.0)
    assert stop_m(bench, 6.0)[0] == pytest.approx(13.0, abs=0.6)
    bench.order(Mode.BRAKE)
    bench.order(Mode.GUIDED)
    bench.stream(5.0, 0.0, 0.0)
    bench.run(6.0)
    bench.stream(0.0, 0.0, 0.0)
    assert stop_m(bench, 6.0)[0] == pytest.approx(4.4, abs=0.6)


def test_a_reversal_crosses_zero_as_recorded() -> None:
    bench = cruising(5.0, parameters={"WPNAV_ACCEL": 250.0})
    bench.stream(-5.0, 0.0, 0.0)
    assert bench.until(lambda: bench.velocity[0] < 0.0, 8.0) == pytest.approx(2.12, abs=0.15)


def test_yaw_turns_90_degrees_in_the_recorded_time() -> None:
    bench = hovering()
    bench.stream(0.0, 0.0, 0.0, YAW_AND_VELOCITY, yaw=math.pi / 2)
    assert bench.until(lambda: yaw_deg(bench) > 81.0, 5.0) == pytest.approx(1.4, abs=0.3)
    bench.run(2.0)
    bench.stream(0.0, 0.0, 0.0, YAW_AND_VELOCITY, yaw=-math.pi / 2)
    turned_s = bench.until(lambda: abs(yaw_deg(bench) + 90.0) < 18.0, 6.0)
    assert turned_s == pytest.approx(2.85, abs=0.3)


def test_a_turn_swings_beyond_and_back_as_recorded() -> None:
    """Habit 49: at 88 degrees/s at most, 14 degrees beyond."""
    bench = hovering()
    bench.stream(0.0, 0.0, 0.0, YAW_AND_VELOCITY, yaw=math.pi / 2)
    track_deg = [yaw_deg(bench.run(0.05)) for _ in range(100)]
    assert max(np.diff(track_deg)) / 0.05 == pytest.approx(88.0, abs=5.0)
    assert max(track_deg) == pytest.approx(103.6, abs=4.0)
    assert track_deg[-1] == pytest.approx(90.0, abs=3.0)


def test_a_yaw_rate_settles_and_0_or_ignored_holds() -> None:
    """Habit 49: 30 degrees/s peak at 46."""
    bench = hovering()
    bench.stream(0.0, 0.0, 0.0, RATE_AND_VELOCITY, yaw_rate=math.radians(30.0))
    turned_deg = np.diff([yaw_deg(bench.run(0.05)) for _ in range(80)])
    assert max(turned_deg) / 0.05 == pytest.approx(46.0, abs=4.0)
    assert turned_deg[-20:].sum() == pytest.approx(30.0, abs=2.0)
    bench.stream(0.0, 0.0, 0.0, RATE_AND_VELOCITY, yaw_rate=0.0)
    bench.run(4.0)
    held = yaw_deg(bench)
    assert yaw_deg(bench.run(2.0)) == pytest.approx(held, abs=2.0)
    bench.stream(2.0, 0.0, 0.0, VELOCITY_ONLY)
    assert yaw_deg(bench.run(2.0)) == pytest.approx(held, abs=2.0)


def yaw_deg(bench: ArduBench) -> float:
    return math.degrees(float(bench.fleet.state.yaw_rad[0]))


def test_at_rest_it_stays_within_5_cm() -> None:
    bench = hovering()
    bench.stream(0.0, 0.0, 0.0)
    bench.run(5.0)
    there = bench.truth
    assert bench.run(10.0).truth == pytest.approx(there, abs=0.05)
