"""What the server answers by itself, and what it writes into the log, over real TCP."""

import asyncio
import json
import logging
import time
from pathlib import Path

import pytest
import websockets
from websockets.asyncio.client import connect

from gcs.api import server
from gcs.api.auth.authorization import AUDIT_BURST, AUDIT_PER_S, Authorization
from gcs.api.auth.tokens import Tokens, create_token
from gcs.api.schemas import reports
from gcs.api.server import CONNECTIONS_MAX, LINES_BURST, LINES_PER_S
from gcs.service.access import Denied, Role
from tests.support.api_fake_service import FakeService
from tests.support.api_station import run, served

UPGRADE = "Host: 127.0.0.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
KEY = "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"


async def asked(port: int, request: str) -> tuple[int, dict[str, str], bytes]:
    """Status, headers in small letters and body of what is answered to bytes."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(request.encode())
    answer = await asyncio.wait_for(reader.read(), timeout=120)
    writer.close()
    head, _, body = answer.partition(b"\r\n\r\n")
    lines = head.decode().splitlines()
    headers = dict(line.lower().split(": ", 1) for line in lines[1:])
    return int(lines[0].split()[1]), headers, body


def check_shape(headers: dict[str, str], body: bytes) -> reports.ErrorBody:
    assert headers["content-type"] == "application/json"
    assert headers["x-content-type-options"] == "nosniff"
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    return reports.ErrorBody.model_validate(json.loads(body))


@pytest.mark.parametrize(
    ("request_text", "status"),
    [
        ("GET /healthz HTTP/1.1\r\nHost 127.0.0.1\r\n\r\n", 400),
        ("\x16\x03\x01\x02\r\n\r\n", 400),
        (f"GET /api/v1/stream HTTP/1.1\r\n{UPGRADE}\r\n", 400),
        (f"GET /api/v1/nothing HTTP/1.1\r\n{UPGRADE}{KEY}\r\n", 403),
    ],
)
def test_invalid_http_and_handshakes_get_the_one_error_shape(request_text: str, status: int) -> None:
    async def main(_service: FakeService, port: int) -> None:
        answered, headers, body = await asked(port, request_text)
        assert answered == status
        assert check_shape(headers, body).detail

    run(main)


CLOSE = "Host: elsewhere.example\r\nConnection: close\r\n"


@pytest.mark.parametrize(
    ("target", "same_as"),
    [
        ("http://127.0.0.1:{port}/api/v1/show", "/api/v1/show"),
        ("HTTP://localhost/api/v1/vehicles/d%31", "/api/v1/vehicles/d1"),
        ("http://[::1]:{port}/api/v1/replay?x=http://a/", "/api/v1/replay"),
        ("http://127.0.0.1:{port}", "/"),
        ("http://127.0.0.1:{port}/nothing", "/nothing"),
    ],
)
def test_absolute_target_is_answered_by_path_and_checked_host(target: str, same_as: str) -> None:
    async def main(_service: FakeService, port: int) -> None:
        absolute = await asked(port, f"GET {target.format(port=port)} HTTP/1.1\r\n{CLOSE}\r\n")
        origin = await asked(port, f"GET {same_as} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
        assert (absolute[0], absolute[2]) == (origin[0], origin[2])

    run(main)


@pytest.mark.parametrize(
    ("target", "status", "says"),
    [
        ("http://elsewhere.example/api/v1/show", 403, "elsewhere.example"),
        ("http:///api/v1/show", 400, "names no host"),
        ("http://127.0.0.1:65536/api/v1/show", 400, "names no host and port"),
        ("http://127.0.0.1:x/api/v1/show", 400, "names no host and port"),
        ("http://[::1/api/v1/show", 400, "names no host"),
        ("http://gcs_secret@127.0.0.1/api/v1/show", 400, "tokens go into Authorization"),
        ("https://127.0.0.1/api/v1/show", 400, "http:// alone"),
        ("ftp://127.0.0.1/api/v1/show", 400, "the scheme is 'ftp'"),
    ],
)
def test_a_bad_absolute_target_is_refused_with_the_reason(target: str, status: int, says: str) -> None:
    async def main(_service: FakeService, port: int) -> None:
        request = f"GET {target} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"
        answered, headers, body = await asked(port, request)
        assert answered == status
        assert says in check_shape(headers, body).detail

    run(main)


@pytest.mark.parametrize(
    ("target", "status"),
    [
        ("http://127.0.0.1/api/v1/stream", 101),
        ("ws://127.0.0.1/api/v1/stream", 101),
        ("https://127.0.0.1/api/v1/stream", 400),
        ("http://elsewhere.example/api/v1/stream", 403),
    ],
)
def test_stream_opens_by_its_absolute_target(target: str, status: int) -> None:
    async def main(_service: FakeService, port: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(f"GET {target} HTTP/1.1\r\n{UPGRADE}{KEY}\r\n".encode())
        line = await asyncio.wait_for(reader.readline(), timeout=30)
        writer.close()
        assert int(line.split()[1]) == status

    run(main, tick_s=0.1)


def test_connection_above_the_limit_is_503_and_rarely_logged(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "CROWDED_S", 120.0)  # those that say nothing stay until this test has ended

    async def main(_service: FakeService, port: int) -> None:
        held = [await asyncio.open_connection("127.0.0.1", port) for _ in range(CONNECTIONS_MAX)]
        text = "GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
        for _ in range(50):
            status, headers, body = await asked(port, text)
            assert (status, headers["retry-after"], headers["connection"]) == (503, "1", "close")
            assert str(CONNECTIONS_MAX) in check_shape(headers, body).detail
        for _, writer in held:
            writer.close()

    began_s = time.monotonic()
    with caplog.at_level(logging.WARNING):
        run(main)
    most = LINES_BURST + LINES_PER_S * (time.monotonic() - began_s) + 2
    assert 1 <= sum("connections" in line.getMessage() for line in caplog.records) <= most


def test_denied_handshakes_log_no_server_lines_and_few_audits(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    count = int(AUDIT_BURST) + 60
    denied: list[Denied] = []
    file = tmp_path / "tokens.json"
    create_token(file, "crew", Role.WATCH)

    async def main() -> None:
        authorization = Authorization(Tokens(file), audit=denied.append, clock_s=lambda: 0.0)
        async with asyncio.timeout(240), served(FakeService(), authorization) as port:
            for _ in range(count):
                with pytest.raises(websockets.InvalidStatus) as refused:
                    await connect(f"ws://127.0.0.1:{port}/api/v1/stream")
                assert refused.value.response.status_code == 401
            await asyncio.sleep(1.1)

    with caplog.at_level(logging.INFO):
        asyncio.run(main())
    assert [line for line in caplog.records if line.name.startswith("uvicorn") and line.levelno >= 30] == []
    assert sum(each.count for each in denied) == count
    assert len(denied) <= AUDIT_BURST + AUDIT_PER_S
