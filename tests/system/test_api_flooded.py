"""Many clients ask the API for more than it can answer: no vehicle in the air is affected."""

import asyncio
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import pytest

from gcs.client import Client
from gcs.links.batch_link import Link
from gcs.model.errors import LinkError
from tests.support.flooded_flight import assert_setpoints_went_on, in_formation
from tests.support.machine import Pauses, TickTimes
from tests.support.processes import SOON_S

FLOOD_S = 3.0
CLIENTS = 8

FLOOD = """
import http.client, os, sys, threading, time
os.nice(10)  # a flood comes from elsewhere: it takes no time from the service
port, seconds = int(sys.argv[1]), float(sys.argv[2])
answered = []
def ask():
    end_s = time.monotonic() + seconds
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    while time.monotonic() < end_s:
        connection.request("GET", "/api/v1/fleet")
        answered.append(connection.getresponse().read())
threads = [threading.Thread(target=ask) for _ in range(int(sys.argv[3]))]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(len(answered))
"""


async def alive(client: Client) -> None:
    """Until the service says so: the machine may have paused just before it was asked."""
    async with asyncio.timeout(SOON_S):
        while True:
            with suppress(LinkError):
                if (await asyncio.to_thread(client.health)).alive:
                    return
            await asyncio.sleep(0.1)


async def fly_and_flood(folder: Path, ticks: TickTimes) -> tuple[Mapping[str, Link], float, float, int]:
    """In formation. Returns: the links, when the flood began and ended, what was answered."""
    async with in_formation(folder, ticks) as flight:
        flood = [sys.executable, "-c", FLOOD, str(flight.api_port), str(FLOOD_S), str(CLIENTS)]
        began_s = time.monotonic()
        answered = int(await asyncio.to_thread(subprocess.check_output, flood))
        ended_s = time.monotonic()
        with Client(f"http://127.0.0.1:{flight.api_port}", timeout_s=30.0) as client:
            await alive(client)
        return flight.links, began_s, ended_s, answered


@pytest.mark.soak
def test_api_flooded(tmp_path: Path) -> None:
    ticks = TickTimes()
    with Pauses() as machine:
        links, began_s, ended_s, answered = asyncio.run(fly_and_flood(tmp_path, ticks))
    assert answered > 2 * FLOOD_S, "it is answered, as far as there is time"
    assert_setpoints_went_on(links, ticks, machine, began_s, ended_s)
