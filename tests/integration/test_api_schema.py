"""The API against its own OpenAPI: schemathesis' default checks, with the real service over a fake fleet."""

import asyncio
import threading
import time
from collections.abc import Iterator
from http import HTTPStatus
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, settings
from schemathesis import Case

from gcs.api.app import create_app
from gcs.api.auth.authorization import Authorization
from gcs.api.auth.tokens import Tokens, create_token
from gcs.api.server import serve
from gcs.flight.orchestrator import Orchestrator
from gcs.preflight.parameters import settings_of
from gcs.service.access import Role
from gcs.sim.fleet import Fleet
from gcs.sim.settings import Settings
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_link import VirtualLink
from gcs.testing.virtual_show import show_config
from tests.support.api_fake_service import FakeService

pytestmark = pytest.mark.soak

EXAMPLES = max(1, settings().max_examples // 33 - 2)
"""At random of each operation, beside those at the bounds of each value: 1, in `make soak` 28."""

BUSY_S = 60.0
"""For an answer: a drawing is parsed at the lowest priority."""


async def serve_fleet(
    tokens: Tokens, shows: Path, up: list[tuple[asyncio.AbstractEventLoop, asyncio.Event, int]]
) -> None:
    """Orchestrator, fake fleet and API, until the event is set."""
    loop, enough = asyncio.get_running_loop(), asyncio.Event()
    config = show_config(3, shows={"folder": shows})
    asked = settings_of(config)
    made = Settings(count=len(config.ids), grid_columns=2, parameters=asked)
    fleet = Fleet(made, start_s=loop.time(), unix_at_start_s=time.time())
    link = VirtualLink(config, fleet)
    service = Orchestrator(config, [link])
    listening = loop.create_future()
    app = create_app(service, authorization=Authorization(tokens))
    tasks = [
        asyncio.create_task(service.run()),
        asyncio.create_task(serve(app, port=0, listening=listening)),
    ]
    async for view in service.view.values():
        if all(vehicle.ready for vehicle in vehicles_of(view)):
            break
    up.append((loop, enough, await listening))
    ended = asyncio.create_task(enough.wait())
    await asyncio.wait({*tasks, ended}, return_when=asyncio.FIRST_COMPLETED)
    for task in tasks:
        task.cancel()
    await asyncio.wait(tasks)


class Served(NamedTuple):
    """Where the service is, and how to be let in."""

    url: str
    headers: dict[str, str]


# With a parameter every operation is a test with a name of its own; xdist runs but one of namesakes.
@pytest.fixture(scope="module", params=[Role.OPERATE])
def served(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Iterator[Served]:
    file = tmp_path_factory.mktemp("access") / "tokens.json"
    token = create_token(file, "tester", request.param)
    up: list[tuple[asyncio.AbstractEventLoop, asyncio.Event, int]] = []
    thread = threading.Thread(
        target=lambda: asyncio.run(serve_fleet(Tokens(file), file.parent / "shows", up))
    )
    thread.start()
    while not up:
        thread.join(0.05)
        assert thread.is_alive()
    loop, enough, port = up[0]
    yield Served(f"http://127.0.0.1:{port}", {"Authorization": f"Bearer {token}"})
    assert thread.is_alive(), "neither control nor the API has ended by itself"
    loop.call_soon_threadsafe(enough.set)
    thread.join(30)
    assert not thread.is_alive()


schema = schemathesis.openapi.from_dict(create_app(FakeService()).openapi())

# Beyond the default: what fence, fleet and speed allow is in no schema, so a proper value may be 422.
proper = schema.config.checks.positive_data_acceptance
proper.expected_statuses = [*proper.expected_statuses, "422"]
improper = schema.config.checks.negative_data_rejection
improper.expected_statuses = [*improper.expected_statuses, "413"]  # a list too long may be a body too large

HEALTH = {"/healthz", "/readyz"}
"""503 is their right answer while a busy machine delays control; no other operation may answer it here."""
healthy = schema.config.checks.not_a_server_error
healthy.expected_statuses = [*healthy.expected_statuses, "503"]


@schema.parametrize()
@settings(
    max_examples=EXAMPLES,
    deadline=None,
    derandomize=True,
    database=None,
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),
)
def test_every_operation_matches_its_description(case: Case[Any], served: Served) -> None:
    answer = case.call_and_validate(base_url=served.url, headers=served.headers, timeout=BUSY_S)
    delayed = answer.status_code == HTTPStatus.SERVICE_UNAVAILABLE and case.path in HEALTH
    assert answer.status_code < 500 or delayed
