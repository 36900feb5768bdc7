"""Typed Python client of the REST API.

    with Client("http://127.0.0.1:8000") as client:
        order = client.start()
        client.wait_for(order.id, timeout_s=120)
        client.change_formation(radius_m=15)
        client.shows.upload("lighthouse", Path("lighthouse.yaml"))

If the service requires a token, pass it: `Client(url, token="gcs_...")`. With `emergency_url` the calls that
pause, stop, land and kill go to the emergency listener first; without an answer there, to `url`.

A refused call raises the same error that the service raised.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self
from urllib.parse import urlencode

from gcs.client.http import Calls, Deferred, Exchange, calls, part
from gcs.model.errors import CommandError, InvalidError, LinkError

if TYPE_CHECKING:
    from gcs import service
    from gcs.api.schemas import fleet as schemas
    from gcs.api.schemas import reports
else:
    schemas = Deferred("gcs.api.schemas.fleet")
    reports = Deferred("gcs.api.schemas.reports")
    service = Deferred("gcs.service")

URL: Final = "http://127.0.0.1:8000"

PENDING: Final = "pending"

ASK_AGAIN_S: Final = 0.2
"""Period of polling a command: outcomes follow the autopilots' heartbeats, once a second."""

CHECK_AGAIN_S: Final = 0.5
"""Period of polling a check, which takes about a minute."""


def _content(file: Path) -> bytes:
    """Return a file's content. Raises: InvalidError when it cannot be read."""
    try:
        return file.read_bytes()
    except OSError as error:
        raise InvalidError("file", str(file), f"a file to read: {error.strerror or error}") from None


class PreflightCalls(Calls):
    """Checks before a start, and exclusion of vehicles. Raises the errors of `Client`."""

    def report(self, vehicles: list[str] | None = None) -> service.PreflightReport:
        """Get every check for a start of `vehicles`, or of all that are not left out."""
        named = f"?{urlencode([('vehicles', name) for name in vehicles])}" if vehicles else ""
        report: service.PreflightReport = self._exchange.call("GET", f"/api/v1/preflight{named}", self.report)
        return report

    def wait_until_ready(
        self, timeout_s: float, vehicles: list[str] | None = None
    ) -> service.PreflightReport:
        """Wait until every check passes. A service that does not answer yet is waited for as well.

        Returns: the newest report, which may not pass after `timeout_s`.
        Raises: LinkError if the service does not answer after `timeout_s`.
        """
        deadline_s = time.monotonic() + timeout_s
        while True:
            left_s = deadline_s - time.monotonic()
            try:
                report = self.report(vehicles)
                if report.passes or left_s <= 0.0:
                    return report
            except LinkError:
                if left_s <= 0.0:
                    raise
            time.sleep(min(ASK_AGAIN_S, max(left_s, 0.0)))

    @calls("POST", "/api/v1/vehicles/{vehicle_id}/exclude")
    def exclude(self, vehicle_id: str, *, reason: str | None = None) -> service.CommandRecord:
        """Exclude a vehicle from the show, on the ground."""

    @calls("POST", "/api/v1/vehicles/{vehicle_id}/include")
    def include(self, vehicle_id: str) -> service.CommandRecord:
        """Include a vehicle in the show again."""


class PlaybackCalls(Calls):
    """Playback of a record. Raises the errors of `Client`; RefusedError if the service controls vehicles."""

    @calls("GET", "/api/v1/replay")
    def now(self) -> service.Playback:
        """Get position and speed of the playback."""

    @calls("POST", "/api/v1/replay")
    def change(
        self,
        *,
        paused: bool | None = None,
        speed: float | None = None,
        position_s: float | None = None,
        skips_idle: bool | None = None,
    ) -> service.Playback:
        """Change the given fields of the playback."""

    @calls("GET", "/api/v1/replay/report")
    def report(self) -> service.ReportState:
        """Get the flight report; the first call starts its analysis, so poll until it is done."""


