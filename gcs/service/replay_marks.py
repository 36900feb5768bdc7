"""What a replay's scrubber shows of the whole record: phases, cues, events, and time in which nothing flies.

Times are seconds since the first recorded state, within the record.
"""

from dataclasses import dataclass

from gcs.model.lifecycle import ShowPhase
from gcs.model.state import VehicleId
from gcs.service.event_log import Severity


@dataclass(frozen=True, slots=True)
class PhaseSpan:
    """The show stands in one phase."""

    phase: ShowPhase
    from_s: float
    until_s: float


@dataclass(frozen=True, slots=True)
class CueMark:
    """A cue of the written show begins."""

    cue: str
    at_s: float


@dataclass(frozen=True, slots=True)
class EventMark:
    """An alarm, or a line of the log that warned of something."""

    at_s: float
    severity: Severity
    is_alarm: bool
    text: str
    vehicle: VehicleId | None


@dataclass(frozen=True, slots=True)
class IdleSpan:
    """Nothing flies, nor is about to."""

    from_s: float
    until_s: float


@dataclass(frozen=True, slots=True)
class ReplayMarks:
    """All marks of one record, in order. All empty where no audit lies beside the flight data."""

    phases: tuple[PhaseSpan, ...] = ()
    cues: tuple[CueMark, ...] = ()
    events: tuple[EventMark, ...] = ()
    idle: tuple[IdleSpan, ...] = ()
