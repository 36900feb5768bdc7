"""ArduPilot gets ready, arms, takes off and lands (habits 19 to 31)."""

from __future__ import annotations

import pytest

from gcs.sim.autopilots.ardupilot.modes import Mode
from tests.support.ardu_bench import IN_AIR, ON_GROUND, TAKING_OFF, ArduBench, grounded, hovering
from tests.support.sim_bench import ACCEPTED, FAILED

BLIND, READY = 165, 831
PREARM = 0x10000000


@pytest.mark.soak
def test_the_start_takes_40_s_in_the_recorded_stages() -> None:
    bench = ArduBench(late=True)
    at_s: dict[str, float] = {}
    while bench.now_s < 42.0:
        bench.run(0.1)
        for text in bench.texts:
            at_s.setdefault(text, bench.now_s)
    assert at_s["EKF2 IMU0 initial yaw alignment complete"] == pytest.approx(4.04, abs=0.15)
    assert at_s["EKF2 IMU1 tilt alignment complete"] == pytest.approx(5.1, abs=0.15)
    assert at_s["GPS 1: detected as u-blox at 230400 baud"] == pytest.approx(8.8, abs=0.15)
    assert at_s["EKF2 IMU0 origin set"] == pytest.approx(19.0, abs=0.15)
    assert at_s["EKF2 IMU1 is using GPS"] == pytest.approx(39.5, abs=0.15)
    times_s = {
        kind: next(time_s for time_s, message in bench.received if message.get_type() == kind)
        for kind in ("GLOBAL_POSITION_INT", "HOME_POSITION", "LOCAL_POSITION_NED")
    }
    assert times_s["GLOBAL_POSITION_INT"] == pytest.approx(8.8, abs=0.3)
    assert times_s["HOME_POSITION"] == pytest.approx(19.0, abs=0.6)
    assert times_s["LOCAL_POSITION_NED"] == pytest.approx(39.5, abs=0.3)


@pytest.mark.soak
def test_ekf_flags_go_from_165_to_831_with_the_position() -> None:
    bench = ArduBench(late=True).run(30.0)
    assert bench.last("EKF_STATUS_REPORT").flags == BLIND
    assert bench.run(11.0).last("EKF_STATUS_REPORT").flags == READY


def test_the_prearm_bit_depends_on_the_mode() -> None:
    bench = ArduBench(late=True).run(12.0)
    assert bench.prearm_ok
    bench.order(Mode.GUIDED)
    assert not bench.run(1.6).prearm_ok
    bench.until(lambda: bench.prearm_ok, 40.0)
    assert bench.now_s == pytest.approx(40.0, abs=1.6)


@pytest.mark.soak
def test_reasons_are_sent_at_arming_and_every_30_s() -> None:
    bench = ArduBench(late=True).run(6.0)
    bench.order(Mode.GUIDED)
    text = "PreArm: Need Position Estimate"
    assert bench.run(10.0).texts.count(text) == 0
    assert bench.run(3.0).texts.count(text) == 1
    assert bench.arm() == [FAILED]
    assert bench.texts.count(text) == 2
    assert bench.last("STATUSTEXT").severity == 2


@pytest.mark.soak
@pytest.mark.parametrize("mode", [Mode.LAND, Mode.RTL, Mode.SMART_RTL, Mode.BRAKE, Mode.AUTO, Mode.CIRCLE])
def test_modes_that_do_not_arm_leave_the_prearm_bit(mode: Mode) -> None:
    bench = grounded()
    bench.order(mode)
    assert bench.run(1.6).prearm_ok
    assert bench.arm() == [FAILED]
    assert bench.texts[-1] == "PreArm: Mode not armable"


@pytest.mark.soak
@pytest.mark.parametrize(
    "mode", [Mode.GUIDED, Mode.STABILIZE, Mode.LOITER, Mode.ALT_HOLD, Mode.THROW, Mode.GUIDED_NOGPS]
)
def test_modes_that_arm(mode: Mode) -> None:
    bench = grounded()
    bench.order(mode)
    assert bench.arm() == [ACCEPTED]


