"""Snapshots of the whole state, of shows and their checks, of records and their marks. None: not known."""

import asyncio
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Final, Generic, Literal, TypeVar

from pydantic import Field

from gcs.estimation.time_estimates import Estimates
from gcs.model.errors import Problem
from gcs.model.interrupted_flight import InterruptedFlight, Offer
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Plan
from gcs.model.settings import PUBLISHED, Measured
from gcs.model.state import Counts, VehicleId
from gcs.model.traffic import KIND_IN_WORDS, TrackKind
from gcs.service.alarms import Alarm, AlarmSeverity
from gcs.service.event_log import Severity
from gcs.service.features import Features
from gcs.service.go import StartMade
from gcs.service.histograms import Collected, TickHistogram
from gcs.service.vehicle_table import VehicleTable

if TYPE_CHECKING:
    from gcs.safety.fenced_areas import FencedArea
    from gcs.safety.surroundings import SafetySettings

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

    def promise(self, make: Callable[[], T]) -> None:
        """Set a value that is computed on the first read (most are never read), and wake waiting readers."""
        self._make = make
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
    hash: Annotated[
        str | None, Field(description="Of all that is flown; a start names it. null: not checked as it is.")
    ]
    drawing: Annotated[str | None, Field(description="File of the drawing that the show names.")] = None
    replaced: Annotated[bool, Field(description="This upload replaced a show of that name.")] = False


