"""The one narrow interface between control and everything above it: orders in, newest state out.

The API, the console and the command line know the service by this file alone, so that control can move to
a process of its own without a change on their side.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any, Final, Generic, Protocol, TypeVar

from gcs.checks import PreflightReport
from gcs.errors import Problem
from gcs.frames import ShowFrame
from gcs.happenings import Happening
from gcs.interrupted import Interrupted, Offer
from gcs.lifecycle import ShowPhase
from gcs.plan import Formation, Obstacle, Orbit, Plan, Target, Yaw
from gcs.rows import VehicleRows, VehicleView
from gcs.state import VehicleId

T = TypeVar("T")

WHO: Final[ContextVar[str]] = ContextVar("who", default="service")
"""Who orders, in this task: a token's name, `local` without tokens, `service` when nobody has called."""


class ShowAction(StrEnum):
    """What can be asked of the whole show."""

    START = "start"
    STOP = "stop"  # come home and land
    PAUSE = "pause"
    RESUME = "resume"
    ABORT = "abort"  # filtered descent to distinct places, now


class VehicleAction(StrEnum):
    """What can be asked of one vehicle."""

    HOLD = "hold"  # leaves the formation, the autopilot holds position
    JOIN = "join"  # from HOLD back into the formation
    RETURN = "return"  # home through the filter, and land
    LAND = "land"  # filtered descent where it is
    HAND_BACK = "hand-back"  # a pilot's vehicle becomes ours again, in HOLD
    CONFIRM_DOWN = "confirm-down"  # an operator has seen a lost vehicle on the ground


class Outcome(StrEnum):
    """How far an order has got with one vehicle."""

    PENDING = "pending"
    DONE = "done"
    FAILED = "failed"
    NOT_INCLUDED = "not-included"  # the order does not touch it; the reason says why


@dataclass(frozen=True, slots=True)
class VehicleOutcome:
    """One vehicle's part of an order."""

    outcome: Outcome
    reason: str = ""


@dataclass(frozen=True, slots=True)
class OrderRecord:
    """An accepted order and what has become of it, vehicle by vehicle."""

    id: str
    action: str
    accepted_time_s: float  # Unix time
    outcomes: dict[VehicleId, VehicleOutcome]
    by: str  # see WHO

    @property
    def outcome(self) -> Outcome:
        """PENDING while any vehicle is, then FAILED if any has, else DONE."""
        seen = {part.outcome for part in self.outcomes.values()}
        for worst in (Outcome.PENDING, Outcome.FAILED):
            if worst in seen:
                return worst
        return Outcome.DONE


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
    good: bool = False
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
class Reaction:
    """What the service does by itself, for as long as its cause lasts; see `gcs.reactions`."""

    cause: str
    action: str
    reason: str  # in words
    vehicles: tuple[VehicleId, ...]  # whom it concerns; empty: nobody in particular
    since_s: float  # loop clock
    since_unix_s: float
    order_id: str | None  # None: nothing was ordered, for what goes on is no weaker, or it waits


@dataclass(frozen=True, slots=True)
class Bounds:
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


@dataclass(frozen=True)
class FleetView:
    """The newest state of everything, complete in itself."""

    time_s: float  # loop clock (monotonic)
    unix_time_s: float
    show: ShowPhase
    reason: str
    rows: VehicleRows
    plan: Plan
    bounds: Bounds
    center_m: tuple[float, float, float] | None  # commanded; None while no formation flies
    center_velocity_m_s: tuple[float, float, float] | None
    radius_m: float | None  # commanded now, on its way to the plan's
    target_m: tuple[float, float]  # now
    minimum_separation_m: float | None  # believed, between centres, of pairs that count
    tick: TickView
    control_alive: bool  # this tick came within the deadman's time of the one before; its age says the rest
    setpoints_sent: int
    interventions: int  # of the safety filter, since the beginning: for each vehicle and tick that it changed
    notices: tuple[str, ...] = ()  # what an operator should know now, in words: the most urgent first
    selected: SelectedShow | None = None  # None: formation, target and orbit are as told
    start_unix_time_s: float | None = None  # ordered, and not reached yet
    countdown_s: float | None = None
    reactions: tuple[Reaction, ...] = ()  # those whose causes last, the most severe first
    interrupted: Interrupted | None = None  # a flight that was cut off, and is not settled
    playback: Playback | None = None  # None: this is no replay

    @cached_property
    def vehicles(self) -> tuple[VehicleView, ...]:
        """One by one; made when somebody looks."""
        return self.rows.one_by_one()


