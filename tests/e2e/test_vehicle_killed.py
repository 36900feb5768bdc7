"""`kill -9` of one fake vehicle of eight in flight."""

import asyncio
import time
from pathlib import Path

import numpy as np
import pytest
from ground import flying_config, free_ports, rate_hz, until, vehicles

from api.app import create_app
from api.server import serve
from gcs.cli.serve import make_link
from gcs.client import Client
from gcs.formation.thomson import best_configuration, energy
from gcs.lifecycle import Phase, ShowPhase
from gcs.links.mavsdk_link import MavsdkLink
from gcs.orchestrator import Orchestrator
from gcs.service import ShowAction

pytestmark = pytest.mark.xdist_group("e2e")

SURVIVORS = ("d1", "d2", "d3", "d4", "d6", "d7", "d8")


async def fly_and_kill(folder: Path) -> tuple[MavsdkLink, float, object, float]:
    """Fly eight, kill the fifth's process, let the others re-form."""
    base = free_ports(8)
    config = flying_config(8, base)
    with vehicles(8, base, folder) as processes:
        link = make_link(config.links[0], config)
        assert isinstance(link, MavsdkLink)
        orchestrator = Orchestrator(config, [link])
        listening: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        tasks = [
            asyncio.create_task(orchestrator.run()),
            asyncio.create_task(serve(create_app(orchestrator), port=0, listening=listening)),
        ]
        view = orchestrator.view
        await until("ready", 40, lambda: all(v.ready for v in view.value.vehicles))
        orchestrator.command_show(ShowAction.START)
        await until("running", 90, lambda: view.value.show is ShowPhase.RUNNING)
        await asyncio.sleep(8.0)
        processes[4].kill()
        killed_s = time.monotonic()
        await until("lost", 5, lambda: view.value.vehicles[4].phase is Phase.LOST)
        await asyncio.sleep(20.0)
        with Client(f"http://127.0.0.1:{await listening}") as client:
            fleet = await asyncio.to_thread(client.fleet)
        ratios = []
        for _ in range(40):  # two seconds of the believed shape, its noise averaged by the median
            await asyncio.sleep(0.05)
            center_m = view.value.center_m
            rows = [v.position_m for v in view.value.vehicles if v.phase is Phase.FORMATION]
            offset_m = np.array(rows, dtype=float) - np.array(center_m, dtype=float)
            direction = offset_m / np.linalg.norm(offset_m, axis=1, keepdims=True)
            ratios.append(energy(direction) / energy(best_configuration(7)) if len(rows) == 7 else np.inf)
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
    return link, killed_s, fleet, float(np.median(ratios))


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> tuple[MavsdkLink, float, object, float]:
    return asyncio.run(fly_and_kill(tmp_path_factory.mktemp("truth")))


def test_the_others_keep_their_setpoint_rate(flight: tuple[MavsdkLink, float, object, float]) -> None:
    link, killed_s, _, _ = flight
    for vehicle_id in SURVIVORS:
        times_s = link.setpoint_times_s(vehicle_id)
        before_hz = rate_hz(times_s, killed_s - 5.0, killed_s)
        after_hz = rate_hz(times_s, killed_s, killed_s + 15.0)
        assert after_hz >= 0.9 * before_hz >= 15.0, vehicle_id


def test_the_others_re_form(flight: tuple[MavsdkLink, float, object, float]) -> None:
    assert flight[3] < 1.01  # one moment's shape carries the position noise; 8 minus 1 unformed is 1.03


def test_the_api_says_which_vehicle_is_lost(flight: tuple[MavsdkLink, float, object, float]) -> None:
    phases = {vehicle.id: vehicle.phase for vehicle in flight[2].vehicles}  # type: ignore[attr-defined]
    assert phases == {"d5": "lost"} | dict.fromkeys(SURVIVORS, "formation")


def test_the_lost_vehicle_gets_no_more_setpoints(flight: tuple[MavsdkLink, float, object, float]) -> None:
    link, killed_s, _, _ = flight
    assert link.setpoint_times_s("d5")[-1] - killed_s < 1.0  # age limit 0.5 s, then the deadman
