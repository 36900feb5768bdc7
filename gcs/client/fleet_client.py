"""Typed Python client of the REST API.

    with Client("http://127.0.0.1:8000") as client:
        order = client.start()
        client.wait_for(order.id, timeout_s=120)
        client.change_formation(radius_m=15)
        client.shows.upload("lighthouse", Path("lighthouse.yaml"))

Where the service asks for a token, give it: `Client(url, token="gcs_...")`. With `emergency_url` the calls
that pause, stop, land and kill go to the listener which answers nothing else; when nobody answers there, to
`url`.

Everything that the service refuses is raised as the error that the service raised itself.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self, TypeVar
from urllib.parse import quote

from gcs.client.deferred import Deferred
from gcs.client.http import Exchange
from gcs.client.preflight import Preflight
from gcs.client.replay import Playback
from gcs.client.shows import Shows
from gcs.model.errors import CommandError, LinkError

if TYPE_CHECKING:
    import pydantic
    from pydantic import BaseModel

    from gcs.api.schemas import alarms as alarm_schemas
    from gcs.api.schemas import kill as kill_schemas
    from gcs.api.schemas import rest as schemas
    from gcs.api.schemas import stream as stream_schemas
    from gcs.api.schemas.recovery import InterruptedFlight
else:
    pydantic = Deferred("pydantic")
    schemas = Deferred("gcs.api.schemas.rest")
    alarm_schemas = Deferred("gcs.api.schemas.alarms")
    kill_schemas = Deferred("gcs.api.schemas.kill")
    stream_schemas = Deferred("gcs.api.schemas.stream")

M = TypeVar("M", bound="BaseModel")

URL: Final = "http://127.0.0.1:8000"

PENDING: Final = "pending"

URGENT: Final = frozenset({"hold", "return", "land"})
"""What goes to the listener for emergency calls, where there is one."""

ASK_AGAIN_S: Final = 0.2
"""Between two looks at an order: outcomes come with the autopilots' heartbeats, once a second."""


