"""`make sitl`, flown with the fake fleet and with stand-ins for the real programs: it cannot rot unseen."""

import json
import math
import os
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common

from gcs.model.frames import ShowFrame
from tests.sitl.sitl_programs import ARDUCOPTER, PX4, NotFoundError, find, px4_files
from tests.sitl.sitl_simulators import DELIVERED, ArduCopter, Pads, Px4Build, parameter_file
from tests.sitl.sitl_truth import FDM_PORTS_APART, GroundTruthRecorder
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, wait_until

REPOSITORY = Path(__file__).resolve().parents[2]
LONGEST_S = 1200.0


def flown(*options: str, given: Mapping[str, str] | None = None) -> tuple[int, dict[str, Any], str]:
    """Exit code, the JSON line if there is one, and everything that was printed."""
    command = [sys.executable, "-m", "tests.sitl.fly", *options]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), **(given or {})}
    done = subprocess.run(
        command,
        cwd=REPOSITORY,
        env=environment,
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
        check=False,
    )
    last = (done.stdout.splitlines() or [""])[-1]
    figures = json.loads(last) if last.startswith("{") else {}
    return done.returncode, figures, done.stdout + done.stderr


def program(file: Path, module: str) -> Path:
    """An executable that runs a stand-in."""
    file.parent.mkdir(parents=True)
    file.write_text(f'#!/bin/sh\nexec {sys.executable} -m {module} "$@"\n', encoding="ascii")
    file.chmod(0o755)
    return file


def px4_tree(folder: Path) -> Path:
    """A tree of PX4 that was built: start scripts, and the stand-in."""
    build = folder / "build/px4_sitl_default"
    program(build / "bin/px4", "tests.sitl.standin_px4")
    (build / "etc/init.d-posix").mkdir(parents=True)
    (build / "etc/init.d-posix/rcS").touch()
    return folder


def ports(given: dict[str, str]) -> list[str]:
    """Options with free ports for two to four vehicles; `given` gets them for stand-ins."""
    base = free_ports(20 + 4 * FDM_PORTS_APART)
    given |= {
        "STANDIN_PORT": str(base),
        "STANDIN_SIMULATOR_PORT": str(base + 10),
        "STANDIN_FDM_PORT": str(base + 20),
    }
    return [
        *("--port-base", str(base), "--simulator-port", str(base + 10), "--fdm-port", str(base + 20)),
        *("--quick", "--any-machine"),
    ]


@pytest.mark.soak
@pytest.mark.parametrize(
    ("autopilot", "phase"), [("px4", "uncontrolled"), ("ardupilot", "running"), ("mixed", "running")]
)
def test_fake_fleet_passes_the_sitl_program(tmp_path: Path, autopilot: str, phase: str) -> None:
    """After the stall PX4 has changed to HOLD by itself; ArduCopter has hovered, and is flown on."""
    options = ["--fake", "--vehicles", "4", "--autopilot", autopilot, "--keep", str(tmp_path)]
    code, figures, printed = flown(*options, *ports({}))
    assert code == 0, printed
    assert figures["verdict"] == "kept"
    assert (figures["landed"], figures["lost"]) == (3, ["d4"])
    assert figures["separation_violations"] == figures["obstacle_penetrations"] == 0
    assert figures["phase_after_stall"] == phase
    assert figures["commands_refused"] == []


@pytest.mark.soak
@pytest.mark.parametrize("transport", ["mavsdk", "native"])
def test_a_tree_that_looks_like_px4s_passes(tmp_path: Path, transport: str) -> None:
    """A stand-in that makes `log`, and has its time where v1.16 has it; with either transport."""
    given: dict[str, str] = {}
    options = ["--px4", str(px4_tree(tmp_path / "PX4-Autopilot")), "--transport", transport]
    code, figures, printed = flown(*options, *ports(given), given=given)
    assert code == 0, printed
    assert (figures["autopilot"], figures["landed"], figures["lost"]) == ("PX4", 3, ["d4"])
    assert 0.0 < figures["simulated_per_wall_s"] < 1.1


@pytest.mark.soak
@pytest.mark.parametrize(
    ("version", "story", "count", "landed"), [("4.0", "short", 2, 2), ("4.7", "whole", 4, 3)]
)
def test_a_tree_that_looks_like_ardupilots_passes(
    tmp_path: Path, version: str, story: str, count: int, landed: int
) -> None:
    """A stand-in that prints at its start, by the options of that version; its time is in TIMESYNC."""
    given = {"STANDIN_VERSION": version}
    program(tmp_path / "ardupilot/build/sitl/bin/arducopter", "tests.sitl.standin_arducopter")
    options = ["--arducopter", str(tmp_path / "ardupilot"), "--story", story, "--vehicles", str(count)]
    code, figures, printed = flown(*options, *ports(given), given=given)
    assert code == 0, printed
    assert (figures["autopilot"], figures["landed"]) == ("ArduCopter", landed)
    assert 0.0 < figures["simulated_per_wall_s"] < 1.1


