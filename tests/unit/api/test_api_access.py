"""Tokens and roles, rates, and what the audit is told."""

import asyncio
from pathlib import Path
from typing import Any

import httpx
import pytest

from gcs.api.app import create_app
from gcs.api.auth.authorization import AUDIT_BURST, Authorization
from gcs.api.auth.middleware import EmergencyLane
from gcs.api.auth.tokens import Tokens, create_token, revoke_token
from gcs.model.lifecycle import ShowPhase
from gcs.service.access import Denied, Role
from tests.support.api_fake_service import FakeService


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


class Station:
    """An app with a token of each role."""

    def __init__(self, folder: Path, **rates: float) -> None:
        self.file = folder / "tokens.json"
        self.tokens = {role.value: create_token(self.file, f"{role}-token", role) for role in Role}
        self.service, self.clock = FakeService(), Clock()
        self.denied: list[Denied] = []
        authorization = Authorization(
            Tokens(self.file), audit=self.denied.append, clock_s=self.clock, **rates
        )
        self.authorization = authorization
        self.app = create_app(self.service, authorization=authorization)
        self.service.tick()

    def __call__(self, role: str, method: str, path: str, **options: Any) -> httpx.Response:
        token = self.tokens.get(role, role)
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        return asyncio.run(self.ask(method, path, headers=headers | options.pop("headers", {}), **options))

    async def ask(self, method: str, path: str, *, lane: bool = False, **options: Any) -> httpx.Response:
        app = EmergencyLane(self.app, 8080) if lane else self.app
        transport = httpx.ASGITransport(app, raise_app_exceptions=False, client=("10.0.0.9", 5))
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            return await client.request(method, path, **options)


@pytest.fixture
def station(tmp_path: Path) -> Station:
    return Station(tmp_path)


READS = [
    *("/api/v1/fleet", "/api/v1/commands", "/api/v1/shows", "/api/v1/shows/lighthouse/check"),
    *("/metrics", "/api/v1/no-such-place"),
]
COMMANDS = [
    ("POST", "/api/v1/show/start"),
    ("POST", "/api/v1/show/resume"),
    ("POST", "/api/v1/vehicles/d1/join"),
    ("POST", "/api/v1/vehicles/d1/take-control"),
    ("POST", "/api/v1/vehicles/d1/confirm-down"),
    ("POST", "/api/v1/fleet/join"),
    ("POST", "/api/v1/fleet/take-control"),
    ("PATCH", "/api/v1/formation"),
    ("PUT", "/api/v1/target"),
    ("DELETE", "/api/v1/obstacles/land"),
    ("PUT", "/api/v1/shows/lighthouse"),
    ("DELETE", "/api/v1/shows/stop"),
    ("POST", "/api/v1/shows/stop/check"),
    ("POST", "/api/v1/shows/lighthouse/select"),
    ("POST", "/api/v1/shows"),
    ("POST", "/api/v1/show/seek"),
    ("POST", "/api/v1/show/deselect"),
    ("POST", "/api/v1/obstacles"),
    ("POST", "/api/v1/no-such-place"),
    ("POST", "/api/v1/obstacles/stop"),
    ("BREW", "/api/v1/show/stop"),
]
EMERGENCIES = [
    *(f"/api/v1/show/{action}" for action in ("pause", "stop", "abort")),
    *(f"/api/v1/vehicles/d1/{action}" for action in ("hold", "return", "land")),
    *(f"/api/v1/fleet/{action}" for action in ("hold", "return", "land")),
]


@pytest.mark.parametrize("path", READS)
def test_any_token_may_read_and_no_other_caller(station: Station, path: str) -> None:
    for role in Role:
        assert station(role.value, "GET", path).status_code in {200, 404}
    for token in ("", "gcs_guess"):
        answer = station(token, "GET", path)
        assert answer.status_code == 401
        assert answer.headers["www-authenticate"] == "Bearer"
        assert "gcs token create" in answer.json()["detail"]


@pytest.mark.parametrize(("method", "path"), COMMANDS)
def test_only_an_operator_may_command(station: Station, method: str, path: str) -> None:
    before = station.service.plan.current, station.service.show, dict(station.service.phases)
    assert station("", method, path).status_code == 401
    for role in ("watch", "emergency"):
        answer = station(role, method, path)
        assert answer.status_code == 403
        assert answer.json()["detail"] == f"{role}-token may not: this needs a token of role operate"
    assert (station.service.plan.current, station.service.show, dict(station.service.phases)) == before
    assert station("operate", method, path, json={}).status_code not in {401, 403}


@pytest.mark.parametrize("path", EMERGENCIES)
def test_emergency_token_can_land_and_a_viewer_token_cannot(station: Station, path: str) -> None:
    station.service.fly()
    assert station("", "POST", path).status_code == 401
    assert station("watch", "POST", path).status_code == 403
    assert station.service.show is ShowPhase.RUNNING
    assert station("emergency", "POST", path).status_code == 202
    station.service.fly()
    assert station("operate", "POST", path).status_code == 202


def test_probes_and_the_documentation_need_no_token(station: Station) -> None:
    station.service.tick()
    for path in ("/healthz", "/readyz", "/docs", "/openapi.json"):
        assert station("", "GET", path).status_code == 200, path


