"""MAVSDK's own calls against `python -m gcs.sim` over UDP, on the real clock."""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action, ActionError
from mavsdk.plugins.offboard import Offboard, VelocityNedYaw
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import FlightMode, LandedState, Telemetry
from pymavlink.dialects.v20 import common

from tests.support.machine import Pauses, free_ports

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

LOCAL = "127.0.0.1"


@contextlib.contextmanager
def running(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A sim that has said it is ready; stopped at the end, and it must stop cleanly."""
    command = [sys.executable, "-m", "gcs.sim", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("sim: ")
            yield process
        finally:
            process.send_signal(signal.SIGTERM)
            _, errors = process.communicate(timeout=120)
    assert (process.returncode, errors) == (0, "")


@contextlib.contextmanager
def connected(port: int) -> Iterator[Any]:
    """The vehicle as MAVSDK sees it."""
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    try:
        mavsdk.add_any_connection(f"udpin://{LOCAL}:{port}")
        wait_for(mavsdk.get_systems, "connect")
        yield mavsdk.get_systems()[0]
    finally:
        mavsdk.destroy()


def wait_for(condition: Callable[[], Any], what: str, limit_s: float = 120.0) -> None:
    deadline_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline_s, f"{what}: not within {limit_s:g} s"
        time.sleep(0.02)


def test_mavsdk_flies_offboard_lands_and_reads_parameters(
    tmp_path: Path,
) -> None:
    port = free_ports()
    truth = tmp_path / "truth.jsonl"
    with contextlib.ExitStack() as stack:
        machine = stack.enter_context(Pauses())
        options = ["--quirk", "late-ready=off"]
        options += ["--param", "COM_OF_LOSS_T=5"]  # a pause of the machine is not the pilot's
        stack.enter_context(running("--port-base", str(port), "--truth", str(truth), *options))
        system = stack.enter_context(connected(port))
        telemetry, action, offboard, param = (
            Telemetry(system),
            Action(system),
            Offboard(system),
            Param(system),
        )
        wait_for(telemetry.health_all_ok, "health")

        assert param.get_param_float("MPC_XY_VEL_MAX") == 12.0
        param.set_param_int("COM_OBL_RC_ACT", 5)
        assert param.get_param_int("COM_OBL_RC_ACT") == 5
        listed = param.get_all_params()
        assert len(listed.int_params) + len(listed.float_params) == 905

        action.set_takeoff_altitude(3.0)
        wait_for(lambda: arms(action), "arm")
        action.takeoff()
        wait_for(lambda: telemetry.in_air() and telemetry.flight_mode() == FlightMode.HOLD, "takeoff")

        offboard.set_velocity_ned(VelocityNedYaw(0.0, 2.0, 0.0, 90.0))
        offboard.start()
        wait_for(lambda: telemetry.flight_mode() == FlightMode.OFFBOARD, "offboard")
        wait_for(lambda: telemetry.position_velocity_ned().velocity.east_m_s > 1.5, "speed")
        wait_for(lambda: abs(telemetry.attitude_euler().yaw_deg - 90.0) < 2.0, "yaw")

        action.hold()
        wait_for(lambda: telemetry.flight_mode() == FlightMode.HOLD, "hold")
        wait_for(lambda: abs(telemetry.position_velocity_ned().velocity.east_m_s) < 0.5, "stop")
        action.land()
        wait_for(lambda: not telemetry.armed(), "land")
        wait_for(lambda: telemetry.landed_state() == LandedState.ON_GROUND, "landed state")
        assert telemetry.battery().remaining_percent > 90

    lines = [json.loads(line) for line in truth.read_text().splitlines()]
    times = [line["time_s"] for line in lines]
    assert np.median(np.diff(times)) == pytest.approx(0.05, abs=0.01)
    # a long pause of the machine leaves a hole, after a short one the fleet catches up; a busy one has many
    assert (len(times) - 1) / machine.awake_s(times[0], times[-1]) > 10.0
    assert (len(times) - 1) / (times[-1] - times[0]) < 21.0
    assert abs(times[-1] - time.monotonic()) < 60.0
    flown = [line["vehicles"][0] for line in lines]
    assert {v["mode"] for v in flown} >= {"HOLD", "TAKEOFF", "OFFBOARD", "LAND"}
    assert max(v["east_m"] for v in flown) > 2.0
    assert (flown[-1]["down_m"], flown[-1]["armed"], flown[-1]["landed"]) == (0.0, False, True)


def arms(action: Action) -> bool:
    """Whether it armed; too early is refused, as by PX4."""
    try:
        action.arm()
    except ActionError:
        return False
    return True


def listen(port: int) -> socket.socket:
    ear = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    ear.bind((LOCAL, port))
    ear.settimeout(60.0)
    return ear


def system_in(datagram: bytes) -> int:
    assert datagram[0] == 0xFD
    return datagram[5]


def test_vehicles_have_separate_ports_that_do_not_mix() -> None:
    port = free_ports(4)
    with (
        listen(port + 2) as first,
        listen(port + 3) as second,
        running("--port-base", str(port), "--first", "2", "--count", "2"),
    ):
        assert {system_in(first.recv(2048)) for _ in range(20)} == {3}
        assert {system_in(second.recv(2048)) for _ in range(20)} == {4}


def test_like_px4_it_answers_the_first_sender_to_its_port() -> None:
    index = 203  # beyond 10: they all talk to 14549, and are told apart by speaking first to 14580 + i
    with listen(0) as ear, running("--first", str(index)):
        ear.sendto(
            bytes(common.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(common.MAVLink(None, 245, 190))),
            (LOCAL, 14580 + index),
        )
        datagram, sender = ear.recvfrom(2048)
        assert (system_in(datagram), sender[1]) == (index + 1, 14580 + index)


def test_a_taken_port_is_named_and_exits_with_one() -> None:
    with listen(14580 + 210):
        done = subprocess.run(
            [sys.executable, "-m", "gcs.sim", "--first", "210"],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert done.returncode == 1
    assert "14790" in done.stderr
    assert "--port-base" in done.stderr
    assert "Traceback" not in done.stderr
