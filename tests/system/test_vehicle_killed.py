"""`kill -9` of one fake vehicle of eight in flight."""

import asyncio
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gcs.cli.service.serve import make_link
from gcs.client import Client
from gcs.flight.orchestrator import Orchestrator
from gcs.formation.repulsion import energy
from gcs.links.mavsdk.link import MavsdkLink
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import FleetView
from gcs.testing.views import vehicles_of
from tests.support.machine import Pauses, TickTimes, free_ports
from tests.support.processes import SOON_S, flying_config, proper, served, until, vehicles

SURVIVORS = ("d1", "d2", "d3", "d4", "d6", "d7", "d8")

STEADY_S = 3.0
"""Flown in formation before the kill."""

WATCHED_S = 10.0
"""And at least this long after it."""

RE_FORMED_S = 60.0
"""From the kill on, silence and re-spreading together; 20 s where the machine has nothing else to do."""

BEST_OF_SEVEN = 14.452977
"""Energy of the best shape known, as `gcs.simulation.reference_shapes` has it."""

FORMED = 1.01
"""Energy over that of the best shape known; 8 minus 1 unformed is 1.03."""


@dataclass(frozen=True, slots=True)
class Seen:
    """What became of the flight."""

    link: MavsdkLink
    ticks: TickTimes
    killed_s: float
    phases: Mapping[str, str]  # as the API has them
    ratio: float  # of the survivors' shape, once formed or when there was no more waiting
    machine: Pauses


def energy_ratio(view: FleetView) -> float:
    """Of the believed shape of seven to the best; infinite while there are not seven."""
    rows = [vehicle.position_m for vehicle in vehicles_of(view) if vehicle.phase is Phase.FORMATION]
    if len(rows) != 7:
        return np.inf
    offset_m = np.array(rows, dtype=float) - np.array(view.center_m, dtype=float)
    direction = offset_m / np.linalg.norm(offset_m, axis=1, keepdims=True)
    return energy(direction) / BEST_OF_SEVEN


async def re_formed(orchestrator: Orchestrator, killed_s: float, machine: Pauses) -> float:
    """The median over two seconds; waits for a good one."""
    ratios: deque[float] = deque(maxlen=40)
    while len(ratios) < 40 or (
        np.median(ratios) >= FORMED and machine.awake_s(killed_s, time.monotonic()) < RE_FORMED_S
    ):
        await asyncio.sleep(0.05)
        ratios.append(energy_ratio(orchestrator.view.value))
    return float(np.median(ratios))


async def fly_and_kill(folder: Path, machine: Pauses) -> Seen:
    """Fly eight, kill the fifth's process, let the others re-form."""
    base = free_ports(8)
    config = flying_config(8, base, silence_s=2.0)
    with vehicles(8, base, folder, *proper(config), "--noise", "0", apart=4) as fifth:
        link = make_link(config.links[0], config)
        assert isinstance(link, MavsdkLink)
        ticks = TickTimes()
        orchestrator = Orchestrator(config, [link], heart=ticks)
        async with served(orchestrator) as port:
            view = orchestrator.view
            await until("running", SOON_S, lambda: view.value.show is ShowPhase.RUNNING)
            await asyncio.sleep(STEADY_S)
            fifth.kill()
            killed_s = time.monotonic()
            await until("lost", SOON_S, lambda: vehicles_of(view.value)[4].phase is Phase.LOST)
            ratio = await re_formed(orchestrator, killed_s, machine)
            await until("watched", SOON_S, lambda: time.monotonic() > killed_s + WATCHED_S)
            with Client(f"http://127.0.0.1:{port}", timeout_s=30.0) as client:
                fleet = await asyncio.to_thread(client.fleet)
    phases = {vehicle.id: vehicle.phase for vehicle in fleet.vehicles}
    return Seen(link, ticks, killed_s, phases, ratio, machine)


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Seen:
    with Pauses() as machine:
        return asyncio.run(fly_and_kill(tmp_path_factory.mktemp("truth"), machine))


@pytest.mark.soak
def test_the_others_keep_their_setpoint_rate(flight: Seen) -> None:
    machine, killed_s = flight.machine, flight.killed_s
    ticks = flight.ticks.count(killed_s, killed_s + WATCHED_S)
    awake_s = machine.awake_s(killed_s, killed_s + WATCHED_S)
    for vehicle_id in SURVIVORS:
        times_s = np.array(flight.link.setpoint_times_s(vehicle_id))
        before_s = times_s[(times_s >= killed_s - STEADY_S) & (times_s < killed_s)]
        after_s = times_s[(times_s >= killed_s) & (times_s < killed_s + WATCHED_S)]
        usual_s = np.median(np.diff(before_s))
        assert np.median(np.diff(after_s)) <= 1.2 * usual_s + 0.01, vehicle_id
        assert len(after_s) >= max(0.9 * ticks, 8.0 * awake_s), vehicle_id
        # no call waits either, but for the machine and until every vehicle has reported again
        waits_s = [machine.awake_s(first_s, next_s) for first_s, next_s in pairwise(after_s.tolist())]
        assert max(waits_s) < 0.5, vehicle_id


@pytest.mark.soak
def test_the_others_re_form(flight: Seen) -> None:
    assert flight.ratio < FORMED


@pytest.mark.soak
def test_api_names_the_lost_vehicle(flight: Seen) -> None:
    assert flight.phases == {"d5": "lost"} | dict.fromkeys(SURVIVORS, "formation")


@pytest.mark.soak
def test_the_lost_vehicle_gets_no_more_setpoints(flight: Seen) -> None:
    last_s = flight.link.setpoint_times_s("d5")[-1]
    assert (
        flight.machine.awake_s(flight.killed_s, last_s) < 1.0
    )  # age limit 0.5 s, then the setpoint watchdog
