"""Velocity and position setpoints, and what happens without them."""

from __future__ import annotations

import math

import pytest

from gcs.sim.protocol.streams import RECORDED_HZ
from gcs.sim.vehicle.px4 import Quirks
from tests.support.sim_bench import (
    ACCEPTED,
    HOLD,
    LAND,
    OFFBOARD,
    POSITION,
    POSITION_ONLY,
    RETURN,
    VELOCITY_AND_YAW,
    VELOCITY_ONLY,
    Bench,
    holding,
    offboard,
    ready,
)

pytestmark = pytest.mark.keeps(
    "test_velocity_with_one_axis_missing_is_not_followed[vector0-3527]",
    "test_setpoints_without_axes_are_invalid_and_fail_safe",
    "test_com_obl_rc_act_decides_what_setpoint_loss_does[5-mode0]",
    "test_resumed_setpoints_restore_offboard",
    "test_setpoints_for_another_vehicle_do_not_count",
    "test_five_metre_step_response_of_the_vehicle_as_recorded",
)
"""The other habits are for `make soak`."""

ON_GROUND = 1
NAN = math.nan

UNTURNED = Quirks(estimator_resets=False)
"""The heading does not turn when it is aligned in flight."""


@pytest.mark.parametrize(
    ("command", "settles_at"),
    [
        ((-15.0, 0.0, 0.0), (-12.0, 0.0, 0.0)),
        ((20.0, 5.0, 0.0), (12.0, 5.0, 0.0)),  # the direction bends
        ((0.0, 0.0, -6.0), (0.0, 0.0, -3.0)),
        ((0.0, 0.0, 5.0), (0.0, 0.0, 1.5)),
    ],
)
def test_velocity_setpoints_are_clipped_per_axis(
    command: tuple[float, float, float], settles_at: tuple[float, float, float]
) -> None:
    bench = offboard(height_m=30.0, drag_per_s=0.0)
    bench.stream(*command)
    assert bench.run(12.0).velocity == pytest.approx(settles_at, abs=0.15)


def test_the_clipping_follows_the_parameters() -> None:
    bench = offboard(height_m=20.0, drag_per_s=0.0)
    bench.set_parameter("MPC_XY_VEL_MAX", 4.0)
    bench.set_parameter("MPC_Z_VEL_MAX_DN", 0.5)
    bench.stream(9.0, 0.0, 9.0)
    assert bench.run(8.0).velocity == pytest.approx((4.0, 0.0, 0.5), abs=0.15)


def test_yaw_turns_to_the_setpoint_at_a_limited_rate() -> None:
    bench = Bench(heading_deg=90.0, rates_hz=RECORDED_HZ, quirks=UNTURNED).fly_offboard()
    bench.stream(0, 0, 0, VELOCITY_AND_YAW, yaw=-math.pi / 2)
    bench.run(1.0)
    assert abs(bench.last("ATTITUDE").yaw) == pytest.approx(math.radians(135.0), abs=0.05)
    bench.run(4.0)
    assert bench.last("ATTITUDE").yaw == pytest.approx(-math.pi / 2, abs=0.01)
    assert bench.last("GLOBAL_POSITION_INT").hdg == 27000


def test_an_ignored_yaw_leaves_the_nose_where_it_is() -> None:
    bench = offboard(heading_deg=90.0, quirks=UNTURNED)
    bench.stream(2, 0, 0, VELOCITY_ONLY, yaw=1.0)
    assert bench.run(3.0).last("ATTITUDE").yaw == pytest.approx(math.pi / 2, abs=0.001)


def test_a_body_frame_velocity_is_turned_by_the_yaw() -> None:
    bench = offboard(heading_deg=90.0, quirks=UNTURNED)
    bench.stream(3.0, 0.0, 0.0, frame=8)
    north, east, _ = bench.run(6.0).velocity
    assert north == pytest.approx(0.0, abs=0.05)
    assert east > 2.4


def test_position_setpoints_are_flown_to() -> None:
    bench = offboard()
    bench.stream(5.0, -3.0, -12.0, POSITION_ONLY)
    assert bench.run(20.0).truth == pytest.approx((5.0, -3.0, -12.0), abs=0.3)


@pytest.mark.parametrize(
    ("vector", "mask"),
    [((NAN, 1.0, 0.0), VELOCITY_ONLY), ((1.0, 0.0, 0.0), 0xDD7), ((math.inf, 1.0, 0.0), VELOCITY_ONLY)],
)
def test_velocity_with_one_axis_missing_is_not_followed(
    vector: tuple[float, float, float], mask: int
) -> None:
    bench = offboard()
    before = len(bench.texts)
    bench.stream(*vector, mask)
    assert bench.run(6.0).velocity == pytest.approx((0.0, 0.0, 0.0), abs=0.05)
    assert (bench.mode, len(bench.texts)) == (OFFBOARD, before)


def test_setpoints_without_axes_are_invalid_and_fail_safe() -> None:
    bench = offboard()
    bench.stream(0, 0, 0, 0xDFF)
    bench.run(2.5)
    assert "SET_POSITION_TARGET_LOCAL_NED invalid" in bench.texts
    assert bench.mode == POSITION


def test_setpoint_loss_in_position_mode_descends_and_lands() -> None:
    bench = offboard()
    bench.stream(3.0, 0.0, 0.0)
    bench.run(3.0)
    bench.repeated = None
    lost_s = bench.until(lambda: "Failsafe activated" in bench.texts, 3.0)
    assert lost_s == pytest.approx(1.0, abs=0.15)
    bench.run(4.0)
    assert bench.mode == POSITION
    assert bench.last("HEARTBEAT").system_status == 5
    assert not bench.prearm_ok
    assert bench.velocity == pytest.approx((0.0, 0.0, 0.9), abs=0.35)
    bench.until(lambda: not bench.armed, 30.0)
    assert bench.truth[2] == 0.0
    assert bench.last("EXTENDED_SYS_STATE").landed_state == ON_GROUND


