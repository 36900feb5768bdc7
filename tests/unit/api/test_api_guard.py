import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest

from gcs.api.app import create_app
from gcs.api.auth.authorization import Authorization
from gcs.api.auth.middleware import DRAIN_MAX_BYTES
from gcs.api.schemas.requests import BODY_MAX_BYTES
from gcs.model.lifecycle import ShowPhase
from gcs.service import CommandRecord
from tests.support.api_fake_service import FakeService
from tests.support.api_harness import Api


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


def test_oversized_chunked_body_is_413_and_smaller_is_read(api: Api) -> None:
    assert api("POST", "/api/v1/show/start", content=chunks(5, 16 * 1024)).status_code == 413
    assert api.service.show is ShowPhase.IDLE
    json_type = {"Content-Type": "application/json"}
    padded = api("PATCH", "/api/v1/formation", content=b" " * 65_000 + b'{"radius_m": 12}', headers=json_type)
    assert (padded.status_code, padded.json()["radius_m"]) == (200, 12.0)


@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:9999", "null", "https://["])
def test_foreign_web_page_may_not_command(api: Api, origin: str) -> None:
    answer = api("POST", "/api/v1/show/start", headers={"Origin": origin})
    assert (answer.status_code, answer.json()["problems"]) == (403, [])
    assert api.service.show is ShowPhase.IDLE


def test_a_page_of_this_service_may_command(api: Api) -> None:
    assert api("POST", "/api/v1/show/start", headers={"Origin": "http://127.0.0.1"}).status_code == 202


NO_CORS = {"Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"}
LINK = {"Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
FRAME = {"Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "iframe"}


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_cross_site_embeds_are_refused_before_being_counted(site: str) -> None:
    clock_s = 0.0
    authorization = Authorization(calls_per_s=1.0, burst=3.0, clock_s=lambda: clock_s, audit=lambda _: None)
    api = Api()
    api.app = create_app(api.service, authorization=authorization)
    for headers in (NO_CORS, FRAME) * 20:
        answer = api("GET", "/api/v1/fleet", headers={"Sec-Fetch-Site": site, **headers})
        assert (answer.status_code, answer.json()["problems"]) == (403, [])
    own = {"Sec-Fetch-Site": "same-origin", "Sec-Fetch-Mode": "cors", "Sec-Fetch-Dest": "empty"}
    assert [api("GET", "/api/v1/fleet", headers=own).status_code for _ in range(4)] == [200, 200, 200, 429]


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/docs", {"Sec-Fetch-Site": "cross-site", **LINK}, 200),  # somebody followed a link
        ("/docs", {"Sec-Fetch-Site": "cross-site", **FRAME}, 403),
        ("/api/v1/fleet", {"Sec-Fetch-Site": "cross-site", **LINK}, 403),
        ("/api/v1/fleet", {"Sec-Fetch-Site": "none", **LINK}, 200),  # typed into the browser
    ],
)
def test_link_from_another_site_reaches_pages_only(
    api: Api, path: str, headers: dict[str, str], status: int
) -> None:
    assert api("GET", path, headers=headers).status_code == status


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/api/v1/fleet", 200),
        ("GET", "/openapi.json", 200),
        ("GET", "/docs", 200),
        ("GET", "/metrics", 200),
        ("GET", "/nothing", 404),
        ("DELETE", "/api/v1/fleet", 405),
        ("OPTIONS", "/api/v1/fleet", 204),
        ("PATCH", "/api/v1/formation", 422),
        ("POST", "/api/v1/show/stop", 500),
    ],
)
def test_no_answer_can_be_framed_or_sniffed(method: str, path: str, status: int) -> None:
    class Broken(FakeService):
        def command_show(self, *_: object, **__: object) -> CommandRecord:
            raise ZeroDivisionError

    answer = Api(Broken())(method, path)
    assert answer.status_code == status
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["x-frame-options"] == "DENY"
    assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]
    assert "unsafe" not in answer.headers["content-security-policy"]


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


def test_host_name_can_be_configured() -> None:
    api = Api()
    api.app = create_app(FakeService(), host_names=["station.local"])
    assert api("GET", "/api/v1/show", headers={"Host": "station.local:8000"}).status_code == 200
    assert api("GET", "/api/v1/show", headers={"Host": "localhost"}).status_code == 403


def test_caller_that_disconnects_while_sending_changes_nothing() -> None:
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
