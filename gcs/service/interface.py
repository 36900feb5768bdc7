"""The service port: one small protocol for each role, and an audit that records nothing."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol, TypedDict, Unpack

from gcs.model.frames import ShowFrame
from gcs.model.interrupted_flight import Offer
from gcs.model.plan import Formation, Obstacle, Orbit, Plan, Target, Yaw
from gcs.model.preflight_report import PreflightReport
from gcs.model.state import VehicleId
from gcs.model.target_fix import TargetFix
from gcs.service.alarms import Alarm
from gcs.service.commands import CommandRecord, ShowAction, VehicleAction
from gcs.service.event_log import LogEvent
from gcs.service.go import GoView, WeatherEntry
from gcs.service.site_view import SiteFormat, SiteView
from gcs.service.snapshots import (
    FleetView,
    FlightMarks,
    Latest,
    Playback,
    ReportState,
    SelectedShow,
    ShowCheck,
    StationView,
    StoredShow,
)

DRAWING_MAX_BYTES: Final = 32 * 1024**2
"""Largest file of a drawing that is uploaded; a show of 500 vehicles and 5 minutes has about 5 MB."""


class Shows(Protocol):
    """The show files that the service stores. Nothing here delays the control loop.

    Raises: InvalidError, RefusedError, UnknownError; then nothing has changed.
    """

    @property
    def why_not_kept(self) -> str:
        """Why no file can be uploaded here; empty when one can."""

    @property
    def rules(self) -> str:
        """What this service's configuration asks of a show file: JSON for `gcs show import --rules`."""

    async def list_shows(self) -> list[StoredShow]:
        """Return all shows, by name."""

    async def text(self, name: str) -> str:
        """Return the file as uploaded."""

    async def store(self, name: str, text: bytes) -> StoredShow:
        """Store a file under a name, replacing the file of that name: completely or not at all."""

    async def store_drawn(self, name: str, text: bytes, drawing: Path) -> StoredShow:
        """As `store`, with the drawing that the show names: a copy of the file `drawing` of this machine."""

    async def drawn_file(self, name: str) -> Path:
        """Return the place of the file of a show that names a drawing, which lies beside it."""

    async def remove(self, name: str) -> None:
        """Delete a file, and its drawing if no other show names that."""

    def check(self, name: str) -> ShowCheck:
        """Start `gcs show check` in a subprocess."""

    def checked(self, name: str) -> ShowCheck:
        """Return the state of the newest check."""


class SiteFile(Protocol):
    """The file of the site, and its change by operators. Nothing here delays the control loop.

    Raises: InvalidError, RefusedError, UnknownError; then nothing has changed.
    """

    async def read(self) -> SiteView:
        """Return the site as its file has it now. UnknownError: the configuration names none."""

    async def text(self, form: SiteFormat) -> bytes:
        """Return that site in a format."""

    async def change(self, text: bytes, version: str) -> SiteView:
        """Replace the file, on the ground. The service flies the new site from its next start on.

        Args:
            text: the whole site as GeoJSON; the file keeps its own format.
            version: of the file of which this change was made; RefusedError when it is another by now.
        """


@dataclass(frozen=True, slots=True)
class Call:
    """A call of the API and its response."""

    caller: str
    method: str
    path: str
    body: str
    status: int


class Audit(Protocol):
    """Records calls and commands. Nothing here raises, and only `kept` waits."""

    def call(self, call: Call) -> None:
        """Record a call that may change something, or was denied."""

    async def kept(self) -> bool:
        """Return once all calls and commands so far are on the disk.

        False, after a short wait, when they are not (no record, a full disk): the view's alarms say so.
        """


class NoAudit:
    """An audit that records nothing, where none is configured."""

    def call(self, call: Call) -> None:
        """Do nothing."""

    async def kept(self) -> bool:
        """Return at once: there is nothing to wait for."""
        return True


class PlaybackChange(TypedDict, total=False):
    """Settings of a playback; those that are not given stay."""

    paused: bool
    speed: float
    position_s: float
    skips_idle: bool