@pytest.mark.parametrize(
    ("parameters", "text", "times"),
    [
        ({"SIM_GPS_DISABLE": 1}, "Need Position Estimate", 1),
        ({"COMPASS_OFS_X": 0.0, "COMPASS_OFS_Y": 0.0, "COMPASS_OFS_Z": 0.0}, "Compass not calibrated", 2),
        (
            {"INS_ACCOFFS_X": 0.0, "INS_ACCOFFS_Y": 0.0, "INS_ACCOFFS_Z": 0.0},
            "3D Accel calibration needed",
            1,
        ),
        ({"GPS_HDOP_GOOD": 10}, "High GPS HDOP", 1),
        ({"BATT_ARM_VOLT": 13.0}, "Battery 1 below minimum arming voltage", 2),
        (
            {"BATT_LOW_VOLT": 11.5, "BATT_LOW_TIMER": 2, "BATT_FS_LOW_ACT": 2, "SIM_BATT_VOLTAGE": 11.0},
            "Battery 1 low voltage failsafe",
            2,
        ),
        ({"SIM_RC_FAIL": 1}, "Radio failsafe on", 1),
        ({"FENCE_ENABLE": 1, "FENCE_RADIUS": 0.0}, "FENCE_MARGIN is less than FENCE_RADIUS", 1),
        ({"ANGLE_MAX": 500}, "Check ANGLE_MAX", 1),
        ({"FRAME_CLASS": 0}, "Check firmware or FRAME_CLASS", 1),
        ({"FS_THR_VALUE": 1005}, "Check FS_THR_VALUE", 1),
        ({"FS_THR_VALUE": 1005}, "Throttle below Failsafe", 1),
    ],
)
def test_each_reason_refuses_arming_with_its_text(
    parameters: dict[str, float], text: str, times: int
) -> None:
    bench = grounded()
    for name, value in parameters.items():
        bench.set_parameter(name, value)
    bench.run(9.0)
    assert not bench.prearm_ok
    before = len(bench.texts)
    assert bench.arm() == [FAILED]
    assert bench.texts[before:].count(f"PreArm: {text}") == times


def test_arming_check_0_keeps_the_check_of_the_position() -> None:
    bench = grounded(parameters={"ARMING_CHECK": 0, "BATT_ARM_VOLT": 13.0})
    assert bench.arm() == [ACCEPTED]
    bench = grounded(parameters={"ARMING_CHECK": 0})
    bench.set_parameter("SIM_GPS_DISABLE", 1)
    assert bench.run(9.0).arm() == [FAILED]


def test_force_2989_arms_with_a_low_battery_but_not_starting() -> None:
    assert grounded(parameters={"BATT_ARM_VOLT": 13.0}).command(400, 1, 2989) == [ACCEPTED]
    assert ArduBench(late=True).run(3.0).command(400, 1, 2989) == [FAILED]


@pytest.mark.parametrize(
    ("after_s", "texts"),
    [
        (3.5, ["EKF attitude is bad", "EKF2: unknown initialization failure"]),
        (4.5, ["EKF2 still initialising", "EKF attitude is bad", "EKF2 still initialising"]),
    ],
)
def test_arming_right_after_the_start_is_refused_by_the_ekf(after_s: float, texts: list[str]) -> None:
    bench = ArduBench(late=True).run(after_s)
    before = len(bench.texts)
    assert bench.arm() == [FAILED]
    assert bench.texts[before:] == [f"PreArm: {text}" for text in texts]


def test_stabilize_can_be_armed_without_a_position() -> None:
    assert ArduBench(late=True).run(12.0).arm() == [ACCEPTED]


def test_the_ack_comes_first_and_the_heartbeat_in_its_turn() -> None:
    bench = grounded()
    beats = bench.count("HEARTBEAT")
    assert bench.command(400, 1, wait_s=0.04) == [ACCEPTED]
    assert bench.texts[-1] == "Arming motors"
    assert bench.count("HEARTBEAT") == beats
    assert bench.run(1.0).armed
    assert bench.arm() == [ACCEPTED]


def test_upward_setpoints_do_nothing_on_the_ground() -> None:
    bench = grounded()
    bench.arm()
    bench.stream(0.0, 0.0, -2.0)
    assert bench.run(8.0).height_m == pytest.approx(0.0, abs=0.01)
    assert bench.armed


@pytest.mark.keeps("4-True")
@pytest.mark.parametrize(("delay_s", "disarms"), [(10, True), (4, True), (0, False)])
def test_it_disarms_disarm_delay_after_arming(delay_s: int, disarms: bool) -> None:
    bench = grounded(parameters={"DISARM_DELAY": delay_s})
    bench.arm()
    bench.run(max(delay_s - 0.5, 1.1))
    assert bench.armed
    assert bench.run(2.0).armed != disarms
    assert ("Disarming motors" in bench.texts) == disarms


