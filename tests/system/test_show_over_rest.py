"""A written show over REST, as a crew does it: uploaded, checked, selected, started, paused, brought home."""

import asyncio
from pathlib import Path

import pytest

from gcs.api.app import create_app
from gcs.api.server import serve
from gcs.cli.service.serve import make_link
from gcs.client import Client
from gcs.config.schema import Config
from gcs.flight.orchestrator import Orchestrator
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import ShowPhase
from gcs.testing.views import vehicles_of
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, flying_config, last_truths, proper, until, vehicles

SHOW = """
about: Three vehicles stand above their pads and turn.
origin: {latitude_deg: 47.397742, longitude_deg: 8.545594, altitude_amsl_m: 488.0, heading_deg: 0.0}
fleet:
  vehicles: 3
  pads: {columns: 3, spacing_m: 5.0, x_m: 0.0, y_m: 5.0}
  endurance_s: 900.0
  takeoff_height_m: 3.0
  takeoff_stagger_s: 0.2
fence: {height_min_m: 3.0, height_max_m: 60.0, distance_max_m: 100.0}
duration_s: 300.0
timeline:
  - {cue: stand, at_s: 0, radius_m: 6, height_m: 14, target: {x_m: 4, y_m: 4}, lights: ["#ff0000"]}
  - {cue: turn, at_s: 1, spin: {rate_deg_s: 8}, over_s: 4}
"""


def prepare(client: Client) -> str:
    """Upload, check and select. Returns: the hash to start with."""
    client.shows.upload("turn", SHOW)
    assert client.shows.text("turn") == SHOW
    with pytest.raises(RefusedError, match="has not been checked"):
        client.shows.select("turn", "0" * 64)
    assert client.shows.check("turn").state == "waiting"
    found = client.shows.wait_for_check("turn", 3 * SOON_S)  # others go first
    assert found.good, f"{found.reason} {found.problems}"
    assert found.hash is not None
    assert found.figures is not None
    assert [cue.cue for cue in found.figures.cues] == ["stand", "turn"]
    assert client.shows.select("turn", found.hash).cues == ("stand", "turn")
    return found.hash


def begin(client: Client, show_hash: str) -> None:
    """Start, as soon as the vehicles are ready."""
    with pytest.raises(RefusedError, match="start with its hash"):
        client.start()
    client.start(show_hash=show_hash)


async def fly(config: Config) -> None:
    loop = asyncio.get_running_loop()
    orchestrator = Orchestrator(config, [make_link(link, config) for link in config.links])
    listening: asyncio.Future[int] = loop.create_future()
    tasks = [
        asyncio.create_task(orchestrator.run()),
        asyncio.create_task(serve(create_app(orchestrator), port=0, listening=listening)),
    ]
    view = orchestrator.view
    try:
        with Client(f"http://127.0.0.1:{await listening}", timeout_s=30.0) as client:
            show_hash = await asyncio.to_thread(prepare, client)
            await until("ready", SOON_S, lambda: all(each.ready for each in vehicles_of(view.value)))
            await asyncio.to_thread(begin, client, show_hash)
            await until("running", SOON_S, lambda: view.value.show is ShowPhase.RUNNING)
            await asyncio.sleep(3.0)
            await asyncio.to_thread(client.pause)
            await asyncio.sleep(1.0)
            paused = (await asyncio.to_thread(client.show)).selected
            await asyncio.sleep(1.0)
            still = await asyncio.to_thread(client.show)
            assert still.phase == "paused"
            assert still.selected == paused
            assert paused is not None
            assert (paused.cue, paused.runs) == ("turn", False)
            await asyncio.to_thread(client.resume)
            await until("running again", SOON_S, lambda: view.value.show is ShowPhase.RUNNING)
            fleet = await asyncio.to_thread(client.fleet)
            assert [vehicle.colour for vehicle in fleet.vehicles] == ["#ff0000"] * 3
            await asyncio.to_thread(client.stop)
            await until("landed", SOON_S, lambda: view.value.show is ShowPhase.LANDED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)


@pytest.mark.soak
@pytest.mark.usefixtures("prompt_checks")
def test_show_is_uploaded_checked_flown_paused_and_returned(tmp_path: Path) -> None:
    base = free_ports(3)
    config = flying_config(3, base, silence_s=20.0)
    raw = config.model_dump() | {"shows": {"folder": tmp_path / "shows"}}
    config = Config.model_validate(raw)
    with vehicles(3, base, tmp_path, *proper(config)):
        asyncio.run(fly(config))
        states = last_truths(tmp_path / "truth.jsonl")
    assert [(state["landed"], state["armed"]) for state in states] == [(True, False)] * 3