@pytest.mark.soak
def test_the_long_story_names_what_is_not_flown(tmp_path: Path) -> None:
    """Everything that the fake fleet can do, over six sorties."""
    options = ["--fake", "--vehicles", "6", "--story", "long", "--keep", str(tmp_path)]
    code, figures, printed = flown(*options, *ports({}))
    assert code == 0, printed
    assert figures["not_flown"] == {}
    laws = {"law_slots", "law_article", "law_neighbours"}
    faults = {"stalls", "gps_lost", "battery_low", "estimator_reset"}
    assert {"drawn", *laws, *faults} <= set(figures["flown"])
    assert (figures["landed"], figures["lost"]) == (6, [])


@pytest.mark.soak
def test_a_refused_start_is_the_verdict_in_words(tmp_path: Path) -> None:
    """Pads too near, with a stand-in for PX4: exit 1, and the refusal's own text."""
    given: dict[str, str] = {}
    tree = px4_tree(tmp_path / "PX4-Autopilot")
    options = ["--px4", str(tree), "--vehicles", "2", "--spacing", "1.5", "--keep", str(tmp_path / "kept")]
    code, figures, printed = flown(*options, *ports(given), given=given)
    assert code == 1, printed
    assert figures["verdict"] == "broken"
    assert any("the start was refused" in each and "m farther apart" in each for each in figures["broken"])
    assert figures["commands_refused"][0].startswith("start: ")
    assert "the start was refused" in printed.splitlines()[0], "also on the screen"
    assert 0.0 < figures["simulated_per_wall_s"] < 1.1, "v1.16 fills another clock"
    working = tmp_path / "kept/px4build-0"
    assert (working / "log").is_dir(), "PX4's own"
    assert "instance: 0" in (tmp_path / "kept/px4build-0.out").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("", "--vehicles 6"),
        ("PX4=/a/build", '--px4 "/a/build" --vehicles 6'),
        ("PX4_IMAGE=px4io/px4-sitl", '--image "px4io/px4-sitl" --vehicles 6'),
        ("ARDUPILOT=/a/arducopter TRANSPORT=native", '--arducopter "/a/arducopter" --transport native'),
        ("AUTOPILOT=ardupilot", "--autopilot ardupilot --vehicles 6"),
        ("FAKE=1", "--fake --vehicles 6"),
        ("FAKE=1 AUTOPILOT=mixed SEED=3", "--fake --autopilot mixed --seed 3"),
        ("FAKE=1 VERSION=1.16,4.5 STORY=long", "--fake --version 1.16,4.5 --story long"),
        ("FAKE=1 STATIONS=2", "--fake --stations 2"),
    ],
)
@pytest.mark.computes
def test_make_passes_the_simulator_on(given: str, expected: str) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    command = ["make", "--dry-run", "--no-print-directory", "sitl", *given.split(), "VEHICLES=6"]
    done = subprocess.run(
        command, cwd=REPOSITORY, env=environment, capture_output=True, text=True, check=True
    )
    assert expected in " ".join(done.stdout.split())


@pytest.mark.soak
@pytest.mark.computes
def test_without_a_program_it_says_what_to_get() -> None:
    empty = {"PX4": "", "ARDUPILOT": "", "PATH": "/nowhere", "HOME": "/nowhere"}
    code, _, printed = flown(given=empty)
    assert code == 2
    for words in ("make px4_sitl_default", "PX4_BUILD", "PATH", "~/PX4-Autopilot", "waf copter", "FAKE=1"):
        assert words in printed


@pytest.mark.soak
@pytest.mark.computes
def test_a_folder_without_px4_is_named(tmp_path: Path) -> None:
    code, _, printed = flown("--px4", str(tmp_path))
    assert code == 2
    assert f"Looked in: {tmp_path}" in printed


@pytest.mark.computes
def test_a_program_is_found_in_every_folder_above_it(tmp_path: Path) -> None:
    tree = px4_tree(tmp_path / "PX4-Autopilot")
    build = tree / "build/px4_sitl_default"
    for given in (tree, build, build / "bin", build / "bin/px4"):
        assert find(PX4, str(given)) == build / "bin/px4"
    assert px4_files(build / "bin/px4") == build / "etc"
    with pytest.raises(NotFoundError, match="waf copter"):
        find(ARDUCOPTER, str(tree))


@pytest.mark.computes
def test_a_program_is_found_by_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tree = px4_tree(tmp_path / "PX4-Autopilot")
    monkeypatch.setenv("PX4_DIR", str(tree))
    assert find(PX4) == tree / "build/px4_sitl_default/bin/px4"


