"""Many clients ask the API for more than it can answer: no vehicle in the air is affected."""

import asyncio
import subprocess
import sys
import time
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import numpy as np

from gcs.cli.serve import make_link
from gcs.client import Client
from gcs.config.schema import Config
from gcs.flight.orchestrator import Orchestrator
from gcs.links.batch_link import Link
from gcs.model.errors import LinkError
from gcs.model.lifecycle import Phase, ShowPhase
from tests.support.machine import Pauses, TickTimes, free_ports
from tests.support.processes import SOON_S, flying_config, proper, served, until, vehicles
from tests.support.views import vehicles_of

IDS = {"mavsdk": "mavsdk1", "native": "native2"}
"""Who is flown over which transport."""

FLOOD_S = 3.0
LONGEST_GAP_S = 0.5
"""Half of what PX4 takes for the loss of its ground station."""
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


def config_of(base: int) -> Config:
    """Two vehicles, each on a link of its own."""
    raw = flying_config(2, base, silence_s=20.0).model_dump()
    (link,) = raw["links"]
    raw["links"] = [
        {
            **link,
            "name": transport,
            "transport": transport,
            "listen": f"udpin://127.0.0.1:{base + row}",
            "ports": 1,
            "vehicles": {"first_system_id": row + 1, "count": 1, "id_pattern": "{link}{system_id}"},
        }
        for row, transport in enumerate(IDS)
    ]
    return Config.model_validate(raw)


async def alive(client: Client) -> None:
    """Until the service says so: the machine may have paused just before it was asked."""
    async with asyncio.timeout(SOON_S):
        while True:
            with suppress(LinkError):
                if (await asyncio.to_thread(client.health)).alive:
                    return
            await asyncio.sleep(0.1)


async def fly_and_flood(folder: Path, ticks: TickTimes) -> tuple[dict[str, Link], float, float, int]:
    """In formation. Returns: the links, when the flood began and ended, what was answered."""
    base = free_ports(2)
    config = config_of(base)
    links: dict[str, Link] = {}
    with vehicles(2, base, folder, *proper(config)):
        for settings in config.links:
            links[settings.transport] = make_link(settings, config)
        orchestrator = Orchestrator(config, list(links.values()), heart=ticks)
        async with served(orchestrator) as port:
            view = orchestrator.view
            flying = {ShowPhase.ASSEMBLING, ShowPhase.RUNNING}
            await until("flying", SOON_S, lambda: view.value.show in flying)
            flood = [sys.executable, "-c", FLOOD, str(port), str(FLOOD_S), str(CLIENTS)]
            began_s = time.monotonic()
            answered = int(await asyncio.to_thread(subprocess.check_output, flood))
            ended_s = time.monotonic()
            assert [vehicle.phase for vehicle in vehicles_of(view.value)] == [Phase.FORMATION] * 2
            with Client(f"http://127.0.0.1:{port}", timeout_s=30.0) as client:
                await alive(client)
    return links, began_s, ended_s, answered


def test_api_flooded(tmp_path: Path) -> None:
    ticks = TickTimes()
    with Pauses() as machine:
        links, began_s, ended_s, answered = asyncio.run(fly_and_flood(tmp_path, ticks))
    assert answered > 2 * FLOOD_S, "it is answered, as far as there is time"
    for transport, vehicle_id in IDS.items():
        times_s = np.array(links[transport].setpoint_times_s(vehicle_id))
        flooded_s = times_s[(times_s >= began_s) & (times_s <= ended_s)].tolist()
        assert len(flooded_s) >= 0.9 * ticks.count(began_s, ended_s), vehicle_id
        assert len(flooded_s) >= 10.0 * machine.awake_s(began_s, ended_s), vehicle_id
        waits_s = [machine.awake_s(first_s, next_s) for first_s, next_s in pairwise(flooded_s)]
        assert max(waits_s) < LONGEST_GAP_S, vehicle_id
