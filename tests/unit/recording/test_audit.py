"""The audit: rows are read back, files of others are refused, a failing disk is reported."""

import asyncio
import logging
import sqlite3
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.links.link import Address
from gcs.model.errors import GcsError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Formation, Obstacle, Plan
from gcs.model.preflight_report import Exclusion
from gcs.model.state import Mode
from gcs.recording.audit_database import VERSION, AuditRow, Journal
from gcs.recording.audit_reader import AUDIT, LostBegin, exclusions, last_known, lost_begin
from gcs.recording.session import Record
from gcs.service import CALLER, Call, Outcome, SelectedShow
from gcs.service.commands import CommandLog
from tests.support.audit_rows import calls, commands, events
from tests.support.machine import soon
from tests.support.record_samples import PLAN, sample

VEHICLES = {"d1": (1, "radio"), "d2": (2, "radio")}
CONFIG = '{"show_frame": {}}'


class Places:
    """The addresses of a link."""

    def __init__(self, **addresses: Address) -> None:
        self.addresses = addresses


def test_command_is_read_back_with_operator_and_outcomes(tmp_path: Path) -> None:
    with Record(tmp_path, CONFIG, VEHICLES) as record:
        book = CommandLog(record.audit)
        book.open("start", ["d1", "d2"], {"d3": "offline: not received yet"})
        token = CALLER.set("anna")
        command = book.open("pause", ["d1", "d2"], {})
        CALLER.reset(token)
        book.close(command.id, "d1", Outcome.DONE)
        book.close(command.id, "d2", Outcome.FAILED, "it did not answer")
        assert asyncio.run(record.audit.kept())
    first, second = commands(tmp_path)
    assert (first.caller, first.action, first.session) == ("service", "start", record.session)
    assert first.outcomes["d3"] == ("not-included", "offline: not received yet")
    assert (second.caller, second.action) == ("anna", "pause")
    assert second.accepted_unix_s == command.accepted_unix_time_s
    assert second.outcomes == {"d1": ("done", ""), "d2": ("failed", "it did not answer")}


def test_calls_are_read_back_long_bodies_shortened(tmp_path: Path) -> None:
    with Record(tmp_path, CONFIG, VEHICLES) as record:
        record.audit.call(Call("anna", "POST", "/api/v1/show/start", "x" * 100_000, 202))
    (call,) = calls(tmp_path)
    assert (call["caller"], call["method"], call["path"], call["status"]) == (
        "anna",
        "POST",
        "/api/v1/show/start",
        202,
    )
    assert 4000 < len(call["body"]) < 5000


def test_logged_event_is_recorded(tmp_path: Path) -> None:
    with Record(tmp_path, CONFIG, VEHICLES):
        logging.getLogger("gcs.flight.state.vehicle").warning(
            "vehicle_phase", extra={"vehicle": "d1", "was": "hold", "phase": "lost"}
        )
    logging.getLogger("gcs.flight.state.vehicle").warning("after_the_end")
    (event,) = events(tmp_path)
    assert (event["level"], event["event"], event["vehicle"]) == ("warning", "vehicle_phase", "d1")
    assert event["detail"] == {"was": "hold", "phase": "lost"}


def test_last_known_vehicles_and_show_are_read_back(tmp_path: Path) -> None:
    with Record(tmp_path, CONFIG, VEHICLES) as record:
        home_m = np.array([1.0, 2.0, -0.5])
        places = Places(d1=Address("10.0.0.7", 14580, 0), d2=Address("/dev/ttyUSB0", 0, 0))
        record.note(sample(homes_m=[home_m, None]), [places])  # type: ignore[list-item]
        desired = Plan(Formation(radius_m=12.0, height_m=20.0))
        record.note(
            sample(time_s=101.0, phases=[Phase.FORMATION, Phase.LOST], homes_m=[home_m, None], plan=desired),
            [places],  # type: ignore[list-item]
        )
    known = last_known(tmp_path)
    d1, d2 = known.vehicles["d1"], known.vehicles["d2"]
    assert (d1.system_id, d1.link, d1.host, d1.port) == (1, "radio", "10.0.0.7", 14580)
    assert (d1.phase, d1.mode, d1.armed, d1.home_m) == ("formation", "offboard", True, (1.0, 2.0, -0.5))
    assert (d2.phase, d2.host, d2.port, d2.home_m) == ("lost", "/dev/ttyUSB0", 0, None)
    assert known.show is not None
    assert (known.show.phase, known.show.plan["formation"]["radius_m"]) == ("running", 12.0)
    assert known.session is not None
    assert known.session.config == {"show_frame": {}}
    assert known.session.ended_unix_s is None, "a vehicle of ours was in the air"
    reported = [event["event"] for event in events(tmp_path)]
    assert reported == ["vehicle_mode", "vehicle_mode", "pad", "plan"]


