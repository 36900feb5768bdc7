"""MAVSDK's own calls against a fake ArduCopter over UDP, on the real clock, as against the real one."""

from __future__ import annotations

import contextlib
import json
from typing import TYPE_CHECKING

import pytest
from mavsdk.plugins.action import Action, ActionError
from mavsdk.plugins.offboard import Offboard, VelocityNedYaw
from mavsdk.plugins.param import Param, ParamError
from mavsdk.plugins.telemetry import FlightMode, LandedState, Telemetry

from tests.integration.test_sim_mavsdk import connected, running, wait_for
from tests.support.machine import free_ports

if TYPE_CHECKING:
    from pathlib import Path

RATE_HZ = 10.0


def test_mavsdk_flies_a_fake_arducopter_as_the_real_one(tmp_path: Path) -> None:
    port = free_ports()
    truth = tmp_path / "truth.jsonl"
    with contextlib.ExitStack() as stack:
        options = ["--autopilot", "ardupilot", "--quirk", "late-ready=off", "--param", "WPNAV_ACCEL=250"]
        stack.enter_context(running("--port-base", str(port), "--truth", str(truth), *options))
        system = stack.enter_context(connected(port))
        telemetry, action, offboard, param = (
            Telemetry(system),
            Action(system),
            Offboard(system),
            Param(system),
        )
        telemetry.set_rate_position_velocity_ned(RATE_HZ)
        telemetry.set_rate_position(RATE_HZ)
        telemetry.set_rate_battery(RATE_HZ)
        wait_for(lambda: telemetry.flight_mode() == FlightMode.STABILIZED, "mode")
        assert param.get_param_int("SYSID_MYGCS") == 255
        with pytest.raises(ParamError, match="WRONG_TYPE"):
            param.get_param_float("FS_GCS_ENABLE")

        action.set_takeoff_altitude(4.0)
        wait_for(lambda: arms(action), "arm")
        action.takeoff()
        wait_for(lambda: telemetry.flight_mode() == FlightMode.OFFBOARD, "GUIDED is shown as OFFBOARD")
        wait_for(lambda: telemetry.position().relative_altitude_m > 3.6, "takeoff")
        wait_for(lambda: telemetry.landed_state() == LandedState.IN_AIR, "landed state")

        offboard.set_velocity_ned(VelocityNedYaw(0.0, 3.0, 0.0, 90.0))
        offboard.start()
        assert offboard.is_active()
        wait_for(lambda: telemetry.position_velocity_ned().velocity.east_m_s > 2.7, "speed")

        action.hold()
        wait_for(lambda: telemetry.flight_mode() == FlightMode.HOLD, "BRAKE is shown as HOLD")
        wait_for(lambda: not offboard.is_active(), "offboard ends")
        wait_for(lambda: abs(telemetry.position_velocity_ned().velocity.east_m_s) < 0.3, "stop")
        action.land()
        wait_for(lambda: telemetry.flight_mode() == FlightMode.LAND, "land")
        wait_for(lambda: not telemetry.armed(), "disarm")
        wait_for(lambda: telemetry.landed_state() == LandedState.ON_GROUND, "landed")
        assert not telemetry.health_all_ok(), "MAVSDK 4.1 never calls an ArduPilot healthy"
        assert telemetry.battery().remaining_percent > 90

    flown = [json.loads(line)["vehicles"][0] for line in truth.read_text().splitlines()]
    assert {vehicle["mode"] for vehicle in flown} == {"STABILIZE", "GUIDED", "BRAKE", "LAND"}
    assert max(vehicle["east_m"] for vehicle in flown) > 2.0
    assert (flown[-1]["down_m"], flown[-1]["armed"], flown[-1]["landed"]) == (0.0, False, True)


def arms(action: Action) -> bool:
    """Whether it armed; too early is refused."""
    try:
        action.arm()
    except ActionError:
        return False
    return True
