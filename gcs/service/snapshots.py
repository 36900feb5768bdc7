"""What is told: the newest state of everything, shows and their checks, records. None: not known."""

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any

from gcs.estimation.time_estimates import Estimates
from gcs.model.errors import Problem
from gcs.model.fleet_counts import Counts
from gcs.model.interrupted_flight import InterruptedFlight
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Plan
from gcs.model.state import VehicleId
from gcs.service.alarms import Alarm
from gcs.service.vehicle_table import VehicleTable, VehicleView


@dataclass(frozen=True, slots=True)
class StoredShow:
    """A show file that the service keeps."""

    name: str
    size_bytes: int
    sha256: str  # of the file; what is flown has a hash of its own


class CheckState(StrEnum):
    """How far the check of a show has got."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"  # the check itself: it says nothing of the show


@dataclass(frozen=True, slots=True)
class ShowCheck:
    """What is known of a show that is, or was, checked. Only a good one may be started."""

    name: str
    state: CheckState
    reason: str = ""  # why it failed
    hash: str | None = None  # of everything that is flown; what a start must name
    good: bool = False  # it can be flown, and by this service
    fits_service: bool = True  # False: for `problems` of which a service with other settings has none
    problems: tuple[Problem, ...] = ()
    figures: dict[str, Any] | None = None  # as `gcs show check --json` tells them; None: not flown


@dataclass(frozen=True, slots=True)
class SelectedShow:
    """The show that will be, or is, flown, and how far it has got."""

    name: str
    hash: str
    cue: str  # the newest
    cues: tuple[str, ...]
    clock_s: float  # the show's own time
    duration_s: float  # loops played
    runs: bool  # the clock; False: before it begins, and while it is paused
    target_is_live: bool
    timeline: tuple[tuple[str, float], ...] = ()  # every cue as it is played, and when; loops written out


@dataclass(frozen=True, slots=True)
class Histogram:
    """How often something took how long, since the beginning."""

    bounds_s: tuple[float, ...]  # upper, rising
    counts: tuple[int, ...]  # of each bound alone, and at last of what was above all of them
    sum_s: float


@dataclass(frozen=True, slots=True)
class TickView:
    """How the control loop keeps its time."""

    rate_hz: float
    count: int
    missed: int  # dropped, never made up
    duration_p50_ms: float
    duration_p99_ms: float
    lateness_p99_ms: float
    durations: Histogram
    latenesses: Histogram


@dataclass(frozen=True, slots=True)
class ActiveFailsafe:
    """What the service does by itself, for as long as its cause lasts; see `gcs.failsafe.policy`."""

    cause: str
    action: str
    reason: str  # in words
    vehicles: tuple[VehicleId, ...]  # whom it concerns; empty: nobody in particular
    since_s: float  # loop clock
    since_unix_s: float
    command_id: str | None  # None: nothing was ordered, for what goes on is no weaker, or it waits


@dataclass(frozen=True, slots=True)
class FlightEnvelope:
    """What nobody may pass: the fence, and how near two may come. Heights above the show's origin."""

    height_min_m: float  # of who flies in the formation
    height_max_m: float
    distance_max_m: float  # from the show's origin, over the ground
    floor_horizontal_m: float  # semi-axes of the ellipsoid around one that no other may be inside
    floor_vertical_m: float
    margin_m: float  # kept on top of it, sideways


@dataclass(frozen=True, slots=True)
class Playback:
    """A recorded flight that is played, and how far it has got."""

    file: str
    began_unix_s: float  # of the first recorded state
    duration_s: float
    position_s: float  # since the first recorded state
    speed: float  # times as fast as it was flown
    paused: bool
    ended: bool  # the last recorded state is shown
    skips_idle: bool = False  # time in which nothing flies is jumped over while it plays


@dataclass(frozen=True, slots=True)
class ReportState:
    """How far the judgement of a record has got, and what it found."""

    state: CheckState
    reason: str = ""  # why it failed
    report: dict[str, Any] | None = None  # as `gcs report --json` tells it


@dataclass(frozen=True)
class FleetView:
    """The newest state of everything, complete in itself."""

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
    minimum_separation_m: float | None  # believed, between centres, of pairs that count
    tick: TickView
    control_alive: bool  # this tick came within the deadman's time of the one before; its age says the rest
    setpoints_sent: int
    interventions: int  # of the safety filter, since the beginning: for each vehicle and tick that it changed
    alarms: tuple[Alarm, ...] = ()  # the most severe first, of one severity the newest first
    selected: SelectedShow | None = None  # None: formation, target and orbit are as told
    start_unix_time_s: float | None = None  # ordered, and not reached yet
    countdown_s: float | None = None
    failsafes: tuple[ActiveFailsafe, ...] = ()  # those whose causes last, the most severe first
    interrupted: InterruptedFlight | None = None  # a flight that was cut off, and is not settled
    playback: Playback | None = None  # None: this is no replay
    estimates: Estimates | None = None  # rows as in `rows`; None: nothing is estimated, as in a replay

    @cached_property
    def counts(self) -> Counts:
        """Numbers of vehicles controlled, uncontrolled, unknown, on the ground and offline."""
        return self.rows.counts()

    @cached_property
    def vehicles(self) -> tuple[VehicleView, ...]:
        """One by one; made when somebody looks."""
        return self.rows.one_by_one()
