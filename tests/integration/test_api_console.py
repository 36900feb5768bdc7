"""The console's stream over real TCP: status and frames, who is slow, who is shown out."""

import asyncio
import json
import socket
import struct
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import websockets
from websockets.asyncio.client import ClientConnection, connect

from gcs.api.auth.authorization import Authorization
from gcs.api.auth.tokens import Tokens, create_token, revoke_token
from gcs.api.context import VIEWERS_MAX
from gcs.api.schemas import binary_frame as frames
from gcs.model.plan import Formation
from gcs.service.access import Role
from tests.support.api_fake_service import FakeService
from tests.support.api_station import narrow, served, ticking
from tests.support.api_station import run as run_beside

TICK_S = 0.02


def run(main: Callable[[FakeService, int], Awaitable[None]], count: int = 3) -> None:
    """Beside a service that ticks."""
    run_beside(main, count, TICK_S)


def console_of(port: int, query: str = "", **options: Any) -> connect:
    return connect(f"ws://127.0.0.1:{port}/api/v1/stream/console{query}", **options)


async def next_of(viewer: ClientConnection, kind: type) -> Any:
    """The next status, or header of a frame."""
    while True:
        message = await asyncio.wait_for(viewer.recv(), timeout=120)
        if isinstance(message, kind):
            return json.loads(message) if isinstance(message, str) else header_of(message)


async def until_closed(viewer: ClientConnection) -> None:
    while True:
        await asyncio.wait_for(viewer.recv(), timeout=120)


def header_of(message: str | bytes) -> Any:
    assert isinstance(message, bytes)
    return np.frombuffer(message, frames.HEADER, 1)[0]


def content(status: dict[str, Any]) -> dict[str, Any]:
    """What a status says, without its time and its number."""
    return {name: status[name] for name in status.keys() - {"time_s", "unix_time_s", "revision"}}


async def watched(
    viewer: ClientConnection, status: dict[str, Any], count: int
) -> tuple[dict[str, Any], list[Any]]:
    """The next `count` frames, which belong to the newest status, and this; a status comes when it changes.

    While the machine pauses control is late, and that is a change.
    """
    seen: list[Any] = []
    while len(seen) < count:
        message = await asyncio.wait_for(viewer.recv(), timeout=120)
        if isinstance(message, bytes):
            seen.append(header_of(message))
            assert seen[-1]["revision"] == status["revision"]
        else:
            newer = json.loads(message)
            assert newer["revision"] == status["revision"] + 1
            assert content(newer) != content(status)
            status = newer
    return status, seen


@pytest.mark.usefixtures("patient_api")
def test_the_status_comes_first_then_frames_that_belong_to_it() -> None:
    async def main(service: FakeService, port: int) -> None:
        service.fly()
        service.happen("formation: offboard", "d1")
        async with console_of(port, "?rate_hz=20") as viewer, httpx.AsyncClient() as http:
            status = json.loads(await viewer.recv())
            answered: dict[str, Any] = {"revision": -1}
            while status["revision"] != answered["revision"]:  # the machine paused between: control was late
                if status["revision"] < answered["revision"]:
                    status = await next_of(viewer, str)
                else:
                    answered = (await http.get(f"http://127.0.0.1:{port}/api/v1/status")).json()
            assert content(status) == content(answered)
            assert [each["id"] for each in status["vehicles"]] == ["d1", "d2", "d3"]
            assert status["vehicles"][1]["home"] == {"x_m": 0.0, "y_m": 5.0, "height_m": 0.0}
            assert status["flight_envelope"]["height_max_m"] == 100.0
            assert status["limits"] == ["separation from d9"]
            assert [each["text"] for each in status["events"]] == ["formation: offboard"]
            assert status["replay"] is None
            _, seen = await watched(viewer, status, 5)
        counts = [int(each["tick_count"]) for each in seen]
        assert counts == sorted(set(counts))

    run(main)


def test_changes_are_sent_with_the_next_revision_only() -> None:
    async def main(service: FakeService, port: int) -> None:
        async with console_of(port, "?rate_hz=20") as viewer:
            first, _ = await watched(viewer, await next_of(viewer, str), 20)  # a second
            service.plan.set_formation(Formation(12.0, 30.0))
            second = await next_of(viewer, str)
            while second["formation"]["radius_m"] != 12.0:  # control was late just then
                second = await next_of(viewer, str)
            await watched(viewer, second, 1)
        assert first["formation"]["radius_m"] == 10.0
        assert second["revision"] > first["revision"]
        assert second["began_unix_time_s"] == first["began_unix_time_s"] < first["unix_time_s"]

    run(main)


