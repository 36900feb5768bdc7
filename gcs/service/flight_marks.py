"""Marks of a flight for a timeline: phases, cues, commands, alarms and warnings, time without flight."""

import logging
import time
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from gcs.model.lifecycle import GROUNDED, ON_THE_GROUND, Phase, ShowPhase
from gcs.model.state import VehicleId
from gcs.service.alarms import AlarmSeverity
from gcs.service.event_log import EventLog, Severity, details, severity, vehicle_of, words
from gcs.service.snapshots import CommandMark, CueMark, EventMark, FlightMarks, IdleSpan, PhaseSpan

SHOW_PHASE, VEHICLE_PHASE, CUE, ALARM, COMMAND = "show_phase", "vehicle_phase", "cue", "alarm", "command"

IDLE_LEAST_S: Final = 8.0
"""Shorter waits on the ground are played: a viewer sees that one flight ended and another began."""

KEPT_S: Final = 3.0
"""Played part of the time on the ground before a take-off and after a landing."""

EVENTS_MAX: Final = 500
"""Most event marks; alarms take precedence over other events, and earlier events over later ones."""

START_S: Final = 1.0
"""A flight begins no later than this after the command to start."""

PHASES_MAX: Final = 200
"""Most changes of the show's phase that are kept of the flight that lasts."""


class RecordedEvent(NamedTuple):
    """A row of the audit, or a log record."""

    unix_s: float
    level: str
    event: str
    vehicle: VehicleId | None
    detail: Mapping[str, Any]


def marks_of(events: Iterable[RecordedEvent], began_unix_s: float, duration_s: float) -> FlightMarks:
    """Return all marks of a record that begins at `began_unix_s` and is `duration_s` long.

    Raises: KeyError or ValueError for invalid events.
    """
    show, cues, event_marks = list[tuple[float, ShowPhase]](), list[CueMark](), list[EventMark]()
    commands: list[CommandMark] = []
    changes: list[tuple[float, VehicleId, Phase, Phase]] = []
    for unix_s, level, event, vehicle, detail in events:
        at_s = min(max(unix_s - began_unix_s, 0.0), duration_s)
        if event == SHOW_PHASE:
            show += [(0.0, ShowPhase(detail["was"]))] if not show else []
            show.append((at_s, ShowPhase(detail["phase"])))
        elif event == VEHICLE_PHASE and vehicle is not None:
            changes.append((at_s, vehicle, Phase(detail.get("was", Phase.STANDBY)), Phase(detail["phase"])))
        elif event == CUE:
            cues.append(CueMark(str(detail["cue"]), at_s))
        elif event == COMMAND:
            commands.append(CommandMark(at_s, str(detail["action"]), words(event, detail), vehicle))
        how = severity(level)
        if event == ALARM:
            alarm = str(detail["alarm"]), AlarmSeverity(detail["severity"])
            event_marks.append(EventMark(at_s, how, *alarm, str(detail["text"]), vehicle))
        elif how is not Severity.INFO:
            event_marks.append(EventMark(at_s, how, None, None, words(event, detail), vehicle))
    if len(event_marks) > EVENTS_MAX:
        kept = sorted(event_marks, key=lambda mark: mark.alarm is None)[:EVENTS_MAX]
        event_marks = sorted(kept, key=lambda mark: mark.at_s)
    phases, flying = _phase_spans(show, duration_s), _flying_spans(changes, duration_s)
    idle = _idle(phases, flying, duration_s)
    return FlightMarks(
        began_unix_s, phases, tuple(cues), tuple(commands[-EVENTS_MAX:]), tuple(event_marks), idle
    )


def _phase_spans(changes: Sequence[tuple[float, ShowPhase]], duration_s: float) -> tuple[PhaseSpan, ...]:
    ends_s = [*(at_s for at_s, _ in changes[1:]), duration_s]
    return tuple(
        PhaseSpan(phase, at_s, until_s)
        for (at_s, phase), until_s in zip(changes, ends_s, strict=False)
        if until_s > at_s
    )


def _flying_spans(
    changes: Iterable[tuple[float, VehicleId, Phase, Phase]], duration_s: float
) -> list[tuple[float, float]]:
    """Times when any vehicle was, or may have been, in the air; `changes`: with phases before and after."""
    flies: dict[VehicleId, bool] = {}
    since_s: float | None = None
    spans: list[tuple[float, float]] = []
    for at_s, vehicle, was, phase in changes:
        if since_s is None and vehicle not in flies and was not in GROUNDED:
            since_s = 0.0  # it flew when the record began
        flies[vehicle] = phase not in GROUNDED
        if since_s is None and flies[vehicle]:
            since_s = at_s
        elif since_s is not None and not any(flies.values()):
            spans.append((since_s, at_s))
            since_s = None
    return spans if since_s is None else [*spans, (since_s, duration_s)]


def _idle(
    phases: Sequence[PhaseSpan], flying: Iterable[tuple[float, float]], duration_s: float
) -> tuple[IdleSpan, ...]:
    """Times when the show is on the ground and no vehicle flies; none where no phase is known."""
    if not phases:
        return ()
    shown = ((span.from_s, span.until_s) for span in phases if span.phase not in ON_THE_GROUND)
    idle, at_s = [], 0.0
    for from_s, until_s in [*sorted([*shown, *flying]), (duration_s, duration_s)]:
        begins_s = at_s + KEPT_S if at_s > 0.0 else 0.0
        ends_s = from_s - (KEPT_S if from_s < duration_s else 0.0)
        if ends_s - begins_s >= IDLE_LEAST_S:
            idle.append(IdleSpan(begins_s, ends_s))
        at_s = max(at_s, until_s)
    return tuple(idle)


class FlightLog(EventLog):
    """Keeps the newest log records, and the marks of the flight that lasts or was the last."""

    def __init__(self) -> None:
        super().__init__()
        self._phases: deque[RecordedEvent] = deque(maxlen=PHASES_MAX)
        self._others: deque[RecordedEvent] = deque(maxlen=EVENTS_MAX)

    def emit(self, record: logging.LogRecord) -> None:
        super().emit(record)
        event, level, detail = record.getMessage(), record.levelname.lower(), details(record)
        seen = RecordedEvent(record.created, level, event, vehicle_of(record), detail)
        if event == SHOW_PHASE:
            if detail["was"] in ON_THE_GROUND and detail["phase"] not in ON_THE_GROUND:
                self._phases.clear()
            self._phases.append(seen)
        elif event in {ALARM, COMMAND} or severity(level) is not Severity.INFO:
            self._others.append(seen)

    @property
    def marks(self) -> FlightMarks:
        phases = list(self._phases)
        if not phases:
            return FlightMarks()
        landed = phases[-1].detail["phase"] in ON_THE_GROUND
        began_s, until_s = phases[0].unix_s, phases[-1].unix_s if landed else time.time()
        others = [each for each in self._others if began_s - START_S <= each.unix_s <= until_s]
        return marks_of(sorted([*phases, *others], key=lambda each: each.unix_s), began_s, until_s - began_s)
