"""The API over a service in another process answers what it answers in the service's own."""

import asyncio
import re

import httpx

from gcs.api.app import create_app
from gcs.service import Service, ShowAction
from gcs.service.remote import RemoteService
from tests.support.api_fake_service import FakeService
from tests.support.remote_port import remote

PATHS = (
    *("fleet", "status", "vehicles", "vehicles/d2", "alarms", "preflight", "show", "formation", "orbit"),
    *("target", "yaw", "obstacles", "commands", "commands/o1", "commands/o9", "shows", "shows/a", "stations"),
)

NOW = re.compile(r'"(view_age_s|began_unix_time_s|unix_time_s)": ?[-+0-9.e]+|gcs_state_age_seconds [0-9.e-]+')


async def answers(service: Service) -> dict[str, tuple[int, str]]:
    """Status and text of every path, without what changes with time."""
    transport = httpx.ASGITransport(create_app(service))
    async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
        found = {path: await client.get(path) for path in ("/healthz", "/metrics")}
        found |= {path: await client.get(f"/api/v1/{path}") for path in PATHS}
    return {path: (answer.status_code, NOW.sub("", answer.text)) for path, answer in found.items()}


async def answers_from_another_process(port: RemoteService) -> dict[str, tuple[int, str]]:
    receiving = asyncio.create_task(port.run())
    try:
        return await answers(port)
    finally:
        receiving.cancel()


def test_every_reading_route_answers_the_same() -> None:
    service = FakeService(3, station_names=("north", "south"))
    service.command_show(ShowAction.START)
    service.fly()
    service.happen("a cue", "d1")
    with remote(service) as (port, _control):
        remotely = asyncio.run(answers_from_another_process(port))
    here = asyncio.run(answers(service))
    assert {path: status for path, (status, _) in here.items() if status not in {200, 404, 409}} == {}
    for path, answer in here.items():
        assert remotely[path] == answer, path
