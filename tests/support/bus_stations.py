"""Stations on a Zenoh bus on loopback: in this process, or each as one that can be killed.

`python -m tests.support.bus_stations NAME ENDPOINTS KEYS [junk]` publishes 20 states a second until it is
killed, with `junk` 50 further topics each time, 1,000 messages a second. KEYS is a folder or empty.
"""

import asyncio
import json
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

from gcs.bus.settings import Endpoint
from gcs.bus.zenoh_bus import ZenohBus
from tests.support.machine import free_ports

SOON_S = 30.0


def endpoints_of(*stations: str) -> dict[str, Endpoint]:
    """Free endpoints on loopback."""
    first = free_ports(len(stations))
    return {name: Endpoint(host="127.0.0.1", port=first + k) for k, name in enumerate(stations)}


def bus_of(station: str, endpoints: dict[str, Endpoint], keys: Path | None = None) -> ZenohBus:
    return ZenohBus(station, endpoints, keys=keys, now_s=time.monotonic)


@asynccontextmanager
async def opened(*buses: ZenohBus) -> AsyncIterator[None]:
    """Run the buses until the block ends."""
    async with asyncio.TaskGroup() as group:
        tasks = [group.create_task(bus.run()) for bus in buses]
        yield
        for task in tasks:
            task.cancel()


@contextmanager
def process_of(
    station: str, endpoints: dict[str, Endpoint], keys: Path | None = None, *, junk: bool = False
) -> Iterator["subprocess.Popen[bytes]"]:
    """Run a station that publishes, until the block ends."""
    raw = json.dumps({name: one.model_dump() for name, one in endpoints.items()})
    command = [sys.executable, "-m", __name__, station, raw, str(keys or ""), *["junk"][: int(junk)]]
    process = subprocess.Popen(command)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


async def until(what: str, holds: Callable[[], bool]) -> None:
    """Wait on the event loop until something holds."""
    end_s = time.monotonic() + SOON_S
    while not holds():
        assert time.monotonic() < end_s, f"{what}: not within {SOON_S:g} s"
        await asyncio.sleep(0.01)


async def _publish(station: str, raw: str, keys: str, *junk: str) -> None:
    endpoints = {name: Endpoint(**one) for name, one in json.loads(raw).items()}
    bus = bus_of(station, endpoints, Path(keys) if keys else None)
    async with opened(bus):
        while True:
            for number in range(50 * len(junk)):
                bus.publish({f"junk{number}": bytes(1000)})
            bus.publish({"states": station.encode()})
            bus.newest()
            await asyncio.sleep(0.05)


if __name__ == "__main__":
    asyncio.run(_publish(*sys.argv[1:]))