def test_session_ended_when_no_controlled_vehicle_is_airborne(tmp_path: Path) -> None:
    with Record(tmp_path, CONFIG, VEHICLES) as record:
        record.note(sample(), [])
        record.note(sample(time_s=101.0, phases=[Phase.STANDBY, Phase.PILOT]), [])
    session = last_known(tmp_path).session
    assert session is not None
    assert session.ended_unix_s is not None


def test_session_without_telemetry_keeps_the_previous_one(tmp_path: Path) -> None:
    places = Places(d1=Address("10.0.0.7", 14580, 0))
    home_m = np.array([1.0, 2.0, -0.5])
    with Record(tmp_path, CONFIG, VEHICLES) as first:
        first.note(sample(homes_m=[home_m, None]), [places])  # type: ignore[list-item]
    with Record(tmp_path, CONFIG, VEHICLES) as second:
        unknown = sample(
            phases=[Phase.OFFLINE] * 2, modes=[Mode.UNKNOWN] * 2, armed=[False] * 2, show=ShowPhase.IDLE
        )
        second.note(unknown, [Places()])  # type: ignore[list-item]
    known = last_known(tmp_path)
    assert known.session is not None
    assert known.session.id == second.session != first.session
    assert known.vehicles["d1"].session == first.session
    assert (known.vehicles["d1"].phase, known.vehicles["d1"].host) == ("formation", "10.0.0.7")
    assert known.vehicles["d1"].home_m == (1.0, 2.0, -0.5)
    assert known.show is not None
    assert known.show.phase == "running"


def test_unchanged_state_writes_nothing(tmp_path: Path) -> None:
    with Record(tmp_path, CONFIG, VEHICLES) as record:
        for tick in range(100):
            record.note(sample(time_s=100.0 + tick / 20), [])
    assert len(events(tmp_path)) == 2  # the modes as first received
    assert PLAN.formation.radius_m == last_known(tmp_path).show.plan["formation"]["radius_m"]  # type: ignore[union-attr]


def test_written_show_is_reported_cue_by_cue_not_every_tick(tmp_path: Path) -> None:
    cues = ("stand", "walk")
    with Record(tmp_path, CONFIG, VEHICLES) as record:
        for tick in range(100):
            show = SelectedShow("small", "ab" * 32, cues[tick // 50], cues, tick / 20, 5.0, True, False)
            plan = Plan(Formation(radius_m=10.0 + tick / 100, height_m=20.0))
            record.note(sample(time_s=100.0 + tick / 20, plan=plan, selected=show), [])
        tower = Obstacle("tower", 5.0, 6.0, 1.0, 2.0, 30.0)
        reported = replace(plan, obstacles=(tower,))
        record.note(sample(time_s=105.0, plan=reported, selected=show), [])
    shown = [event for event in events(tmp_path) if event["event"] != "vehicle_mode"]
    assert [event["event"] for event in shown] == ["cue", "plan", "cue", "plan"]
    assert shown[2]["detail"] == {"name": "small", "hash": "ab" * 32, "cue": "walk"}
    assert shown[3]["detail"]["obstacles"][0]["id"] == "tower"


def test_exclusion_is_read_back_with_operator_reason_and_time(tmp_path: Path) -> None:
    assert exclusions(tmp_path) == {}, "no record yet"
    with Record(tmp_path, CONFIG, VEHICLES) as record:
        for event, vehicle, reason in (
            ("excluded", "d1", "battery"),
            ("excluded", "d2", "bent arm"),
            ("included", "d1", ""),
        ):
            record.audit.event(1.8e9, "warning", event, vehicle, {"by": "anna", "reason": reason})
    assert exclusions(tmp_path) == {"d2": Exclusion("anna", "bent arm", 1.8e9)}


def test_invalid_exclusion_is_refused_by_name(tmp_path: Path) -> None:
    with Record(tmp_path, CONFIG, VEHICLES) as record:
        record.audit.event(1.8e9, "warning", "excluded", "d2", {"by": "anna"})
    with pytest.raises(GcsError, match="the exclusion of d2 cannot be read"):
        exclusions(tmp_path)
    with closing(sqlite3.connect(tmp_path / AUDIT)) as audit, audit:
        audit.execute("UPDATE events SET detail = ?", ("[" * 9999,))
    with pytest.raises(GcsError, match="the exclusion of d2 cannot be read"):
        exclusions(tmp_path)


@pytest.mark.parametrize(
    ("events_then", "expected"),
    [
        (["show_begins_at"], LostBegin("tour", "2026-11-26 20:30:00 UTC")),
        (["show_begins_at", "show_phase"], LostBegin("tour", "2026-11-26 20:30:00 UTC")),
        (["show_begins_at", "show_began"], None),
        (["show_begins_at", "show_begin_cancelled"], None),
        (["show_begins_at", "show_begin_forgotten"], None),
        ([], None),
    ],
)
def test_a_show_that_waited_is_known_to_the_next_session(
    tmp_path: Path, events_then: list[str], expected: LostBegin | None
) -> None:
    assert lost_begin(tmp_path) is None, "no record yet"
    with Record(tmp_path, CONFIG, VEHICLES) as record:
        for event in events_then:
            record.audit.event(1.8e9, "info", event, None, {"show": "tour", "at": "2026-11-26 20:30:00 UTC"})
    assert lost_begin(tmp_path) == expected
    with Record(tmp_path, CONFIG, VEHICLES):
        pass
    assert lost_begin(tmp_path) is None, "the session after it has said so"


def test_an_audit_is_read_while_the_service_writes(tmp_path: Path) -> None:
    with Record(tmp_path, CONFIG, VEHICLES) as record:
        book = CommandLog(record.audit)
        for count in range(1, 20):
            book.open("hold", ["d1"], {})
            assert asyncio.run(record.audit.kept())
            assert len(commands(tmp_path)) == count


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "not an audit of this program"),
        (b"no database at all" * 100, "not an audit of this program"),
        (b"SQLite format 3\x00" + b"\xff" * 4000, "not an audit of this program"),
    ],
)
def test_a_foreign_file_is_refused_by_name(tmp_path: Path, content: bytes, reason: str) -> None:
    (tmp_path / "other.sqlite").write_bytes(content)
    with pytest.raises(GcsError, match=f"other.sqlite: .*{reason}"):
        last_known(tmp_path / "other.sqlite")
    with pytest.raises(GcsError, match=r"absent\.sqlite: there is no such file"):
        last_known(tmp_path / "absent.sqlite")


