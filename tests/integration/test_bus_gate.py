"""Bad handshakes at the bus: the station that was killed is back soon, and memory stays bounded."""

import asyncio
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path

import pytest

from gcs.bus.gate import AT_ONCE, STRANGERS_WAITING, WAITING
from gcs.bus.keys import make_site_keys
from tests.support.bad_handshakes import KINDS
from tests.support.bus_stations import bus_of, endpoints_of, opened, process_of, until
from tests.support.machine import Pauses

PER_S = 1000
SECONDS = (3.0, 30.0)
BACK_S = 10.0

NAMED_S = 2.0
STRANGER = "127.0.0.9"
"""Another host's address, as the kernel sees it. 127.0.0.1 is that of all stations."""


@contextmanager
def bad_handshakes(kind: str, source: str, port: int, seconds: float) -> Iterator["subprocess.Popen[str]"]:
    """Connections of a host without a key, once they have begun."""
    words = (kind, source, "127.0.0.1", str(port), str(PER_S), str(seconds))
    command = [sys.executable, "-m", "tests.support.bad_handshakes", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        try:
            yield process
        finally:
            process.kill()


def cases() -> Iterator[object]:
    """All but whole ClientHellos from a station's own host that go on: they keep that host's stations out."""
    for kind, source, goes_on, seconds in product(KINDS, (STRANGER, "127.0.0.1"), (False, True), SECONDS):
        is_short = seconds == SECONDS[0] and goes_on == (source == STRANGER) and kind != "idle"
        if not (kind == "hello" and source != STRANGER and goes_on):
            marks = () if is_short else pytest.mark.soak
            when = "during" if goes_on else "after"
            yield pytest.param(
                kind, source, goes_on, seconds, marks=marks, id=f"{kind}-{source}-{when}-{seconds:g}"
            )


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.mark.keeps("junk-127.0.0.9-during-3", "hello-127.0.0.1-after-3")
@pytest.mark.parametrize(("kind", "source", "goes_on", "seconds"), list(cases()))
def test_station_is_back_soon_after_bad_handshakes(
    tmp_path: Path, kind: str, source: str, goes_on: bool, seconds: float
) -> None:
    """North, which connects to south, is killed and started: after the flood, or within it."""
    endpoints = endpoints_of("north", "south")
    make_site_keys(tmp_path / "keys", {name: ["127.0.0.1"] for name in endpoints})
    south = bus_of("south", endpoints, tmp_path / "keys")
    loop_s = time.monotonic

    async def story() -> None:
        async with opened(south):
            with process_of("north", endpoints, tmp_path / "keys") as north:
                await until("present", lambda: south.present == {"north"})
                files, begin_s = open_files(), loop_s()
                flood = bad_handshakes(kind, source, endpoints["south"].port, 3600.0 if goes_on else seconds)
                with flood as stranger, Pauses() as machine:
                    await until("named", lambda: any(one.why_over(loop_s()) for one in south.intakes))
                    assert machine.awake_s(begin_s, loop_s()) < NAMED_S
                    (failures,) = south.intakes
                    assert failures.why_over(loop_s()).endswith(f"failed handshakes a second from {source}")
                    most = 0
                    while loop_s() < begin_s + seconds or (not goes_on and stranger.poll() is None):
                        await asyncio.sleep(0.05)
                        most = max(most, open_files() - files)
                    assert most <= max(WAITING, STRANGERS_WAITING) + 4 * AT_ONCE + 8
                    assert south.present == {"north"}, "connections that were open stay open"
                    north.kill()
                    await until("gone", lambda: not south.present)
                    began_s = loop_s()
                    with process_of("north", endpoints, tmp_path / "keys"):
                        await until("back", lambda: south.present == {"north"})
                        assert machine.awake_s(began_s, loop_s()) < BACK_S

    asyncio.run(story())
