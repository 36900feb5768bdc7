"""Takeoff, hold, land, return; and noise, wind, seeds and the grid."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.sim.protocol.autopilot import Autopilot
from tests.support.sim_bench import (
    ACCEPTED,
    HOLD,
    LAND,
    POSITION_ONLY,
    RETURN,
    Bench,
    holding,
    offboard,
    ready,
)

TAKING_OFF, IN_AIR, LANDING, ON_GROUND = 3, 2, 4, 1


pytestmark = pytest.mark.soak


def test_takeoff_climbs_at_mpc_tko_speed_to_its_altitude() -> None:
    bench = ready()
    amsl_m = bench.last("HOME_POSITION").altitude * 1e-3 + 12.0
    bench.command(22, 0, 0, 0, math.nan, math.nan, math.nan, amsl_m)
    bench.arm()
    bench.run(6.0)
    assert bench.last("EXTENDED_SYS_STATE").landed_state == TAKING_OFF
    fastest_m_s = 0.0
    while bench.mode != HOLD:
        bench.run(0.1)
        fastest_m_s = max(fastest_m_s, -bench.velocity[2])
    assert fastest_m_s == pytest.approx(1.5, abs=0.15)
    assert bench.run(0.3).last("EXTENDED_SYS_STATE").landed_state == IN_AIR
    assert bench.run(5.0).truth == pytest.approx((0.0, 0.0, -12.0), abs=0.25)


def test_mis_takeoff_alt_is_the_default_height() -> None:
    bench = ready(parameters={"MIS_TAKEOFF_ALT": 6.0})
    bench.command(22, 0, 0, 0, *[math.nan] * 4)
    bench.arm()
    assert bench.run(15.0).truth[2] == pytest.approx(-6.0, abs=0.25)


def test_hold_stops_and_stays() -> None:
    bench = offboard()
    bench.stream(5.0, 0.0, 0.0)
    bench.run(5.0)
    assert bench.set_mode(HOLD) == [ACCEPTED, ACCEPTED]
    bench.repeated = None
    bench.run(12.0)
    there = bench.truth
    assert bench.velocity == pytest.approx((0.0, 0.0, 0.0), abs=0.1)
    assert bench.run(10.0).truth == pytest.approx(there, abs=0.3)


def test_land_slows_down_near_the_ground() -> None:
    bench = holding(height_m=12.0)
    assert bench.command(21) == [ACCEPTED]
    assert "Landing at current position" in bench.texts
    speeds: dict[int, float] = {}
    bench.run(1.5)
    while bench.truth[2] < -0.05:
        bench.run(0.1)
        speeds[round(-bench.truth[2])] = bench.velocity[2]
    assert speeds[9] == pytest.approx(1.3, abs=0.25)
    assert speeds[4] == pytest.approx(0.7, abs=0.1)
    assert speeds[0] == pytest.approx(0.3, abs=0.1)
    assert bench.last("EXTENDED_SYS_STATE").landed_state == LANDING
    bench.until(lambda: bench.last("EXTENDED_SYS_STATE").landed_state == ON_GROUND, 8.0)


def test_mpc_land_speed_is_honoured() -> None:
    bench = holding(height_m=5.0, parameters={"MPC_LAND_SPEED": 0.4})
    bench.command(21)
    assert bench.run(3.0).velocity[2] == pytest.approx(0.4, abs=0.08)


def fly_away(bench: Bench, north_m: float) -> Bench:
    bench.fly_offboard(height_m=8.0)
    bench.stream(north_m, 0.0, -8.0, POSITION_ONLY)
    bench.until(lambda: abs(bench.truth[0] - north_m) < 0.5, 60.0)
    bench.repeated = None
    return bench


def test_return_climbs_flies_home_descends_waits_and_lands() -> None:
    bench = Bench(parameters={"RTL_RETURN_ALT": 15.0, "RTL_DESCEND_ALT": 6.0, "RTL_LAND_DELAY": 4.0})
    fly_away(bench, 30.0)
    assert bench.set_mode(RETURN) == [ACCEPTED, ACCEPTED]
    highest_m, fastest_m_s, waited_s = 0.0, 0.0, 0.0
    while bench.now_s < 200.0 and bench.last("EXTENDED_SYS_STATE").landed_state != ON_GROUND:
        bench.run(0.1)
        highest_m = max(highest_m, -bench.truth[2])
        fastest_m_s = max(fastest_m_s, math.hypot(*bench.velocity[:2]))
        if bench.truth[0] > 20.0 and bench.velocity[0] < -1.0:
            assert -bench.truth[2] > 13.0  # first up, then home
        waited_s += 0.1 if abs(bench.truth[2] + 6.0) < 1.0 and math.hypot(*bench.truth[:2]) < 1.5 else 0.0
    assert highest_m == pytest.approx(15.0, abs=0.7)
    assert fastest_m_s <= 5.1  # MPC_XY_CRUISE
    assert waited_s >= 4.0
    assert math.hypot(*bench.truth[:2]) < 1.0
    assert not bench.run(4.0).armed


def test_return_near_home_climbs_no_higher_than_the_cone() -> None:
    bench = fly_away(Bench(), 14.0)
    bench.set_mode(RETURN)
    highest_m = max(-bench.run(0.2).truth[2] for _ in range(100))
    assert highest_m == pytest.approx(14.0, abs=1.0)


def test_a_negative_rtl_land_delay_waits_over_home_for_ever() -> None:
    bench = fly_away(Bench(parameters={"RTL_LAND_DELAY": -1.0}), 12.0)
    bench.set_mode(RETURN)
    assert bench.run(60.0).truth == pytest.approx((0.0, 0.0, -10.0), abs=1.2)


def test_holding_in_measured_noise_moves_the_vehicle_as_measured() -> None:
    bench = Bench(noise_scale=1.0, count=4, seed=5, rates_hz={})  # nothing to say: faster
    bench.heartbeats = False
    bench.run(7.0)
    for autopilot in bench.fleet.autopilots:
        assert isinstance(autopilot, Autopilot)
        autopilot.take_off(None)
        autopilot.arm()
    bench.run(15.0)
    track = np.array([bench.run(0.2).fleet.bodies.position_m for _ in range(300)])
    spread_m = track.std(axis=0).mean(axis=0)
    assert (spread_m > (0.04, 0.08, 0.15)).all()
    assert (spread_m < (0.35, 0.6, 0.75)).all()


def test_the_estimate_is_off_by_the_scaled_noise() -> None:
    bench = Bench(noise_scale=1.0, count=40, rates_hz={})
    bench.run(0.1)
    assert bench.fleet._error.position_m.std(axis=0) == pytest.approx((0.09, 0.19, 0.41), rel=0.4)


def test_wind_from_the_side_is_held_against() -> None:
    bench = holding(wind_m_s=(0.0, 5.0, 0.0))
    bench.run(10.0)
    assert bench.run(5.0).velocity == pytest.approx((0.0, 0.0, 0.0), abs=0.1)
    assert abs(bench.last("ATTITUDE").roll) > 0.3  # leaning into it
    assert bench.last("ATTITUDE").roll < 0.0


def flown(seed: int) -> list[float]:
    bench = Bench(noise_scale=1.0, seed=seed).take_off(height_m=4.0)
    return [*bench.truth, *[m.x for m in bench.all("LOCAL_POSITION_NED")]]


def test_the_same_seed_flies_the_same_flight() -> None:
    assert flown(7) == flown(7)
    assert flown(7) != flown(8)


def test_vehicle_i_starts_at_row_i_over_c_and_column_i_modulo_c() -> None:
    bench = Bench(count=5, first=3, grid_columns=3, spacing_m=2.0)
    grid = [(row[0], row[1]) for row in bench.fleet.bodies.position_m.tolist()]
    assert grid == [(2.0, 0.0), (2.0, 2.0), (2.0, 4.0), (4.0, 0.0), (4.0, 2.0)]
    assert [autopilot.system_id for autopilot in bench.fleet.autopilots] == [4, 5, 6, 7, 8]


def test_the_land_mode_can_be_left_again() -> None:
    bench = holding()
    bench.set_mode(LAND)
    bench.run(3.0)
    assert bench.set_mode(HOLD) == [ACCEPTED, ACCEPTED]
    bench.run(3.0)
    height_m = bench.truth[2]
    assert bench.run(5.0).truth[2] == pytest.approx(height_m, abs=0.2)