class CheckState(StrEnum):
    """State of a show's check."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"  # the check itself failed: it judges nothing about the show


@dataclass(frozen=True, slots=True)
class CueFigures:
    """One pass through a cue, as flown in virtual time, until the next cue."""

    cue: str
    line: int
    at_s: float  # time of the show, loops included
    radius_m: float  # desired at its end
    height_m: float
    separation_m: Annotated[
        Measured, Field(description="Least separation, in the metric of the separation ellipsoid.")
    ]
    speed_m_s: Measured  # greatest horizontal speed of any vehicle
    radius_error_m: Measured  # median over time of the vehicle that is farthest from the law's shape
    center_off_m: Measured  # at its end, from orbit or target
    held_back: int  # most vehicles at a time that the safety filter limited


@dataclass(frozen=True, slots=True)
class VerticalOverlap:
    """Two vehicles, one above the other during the check: they cannot both descend vertically.

    In flight it may be other vehicles, because the law assigns no slots.
    """

    upper: Annotated[int, Field(description="Vehicle of the show, from 1.")]
    lower: int
    sideways_m: Annotated[float, Field(description="Least horizontal distance between the two vehicles.")]
    cue: Annotated[str, Field(description="Cue at that time.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class ShowFigures:
    """Figures of a show flown in virtual time, from true positions."""

    vehicles: int
    show_s: float  # duration of the timeline, loops included
    assembled_s: float  # from hover until the sphere stood
    home_s: Measured  # from the end of the timeline until the last landing; None: never
    floor_m: float
    separation_min_m: float
    separation_min_at: str  # the cue, "before the show" or "on the way home"
    pairs_below_floor: int
    speed_max_m_s: float
    climb_max_m_s: float
    sink_max_m_s: float
    fence_distance_margin_m: float
    fence_height_margin_m: float  # smaller margin to least or greatest height, during the show
    battery_need: Annotated[float, Field(description="Share of a full battery, reserve included.")]
    vertical_overlaps: Annotated[
        int, Field(description="Pairs whose columns overlap at some time of the show.")
    ]
    columns: Annotated[tuple[VerticalOverlap, ...], Field(description="The nearest of these pairs.")]
    cues: tuple[CueFigures, ...]
    warnings: Annotated[
        tuple[str, ...], Field(description="What an operator should know of a show that is good to fly.")
    ] = ()


@dataclass(frozen=True, slots=True)
class ShowCheck:
    """A running or finished check of a show; only a show that passed may be selected."""

    __pydantic_config__ = PUBLISHED

    name: str
    state: CheckState
    reason: Annotated[
        str, Field(description="Why the check itself failed; it says nothing of the show then.")
    ] = ""
    hash: Annotated[str | None, Field(description="Of everything that is flown; a start must name it.")] = (
        None
    )
    good: Annotated[bool, Field(description="It can be flown, and by this service as it is set now.")] = False
    fits_service: Annotated[
        bool,
        Field(description="false: other settings of the service would remove some of the problems."),
    ] = True
    problems: tuple[Problem, ...] = ()
    figures: Annotated[ShowFigures | None, Field(description="null: not flown.")] = None


@dataclass(frozen=True, slots=True)
class CueMark:
    """A cue as it is played; a cue in a loop occurs several times."""

    cue: str
    at_s: Annotated[float, Field(description="Time on the show's clock, or in a record since its beginning.")]


class BeginState(StrEnum):
    """How a show waits for the beginning that an operator set."""

    ARMED = "armed"  # the vehicles are not where it begins yet
    WAITING = "waiting"  # they are, and it begins by itself
    LATE = "late"  # its time has passed: it begins as soon as they are there
    HELD = "held"  # the time was cancelled in the air: it waits for another


@dataclass(frozen=True, slots=True)
class BeginView:
    """When the selected show begins to move."""

    __pydantic_config__ = PUBLISHED

    state: BeginState
    at_unix_time_s: Annotated[float | None, Field(description="In s since 1970; null: none, it is held.")]
    in_s: Annotated[float | None, Field(description="Until then; negative: it has passed.")]


@dataclass(frozen=True, slots=True)
class SelectedShow:
    """The written show that is or will be flown, and its progress."""

    name: str
    hash: str
    cue: Annotated[str, Field(description="The newest cue.")]
    cues: tuple[str, ...]
    clock_s: Annotated[float, Field(description="The show's own time; 0 when the first sphere stands.")]
    duration_s: Annotated[float, Field(description="Loops played.")]
    runs: Annotated[
        bool,
        Field(
            description="Whether the show's clock runs; false before the show begins and while it is paused."
        ),
    ]
    target_is_live: Annotated[bool, Field(description="Whether PUT target moves the target now.")]
    timeline: Annotated[tuple[CueMark, ...], Field(exclude=True)] = ()  # as played; loops written out
    track_rms_m: Annotated[
        float | None,
        Field(
            description="Distance from the trajectory since the start, as estimated, over time and vehicles;"
            " null while no drawn part has run."
        ),
    ] = None
    track_max_m: Annotated[float | None, Field(description="The greatest such distance of any vehicle.")] = (
        None
    )
    spares: Annotated[
        tuple[str, ...],
        Field(description="Vehicles on the ground that take the places of lost ones; empty without any."),
    ] = ()
    begin: Annotated[
        BeginView | None,
        Field(description="null: it begins as soon as all vehicles are there, or has begun."),
    ] = None
    begun: Annotated[
        bool,
        Field(description="Its clock has run since the start: no time to begin is accepted any more."),
    ] = False
    lit_until_s: Annotated[
        float | None,
        Field(
            description="The show's time until which vehicles are lit, by a drawing also while they"
            " return. null: not known."
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class Scheduling:
    """What the machine grants this process, so that control keeps time beside other programs."""

    priority: Annotated[
        str,
        Field(description="`real-time 10`, `nice -10`, or `usual`: other programs can delay control."),
    ] = "usual"
    memory_locked: Annotated[bool, Field(description="No page of its memory has to be read again.")] = False

    @property
    def text(self) -> str:
        return f"priority {self.priority}, memory {'locked' if self.memory_locked else 'not locked'}"


@dataclass(frozen=True, slots=True)
class TickView:
    """Timing of the control loop."""

    rate_hz: Measured
    count: int
    missed: Annotated[int, Field(description="Dropped, never made up.")]
    duration_p50_ms: Measured
    duration_p99_ms: Measured
    lateness_p99_ms: Measured
    scheduling: Scheduling = Scheduling()


@dataclass(frozen=True, slots=True)
class StationView:
    """One station of the site."""

    name: str
    own: Annotated[bool, Field(description="The station that answers.")]
    leads: Annotated[bool, Field(description="It holds the plan, and computes the formation.")]
    received: Annotated[
        bool, Field(description="Its messages arrive; false: its vehicles are without control.")
    ]
    silent_s: Annotated[Measured, Field(description="Since its newest message; null: none has arrived.")]
    show: ShowPhase
    vehicles: Annotated[int, Field(description="Vehicles that it flies.")]
    delay_s: Annotated[Measured, Field(description="One way, over the bus.")]
    term: Annotated[int, Field(description="Term of the lead that the answering station obeys.")]
    offers: Annotated[
        tuple[Offer, ...],
        Field(description="For its interrupted flight: POST /api/v1/show/take-over, at any station."),
    ] = ()


@dataclass(frozen=True, slots=True)
class BusView:
    """Totals of the bus between the stations, since this station's start."""

    sent: int  # messages, each to all other stations
    sent_bytes: int
    received: int
    refused: int  # damaged, of another version, or not of a station of this site


