"""The marks of a record, from its audit: see `gcs.service.replay_marks`. Pure."""

from collections.abc import Iterable, Mapping
from typing import Any, Final, NamedTuple

from gcs.model.lifecycle import GROUNDED, ON_THE_GROUND, Phase, ShowPhase
from gcs.model.state import VehicleId
from gcs.service.event_log import Severity, severity
from gcs.service.event_texts import words
from gcs.service.replay_marks import CueMark, EventMark, IdleSpan, PhaseSpan, ReplayMarks

SHOW_PHASE, VEHICLE_PHASE, CUE, ALARM = "show_phase", "vehicle_phase", "cue", "alarm"

IDLE_LEAST_S: Final = 8.0
"""Shorter waits on the ground are played: a viewer sees that one flight ended and another began."""

KEPT_S: Final = 3.0
"""Played part of the time on the ground before a take-off and after a landing."""

EVENTS_MAX: Final = 500
"""Most event marks; alarms take precedence over other events, and earlier events over later ones."""


class Event(NamedTuple):
    """A row of the audit."""

    unix_s: float
    level: str
    event: str
    vehicle: VehicleId | None
    detail: Mapping[str, Any]


def marks_of(events: Iterable[Event], began_unix_s: float, duration_s: float) -> ReplayMarks:
    """Return all marks of a record that begins at `began_unix_s` and is `duration_s` long.

    Raises: KeyError or ValueError for invalid events.
    """
    show, cues, event_marks = _Spans(duration_s), list[CueMark](), list[EventMark]()
    flying = _Flying(duration_s)
    for unix_s, level, event, vehicle, detail in events:
        at_s = min(max(unix_s - began_unix_s, 0.0), duration_s)
        if event == SHOW_PHASE:
            show.change(at_s, ShowPhase(detail["was"]), ShowPhase(detail["phase"]))
        elif event == VEHICLE_PHASE and vehicle is not None:
            flying.change(at_s, vehicle, Phase(detail.get("was", Phase.STANDBY)), Phase(detail["phase"]))
        elif event == CUE:
            cues.append(CueMark(str(detail["cue"]), at_s))
        how = severity(level)
        if event == ALARM or how is not Severity.INFO:
            event_marks.append(EventMark(at_s, how, event == ALARM, words(event, detail), vehicle))
    phases = show.spans()
    return ReplayMarks(phases, tuple(cues), _fewer(event_marks), _idle(phases, flying.spans(), duration_s))


class _Spans:
    """Collects the show's phases in order."""

    def __init__(self, duration_s: float) -> None:
        self._duration_s = duration_s
        self._changes: list[tuple[float, ShowPhase]] = []

    def change(self, at_s: float, was: ShowPhase, phase: ShowPhase) -> None:
        if not self._changes:
            self._changes.append((0.0, was))
        self._changes.append((at_s, phase))

    def spans(self) -> tuple[PhaseSpan, ...]:
        if not self._changes:
            return ()
        ends_s = [*(at_s for at_s, _ in self._changes[1:]), self._duration_s]
        return tuple(
            PhaseSpan(phase, at_s, until_s)
            for (at_s, phase), until_s in zip(self._changes, ends_s, strict=True)
            if until_s > at_s
        )


class _Flying:
    """Collects when any vehicle was, or may have been, in the air, under any control."""

    def __init__(self, duration_s: float) -> None:
        self._duration_s = duration_s
        self._flies: dict[VehicleId, bool] = {}
        self._since_s: float | None = None
        self._spans: list[tuple[float, float]] = []

    def change(self, at_s: float, vehicle: VehicleId, was: Phase, phase: Phase) -> None:
        if vehicle not in self._flies and was not in GROUNDED:
            self._begin(0.0)  # it flew when the record began
        self._flies[vehicle] = phase not in GROUNDED
        if self._flies[vehicle]:
            self._begin(at_s)
        elif self._since_s is not None and not any(self._flies.values()):
            self._spans.append((self._since_s, at_s))
            self._since_s = None

    def _begin(self, at_s: float) -> None:
        if self._since_s is None:
            self._since_s = at_s

    def spans(self) -> list[tuple[float, float]]:
        left = [] if self._since_s is None else [(self._since_s, self._duration_s)]
        return [*self._spans, *left]


def _idle(
    phases: Iterable[PhaseSpan], flying: Iterable[tuple[float, float]], duration_s: float
) -> tuple[IdleSpan, ...]:
    """Times when the show is on the ground and no vehicle flies; none where no phase is known."""
    known = tuple(phases)
    if not known:
        return ()
    busy = sorted(
        [*((span.from_s, span.until_s) for span in known if span.phase not in ON_THE_GROUND), *flying]
    )
    found, at_s = [], 0.0
    for from_s, until_s in [*busy, (duration_s, duration_s)]:
        begins_s, ends_s = (
            (at_s + KEPT_S if at_s > 0.0 else 0.0),
            from_s - (KEPT_S if from_s < duration_s else 0.0),
        )
        if ends_s - begins_s >= IDLE_LEAST_S:
            found.append(IdleSpan(begins_s, ends_s))
        at_s = max(at_s, until_s)
    return tuple(found)


def _fewer(event_marks: list[EventMark]) -> tuple[EventMark, ...]:
    if len(event_marks) <= EVENTS_MAX:
        return tuple(event_marks)
    kept = sorted(event_marks, key=lambda mark: not mark.is_alarm)[:EVENTS_MAX]
    return tuple(sorted(kept, key=lambda mark: mark.at_s))
