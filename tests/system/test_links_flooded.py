"""A stranger floods the ports of vehicles in the air: no vehicle is affected, and the sender is named."""

import asyncio
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import pytest

from gcs.links.batch_link import Link
from gcs.service.alarms import AlarmCause
from tests.support.flooded_flight import FloodedFlight, assert_setpoints_went_on, in_formation
from tests.support.machine import Pauses, TickTimes
from tests.support.processes import SOON_S, until

KINDS = ("heartbeats", "texts", "beginnings", "cut")
PER_S, FLOOD_S = 3000, 3.0
NAMED_S = 2.0


async def flood(flight: FloodedFlight, kind: str, machine: Pauses) -> None:
    """Flood both ports at once. Every sender is named soon after all have begun."""
    command = [sys.executable, "-m", "tests.support.floods"]
    floods = [
        await asyncio.create_subprocess_exec(
            *command, str(port), kind, str(PER_S), str(FLOOD_S), stdout=subprocess.PIPE
        )
        for port in flight.vehicle_ports
    ]
    senders = []
    for each in floods:
        assert each.stdout is not None
        senders.append((await each.stdout.readline()).decode().strip())
    began_s = time.monotonic()

    def are_named() -> bool:
        alarms = flight.orchestrator.view.value.alarms
        texts = [alarm.text for alarm in alarms if alarm.cause is AlarmCause.INPUT_FLOODED]
        return all(any(sender in text for text in texts) for sender in senders)

    await until("named", SOON_S, are_named)
    assert machine.awake_s(began_s, time.monotonic()) < NAMED_S, kind
    for each in floods:
        await each.wait()


async def fly_and_flood(
    folder: Path, ticks: TickTimes, machine: Pauses
) -> tuple[Mapping[str, Link], float, float]:
    """In formation. Returns: the links, when the first flood began, and the last one ended."""
    async with in_formation(folder, ticks) as flight:
        began_s = time.monotonic()
        for kind in KINDS:
            await flood(flight, kind, machine)
        return flight.links, began_s, time.monotonic()


@pytest.mark.soak
def test_links_flooded(tmp_path: Path) -> None:
    ticks = TickTimes()
    with Pauses() as machine:
        links, began_s, ended_s = asyncio.run(fly_and_flood(tmp_path, ticks, machine))
    assert_setpoints_went_on(links, ticks, machine, began_s, ended_s)