class ShowsCalls(Calls):
    """Show files of the service, their checks, and the selected show. Raises the errors of `Client`."""

    @calls("GET", "/api/v1/shows")
    def stored(self) -> list[service.StoredShow]:
        """List the stored show files."""

    def text(self, name: str) -> str:
        """Get the text of a show file."""
        return self._file(name).text

    @calls("GET", "/api/v1/shows/{name}")
    def _file(self, name: str) -> reports.ShowText:
        """Get a show file."""

    def upload(self, name: str, file: Path | str) -> service.StoredShow:
        """Upload a show under a name; `file` is a path, or the YAML text itself.

        Raises: InvalidError when there is no such file.
        """
        content = _content(file) if isinstance(file, Path) else file.encode()
        stored: service.StoredShow = self._exchange.call(
            "PUT", f"/api/v1/shows/{part(name)}", self.upload, content
        )
        return stored

    def import_drawing(self, name: str, file: Path) -> reports.ImportedShow:
        """Make a show of a drawing, the file of another program: .skyc, .zip or .csv.

        Raises: InvalidError when there is no such file, or it is no drawing that can be read.
        """
        query = urlencode({"name": name, "format": file.suffix.lower().removeprefix(".")})
        path = f"/api/v1/shows?{query}"
        imported: reports.ImportedShow = self._exchange.call(
            "POST", path, self.import_drawing, _content(file), "application/octet-stream"
        )
        return imported

    @calls("GET", "/api/v1/shows/{name}/drawing")
    def drawing(self, name: str) -> reports.DrawnSamples:
        """Get positions and colours of a drawn show at regular times."""

    @calls("GET", "/api/v1/shows/{name}/placement")
    def placement(self, name: str) -> reports.PlacedShow:
        """Get where a drawn show lies, and how far the vehicles stand from its pads."""

    def place(
        self,
        name: str,
        *,
        x_m: float | None = None,
        y_m: float | None = None,
        turn_deg: float | None = None,
        fit: bool = False,
    ) -> reports.PlacedShow:
        """Move and turn a drawn show with its pads, which must be checked again.

        What is not given stays. With `fit` the pads are fitted to where the vehicles stand, from there on.
        """
        named = {"x_m": x_m, "y_m": y_m, "turn_deg": turn_deg}
        given = {key: value for key, value in named.items() if value is not None} | {"fit": str(fit).lower()}
        path = f"/api/v1/shows/{part(name)}/placement?{urlencode(given)}"
        placed: reports.PlacedShow = self._exchange.call("GET", path, self.placement)
        return self._placed(name, placed.x_m, placed.y_m, placed.turn_deg)

    @calls("PUT", "/api/v1/shows/{name}/placement")
    def _placed(self, name: str, x_m: float, y_m: float, turn_deg: float) -> reports.PlacedShow:
        """Store the placement."""

    @calls("DELETE", "/api/v1/shows/{name}")
    def remove(self, name: str) -> None:
        """Delete a show file."""

    @calls("POST", "/api/v1/shows/{name}/check")
    def check(self, name: str) -> service.ShowCheck:
        """Start the check of a show."""

    @calls("GET", "/api/v1/shows/{name}/check")
    def checked(self, name: str) -> service.ShowCheck:
        """Get the newest check of a show, or its progress."""

    def wait_for_check(self, name: str, timeout_s: float) -> service.ShowCheck:
        """Wait until a check is done or has failed. Raises: CommandError after `timeout_s`."""
        deadline_s = time.monotonic() + timeout_s
        while (check := self.checked(name)).state in {"waiting", "running"}:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                raise CommandError(f"the check of {name} is not done after {timeout_s:g} s")
            time.sleep(min(CHECK_AGAIN_S, left_s))
        return check

    @calls("POST", "/api/v1/shows/{name}/select", show_hash="hash")
    def select(self, name: str, show_hash: str) -> service.SelectedShow:
        """Select a checked show for the next start."""

    @calls("POST", "/api/v1/show/deselect")
    def deselect(self) -> None:
        """Return to manual control: formation, target and orbit follow the operator's commands."""

    @calls("POST", "/api/v1/show/seek")
    def seek(self, cue: str) -> service.SelectedShow:
        """Let the selected show begin at a cue."""

    @calls("POST", "/api/v1/show/begin")
    def begin(self, at_unix_time_s: float) -> service.SelectedShow:
        """Let the selected show begin to move at a clock time."""

    @calls("DELETE", "/api/v1/show/begin")
    def cancel_begin(self) -> service.SelectedShow:
        """Cancel that time; in the air the show then waits for another."""

    @calls("POST", "/api/v1/show/external-clock")
    def follow_external_clock(self, follow: bool) -> None:
        """Let shows follow an external clock, or this station's."""


