"""How a record is played, over REST."""

from dataclasses import replace
from typing import Any

import pytest
from pydantic import TypeAdapter

from gcs.model.lifecycle import ShowPhase
from gcs.service import (
    CheckState,
    CommandMark,
    CueMark,
    EventMark,
    FlightMarks,
    IdleSpan,
    PhaseSpan,
    ReportState,
)
from gcs.service.alarms import AlarmSeverity
from gcs.service.event_log import Severity
from gcs.service.snapshots import ReportBody
from tests.support.api_harness import Api
from tests.support.replays import FakeRecord


@pytest.fixture(autouse=True)
def _patient() -> None:
    """The age of a state is the subject here."""


def playing() -> tuple[Api, FakeRecord]:
    api, record = Api(), FakeRecord()
    api.service.replaying = record
    api.service.tick()
    return api, record


@pytest.mark.parametrize(
    ("method", "path"), [("GET", "replay"), ("POST", "replay"), ("GET", "replay/report")]
)
def test_flying_service_refuses_replay(method: str, path: str) -> None:
    answer = Api()(method, f"/api/v1/{path}", json={"speed": 2.0} if method == "POST" else None)
    assert answer.status_code == 409
    assert "this service flies vehicles, and replays nothing" in answer.json()["detail"]


def test_replay_changes_are_shown_by_its_status() -> None:
    api, _ = playing()
    assert api("GET", "/api/v1/replay").json()["paused"] is False
    reported = api("POST", "/api/v1/replay", json={"paused": True, "position_s": 12.5}).json()
    assert (reported["paused"], reported["position_s"], reported["speed"], reported["duration_s"]) == (
        True,
        12.5,
        1.0,
        60.0,
    )
    assert api("POST", "/api/v1/replay", json={"speed": 4}).json() == {**reported, "speed": 4.0}
    api.service.tick()
    assert api("GET", "/api/v1/status").json()["replay"] == {**reported, "speed": 4.0}


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({}, "body"),
        ({"speed": 0}, "speed"),
        ({"speed": 101}, "speed"),
        ({"speed": "2"}, "speed"),
        ({"position_s": -1}, "position_s"),
        ({"position_s": 60.1}, "position_s"),
        ({"paused": 1}, "paused"),
        ({"rewind": True}, "rewind"),
    ],
)
def test_invalid_replay_command_is_refused_and_changes_nothing(body: dict[str, Any], field: str) -> None:
    api, record = playing()
    record.change(paused=True, position_s=5.0)
    answer = api("POST", "/api/v1/replay", json={"speed": 2.0, **body} if body else body)
    assert answer.status_code == 422
    assert answer.json()["problems"][0]["field"] == field
    assert (record.playback.position_s, record.playback.speed) == (5.0, 1.0)


def test_flight_report_is_shown_once_it_is_made() -> None:
    api, record = playing()
    assert api("GET", "/api/v1/replay/report").json() == {
        "state": "running",
        "reason": "",
        "report": None,
    }
    check = {"name": "height", "limit": 100.0, "tolerated": 100.0, "worst": None, "unit": "m"}
    check |= {"vehicle": "", "at_s": None}
    report = {
        "source": "flight.mcap",
        "verdict": "incomplete",
        "missing": ["no vehicle was in the air: there was nothing to judge"],
        "based_on": "estimated positions",
        "uncertainty": "none",
        "remarks": [],
        "vehicles": 2,
        "autopilots": {},
        "flew": 0,
        "duration_s": 60.0,
        "checks": [{**check, "kept": None}],
        "nearest_pairs": [],
        "tracking": [],
        "traffic": [],
        "ground": None,
        "site_hash": None,
        "show_hashes": [],
        "starts": [],
        "wind_m_s": None,
    }
    record.report_state = ReportState(CheckState.DONE, report=TypeAdapter(ReportBody).validate_python(report))
    reported = api("GET", "/api/v1/replay/report").json()
    assert (reported["state"], reported["report"]) == ("done", report)
    record.report_state = ReportState(CheckState.FAILED, "the disk is gone")
    assert api("GET", "/api/v1/replay/report").json()["reason"] == "the disk is gone"


def test_marks_are_listed_and_idle_time_can_be_played() -> None:
    api, _ = playing()
    assert api("GET", "/api/v1/show/marks").json()["began_unix_time_s"] is None
    api.service.marks = FlightMarks(
        began_unix_time_s=1.7e9,
        phases=(PhaseSpan(ShowPhase.RUNNING, 0.0, 60.0),),
        cues=(CueMark("rise", 3.0),),
        commands=(CommandMark(4.0, "hold", "command hold by anna", "d1"),),
        events=(EventMark(5.0, Severity.ERROR, "a1", AlarmSeverity.WARNING, "d2 lost", "d2"),),
        idle=(IdleSpan(20.0, 40.0),),
    )
    mark = {"at_s": 5.0, "severity": "error", "alarm": "a1", "alarm_severity": "warning"}
    assert api("GET", "/api/v1/show/marks").json() == {
        "began_unix_time_s": 1.7e9,
        "phases": [{"phase": "running", "from_s": 0.0, "until_s": 60.0}],
        "cues": [{"cue": "rise", "at_s": 3.0}],
        "commands": [{"at_s": 4.0, "action": "hold", "text": "command hold by anna", "vehicle": "d1"}],
        "events": [{**mark, "text": "d2 lost", "vehicle": "d2"}],
        "idle": [{"from_s": 20.0, "until_s": 40.0}],
    }
    assert api("GET", "/api/v1/replay").json()["skips_idle"] is True
    assert api("POST", "/api/v1/replay", json={"skips_idle": False}).json()["skips_idle"] is False


@pytest.mark.parametrize("age_s", [0.0, 1.5])
def test_replay_never_reports_control_as_stopped(age_s: float) -> None:
    api, _ = playing()
    view = api.service.view.value
    api.service.view.promise(lambda: replace(view, time_s=view.time_s - age_s, control_alive=False))
    alarms = [alarm.cause.value for alarm in view.alarms]
    for path in ("/api/v1/fleet", "/api/v1/status"):
        reported = api("GET", path).json()
        assert [alarm["cause"] for alarm in reported["alarms"]] == alarms
        assert "control loop" not in reported["control_reason"]
        assert bool(reported["control_reason"]) == (age_s > 0.0)
    assert [alarm["cause"] for alarm in api("GET", "/api/v1/alarms").json()["alarms"]] == alarms
    assert api("GET", "/healthz").status_code == (503 if age_s > 0.0 else 200)
