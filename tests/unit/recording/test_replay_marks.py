"""What a timeline shows of a flight or a record: phases, cues, commands, events, time without flight."""

import logging
from typing import Any

import pytest

from gcs.model.lifecycle import ShowPhase
from gcs.service.commands import CALLER, CommandLog
from gcs.service.event_log import Severity, attached
from gcs.service.flight_marks import EVENTS_MAX, KEPT_S, FlightLog, RecordedEvent, marks_of

BEGAN_S = 1.7e9
LASTS_S = 600.0


def at(
    time_s: float, event: str, vehicle: str | None = None, level: str = "info", **detail: Any
) -> RecordedEvent:
    return RecordedEvent(BEGAN_S + time_s, level, event, vehicle, detail)


FLIGHT = [
    at(-5.0, "session_begins"),
    at(98.0, "command", action="start", by="anna", count=2),
    at(100.0, "show_phase", was="idle", phase="arming", reason=""),
    at(102.0, "vehicle_phase", "d1", was="standby", phase="takeoff", reason=""),
    at(103.0, "vehicle_phase", "d2", was="standby", phase="takeoff", reason=""),
    at(130.0, "show_phase", was="arming", phase="running", reason=""),
    at(131.0, "cue", name="parade", hash="ab", cue="rise"),
    at(150.0, "alarm", level="error", alarm="a1", severity="emergency", cause="vehicle-lost", text="d2 lost"),
    at(160.0, "setpoint_late", "d2", level="warning", reason="x"),
    at(170.0, "cue", name="parade", hash="ab", cue="ring"),
    at(180.0, "command", "d1", action="hold", by="anna", count=None),
    at(200.0, "show_phase", was="running", phase="returning", reason=""),
    at(230.0, "vehicle_phase", "d1", was="landing", phase="standby", reason=""),
    at(231.0, "show_phase", was="returning", phase="landed", reason=""),
]
DOWN = at(300.0, "vehicle_phase", "d2", was="lost", phase="offline", reason="")


def test_phases_follow_from_beginning_to_end() -> None:
    spans = marks_of(FLIGHT, BEGAN_S, LASTS_S).phases
    assert [(span.phase, span.from_s, span.until_s) for span in spans] == [
        (ShowPhase.IDLE, 0.0, 100.0),
        (ShowPhase.ARMING, 100.0, 130.0),
        (ShowPhase.RUNNING, 130.0, 200.0),
        (ShowPhase.RETURNING, 200.0, 231.0),
        (ShowPhase.LANDED, 231.0, LASTS_S),
    ]


def test_cues_alarms_and_warnings_are_marked_routine_is_not() -> None:
    marks = marks_of(FLIGHT, BEGAN_S, LASTS_S)
    assert [(mark.cue, mark.at_s) for mark in marks.cues] == [("rise", 131.0), ("ring", 170.0)]
    assert [(mark.at_s, mark.severity, mark.alarm, mark.vehicle) for mark in marks.events] == [
        (150.0, Severity.ERROR, "a1", None),
        (160.0, Severity.WARNING, None, "d2"),
    ]
    assert (marks.events[0].text, marks.events[0].alarm_severity) == ("d2 lost", "emergency")
    assert [(mark.at_s, mark.action, mark.text, mark.vehicle) for mark in marks.commands] == [
        (98.0, "start", "command start by anna: 2 vehicles", None),
        (180.0, "hold", "command hold by anna", "d1"),
    ]


def test_idle_is_without_flight_less_a_margin_on_both_sides() -> None:
    idle = marks_of([*FLIGHT, DOWN], BEGAN_S, LASTS_S).idle
    assert [(span.from_s, span.until_s) for span in idle] == [
        (0.0, 100.0 - KEPT_S),
        (300.0 + KEPT_S, LASTS_S),
    ]


def test_possibly_airborne_vehicle_means_not_idle() -> None:
    (before,) = marks_of(FLIGHT, BEGAN_S, LASTS_S).idle  # d2 is lost, not confirmed on the ground
    assert before.until_s < 100.0
    piloted = at(50.0, "vehicle_phase", "d3", was="pilot", phase="standby", reason="")
    later = marks_of([*FLIGHT[:1], piloted, *FLIGHT[1:]], BEGAN_S, LASTS_S).idle
    assert [(span.from_s, span.until_s) for span in later] == [(50.0 + KEPT_S, 100.0 - KEPT_S)]


def test_short_wait_is_not_idle_and_without_phases_unknown() -> None:
    again = at(240.0, "show_phase", was="landed", phase="arming", reason="")
    assert len(marks_of([*FLIGHT, DOWN, again], BEGAN_S, LASTS_S).idle) == 1
    assert marks_of([], BEGAN_S, LASTS_S).idle == ()
    assert marks_of([], BEGAN_S, LASTS_S).phases == ()


def test_of_too_many_events_alarms_have_precedence() -> None:
    many = [at(t, "setpoint_late", level="warning", reason="x") for t in range(EVENTS_MAX + 50)]
    marks = marks_of([*many, *FLIGHT[7:8]], BEGAN_S, 10_000.0)
    assert len(marks.events) == EVENTS_MAX
    assert any(mark.alarm for mark in marks.events)
    assert [mark.at_s for mark in marks.events] == sorted(mark.at_s for mark in marks.events)


def test_invalid_phase_is_refused() -> None:
    with pytest.raises(ValueError, match="dancing"):
        marks_of([at(1.0, "show_phase", was="idle", phase="dancing")], BEGAN_S, LASTS_S)


def test_marks_of_this_flight_are_kept_until_the_next_one() -> None:
    log, kept = logging.getLogger("gcs.service.commands"), FlightLog()

    def moved(was: str, phase: str) -> None:
        log.info("show_phase", extra={"was": was, "phase": phase, "reason": ""})

    with attached(kept):
        log.warning("setpoint_late", extra={"reason": "before any flight"})
        assert kept.marks.began_unix_time_s is None
        CommandLog().open("start", ["d1", "d2"], {})  # by the service: none of an operator
        caller = CALLER.set("anna")
        CommandLog().open("start", ["d1", "d2"], {})
        moved("idle", "preflight")
        moved("preflight", "arming")
        CommandLog().open("hold", ["d2"], {})
        moved("arming", "returning")
        assert [span.phase for span in kept.marks.phases] == ["preflight", "arming", "returning"]
        moved("returning", "landed")
        log.warning("setpoint_late", extra={"reason": "on the ground"})
        flown = kept.marks
        moved("landed", "preflight")
        again = kept.marks
        CALLER.reset(caller)
    assert [(mark.text, mark.vehicle) for mark in flown.commands] == [
        ("command start by anna: 2 vehicles", None),
        ("command hold by anna", "d2"),
    ]
    assert (flown.commands[0].at_s, flown.phases[0].from_s) == (0.0, 0.0)
    assert [mark.text for mark in flown.events if "on the ground" in mark.text] == []
    assert [span.phase for span in again.phases] == ["preflight"]
