"""The fleet that is flown, and what is measured of whoever flies it."""

import contextlib
import json
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import nan

import numpy as np

from gcs.mavlink.kernels import Whole

FIRST_PORT = 15400
EACH = 250
WARM_UP_S, MEASURED_S = 6.0, 12.0
MEETING_S = 30.0
"""Whoever has not met its vehicles by then cannot."""


class CannotError(Exception):
    """Somebody is not up to so many vehicles; the text says how far it came."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Of one run. What could not be measured is not a number."""

    core_percent: float
    resident_mb: float
    per_s: float  # setpoints that left
    passed_on_p99_ms: float = nan  # from telemetry's arrival until a setpoint made with it has left
    tick_p99_ms: float = nan
    late_p99_ms: float = nan
    lost_in_percent: float = nan  # of the vehicles' frames: gaps in their numbers
    lost_out_percent: float = nan  # of the setpoints that left: not received


@dataclass(slots=True)
class Fleet:
    """Light vehicles in a process of their own; what they told is here when it has ended."""

    process: subprocess.Popen[str]
    setpoints: int = 0  # received, in all
    first_beat_s: list[list[float]] = field(default_factory=list)  # of each namespace, on the monotonic clock
    answered_p99_ms: float = nan  # from sending a position until a setpoint came that returns its stamp

    def restart(self) -> None:
        """Forget what was measured before."""
        self.process.send_signal(signal.SIGUSR1)

    def end(self) -> None:
        """Let it tell what it saw, and end."""
        if self.process.poll() is not None:
            return
        self.process.terminate()
        stated = json.loads(self.process.communicate(timeout=30)[0])
        self.setpoints, self.first_beat_s = stated["setpoints"], stated["first_beat_s"]
        self.answered_p99_ms = nan if stated["answered_p99_ms"] is None else stated["answered_p99_ms"]

    def connecting_s(self, met_s: list[tuple[int, int, float]]) -> float:
        """The longest time from a first heartbeat until its vehicle was met: (namespace, system id, when)."""
        return max(when_s - self.first_beat_s[index][system_id - 1] for index, system_id, when_s in met_s)


def radius_m(count: int) -> float:
    """Of a sphere on which so many have room."""
    return float(max(15.0, 1.6 * count**0.5))


def namespaces(count: int) -> int:
    """Ports that so many vehicles need."""
    return max(1, count // EACH)


@contextlib.contextmanager
def flying(count: int, *options: str) -> Iterator[Fleet]:
    """Vehicles on their sphere, until the block ends."""
    wide_m = radius_m(count)
    shape = [FIRST_PORT, namespaces(count), min(EACH, count), wide_m, wide_m + 10.0]
    command = [sys.executable, "-m", "tests.bench.link_traffic", *map(str, shape), *options]
    fleet = Fleet(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
    try:
        yield fleet
    finally:
        fleet.end()


class Window:
    """The part of a run that is measured: behind the warm-up, for whoever loops for himself."""

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self._start_s = time.monotonic()
        self._marks: list[tuple[float, float, int]] = []  # wall and processor time, setpoints

    def goes_on(self, sent: int) -> bool:
        """Whether to fly on, with so many setpoints sent in all."""
        now_s = time.monotonic()
        until_s = self._marks[-1][0] + MEASURED_S if self._marks else self._start_s + WARM_UP_S
        if now_s < until_s:
            return True
        if not self._marks:
            self._fleet.restart()
        self._marks.append((now_s, time.process_time(), sent))
        return len(self._marks) < 2

    def cost(self) -> Cost:
        """When it does not go on. Ends the fleet."""
        (began_s, began_cpu_s, before), (ended_s, ended_cpu_s, sent) = self._marks
        wall_s = ended_s - began_s
        self._fleet.end()
        return Cost(
            100 * (ended_cpu_s - began_cpu_s) / wall_s,
            resident_mb(),
            (sent - before) / wall_s,
            self._fleet.answered_p99_ms,
        )


class Gaps:
    """Frames that are missing between those that came: each vehicle numbers its own, modulo 256."""

    def __init__(self, count: int) -> None:
        self.received, self.missing = 0, 0
        self._newest = np.full(count, -1)

    def take(self, rows: Whole, numbers: Whole) -> None:
        """Frames in order of arrival: (k,) whose, (k,) their numbers."""
        order = np.argsort(rows, kind="stable")
        rows, numbers = rows[order], numbers[order]
        first = np.append(True, rows[1:] != rows[:-1])
        before = np.where(first, self._newest[rows], np.append(-1, numbers[:-1]))
        steps = (numbers - before)[before >= 0] % 256
        self.missing += int(np.maximum(steps - 1, 0).sum())
        self.received += len(rows)
        self._newest[rows] = numbers  # the last of each stays


def resident_mb() -> float:
    """The most this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
