"""Each habit of PX4's can be switched off, and only that one."""

from __future__ import annotations

import math
from typing import Any

import pytest

from gcs.sim.fleet import STEP_S
from gcs.sim.protocol.streams import RECORDED_HZ
from gcs.sim.vehicle.px4 import QuirkError, Quirks, quirk_names
from tests.support.sim_bench import (
    ACCEPTED,
    HOLD,
    LAND,
    OFFBOARD,
    POSITION,
    TEMPORARILY_REJECTED,
    VELOCITY_ONLY,
    Bench,
)

pytestmark = pytest.mark.soak


def without(quirk: str, **settings: Any) -> Bench:
    return Bench(quirks=Quirks().changed([(quirk, False)]), **settings)


def test_an_unknown_quirk_is_refused_with_those_there_are() -> None:
    with pytest.raises(QuirkError, match=r"telepathy: no such quirk; there are .*double-ack"):
        Quirks().changed([("telepathy", False)])
    assert len(quirk_names()) == 18


def test_without_own_origin_all_vehicles_count_from_the_fleets() -> None:
    bench = without("own-origin", count=2, noise_scale=0.0, spacing_m=5.0, grid_columns=2).run(6.0)
    east = {m.get_srcSystem(): m.y for m in bench.all("LOCAL_POSITION_NED")}
    assert east == pytest.approx({1: 0.0, 2: 5.0})


def test_without_late_ready_it_arms_at_once() -> None:
    assert without("late-ready").run(0.3).arm() == [ACCEPTED]


def test_without_double_ack_a_mode_change_has_one_answer() -> None:
    assert without("double-ack").ready().set_mode(HOLD) == [ACCEPTED]


def test_without_starved_offboard_flies_without_setpoints() -> None:
    bench = without("starved-offboard").ready()
    assert bench.set_mode(OFFBOARD) == [ACCEPTED, ACCEPTED]
    assert bench.arm() == [ACCEPTED]


def test_without_setpoint_loss_the_last_setpoint_is_flown_on() -> None:
    bench = without("setpoint-loss").fly_offboard()
    bench.repeated = None
    assert bench.run(4.0).mode == OFFBOARD


def test_without_resume_offboard_needs_a_command() -> None:
    bench = without("resume").fly_offboard()
    bench.repeated = None
    bench.run(3.0)
    bench.stream(0, 0, 0)
    assert bench.run(2.5).mode == POSITION
    assert bench.set_mode(OFFBOARD) == [ACCEPTED, ACCEPTED]
    assert bench.run(1.1).mode == OFFBOARD


def test_without_mode_reverts_it_stands_in_hold_after_landing() -> None:
    bench = without("mode-reverts").fly_offboard(height_m=3.0)
    bench.set_mode(LAND)
    bench.repeated = None
    bench.until(lambda: not bench.armed, 30.0)
    assert bench.run(1.1).mode == HOLD
    assert bench.arm() == [ACCEPTED]


def test_without_quiet_texts_they_come_unasked() -> None:
    bench = without("quiet-texts")
    bench.heartbeats = False
    bench.ready().arm()
    assert "Armed by external command" in bench.texts


def test_without_late_heartbeat_a_change_shows_at_once() -> None:
    bench = without("late-heartbeat").ready()
    bench.arm()
    assert bench.armed


def test_without_whole_velocity_the_axes_given_are_flown() -> None:
    bench = without("whole-velocity").fly_offboard()
    bench.stream(math.nan, 2.0, 0.0, VELOCITY_ONLY)
    assert bench.run(6.0).velocity[1] > 1.2


def test_without_early_takeoff_it_is_refused_while_disarmed() -> None:
    bench = without("early-takeoff").ready()
    assert bench.command(22, 0, 0, 0, math.nan, math.nan, math.nan, math.nan) == [TEMPORARILY_REJECTED]


def test_without_disarm_refused_it_falls() -> None:
    bench = without("disarm-refused").take_off()
    assert bench.command(400, 0) == [ACCEPTED]
    assert not bench.run(1.1).armed


def test_without_slow_clock_the_boot_clock_is_exact() -> None:
    bench = without("slow-clock", rates_hz=RECORDED_HZ, step_s=STEP_S).run(5.0)
    assert bench.last("ATTITUDE").time_boot_ms == pytest.approx(5000, abs=11)


def test_without_patient_offboard_two_setpoints_a_second_fail() -> None:
    bench = without("patient-offboard").fly_offboard()
    repeated, bench.repeated = bench.repeated, None
    for _ in range(4):
        bench.send(repeated)
        bench.run(0.5)
    assert "Failsafe activated" in bench.texts