def test_database_of_another_program_is_refused_unchanged(tmp_path: Path) -> None:
    with closing(sqlite3.connect(tmp_path / AUDIT)) as other:
        other.execute("CREATE TABLE birds (name TEXT)")
        other.commit()
    before = (tmp_path / AUDIT).read_bytes()
    with Record(tmp_path, CONFIG, VEHICLES) as record:
        CommandLog(record.audit).open("hold", ["d1"], {})
        assert not asyncio.run(record.audit.kept())
        soon(lambda: bool(record.problems))
        assert "a database, but not an audit of this program" in record.problems[0]
    assert (tmp_path / AUDIT).read_bytes() == before


def test_an_audit_of_a_later_version_is_refused(tmp_path: Path) -> None:
    with Record(tmp_path, CONFIG, VEHICLES):
        pass
    with closing(sqlite3.connect(tmp_path / AUDIT)) as later:
        later.execute(f"PRAGMA user_version = {VERSION + 1}")
    with pytest.raises(GcsError, match=f"version {VERSION + 1}; this program knows version {VERSION}"):
        last_known(tmp_path)


def test_a_truncated_audit_is_refused_with_a_reason(tmp_path: Path) -> None:
    with Record(tmp_path, CONFIG, VEHICLES) as record:
        for _ in range(500):
            record.audit.call(Call("anna", "POST", "/api/v1/show/start", "x" * 1000, 202))
        record.note(sample(), [])
    whole = (tmp_path / AUDIT).read_bytes()
    (tmp_path / AUDIT).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(GcsError, match=r"audit.sqlite: (cannot be read|not an audit)"):
        last_known(tmp_path)


def test_failing_disk_is_reported_and_notes_are_written_later(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    root = tmp_path / "runs"
    root.touch()  # a file where the folder should be
    with Record(root, CONFIG, VEHICLES) as record:
        book = CommandLog(record.audit)
        book.open("start", ["d1"], {})
        began_s = time.monotonic()
        assert not asyncio.run(record.audit.kept())
        assert time.monotonic() - began_s < 30.0  # not for ever: the disk fails
        soon(lambda: bool(record.problems))
        assert "rows of the audit are not recorded" in record.problems[0]
        root.unlink()
        soon(lambda: not record.problems)
        book.open("stop", ["d1"], {})
        assert asyncio.run(record.audit.kept())
    assert [command.action for command in commands(root)] == ["start", "stop"]
    assert [line.msg for line in caplog.records if line.name == "gcs.links.disk_writer"] == [
        "recording_failed",
        "recording_resumed",
    ]


def test_notes_beyond_the_buffer_of_a_bad_disk_are_counted(tmp_path: Path) -> None:
    (tmp_path / "runs").touch()
    journal = Journal(tmp_path / "runs" / AUDIT)
    journal.open()
    for _ in range(60):
        journal.put([AuditRow("SELECT 1", ())] * 1_000)
    assert not asyncio.run(journal.kept())
    (tmp_path / "runs").unlink()
    soon(lambda: "10000 rows of the audit were not recorded" in journal.problem)
    journal.close()
