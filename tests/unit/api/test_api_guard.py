import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest
from api_fake_service import FakeService
from api_harness import Api

from api.app import create_app
from api.guard import BODY_MAX_BYTES, DRAIN_MAX_BYTES
from gcs.lifecycle import ShowPhase


@pytest.fixture
def api() -> Api:
    return Api()


async def chunks(count: int, size: int) -> AsyncIterator[bytes]:
    for _ in range(count):
        yield b" " * size


@pytest.mark.parametrize("size", [BODY_MAX_BYTES + 1, DRAIN_MAX_BYTES + 1])
def test_a_body_too_large_is_413(api: Api, size: int) -> None:
    answer = api("PATCH", "/api/v1/formation", content=b" " * size)
    assert answer.status_code == 413
    assert answer.json() == {"detail": "the body is larger than 65536 bytes", "problems": []}


def test_a_body_too_large_in_pieces_is_413_and_a_large_one_in_bounds_is_read(api: Api) -> None:
    assert api("POST", "/api/v1/show/start", content=chunks(5, 16 * 1024)).status_code == 413
    assert api.service.show is ShowPhase.IDLE
    json_type = {"Content-Type": "application/json"}
    padded = api("PATCH", "/api/v1/formation", content=b" " * 65_000 + b'{"radius_m": 12}', headers=json_type)
    assert (padded.status_code, padded.json()["radius_m"]) == (200, 12.0)


@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:9999", "null", "https://["])
def test_a_foreign_web_page_may_not_command(api: Api, origin: str) -> None:
    answer = api("POST", "/api/v1/show/start", headers={"Origin": origin})
    assert (answer.status_code, answer.json()["problems"]) == (403, [])
    assert api.service.show is ShowPhase.IDLE


def test_a_page_of_this_service_may_command(api: Api) -> None:
    assert api("POST", "/api/v1/show/start", headers={"Origin": "http://127.0.0.1"}).status_code == 202


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("localhost:8000", 200),
        ("LOCALHOST", 200),
        ("192.168.1.7:8000", 200),
        ("[::1]:8000", 200),
        ("evil.example:8000", 403),
        ("", 403),
        ("[::1", 403),
    ],
)
def test_only_addresses_and_known_names_are_answered(api: Api, host: str, status: int) -> None:
    assert api("GET", "/api/v1/fleet", headers={"Host": host}).status_code == status


def test_a_name_can_be_made_known() -> None:
    api = Api()
    api.app = create_app(FakeService(), host_names=["station.local"])
    assert api("GET", "/api/v1/show", headers={"Host": "station.local:8000"}).status_code == 200
    assert api("GET", "/api/v1/show", headers={"Host": "localhost"}).status_code == 403


def test_a_caller_that_goes_while_sending_changes_nothing() -> None:
    service = FakeService()
    sent: list[dict[str, Any]] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.disconnect"}

    async def send(message: Any) -> None:
        sent.append(message)

    scope: dict[str, Any] = {
        "type": "http",
        "method": "POST",
        "path": "/api/v1/show/start",
        "raw_path": b"/api/v1/show/start",
        "query_string": b"",
        "headers": [(b"host", b"127.0.0.1"), (b"content-length", b"20")],
        "http_version": "1.1",
        "scheme": "http",
        "server": ("127.0.0.1", 80),
        "client": ("127.0.0.1", 5),
        "root_path": "",
    }
    asyncio.run(create_app(service)(scope, receive, send))
    assert sent == []
    assert service.show is ShowPhase.IDLE
