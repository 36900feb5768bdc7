"""A stranger floods the ports of vehicles in the air: no vehicle is affected, and the sender is named."""

import asyncio
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np

from gcs.cli.serve import make_link
from gcs.flight.orchestrator import Orchestrator
from gcs.links.batch_link import Link
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service.alarms import AlarmCause
from tests.support.machine import Pauses, TickTimes, free_ports
from tests.support.processes import SOON_S, proper, served, until, vehicles
from tests.support.views import vehicles_of
from tests.system.test_api_flooded import IDS, LONGEST_GAP_S, config_of

KINDS = ("heartbeats", "texts", "beginnings", "cut")
PER_S, FLOOD_S = 3000, 3.0
NAMED_S, STARTS_S = 2.0, 6.0
"""Of the alarm; of the senders, on a busy machine. Without senders: `tests/flight/test_link_flooded.py`."""


async def flooded(orchestrator: Orchestrator, ports: list[int], kind: str) -> float:
    """Flood these ports at once. Returns: when all senders were named."""
    command = [sys.executable, "-m", "tests.support.floods"]
    floods = [
        await asyncio.create_subprocess_exec(
            *command, str(port), kind, str(PER_S), str(FLOOD_S), stdout=subprocess.PIPE
        )
        for port in ports
    ]
    senders = []
    for each in floods:
        assert each.stdout is not None
        senders.append((await each.stdout.readline()).decode().strip())

    def are_named() -> bool:
        alarms = orchestrator.view.value.alarms
        texts = [alarm.text for alarm in alarms if alarm.cause is AlarmCause.INPUT_FLOODED]
        return all(any(sender in text for text in texts) for sender in senders)

    await until("named", SOON_S, are_named)
    named_s = time.monotonic()
    for each in floods:
        await each.wait()
    return named_s


async def fly_and_flood(
    folder: Path, ticks: TickTimes, machine: Pauses
) -> tuple[dict[str, Link], float, float]:
    """In formation. Returns: the links, when the first flood began, and the last one ended."""
    base = free_ports(2)
    config = config_of(base)
    links: dict[str, Link] = {}
    with vehicles(2, base, folder, *proper(config)):
        for settings in config.links:
            links[settings.transport] = make_link(settings, config)
        orchestrator = Orchestrator(config, list(links.values()), heart=ticks)
        async with served(orchestrator):
            view = orchestrator.view
            flying = {ShowPhase.ASSEMBLING, ShowPhase.RUNNING}
            await until("flying", SOON_S, lambda: view.value.show in flying)
            first_s = time.monotonic()
            for kind in KINDS:
                began_s = time.monotonic()
                named_s = await flooded(orchestrator, [base, base + 1], kind)
                assert machine.awake_s(began_s, named_s) < NAMED_S + STARTS_S, "with the start of the senders"
            ended_s = time.monotonic()
            assert [vehicle.phase for vehicle in vehicles_of(view.value)] == [Phase.FORMATION] * 2
    return links, first_s, ended_s


def test_links_flooded(tmp_path: Path) -> None:
    ticks = TickTimes()
    with Pauses() as machine:
        links, began_s, ended_s = asyncio.run(fly_and_flood(tmp_path, ticks, machine))
    for transport, vehicle_id in IDS.items():
        times_s = np.array(links[transport].setpoint_times_s(vehicle_id))
        flooded_s = times_s[(times_s >= began_s) & (times_s <= ended_s)].tolist()
        assert len(flooded_s) >= 0.9 * ticks.count(began_s, ended_s), vehicle_id
        assert len(flooded_s) >= 10.0 * machine.awake_s(began_s, ended_s), vehicle_id
        waits_s = [machine.awake_s(first_s, next_s) for first_s, next_s in pairwise(flooded_s)]
        assert max(waits_s) < LONGEST_GAP_S, vehicle_id
