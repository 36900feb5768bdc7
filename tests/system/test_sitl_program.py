"""`make sitl`, flown with the fake fleet: the program that judges real PX4 flights cannot rot unseen."""

import json
import math
import os
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common

from gcs.model.frames import ShowFrame
from tests.sitl.sitl_simulators import DELIVERED, ArduCopter, Pads
from tests.sitl.sitl_truth import FDM_PORTS_APART, GroundTruthRecorder
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, wait_until

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.mark.soak
@pytest.mark.parametrize(
    ("autopilot", "phase"), [("px4", "uncontrolled"), ("ardupilot", "running"), ("mixed", "running")]
)
def test_fake_fleet_passes_the_sitl_program(tmp_path: Path, autopilot: str, phase: str) -> None:
    """After the stall PX4 has changed to HOLD by itself; ArduCopter has hovered, and is flown on."""
    base = free_ports(20)
    command = [sys.executable, "-m", "tests.sitl.fly", "--fake", "--quick", "--vehicles", "4"]
    command += ["--autopilot", autopilot]
    command += ["--port-base", str(base), "--simulator-port", str(base + 10), "--keep", str(tmp_path)]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads(done.stdout.splitlines()[-1])
    assert figures["verdict"] == "kept"
    assert (figures["landed"], figures["lost"]) == (3, ["d4"])
    assert figures["separation_violations"] == figures["obstacle_penetrations"] == 0
    assert figures["phase_after_stall"] == phase
    assert figures["commands_refused"] == []


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("PX4=/a/build", '--px4 "/a/build"'),
        ("PX4_IMAGE=px4io/px4-sitl", '--image "px4io/px4-sitl"'),
        ("ARDUPILOT=/a/arducopter", '--arducopter "/a/arducopter"'),
        ("FAKE=1", "--fake "),
        ("FAKE=1 AUTOPILOT=mixed", "--fake --autopilot mixed"),
    ],
)
@pytest.mark.computes
def test_make_passes_the_simulator_on(given: str, expected: str) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    command = ["make", "--dry-run", "--no-print-directory", "sitl", *given.split(), "VEHICLES=6"]
    done = subprocess.run(
        command, cwd=REPOSITORY, env=environment, capture_output=True, text=True, check=True
    )
    assert f"tests.sitl.fly {expected} --vehicles 6" in done.stdout


@pytest.mark.computes
def test_a_folder_without_px4_is_named(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tests.sitl.fly", "--px4", str(tmp_path)]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert str(tmp_path / "bin/px4") in done.stderr


FRAME = ShowFrame(47.397742, 8.545594, 488.0)

PROGRAM = """#!/bin/sh
if [ "$1" = --help ]; then echo "{options}"; exit 1; fi
for word in "$@"; do echo "$word"; done > words.new
mv words.new words
exec sleep 60
"""
"""Stands in for arducopter: it writes down how it was started."""


def started(tree: Path, options: str) -> list[dict[str, str]]:
    """How each of two instances of a program with these options is started: its words, by option."""
    program = tree / "build/sitl/bin/arducopter"
    program.parent.mkdir(parents=True)
    program.write_text(PROGRAM.format(options=options), encoding="ascii")
    program.chmod(0o755)
    fleet = ArduCopter(program, Pads(FRAME, 2, 4.0), tree / "run", port=15000, truth_port=16000)
    fleet.start()
    try:
        files = [tree / f"run/ardupilot-{index}/words" for index in range(2)]
        wait_until("started", SOON_S, lambda: all(file.exists() for file in files))
    finally:
        fleet.close()
    words = [file.read_text(encoding="utf-8").split("\n") for file in files]
    return [dict(zip(each, [*each[1:], ""], strict=True)) for each in words]


@pytest.mark.computes
def test_each_arducopter_has_its_place_ports_and_parameters(tmp_path: Path) -> None:
    first, second = started(tmp_path, "--uartA device --fg ADDRESS --disable-fgview")
    assert (first["--instance"], second["--instance"]) == ("0", "1")
    assert (first["--uartA"], second["--uartA"]) == ("udpclient:127.0.0.1:15000", "udpclient:127.0.0.1:15001")
    assert second["--uartC"] == "udpclient:127.0.0.1:16001"
    assert first["--home"] == "47.397742000,8.545594000,488.000,0"
    assert second["--home"].startswith("47.3977420")
    assert "--enable-fgview" not in first
    own = Path(second["--defaults"]).read_text(encoding="ascii")
    assert "SYSID_THISMAV 2\n" in own
    assert "FS_THR_ENABLE 0\n" in own
    assert "FRAME_CLASS 1\n" in own


@pytest.mark.computes
def test_newer_arducopter_is_started_with_its_own_options(tmp_path: Path) -> None:
    (tmp_path / DELIVERED).parent.mkdir(parents=True)
    (tmp_path / DELIVERED).write_text("FRAME_CLASS 1\n", encoding="ascii")
    _, second = started(tmp_path, "--serial0 device --fg ADDRESS --enable-fgview")
    assert second["--serial0"] == "udpclient:127.0.0.1:15001"
    assert second["--serial1"] == "udpclient:127.0.0.1:16001"
    assert "--enable-fgview" in second
    delivered, own = map(Path, second["--defaults"].split(","))
    assert delivered == tmp_path / DELIVERED
    assert "MAV_SYSID 2\n" in own.read_text(encoding="ascii")
    assert "FRAME_CLASS" not in own.read_text(encoding="ascii"), "that of its own tree"


@pytest.mark.computes
def test_true_states_of_arducopter_are_flightgears_packets() -> None:
    """As SITL sends them: big-endian, radians, and the time apart from them."""
    base = free_ports(2 + FDM_PORTS_APART + 1)
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with sender, GroundTruthRecorder(base, 2, fdm_port=base + 2) as truth:
        for step in range(6):
            for index in range(2):
                latitude_rad, longitude_rad = (
                    math.radians(FRAME.latitude_deg),
                    math.radians(FRAME.longitude_deg),
                )
                packet = struct.pack(">II3d", 24, 0, longitude_rad, latitude_rad, 488.0 + 2.0 * step * index)
                sender.sendto(packet + bytes(376), ("127.0.0.1", base + 2 + FDM_PORTS_APART * index))
                clock = common.MAVLink_timesync_message(0, (7 + step) * 10**8 + index)
                sender.sendto(
                    clock.pack(common.MAVLink(None, srcSystem=1 + index)), ("127.0.0.1", base + index)
                )
            time.sleep(0.1)
    flown = truth.truth(FRAME)
    assert abs(flown.position_m[:, :, :2]).max() < 0.01
    assert flown.position_m[:, 0, 2] == pytest.approx(0.0)
    assert (-flown.position_m[-1, 1, 2]) > 5.0
    assert flown.airborne[-1].tolist() == [False, True]
    share = truth.simulated_per_wall_s()
    assert share is not None
    assert 0.0 < share <= 1.1
