"""ArduPilot's home, origin and local frame (habits 32 to 35)."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import common

from gcs.sim.autopilots.ardupilot.modes import Mode
from tests.support.ardu_bench import ArduBench, cruising, grounded, hovering
from tests.support.sim_bench import ACCEPTED, POSITION_ONLY

pytestmark = pytest.mark.soak

METRES_PER_UNIT = 0.0111194  # of latitude in GLOBAL_POSITION_INT


def local(bench: ArduBench) -> tuple[float, float, float]:
    message = bench.last("LOCAL_POSITION_NED")
    return message.x, message.y, message.z


def moved() -> ArduBench:
    """Landed some 30 m north of where it started, and armed again."""
    bench = cruising(5.0, height_m=3.0)
    bench.repeated = None
    bench.order(Mode.LAND)
    bench.until(lambda: not bench.armed, 30.0)
    assert bench.order(Mode.GUIDED) == [ACCEPTED]
    return bench.run(1.1)


def test_home_moves_with_every_arming_and_the_origin_stays() -> None:
    bench = moved()
    north_m = bench.truth[0]
    assert north_m > 20.0
    assert local(bench)[0] == pytest.approx(north_m, abs=0.2)
    home, origin = bench.last("HOME_POSITION"), origin_of(bench)
    bench.arm()
    bench.run(1.1)
    assert local(bench) == pytest.approx((0.0, 0.0, 0.0), abs=0.2)
    jumped_m = METRES_PER_UNIT * (bench.last("HOME_POSITION").latitude - home.latitude)
    assert jumped_m == pytest.approx(north_m, abs=0.3)
    assert origin_of(bench) == origin


def origin_of(bench: ArduBench) -> tuple[int, int, int]:
    bench.command(512, 49)
    message = bench.last("GPS_GLOBAL_ORIGIN")
    return message.latitude, message.longitude, message.altitude


def test_local_position_ned_counts_from_home_in_flight_too() -> None:
    bench = moved()
    begin_m = bench.truth[0]
    bench.arm()
    bench.command(22, 0, 0, 0, 0, 0, 0, 5.0)
    bench.run(9.0)
    assert local(bench) == pytest.approx((bench.truth[0] - begin_m, 0.0, -5.0), abs=0.3)


def test_global_positions_do_not_jump_with_home() -> None:
    bench = moved()
    before = bench.last("GLOBAL_POSITION_INT").lat
    bench.arm()
    assert bench.run(1.0).last("GLOBAL_POSITION_INT").lat == pytest.approx(before, abs=3)


def test_do_set_home_in_the_air_makes_the_local_position_jump() -> None:
    bench = hovering(8.0)
    assert local(bench)[2] == pytest.approx(-8.0, abs=0.2)
    assert bench.command(179, 1) == [ACCEPTED]
    assert bench.run(0.3).last("LOCAL_POSITION_NED").z == pytest.approx(0.0, abs=0.2)
    assert bench.last("GLOBAL_POSITION_INT").relative_alt == pytest.approx(0, abs=200)
    assert bench.height_m == pytest.approx(8.0, abs=0.2)


def test_position_setpoints_count_from_the_origin_not_from_home() -> None:
    bench = moved()
    bench.arm()
    bench.command(22, 0, 0, 0, 0, 0, 0, 8.0)
    bench.run(12.0)
    begin_m = bench.truth[0]
    assert begin_m > 20.0
    bench.stream(10.0, 0.0, -8.0, POSITION_ONLY)
    bench.run(25.0)
    assert bench.truth == pytest.approx((10.0, 0.0, -8.0), abs=0.4)
    assert local(bench)[0] < -10.0


def test_home_by_coordinates_is_float32_and_rtl_goes_there() -> None:
    bench = hovering(8.0)
    home = bench.last("HOME_POSITION")
    latitude_deg = (home.latitude + 15.0 / METRES_PER_UNIT) * 1e-7
    place = (latitude_deg, home.longitude * 1e-7, home.altitude * 1e-3)
    assert bench.command(179, 0, 0, 0, 0, *place) == [ACCEPTED]
    assert bench.run(0.6).last("LOCAL_POSITION_NED").x == pytest.approx(-15.0, abs=1.0)
    bench.order(Mode.RTL)
    bench.until(lambda: not bench.armed, 90.0)
    assert bench.truth[0] == pytest.approx(15.0, abs=1.0)
    assert bench.truth[0] != pytest.approx(15.0, abs=0.01)


def test_home_is_at_its_own_zero_and_level() -> None:
    home = hovering().last("HOME_POSITION")
    assert (home.x, home.y, home.z, list(home.q)) == (0.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0])


def test_relative_alt_is_above_home() -> None:
    bench = hovering(8.0)
    assert bench.last("GLOBAL_POSITION_INT").relative_alt == pytest.approx(8000, abs=200)


def test_an_origin_from_outside_is_ignored_silently() -> None:
    bench = grounded()
    before = origin_of(bench)
    answers = len(bench.all("COMMAND_ACK")) + len(bench.texts)
    bench.send(common.MAVLink_set_gps_global_origin_message(1, 470000000, 80000000, 400000))
    bench.run(0.5)
    assert len(bench.all("COMMAND_ACK")) + len(bench.texts) == answers
    assert origin_of(bench) == before


def test_each_vehicle_has_a_home_and_an_origin_of_its_own() -> None:
    bench = ArduBench(count=3, grid_columns=3, spacing_m=3.8).run(2.0)
    homes = {message.get_srcSystem(): message.longitude for message in bench.all("HOME_POSITION")}
    assert len(set(homes.values())) == 3
    for message in bench.all("LOCAL_POSITION_NED")[-3:]:
        assert (message.x, message.y) == pytest.approx((0.0, 0.0), abs=0.05)
