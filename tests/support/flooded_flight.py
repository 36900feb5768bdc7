"""Two vehicles in the air, one over each transport, while something floods an input of the service."""

from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from gcs.cli.service.serve import make_link
from gcs.config.schema import Config
from gcs.flight.orchestrator import Orchestrator
from gcs.links.batch_link import Link
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.testing.views import vehicles_of
from tests.support.machine import Pauses, TickTimes, free_ports
from tests.support.processes import SOON_S, flying_config, proper, served, until, vehicles

IDS = {"mavsdk": "mavsdk1", "native": "native2"}
"""The vehicle of each transport."""

LONGEST_GAP_S = 0.5
"""Half of what PX4 takes for the loss of its ground station."""


@dataclass(frozen=True, slots=True)
class FloodedFlight:
    """What a flood is aimed at, and what it must not affect."""

    orchestrator: Orchestrator
    links: Mapping[str, Link]
    vehicle_ports: tuple[int, int]
    api_port: int


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


@asynccontextmanager
async def in_formation(folder: Path, ticks: TickTimes) -> AsyncIterator[FloodedFlight]:
    """A service with both vehicles in the formation, which they must not leave."""
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
            yield FloodedFlight(orchestrator, links, (base, base + 1), port)
            assert [vehicle.phase for vehicle in vehicles_of(view.value)] == [Phase.FORMATION] * 2


def assert_setpoints_went_on(
    links: Mapping[str, Link], ticks: TickTimes, machine: Pauses, began_s: float, ended_s: float
) -> None:
    """Each vehicle received a setpoint in nearly every tick between these times, without a gap."""
    for transport, vehicle_id in IDS.items():
        times_s = np.array(links[transport].setpoint_times_s(vehicle_id))
        flooded_s = times_s[(times_s >= began_s) & (times_s <= ended_s)].tolist()
        assert len(flooded_s) >= 0.9 * ticks.count(began_s, ended_s), vehicle_id
        assert len(flooded_s) >= 10.0 * machine.awake_s(began_s, ended_s), vehicle_id
        waits_s = [machine.awake_s(first_s, next_s) for first_s, next_s in pairwise(flooded_s)]
        assert max(waits_s) < LONGEST_GAP_S, vehicle_id
