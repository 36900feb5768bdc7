"""Every call that may change something stands in the record before its answer leaves."""

from pathlib import Path

from gcs.recording.session import Record
from tests.support.api_fake_service import FakeService
from tests.support.api_harness import Api
from tests.support.audit_rows import calls

VEHICLES = {"d1": (1, "radio")}


def test_a_call_is_in_the_record_when_its_answer_comes(tmp_path: Path) -> None:
    with Record(tmp_path, "{}", VEHICLES, flight=False) as record:
        service = FakeService()
        service.audit = record.audit
        api = Api(service)
        answer = api("PATCH", "/api/v1/orbit", json={"radius_m": 12.0})
        assert (answer.status_code, "X-Recorded" in answer.headers) == (200, False)
        (call,) = calls(tmp_path)  # read while the service still runs
    assert (call["caller"], call["method"], call["path"], call["status"]) == (
        "local",
        "PATCH",
        "/api/v1/orbit",
        200,
    )
    assert call["body"] == '{"radius_m":12.0}'


def test_refused_and_denied_calls_are_audited_reads_are_not(tmp_path: Path) -> None:
    with Record(tmp_path, "{}", VEHICLES, flight=False) as record:
        service = FakeService()
        service.audit = record.audit
        api = Api(service)
        assert api("GET", "/api/v1/fleet").status_code == 200
        assert api("POST", "/api/v1/show/resume").status_code == 409
        assert api("PATCH", "/api/v1/orbit", json={"radius_m": "wide"}).status_code == 422
        assert api("DELETE", "/api/v1/nothing").status_code == 404
        assert api("GET", "/api/v1/fleet", headers={"Host": "evil.example"}).status_code == 403
    noted = [(call["method"], call["path"], call["status"]) for call in calls(tmp_path)]
    assert noted == [
        ("POST", "/api/v1/show/resume", 409),
        ("PATCH", "/api/v1/orbit", 422),
        ("DELETE", "/api/v1/nothing", 404),
        ("GET", "/api/v1/fleet", 403),
    ]


def test_without_a_disk_commands_run_and_report_no_recording(
    tmp_path: Path,
) -> None:
    (tmp_path / "runs").touch()  # a file where the folder should be
    with Record(tmp_path / "runs", "{}", VEHICLES, flight=False) as record:
        service = FakeService()
        service.audit = record.audit
        answer = Api(service)("POST", "/api/v1/show/start")
        assert (answer.status_code, answer.headers["X-Recorded"]) == (202, "no")
        assert service.show == "preflight"
        assert "rows of the audit are not recorded" in record.problems[0]
