"""Snapshots of the whole state, of shows and their checks, of records and their marks. None: not known."""

import asyncio
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Generic, TypeVar

from prometheus_client import Histogram
from pydantic import Field

from gcs.estimation.time_estimates import Estimates
from gcs.model.errors import Problem
from gcs.model.interrupted_flight import InterruptedFlight
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Plan
from gcs.model.state import Counts, VehicleId
from gcs.service.alarms import Alarm
from gcs.service.event_log import Severity
from gcs.service.vehicle_table import VehicleTable, VehicleView

if TYPE_CHECKING:
    from gcs.safety.filter import SafetySettings

T = TypeVar("T")


class Latest(Generic[T]):
    """The newest value of something, for any number of readers that cannot delay the writer."""

    def __init__(self, value: T) -> None:
        self._value = value
        self._make: Callable[[], T] | None = None
        self._changed = asyncio.Event()

    @property
    def value(self) -> T:
        make, self._make = self._make, None
        if make is not None:
            self._value = make()
        return self._value

    def set(self, value: T) -> None:
        """Replace the value and wake all waiting readers."""
        self._value, self._make = value, None
        self._wake()

    def promise(self, make: Callable[[], T]) -> None:
        """Set a value that is computed on the first read: most values are never read."""
        self._make = make
        self._wake()

    def _wake(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()

    async def changed(self) -> None:
        """Return with the next change."""
        await self._changed.wait()

    async def values(self) -> AsyncIterator[T]:
        """Yield the value now, then the newest after each change; a slow reader misses those between."""
        while True:
            changed = self._changed  # taken first, so that no change is missed
            yield self.value
            await changed.wait()


@dataclass(frozen=True, slots=True)
class StoredShow:
    """A stored show file."""

    name: str
    size_bytes: int
    sha256: Annotated[str, Field(description="Hash of the file; what is flown has a hash of its own.")]


class CheckState(StrEnum):
    """State of a show's check."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"  # the check itself failed: it judges nothing about the show


@dataclass(frozen=True, slots=True)
class ShowCheck:
    """Result of a show's check. Only a good show may be started."""

    name: str
    state: CheckState
    reason: str = ""  # why it failed
    hash: str | None = None  # of everything that is flown; a start must name it
    good: bool = False  # it can be flown, and by this service
    fits_service: bool = True  # False: some `problems` are due to this service's settings
    problems: tuple[Problem, ...] = ()
    figures: dict[str, Any] | None = None  # as in `gcs show check --json`; None: not flown


@dataclass(frozen=True, slots=True)
class SelectedShow:
    """The show that will be, or is, flown, and its progress."""

    name: str
    hash: str
    cue: str  # the newest
    cues: tuple[str, ...]
    clock_s: float  # the show's own time
    duration_s: float  # loops played
    runs: bool  # the clock; False: before it begins, and while it is paused
    target_is_live: bool
    timeline: tuple[tuple[str, float], ...] = ()  # name and time of every cue as played; loops written out


@dataclass(frozen=True, slots=True)
class TickView:
    """Timing of the control loop."""

    rate_hz: float
    count: int
    missed: int  # dropped, never made up
    duration_p50_ms: float
    duration_p99_ms: float
    lateness_p99_ms: float
    histograms: tuple[Histogram, ...] = ()  # since the start, for metrics; not a copy: they change


@dataclass(frozen=True, slots=True)
class ActiveFailsafe:
    """What the service does automatically while a cause lasts; see `gcs.failsafe.policy`."""

    cause: str
    action: str
    reason: str  # in words
    vehicles: tuple[VehicleId, ...]  # concerned; empty: no single vehicle
    since_s: float  # loop clock
    since_unix_s: float
    command_id: str | None  # None: no command, because it is done already or must wait


@dataclass(frozen=True, slots=True)
class FlightEnvelope:
    """Geofence, and minimum separation of two vehicles. Heights above the show's origin."""

    height_min_m: float  # of vehicles in the formation
    height_max_m: float
    distance_max_m: float  # from the show's origin, over the ground
    floor_horizontal_m: float  # semi-axes of the minimum-separation ellipsoid
    floor_vertical_m: float
    margin_m: float  # kept in addition, sideways

    @staticmethod
    def of(safety: "SafetySettings") -> "FlightEnvelope":
        fence, floor = safety.fence, safety.floor
        return FlightEnvelope(
            fence.height_min_m,
            fence.height_max_m,
            fence.distance_max_m,
            floor.horizontal_m,
            floor.vertical_m,
            floor.margin_m,
        )


@dataclass(frozen=True, slots=True)
class Playback:
    """State of a recorded flight's playback."""

    file: str
    began_unix_s: float  # of the first recorded state
    duration_s: float
    position_s: float  # since the first recorded state
    speed: float  # 1 is the speed of the flight
    paused: bool
    ended: bool  # the last recorded state is shown
    skips_idle: bool = False  # playback skips time in which no vehicle flies


@dataclass(frozen=True, slots=True)
class PhaseSpan:
    """A period in one phase of the show. Times are in seconds since the first recorded state."""

    phase: ShowPhase
    from_s: float
    until_s: float


@dataclass(frozen=True, slots=True)
class CueMark:
    """The start of a cue of the written show."""

    cue: str
    at_s: float


@dataclass(frozen=True, slots=True)
class EventMark:
    """An alarm, or a warning or error of the event log."""

    at_s: float
    severity: Severity
    is_alarm: bool
    text: str
    vehicle: Annotated[
        VehicleId | None, Field(description="The vehicle concerned; null: none in particular.")
    ]


@dataclass(frozen=True, slots=True)
class IdleSpan:
    """A period in which no vehicle flies or is about to."""

    from_s: float
    until_s: float


@dataclass(frozen=True, slots=True)
class ReplayMarks:
    """Marks of the whole record for a timeline; empty when the flight data has no audit beside it."""

    phases: tuple[PhaseSpan, ...]
    cues: tuple[CueMark, ...]
    events: Annotated[tuple[EventMark, ...], Field(description="At most 500; alarms before others.")]
    idle: Annotated[tuple[IdleSpan, ...], Field(description="Jumped over while `skips_idle` is true.")]


@dataclass(frozen=True, slots=True)
class ReportState:
    """State and result of a flight report."""

    state: CheckState
    reason: str = ""  # why it failed
    report: dict[str, Any] | None = None  # as in `gcs report --json`


@dataclass(frozen=True)
class FleetView:
    """The newest state of the whole flight, complete in itself."""

    time_s: float  # loop clock (monotonic)
    unix_time_s: float
    show: ShowPhase
    reason: str
    rows: VehicleTable
    plan: Plan
    flight_envelope: FlightEnvelope
    center_m: tuple[float, float, float] | None  # commanded; None while no formation flies
    center_velocity_m_s: tuple[float, float, float] | None
    radius_m: float | None  # commanded now, on its way to the plan's
    target_m: tuple[float, float]  # now
    minimum_separation_m: float | None  # estimated, between centres, of pairs that count
    tick: TickView
    control_alive: bool  # this tick was within the watchdog's time of the one before; see also its age
    setpoints_sent: int
    interventions: int  # of the safety filter, since the start: vehicles it changed, summed over ticks
    alarms: tuple[Alarm, ...] = ()  # most severe first, of one severity newest first
    selected: SelectedShow | None = None  # None: formation, target and orbit follow the panels
    start_unix_time_s: float | None = None  # scheduled, and not reached yet
    countdown_s: float | None = None
    failsafes: tuple[ActiveFailsafe, ...] = ()  # those whose causes last, most severe first
    interrupted: InterruptedFlight | None = None  # a flight that was cut off, and is not settled
    playback: Playback | None = None  # None: this is no replay
    estimates: Estimates | None = None  # rows as in `rows`; None: nothing is estimated, as in a replay

    @cached_property
    def counts(self) -> Counts:
        return self.rows.counts()

    @cached_property
    def vehicles(self) -> tuple[VehicleView, ...]:
        return self.rows.one_by_one()
