"""ArduPilot's modes and commands (habits 11 to 17)."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import common

from gcs.sim.autopilots.ardupilot.modes import Mode
from tests.support.ardu_bench import LANDING, ArduBench, cruising, grounded, hovering, stop_m
from tests.support.sim_bench import ACCEPTED, FAILED, UNSUPPORTED

pytestmark = pytest.mark.soak


@pytest.mark.parametrize(
    ("mode", "number"), [(Mode.GUIDED, 4), (Mode.RTL, 6), (Mode.LAND, 9), (Mode.BRAKE, 17)]
)
def test_the_mode_is_the_plain_number(mode: Mode, number: int) -> None:
    bench = grounded()
    assert bench.command(176, 1, number) == [ACCEPTED]
    assert bench.last("HEARTBEAT").custom_mode == mode


def test_a_mode_change_has_one_ack_and_a_heartbeat_at_once() -> None:
    bench = hovering()
    beats = bench.count("HEARTBEAT")
    assert bench.command(176, 1, Mode.BRAKE, wait_s=0.02) == [ACCEPTED]
    assert bench.count("HEARTBEAT") == beats + 1
    assert bench.custom_mode == Mode.BRAKE


def test_a_repeated_order_is_acked_each_time() -> None:
    bench = hovering()
    assert [bench.order(Mode.BRAKE) for _ in range(3)] == [[ACCEPTED]] * 3


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (8, "No such mode"),
        (Mode.AUTO, "Flight mode change failed AUTO"),
        (Mode.THROW, "Flight mode change failed THROW"),
        (Mode.FOLLOW, "Flight mode change failed FOLLOW"),
    ],
)
def test_a_refused_mode_is_result_3_with_a_text_and_flies_on(number: int, text: str) -> None:
    bench = cruising(3.0)
    assert bench.order(number) == [UNSUPPORTED]
    assert bench.texts[-1] == text
    assert bench.run(3.0).velocity[0] == pytest.approx(3.0, abs=0.3)
    assert bench.custom_mode == Mode.GUIDED


def test_disarmed_any_mode_is_accepted_without_a_position() -> None:
    bench = ArduBench(late=True).run(6.0)
    for mode in (Mode.GUIDED, Mode.AUTO, Mode.RTL):
        assert bench.order(mode) == [ACCEPTED]


def test_a_mode_commanded_while_booting_is_forgotten() -> None:
    bench = ArduBench(late=True).run(1.3)
    assert bench.order(Mode.GUIDED) == [ACCEPTED]
    assert bench.custom_mode == Mode.GUIDED
    assert bench.run(2.0).custom_mode == Mode.STABILIZE


def test_guided_is_refused_armed_without_a_position() -> None:
    bench = ArduBench(late=True).run(12.0)
    assert bench.arm() == [ACCEPTED]
    assert bench.order(Mode.GUIDED) == [UNSUPPORTED]
    assert bench.texts[-1] == "Mode change failed: GUIDED requires position"


def test_set_mode_is_acknowledged_as_command_11() -> None:
    bench = hovering()
    bench.send(common.MAVLink_set_mode_message(1, 1, Mode.BRAKE))
    ack = bench.run(0.1).last("COMMAND_ACK")
    assert (ack.command, ack.result, bench.custom_mode) == (11, ACCEPTED, Mode.BRAKE)


def under_way(speed_m_s: float, over_s: float) -> ArduBench:
    """As recorded: north for some seconds, past the overshoot of the ramp."""
    bench = hovering()
    bench.stream(speed_m_s, 0.0, 0.0)
    return bench.run(over_s)


@pytest.mark.parametrize(("speed_m_s", "over_s", "on_m"), [(3.0, 3.5, 4.2), (5.0, 5.3, 6.0)])
def test_brake_stops_in_the_recorded_distance(speed_m_s: float, over_s: float, on_m: float) -> None:
    bench = under_way(speed_m_s, over_s)
    assert bench.velocity[0] > speed_m_s
    assert bench.order(Mode.BRAKE) == [ACCEPTED]
    farthest_m, last_m = stop_m(bench)
    assert farthest_m == pytest.approx(on_m, abs=0.5)
    there = bench.truth
    assert bench.run(10.0).truth == pytest.approx(there, abs=0.3)
    assert bench.height_m == pytest.approx(10.0, abs=0.3)
    assert last_m > 0.7 * farthest_m


@pytest.mark.parametrize("acceleration", [100.0, 500.0])
def test_brake_does_not_depend_on_wpnav_accel(acceleration: float) -> None:
    bench = cruising(5.0, parameters={"WPNAV_ACCEL": acceleration})
    bench.order(Mode.BRAKE)
    assert stop_m(bench)[0] == pytest.approx(6.0, abs=0.6)


def test_setpoints_are_ignored_outside_guided() -> None:
    bench = cruising(3.0)
    bench.order(Mode.BRAKE)
    assert bench.run(6.0).velocity[0] == pytest.approx(0.0, abs=0.2)
    assert bench.custom_mode == Mode.BRAKE


def test_guided_by_command_takes_setpoints_again() -> None:
    bench = cruising(3.0)
    bench.order(Mode.BRAKE)
    bench.run(4.0)
    assert bench.order(Mode.GUIDED) == [ACCEPTED]
    assert bench.run(6.0).velocity[0] > 2.0


@pytest.mark.parametrize("mode", [Mode.LOITER, Mode.POSHOLD, Mode.ALT_HOLD, Mode.CIRCLE])
def test_modes_by_hand_sink_without_a_transmitter(mode: Mode) -> None:
    bench = hovering()
    assert bench.order(mode) == [ACCEPTED]
    assert bench.run(3.0).velocity[2] == pytest.approx(2.4, abs=0.2)


@pytest.mark.parametrize(
    ("mode", "least_m", "most_m"),
    [
        (Mode.BRAKE, 3.7, 4.7),
        (Mode.LOITER, 3.5, 4.5),
        (Mode.POSHOLD, 3.3, 4.3),
        (Mode.ALT_HOLD, 5.9, 20.0),
        (Mode.CIRCLE, 7.0, 9.0),
        (Mode.LAND, 2.4, 3.2),
        (Mode.RTL, 6.8, 8.2),
        (Mode.SMART_RTL, 6.8, 8.2),
        (Mode.AVOID_ADSB, 7.1, 8.5),
    ],
)
def test_each_mode_goes_on_so_far_and_takes_no_setpoints(mode: Mode, least_m: float, most_m: float) -> None:
    """Habit 14: from 3.4 m/s, while setpoints go on; none leads back to GUIDED by itself."""
    bench = under_way(3.0, 3.5)
    assert bench.order(mode) == [ACCEPTED]
    assert least_m < stop_m(bench, 4.0)[0] < most_m
    assert bench.run(4.0).custom_mode == mode
    assert bench.velocity[0] < 1.5


@pytest.mark.parametrize("mode", [Mode.BRAKE, Mode.AVOID_ADSB])
def test_modes_that_hold_keep_place_and_height(mode: Mode) -> None:
    bench = hovering()
    bench.order(mode)
    assert bench.run(15.0).truth == pytest.approx((0.0, 0.0, -10.0), abs=0.3)


def test_guided_nogps_keeps_the_height_and_takes_no_setpoints() -> None:
    bench = hovering()
    assert bench.order(Mode.GUIDED_NOGPS) == [ACCEPTED]
    bench.stream(3.0, 0.0, 0.0)
    bench.run(5.0)
    assert bench.height_m == pytest.approx(10.0, abs=0.3)
    assert bench.velocity[0] == pytest.approx(0.0, abs=0.2)


def test_land_stops_within_three_metres_from_3_4_m_s() -> None:
    bench = under_way(3.0, 3.5)
    bench.order(Mode.LAND)
    assert stop_m(bench, 4.0)[0] == pytest.approx(2.8, abs=0.4)


@pytest.mark.parametrize("mode", [Mode.RTL, Mode.AVOID_ADSB])
def test_other_modes_stop_as_wpnav_accel_has_it(mode: Mode) -> None:
    bench = under_way(3.0, 3.5)
    bench.order(mode)
    assert stop_m(bench, 4.0)[0] == pytest.approx(7.5, abs=0.7)


def test_land_is_fast_above_ten_metres_and_slow_below() -> None:
    bench = hovering(20.0)
    bench.order(Mode.LAND)
    assert bench.run(3.0).velocity[2] == pytest.approx(1.5, abs=0.1)
    assert bench.last("EXTENDED_SYS_STATE").landed_state == LANDING
    bench.until(lambda: bench.height_m < 8.0, 10.0)
    assert bench.run(1.0).velocity[2] == pytest.approx(0.5, abs=0.1)


def test_land_from_ten_metres_takes_20_s_and_disarms() -> None:
    bench = hovering()
    bench.order(Mode.LAND)
    assert bench.until(lambda: bench.truth[2] >= 0.0, 40.0) == pytest.approx(20.3, abs=1.0)
    assert bench.until(lambda: "Disarming motors" in bench.texts, 5.0) == pytest.approx(2.1, abs=0.3)
    assert bench.run(1.1).custom_mode == Mode.LAND


def test_rtl_climbs_to_rtl_alt_flies_home_waits_and_lands() -> None:
    bench = cruising(5.0)
    bench.stream(0.0, 5.0, 0.0)
    bench.run(8.0)
    assert bench.order(Mode.RTL) == [ACCEPTED]
    highest_m = max(bench.run(0.5).height_m for _ in range(30))
    assert highest_m == pytest.approx(15.0, abs=0.3)
    bench.until(lambda: not bench.armed, 80.0)
    assert math.hypot(*bench.truth[:2]) < 0.3
    assert bench.custom_mode == Mode.RTL


def test_rtl_above_rtl_alt_stays_at_its_height() -> None:
    bench = cruising(5.0, height_m=20.0)
    bench.order(Mode.RTL)
    assert max(bench.run(0.5).height_m for _ in range(20)) == pytest.approx(20.0, abs=0.4)


@pytest.mark.parametrize(("rtl_speed", "speed_m_s"), [(0, 5.0), (250, 2.5)])
def test_rtl_returns_at_rtl_speed_or_wpnav_speed(rtl_speed: int, speed_m_s: float) -> None:
    bench = cruising(5.0, height_m=20.0, parameters={"RTL_SPEED": rtl_speed})
    bench.stream(0.0, 0.0, 0.0)
    bench.run(9.0)
    bench.order(Mode.RTL)
    fastest_m_s = max(-bench.run(0.2).velocity[0] for _ in range(60))
    assert fastest_m_s == pytest.approx(speed_m_s, abs=0.4)


def test_smart_rtl_returns_at_its_height() -> None:
    bench = cruising(5.0)
    bench.order(Mode.SMART_RTL)
    assert max(bench.run(0.5).height_m for _ in range(20)) == pytest.approx(10.0, abs=0.4)
    bench.until(lambda: not bench.armed, 80.0)
    assert math.hypot(*bench.truth[:2]) < 0.3


def test_a_pause_is_not_known_and_it_flies_on() -> None:
    bench = cruising(4.0)
    assert bench.command(193, 0) == [UNSUPPORTED]
    assert bench.run(2.0).velocity[0] == pytest.approx(4.0, abs=0.3)


@pytest.mark.parametrize(("number", "mode"), [(17, Mode.LOITER), (20, Mode.RTL), (21, Mode.LAND)])
def test_navigation_commands_are_modes(number: int, mode: Mode) -> None:
    bench = hovering()
    assert bench.command(number) == [ACCEPTED]
    assert bench.custom_mode == mode


@pytest.mark.parametrize(
    ("number", "result"),
    [(84, UNSUPPORTED), (252, UNSUPPORTED), (530, UNSUPPORTED), (31000, UNSUPPORTED), (300, FAILED)],
)
def test_unknown_commands_are_unsupported(number: int, result: int) -> None:
    assert grounded().command(number) == [result]


@pytest.mark.parametrize("number", [400, 176])
def test_arming_and_modes_by_command_int_are_unsupported(number: int) -> None:
    bench = grounded()
    bench.send(common.MAVLink_command_int_message(1, 1, 0, number, 0, 0, 1.0, 17.0, 0.0, 0.0, 0, 0, 0.0))
    ack = bench.run(0.1).last("COMMAND_ACK")
    assert (ack.command, ack.result) == (number, UNSUPPORTED)
    assert (bench.armed, bench.custom_mode) == (False, Mode.GUIDED)


def test_do_reposition_flies_to_a_place_by_command_int() -> None:
    bench = hovering()
    home = bench.last("HOME_POSITION")
    latitude = round(home.latitude + 20.0 / 0.0111194)
    bench.send(
        common.MAVLink_command_int_message(
            1, 1, 6, 192, 0, 0, -1.0, 0.0, 0.0, math.nan, latitude, home.longitude, 12.0
        )
    )
    assert bench.run(0.1).last("COMMAND_ACK").result == ACCEPTED
    assert bench.run(25.0).truth == pytest.approx((20.0, 0.0, -12.0), abs=0.5)


def test_condition_yaw_is_kept_under_setpoints_without_a_yaw() -> None:
    bench = hovering()
    assert bench.command(115, 90.0, 0, 1, 0) == [ACCEPTED]
    bench.run(4.0)
    bench.stream(2.0, 0.0, 0.0)
    assert bench.run(4.0).last("GLOBAL_POSITION_INT").hdg == pytest.approx(9000, abs=200)
    assert bench.velocity[0] > 1.0


def test_do_change_speed_is_accepted_and_setpoints_go_on() -> None:
    """Habit 17: whether the real one limits setpoints was not settled; the station never sends it."""
    bench = cruising(4.0)
    assert bench.command(178, 1, 2.0) == [ACCEPTED]
    assert bench.run(3.0).velocity[0] == pytest.approx(4.0, abs=0.3)