@pytest.mark.soak
def test_a_simulator_that_ends_at_once_is_named(tmp_path: Path) -> None:
    """As PX4 does where a file stands in the place of its folder."""
    given: dict[str, str] = {}
    kept = tmp_path / "kept"
    (kept / "px4build-1").mkdir(parents=True)
    (kept / "px4build-1/log").touch()
    tree = px4_tree(tmp_path / "PX4-Autopilot")
    options = ["--px4", str(tree), "--vehicles", "2", "--keep", str(kept)]
    code, _, printed = flown(*options, *ports(given), given=given)
    assert code == 2
    assert "instance 1 ended with exit code 255: ERROR [px4] Failed to create directory: log" in printed


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
    file = tree / "build/sitl/bin/arducopter"
    file.parent.mkdir(parents=True)
    file.write_text(PROGRAM.format(options=options), encoding="ascii")
    file.chmod(0o755)
    fleet = ArduCopter(str(tree), Pads(FRAME, 2, 4.0), tree / "run", port=15000, simulator_port=16000)
    fleet.start()
    try:
        files = [tree / f"run/arducopter-{index}/words" for index in range(2)]
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
        for index in range(2):
            sender.sendto(b"Init ArduCopter V4.5.5\r\n\r\nFree RAM: 131072\r\n", ("127.0.0.1", base + index))
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


@pytest.mark.computes
def test_a_vehicle_between_two_processes_is_not_in_the_air() -> None:
    """Killed at 20 m, and started again on its pad 1.5 s later: nothing flew in between."""
    base = free_ports(2)
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    encoder = common.MAVLink(None)
    with sender, GroundTruthRecorder(base, 1) as truth:
        for height_m in (0.0, 20.0, 20.0, None, 0.0, 0.0):
            if height_m is None:
                time.sleep(1.5)
                continue
            where = round(FRAME.latitude_deg * 1e7), round(FRAME.longitude_deg * 1e7)
            state = encoder.hil_state_quaternion_encode(
                0, [1, 0, 0, 0], 0, 0, 0, *where, round(1e3 * (488.0 + height_m)), *[0] * 8
            )
            sender.sendto(state.pack(encoder), ("127.0.0.1", base))
            time.sleep(0.1)
    flown_by = truth.truth(FRAME)
    in_air_s = 0.02 * float(flown_by.airborne.sum())
    assert in_air_s < 1.3, "until a second after its last message"
    assert flown_by.landed_at_end.tolist() == [True]


@pytest.mark.computes
def test_px4_gets_parameters_of_its_simulation_as_integers(tmp_path: Path) -> None:
    base = free_ports(1)
    fleet = Px4Build(str(px4_tree(tmp_path)), Pads(FRAME, 1, 5.0), tmp_path)
    instance = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with instance, GroundTruthRecorder(base, 1) as link:
        with pytest.raises(OSError, match="instance 0 has sent nothing"):
            fleet.inject("gps-lost", 0, link)
        instance.sendto(b"\0", ("127.0.0.1", base))
        wait_until("received", SOON_S, lambda: _sets(fleet, link))
        instance.settimeout(SOON_S)
        (message,) = common.MAVLink(None).parse_buffer(instance.recv(300))
    assert (message.param_id, message.target_system) == ("SIM_GPS_USED", 1)
    assert struct.pack("<f", message.param_value) == struct.pack("<i", 0)
    assert message.param_type == common.MAV_PARAM_TYPE_INT32


def _sets(fleet: Px4Build, link: GroundTruthRecorder) -> bool:
    try:
        fleet.inject("gps-lost", 0, link)
    except OSError:
        return False
    return True


@pytest.mark.soak
def test_the_how_tos_line_starts_a_vehicle(tmp_path: Path) -> None:
    """The line by hand, as it is written, with the stand-in in the place of ArduPilot's tree."""
    document = (REPOSITORY / "docs/how-to/ardupilot.md").read_text(encoding="utf-8")
    line = document[document.index("    mkdir -p d1") : document.index("`own.parm` has two lines")]
    tree = tmp_path / "ardupilot"
    program(tree / "build/sitl/bin/arducopter", "tests.sitl.standin_arducopter")
    (tree / DELIVERED).parent.mkdir(parents=True)
    (tree / DELIVERED).write_text(parameter_file(0, calibrated=True), encoding="ascii")
    (tmp_path / "d1").mkdir()
    (tmp_path / "d1/own.parm").write_text("SYSID_THISMAV 1\nFS_THR_ENABLE 0\n", encoding="ascii")
    port = free_ports()
    line = line.replace("14540", str(port)).replace("~/ardupilot/build", "exec ~/ardupilot/build")
    given = os.environ | {"PYTHONPATH": str(REPOSITORY), "HOME": str(tmp_path)}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", port))
        station.settimeout(SOON_S)
        vehicle = subprocess.Popen(["/bin/sh", "-c", line], cwd=tmp_path, env=given)
        try:
            decoder, seen = common.MAVLink(None), list[str]()
            decoder.robust_parsing = True
            while "HEARTBEAT" not in seen:
                seen += [message.get_type() for message in decoder.parse_buffer(station.recv(2048)) or ()]
        finally:
            vehicle.kill()
            vehicle.wait()
    assert "BAD_DATA" in seen, "the text of its start"