class Client:
    """One service, by its address. Not for use by several threads at once.

    Every call raises LinkError when the service cannot be reached or control is not alive, InvalidError for
    a value that can never be accepted, RefusedError for what is not possible now, UnknownError for what does
    not exist, AccessError for what the token may not do, and for too many calls.
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
        """Connects with the first call.

        Args:
            url: of the service, http or https.
            token: from `gcs token create`.
            emergency_url: of the same service's listener for emergency calls alone.
            ca_file: PEM; https is believed when this has signed its certificate. None: who the system trusts.
            timeout_s: of every call.

        Raises: ConfigError for a certificate file that is none.
        """
        self._exchange = Exchange(url, token, emergency_url, ca_file, timeout_s)
        self.shows = Shows(self)
        self.preflight = Preflight(self)
        self.playback = Playback(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection."""
        self._exchange.close()

    def health(self) -> schemas.Health:
        """Raises: LinkError, saying why, when control is not alive."""
        return self.one(lambda: schemas.Health, "GET", "/healthz")

    def readiness(self) -> schemas.Readiness:
        """Raises: LinkError, saying why, when nobody can be ordered anything."""
        return self.one(lambda: schemas.Readiness, "GET", "/readyz")

    def metrics(self) -> str:
        """Every metric, in Prometheus' text format."""
        return self.call("GET", "/metrics").decode()

    def fleet(self) -> schemas.Fleet:
        """Everything at one instant."""
        return self.one(lambda: schemas.Fleet, "GET", "/api/v1/fleet")

    def status(self) -> stream_schemas.Status:
        """What changes seldom: the fence, home places, cues, events and so on."""
        return self.one(lambda: stream_schemas.Status, "GET", "/api/v1/status")

    def access(self) -> stream_schemas.Access:
        """Whose token this is, and what it may do."""
        return self.one(lambda: stream_schemas.Access, "GET", "/api/v1/access")

    def vehicles(self) -> list[schemas.Vehicle]:
        """Every vehicle."""
        return self.many(lambda: schemas.Vehicle, "/api/v1/vehicles")

    def vehicle(self, vehicle_id: str) -> schemas.Vehicle:
        """One vehicle."""
        return self.one(lambda: schemas.Vehicle, "GET", f"/api/v1/vehicles/{_part(vehicle_id)}")

    def command(self, vehicle_id: str, action: str) -> schemas.Command:
        """Order one vehicle: hold, join, return, land, take-control or confirm-down."""
        path = f"/api/v1/vehicles/{_part(vehicle_id)}/{_part(action)}"
        return self.one(lambda: schemas.Command, "POST", path, urgent=action in URGENT)

    def command_vehicles(self, action: str, vehicles: list[str] | None = None) -> schemas.Command:
        """Order several at once: hold, join, return, land or take-control. None: all that it can apply to.

        Those that the order does not reach are in it as `not-included`, with the reason.
        """
        path, body = f"/api/v1/fleet/{_part(action)}", _given(vehicles=vehicles)
        return self.one(lambda: schemas.Command, "POST", path, body or None, urgent=action in URGENT)

    def arm_kill(self, vehicles: list[str] | None = None) -> kill_schemas.KillArmed:
        """The first step of a kill: whom the code will kill. None: all that are not offline."""
        body = _given(vehicles=vehicles)
        return self.one(lambda: kill_schemas.KillArmed, "POST", "/api/v1/kill", body or None, urgent=True)

    def confirm_kill(self, code: str) -> schemas.Command:
        """The second step: their motors stop, even in the air."""
        return self.one(lambda: schemas.Command, "POST", "/api/v1/kill/confirm", {"code": code}, urgent=True)

    def show(self) -> schemas.Show:
        """Where the show stands."""
        return self.one(lambda: schemas.Show, "GET", "/api/v1/show")

    def start(
        self,
        vehicles: list[str] | None = None,
        *,
        show_hash: str | None = None,
        at_unix_time_s: float | None = None,
    ) -> schemas.Command:
        """Start with `vehicles`, or with all that are online; a selected show by its hash; now, or later."""
        body = _given(vehicles=vehicles, show_hash=show_hash, at_unix_time_s=at_unix_time_s)
        return self.one(lambda: schemas.Command, "POST", "/api/v1/show/start", body or None)

    def stop(self) -> schemas.Command:
        """Everybody comes home and lands."""
        return self.one(lambda: schemas.Command, "POST", "/api/v1/show/stop", urgent=True)

    def pause(self) -> schemas.Command:
        """Everybody stands still."""
        return self.one(lambda: schemas.Command, "POST", "/api/v1/show/pause", urgent=True)

    def resume(self) -> schemas.Command:
        """Go on after a pause."""
        return self.one(lambda: schemas.Command, "POST", "/api/v1/show/resume")

    def abort(self) -> schemas.Command:
        """Everybody descends to distinct places, now."""
        return self.one(lambda: schemas.Command, "POST", "/api/v1/show/abort", urgent=True)

    def take_over(self) -> schemas.Command:
        """Go on with a flight that was cut off: into the formation, which stands until `resume`."""
        return self.one(lambda: schemas.Command, "POST", "/api/v1/show/take-over")

    def bring_home(self) -> schemas.Command:
        """Bring a flight that was cut off home to where it took off."""
        return self.one(lambda: schemas.Command, "POST", "/api/v1/show/bring-home", urgent=True)

    def interrupted(self) -> InterruptedFlight | None:
        """A flight that was cut off and is not settled, and what can be ordered; None: there is none."""
        return self.fleet().interrupted

    def alarms(self) -> alarm_schemas.AlarmList:
        """What an operator should know now, and the state of the whole."""
        return self.one(lambda: alarm_schemas.AlarmList, "GET", "/api/v1/alarms")

    def acknowledge(self, alarm_id: str) -> alarm_schemas.Alarm:
        """Say that an alarm was seen. Raises: UnknownError, naming those that are listed."""
        path = f"/api/v1/alarms/{_part(alarm_id)}/acknowledge"
        return self.one(lambda: alarm_schemas.Alarm, "POST", path, urgent=True)

    def acknowledge_all(self) -> list[alarm_schemas.Alarm]:
        """Acknowledge all alarms; returns those that were not acknowledged before."""
        return self.many(lambda: alarm_schemas.Alarm, "/api/v1/alarms/acknowledge", "POST", urgent=True)

    def commands(self) -> list[schemas.Command]:
        """The last orders, the newest first."""
        return self.many(lambda: schemas.Command, "/api/v1/commands")

    def command_record(self, command_id: str) -> schemas.Command:
        """How far an order has got."""
        return self.one(lambda: schemas.Command, "GET", f"/api/v1/commands/{_part(command_id)}")

    def wait_for(self, command_id: str, timeout_s: float) -> schemas.Command:
        """The order once it is done or has failed, which its `outcome` says.

        Raises: CommandError naming the vehicles that are still at it after `timeout_s`.
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
        """Radius and height, wanted and now."""
        return self.one(lambda: schemas.Formation, "GET", "/api/v1/formation")

    def change_formation(
        self, *, radius_m: float | None = None, height_m: float | None = None
    ) -> schemas.Formation:
        """Change what is given."""
        body = _given(radius_m=radius_m, height_m=height_m)
        return self.one(lambda: schemas.Formation, "PATCH", "/api/v1/formation", body)

    def target(self) -> schemas.Target:
        """Where the target is now."""
        return self.one(lambda: schemas.Target, "GET", "/api/v1/target")

    def set_target(
        self, x_m: float, y_m: float, *, velocity_x_m_s: float = 0.0, velocity_y_m_s: float = 0.0
    ) -> schemas.Target:
        """Say where the target is, in the show frame."""
        body = {"x_m": x_m, "y_m": y_m, "velocity_x_m_s": velocity_x_m_s, "velocity_y_m_s": velocity_y_m_s}
        return self.one(lambda: schemas.Target, "PUT", "/api/v1/target", body)

    def set_target_geodetic(
        self,
        latitude_deg: float,
        longitude_deg: float,
        *,
        velocity_north_m_s: float = 0.0,
        velocity_east_m_s: float = 0.0,
    ) -> schemas.Target:
        """Say where the target is, on the globe."""
        body = {
            "latitude_deg": latitude_deg,
            "longitude_deg": longitude_deg,
            "velocity_north_m_s": velocity_north_m_s,
            "velocity_east_m_s": velocity_east_m_s,
        }
        return self.one(lambda: schemas.Target, "PUT", "/api/v1/target", body)

    def orbit(self) -> schemas.Orbit:
        """How the formation circles the target."""
        return self.one(lambda: schemas.Orbit, "GET", "/api/v1/orbit")

    def change_orbit(
        self,
        *,
        radius_m: float | None = None,
        speed_m_s: float | None = None,
        direction: str | None = None,
    ) -> schemas.Orbit:
        """Change what is given."""
        body = _given(radius_m=radius_m, speed_m_s=speed_m_s, direction=direction)
        return self.one(lambda: schemas.Orbit, "PATCH", "/api/v1/orbit", body)

    def yaw(self) -> schemas.Yaw:
        """Where the vehicles look."""
        return self.one(lambda: schemas.Yaw, "GET", "/api/v1/yaw")

    def change_yaw(self, *, policy: str | None = None, heading_deg: float | None = None) -> schemas.Yaw:
        """Change what is given."""
        return self.one(
            lambda: schemas.Yaw, "PATCH", "/api/v1/yaw", _given(policy=policy, heading_deg=heading_deg)
        )

    def obstacles(self) -> list[schemas.Obstacle]:
        """Every obstacle."""
        return self.many(lambda: schemas.Obstacle, "/api/v1/obstacles")

    def obstacle(self, obstacle_id: str) -> schemas.Obstacle:
        """One obstacle."""
        return self.one(lambda: schemas.Obstacle, "GET", f"/api/v1/obstacles/{_part(obstacle_id)}")

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
        """Add a box; without an id it is given one."""
        box = _box(x_m, y_m, half_length_x_m, half_length_y_m, height_m)
        body = box | _moving(velocity_x_m_s, velocity_y_m_s) | _given(id=obstacle_id)
        return self.one(lambda: schemas.Obstacle, "POST", "/api/v1/obstacles", body)

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
        box = _box(x_m, y_m, half_length_x_m, half_length_y_m, height_m)
        body = box | _moving(velocity_x_m_s, velocity_y_m_s)
        return self.one(lambda: schemas.Obstacle, "PUT", f"/api/v1/obstacles/{_part(obstacle_id)}", body)

    def remove_obstacle(self, obstacle_id: str) -> None:
        """Forget a box."""
        self.call("DELETE", f"/api/v1/obstacles/{_part(obstacle_id)}")

    def one(
        self,
        model: Callable[[], type[M]],
        method: str,
        path: str,
        body: dict[str, Any] | bytes | None = None,
        *,
        urgent: bool = False,
    ) -> M:
        """One thing that a path answers. Its model is asked for once the answer is there."""
        answer = self.call(method, path, body, urgent=urgent)
        try:
            return model().model_validate_json(answer)
        except pydantic.ValidationError as error:
            raise LinkError(f"{path} answered what this client does not understand") from error

    def many(
        self, model: Callable[[], type[M]], path: str, method: str = "GET", *, urgent: bool = False
    ) -> list[M]:
        """A list of things that a path answers."""
        answer = self.call(method, path, urgent=urgent)
        try:
            kind = model()
            return pydantic.TypeAdapter(list[kind]).validate_json(answer)  # type: ignore[valid-type]
        except pydantic.ValidationError as error:
            raise LinkError(f"{path} answered what this client does not understand") from error

    def call(
        self, method: str, path: str, body: dict[str, Any] | bytes | None = None, *, urgent: bool = False
    ) -> bytes:
        """What a path answers; a body is JSON, or a show file as it is."""
        return self._exchange.call(method, path, body, urgent=urgent)


def _part(name: str) -> str:
    """A name as one part of a path, whatever is in it."""
    return quote(name, safe="")


def _given(**fields: object) -> dict[str, Any]:
    return {name: value for name, value in fields.items() if value is not None}


def _box(
    x_m: float, y_m: float, half_length_x_m: float, half_length_y_m: float, height_m: float
) -> dict[str, Any]:
    return {
        "x_m": x_m,
        "y_m": y_m,
        "half_length_x_m": half_length_x_m,
        "half_length_y_m": half_length_y_m,
        "height_m": height_m,
    }


def _moving(velocity_x_m_s: float, velocity_y_m_s: float) -> dict[str, Any]:
    return {"velocity_x_m_s": velocity_x_m_s, "velocity_y_m_s": velocity_y_m_s}
