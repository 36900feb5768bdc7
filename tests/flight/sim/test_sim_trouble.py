"""Faults by order, in virtual time."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from gcs.sim.faults.injector import FaultInjector, Jammer, Way
from tests.support.sim_bench import HOLD, OFFBOARD, POSITION, Bench, holding, offboard, ready

DENIED = 2


def command(fault_injector: FaultInjector, **fields: Any) -> dict[str, Any]:
    return dict(json.loads(fault_injector.obey(json.dumps({"vehicle": 1, **fields}))))


def way(**faults: float) -> Way[int]:
    made: Way[int] = Way(np.random.default_rng(3))
    for name, value in faults.items():
        setattr(made.faults, name, value)
    return made


def passed(line: Way[int], count: int = 1000) -> list[tuple[bytes, int]]:
    """What arrives of packets that are sent 10 ms apart."""
    arrived = []
    for k in range(count):
        line.put(b"packet", k, k * 0.01)
        arrived += line.take(k * 0.01)
    return arrived + line.take(1e9)


def test_healthy_channel_passes_everything_in_order_at_once() -> None:
    assert passed(way()) == [(b"packet", k) for k in range(1000)]


def test_loss_duplicates_and_damage_come_in_their_shares() -> None:
    assert 650 < len(passed(way(loss=0.3))) < 750
    assert 1250 < len(passed(way(duplicate=0.3))) < 1350
    damaged = [packet for packet, _ in passed(way(corrupt=0.3)) if packet != b"packet"]
    assert 250 < len(damaged) < 350


def test_delay_and_jitter_keep_the_order_reordering_does_not() -> None:
    late = way(delay_s=0.2, jitter_s=0.1)
    late.put(b"a", 0, 0.0)
    assert (late.take(0.19), len(late.take(0.31))) == ([], 1)
    places = [k for _, k in passed(way(delay_s=0.2, jitter_s=0.1))]
    assert places == sorted(places)
    overtaken = [k for _, k in passed(way(reorder=0.2))]
    assert overtaken != sorted(overtaken)
    assert sorted(overtaken) == list(range(1000))


def test_silence_drops_packets_in_flight() -> None:
    line = way(delay_s=1.0)
    line.put(b"a", 0, 0.0)
    line.faults.silent = True
    line.put(b"b", 0, 0.5)
    assert line.take(5.0) == []


def test_the_same_seed_loses_the_same_packets() -> None:
    assert passed(way(loss=0.5, jitter_s=0.1)) == passed(way(loss=0.5, jitter_s=0.1))


def test_a_jammer_sends_garbage_at_its_rate() -> None:
    jammer = Jammer(np.random.default_rng(1))
    jammer.rate_hz = 200.0
    garbage = [datagram for k in range(101) for datagram in jammer.take(k * 0.01)]
    assert len(garbage) == pytest.approx(200, abs=1)
    assert len(set(map(len, garbage))) > 50


def test_link_faults_end_after_their_time_or_on_none() -> None:
    bench = Bench()
    fault_injector = FaultInjector(bench.fleet)
    assert command(fault_injector, fault="silence", for_s=2.0)["ok"]
    assert command(fault_injector, fault="loss", share=0.5, way="out")["ok"]
    channel = fault_injector.broken[0]
    assert (channel.into.faults.silent, channel.into.faults.loss, channel.out.faults.loss) == (True, 0.0, 0.5)
    bench.run(2.1)
    fault_injector.pass_time()
    assert (channel.out.faults.silent, channel.out.faults.loss) == (False, 0.5)
    assert command(fault_injector, fault="none")["ok"]
    assert not fault_injector.broken


def test_a_position_that_jumps_is_reported_and_flown_back() -> None:
    bench = offboard()
    fault_injector = FaultInjector(bench.fleet)
    before = bench.last("LOCAL_POSITION_NED").x
    counter = bench.last("ODOMETRY").reset_counter
    command(fault_injector, fault="gps-jump", north_m=8.0)
    bench.run(0.2)
    assert bench.last("LOCAL_POSITION_NED").x == pytest.approx(before + 8.0, abs=0.2)
    assert bench.last("ODOMETRY").reset_counter == counter
    command(fault_injector, fault="position-reset", north_m=-8.0)
    bench.run(0.2)
    assert bench.last("LOCAL_POSITION_NED").x == pytest.approx(before, abs=0.2)
    assert bench.last("ODOMETRY").reset_counter == counter + 1


def test_a_frozen_receiver_repeats_its_position() -> None:
    bench = offboard()
    fault_injector = FaultInjector(bench.fleet)
    command(fault_injector, fault="gps-freeze", for_s=3.0)
    bench.stream(3.0, 0.0, 0.0)
    begin_s = bench.now_s + 0.05
    bench.run(2.5)
    reported = {(m.lat, m.lon, m.alt) for m in bench.all("GLOBAL_POSITION_INT", begin_s)}
    assert len(reported) == 1
    assert bench.last("GLOBAL_POSITION_INT").vx > 150
    bench.run(1.0)
    fault_injector.pass_time()
    bench.run(0.2)
    assert (bench.last("GLOBAL_POSITION_INT").lat, 0) != (reported.pop()[0], 0)


def test_accuracy_is_reported_in_gps_raw_int() -> None:
    bench = ready()
    command(FaultInjector(bench.fleet), fault="accuracy", eph_m=4.5, epv_m=7.0, hdop=2.5)
    gps = bench.run(0.5).last("GPS_RAW_INT")
    assert (gps.h_acc, gps.v_acc, gps.eph, gps.epv) == (4500, 7000, 250, 110)


def test_worse_fix_and_wrong_time_are_reported_until_they_end() -> None:
    bench = ready()
    fault_injector = FaultInjector(bench.fleet)
    true_us = bench.run(1.1).last("SYSTEM_TIME").time_unix_usec
    assert true_us > 1.79e15
    command(fault_injector, fault="fix", type="2d", for_s=2.0)
    command(fault_injector, fault="wrong-time", ahead_s=-3600.0, for_s=2.0)
    bench.run(1.5)
    assert bench.last("GPS_RAW_INT").fix_type == 2
    assert (true_us - bench.last("SYSTEM_TIME").time_unix_usec) / 1e6 == pytest.approx(3598.5, abs=1.1)
    bench.run(1.0)
    fault_injector.pass_time()
    bench.run(1.5)
    assert bench.last("GPS_RAW_INT").fix_type == 3
    assert bench.last("SYSTEM_TIME").time_unix_usec > true_us


@pytest.mark.parametrize(("which", "bit"), [("gyro", 0x1), ("ahrs", 0x200000)])
def test_unhealthy_sensor_is_reported_and_prevents_arming(which: str, bit: int) -> None:
    bench = ready()
    fault_injector = FaultInjector(bench.fleet)
    assert bench.run(1.1).last("SYS_STATUS").onboard_control_sensors_health & bit
    command(fault_injector, fault="sensor", which=which)
    health = bench.run(1.1).last("SYS_STATUS").onboard_control_sensors_health
    assert not health & (bit | 0x10000000)
    command(fault_injector, fault="none")
    assert bench.run(1.1).last("SYS_STATUS").onboard_control_sensors_health & bit


def test_reboot_on_the_ground_resets_clock_arming_and_streams() -> None:
    bench = ready()
    bench.command(511, common.MAVLINK_MSG_ID_ATTITUDE, -1)
    bench.arm()
    command(FaultInjector(bench.fleet), fault="reboot", off_s=0.0)
    bench.run(1.2)
    assert not bench.armed
    assert bench.last("ATTITUDE").time_boot_ms < 1300
    bench.run(7.0)
    assert bench.prearm_ok


def test_reboot_in_the_air_stops_the_motors_unless_survived() -> None:
    bench = holding()
    fault_injector = FaultInjector(bench.fleet)
    command(fault_injector, fault="reboot", off_s=0.0, motors="go-on")
    bench.run(1.0)
    assert bench.armed
    assert bench.last("ATTITUDE").time_boot_ms < 1_000_000
    height_m = -bench.truth[2]
    command(fault_injector, fault="reboot", off_s=0.0)
    assert -bench.run(1.0).truth[2] < height_m - 3.0
    assert not bench.fleet.autopilots[0].commander.armed


def test_a_reboot_by_command_is_denied_while_armed() -> None:
    bench = ready()
    bench.arm()
    assert bench.command(246, 1) == [DENIED]
    bench.command(400, 0)
    assert bench.command(246, 1) == [0]
    assert bench.run(0.5).last("ATTITUDE").time_boot_ms < 1000


def test_a_clock_can_jump_back() -> None:
    bench = Bench().run(8.0)
    command(FaultInjector(bench.fleet), fault="clock-jump", by_s=-5.0)
    assert bench.run(0.1).last("ATTITUDE").time_boot_ms == pytest.approx(3000, abs=200)


def test_a_battery_can_be_set() -> None:
    bench = ready()
    command(FaultInjector(bench.fleet), fault="battery", remaining=0.31)
    assert bench.run(1.0).last("SYS_STATUS").battery_remaining == 31


@pytest.mark.parametrize(("answer", "result"), [("accepted", 0), ("rejected", 1)])
def test_stuck_mode_stays_whatever_is_acknowledged(answer: str, result: int) -> None:
    bench = holding()
    fault_injector = FaultInjector(bench.fleet)
    command(fault_injector, fault="stuck-mode", answer=answer)
    assert bench.set_mode((4, 6)) == [0, result]
    assert bench.run(1.1).mode == HOLD
    command(fault_injector, fault="none")
    bench.set_mode((4, 6))
    assert bench.run(1.1).mode == (4, 6)


def test_pilot_takes_over_by_switch_or_sticks() -> None:
    """The switch always gives the pilot control; the sticks as COM_RC_OVERRIDE allows."""
    bench = offboard()
    fault_injector = FaultInjector(bench.fleet)
    assert command(fault_injector, fault="pilot", by="sticks")["unmoved"] == [1]
    assert bench.run(1.1).mode == OFFBOARD
    bench.set_parameter("COM_RC_OVERRIDE", 3)
    assert "unmoved" not in command(fault_injector, fault="pilot", by="sticks", east_m_s=2.0)
    bench.run(5.0)
    assert bench.mode == POSITION
    assert bench.velocity[1] > 1.2
    command(fault_injector, fault="none")
    assert bench.run(1.1).mode == HOLD


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("nonsense", "not JSON"),
        ("[1]", "a command is an object"),
        ('{"vehicle": 1}', "fault must be one of"),
        ('{"vehicle": 1, "fault": "gremlins"}', "fault must be one of"),
        ('{"fault": "silence"}', "must be there"),
        ('{"vehicle": 9, "fault": "silence"}', "there are 1 to 1"),
        ('{"vehicle": true, "fault": "silence"}', "no vehicle's number"),
        ('{"vehicles": [], "fault": "silence"}', "must be a list"),
        ('{"vehicle": 1, "fault": "loss"}', "share is missing"),
        ('{"vehicle": 1, "fault": "loss", "share": 1.5}', "from 0 to 1"),
        ('{"vehicle": 1, "fault": "loss", "share": NaN}', "from 0 to 1"),
        ('{"vehicle": 1, "fault": "loss", "share": 0.5, "colour": 1}', "no such field"),
        ('{"vehicle": 1, "fault": "battery", "remaining": 0.5, "for_s": 1}', "happens once"),
        ('{"vehicle": 1, "fault": "pilot", "mode": "OFFBOARD"}', "must be one of POSITION"),
    ],
)
def test_bad_command_is_answered_with_an_error(line: str, says: str) -> None:
    fault_injector = FaultInjector(Bench().fleet)
    answer = json.loads(fault_injector.obey(line))
    assert answer["ok"] is False
    assert says in answer["error"]
    assert not fault_injector.broken


GARBLED = FaultInjector(Bench().fleet)


@given(st.binary(max_size=80))
def test_garbage_commands_are_refused(line: bytes) -> None:
    assert json.loads(GARBLED.obey(line))["ok"] is False
