"""`make sitl`, flown with the fake fleet: the program that judges real PX4 flights cannot rot unseen."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.machine import free_ports

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.mark.soak
def test_fake_fleet_passes_the_sitl_program(tmp_path: Path) -> None:
    base = free_ports(20)
    command = [sys.executable, "-m", "tests.sitl.fly", "--fake", "--quick", "--vehicles", "4"]
    command += ["--port-base", str(base), "--simulator-port", str(base + 10), "--keep", str(tmp_path)]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads(done.stdout.splitlines()[-1])
    assert figures["verdict"] == "kept"
    assert (figures["landed"], figures["lost"]) == (3, ["d4"])
    assert figures["separation_violations"] == figures["obstacle_penetrations"] == 0
    assert figures["phase_after_stall"] == "uncontrolled"
    assert figures["commands_refused"] == []


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("PX4=/a/build", '--px4 "/a/build"'),
        ("PX4_IMAGE=px4io/px4-sitl", '--image "px4io/px4-sitl"'),
        ("FAKE=1", "--fake"),
    ],
)
@pytest.mark.computes
def test_make_passes_the_simulator_on(given: str, expected: str) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    command = ["make", "--dry-run", "--no-print-directory", "sitl", given, "VEHICLES=6"]
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