@dataclass(frozen=True, slots=True)
class ActiveFailsafe:
    """What the service does automatically while a cause lasts; see `gcs.failsafe.policy`."""

    cause: str
    action: str
    reason: str  # in words
    vehicles: tuple[VehicleId, ...]  # concerned; empty: no single vehicle
    since_s: float  # loop clock
    since_unix_time_s: float
    command_id: str | None  # None: no command, because it is done already or must wait


@dataclass(frozen=True, slots=True)
class FenceArea:
    """A polygon on the ground, with heights if it has some."""

    corners_m: Annotated[tuple[tuple[float, float], ...], Field(description="x and y, show frame.")]
    inside: Annotated[bool, Field(description="Vehicles stay inside; false: outside.")]
    height_min_m: Annotated[float | None, Field(description="null: from the ground up.")] = None
    height_max_m: Annotated[float | None, Field(description="null: no limit.")] = None


@dataclass(frozen=True, slots=True)
class FlightEnvelope:
    """The volume that no vehicle may leave, and the ellipsoid around a vehicle that no other may enter."""

    height_min_m: Annotated[
        float, Field(description="Least height of vehicles in the formation, above the show's origin.")
    ]
    height_max_m: float
    distance_max_m: Annotated[float, Field(description="Horizontal distance from the show's origin.")]
    floor_horizontal_m: Annotated[float, Field(description="Horizontal half-axis of the ellipsoid.")]
    floor_vertical_m: Annotated[
        float, Field(description="Vertical half-axis; greater, because a vehicle's air goes down.")
    ]
    margin_m: Annotated[float, Field(description="Added sideways, and in proportion up and down.")]
    areas: Annotated[
        tuple[FenceArea, ...],
        Field(description="Of the site and the selected drawing; empty: only height and distance count."),
    ] = ()
    controlled_ground: Annotated[
        FenceArea | None, Field(description="Where vehicles may fall; null: that is not kept.")
    ] = None

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
            tuple(map(_shown, fence.areas)),
            None if fence.controlled_ground is None else _shown(fence.controlled_ground),
        )


def _shown(area: "FencedArea") -> FenceArea:
    return FenceArea(area.corners_m, area.inside, area.height_min_m, area.height_max_m)


@dataclass(frozen=True, slots=True)
class Playback:
    """A recorded flight that is played back as if live."""

    file: str
    began_unix_time_s: Annotated[float, Field(description="Time of the first recorded state.")]
    duration_s: float
    position_s: Annotated[float, Field(description="Time from the first recorded state to this one.")]
    speed: Annotated[float, Field(description="Playback speed as a multiple of the flight's.")]
    paused: bool
    ended: Annotated[bool, Field(description="The last recorded state is shown.")]
    skips_idle: Annotated[
        bool, Field(description="Time in which nothing flies is jumped over while it plays.")
    ]


