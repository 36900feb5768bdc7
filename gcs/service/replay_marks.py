"""Marks of a whole record for a replay's scrubber: phases, cues, events, and time in which no vehicle flies.

Times are seconds since the first recorded state, within the record.
"""

from dataclasses import dataclass

from gcs.model.lifecycle import ShowPhase
from gcs.model.state import VehicleId
from gcs.service.event_log import Severity


@dataclass(frozen=True, slots=True)
class PhaseSpan:
    """Time span of one show phase."""

    phase: ShowPhase
    from_s: float
    until_s: float


@dataclass(frozen=True, slots=True)
class CueMark:
    """Start of a cue of the written show."""

    cue: str
    at_s: float


@dataclass(frozen=True, slots=True)
class EventMark:
    """An alarm, or a log record of severity warning or above."""

    at_s: float
    severity: Severity
    is_alarm: bool
    text: str
    vehicle: VehicleId | None


@dataclass(frozen=True, slots=True)
class IdleSpan:
    """Time span in which no vehicle flies or is about to fly."""

    from_s: float
    until_s: float


@dataclass(frozen=True, slots=True)
class ReplayMarks:
    """All marks of one record, in order; empty if there is no audit beside the flight data."""

    phases: tuple[PhaseSpan, ...] = ()
    cues: tuple[CueMark, ...] = ()
    events: tuple[EventMark, ...] = ()
    idle: tuple[IdleSpan, ...] = ()
