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
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self

from gcs.client.call_groups import Playback, Preflight, Shows
from gcs.client.http import Deferred, Exchange, given, part
from gcs.model.errors import CommandError

if TYPE_CHECKING:
    from gcs.api.schemas import fleet as schemas
    from gcs.api.schemas import reports
else:
    schemas = Deferred("gcs.api.schemas.fleet")
    reports = Deferred("gcs.api.schemas.reports")

URL: Final = "http://127.0.0.1:8000"

PENDING: Final = "pending"

URGENT: Final = frozenset({"hold", "return", "land"})
"""Vehicle actions that go to the emergency listener, if there is one."""

ASK_AGAIN_S: Final = 0.2
"""Period of polling a command: outcomes follow the autopilots' heartbeats, once a second."""


class Client:
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
        self._exchange = Exchange(url, token, emergency_url, ca_file, timeout_s)
        self.shows = Shows(self._exchange)
        self.preflight = Preflight(self._exchange)
        self.playback = Playback(self._exchange)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._exchange.close()

    def health(self) -> reports.Health:
        """Get the health of control. Raises: LinkError with the reason when control is not alive."""
        return self._exchange.one(lambda: reports.Health, "GET", "/healthz")

    def readiness(self) -> reports.Readiness:
        """Get the readiness. Raises: LinkError with the reason when no vehicle can be commanded."""
        return self._exchange.one(lambda: reports.Readiness, "GET", "/readyz")

    def metrics(self) -> str:
        """Get every metric, in the text format of Prometheus."""
        return self._exchange.call("GET", "/metrics").decode()

    def fleet(self) -> schemas.Fleet:
        """Get the whole state at one instant."""
        return self._exchange.one(lambda: schemas.Fleet, "GET", "/api/v1/fleet")

    def status(self) -> schemas.Status:
        """Get the data that changes seldom: fence, take-off positions, cues, events."""
        return self._exchange.one(lambda: schemas.Status, "GET", "/api/v1/status")

    def access(self) -> reports.Access:
        """Get the name of the token and its rights."""
        return self._exchange.one(lambda: reports.Access, "GET", "/api/v1/access")

    def vehicles(self) -> list[schemas.Vehicle]:
        return self._exchange.many(lambda: schemas.Vehicle, "/api/v1/vehicles")

    def vehicle(self, vehicle_id: str) -> schemas.Vehicle:
        return self._exchange.one(lambda: schemas.Vehicle, "GET", f"/api/v1/vehicles/{part(vehicle_id)}")

    def command(self, vehicle_id: str, action: str) -> schemas.Command:
        """Command one vehicle: hold, join, return, land, take-control or confirm-down."""
        path = f"/api/v1/vehicles/{part(vehicle_id)}/{part(action)}"
        return self._exchange.one(lambda: schemas.Command, "POST", path, urgent=action in URGENT)

    def command_vehicles(self, action: str, vehicles: list[str] | None = None) -> schemas.Command:
        """Command several vehicles at once: hold, join, return, land or take-control.

        `vehicles` None: all to which the command can apply. The result lists vehicles that the command does
        not reach as `not-included`, with the reason.
        """
        path, body = f"/api/v1/fleet/{part(action)}", given(vehicles=vehicles)
        return self._exchange.one(
            lambda: schemas.Command, "POST", path, body or None, urgent=action in URGENT
        )

    def arm_kill(self, vehicles: list[str] | None = None) -> schemas.KillArmed:
        """Do the first step of a kill: get a code and its vehicles. None: all that are not offline."""
        body = given(vehicles=vehicles)
        return self._exchange.one(
            lambda: schemas.KillArmed, "POST", "/api/v1/kill", body or None, urgent=True
        )

    def confirm_kill(self, code: str) -> schemas.Command:
        """Do the second step: the motors of the code's vehicles stop, even in the air."""
        return self._exchange.one(
            lambda: schemas.Command, "POST", "/api/v1/kill/confirm", {"code": code}, urgent=True
        )

    def show(self) -> schemas.Show:
        """Get the show's phase, and the commands that it accepts now."""
        return self._exchange.one(lambda: schemas.Show, "GET", "/api/v1/show")

    def start(
        self,
        vehicles: list[str] | None = None,
        *,
        show_hash: str | None = None,
        at_unix_time_s: float | None = None,
    ) -> schemas.Command:
        """Start with `vehicles` or all online ones, now or later. A selected show needs its hash."""
        body = given(vehicles=vehicles, show_hash=show_hash, at_unix_time_s=at_unix_time_s)
        return self._exchange.one(lambda: schemas.Command, "POST", "/api/v1/show/start", body or None)

    def stop(self) -> schemas.Command:
        """Return all vehicles home and land them."""
        return self._exchange.one(lambda: schemas.Command, "POST", "/api/v1/show/stop", urgent=True)

    def pause(self) -> schemas.Command:
        """Stop all vehicles where they are."""
        return self._exchange.one(lambda: schemas.Command, "POST", "/api/v1/show/pause", urgent=True)

    def resume(self) -> schemas.Command:
        """Continue after a pause."""
        return self._exchange.one(lambda: schemas.Command, "POST", "/api/v1/show/resume")

    def abort(self) -> schemas.Command:
        """Descend at once, each vehicle to a landing site of its own."""
        return self._exchange.one(lambda: schemas.Command, "POST", "/api/v1/show/abort", urgent=True)

    def take_over(self) -> schemas.Command:
        """Continue an interrupted flight: its vehicles join the formation, which holds until `resume`."""
        return self._exchange.one(lambda: schemas.Command, "POST", "/api/v1/show/take-over")

    def bring_home(self) -> schemas.Command:
        """Return the vehicles of an interrupted flight to their take-off positions."""
        return self._exchange.one(lambda: schemas.Command, "POST", "/api/v1/show/bring-home", urgent=True)

    def interrupted(self) -> schemas.InterruptedFlight | None:
        """Get an unsettled interrupted flight, and what can be commanded for it; None: there is none."""
        return self.fleet().interrupted

    def alarms(self) -> schemas.AlarmList:
        """Get all alarms and the overall severity."""
        return self._exchange.one(lambda: schemas.AlarmList, "GET", "/api/v1/alarms")

    def acknowledge(self, alarm_id: str) -> schemas.Alarm:
        """Acknowledge an alarm. Raises: UnknownError that names the listed alarms."""
        path = f"/api/v1/alarms/{part(alarm_id)}/acknowledge"
        return self._exchange.one(lambda: schemas.Alarm, "POST", path, urgent=True)

    def acknowledge_all(self) -> list[schemas.Alarm]:
        """Acknowledge all alarms. Returns: those that were not acknowledged before."""
        return self._exchange.many(lambda: schemas.Alarm, "/api/v1/alarms/acknowledge", "POST", urgent=True)

    def commands(self) -> list[schemas.Command]:
        """Get the last commands, the newest first."""
        return self._exchange.many(lambda: schemas.Command, "/api/v1/commands")

    def command_record(self, command_id: str) -> schemas.Command:
        """Get a command and its outcomes so far."""
        return self._exchange.one(lambda: schemas.Command, "GET", f"/api/v1/commands/{part(command_id)}")

    def wait_for(self, command_id: str, timeout_s: float) -> schemas.Command:
        """Wait until a command is done or has failed; its `outcome` says which.

        Raises: CommandError that names the vehicles still pending after `timeout_s`.
        """
        deadline_s = time.monotonic() + timeout_s
        while True:
            command = self.command_record(command_id)
            if command.outcome != PENDING:
                return command
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                pending = [name for name, part in command.vehicles.items() if part.outcome == PENDING]
                raise CommandError(f"{command.action} not done after {timeout_s:g} s by {', '.join(pending)}")
            time.sleep(min(ASK_AGAIN_S, left_s))

    def formation(self) -> schemas.Formation:
        """Get radius and height, desired and commanded now."""
        return self._exchange.one(lambda: schemas.Formation, "GET", "/api/v1/formation")

    def change_formation(
        self, *, radius_m: float | None = None, height_m: float | None = None
    ) -> schemas.Formation:
        """Change the given fields."""
        body = given(radius_m=radius_m, height_m=height_m)
        return self._exchange.one(lambda: schemas.Formation, "PATCH", "/api/v1/formation", body)

    def target(self) -> schemas.Target:
        """Get the target's position and velocity now."""
        return self._exchange.one(lambda: schemas.Target, "GET", "/api/v1/target")

    def set_target(
        self, x_m: float, y_m: float, *, velocity_x_m_s: float = 0.0, velocity_y_m_s: float = 0.0
    ) -> schemas.Target:
        """Set the target's position and velocity, in the show frame."""
        body = {"x_m": x_m, "y_m": y_m, "velocity_x_m_s": velocity_x_m_s, "velocity_y_m_s": velocity_y_m_s}
        return self._exchange.one(lambda: schemas.Target, "PUT", "/api/v1/target", body)

    def set_target_geodetic(
        self,
        latitude_deg: float,
        longitude_deg: float,
        *,
        velocity_north_m_s: float = 0.0,
        velocity_east_m_s: float = 0.0,
    ) -> schemas.Target:
        """Set the target's position (WGS84) and velocity."""
        body = {
            "latitude_deg": latitude_deg,
            "longitude_deg": longitude_deg,
            "velocity_north_m_s": velocity_north_m_s,
            "velocity_east_m_s": velocity_east_m_s,
        }
        return self._exchange.one(lambda: schemas.Target, "PUT", "/api/v1/target", body)

    def orbit(self) -> schemas.Orbit:
        """Get the orbit of the formation around the target."""
        return self._exchange.one(lambda: schemas.Orbit, "GET", "/api/v1/orbit")

    def change_orbit(
        self,
        *,
        radius_m: float | None = None,
        speed_m_s: float | None = None,
        direction: str | None = None,
    ) -> schemas.Orbit:
        """Change the given fields."""
        body = given(radius_m=radius_m, speed_m_s=speed_m_s, direction=direction)
        return self._exchange.one(lambda: schemas.Orbit, "PATCH", "/api/v1/orbit", body)

    def yaw(self) -> schemas.Yaw:
        """Get the vehicles' yaw policy and heading."""
        return self._exchange.one(lambda: schemas.Yaw, "GET", "/api/v1/yaw")

    def change_yaw(self, *, policy: str | None = None, heading_deg: float | None = None) -> schemas.Yaw:
        """Change the given fields."""
        return self._exchange.one(
            lambda: schemas.Yaw, "PATCH", "/api/v1/yaw", given(policy=policy, heading_deg=heading_deg)
        )

    def obstacles(self) -> list[schemas.Obstacle]:
        return self._exchange.many(lambda: schemas.Obstacle, "/api/v1/obstacles")

    def obstacle(self, obstacle_id: str) -> schemas.Obstacle:
        return self._exchange.one(lambda: schemas.Obstacle, "GET", f"/api/v1/obstacles/{part(obstacle_id)}")

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
    ) -> schemas.Obstacle:
        """Add a box; without an id the service assigns one."""
        box = _box(x_m, y_m, half_length_x_m, half_length_y_m, height_m, velocity_x_m_s, velocity_y_m_s)
        body = box | given(id=obstacle_id)
        return self._exchange.one(lambda: schemas.Obstacle, "POST", "/api/v1/obstacles", body)

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
    ) -> schemas.Obstacle:
        """Replace the box of this id."""
        body = _box(x_m, y_m, half_length_x_m, half_length_y_m, height_m, velocity_x_m_s, velocity_y_m_s)
        return self._exchange.one(
            lambda: schemas.Obstacle, "PUT", f"/api/v1/obstacles/{part(obstacle_id)}", body
        )

    def remove_obstacle(self, obstacle_id: str) -> None:
        self._exchange.call("DELETE", f"/api/v1/obstacles/{part(obstacle_id)}")


def _box(
    x_m: float,
    y_m: float,
    half_length_x_m: float,
    half_length_y_m: float,
    height_m: float,
    velocity_x_m_s: float,
    velocity_y_m_s: float,
) -> dict[str, Any]:
    return {
        "x_m": x_m,
        "y_m": y_m,
        "half_length_x_m": half_length_x_m,
        "half_length_y_m": half_length_y_m,
        "height_m": height_m,
        "velocity_x_m_s": velocity_x_m_s,
        "velocity_y_m_s": velocity_y_m_s,
    }