class Replaying(Protocol):
    """Controls a replay. Raises: InvalidError, RefusedError; then nothing has changed."""

    @property
    def playback(self) -> Playback:
        """Current state of the playback."""

    def change(self, **given: Unpack[PlaybackChange]) -> Playback:
        """Change the given settings of the playback, at once."""

    def make_flight_report(self) -> ReportState:
        """Return the flight report; the first call starts it in a subprocess."""


class Commands(Protocol):
    """Commands to the show and its vehicles. Raises: InvalidError, RefusedError, UnknownError."""

    def command_show(
        self,
        action: ShowAction,
        vehicles: Sequence[VehicleId] | None = None,
        *,
        show_hash: str | None = None,
        at_unix_time_s: float | None = None,
    ) -> CommandRecord:
        """Execute a fleet-wide command.

        The other arguments are for START only: the vehicles (None: all but those left out), the hash of the
        selected show (None where none is selected), and when they take off (None: now).
        """

    def confirm_start(self, go_hash: str) -> CommandRecord:
        """Make the start that another token proposed; `go_hash` is the proposal's. Returns: the start."""

    def command_vehicle(self, vehicle_id: VehicleId, action: VehicleAction) -> CommandRecord:
        """Execute a command to one vehicle."""

    def command_vehicles(
        self, action: VehicleAction, vehicles: Sequence[VehicleId] | None = None
    ) -> CommandRecord:
        """Execute one command, except CONFIRM_DOWN and FIND, for a selection; None: all that it can apply to.

        The record names those that it cannot reach, with the reason.

        Raises: RefusedError when it reaches none.
        """

    def kill(self, vehicle_ids: Sequence[VehicleId]) -> CommandRecord:
        """Stop the motors of these vehicles immediately; the record names those that cannot be reached."""


class LastResort(Protocol):
    """Kills vehicles while control does not answer; a further kill does no harm."""

    async def kill(self, vehicle_ids: Sequence[VehicleId]) -> CommandRecord:
        """Send the kill without control. Returns: the command, with its last outcomes."""

    def find(self, command_id: str) -> CommandRecord | None:
        """Return one of its own commands."""


class Go(Protocol):
    """What people say before a start. Raises: InvalidError, RefusedError, UnknownError."""

    def sign(self, role: str, items: Sequence[int]) -> GoView:
        """Sign items of a role's checklist, by their numbers from 1."""

    def reopen(self, role: str, items: Sequence[int]) -> GoView:
        """Take the signatures of these items back."""

    def enter_weather(self, entry: WeatherEntry) -> GoView:
        """Enter the weather as it is now, in place of the last entry; name and time are the service's."""


class Stations(Protocol):
    """Several stations that fly one formation."""

    def take_lead(self) -> Sequence[StationView]:
        """Lead from now on: hold the plan, compute the formation. Returns: all stations."""

    def take_over(self, station: str) -> CommandRecord:
        """Fly on with a lost station's vehicles, for which this one is the standby. Raises: RefusedError."""


class CommandRecords(Protocol):
    """The newest commands and their outcomes."""

    def get(self, command_id: str) -> CommandRecord:
        """Return an accepted command with its newest outcomes. Raises: UnknownError."""

    def newest(self) -> Sequence[CommandRecord]:
        """The newest commands, newest first."""


class Recovery(Protocol):
    """Settles an interrupted flight."""

    def settle(self, offer: Offer) -> CommandRecord:
        """Continue an interrupted flight or return its vehicles, as offered. Raises: RefusedError."""


class Player(Protocol):
    """Selects the show to fly next; on the ground only. Raises: RefusedError, UnknownError."""

    def select(self, name: str, show_hash: str) -> SelectedShow:
        """Select a checked show. `show_hash` is the check's."""

    def deselect(self) -> None:
        """Select no show: the panels decide the plan. No effect without a show."""

    def seek(self, cue: str) -> SelectedShow:
        """Start the selected show at a cue."""

    def begin_at(self, at_unix_time_s: float) -> SelectedShow:
        """Have the selected show begin to move at a clock time, on the ground or while it waits in the air.

        Raises: InvalidError unless it lies ahead; RefusedError once the show has begun.
        """

    def cancel_begin(self) -> SelectedShow:
        """Forget that time. A show that waits in the air then waits until another is given."""

    def follow_external_clock(self, follow: bool) -> None:
        """Have shows follow an external clock, or this station's. RefusedError: none is configured."""


