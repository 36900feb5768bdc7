import pytest

from gcs.api.auth.authorization import needed
from gcs.api.schemas import convert
from gcs.service.access import RIGHTS, Right, Role
from gcs.service.alarms import AlarmCause, Condition
from tests.support.api_fake_service import FakeService
from tests.support.api_harness import Api

LOST = Condition(
    AlarmCause.VEHICLE_LOST, "no telemetry for 2.0 s", ("d3",), "Formation closes the gap.", command_id="o7"
)
KILLED = Condition(AlarmCause.KILLED, "motors stopped on command by anna", ("d2",))
NOTE = Condition(AlarmCause.SERVICE_NOTE, "no map")


@pytest.fixture(autouse=True)
def _old_states_are_fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """However long this machine takes between two lines."""
    monkeypatch.setattr(convert, "VIEW_AGE_MAX_S", 1e6)


@pytest.fixture
def api() -> Api:
    service = FakeService()
    service.conditions = (NOTE, LOST, KILLED)
    service.tick()
    return Api(service)


@pytest.mark.parametrize("path", ["/api/v1/fleet", "/api/v1/status", "/api/v1/alarms"])
def test_alarms_are_listed_by_severity_with_the_overall_state(api: Api, path: str) -> None:
    answered = api("GET", path).json()
    assert answered["severity"] == "emergency"
    assert [alarm["severity"] for alarm in answered["alarms"]] == ["emergency", "warning", "information"]
    lost = answered["alarms"][1]
    assert lost["text"] == "Vehicle d3 lost: no telemetry for 2.0 s. Formation closes the gap."
    assert (lost["cause"], lost["vehicles"], lost["command_id"]) == ("vehicle-lost", ["d3"], "o7")
    assert lost["acknowledged_by"] is lost["ended_unix_time_s"] is None


def test_without_alarms_the_state_of_the_whole_is_normal() -> None:
    assert Api()("GET", "/api/v1/alarms").json() == {"severity": "normal", "alarms": []}


def test_acknowledged_alarm_names_its_operator_and_stays(api: Api) -> None:
    alarm_id = api("GET", "/api/v1/alarms").json()["alarms"][0]["id"]
    answer = api("POST", f"/api/v1/alarms/{alarm_id}/acknowledge")
    assert answer.status_code == 200
    assert answer.json()["acknowledged_by"] == "local"
    api.service.tick()
    listed = api("GET", "/api/v1/alarms").json()
    assert listed["severity"] == "emergency"
    assert [alarm["acknowledged_by"] for alarm in listed["alarms"]] == ["local", None, None]


def test_all_alarms_are_acknowledged_at_once(api: Api) -> None:
    answer = api("POST", "/api/v1/alarms/acknowledge")
    assert len(answer.json()) == 3
    api.service.tick()
    assert all(alarm["acknowledged_by"] for alarm in api("GET", "/api/v1/alarms").json()["alarms"])
    assert api("POST", "/api/v1/alarms/acknowledge").json() == []


def test_an_alarm_that_is_not_listed_cannot_be_acknowledged(api: Api) -> None:
    answer = api("POST", "/api/v1/alarms/vehicle-lost-99/acknowledge")
    assert answer.status_code == 404
    assert "killed-" in answer.json()["detail"]


def test_stopped_control_is_first_and_stays_after_acknowledging(api: Api) -> None:
    api.service.control_alive = False
    api.service.tick()
    for path in ("/api/v1/fleet", "/api/v1/status", "/api/v1/alarms"):
        answered = api("GET", path).json()
        assert answered["severity"] == "emergency"
        first = answered["alarms"][0]
        assert (first["id"], len(answered["alarms"])) == ("control-stopped", 4)
        assert first["text"].startswith("Control stopped: the control loop has completed no tick")
    answer = api("POST", "/api/v1/alarms/control-stopped/acknowledge")
    assert answer.status_code == 409
    assert "until control runs again" in answer.json()["detail"]


@pytest.mark.parametrize(("role", "status"), [(Role.WATCH, 403), (Role.EMERGENCY, 200), (Role.OPERATE, 200)])
def test_alarms_are_acknowledged_by_roles_that_may_act(role: Role, status: int) -> None:
    for path in ("/api/v1/alarms/acknowledge", "/api/v1/alarms/killed-1/acknowledge"):
        right = needed("POST", path)
        assert (right in RIGHTS[role]) == (status == 200)
    assert needed("GET", "/api/v1/alarms") is Right.WATCH
