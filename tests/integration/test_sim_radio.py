"""`python -m gcs.sim` behind a radio: shared ports, namespaces, faults by order; on the real clock."""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import common

from tests.support.machine import free_ports

if TYPE_CHECKING:
    from collections.abc import Iterator

LOCAL = "127.0.0.1"
LIMIT_S = 120.0


@contextlib.contextmanager
def running(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "gcs.sim", *arguments]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("sim: ")
            yield process
        finally:
            process.send_signal(signal.SIGTERM)
            _, errors = process.communicate(timeout=LIMIT_S)
    assert (process.returncode, errors) == (0, "")


@contextlib.contextmanager
def ear(port: int) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as open_socket:
        open_socket.bind((LOCAL, port))
        open_socket.settimeout(LIMIT_S)
        yield open_socket


def systems_in(datagram: bytes) -> set[int]:
    """The senders of the frames that lie end to end in it."""
    systems, start = set(), 0
    while start < len(datagram):
        assert datagram[start] == 0xFD
        systems.add(datagram[start + 5])
        start += 12 + datagram[start + 1]
    return systems


def received(ear_socket: socket.socket, datagrams: int) -> set[int]:
    return set().union(*(systems_in(ear_socket.recv(65536)) for _ in range(datagrams)))


def arm_disarm(target: int) -> bytes:
    message = common.MAVLink_command_long_message(target, 1, 400, 0, 0, 0, 0, 0, 0, 0, 0)
    return bytes(message.pack(common.MAVLink(None, 245, 190)))


def answers(ear_socket: socket.socket, expected: set[int]) -> set[int]:
    """Who acknowledges, until those expected have, and a moment longer."""
    found: set[int] = set()
    voice = common.MAVLink(None)
    until_s = time.monotonic() + LIMIT_S
    while time.monotonic() < until_s:
        datagram = ear_socket.recv(65536)
        voice.robust_parsing = True
        for message in voice.parse_buffer(bytearray(datagram)) or []:
            if message.get_type() == "COMMAND_ACK":
                found.add(message.get_srcSystem())
        if found >= expected and until_s - time.monotonic() > 0.3:
            until_s = time.monotonic() + 0.3
    return found


def test_a_mixed_fleet_shares_a_port_and_its_faults() -> None:
    port = free_ports()
    options = ["--autopilot", "mixed", "--shared-port", "--count", "4", "--faults-from", "-"]
    with ear(port) as station, running(*options, "--port-base", str(port)) as sim:
        _, radio = station.recvfrom(65536)
        station.sendto(arm_disarm(0), radio)
        assert answers(station, {1, 2, 3, 4}) == {1, 2, 3, 4}
        station.sendto(arm_disarm(2), radio)
        assert answers(station, {2}) == {2}
        assert sim.stdin is not None
        assert sim.stdout is not None
        sim.stdin.write(json.dumps({"vehicles": [2, 3], "fault": "silence"}) + "\n")
        sim.stdin.flush()
        assert json.loads(sim.stdout.readline())["ok"]
        station.sendto(arm_disarm(0), radio)
        assert answers(station, {1, 4}) == {1, 4}


def test_vehicles_on_a_shared_port_share_datagrams_by_target() -> None:
    port = free_ports()
    with ear(port) as station, running("--shared-port", "--count", "20", "--port-base", str(port)):
        first, radio = station.recvfrom(65536)
        assert received(station, 100) | systems_in(first) == set(range(1, 21))
        station.sendto(arm_disarm(7), radio)
        assert answers(station, {7}) == {7}
        station.sendto(arm_disarm(0), radio)
        assert answers(station, set(range(1, 21))) == set(range(1, 21))


def test_each_namespace_has_a_port_and_ids_from_one() -> None:
    port = free_ports(3)
    arguments = ["--shared-port", "--count", "7", "--namespace-size", "3", "--port-base", str(port)]
    with ear(port) as one, ear(port + 1) as two, ear(port + 2) as three, running(*arguments):
        assert [received(each, 60) for each in (one, two, three)] == [{1, 2, 3}, {1, 2, 3}, {1}]


def ask(control: int, command: Any) -> dict[str, Any]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as operator:
        operator.settimeout(LIMIT_S)
        operator.sendto(
            (command if isinstance(command, str) else json.dumps(command)).encode(), (LOCAL, control)
        )
        return dict(json.loads(operator.recv(65536)))


def test_control_port_silences_jams_and_refuses_unknown_faults() -> None:
    port = free_ports(2)
    arguments = ["--shared-port", "--count", "3", "--port-base", str(port), "--control", str(port + 1)]
    with ear(port) as station, running(*arguments):
        assert received(station, 60) == {1, 2, 3}
        assert ask(port + 1, {"vehicle": 2, "fault": "silence"}) == {
            "ok": True,
            "fault": "silence",
            "vehicles": [2],
        }
        assert "number from 0 to 1" in ask(port + 1, {"vehicle": 1, "fault": "loss", "share": 7})["error"]
        assert "not JSON" in ask(port + 1, "\x00garbage")["error"]
        drain(station)
        assert received(station, 60) == {1, 3}
        assert ask(port + 1, {"vehicles": "all", "fault": "none"})["ok"]
        assert ask(port + 1, {"vehicle": 3, "fault": "jam", "rate_hz": 500})["ok"]
        drain(station)
        sound, garbage = 0, 0
        for _ in range(200):
            try:
                sound += 2 in systems_in(station.recv(65536))
            except (AssertionError, IndexError):
                garbage += 1
        assert sound > 20
        assert garbage > 20


def drain(ear_socket: socket.socket) -> None:
    """Receive what is still under way."""
    time.sleep(0.3)
    ear_socket.setblocking(False)
    with contextlib.suppress(BlockingIOError):
        while True:
            ear_socket.recv(65536)
    ear_socket.settimeout(LIMIT_S)


def test_commands_on_standard_input_and_its_end_is_harmless() -> None:
    port = free_ports()
    with ear(port) as station, running("--faults-from", "-", "--port-base", str(port)) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write('{"vehicle": 1, "fault": "battery", "remaining": 0.5}\n{"vehicle": 2}\n')
        process.stdin.flush()
        assert json.loads(process.stdout.readline())["ok"]
        assert "fault must be one of" in json.loads(process.stdout.readline())["error"]
        process.stdin.close()
        assert received(station, 20) == {1}
        process.stdin = None
