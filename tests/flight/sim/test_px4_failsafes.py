"""PX4's own failsafes as flown on a real v1.16: HOLD first, resets of the estimator, no GPS, termination."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from gcs.sim.faults.injector import FaultInjector
from gcs.sim.vehicle import failsafe
from gcs.sim.vehicle.px4 import Quirks
from tests.support.sim_bench import (
    HOLD,
    LAND,
    OFFBOARD,
    POSITION,
    RETURN,
    TEMPORARILY_REJECTED,
    Bench,
    holding,
    offboard,
    ready,
)

ON_GROUND, IN_AIR, LANDING = 1, 2, 4
ACTIVE, CRITICAL, TERMINATED = 4, 5, 8
pytestmark = pytest.mark.keeps(
    "test_from_1_17_lost_setpoints_are_a_lost_transmitter[1.17-mode1]",
    "test_flight_termination_stops_the_motors_for_good",
)
"""The other habits are for `make soak`."""

TERMINATION = (10, 0)
HELD = "Failsafe activated: entering Hold for 5 seconds"


def befall(bench: Bench, fault: str, **values: Any) -> dict[str, Any]:
    command = {"vehicle": 1, "fault": fault, **values}
    return dict(json.loads(FaultInjector(bench.fleet).obey(json.dumps(command))))


def status(bench: Bench) -> int:
    return int(bench.last("HEARTBEAT").system_status)


def test_a_battery_failsafe_holds_before_it_acts() -> None:
    bench = holding()
    befall(bench, "battery", remaining=0.06)
    held_s = bench.until(lambda: HELD in bench.texts, 1.0)
    bench.run(1.1)
    assert (bench.mode, status(bench)) == (HOLD, CRITICAL)
    assert held_s + 1.1 + bench.until(lambda: bench.mode == RETURN, 6.0) == pytest.approx(5.5, abs=1.1)
    assert bench.texts[-2:] == [HELD, "Failsafe activated"]


def test_a_pilot_takes_over_during_the_hold() -> None:
    bench = holding()
    befall(bench, "battery", remaining=0.06)
    bench.until(lambda: HELD in bench.texts, 1.0)
    befall(bench, "pilot", mode="POSITION")
    assert bench.run(8.0).mode == POSITION


def test_a_low_battery_is_a_warning_with_the_failsafes_text() -> None:
    """Until v1.16 the text comes for mere warnings as well; HEARTBEAT stays ACTIVE."""
    bench = holding()
    befall(bench, "battery", remaining=0.12)
    bench.run(1.2)
    assert bench.texts[-2:] == ["Low battery", "Failsafe activated"]
    assert (bench.mode, status(bench)) == (HOLD, ACTIVE)


def test_without_failsafe_hold_it_acts_at_once() -> None:
    bench = holding(quirks=Quirks(failsafe_hold=False))
    befall(bench, "battery", remaining=0.06)
    assert bench.run(1.2).mode == RETURN
    assert HELD not in bench.texts


def test_the_firmwares_default_for_a_battery_is_a_warning() -> None:
    bench = holding(as_delivered=True)
    befall(bench, "battery", remaining=0.01)
    assert bench.run(7.0).mode == HOLD
    assert "Emergency battery level" in bench.texts


def test_a_battery_that_was_low_at_arming_does_not_act() -> None:
    """From v1.16 on: only what becomes worse in flight acts."""
    bench = ready()
    befall(bench, "battery", remaining=0.06)
    assert bench.take_off(3.0).mode == HOLD
    assert "Critical battery" not in bench.texts


@pytest.mark.parametrize(("release", "mark"), [((1, 14), ","), ((1, 15), ":"), ((1, 18), ":")])
def test_the_text_of_the_hold_changed_with_1_15(release: tuple[int, int], mark: str) -> None:
    assert failsafe.hold_text(release, 5.0) == f"Failsafe activated{mark} entering Hold for 5 seconds"


@pytest.mark.parametrize(("version", "mode"), [("1.16", POSITION), ("1.17", RETURN)])
def test_from_1_17_lost_setpoints_are_a_lost_transmitter(version: str, mode: tuple[int, int]) -> None:
    """COM_OBL_RC_ACT 0, NAV_RCL_ACT 2 and no transmitter; lost setpoints wait for no HOLD."""
    bench = offboard(version=version)
    bench.repeated = None
    assert bench.run(2.2).mode == mode
    assert HELD not in bench.texts


@pytest.mark.parametrize(("action", "mode"), [(2, HOLD), (3, RETURN), (4, LAND), (5, TERMINATION)])
def test_a_transponder_that_fails_in_flight_acts_from_1_18(action: int, mode: tuple[int, int]) -> None:
    """COM_ARM_ODID 3 to 5; 2, which preflight demands, and earlier versions only refuse to arm."""
    for version, then in (("1.18", mode), ("1.17", HOLD)):
        bench = holding(version=version)
        bench.fleet.state.transponder_ok[:] = True
        bench.set_parameter("COM_ARM_ODID", action)
        assert bench.run(2.0).mode == HOLD
        bench.fleet.state.transponder_ok[:] = False
        assert bench.run(7.0).mode == then
        assert ("Open Drone ID system not ready" in bench.texts) == (then != HOLD)


def test_each_flight_resets_the_estimator_once() -> None:
    """Recorded: 13 at first, and 14 at 1.5 m, 4.5 s after "Takeoff detected"; the heading turns."""
    bench = ready()
    assert bench.last("ODOMETRY").reset_counter == 13
    bench.command(22, 0, 0, 0, math.nan, math.nan, math.nan, bench.last("HOME_POSITION").altitude * 1e-3 + 5)
    bench.arm()
    bench.until(lambda: "Takeoff detected" in bench.texts, 6.0)
    before, yaw_rad = bench.truth, bench.fleet.state.yaw_rad[0]
    assert bench.until(lambda: bench.last("ODOMETRY").reset_counter == 14, 8.0) == pytest.approx(4.5, abs=0.3)
    assert bench.truth[2] < -1.5
    assert np.degrees(abs(bench.fleet.state.yaw_rad[0] - yaw_rad)) <= 4.0
    assert bench.truth[:2] == pytest.approx(before[:2], abs=0.1)
    bench.run(10.0)
    assert bench.last("ODOMETRY").reset_counter == 14


def test_without_estimator_resets_there_are_none() -> None:
    bench = holding(quirks=Quirks(estimator_resets=False))
    assert {message.reset_counter for message in bench.all("ODOMETRY")} == {0}


def test_without_gps_it_descends_and_positions_go_on() -> None:
    """Flown: fix 0, 4.8 s later "Failsafe activated", LAND, CRITICAL, IN_AIR; positions to the end."""
    bench = offboard()
    befall(bench, "fix", type="no-gps")
    before = bench.texts
    lasted_s = bench.until(lambda: bench.texts != before, 8.0)
    fixes = [message.fix_type for message in bench.all("GPS_RAW_INT", bench.now_s - 3.0)]
    assert set(fixes) == {0}
    assert lasted_s == pytest.approx(4.8, abs=0.2)
    assert bench.texts[len(before) :] == ["Failsafe activated"]
    bench.run(1.1)
    state = int(bench.last("EXTENDED_SYS_STATE").landed_state)
    assert (bench.mode, status(bench), state) == (LAND, CRITICAL, IN_AIR)
    assert bench.set_mode(OFFBOARD)[-1] == bench.set_mode(HOLD)[-1] == TEMPORARILY_REJECTED
    begin_s, count = bench.now_s, bench.count("GLOBAL_POSITION_INT")
    bench.until(lambda: bench.truth[2] > -0.05, 30.0)
    assert bench.count("GLOBAL_POSITION_INT") - count == pytest.approx(
        10.0 * (bench.now_s - begin_s), rel=0.1
    )
    error_m = bench.fleet.sensors.estimate_m[0] - bench.truth
    assert 0.5 < math.hypot(*error_m[:2]) < 20.0


def test_a_landing_by_command_reports_landing() -> None:
    bench = holding()
    bench.set_mode(LAND)
    assert bench.run(2.0).last("EXTENDED_SYS_STATE").landed_state == LANDING


def test_flight_termination_stops_the_motors_for_good() -> None:
    bench = holding()
    assert befall(bench, "termination")["ok"]
    bench.run(1.1)
    assert (bench.mode, status(bench)) == (TERMINATION, TERMINATED)
    bench.until(lambda: bench.truth[2] >= 0.0, 5.0)
    bench.run(4.0)
    assert bench.last("EXTENDED_SYS_STATE").landed_state == ON_GROUND
    bench.set_mode(HOLD)
    assert bench.run(1.1).mode == TERMINATION
    assert bench.arm() == [TEMPORARILY_REJECTED]
    assert befall(ready(), "termination")["unmoved"] == [1], "it is not armed"


def test_a_compass_can_ask_for_a_landing() -> None:
    bench = holding()
    befall(bench, "compass")
    assert bench.run(0.1).texts[-1] == "Compass needs calibration - Land now!"


def test_a_return_without_a_cone_climbs_near_home_too() -> None:
    bench = holding(parameters={"RTL_CONE_ANG": 0, "RTL_RETURN_ALT": 15.0})
    bench.set_mode(RETURN)
    highest_m = max(-bench.run(0.5).truth[2] for _ in range(24))
    assert highest_m == pytest.approx(15.0, abs=1.0)
