"""JSON schemas of a replay: playback, marks, and the flight report of its record."""

from typing import Annotated, Final, Literal

from pydantic import Field

from gcs.api.schemas.rest import ABSENT, Change, Measured, Outward
from gcs.model.lifecycle import ShowPhase
from gcs.service import CheckState
from gcs.service.event_log import Severity

SPEED_MAX: Final = 100.0


class ReplayChange(Change):
    """Changes of the playback; at least one field."""

    paused: bool = Field(default=ABSENT)
    speed: Annotated[float, Field(gt=0, le=SPEED_MAX, examples=[4.0])] = Field(
        default=ABSENT, description="Playback speed as a multiple of the flight's."
    )
    position_s: Annotated[float, Field(ge=0, examples=[12.5])] = Field(
        default=ABSENT, description="Time since the first recorded state, at most the record's duration."
    )
    skips_idle: bool = Field(
        default=ABSENT, description="Jump over time in which nothing flies, while it plays."
    )


class Replay(Outward):
    """A recorded flight that is played back as if live."""

    file: str
    began_unix_time_s: float = Field(description="Time of the first recorded state.")
    duration_s: float
    position_s: float = Field(description="Time from the first recorded state to this one.")
    speed: float = Field(description="Playback speed as a multiple of the flight's.")
    paused: bool
    ended: bool = Field(description="The last recorded state is shown.")
    skips_idle: bool = Field(description="Time in which nothing flies is jumped over while it plays.")


class PhaseSpan(Outward):
    """A period in one phase of the show. Times are in seconds since the first recorded state."""

    phase: ShowPhase
    from_s: float
    until_s: float


class CueMark(Outward):
    """The start of a cue of the written show."""

    cue: str
    at_s: float


class EventMark(Outward):
    """An alarm, or a warning or error of the event log."""

    at_s: float
    severity: Severity
    is_alarm: bool
    text: str
    vehicle: str | None = Field(description="The vehicle concerned; null: none in particular.")


class IdleSpan(Outward):
    """A period in which no vehicle flies or is about to."""

    from_s: float
    until_s: float


class ReplayMarks(Outward):
    """Marks of the whole record for a timeline; empty when the flight data has no audit beside it."""

    phases: list[PhaseSpan]
    cues: list[CueMark]
    events: list[EventMark] = Field(description="At most 500; alarms before others.")
    idle: list[IdleSpan] = Field(description="Jumped over while `skips_idle` is true.")


class ReportCheck(Outward):
    """One limit: whether it was kept, and the worst value."""

    name: str = Field(examples=["greatest height"])
    limit: Measured = Field(description="The limit that applied then: a written show has its own.")
    tolerated: Measured = Field(
        description="Kept up to here: an autopilot's own answer may pass the limit by a little."
    )
    worst: Measured = Field(description="null: there was nothing to judge.")
    unit: str = Field(description="Unit of limit, tolerated and worst.", examples=["m"])
    vehicle: str = Field(description="The vehicle with the worst value.")
    at_s: Measured = Field(description="Time since the beginning of the record.")
    kept: bool | None = Field(description="null: there was nothing to judge.")


class NearestPair(Outward):
    """Two vehicles at the time when they were nearest, in the metric of the minimum separation."""

    vehicles: list[str]
    distance_m: Measured
    floor_ratio: Measured = Field(description="Distance as a multiple of the floor: 1 is the floor.")
    floor_ratio_if_off: Measured = Field(
        description="The same if both positions were wrong by their margin, towards each other."
    )
    at_s: Measured


class ReportBody(Outward):
    """The flight report, as `gcs report --json` prints it."""

    source: str
    verdict: Literal["kept", "broken", "incomplete"] = Field(
        description="incomplete: nothing was found broken, but not all of the flight could be judged."
    )
    missing: list[str] = Field(description="What could not be judged, and why; with times and bytes.")
    based_on: str = Field(examples=["true positions", "estimated positions"])
    uncertainty: str = Field(description="Uncertainty of the positions, in words.")
    remarks: list[str] = Field(description="Remarks about the file.")
    vehicles: int
    flew: int
    duration_s: float
    checks: list[ReportCheck]
    nearest_pairs: list[NearestPair]


class FlightReport(Outward):
    """The flight report of the record, or its progress."""

    state: CheckState
    reason: str = Field(description="Why it failed, empty when it did not.")
    report: ReportBody | None = Field(description="null until it is done.")
