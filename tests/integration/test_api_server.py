"""The server and the stream over real TCP."""

import asyncio
import json
import socket
import threading
import time
from contextlib import suppress
from itertools import pairwise
from typing import Any

import httpx
import pytest
import websockets
from websockets.asyncio.client import ClientConnection, connect

from gcs.api.app import create_app
from gcs.api.context import VIEWERS_MAX
from gcs.api.server import CONNECTIONS_MAX, serve
from gcs.model.errors import LinkError
from tests.support.api_fake_service import FakeService
from tests.support.api_station import narrow, run, served, ticking


def stream_of(port: int, query: str = "", **options: Any) -> connect:
    return connect(f"ws://127.0.0.1:{port}/api/v1/stream{query}", **options)


async def closed(viewer: ClientConnection) -> None:
    """Read what is left, until the server closes."""
    async with asyncio.timeout(120):
        with suppress(websockets.ConnectionClosed):
            async for _ in viewer:
                pass


async def frame_of(viewer: ClientConnection) -> dict[str, Any]:
    frame: dict[str, Any] = json.loads(await asyncio.wait_for(viewer.recv(), timeout=120))
    return frame


def test_serves_over_tcp_and_stops_cleanly_with_viewers() -> None:
    async def main(service: FakeService, port: int) -> None:
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}") as http, stream_of(port) as viewer:
            assert (await http.get("/api/v1/fleet")).json()["show"]["phase"] == "idle"
            assert (await frame_of(viewer))["show"]["phase"] == "idle"
            stopping.append(viewer)

    stopping: list[ClientConnection] = []
    run(main)
    assert stopping[0].close_code == 1000


def test_stopping_the_server_closes_viewers_and_frees_the_port() -> None:
    async def main() -> None:
        async with asyncio.timeout(240):
            async with served(FakeService()) as port:
                viewer = await stream_of(port)
                await frame_of(viewer)
            await closed(viewer)
            assert viewer.close_code == 1012  # service restart
            with socket.socket() as again:
                again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                again.bind(("127.0.0.1", port))

    asyncio.run(main())


def test_viewer_that_reads_nothing_does_not_delay_the_stop() -> None:
    async def main() -> None:
        service = FakeService(count=100)
        async with asyncio.timeout(240):
            async with served(service) as port, ticking(service, 0.05):
                stuck = await stalled_viewer(port)
                await asyncio.sleep(1.0)
            stuck.close()

    before = set(threading.enumerate())
    asyncio.run(main())
    assert set(threading.enumerate()) <= before


async def stalled_viewer(port: int) -> socket.socket:
    """A viewer that shakes hands and then reads nothing, with little room for what it does not read."""
    loop = asyncio.get_running_loop()
    viewer = socket.socket()
    viewer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    viewer.setblocking(False)
    await loop.sock_connect(viewer, ("127.0.0.1", port))
    lines = [
        "GET /api/v1/stream?rate_hz=20 HTTP/1.1",
        "Host: 127.0.0.1",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version: 13",
    ]
    request = "\r\n".join([*lines, "", ""])
    await loop.sock_sendall(viewer, request.encode())
    return viewer


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_a_port_in_use_is_reported_as_such(host: str) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(LinkError, match=f"port {port} is in use on {host}"):
            asyncio.run(serve(create_app(FakeService()), host, port))


@pytest.mark.parametrize(
    ("host", "port"), [("no.such.host.invalid", 8000), ("203.0.113.7", 8000), ("127.0.0.1", 70000)]
)
def test_unavailable_address_is_reported(host: str, port: int) -> None:
    with pytest.raises(LinkError, match=f"cannot listen on {host} port {port}"):
        asyncio.run(serve(create_app(FakeService()), host, port))


async def until_green(http: httpx.AsyncClient) -> None:
    """At once, unless the machine stands still between a tick and the answer."""
    for _ in range(400):
        await asyncio.sleep(0.05)
        if (await http.get("/healthz")).status_code == 200:
            return
    raise AssertionError("not green")


def test_health_is_red_without_ticks_and_green_with_them() -> None:
    async def main(service: FakeService, port: int) -> None:
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}") as http:
            async with ticking(service, 0.05):
                await until_green(http)
            await asyncio.sleep(1.2)
            red = await http.get("/healthz")
            assert (red.status_code, red.json()["problems"]) == (503, [])
            async with ticking(service, 0.05):
                await until_green(http)

    run(main)


def test_stream_sends_snapshots_at_the_requested_rate() -> None:
    async def main(service: FakeService, port: int) -> None:
        service.fly()
        async with stream_of(port, "?rate_hz=20") as viewer, httpx.AsyncClient(timeout=30.0) as http:
            frame = await frame_of(viewer)
            fleet = (await http.get(f"http://127.0.0.1:{port}/api/v1/fleet")).json()
            while not (frame["control_alive"] and fleet["control_alive"]):  # not looked at within a second
                service.tick()
                while frame["tick"]["count"] < service.ticks:
                    frame = await frame_of(viewer)
                fleet = (await http.get(f"http://127.0.0.1:{port}/api/v1/fleet")).json()
            assert frame == fleet
            assert {"show", "center", "target", "obstacles", "vehicles"} <= frame.keys()
            async with ticking(service, 0.01):
                for _ in range(20):
                    begin_s = time.monotonic()
                    counts = [(await frame_of(viewer))["tick"]["count"] for _ in range(11)]
                    assert counts == sorted(set(counts))
                    if time.monotonic() - begin_s > 0.35:  # 0.5, but for what came while the machine paused
                        return
        raise AssertionError("frames come faster")

    run(main)


