"""What may be asked of the service: protocols, and the audit of a service that keeps none."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from gcs.model.frames import ShowFrame
from gcs.model.interrupted_flight import Offer
from gcs.model.plan import Formation, Obstacle, Orbit, Target, Yaw
from gcs.model.preflight_report import PreflightReport
from gcs.model.state import VehicleId
from gcs.service.alarms import Alarm
from gcs.service.commands import CommandRecord, ShowAction, VehicleAction
from gcs.service.event_log import LogEvent
from gcs.service.latest import Latest
from gcs.service.replay_marks import ReplayMarks
from gcs.service.snapshots import FleetView, Playback, ReportState, SelectedShow, ShowCheck, StoredShow


class Shows(Protocol):
    """The show files that the service keeps. Nothing here waits in the control loop.

    Raises: InvalidError, RefusedError, UnknownError; then nothing has changed.
    """

    @property
    def why_not_kept(self) -> str:
        """Why no file can be uploaded here; empty when one can."""
        ...

    async def list_shows(self) -> list[StoredShow]:
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

        False, soon, when it is not (no record, a full disk): the view's alarms say so.
        """
        ...


class NoAudit:
    """Where nothing is recorded, and nothing was promised."""

    def call(self, call: Call) -> None:
        """Nothing."""

    async def kept(self) -> bool:
        """At once: nobody asked for a record."""
        return True


class Replaying(Protocol):
    """How a record is played. Raises: InvalidError, RefusedError; then nothing has changed."""

    @property
    def playback(self) -> Playback:
        """Now."""
        ...

    @property
    def marks(self) -> ReplayMarks:
        """What a scrubber shows of the whole record; it never changes."""
        ...

    def change(
        self,
        *,
        paused: bool | None = None,
        speed: float | None = None,
        position_s: float | None = None,
        skips_idle: bool | None = None,
    ) -> Playback:
        """Play it otherwise: what is given changes, at once."""
        ...

    def make_flight_report(self) -> ReportState:
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
    ) -> CommandRecord:
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

    def command_vehicle(self, vehicle_id: VehicleId, action: VehicleAction) -> CommandRecord:
        """Order one vehicle."""
        ...

    def command_vehicles(
        self, action: VehicleAction, vehicles: Sequence[VehicleId] | None = None
    ) -> CommandRecord:
        """One command for a selection: hold, join, return, land or take control.

        Args:
            action: what; CONFIRM_DOWN is for one vehicle alone.
            vehicles: those it is for; None: all that it can apply to. Those that it cannot reach are named in
                the record, with the reason. Raises: RefusedError when it reaches none of them.
        """
        ...

    def preflight(self, vehicles: Sequence[VehicleId] | None = None) -> PreflightReport:
        """What a start of these, or of all, would find: everything that is checked, vehicle by vehicle."""
        ...

    def exclude(self, vehicle_id: VehicleId, reason: str) -> CommandRecord:
        """Take a vehicle out of the show, on the ground, until it is included again."""
        ...

    def include(self, vehicle_id: VehicleId) -> CommandRecord:
        """Take it into the show again."""
        ...

    def kill(self, vehicle_ids: Sequence[VehicleId]) -> CommandRecord:
        """Motors off, now, of everybody named; who cannot be reached is told in the order."""
        ...

    def acknowledge_alarm(self, alarm_id: str) -> Alarm:
        """Note that whoever calls has seen an alarm; it stays listed while its cause lasts."""
        ...

    def acknowledge_alarms(self) -> Sequence[Alarm]:
        """Acknowledge all alarms; returns those that were not acknowledged before."""
        ...

    def settle(self, offer: Offer) -> CommandRecord:
        """Go on with a flight that was cut off, or bring it home, as it is offered."""
        ...

    def command_record(self, command_id: str) -> CommandRecord:
        """An accepted order, with its newest outcomes."""
        ...

    def commands(self) -> Sequence[CommandRecord]:
        """The last orders, the newest first."""
        ...

    def events(self) -> Sequence[LogEvent]:
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
