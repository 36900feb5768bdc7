"""Preflight over REST: what is answered, who may take a vehicle out, and what is refused."""

from pathlib import Path
from typing import Any

import pytest

from tests.support.api_harness import Api
from tests.unit.api.test_api_access import Station

PREFLIGHT = "/api/v1/preflight"
D2 = "/api/v1/vehicles/d2"


@pytest.fixture
def api() -> Api:
    return Api()


def test_every_check_has_state_value_unit_and_limit(api: Api) -> None:
    api.service.battery = 0.2
    reported = api("GET", PREFLIGHT).json()
    assert reported["passes"] is False
    assert reported["vehicles"][0]["checks"] == [
        {
            "name": "battery",
            "state": "fail",
            "value": 0.2,
            "unit": "of 1",
            "limit": "at least 25%",
            "problem": "battery at 20%, at least 25% is needed",
            "to_do": "charge it",
            "depends_on": [],
        }
    ]
    assert reported["fleet"][0]["value"] is None
    assert reported["not_checked"] == ["start pattern: there is none"]


def test_excluded_vehicle_is_named_with_operator_and_reason(api: Api) -> None:
    answer = api("POST", f"{D2}/exclude", json={"reason": "cracked"})
    assert answer.status_code == 202
    assert answer.headers["Location"] == f"/api/v1/commands/{answer.json()['id']}"
    assert (answer.json()["action"], answer.json()["by"]) == ("exclude", "local")
    reported = api("GET", PREFLIGHT).json()
    assert reported["not_flying"] == {"d2": "taken out of the show by local: cracked"}
    assert [vehicle["flies"] for vehicle in reported["vehicles"]] == [True, False, True]
    assert api("POST", f"{D2}/include").status_code == 202
    assert api("GET", PREFLIGHT).json()["not_flying"] == {}
    assert api("POST", f"{D2}/exclude").status_code == 202, "a reason may be left out"


@pytest.mark.parametrize(
    ("method", "path", "options", "status", "says"),
    [
        ("GET", f"{PREFLIGHT}?vehicles=d1&vehicles=d9", {}, 404, "there is no vehicle 'd9'"),
        ("POST", "/api/v1/vehicles/d9/exclude", {}, 404, "there is no vehicle 'd9'"),
        ("POST", f"{D2}/include", {}, 409, "d2 was not taken out"),
        ("POST", f"{D2}/include", {"json": {"reason": "x"}}, 422, "this request has no fields"),
        ("POST", f"{D2}/exclude", {"json": {"reason": 201 * "x"}}, 422, "reason = xxx"),
        ("POST", f"{D2}/exclude", {"json": {"reason": 5}}, 422, "reason = 5: a valid string"),
        ("POST", f"{D2}/exclude", {"json": {"why": "x"}}, 422, "not a field of this request"),
        ("POST", f"{D2}/exclude", {"content": b"{"}, 422, "JSON"),
        ("POST", PREFLIGHT, {}, 405, "POST is not possible"),
    ],
)
def test_bad_exclusion_is_refused_with_a_reason(
    api: Api, method: str, path: str, options: dict[str, Any], status: int, says: str
) -> None:
    answer = api(method, path, **options)
    assert (answer.status_code, says in answer.json()["detail"]) == (status, True), answer.text
    assert api("GET", PREFLIGHT).json()["not_flying"] == {}


def test_in_the_air_no_vehicle_is_excluded(api: Api) -> None:
    api.service.fly()
    assert api("POST", f"{D2}/exclude").status_code == 409
    assert api("GET", PREFLIGHT).status_code == 409


@pytest.mark.parametrize(("role", "may"), [("watch", False), ("emergency", False), ("operate", True)])
def test_viewer_may_read_only_an_operator_may_exclude(tmp_path: Path, role: str, may: bool) -> None:
    station = Station(tmp_path)
    assert station(role, "GET", PREFLIGHT).status_code == 200
    answer = station(role, "POST", f"{D2}/exclude", json={"reason": "cracked"})
    assert answer.status_code == (202 if may else 403)
    assert bool(station.service.excluded) is may
    if may:
        assert answer.json()["by"] == f"{role}-token"
        assert station.service.excluded["d2"].by == f"{role}-token"
    assert station("", "GET", PREFLIGHT).status_code == 401