@pytest.mark.parametrize(("action", "mode"), [(5, HOLD), (4, LAND), (3, RETURN)])
def test_com_obl_rc_act_decides_what_setpoint_loss_does(action: int, mode: tuple[int, int]) -> None:
    bench = offboard(parameters={"COM_OBL_RC_ACT": action})
    height_m = -bench.truth[2]
    bench.repeated = None
    bench.run(2.3)
    assert bench.mode == mode
    bench.run(6.0)
    if mode == HOLD:
        assert -bench.truth[2] == pytest.approx(height_m, abs=0.3)
    assert (-bench.truth[2] < height_m - 2.0) == (mode != HOLD)  # so near home RTL descends at once


@pytest.mark.parametrize("action", [6, 7])
def test_com_obl_rc_act_can_stop_the_motors(action: int) -> None:
    bench = offboard(parameters={"COM_OBL_RC_ACT": action})
    bench.repeated = None
    bench.run(6.0)
    assert (bench.armed, bench.truth[2]) == (False, 0.0)


@pytest.mark.parametrize("loss_s", [0.6, 3.0])
def test_com_of_loss_t_is_the_time_until_the_failsafe(loss_s: float) -> None:
    bench = offboard(parameters={"COM_OF_LOSS_T": loss_s})
    bench.repeated = None
    lasted_s = bench.until(lambda: "Failsafe activated" in bench.texts, 5.0)
    assert lasted_s == pytest.approx(loss_s, abs=0.15)


def test_resumed_setpoints_restore_offboard() -> None:
    bench = offboard()
    bench.repeated = None
    bench.run(3.0)
    assert bench.mode == POSITION
    bench.stream(0, 2, 0)
    bench.run(3.0)
    assert bench.mode == OFFBOARD
    assert bench.velocity[1] > 1.0


def test_only_an_explicit_mode_ends_offboard_for_good() -> None:
    bench = offboard()
    bench.repeated = None
    bench.run(2.0)
    assert bench.set_mode(HOLD) == [ACCEPTED, ACCEPTED]
    bench.stream(0, 2, 0)
    assert bench.run(3.0).mode == HOLD


def test_two_setpoints_a_second_keep_offboard() -> None:
    bench = offboard()
    repeated, bench.repeated = bench.repeated, None
    for _ in range(10):
        bench.send(repeated)
        bench.run(0.5)
    assert bench.mode == OFFBOARD
    assert "Failsafe activated" not in bench.texts


def test_setpoints_for_another_vehicle_do_not_count() -> None:
    bench = offboard()
    bench.stream(0, 0, 0, target=2)
    assert bench.run(2.5).mode == POSITION


def test_takeoff_and_landing_by_velocity() -> None:
    bench = ready()
    bench.stream(0, 0, -2)
    bench.run(0.2)
    bench.set_mode(OFFBOARD)
    assert bench.arm() == [ACCEPTED]
    armed_s = bench.now_s
    bench.until(lambda: "Takeoff detected" in bench.texts, 5.0)
    assert bench.now_s - armed_s == pytest.approx(1.84, abs=0.15)
    bench.run(6.0)
    assert bench.last("EXTENDED_SYS_STATE").landed_state == 2
    assert bench.truth[2] < -3.0
    bench.stream(0, 0, 1)
    bench.until(lambda: bench.last("EXTENDED_SYS_STATE").landed_state == ON_GROUND, 30.0)
    bench.until(lambda: not bench.armed, 4.0)


def test_five_metre_step_response_of_the_vehicle_as_recorded() -> None:
    bench = offboard()
    bench.stream(5.0, 0.0, 0.0)
    bench.run(1.0)
    assert bench.velocity[0] == pytest.approx(3.15, abs=0.35)
    assert bench.run(7.0).velocity[0] == pytest.approx(4.36, abs=0.2)
    bench.stream(0.0, 0.0, 0.0)
    begin_m = bench.truth[0]
    assert 3.5 < bench.run(8.0).truth[0] - begin_m < 7.5


@pytest.mark.parametrize(("action", "mode"), [(0, HOLD), (1, HOLD), (2, RETURN), (3, LAND)])
def test_data_link_loss_on_the_ground_station_timeout(action: int, mode: tuple[int, int]) -> None:
    """Without a ground station's heartbeat, NAV_DLL_ACT acts after COM_DL_LOSS_T and COM_FAIL_ACT_T."""
    bench = holding()
    bench.set_parameter("NAV_DLL_ACT", action)
    bench.set_parameter("COM_DL_LOSS_T", 5)
    bench.set_parameter("COM_FAIL_ACT_T", 3.0)
    bench.run(2.0)
    bench.heartbeats = False
    bench.run(6.5)
    assert bench.mode == HOLD
    bench.run(3.0)
    assert bench.mode == mode


def test_data_link_loss_acts_once_and_in_offboard() -> None:
    bench = offboard()
    bench.set_parameter("NAV_DLL_ACT", 2)
    bench.set_parameter("COM_DL_LOSS_T", 5)
    bench.heartbeats = False
    bench.until(lambda: bench.mode == RETURN, 13.0)
    bench.set_mode(HOLD)  # whoever takes it out of there is not overruled again
    assert bench.run(8.0).mode == HOLD