@dataclass(frozen=True, slots=True)
class PhaseSpan:
    """A period in one phase of the show. Times are those of `FlightMarks`."""

    phase: ShowPhase
    from_s: float
    until_s: float


@dataclass(frozen=True, slots=True)
class EventMark:
    """An alarm, or a warning or error of the event log."""

    at_s: float
    severity: Severity
    alarm: Annotated[str | None, Field(description="Id of the alarm; null: it is none.")]
    alarm_severity: AlarmSeverity | None
    text: str
    vehicle: Annotated[
        VehicleId | None, Field(description="The vehicle concerned; null: none in particular.")
    ]


@dataclass(frozen=True, slots=True)
class CommandMark:
    """A command of an operator or a program."""

    at_s: float
    action: str
    text: str
    vehicle: Annotated[VehicleId | None, Field(description="Its vehicle; null: several, or the show.")]


@dataclass(frozen=True, slots=True)
class IdleSpan:
    """A period in which no vehicle flies or is about to."""

    from_s: float
    until_s: float


@dataclass(frozen=True, slots=True)
class FlightMarks:
    """Marks for a timeline, in seconds since it began: of the flight that lasts, else of the last one.

    Of a replay those of the whole record; empty when the flight data has no audit beside it.
    """

    began_unix_time_s: Annotated[
        float | None, Field(description="null: nothing has flown since the service began.")
    ] = None
    phases: tuple[PhaseSpan, ...] = ()
    cues: Annotated[tuple[CueMark, ...], Field(description="As they were flown; of a replay only.")] = ()
    commands: Annotated[tuple[CommandMark, ...], Field(description="The newest 500.")] = ()
    events: Annotated[tuple[EventMark, ...], Field(description="At most 500; alarms before others.")] = ()
    idle: Annotated[tuple[IdleSpan, ...], Field(description="Jumped over while `skips_idle` is true.")] = ()


LEEWAY_REPORTED: Final = 1.01
"""A smaller ratio of what is tolerated to the limit is rounding to single precision."""


@dataclass(frozen=True, slots=True)
class ReportCheck:
    """One limit: whether it was kept, and the worst value."""

    name: Annotated[str, Field(examples=["greatest height"])]
    limit: Annotated[float, Field(description="The limit that applied then: a written show has its own.")]
    tolerated: Annotated[
        float,
        Field(description="Kept up to here: an autopilot's own answer may pass the limit by a little."),
    ]
    worst: Annotated[Measured, Field(description="null: there was nothing to judge.")]
    unit: Annotated[str, Field(description="Unit of limit, tolerated and worst.", examples=["m"])]
    vehicle: Annotated[str, Field(description="The vehicle with the worst value.")]
    at_s: Annotated[Measured, Field(description="Time since the beginning of the record.")]
    kept: Annotated[bool | None, Field(description="null: there was nothing to judge.")]

    @property
    def leeway(self) -> str:
        """The tolerance beyond the limit, in words; empty if it is negligible."""
        return f" (kept up to {self.tolerated:g})" if self.tolerated > self.limit * LEEWAY_REPORTED else ""


@dataclass(frozen=True, slots=True)
class NearestPair:
    """Two vehicles at the time when they were nearest, in the metric of the minimum separation."""

    vehicles: tuple[VehicleId, ...]  # two
    distance_m: Measured
    floor_ratio: Annotated[
        Measured, Field(description="Distance as a multiple of the floor: 1 is the floor.")
    ]
    floor_ratio_if_off: Annotated[
        Measured,
        Field(description="The same if both positions were wrong by their margin, towards each other."),
    ]
    at_s: Measured


