"""Events, marks, alarms and take-off positions of a session, from its audit and its recorded status."""

import json
from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from gcs.model.errors import GcsError
from gcs.model.lifecycle import GROUNDED, ON_THE_GROUND, Phase, ShowPhase
from gcs.model.state import Array, VehicleId
from gcs.recording.audit_reader import AUDIT, PAD, rows
from gcs.service import CueMark, EventMark, IdleSpan, PhaseSpan, ReplayMarks
from gcs.service.alarms import CAUSES, Alarm, AlarmCause
from gcs.service.event_log import KEPT, LogEvent, Severity, severity, words

PLAN: Final = "plan"

EVENTS: Final = (
    "SELECT unix_s, level, event, vehicle, detail FROM events WHERE session = ? ORDER BY unix_s, rowid"
)

SHOW_PHASE, VEHICLE_PHASE, CUE, ALARM = "show_phase", "vehicle_phase", "cue", "alarm"

IDLE_LEAST_S: Final = 8.0
"""Shorter waits on the ground are played: a viewer sees that one flight ended and another began."""

KEPT_S: Final = 3.0
"""Played part of the time on the ground before a take-off and after a landing."""

EVENTS_MAX: Final = 500
"""Most event marks; alarms take precedence over other events, and earlier events over later ones."""


class RecordedEvent(NamedTuple):
    """A row of the audit."""

    unix_s: float
    level: str
    event: str
    vehicle: VehicleId | None
    detail: Mapping[str, Any]


def marks_of(events: Iterable[RecordedEvent], began_unix_s: float, duration_s: float) -> ReplayMarks:
    """Return all marks of a record that begins at `began_unix_s` and is `duration_s` long.

    Raises: KeyError or ValueError for invalid events.
    """
    show, cues, event_marks = list[tuple[float, ShowPhase]](), list[CueMark](), list[EventMark]()
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
        how = severity(level)
        if event == ALARM or how is not Severity.INFO:
            event_marks.append(EventMark(at_s, how, event == ALARM, words(event, detail), vehicle))
    if len(event_marks) > EVENTS_MAX:
        kept = sorted(event_marks, key=lambda mark: not mark.is_alarm)[:EVENTS_MAX]
        event_marks = sorted(kept, key=lambda mark: mark.at_s)
    phases, flying = _phase_spans(show, duration_s), _flying_spans(changes, duration_s)
    return ReplayMarks(phases, tuple(cues), tuple(event_marks), _idle(phases, flying, duration_s))


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


class EventHistory:
    """One session's events, in order."""

    def __init__(self, events: Sequence[RecordedEvent]) -> None:
        """Raises: KeyError, TypeError or ValueError for invalid events."""
        self._events = tuple(events)
        self._happened: list[LogEvent] = []
        self._pads: dict[VehicleId, list[tuple[float, Array]]] = {}
        for unix_s, level, event, vehicle, detail in events:
            if event == PAD and vehicle is not None:
                pad_m = np.array(detail["pad_m"], dtype=np.float64)
                self._pads.setdefault(vehicle, []).append((unix_s, pad_m))
                continue
            text = "the plan was changed" if event == PLAN else words(event, detail)
            number = len(self._happened) + 1
            self._happened.append(LogEvent(number, unix_s, severity(level), text, vehicle))
        self._times_s = [each.unix_time_s for each in self._happened]

    @staticmethod
    def of(flight: Path, session: str) -> "EventHistory":
        """Read a session from the audit in the folder above that of its flight data; empty without one.

        Raises: GcsError when there is one, and it cannot be read.
        """
        file = flight.absolute().parent.parent / AUDIT
        if not file.is_file():
            return EventHistory(())
        try:
            event_rows = rows(file, EVENTS, session)
            return EventHistory(
                [RecordedEvent(**{**dict(row), "detail": json.loads(row["detail"])}) for row in event_rows]
            )
        except (KeyError, TypeError, ValueError) as error:
            raise GcsError(f"{file}: its events are none: {error!r}") from None

    def until(self, unix_s: float) -> tuple[LogEvent, ...]:
        """The newest events up to that time, newest last."""
        end = bisect_right(self._times_s, unix_s)
        return tuple(self._happened[max(end - KEPT, 0) : end])

    def marks(self, began_unix_s: float, duration_s: float) -> ReplayMarks:
        """The scrubber's marks of the whole session. Raises: GcsError for invalid events."""
        try:
            return marks_of(self._events, began_unix_s, duration_s)
        except (KeyError, ValueError) as error:
            raise GcsError(f"the audit's events cannot be read: {error!r}") from None

    def home_m(self, vehicle: VehicleId, unix_s: float) -> Array | None:
        """(3,) Its last take-off position, show frame; None: it had not taken off, or it is not recorded."""
        pads = self._pads.get(vehicle, [])
        at = bisect_right(pads, unix_s, key=lambda pad: pad[0]) - 1
        return pads[at][1] if at >= 0 else None


def replay_alarm(path: Path, began_unix_s: float, *, ended: bool, cut: str) -> Alarm:
    """Return the alarm that what is shown is a replay; `cut` says what is missing at the record's end."""
    over = f" The record has ended. {cut}".rstrip() if ended else ""
    cause, row = AlarmCause.REPLAY, CAUSES[AlarmCause.REPLAY]
    text = f"{row.headline}: this is a record of {path}. Nothing here flies.{over}"
    return Alarm(cause.value, row.severity, cause, text, row.advice, (), began_unix_s, began_unix_s)
