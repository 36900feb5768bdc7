"""One station beside two busy processes: which vehicles leave the formation, and how late ticks come.

`python -m tests.bench.busy [VEHICLES [SECONDS]]`, 1,000 and 300 unless said: native transport, 20 Hz, steady
orbit. The busy processes have the usual priority. The fake vehicles come before them, as real ones share no
processor with the station.
"""

import os
import signal
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from gcs.cli.demo.demo_script import ORBIT_SPEED_M_S, USUAL_RADIUS_M
from tests.bench.fake_fleet import busy_s
from tests.bench.links import Requirement
from tests.bench.stations import ALONE, SETTLE_S, START_S, Fleet, flying, site_of, wait
from tests.support.started import DEVNULL, Started

BUSY = 2
RATE_HZ = 20.0
LATE_MS = 10.0
LOOK_S = 5.0
BEFORE_OTHERS = -5
"""Nice value of the fake vehicles, where it is permitted."""


def fly(count: int, seconds: float, folder: Path) -> list[Requirement]:
    """Fly, and print what is seen. Raises: TimeoutError."""
    with flying(site_of(1, count, RATE_HZ), folder) as fleet, ExitStack() as stack:
        wait("started", [fleet], Fleet.starts, START_S)
        wait("running", [fleet], lambda fleet: fleet.all_show("running"))
        client, station = fleet.clients[fleet.names[0]], fleet.stations[fleet.names[0]]
        client.change_orbit(radius_m=USUAL_RADIUS_M, speed_m_s=ORBIT_SPEED_M_S)
        time.sleep(SETTLE_S)
        if os.geteuid() == 0:
            os.setpriority(os.PRIO_PROCESS, fleet.vehicles.pid, BEFORE_OTHERS)
        for _ in range(BUSY):
            stack.callback(Started("timeit", "-n", "1000000000", stdout=DEVNULL).end)
        before, began_s, used_s = client.fleet().tick, time.monotonic(), busy_s(station.pid)
        left, late_ms = set[str](), []
        while time.monotonic() < began_s + seconds:
            time.sleep(LOOK_S)
            seen = client.fleet()
            left |= {one.id for one in client.vehicles() if one.phase != "formation"}
            late_ms.append(seen.tick.lateness_p99_ms or 0.0)
        percent = 100.0 * (busy_s(station.pid) - used_s) / (time.monotonic() - began_s)
        granted = seen.tick.scheduling
        print(f"  {percent:.1f} % of a core, {seen.tick.missed - before.missed} ticks missed; {granted}")
        client.stop()
        wait("landed", [fleet], lambda fleet: fleet.all_show("landed"))
    return [
        Requirement("vehicles that left the formation", len(left), 0.0),
        Requirement("lateness p99 at most, ms", max(late_ms), LATE_MS),
    ]


def main(count: int = 1000, seconds: float = 300.0) -> int:
    """Fly and print. Returns: 0 when it was measured, whatever the figures."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends all processes as Ctrl-C does
    print(f"{count} vehicles at {RATE_HZ:g} Hz beside {BUSY} busy processes for {seconds:g} s", flush=True)
    with tempfile.TemporaryDirectory(prefix="gcs-bench-") as folder:
        required = fly(count, seconds, Path(folder) / ALONE[0])
    for each in required:
        print(f"  {each.figure:8.2f}  {each}")
    return 0


if __name__ == "__main__":
    given = sys.argv[1:]
    sys.exit(main(*(int(one) for one in given[:1]), *(float(one) for one in given[1:2])))