@pytest.mark.soak
@pytest.mark.parametrize(("height_m", "after_s"), [(10.0, 7.0), (15.0, 9.1), (20.0, 11.1)])
def test_takeoff_reaches_its_height_in_the_recorded_time(height_m: float, after_s: float) -> None:
    bench = grounded()
    bench.arm()
    assert bench.command(22, 0, 0, 0, 0, 0, 0, height_m) == [ACCEPTED]
    assert bench.until(lambda: bench.height_m > height_m - 0.4, 20.0) == pytest.approx(after_s, abs=0.7)
    assert bench.run(5.0).height_m == pytest.approx(height_m, abs=0.2)


@pytest.mark.soak
def test_landed_state_is_3_at_once_and_2_five_seconds_later() -> None:
    bench = grounded(step_s=0.01)
    bench.arm()
    bench.command(22, 0, 0, 0, 0, 0, 0, 10.0)
    assert bench.run(0.3).landed_state == TAKING_OFF
    assert bench.until(lambda: bench.landed_state == IN_AIR, 10.0) == pytest.approx(5.0, abs=0.8)


@pytest.mark.soak
@pytest.mark.parametrize("case", ["disarmed", "in the air", "in STABILIZE", "below"])
def test_a_takeoff_is_refused(case: str) -> None:
    bench = hovering() if case == "in the air" else grounded()
    if case == "in STABILIZE":
        bench.order(Mode.STABILIZE)
    if case in {"in STABILIZE", "below"}:
        bench.arm()
    assert bench.command(22, 0, 0, 0, 0, 0, 0, -2.0 if case == "below" else 10.0) == [FAILED]


@pytest.mark.soak
def test_a_velocity_setpoint_cancels_the_takeoff_on_the_ground() -> None:
    bench = grounded()
    bench.arm()
    bench.stream(0.0, 0.0, 0.0)
    texts = len(bench.texts)
    assert bench.command(22, 0, 0, 0, 0, 0, 0, 10.0) == [ACCEPTED]
    assert bench.run(8.0).height_m == pytest.approx(0.0, abs=0.01)
    assert (bench.landed_state, len(bench.texts)) == (ON_GROUND, texts)
    assert not bench.run(4.0).armed


@pytest.mark.soak
def test_a_velocity_setpoint_cancels_the_climb() -> None:
    bench = grounded()
    bench.arm()
    bench.command(22, 0, 0, 0, 0, 0, 0, 10.0)
    bench.until(lambda: bench.height_m > 3.0, 10.0)
    bench.stream(0.0, 0.0, 0.0)
    assert bench.run(5.0).height_m == pytest.approx(3.85, abs=0.5)
    assert bench.landed_state == IN_AIR
    assert bench.command(22, 0, 0, 0, 0, 0, 0, 10.0) == [FAILED]
    bench.stream(0.0, 0.0, -1.0)
    assert bench.run(4.0).height_m > 6.0


def test_without_setpoints_the_takeoff_goes_on_by_itself() -> None:
    assert hovering().truth == pytest.approx((0.0, 0.0, -10.0), abs=0.2)


def test_yaw_is_aligned_3_5_s_after_the_takeoff_command() -> None:
    bench = grounded()
    bench.arm()
    bench.command(22, 0, 0, 0, 0, 0, 0, 10.0)
    text = "EKF2 IMU1 in-flight yaw alignment complete"
    assert bench.until(lambda: text in bench.texts, 8.0) == pytest.approx(3.5, abs=0.2)


@pytest.mark.soak
def test_pushed_into_the_ground_it_lands_and_disarms_later() -> None:
    bench = hovering(3.0)
    bench.stream(0.0, 0.0, 1.0)
    bench.until(lambda: bench.truth[2] >= 0.0, 10.0)
    assert bench.until(lambda: bench.landed_state == ON_GROUND, 5.0) == pytest.approx(2.0, abs=0.4)
    assert bench.last("HEARTBEAT").base_mode & 128
    assert bench.until(lambda: "Disarming motors" in bench.texts, 15.0) == pytest.approx(10.0, abs=0.5)


def test_after_landing_guided_must_be_ordered_before_arming() -> None:
    bench = hovering(3.0)
    bench.order(Mode.LAND)
    bench.until(lambda: not bench.armed, 20.0)
    assert bench.arm() == [FAILED]
    assert bench.order(Mode.GUIDED) == [ACCEPTED]
    assert bench.arm() == [ACCEPTED]