class Preflight(Protocol):
    """Checks before a start, and the vehicles that take part. Raises: RefusedError, UnknownError."""

    def report(self, vehicles: Sequence[VehicleId] | None = None) -> PreflightReport:
        """Report what a start of these, or of all, would find: every check, vehicle by vehicle.

        Raises: UnknownError; RefusedError in the air, when there is none from before take-off.
        """

    def exclude(self, vehicle_id: VehicleId, reason: str) -> CommandRecord:
        """Take a vehicle out of the show, on the ground, until it is included again.

        Raises: UnknownError, InvalidError; RefusedError unless all vehicles are on the ground.
        """

    def include(self, vehicle_id: VehicleId) -> CommandRecord:
        """Include an excluded vehicle again. Raises: UnknownError; RefusedError as above, or if it is not."""


class Alarms(Protocol):
    """Acknowledges alarms."""

    def acknowledge(self, alarm_id: str) -> Alarm:
        """Mark an alarm as acknowledged by the caller; it stays listed while its cause lasts.

        Raises: UnknownError.
        """

    def acknowledge_all(self) -> Sequence[Alarm]:
        """Acknowledge all alarms; returns those that were not acknowledged before."""


class Events(Protocol):
    """The service's log in words."""

    def newest(self) -> Sequence[LogEvent]:
        """The newest events, newest last."""

    @property
    def marks(self) -> FlightMarks:
        """Marks of the flight that lasts, else of the last one; in a replay of the record."""


class PlanChanges(Protocol):
    """The plan, and its changes by operators. Raises: InvalidError, RefusedError, UnknownError.

    `fields`: names of the fields that are changed, the others stay as they are by then; empty: all.
    """

    @property
    def current(self) -> Plan:
        """The plan as of now: an accepted change is in it at once, before the next tick."""

    def set_formation(self, formation: Formation, fields: Sequence[str] = ()) -> None:
        """Change radius and height, which the formation follows within its limits, or the law."""

    def set_orbit(self, orbit: Orbit, fields: Sequence[str] = ()) -> None:
        """Change how the centre circles the target."""

    def set_target(self, target: Target) -> None:
        """Set the target's position and velocity; `time_s` is overwritten with now."""

    def select_target(self, name: str) -> None:
        """Follow a target of the configuration, as its sources report it; empty: none of them."""

    def hold_target(self) -> None:
        """Follow none of them: the target stands where it is now."""

    def report_target(self, name: str, fix: TargetFix) -> None:
        """Report where a target is that has a source of kind rest."""

    def set_yaw(self, yaw: Yaw, fields: Sequence[str] = ()) -> None:
        """Change the vehicles' heading."""

    def add_obstacle(self, obstacle: Obstacle) -> None:
        """Add a box-shaped obstacle; RefusedError if the id is taken or a vehicle flies there."""

    def change_obstacle(self, obstacle: Obstacle) -> None:
        """Replace the obstacle of the same id."""

    def remove_obstacle(self, obstacle_id: str) -> None:
        """Remove an obstacle."""


class Service(Protocol):
    """The service port that the API uses: the newest state, and one object for each role.

    Every call returns at once. Raises: InvalidError (never valid), RefusedError (not now), UnknownError (no
    such object); then nothing has changed.
    """

    @property
    def view(self) -> Latest[FleetView]:
        """Newest state, set once a tick."""

    @property
    def frame(self) -> ShowFrame:
        """Position and heading of the show's origin."""

    @property
    def replaying(self) -> Replaying | None:
        """Controls of the replay; None: this service is no replay."""

    @property
    def audit(self) -> Audit: ...

    @property
    def plan(self) -> PlanChanges: ...

    @property
    def commands(self) -> Commands: ...

    @property
    def stations(self) -> Stations | None:
        """None: one station flies all vehicles."""

    @property
    def command_log(self) -> CommandRecords: ...

    @property
    def recovery(self) -> Recovery: ...

    @property
    def shows(self) -> Shows: ...

    @property
    def site(self) -> SiteFile: ...

    @property
    def player(self) -> Player: ...

    @property
    def preflight(self) -> Preflight: ...

    @property
    def go(self) -> Go: ...

    @property
    def alarms(self) -> Alarms: ...

    @property
    def events(self) -> Events: ...
