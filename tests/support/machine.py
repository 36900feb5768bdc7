"""Properties of the machine for real-time tests: free ports, and the times in which it paused."""

import os
import random
import socket
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack

from gcs.service import check_process
from tests.support.background import Background

FIRST_PORT, LAST_PORT = 16000, 32000
"""Below the ports that the kernel assigns (32768 and up on Linux): no program is given one meanwhile."""

WORKERS = 5
"""Each with a share of these ports: no test takes what another has found free."""

LOOK_S = 0.01
STALL_S = 0.05
"""Shorter pauses are not noted: what is measured with `Pauses.awake_s` may still hold one of them."""


_given: deque[int] = deque(maxlen=500)
"""Ports that this process was given last. They may be free still: the test has not opened them yet."""


def free_ports(count: int = 1) -> int:
    """The first of `count` consecutive ports that are free now, for UDP and for TCP, and not given before."""
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    share = (LAST_PORT - FIRST_PORT) // (WORKERS if worker else 1)
    lowest = FIRST_PORT + (int(worker[2:]) % WORKERS * share if worker else 0)
    for _ in range(1000):
        # at random: another run of the tests may look for ports, and late datagrams to a used port may arrive
        first = random.SystemRandom().randrange(lowest, lowest + share - count)
        ports = range(first, first + count)
        if any(port in _given for port in ports):
            continue
        with ExitStack() as stack:
            try:
                for port in ports:
                    for kind in (socket.SOCK_DGRAM, socket.SOCK_STREAM):
                        probe = stack.enter_context(socket.socket(socket.AF_INET, kind))
                        probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            _given.extend(ports)
            return first
    raise OSError("no free ports")


_restrict = check_process.restrict


def restrict_at_usual_priority(pid: int, _: int, memory_max_bytes: int) -> None:
    """Restrict a check beside a service in its memory only.

    At the lowest priority it takes minutes beside two busy processes.
    """
    _restrict(pid, 0, memory_max_bytes)


class Pauses(Background):
    """A thread that runs every 10 ms and records when it could not.

    It waits for no other thread, so a missed turn is a pause of the machine (another virtual machine's turn,
    a full run queue), not of the code under test. Tests subtract this time.
    """

    def __init__(self) -> None:
        self._stalls_s: list[tuple[float, float]] = []
        super().__init__("pauses")

    def stalled_s(self, start_s: float, end_s: float) -> float:
        """Seconds of this interval of the monotonic clock in which the machine paused."""
        return sum(max(0.0, min(to_s, end_s) - max(from_s, start_s)) for from_s, to_s in self._stalls_s)

    def awake_s(self, start_s: float, end_s: float) -> float:
        """Seconds of this interval in which the machine ran."""
        return end_s - start_s - self.stalled_s(start_s, end_s)

    def _live(self) -> None:
        before_s = time.monotonic()
        while not self._stopped.is_set():
            time.sleep(LOOK_S)
            now_s = time.monotonic()
            if now_s - before_s > STALL_S:
                self._stalls_s.append((before_s, now_s))
            before_s = now_s


class TickTimes:
    """Notes when each tick of a control loop ended, as its `Heart`. A busy machine drops ticks."""

    problem = ""

    def __init__(self) -> None:
        self.times_s: list[float] = []

    def beat(self) -> None:
        self.times_s.append(time.monotonic())

    def count(self, begin_s: float, end_s: float) -> int:
        """Ticks in this interval of the monotonic clock."""
        return sum(begin_s <= time_s < end_s for time_s in self.times_s)


def soon(holds: Callable[[], bool]) -> None:
    """Wait until something holds, as long as a slow machine may need."""
    end_s = time.monotonic() + 120.0
    while not holds():
        assert time.monotonic() < end_s
        time.sleep(0.01)
