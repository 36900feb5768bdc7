"""Events of a replayed session, read from the audit."""

from pathlib import Path

import numpy as np
import pytest

from gcs.model.errors import GcsError
from gcs.recording.audit import AuditTrail
from gcs.recording.audit_database import Journal
from gcs.recording.audit_reader import AUDIT, PAD
from gcs.recording.replay.history import EventHistory
from gcs.service.event_log import KEPT, Severity


def recorded(root: Path) -> Path:
    """Two sessions. Returns: the flight data of the second."""
    journal = Journal(root / AUDIT)
    journal.open()
    for session in ("s1", "s2"):
        audit = AuditTrail(journal, session, {"d1": (1, "a")})
        audit.begin(root / session, "{}")
        audit.event(10.0, "info", PAD, "d1", {"pad_m": [1.0, 2.0, -0.5]})
        audit.event(20.0, "warning", "vehicle_phase", "d1", {"phase": session, "reason": "silent"})
        audit.event(30.0, "info", "plan", None, {"formation": {"radius_m": 10.0}})
        audit.event(40.0, "info", PAD, "d1", {"pad_m": [7.0, 2.0, -0.5]})
    journal.close()
    return root / "s2" / "flight.mcap"


def test_history_holds_earlier_events_of_that_session_only(tmp_path: Path) -> None:
    past = EventHistory.of(recorded(tmp_path), "s2")
    assert past.until(19.9) == ()
    (first,) = past.until(20.0)
    assert (first.text, first.vehicle, first.severity) == ("s2: silent", "d1", Severity.WARNING)
    assert [each.text for each in past.until(35.0)] == ["s2: silent", "the plan was changed"]
    assert [each.number for each in past.until(35.0)] == [1, 2]


def test_latest_takeoff_place_is_found(tmp_path: Path) -> None:
    past = EventHistory.of(recorded(tmp_path), "s2")
    assert past.home_m("d1", 9.0) is None
    assert past.home_m("d9", 50.0) is None
    for unix_s, home_m in ((10.0, [1.0, 2.0, -0.5]), (39.9, [1.0, 2.0, -0.5]), (41.0, [7.0, 2.0, -0.5])):
        assert np.array_equal(past.home_m("d1", unix_s), home_m)  # type: ignore[arg-type]


def test_missing_audit_is_silent_and_a_damaged_one_is_named(tmp_path: Path) -> None:
    assert EventHistory.of(tmp_path / "s1" / "flight.mcap", "s1").until(1e12) == ()
    (tmp_path / AUDIT).write_bytes(b"no database" * 100)
    with pytest.raises(GcsError, match=AUDIT):
        EventHistory.of(tmp_path / "s1" / "flight.mcap", "s1")


def test_history_is_limited_to_a_page(tmp_path: Path) -> None:
    journal = Journal(tmp_path / AUDIT)
    journal.open()
    audit = AuditTrail(journal, "s1", {})
    for number in range(KEPT + 50):
        audit.event(float(number), "info", "vehicle_connected", f"d{number}", {})
    journal.close()
    reported = EventHistory.of(tmp_path / "s1" / "flight.mcap", "s1").until(120.0)
    assert [each.vehicle for each in reported] == [f"d{number}" for number in range(21, 121)]