@dataclass(frozen=True, slots=True)
class TargetTracking:
    """How near the formation's centre was to a target, or to the orbit around it, while it was followed.

    The target is where it was estimated: the record does not know where it truly was.
    """

    target: str
    followed_s: Annotated[float, Field(description="While the show ran and this target was selected.")]
    approach_s: Annotated[float, Field(description="Of these, on the way: no distance counts.")]
    coasting_s: Annotated[float, Field(description="Of these, without reports, on its last motion.")]
    lost_s: Annotated[float, Field(description="Of these, with the target lost: likewise.")]
    median_m: Annotated[Measured, Field(description="null, as the others: it was never reached.")] = None
    p95_m: Measured = None
    worst_m: Measured = None
    worst_at_s: Annotated[Measured, Field(description="Time since the beginning of the record.")] = None
    deviation_m: Annotated[Measured, Field(description="Median deviation of the estimate itself.")] = None

    @property
    def text(self) -> str:
        """All of it, in words."""
        lasts = f"followed for {self.followed_s:g} s, {self.approach_s:g} s of them on the way to it,"
        lasts += f" {self.coasting_s:g} s without reports, {self.lost_s:g} s lost"
        if self.median_m is None:
            return f"{self.target}: {lasts}; it was never reached"
        off = f"{self.median_m:g} m in the median, {self.p95_m:g} m in 95 % of the time"
        worst = f"at worst {self.worst_m:g} m at {self.worst_at_s:g} s"
        estimate = f"from its estimate (standard deviation {self.deviation_m:g} m), not from the true target"
        return f"{self.target}: the centre was {off}, {worst}, away {estimate}; {lasts}"


@dataclass(frozen=True, slots=True)
class TrackPassed:
    """Where a track was nearest to a vehicle, by its cylinder, of those of which operators were alarmed.

    The track is where it was estimated: the record does not know where it truly was.
    """

    track: str
    kind: TrackKind
    vehicle: VehicleId
    outside_m: Annotated[float, Field(description="From the vehicle to the cylinder; negative: in it.")]
    sideways_m: float
    above_m: Annotated[Measured, Field(description="Of the track over the vehicle; null: not known.")]
    deviation_m: Annotated[float, Field(description="Of the estimate, along an axis.")]
    at_s: Annotated[float, Field(description="Time since the beginning of the record.")]

    @property
    def text(self) -> str:
        """All of it, in words."""
        height = "at a height that is not known"
        if self.above_m is not None:
            height = f"{abs(self.above_m):g} m {'above' if self.above_m >= 0.0 else 'below'} the vehicle"
        gap = f"{abs(self.outside_m):g} m {'outside' if self.outside_m >= 0.0 else 'INSIDE'} its cylinder"
        where = f"{self.sideways_m:g} m beside it, {height}"
        estimate = f"by its estimate (standard deviation {self.deviation_m:g} m), not the true track"
        nearest = f"{self.vehicle} was nearest, {gap}, {where}, at {self.at_s:g} s"
        return f"{KIND_IN_WORDS[self.kind]} {self.track}: {nearest}; {estimate}"


@dataclass(frozen=True, slots=True)
class GroundKept:
    """Whether vehicles would have fallen on controlled ground, whenever their motors had stopped."""

    contacts: Annotated[int, Field(description="How often an impact came inside the hard line.")]
    vehicles: Annotated[int, Field(description="Vehicles of these contacts.")]
    margin_m: Annotated[float, Field(description="Least, of an impact to the edge; negative: beyond it.")]
    vehicle: VehicleId
    at_s: Annotated[float, Field(description="Time of the least margin since the beginning of the record.")]
    energy_max_j: Annotated[float, Field(description="Greatest energy of an impact, in J.")]

    @property
    def text(self) -> str:
        """All of it, in words."""
        where = f"{abs(self.margin_m):g} m {'inside' if self.margin_m >= 0.0 else 'BEYOND'} the edge"
        contacts = f"hard line contacted {self.contacts} times, vehicles: {self.vehicles}"
        least = f"{self.vehicle} would have fallen nearest to it, {where}, at {self.at_s:g} s"
        return f"{contacts}; {least}; impacts of up to {self.energy_max_j:g} J"