class Latest(Generic[T]):
    """The newest value of something, for any number of readers, none of whom can delay the writer."""

    def __init__(self, value: T) -> None:
        self._value = value
        self._make: Callable[[], T] | None = None
        self._changed = asyncio.Event()

    @property
    def value(self) -> T:
        """The newest."""
        make, self._make = self._make, None
        if make is not None:
            self._value = make()
        return self._value

    def set(self, value: T) -> None:
        """Replace it and wake everybody who waits."""
        self._value, self._make = value, None
        self._wake()

    def promise(self, make: Callable[[], T]) -> None:
        """The same, but the value is made only when somebody looks: most of them nobody looks at."""
        self._make = make
        self._wake()

    def _wake(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()

    async def changed(self) -> None:
        """Return with the next change."""
        await self._changed.wait()

    async def values(self) -> AsyncIterator[T]:
        """The value now, then the newest after each change; a slow reader misses those between."""
        while True:
            changed = self._changed  # taken first, so that no change is missed
            yield self.value
            await changed.wait()


class Shows(Protocol):
    """The show files that the service keeps. Nothing here waits in the control loop.

    Raises: InvalidError, RefusedError, UnknownError; then nothing has changed.
    """

    async def listed(self) -> list[StoredShow]:
        """All of them, by name."""
        ...

    async def text(self, name: str) -> str:
        """The file, as it was given."""
        ...

    async def store(self, name: str, text: bytes) -> StoredShow:
        """Keep a file under a name, in place of what had it: all of it or nothing."""
        ...

    async def remove(self, name: str) -> None:
        """Forget a file."""
        ...

    def check(self, name: str) -> ShowCheck:
        """Begin `gcs show check` in a process of its own."""
        ...

    def checked(self, name: str) -> ShowCheck:
        """How far the newest check has got."""
        ...


@dataclass(frozen=True, slots=True)
class Call:
    """A call of the API and how it was answered."""

    who: str
    method: str
    path: str
    body: str
    status: int


class Audit(Protocol):
    """Where everything ordered is noted. Nothing here raises, and nothing but `kept` waits."""

    def call(self, call: Call) -> None:
        """Note a call that may change something, or was denied."""
        ...

    async def kept(self) -> bool:
        """Return once everything noted and ordered so far is on the disk.

        False, soon, when it is not (no record, a full disk): the view's notices say so.
        """
        ...


class NoAudit:
    """Where nothing is recorded, and nothing was promised."""

    def call(self, call: Call) -> None:
        """Nothing."""

    async def kept(self) -> bool:
        """At once: nobody asked for a record."""
        return True


@dataclass(frozen=True, slots=True)
class Certification:
    """How far the judgement of a record has got, and what it found."""

    state: CheckState
    reason: str = ""  # why it failed
    report: dict[str, Any] | None = None  # as `gcs certify --json` tells it


class Replaying(Protocol):
    """How a record is played. Raises: InvalidError, RefusedError; then nothing has changed."""

    @property
    def playback(self) -> Playback:
        """Now."""
        ...

    def change(
        self, *, paused: bool | None = None, speed: float | None = None, position_s: float | None = None
    ) -> Playback:
        """Play it otherwise: what is given changes, at once."""
        ...

    def certify(self) -> Certification:
        """The judgement of the record; the first call begins it, in a process of its own."""
        ...


class Service(Protocol):
    """What the API may do.

    Every call returns at once. Raises: InvalidError (never right), RefusedError (not now), UnknownError (no
    such thing); then nothing has changed.
    """

    @property
    def view(self) -> Latest[FleetView]:
        """Newest state, set once a tick."""
        ...

    @property
    def frame(self) -> ShowFrame:
        """Where the show's origin lies."""
        ...

    @property
    def audit(self) -> Audit:
        """Where calls are noted, and what an answer waits for."""
        ...

    @property
    def shows(self) -> Shows:
        """The show files that can be selected."""
        ...

    @property
    def replaying(self) -> Replaying | None:
        """How the record is played; None: this is no replay."""
        ...

    def command_show(
        self,
        action: ShowAction,
        vehicles: Sequence[VehicleId] | None = None,
        *,
        show_hash: str | None = None,
        at_unix_time_s: float | None = None,
    ) -> OrderRecord:
        """Order the whole show.

        Args:
            action: what.
            vehicles: for START only: those that fly; None: all that are online.
            show_hash: for START only: of the selected show; None where none is selected.
            at_unix_time_s: for START only: when they take off; None: now.
        """
        ...

    def select_show(self, name: str, show_hash: str) -> SelectedShow:
        """Have a checked show fly next; on the ground only. `show_hash` is the check's."""
        ...

    def deselect_show(self) -> None:
        """Fly what is told instead; on the ground only. No effect where none is selected."""
        ...

    def seek_show(self, cue: str) -> SelectedShow:
        """Have the selected show begin at a cue; on the ground only."""
        ...

    def command_vehicle(self, vehicle_id: VehicleId, action: VehicleAction) -> OrderRecord:
        """Order one vehicle."""
        ...

    def preflight(self, vehicles: Sequence[VehicleId] | None = None) -> PreflightReport:
        """What a start of these, or of all, would find: everything that is checked, vehicle by vehicle."""
        ...

    def exclude(self, vehicle_id: VehicleId, reason: str) -> OrderRecord:
        """Take a vehicle out of the show, on the ground, until it is included again."""
        ...

    def include(self, vehicle_id: VehicleId) -> OrderRecord:
        """Take it into the show again."""
        ...

    def kill(self, vehicle_ids: Sequence[VehicleId]) -> OrderRecord:
        """Motors off, now, of everybody named; who cannot be reached is told in the order."""
        ...

    def settle(self, offer: Offer) -> OrderRecord:
        """Go on with a flight that was cut off, or bring it home, as it is offered."""
        ...

    def order(self, order_id: str) -> OrderRecord:
        """An accepted order, with its newest outcomes."""
        ...

    def orders(self) -> Sequence[OrderRecord]:
        """The last orders, the newest first."""
        ...

    def happenings(self) -> Sequence[Happening]:
        """What happened last, the newest last."""
        ...

    def set_formation(self, formation: Formation) -> None:
        """Change radius and height; the formation follows within its limits."""
        ...

    def set_orbit(self, orbit: Orbit) -> None:
        """Change how the centre circles the target."""
        ...

    def set_target(self, target: Target) -> None:
        """Tell where the target is and how it moves; `time_s` is overwritten with now."""
        ...

    def set_yaw(self, yaw: Yaw) -> None:
        """Change where the vehicles look."""
        ...

    def add_obstacle(self, obstacle: Obstacle) -> None:
        """Add a box; RefusedError when the id is taken or it would stand on a vehicle in the air."""
        ...

    def change_obstacle(self, obstacle: Obstacle) -> None:
        """Replace the box of the same id."""
        ...

    def remove_obstacle(self, obstacle_id: str) -> None:
        """Forget a box."""
        ...
