"""What the fake fleet costs: percent of one core of its process, flying on setpoints.

    python -m tests.bench.fake_fleet [VEHICLES ...]

Telemetry 10 Hz, 20 setpoints a second and vehicle, each in a datagram of its own; once with a port for each
vehicle, once with a shared port for each namespace. What is told is CPU time per second flown, by the
positions that came: a machine with other work makes the fleet drop time, which `keeps up` tells, and shows
up little in the figure. Beside it the setpoints that each vehicle received per second flown: 20 where station
and fleet keep up.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from itertools import cycle, islice
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import common

LOCAL, PORT, NAMESPACE = "127.0.0.1", 21000, 250
MEASURED_S, TICK_S, TELEMETRY_HZ = 10.0, 0.05, 10.0
ARM, SET_MODE, OFFBOARD = 400, 176, 6
CLIMB_M_S = -1.0


class Station:
    """Speaks to a fleet and counts what comes back."""

    def __init__(self, count: int, shared: bool) -> None:
        self.positions = 0
        self._count = count
        ports = range(-(-count // NAMESPACE) if shared else count)
        self._sockets = [self._open(PORT + k) for k in ports]
        self._peers: dict[int, Any] = {}
        self._of = [i // NAMESPACE if shared else i for i in range(count)]
        self._voice = common.MAVLink(None, 245, 190)

    @staticmethod
    def _open(port: int) -> socket.socket:
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        opened.bind((LOCAL, port))
        opened.setblocking(False)
        return opened

    def close(self) -> None:
        for opened in self._sockets:
            opened.close()

    def frames(self, make: Any) -> list[bytes]:
        """One frame for each vehicle; make takes its system id."""
        by_id = [bytes(make(k + 1).pack(self._voice)) for k in range(min(self._count, NAMESPACE))]
        return list(islice(cycle(by_id), self._count))

    def receive(self) -> None:
        for k, opened in enumerate(self._sockets):
            try:
                while True:
                    data, self._peers[k] = opened.recvfrom(65536)
                    self.positions += data.count(b"\x01\x21\x00\x00")  # component 1, GLOBAL_POSITION_INT
            except BlockingIOError:
                pass

    def say(self, frames: list[bytes]) -> None:
        for k, frame in zip(self._of, frames, strict=True):
            if k in self._peers:
                self._sockets[k].sendto(frame, self._peers[k])

    def tick(self, setpoints: list[bytes], duration_s: float) -> int:
        """Send them every TICK_S; how often."""
        ticks = 0
        next_s = time.monotonic()
        until_s = next_s + duration_s
        while next_s < until_s:
            self.say(setpoints)
            self.receive()
            next_s = max(next_s + TICK_S, time.monotonic() - TICK_S)  # after a stall on from here
            ticks += 1
            time.sleep(max(next_s - time.monotonic(), 0.0))
        return ticks


def frames_of(number: int, *values: float) -> Any:
    padded = [*values, *[0.0] * (7 - len(values))]
    return lambda system: common.MAVLink_command_long_message(system, 1, number, 0, *padded)


def climb(system: int) -> Any:
    at = (0.0, 0.0, 0.0)
    return common.MAVLink_set_position_target_local_ned_message(
        0, system, 1, 1, 0xDC7, *at, 0.0, 0.0, CLIMB_M_S, *at, 0.0, 0.0
    )


def busy_s(pid: int) -> float:
    """CPU time of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure(count: int, shared: bool) -> str:
    command = [sys.executable, "-m", "gcs.sim", "--count", str(count), "--port-base", str(PORT)]
    command += ["--telemetry-hz", str(TELEMETRY_HZ), "--battery", "600", "--param", "COM_OF_LOSS_T=10"]
    station = Station(count, shared)
    with subprocess.Popen(command + ["--shared-port"] * shared, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        setpoints = station.frames(climb)
        station.tick([], 0.0)
        for _ in range(160):  # until all are ready
            station.receive()
            time.sleep(TICK_S)
        station.tick(setpoints, 0.5)
        for frames in (frames_of(SET_MODE, 1, OFFBOARD), frames_of(ARM, 1)):
            station.say(station.frames(frames))
            station.tick(setpoints, 1.0)
        station.tick(setpoints, 2.0)
        began_s, before_s, before = time.monotonic(), busy_s(process.pid), station.positions
        ticks = station.tick(setpoints, MEASURED_S)
        passed_s, used_s = time.monotonic() - began_s, busy_s(process.pid) - before_s
        flown_s = (station.positions - before) / (count * TELEMETRY_HZ)
        process.terminate()
    station.close()
    ports = "shared" if shared else "own"
    return (
        f"{count:5d} vehicles, {ports:6s} ports: {100 * used_s / flown_s:5.1f} % of a core, "
        f"{ticks / flown_s:4.1f} setpoints/s, keeps up {100 * flown_s / passed_s:3.0f} %"
    )


def main() -> None:
    for count in [int(text) for text in sys.argv[1:]] or [64, 250, 300, 1000]:
        for shared in (False, True):
            print(measure(count, shared), flush=True)


if __name__ == "__main__":
    main()