@dataclass(frozen=True, slots=True)
class ReportBody:
    """The flight report, as `gcs report --json` prints it."""

    source: str
    verdict: Annotated[
        Literal["kept", "broken", "incomplete"],
        Field(description="incomplete: nothing was found broken, but not all of the flight could be judged."),
    ]
    missing: Annotated[
        tuple[str, ...], Field(description="What could not be judged, and why; with times and bytes.")
    ]
    based_on: Annotated[str, Field(examples=["true positions", "estimated positions"])]
    uncertainty: Annotated[str, Field(description="Uncertainty of the positions, in words.")]
    remarks: Annotated[tuple[str, ...], Field(description="Remarks about the file.")]
    vehicles: int
    autopilots: Annotated[
        dict[str, int], Field(description="Number of vehicles by autopilot; empty: not known.")
    ]
    flew: int
    duration_s: float
    checks: tuple[ReportCheck, ...]
    nearest_pairs: tuple[NearestPair, ...]
    tracking: Annotated[
        tuple[TargetTracking, ...], Field(description="Of each target that was followed; empty: of none.")
    ]
    traffic: Annotated[
        tuple[TrackPassed, ...], Field(description="Each track of which operators were alarmed; empty: none.")
    ]
    ground: Annotated[
        GroundKept | None, Field(description="Where vehicles would have fallen; null: no controlled ground.")
    ] = None
    site_hash: Annotated[
        str | None, Field(description="SHA-256 of the areas of the site; null: there were none.")
    ] = None
    show_hashes: Annotated[
        tuple[str, ...], Field(description="Of the written shows that were selected in the air, in order.")
    ] = ()
    starts: Annotated[
        tuple[StartMade, ...],
        Field(
            description="Each start with its names, signatures and weather, where the configuration has `go`."
        ),
    ] = ()
    wind_m_s: Annotated[
        float | None, Field(description="Greatest wind that was measured, with gusts; null: none was.")
    ] = None


@dataclass(frozen=True, slots=True)
class ReportState:
    """The flight report of the record, or its progress."""

    __pydantic_config__ = PUBLISHED

    state: CheckState
    reason: Annotated[str, Field(description="Why it failed, empty when it did not.")] = ""
    report: Annotated[ReportBody | None, Field(description="null until it is done.")] = None


NOT_LOOKED: Final = "it is not known yet whether a start would be accepted"


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
    start_refused: str = NOT_LOOKED  # why a start would be refused now, in short; empty: it would not
    late_samples: int = 0  # dropped, since the start: older than the newest of their kind
    alarms: tuple[Alarm, ...] = ()  # most severe first, of one severity newest first
    selected: SelectedShow | None = None  # None: formation, target and orbit follow the panels
    start_unix_time_s: float | None = None  # scheduled, and not reached yet
    countdown_s: float | None = None
    failsafes: tuple[ActiveFailsafe, ...] = ()  # those whose causes last, most severe first
    interrupted: InterruptedFlight | None = None  # a flight that was cut off, and is not settled
    playback: Playback | None = None  # None: this is no replay
    histograms: tuple[TickHistogram | Collected, ...] = ()  # of the ticks since the start; the first change
    stations: tuple[StationView, ...] = ()  # of the site; empty: one station flies all
    features: Features = Features()
    bus: BusView | None = None  # None: one station flies all
    estimates: Estimates | None = None  # rows as in `rows`; None: nothing is estimated, as in a replay

    @cached_property
    def counts(self) -> Counts:
        return self.rows.counts()
