"""Arming, modes and disarming, by MAVLink bytes in virtual time."""

from __future__ import annotations

import math

import pytest

from gcs.sim.fleet import STEP_S
from tests.support.sim_bench import (
    ACCEPTED,
    DENIED,
    HOLD,
    LAND,
    OFFBOARD,
    POSITION,
    TAKEOFF,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    Bench,
    holding,
    offboard,
    ready,
)

IN_AIR, ON_GROUND = 2, 1


@pytest.mark.parametrize("seed", range(5))
def test_ready_four_to_six_seconds_after_start_not_before(seed: int) -> None:
    bench = Bench(seed=seed).run(3.0)
    assert bench.arm() == [TEMPORARILY_REJECTED]
    assert not bench.prearm_ok
    bench.until(lambda: bench.prearm_ok, 5.0)
    assert 4.0 <= bench.now_s <= 6.3
    assert bench.arm() == [ACCEPTED]


def test_positions_come_only_after_the_first_fix() -> None:
    bench = Bench().run(2.5)
    assert not bench.count("GLOBAL_POSITION_INT")
    assert bench.last("SYS_STATUS").onboard_control_sensors_health & 0x20 == 0
    assert bench.ready().count("GLOBAL_POSITION_INT")


def test_each_vehicle_has_a_local_origin_of_its_own() -> None:
    bench = Bench(count=6, noise_scale=1.0, spacing_m=0.0)
    bench.run(7.0)
    origins = bench.fleet._local_origin_m
    offsets = [math.dist(one, other) for i, one in enumerate(origins) for other in origins[:i]]
    assert max(offsets) > 0.2
    assert max(offsets) < 2.5


@pytest.mark.soak
def test_mode_change_acknowledged_twice_accepted_then_result() -> None:
    bench = holding(step_s=STEP_S)
    before = len(bench.received)
    assert bench.set_mode(OFFBOARD) == [ACCEPTED, TEMPORARILY_REJECTED]
    times = [time_s for time_s, m in bench.received[before:] if m.get_type() == "COMMAND_ACK"]
    assert 0.006 <= times[1] - times[0] <= 0.015
    assert "Switching to Offboard is currently not available" in bench.texts


@pytest.mark.soak
def test_mode_change_shows_in_next_heartbeat_within_a_second() -> None:
    bench = holding()
    assert bench.set_mode(LAND) == [ACCEPTED, ACCEPTED]
    assert 0.0 < bench.until(lambda: bench.mode == LAND, 2.0) <= 1.1


def test_disarmed_offboard_without_setpoints_refuses_arming() -> None:
    bench = ready()
    assert bench.set_mode(OFFBOARD) == [ACCEPTED, ACCEPTED]
    assert bench.arm() == [TEMPORARILY_REJECTED]
    assert "Arming denied: Resolve system health failures first" in bench.texts
    bench.run(1.2)
    assert bench.mode == OFFBOARD
    assert bench.last("HEARTBEAT").system_status == 0
    assert not bench.prearm_ok
    bench.stream(0, 0, 0)
    assert bench.run(0.5).arm() == [ACCEPTED]


def test_offboard_without_setpoints_is_refused_in_the_air() -> None:
    bench = holding()
    assert bench.set_mode(OFFBOARD) == [ACCEPTED, TEMPORARILY_REJECTED]
    assert bench.run(1.1).mode == HOLD


def test_manual_modes_are_refused_in_the_air_without_a_pilot() -> None:
    bench = holding()
    assert bench.set_mode(POSITION) == [ACCEPTED, TEMPORARILY_REJECTED]
    assert bench.run(1.1).mode == HOLD


@pytest.mark.soak
def test_takeoff_while_disarmed_happens_at_the_next_arming() -> None:
    bench = ready()
    assert bench.command(22, 0, 0, 0, math.nan, math.nan, math.nan, math.nan) == [ACCEPTED]
    bench.run(3.0)
    assert bench.mode == TAKEOFF
    assert bench.truth[2] == 0.0
    assert bench.arm() == [ACCEPTED]
    bench.until(lambda: bench.mode == HOLD, 15.0)
    assert bench.run(4.0).truth[2] == pytest.approx(-2.5, abs=0.3)
    assert "Using default takeoff altitude: 2.5 m" in bench.texts


def test_disarming_is_refused_in_the_air() -> None:
    bench = holding()
    assert bench.command(400, 0) == [TEMPORARILY_REJECTED]
    assert bench.run(1.1).armed


def test_disarming_on_the_ground_is_accepted() -> None:
    bench = ready()
    bench.arm()
    assert bench.command(400, 0) == [ACCEPTED]
    assert not bench.run(1.1).armed