def test_command_records_the_name_of_its_token(station: Station) -> None:
    assert station("operate", "POST", "/api/v1/show/start").json()["by"] == "operate-token"
    station.service.fly()
    assert station("emergency", "POST", "/api/v1/show/stop").json()["by"] == "emergency-token"
    assert [command["by"] for command in station("watch", "GET", "/api/v1/commands").json()] == [
        "emergency-token",
        "operate-token",
    ]


def test_access_describes_its_own_rights(station: Station) -> None:
    assert station("", "GET", "/healthz").json()["access"] == "tokens"
    assert station("watch", "GET", "/api/v1/fleet").json()["access"] == "tokens"
    station.app = create_app(FakeService())
    assert station("", "GET", "/healthz").json()["access"].startswith("off: ")
    assert station("", "POST", "/api/v1/show/start").json()["by"] == "local"


def test_every_denied_call_is_reported(station: Station) -> None:
    station("", "GET", "/api/v1/fleet")
    station("watch", "PUT", "/api/v1/target")
    station("operate", "POST", "/api/v1/show/stop", headers={"Origin": "http://evil.example"})
    reported = [(each.caller, each.method, each.path, each.status, each.address) for each in station.denied]
    assert reported == [
        ("anonymous", "GET", "/api/v1/fleet", 401, "10.0.0.9"),
        ("watch-token", "PUT", "/api/v1/target", 403, "10.0.0.9"),
        ("operate-token", "POST", "/api/v1/show/stop", 403, "10.0.0.9"),
    ]
    assert "role operate" in station.denied[1].reason
    assert not any(token in str(station.denied) for token in station.tokens.values())


def test_revoked_token_is_refused(station: Station) -> None:
    assert station("operate", "GET", "/api/v1/show").status_code == 200
    revoke_token(station.file, "operate-token")
    assert station("operate", "GET", "/api/v1/show").status_code == 401


def test_each_token_has_a_rate_and_emergencies_another(tmp_path: Path) -> None:
    station = Station(tmp_path, calls_per_s=10.0, burst=5.0)
    assert [station("operate", "GET", "/api/v1/show").status_code for _ in range(7)] == [200] * 5 + [429] * 2
    late = station("operate", "GET", "/api/v1/show")
    assert (late.headers["retry-after"], late.json()["detail"]) == (
        "1",
        "too many calls: 10 a second may come",
    )
    assert station("watch", "GET", "/api/v1/show").status_code == 200
    station.service.fly()
    assert station("operate", "POST", "/api/v1/show/stop").status_code == 202
    station.clock.now_s += 0.35
    assert [station("operate", "GET", "/api/v1/show").status_code for _ in range(4)] == [200] * 3 + [429]


def test_junk_on_emergency_paths_uses_no_emergency_rate(tmp_path: Path) -> None:
    station = Station(tmp_path, calls_per_s=1.0, burst=3.0)
    junk = [station("", "POST", "/api/v1/show/stop").status_code for _ in range(5)]
    assert junk == [401, 401, 401, 429, 429]
    assert [station("watch", "POST", "/api/v1/show/stop").status_code for _ in range(4)] == [403] * 3 + [429]
    station.service.fly()
    assert station("emergency", "POST", "/api/v1/show/stop").status_code == 202


def test_probes_are_answered_during_a_flood(tmp_path: Path) -> None:
    station = Station(tmp_path, calls_per_s=1.0, burst=2.0)
    assert [station("", "GET", "/openapi.json").status_code for _ in range(3)] == [200, 200, 429]
    assert [station("", "GET", path).status_code for path in ("/healthz", "/readyz") * 5] == [200] * 10
    assert station("", "POST", "/healthz").status_code == 429


def test_a_flood_of_denied_calls_is_summed_up(station: Station) -> None:
    async def flood(count: int) -> None:
        for _ in range(count):
            await station.ask("GET", "/api/v1/fleet")
        await asyncio.sleep(1.1)

    asyncio.run(flood(int(AUDIT_BURST) + 40))
    # one line a second more, where the machine takes long for so many calls
    assert sum(each.count for each in station.denied) == AUDIT_BURST + 40
    assert AUDIT_BURST < len(station.denied) < AUDIT_BURST + 20
    assert station.authorization.denied == AUDIT_BURST + 40


def test_emergency_lane_answers_emergency_calls_only(station: Station) -> None:
    station.service.fly()
    station.service.tick()
    refused = station("operate", "GET", "/api/v1/fleet", lane=True)
    assert (refused.status_code, "port 8080 answers" in refused.text) == (404, True)
    assert station("operate", "POST", "/api/v1/show/resume", lane=True).status_code == 404
    assert station("", "GET", "/healthz", lane=True).status_code == 200
    assert station("", "POST", "/api/v1/show/stop", lane=True).status_code == 401
    assert station("emergency", "POST", "/api/v1/show/stop", lane=True).status_code == 202


def test_cross_origin_page_gets_no_cors_headers(station: Station) -> None:
    preflight = {"Origin": "http://evil.example", "Access-Control-Request-Method": "POST"}
    answer = station("operate", "OPTIONS", "/api/v1/show/stop", headers=preflight)
    assert answer.status_code == 403
    assert not [name for name in answer.headers if name.startswith("access-control")]


def test_ready_reports_whether_commands_are_possible(station: Station) -> None:
    assert station("", "GET", "/readyz").json() == {
        "ready": True,
        "vehicles_ready": 3,
        "vehicles_airborne": 0,
        "vehicles": 3,
    }