def test_frame_reports_that_control_has_stopped() -> None:
    async def main(service: FakeService, port: int) -> None:
        async with console_of(port) as viewer:
            while not (await next_of(viewer, bytes))["control_alive"]:
                pass
            service.control_alive = False
            while (await next_of(viewer, bytes))["control_alive"]:
                pass
            assert "no tick" in (await next_of(viewer, str))["control_reason"]

    run(main)


def test_all_viewers_are_sent_the_same_bytes_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[bytes] = []
    encode = frames.encode

    def counted(*arguments: Any, **named: Any) -> bytes:
        made.append(encode(*arguments, **named))
        return made[-1]

    monkeypatch.setattr(frames, "encode", counted)

    async def main(_: FakeService, port: int) -> None:
        async with asyncio.TaskGroup() as group:
            watching = [group.create_task(watch(port)) for _ in range(5)]
        seen = [message for each in watching for message in each.result()]
        assert set(seen) <= set(made)
        assert len(made) < len(seen) / 2

    async def watch(port: int) -> list[bytes]:
        async with console_of(port, "?rate_hz=20") as viewer:
            got = [await viewer.recv() for _ in range(41)]
        return [message for message in got if isinstance(message, bytes)]

    run(main)


def test_slow_reader_delays_no_other_and_gets_the_newest() -> None:
    async def main(service: FakeService, port: int) -> None:
        options = {"sock": narrow(port), "max_queue": 1, "compression": None}
        async with (
            console_of(port, "?rate_hz=20", **options) as slow,
            console_of(port, "?rate_hz=20") as quick,
        ):
            seen = [int((await next_of(quick, bytes))["tick_count"]) for _ in range(60)]
            missed = service.ticks
            late = [int((await next_of(slow, bytes))["tick_count"]) for _ in range(12)]
        assert max(np.diff(seen)) < 40
        assert late == sorted(set(late))
        assert max(np.diff(late)) > 20  # by leaving out, not by catching up
        assert late[-1] >= missed

    run(main, count=1000)


@pytest.mark.parametrize("rate", ["0", "21", "nan", "fast"])
def test_a_bad_rate_is_reported(rate: str) -> None:
    async def main(_: FakeService, port: int) -> None:
        async with console_of(port, f"?rate_hz={rate}") as viewer:
            with pytest.raises(websockets.ConnectionClosed):
                await viewer.recv()
            assert (viewer.close_code, viewer.close_reason) == (
                1008,
                f"rate_hz = {rate}: a number from 1 to 20",
            )

    run(main)


def test_token_is_required_and_revoking_it_ends_the_stream(tmp_path: Path) -> None:
    file = tmp_path / "tokens.json"
    token = create_token(file, "screen", Role.WATCH)

    async def main() -> None:
        authorization = Authorization(Tokens(file))
        service = FakeService()
        async with asyncio.timeout(240), served(service, authorization) as port, ticking(service, TICK_S):
            with pytest.raises(websockets.InvalidStatus) as refused:
                await console_of(port)
            assert refused.value.response.status_code == 401
            offered = [websockets.Subprotocol("gcs.v1"), websockets.Subprotocol(f"bearer.{token}")]
            async with console_of(port, subprotocols=offered) as viewer, httpx.AsyncClient() as http:
                url, header = f"http://127.0.0.1:{port}/api/v1/access", {"Authorization": f"Bearer {token}"}
                assert (await http.get(url)).status_code == 401
                assert (await http.get(url, headers=header)).json() == {"name": "screen", "rights": ["watch"]}
                await next_of(viewer, bytes)
                revoke_token(file, "screen")
                with pytest.raises(websockets.ConnectionClosed):
                    await until_closed(viewer)
                assert (viewer.close_code, viewer.close_reason) == (1008, "the token was revoked")

    asyncio.run(main())


def test_without_tokens_every_local_caller_may_do_everything() -> None:
    async def main(_: FakeService, port: int) -> None:
        async with httpx.AsyncClient() as http:
            reported = (await http.get(f"http://127.0.0.1:{port}/api/v1/access")).json()
        assert reported == {"name": "local", "rights": ["emergency", "operate", "watch"]}

    run(main)


async def cut_off(port: int) -> bool:
    """Whether there was a seat; a viewer took it, and is gone without a word."""
    viewer = await console_of(port)
    try:
        await viewer.recv()
    except websockets.ConnectionClosed:
        return False
    linger = struct.pack("ii", 1, 0)
    viewer.transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
    viewer.transport.abort()
    return True


def test_viewers_that_disconnect_free_their_slots() -> None:
    seated = 0

    async def main(service: FakeService, port: int) -> None:
        nonlocal seated
        for _ in range(10 * VIEWERS_MAX):  # a seat is free a moment after it was left
            seated += await cut_off(port)
            if seated == VIEWERS_MAX + 8:
                return

    run(main)
    assert seated == VIEWERS_MAX + 8, "seats of those who are gone stay taken"