def test_kill_stops_the_motors_and_the_vehicle_falls() -> None:
    bench = offboard(height_m=20.0)
    bench.stream(5.0, 0.0, 0.0)
    bench.run(3.0)
    north_m = bench.truth[0]
    assert bench.command(400, 0, 21196) == [ACCEPTED]
    assert 2.0 < bench.until(lambda: bench.truth[2] == 0.0, 6.0) < 4.0  # free fall 2.0 s, with drag more
    bench.run(1.0)
    assert north_m < bench.truth[0] < north_m + 6.0
    lies_at = bench.truth
    assert bench.run(5.0).truth == lies_at
    assert not bench.armed
    assert bench.last("EXTENDED_SYS_STATE").landed_state == ON_GROUND


def test_arming_without_taking_off_ends_after_com_disarm_prflt() -> None:
    bench = ready()
    bench.arm()
    assert bench.run(9.0).armed
    assert not bench.run(2.2).armed
    assert "Disarmed by auto preflight disarming" in bench.texts


@pytest.mark.soak
def test_a_negative_com_disarm_prflt_leaves_it_armed() -> None:
    bench = ready()
    bench.set_parameter("COM_DISARM_PRFLT", -1.0)
    bench.arm()
    assert bench.run(15.0).armed


@pytest.mark.soak
@pytest.mark.parametrize("wait_s", [2.0, 5.0])
def test_it_disarms_com_disarm_land_after_landing(wait_s: float) -> None:
    bench = holding(height_m=3.0)
    bench.set_parameter("COM_DISARM_LAND", wait_s)
    bench.set_mode(LAND)
    bench.until(lambda: bench.last("EXTENDED_SYS_STATE").landed_state == ON_GROUND, 30.0)
    assert bench.until(lambda: "Disarmed by landing" in bench.texts, 10.0) == pytest.approx(wait_s, abs=0.35)


@pytest.mark.soak
def test_mode_after_landing_from_offboard() -> None:
    """After landing from OFFBOARD the mode reverts; arming waits for HOLD or setpoints."""
    bench = offboard(height_m=3.0)
    bench.set_mode(LAND)
    bench.repeated = None
    bench.until(lambda: not bench.armed, 30.0)
    assert bench.run(1.1).mode == OFFBOARD
    assert bench.arm() == [TEMPORARILY_REJECTED]
    assert bench.set_mode(HOLD) == [ACCEPTED, ACCEPTED]
    assert bench.arm() == [ACCEPTED]


@pytest.mark.soak
def test_after_landing_from_hold_it_can_arm_again() -> None:
    bench = holding(height_m=3.0)
    bench.set_mode(LAND)
    bench.until(lambda: not bench.armed, 30.0)
    assert bench.arm() == [ACCEPTED]


def test_the_land_mode_prevents_arming() -> None:
    bench = ready()
    assert bench.command(21) == [ACCEPTED]
    assert bench.arm() == [TEMPORARILY_REJECTED]


def test_forced_arming_overrides_the_checks() -> None:
    bench = Bench().run(1.0)
    assert bench.command(400, 1, 21196) == [ACCEPTED]


def test_unknown_commands_unsupported_unknown_modes_denied() -> None:
    bench = ready()
    assert bench.command(31999) == [UNSUPPORTED]
    assert bench.set_mode((4, 77)) == [ACCEPTED, DENIED]
    assert bench.command(176, 0, 4, 3) == [ACCEPTED, DENIED]
    assert bench.command(400, 0.5) == [DENIED]


@pytest.mark.soak
def test_battery_drains_in_the_air_only_and_messages_agree() -> None:
    bench = ready(endurance_s=100.0)
    bench.run(20.0)
    assert bench.last("BATTERY_STATUS").battery_remaining == 100
    bench.take_off()
    airborne_s = bench.now_s - float(bench.fleet.state.airborne_since_s[0]) + 1000.0
    bench.run(0.5)
    left = bench.last("SYS_STATUS").battery_remaining
    assert left == pytest.approx(100 - airborne_s, abs=2)
    assert bench.run(2.0).last("BATTERY_STATUS").voltages[0] == pytest.approx(
        16200 - 18 * (100 - left + 2), abs=60
    )


@pytest.mark.soak
def test_a_critical_battery_returns_and_an_empty_one_lands() -> None:
    bench = holding(height_m=15.0, endurance_s=40.0, parameters={"COM_FAIL_ACT_T": 0.0})
    bench.until(lambda: bench.mode == (4, 5), 40.0)
    assert bench.last("SYS_STATUS").battery_remaining in {6, 7}
    bench.until(lambda: bench.mode == LAND, 10.0)
    assert {"Low battery", "Critical battery", "Emergency battery level"} <= set(bench.texts)
    assert bench.last("EXTENDED_SYS_STATE").landed_state != IN_AIR