class SiteCalls(Calls):
    """The areas of the site, and their file. Raises the errors of `Client`."""

    @calls("GET", "/api/v1/site")
    def stored(self) -> service.SiteView:
        """Get the site as its file has it."""

    def text(self, form: str) -> str:
        """Get the site as a file: geojson, kml or plan."""
        content: bytes = self._exchange.call("GET", f"/api/v1/site/{part(form)}")
        return content.decode()

    def change(self, file: Path | str, *, version: str | None = None) -> service.SiteView:
        """Replace the site, on the ground; it counts from the next start of the service on.

        Args:
            file: a path of a file of GeoJSON, or its text.
            version: of the site that was edited; None: that of the file now.

        Raises: InvalidError when there is no such file.
        """
        content = _content(file) if isinstance(file, Path) else file.encode()
        of = self.stored().version if version is None else version
        site: service.SiteView = self._exchange.call(
            "PUT", f"/api/v1/site?version={part(of)}", self.change, content, "application/geo+json"
        )
        return site


class Client(Calls):
    """Client of one service. Not for use by several threads at once.

    Every call raises LinkError when the service cannot be reached or control is not alive, InvalidError for
    a value that is never accepted, RefusedError for a command that is not possible now, UnknownError for an
    unknown name, and AccessError when the token lacks the right, or after too many calls.
    """

    def __init__(
        self,
        url: str = URL,
        *,
        token: str | None = None,
        emergency_url: str | None = None,
        ca_file: Path | None = None,
        timeout_s: float = 5.0,
    ) -> None:
        """Make a client, which connects at the first call.

        Args:
            url: URL of the service, http or https.
            token: from `gcs token create`.
            emergency_url: URL of the same service's emergency listener.
            ca_file: PEM file of the authority that signed the service's certificate. None: the system's.
            timeout_s: time limit of every call.

        Raises: ConfigError for an invalid certificate file.
        """
        super().__init__(Exchange(url, token, emergency_url, ca_file, timeout_s))
        self.shows = ShowsCalls(self._exchange)
        self.site = SiteCalls(self._exchange)
        self.preflight = PreflightCalls(self._exchange)
        self.playback = PlaybackCalls(self._exchange)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._exchange.close()

    @calls("GET", "/healthz")
    def health(self) -> reports.Health:
        """Get the health of control. Raises: LinkError with the reason when control is not alive."""

    @calls("GET", "/readyz")
    def readiness(self) -> reports.Readiness:
        """Get the readiness. Raises: LinkError with the reason when no vehicle can be commanded."""

    def metrics(self) -> str:
        """Get every metric, in the text format of Prometheus."""
        text: bytes = self._exchange.call("GET", "/metrics")
        return text.decode()

    @calls("GET", "/api/v1/fleet")
    def fleet(self) -> schemas.Fleet:
        """Get the whole state at one instant."""

    @calls("GET", "/api/v1/status")
    def status(self) -> schemas.Status:
        """Get the data that changes seldom: fence, take-off positions, cues, events."""

    @calls("GET", "/api/v1/access")
    def access(self) -> reports.Access:
        """Get the name of the token and its rights."""

    @calls("GET", "/api/v1/stations")
    def stations(self) -> list[service.StationView]:
        """Get every station of the site; empty where one station flies all vehicles."""

    @calls("POST", "/api/v1/stations/lead")
    def take_lead(self) -> list[service.StationView]:
        """Have the station that is asked lead. Raises: RefusedError where one station flies all vehicles."""

    @calls("POST", "/api/v1/stations/{name}/take-over")
    def take_over_station(self, name: str) -> service.CommandRecord:
        """Fly on with the vehicles of a lost station. Raises: RefusedError."""

    @calls("GET", "/api/v1/vehicles")
    def vehicles(self) -> list[schemas.Vehicle]:
        """Get every vehicle."""

    @calls("GET", "/api/v1/features")
    def features(self) -> service.Features:
        """Get what each feature reports; None: it is not configured."""

    @calls("GET", "/api/v1/vehicles/{vehicle_id}")
    def vehicle(self, vehicle_id: str) -> schemas.Vehicle:
        """Get one vehicle."""

    @calls("POST", "/api/v1/vehicles/{vehicle_id}/{action}")
    def command(self, vehicle_id: str, action: str) -> service.CommandRecord:
        """Command one vehicle: hold, join, return, land, take-control, confirm-down or find."""

    @calls("POST", "/api/v1/fleet/{action}")
    def command_vehicles(self, action: str, vehicles: list[str] | None = None) -> service.CommandRecord:
        """Command several vehicles at once: hold, join, return, land or take-control.

        `vehicles` None: all to which the command can apply. The result lists vehicles that the command does
        not reach as `not-included`, with the reason.
        """

    @calls("POST", "/api/v1/kill")
    def arm_kill(self, vehicles: list[str] | None = None) -> schemas.KillArmed:
        """Do the first step of a kill: get a code and its vehicles. None: all that are not offline."""

    @calls("POST", "/api/v1/kill/confirm")
    def confirm_kill(self, code: str) -> service.CommandRecord:
        """Do the second step: the motors of the code's vehicles stop, even in the air."""

    @calls("GET", "/api/v1/show")
    def show(self) -> schemas.Show:
        """Get the show's phase, and the commands that it accepts now."""

    @calls("GET", "/api/v1/show/marks")
    def marks(self) -> service.FlightMarks:
        """Get phases, commands and alarms of the flight so far, or of the whole record of a replay."""

    @calls("POST", "/api/v1/show/start")
    def start(
        self,
        vehicles: list[str] | None = None,
        *,
        show_hash: str | None = None,
        at_unix_time_s: float | None = None,
    ) -> service.CommandRecord:
        """Start with `vehicles` or all but those left out, now or later. A selected show needs its hash."""

    @calls("POST", "/api/v1/show/confirm", go_hash="hash")
    def confirm(self, go_hash: str) -> service.CommandRecord:
        """Confirm the start that another token proposed; `go()` has its hash."""

    @calls("GET", "/api/v1/go")
    def go(self) -> service.GoView:
        """Get what a start needs of people: the proposed start, checklists, weather."""

    @calls("POST", "/api/v1/go/sign")
    def sign(self, role: str, items: list[int]) -> service.GoView:
        """Sign items of a role's checklist, by their numbers."""

    @calls("POST", "/api/v1/go/reopen")
    def reopen(self, role: str, items: list[int]) -> service.GoView:
        """Take the signatures of these items back."""

    @calls("PUT", "/api/v1/go/weather")
    def enter_weather(
        self,
        *,
        wind_m_s: float | None = None,
        gust_m_s: float | None = None,
        visibility_m: float | None = None,
        kp: float | None = None,
    ) -> service.GoView:
        """Enter the weather as it is now."""

    @calls("POST", "/api/v1/show/stop")
    def stop(self) -> service.CommandRecord:
        """Return all vehicles home and land them."""

    @calls("POST", "/api/v1/show/pause")
    def pause(self) -> service.CommandRecord:
        """Stop all vehicles where they are."""

    @calls("POST", "/api/v1/show/resume")
    def resume(self) -> service.CommandRecord:
        """Continue after a pause."""

    @calls("POST", "/api/v1/show/abort")
    def abort(self) -> service.CommandRecord:
        """Descend at once, each vehicle to a landing site of its own."""

    @calls("POST", "/api/v1/show/take-over")
    def take_over(self) -> service.CommandRecord:
        """Continue an interrupted flight: its vehicles join the formation, which holds until `resume`."""

    @calls("POST", "/api/v1/show/bring-home")
    def bring_home(self) -> service.CommandRecord:
        """Return the vehicles of an interrupted flight to their take-off positions."""

    def interrupted(self) -> service.InterruptedFlight | None:
        """Get an unsettled interrupted flight, and what can be commanded for it; None: there is none."""
        return self.fleet().interrupted

    @calls("GET", "/api/v1/alarms")
    def alarms(self) -> schemas.AlarmList:
        """Get all alarms and the overall severity."""

    @calls("POST", "/api/v1/alarms/{alarm_id}/acknowledge")
    def acknowledge(self, alarm_id: str) -> service.Alarm:
        """Acknowledge an alarm. Raises: UnknownError that names the listed alarms."""

    @calls("POST", "/api/v1/alarms/acknowledge")
    def acknowledge_all(self) -> list[service.Alarm]:
        """Acknowledge all alarms. Returns: those that were not acknowledged before."""

    @calls("GET", "/api/v1/commands")
    def commands(self) -> list[service.CommandRecord]:
        """Get the last commands, the newest first."""

    @calls("GET", "/api/v1/commands/{command_id}")
    def command_record(self, command_id: str) -> service.CommandRecord:
        """Get a command and its outcomes so far."""

    def wait_for(self, command_id: str, timeout_s: float) -> service.CommandRecord:
        """Wait until a command is done or has failed; its `outcome` says which.

        Raises: CommandError that names the vehicles still pending after `timeout_s`.
        """
        deadline_s = time.monotonic() + timeout_s
        while (command := self.command_record(command_id)).outcome == PENDING:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                pending = [name for name, part in command.outcomes.items() if part.outcome == PENDING]
                raise CommandError(f"{command.action} not done after {timeout_s:g} s by {', '.join(pending)}")
            time.sleep(min(ASK_AGAIN_S, left_s))
        return command

    @calls("GET", "/api/v1/formation")
    def formation(self) -> schemas.Formation:
        """Get radius and height, desired and commanded now."""

    @calls("PATCH", "/api/v1/formation")
    def change_formation(
        self, *, radius_m: float | None = None, height_m: float | None = None, law: str | None = None
    ) -> schemas.Formation:
        """Change the given fields."""

    @calls("GET", "/api/v1/target")
    def target(self) -> schemas.Target:
        """Get the target's position and velocity now."""

    @calls("PUT", "/api/v1/target")
    def set_target(
        self,
        x_m: float,
        y_m: float,
        *,
        velocity_x_m_s: float = 0.0,
        velocity_y_m_s: float = 0.0,
        height_m: float = 0.0,
        clearance_m: float = 0.0,
    ) -> schemas.Target:
        """Set the target's position and velocity, in the show frame."""

    @calls("PUT", "/api/v1/target")
    def set_target_geodetic(
        self,
        latitude_deg: float,
        longitude_deg: float,
        *,
        velocity_north_m_s: float = 0.0,
        velocity_east_m_s: float = 0.0,
        height_m: float = 0.0,
        clearance_m: float = 0.0,
    ) -> schemas.Target:
        """Set the target's position (WGS84) and velocity."""

    @calls("GET", "/api/v1/targets")
    def targets(self) -> service.TargetsView:
        """Get the targets that the formation can follow, and which one it follows."""

    @calls("POST", "/api/v1/targets/select")
    def select_target(self, name: str) -> service.TargetsView:
        """Follow a target."""

    @calls("POST", "/api/v1/targets/hold")
    def hold_target(self) -> schemas.Target:
        """Follow none of them: the target stands where it is now."""

    @calls("GET", "/api/v1/traffic")
    def traffic(self) -> service.TrafficView:
        """Get other traffic, and how near it comes."""

    @calls("POST", "/api/v1/targets/{name}/report")
    def report_target(
        self,
        name: str,
        latitude_deg: float,
        longitude_deg: float,
        *,
        altitude_amsl_m: float | None = None,
        north_m_s: float | None = None,
        east_m_s: float | None = None,
        deviation_m: float | None = None,
        velocity_deviation_m_s: float | None = None,
        source_s: float | None = None,
    ) -> None:
        """Report where a target is that has a source of kind rest."""

    @calls("GET", "/api/v1/orbit")
    def orbit(self) -> service.Orbit:
        """Get the orbit of the formation around the target."""

    @calls("PATCH", "/api/v1/orbit")
    def change_orbit(
        self, *, radius_m: float | None = None, speed_m_s: float | None = None, direction: str | None = None
    ) -> service.Orbit:
        """Change the given fields."""

    @calls("GET", "/api/v1/yaw")
    def yaw(self) -> schemas.Yaw:
        """Get the vehicles' yaw policy and heading."""

    @calls("PATCH", "/api/v1/yaw")
    def change_yaw(self, *, policy: str | None = None, heading_deg: float | None = None) -> schemas.Yaw:
        """Change the given fields."""

    @calls("GET", "/api/v1/obstacles")
    def obstacles(self) -> list[service.Obstacle]:
        """Get every obstacle."""

    @calls("GET", "/api/v1/obstacles/{obstacle_id}")
    def obstacle(self, obstacle_id: str) -> service.Obstacle:
        """Get one obstacle."""

    @calls("POST", "/api/v1/obstacles", obstacle_id="id")
    def add_obstacle(
        self,
        *,
        x_m: float,
        y_m: float,
        half_length_x_m: float,
        half_length_y_m: float,
        height_m: float,
        velocity_x_m_s: float = 0.0,
        velocity_y_m_s: float = 0.0,
        obstacle_id: str | None = None,
    ) -> service.Obstacle:
        """Add a box; without an id the service assigns one."""

    @calls("PUT", "/api/v1/obstacles/{obstacle_id}")
    def change_obstacle(
        self,
        obstacle_id: str,
        *,
        x_m: float,
        y_m: float,
        half_length_x_m: float,
        half_length_y_m: float,
        height_m: float,
        velocity_x_m_s: float = 0.0,
        velocity_y_m_s: float = 0.0,
    ) -> service.Obstacle:
        """Replace the box of this id."""

    @calls("DELETE", "/api/v1/obstacles/{obstacle_id}")
    def remove_obstacle(self, obstacle_id: str) -> None:
        """Remove a box."""
