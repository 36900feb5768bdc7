"""Reports of a target over a WebSocket: good ones are taken, bad ones answered, too many dropped."""

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest
import websockets
from websockets.asyncio.client import ClientConnection, connect

from gcs.api.auth.authorization import SUBPROTOCOL, Authorization
from gcs.api.auth.tokens import Tokens, create_token
from gcs.api.context import VIEWERS_MAX
from gcs.api.routes.target_reports import RATE_MAX_HZ
from gcs.service import Call, NoAudit
from gcs.service.access import Role
from tests.support.api_fake_service import FakeService
from tests.support.api_station import run, served

PLACE = {"latitude_deg": 47.3977, "longitude_deg": 8.5456, "north_m_s": 1.5, "source_s": 12.25}


class Audited(NoAudit):
    """Keeps the calls."""

    def __init__(self) -> None:
        self.calls: list[Call] = []

    def call(self, call: Call) -> None:
        self.calls.append(call)


def reports_of(port: int, name: str = "boat", **options: Any) -> connect:
    return connect(f"ws://127.0.0.1:{port}/api/v1/targets/{name}/reports", **options)


async def answer_of(sender: ClientConnection, message: str | bytes) -> dict[str, Any]:
    await sender.send(message)
    answer: dict[str, Any] = json.loads(await asyncio.wait_for(sender.recv(), timeout=120))
    return answer


async def arrived(service: FakeService, count: int) -> None:
    async with asyncio.timeout(120):
        while len(service.plan.reported) < count:  # noqa: ASYNC110
            await asyncio.sleep(0.01)


def test_reports_are_taken_and_not_answered() -> None:
    """The audit has the connection, not each report."""

    async def main(service: FakeService, port: int) -> None:
        service.audit = audit = Audited()
        async with reports_of(port) as sender:
            await sender.send(json.dumps(PLACE))
            await sender.send(json.dumps(PLACE).encode())
            await arrived(service, 2)
            fix = service.plan.reported[0]
            assert (fix.latitude_deg, fix.north_m_s, fix.source_s) == (47.3977, 1.5, 12.25)
            problem = await answer_of(sender, "{}")
        assert [each["field"] for each in problem["problems"]] == ["latitude_deg", "longitude_deg"]
        (call,) = audit.calls
        assert (call.method, call.path) == ("WEBSOCKET", "/api/v1/targets/boat/reports")

    run(main)


@pytest.mark.parametrize(
    ("message", "detail"),
    [
        ("hello", "JSON; at character 0"),
        ("[1]", "a JSON object"),
        ("[" * 4000, "levels deep"),
        ('{"latitude_deg": 1, "latitude_deg": 2}', "given once, not twice"),
        (json.dumps({**PLACE, "latitude_deg": 91}), "latitude_deg = 91: less than or equal to 90"),
        (json.dumps({**PLACE, "latitude_deg": float("nan")}), "latitude_deg = NaN"),
        (json.dumps({**PLACE, "speed": 3}), "speed = 3: not a field of this request"),
        (b"\xff\xfe", "JSON in UTF-8"),
    ],
)
def test_bad_report_is_answered_and_the_next_is_taken(message: str | bytes, detail: str) -> None:
    async def main(service: FakeService, port: int) -> None:
        async with reports_of(port) as sender:
            assert detail in (await answer_of(sender, message))["detail"]
            await sender.send(json.dumps(PLACE))
            await arrived(service, 1)

    run(main)


def test_target_that_takes_no_reports_is_named() -> None:
    async def main(_: FakeService, port: int) -> None:
        async with reports_of(port, "buoy") as sender:
            assert (await answer_of(sender, json.dumps(PLACE)))["detail"] == "there is no target 'buoy'"

    run(main)


def test_more_than_fifty_a_second_are_dropped_and_counted() -> None:
    async def main(service: FakeService, port: int) -> None:
        async with reports_of(port) as sender:
            many = int(RATE_MAX_HZ)
            for _ in range(20 * many):
                await sender.send(json.dumps(PLACE))
            await arrived(service, many)
            await asyncio.sleep(0.2)
            assert "were dropped unread: 50 a second may come" in (await answer_of(sender, "{}"))["detail"]
            assert len(service.plan.reported) < 10 * many
            await sender.send("x" * 5000)
            await sender.wait_closed()
            assert sender.close_code == 1009  # too big

    run(main)


def test_senders_have_slots_among_the_viewers() -> None:
    async def main(_: FakeService, port: int) -> None:
        senders = [await reports_of(port) for _ in range(VIEWERS_MAX)]
        for sender in senders:
            assert await answer_of(sender, "{}")
        async with reports_of(port) as late:
            await late.wait_closed()
            assert late.close_code == 1013
        await asyncio.gather(*(sender.close() for sender in senders))

    run(main)


def test_only_operators_may_report(tmp_path: Path) -> None:
    file = tmp_path / "tokens"
    watcher, operator = (create_token(file, role.value, role) for role in (Role.WATCH, Role.OPERATE))

    async def main() -> None:
        service = FakeService()
        authorization = Authorization(Tokens(file))
        async with asyncio.timeout(240), served(service, authorization) as port:
            for token, status in (("", 401), (watcher, 403)):
                headers = {"Authorization": f"Bearer {token}"} if token else {}
                with pytest.raises(websockets.InvalidStatus) as refused:
                    await reports_of(port, additional_headers=headers)
                assert refused.value.response.status_code == status
            offered = [SUBPROTOCOL, f"bearer.{operator}"]
            async with reports_of(port, subprotocols=offered) as sender:
                await sender.send(json.dumps(PLACE))
                await arrived(service, 1)

    asyncio.run(main())