def test_stream_reports_that_control_stopped_without_new_state() -> None:
    async def main(service: FakeService, port: int) -> None:
        async with stream_of(port, "?rate_hz=10") as viewer:
            async with ticking(service, 0.05):
                first = await frame_of(viewer)
                while not first["control_alive"]:
                    first = await frame_of(viewer)
            last = service.ticks
            second = await frame_of(viewer)
            while second["control_alive"]:  # those on their way
                second = await frame_of(viewer)
        assert second["tick"]["count"] == last
        assert "does not run" in second["control_reason"]

    run(main)


def longest_step(counts: list[int]) -> int:
    return max(later - earlier for earlier, later in pairwise(counts))


def test_slow_reader_skips_to_the_newest_frame_delaying_none() -> None:
    async def main(service: FakeService, port: int) -> None:
        options = {"sock": narrow(port), "max_queue": 1, "compression": None}
        async with (
            stream_of(port, "?rate_hz=20", **options) as slow,
            stream_of(port, "?rate_hz=20") as quick,
            ticking(service, 0.02),
        ):
            seen = [(await frame_of(quick))["tick"]["count"] for _ in range(40)]
            while seen[-1] - seen[0] < 80:
                seen.append((await frame_of(quick))["tick"]["count"])
            missed = service.ticks
            late = [(await frame_of(slow))["tick"]["count"] for _ in range(12)]
        assert longest_step(seen) < 40  # the slow one did not delay the quick one
        assert late == sorted(set(late))
        assert late[-1] >= missed  # within a few frames the slow one is at the present,
        assert longest_step(late) > 40  # by leaving out, not by catching up

    async def with_a_large_fleet() -> None:
        service = FakeService(count=100)
        async with asyncio.timeout(240), served(service) as port:
            await main(service, port)

    asyncio.run(with_a_large_fleet())


@pytest.mark.parametrize("rate", ["0", "0.99", "21", "-5", "nan", "inf", "fast", ""])
def test_a_bad_rate_is_closed_with_1008_and_the_reason(rate: str) -> None:
    async def main(_: FakeService, port: int) -> None:
        async with stream_of(port, f"?rate_hz={rate}") as viewer:
            with pytest.raises(websockets.ConnectionClosed):
                await viewer.recv()
            assert viewer.close_code == 1008
            assert viewer.close_reason == f"rate_hz = {rate}: a number from 1 to 20"

    run(main)


async def phase_if_seated(port: int) -> str:
    async with stream_of(port) as viewer:
        with suppress(websockets.ConnectionClosed):
            return str((await frame_of(viewer))["show"]["phase"])
    return ""


def test_viewer_above_the_limit_may_retry_and_a_slot_is_free() -> None:
    async def main(_: FakeService, port: int) -> None:
        viewers = [await stream_of(port) for _ in range(VIEWERS_MAX)]
        for viewer in viewers:
            await frame_of(viewer)
        async with stream_of(port) as late:
            with pytest.raises(websockets.ConnectionClosed):
                await late.recv()
            assert late.close_code == 1013
        await viewers[0].close()
        while await phase_if_seated(port) != "idle":  # a moment later
            pass
        await asyncio.gather(*(viewer.close() for viewer in viewers))

    run(main)


def test_viewer_messages_are_ignored_and_a_flood_disconnects() -> None:
    async def main(service: FakeService, port: int) -> None:
        async with stream_of(port, "?rate_hz=20") as viewer, ticking(service, 0.02):
            for text in ("hello", b"\x00", '{"radius_m": 1}'):
                await viewer.send(text)
                await frame_of(viewer)
            await viewer.send("x" * 5000)
            await closed(viewer)
            assert viewer.close_code == 1009  # too big

    run(main)


def test_cross_origin_page_is_refused_the_stream() -> None:
    async def main(_: FakeService, port: int) -> None:
        with pytest.raises(websockets.InvalidStatus) as refused:
            await stream_of(port, origin="http://evil.example")
        assert refused.value.response.status_code == 403
        async with stream_of(port, origin=f"http://127.0.0.1:{port}") as viewer:
            assert (await frame_of(viewer))["show"]["phase"] == "idle"

    run(main)


def test_silent_or_partial_requests_block_no_other() -> None:
    async def main(service: FakeService, port: int) -> None:
        silent = [await asyncio.open_connection("127.0.0.1", port) for _ in range(CONNECTIONS_MAX)]
        for _, writer in silent[::2]:
            writer.write(b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n")
        for reader, _ in silent[: CONNECTIONS_MAX // 4]:
            with suppress(ConnectionError):
                assert await asyncio.wait_for(reader.read(), timeout=60.0) == b""
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}") as http:
            answer = await http.get("/api/v1/show")
            assert (answer.status_code, answer.json()["phase"]) == (200, service.show)
        for _, writer in silent:
            writer.close()

    run(main)


@pytest.mark.parametrize("size", [70_000, 900_000])
def test_oversized_body_is_answered_before_the_close(size: int) -> None:
    async def main(_: FakeService, port: int) -> None:
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}") as http:
            assert (await http.patch("/api/v1/formation", content=b" " * size)).status_code == 413
            assert (await http.get("/api/v1/show")).status_code == 200

    run(main)
