"""The sections of a configuration, as frozen settings; keys of quantities end in their unit."""

import re
from functools import cached_property
from itertools import combinations
from math import hypot
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from gcs.config.setting_errors import located
from gcs.formation.laws.registry import LawName
from gcs.links.autopilots import AUTOPILOTS, DEFAULT, Autopilot
from gcs.links.settings import (
    SPARE_ID,
    SYSTEM_ID_MAX,
    Forward,
    Place,
    SigningSettings,
    StreamSettings,
    extra_bytes_per_s,
    occupied,
    station_id,
)
from gcs.links.settings import parse as place_at
from gcs.model.errors import ConfigError
from gcs.model.frames import ShowFrame
from gcs.model.plan import DEFAULT_LAW, Direction, YawPolicy
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import VehicleId

APART_MIN_M = 0.5
"""Least distance of two start places; nearer ones are the same place, written twice."""

LENGTH_MAX_M = 10_000.0


class StartPlace(Settings):
    """Place of a vehicle before the start, in the show frame: x along the show's heading, y to its right."""

    x_m: Annotated[float, Field(strict=True, ge=-LENGTH_MAX_M, le=LENGTH_MAX_M)]
    """Along the show's heading from its origin, in m."""
    y_m: Annotated[float, Field(strict=True, ge=-LENGTH_MAX_M, le=LENGTH_MAX_M)]
    """To the right of that, in m."""


class PreflightSettings(Settings):
    """Limits of the checks. The report names every check that a limit switches off."""

    battery_min: Annotated[float, Field(ge=0.1, le=1)] = 0.25
    """Least charge at the start, as a share; a show's own need counts if it is higher."""
    require_fix: bool = True
    """Whether a 3D fix is needed; false for vehicles with a position source other than GNSS."""
    rotation_max_deg: Annotated[float, Field(gt=0, le=45)] = 2.0
    """Most that the start pattern may be turned from the expected one, in degrees."""
    shift_max_m: Positive = 2.0
    """Most that the pattern's centre may be off, in m."""
    place_max_m: Positive = 1.5
    """Most that one vehicle may be off its own place in the pattern, in m."""
    height_spread_max_m: Positive = 2.0
    """Most that a pad may lie above or below the median height, in m."""
    # Recorded: two vehicles on pads 4 m apart came to 2.3 m while their autopilots climbed and held position.
    wander_m: NotNegative = 0.85
    """How far off its place PX4's own TAKEOFF and HOLD let a vehicle be, in m; 0: not checked."""
    clock_max_s: Positive | None = 2.0
    """Most that the clocks of vehicle and station may differ, in s; null: not checked."""
    start_places: dict[VehicleId, StartPlace] = Field(default_factory=dict)
    """Where each vehicle stands, by id, without a written show; a written show has its own."""

    @model_validator(mode="after")
    def _check(self) -> "PreflightSettings":
        for (one, here), (other, there) in combinations(self.start_places.items(), 2):
            if hypot(here.x_m - there.x_m, here.y_m - there.y_m) < APART_MIN_M:
                raise ValueError(f"start_places: {one} and {other} have the same place")
        return self


SystemId: TypeAlias = Annotated[int, Field(ge=1, le=SYSTEM_ID_MAX)]


def _listed(value: object) -> object:
    """Accept a single value for a list of one."""
    return value if isinstance(value, list | tuple) else (value,)


def _as_forward(value: object) -> object:
    """Accept a URL for a station that only reads."""
    return {"url": value} if isinstance(value, str) else value


def _place(url: str) -> str:
    """Check that a URL describes an endpoint."""
    try:
        place_at(url)
    except ConfigError as error:
        raise ValueError(str(error)) from None
    return url


Urls: TypeAlias = Annotated[
    tuple[Annotated[str, AfterValidator(_place)], ...], BeforeValidator(_listed), Field(min_length=1)
]

Forwards: TypeAlias = Annotated[
    tuple[Annotated[Forward, BeforeValidator(_as_forward)], ...], BeforeValidator(_listed)
]


def _vehicle_id(name: str) -> str:
    if re.fullmatch(r"[A-Za-z0-9_.-]{1,32}", name) is None:
        raise ValueError("1 to 32 of A-Z a-z 0-9 _ . -, without spaces")
    return name


class ShowFrameSettings(Settings):
    """Origin of the show frame, and heading of its x axis."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    """Latitude of the origin, in degrees."""
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]
    """Longitude of the origin, in degrees."""
    altitude_amsl_m: float
    """Altitude of the origin above mean sea level, in m."""
    heading_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """Direction of the show's x axis, in degrees clockwise from north."""

    @property
    def frame(self) -> ShowFrame:
        return ShowFrame(**self.model_dump())


def _autopilot(name: str) -> str:
    if name not in AUTOPILOTS:
        raise ValueError(f"one of {', '.join(AUTOPILOTS)}")
    return name


AutopilotName: TypeAlias = Annotated[str, AfterValidator(_autopilot)]


class VehicleSettings(Settings):
    """One vehicle of a link."""

    id: Annotated[str, AfterValidator(_vehicle_id)]
    """Name of the vehicle everywhere in this station: 1 to 32 letters, digits or `_ . -`."""
    system_id: SystemId
    """MAVLink system id that the vehicle has, unique within its link."""
    autopilot: AutopilotName | None = None
    """`px4` or `ardupilot`; null: that of the link."""
    charge: Positive = 1.0
    """Weight in the repulsion: a vehicle with a greater one gets more room on the sphere."""
    speed_max_m_s: Positive | None = None
    """Most that it can fly in any direction, in m/s; null: the limits of `control.safety`."""


class RangeSettings(Settings):
    """Consecutive system ids, named by a pattern."""

    first_system_id: SystemId = 1
    """System id of the first vehicle."""
    count: Annotated[int, Field(ge=1, le=SYSTEM_ID_MAX)]
    """Number of vehicles, with consecutive system ids."""
    id_pattern: str = "d{system_id}"
    """Name of each; `{system_id}` and `{link}` are filled in, because links may share system ids."""

    @model_validator(mode="after")
    def _check(self) -> "RangeSettings":
        last = self.first_system_id + self.count - 1
        if last > SYSTEM_ID_MAX:
            text = f"the last would have the system_id {last}: at most {SYSTEM_ID_MAX}"
            raise located(text, "count")
        return self

    def expanded(self, link: str) -> tuple[VehicleSettings, ...]:
        pattern = self.id_pattern.replace("{link}", link)
        ids = range(self.first_system_id, self.first_system_id + self.count)
        return tuple(VehicleSettings(id=pattern.replace("{system_id}", str(i)), system_id=i) for i in ids)


def _kind_of_fleet(value: object) -> str:
    """Tag of the union: a list of vehicles, or a range."""
    return "range" if isinstance(value, dict | RangeSettings) else "list"


Fleet: TypeAlias = Annotated[
    Annotated[tuple[VehicleSettings, ...], Tag("list")] | Annotated[RangeSettings, Tag("range")],
    Discriminator(_kind_of_fleet),
]


class LinkSettings(Settings):
    """One link: its endpoints and vehicles. `ports` consecutive UDP ports start with the one in `listen`."""

    name: Annotated[str, Field(min_length=1)]
    """Name of the link in alarms, the log and records."""
    transport: Literal["mavsdk", "native"] = "mavsdk"
    """`mavsdk` through the MAVSDK library, or `native`: this project's own MAVLink, for large fleets."""
    autopilot: AutopilotName = DEFAULT.name
    """`px4` or `ardupilot`, of its vehicles without an `autopilot` of their own."""
    listen: Urls
    """One or several endpoints: `udpin://`, `udpout://`, `tcpin://`, `tcpout://` or `serial://`."""
    ports: Annotated[int, Field(ge=1, le=1000)] = 1
    """Consecutive UDP ports from the one in `listen`: one per vehicle, or 1 for a radio or router."""
    vehicles: Fleet
    """A list of vehicles, or a range of system ids."""
    streams: StreamSettings = StreamSettings()
    """Rates at which the vehicles are asked to report."""
    forward: Forwards = ()
    """Further ground stations that receive the vehicles' messages; a URL alone is read-only."""
    signing: SigningSettings | None = None
    """Key of signed MAVLink 2; without it frames are not signed, and not checked."""
    extra_bytes_per_s: Positive | None = None
    """What features may send together, in bytes/s; null: 100,000, on serial ports a quarter."""
    heartbeat_hold_s: Positive = 3.0
    """The station's heartbeats end when control has stopped for this long, in s."""

    @cached_property
    def fleet(self) -> tuple[VehicleSettings, ...]:
        """Its vehicles, each with its autopilot."""
        vehicles = self.vehicles
        listed = vehicles.expanded(self.name) if isinstance(vehicles, RangeSettings) else vehicles
        return tuple(
            each if each.autopilot else each.model_copy(update={"autopilot": self.autopilot})
            for each in listed
        )

    @cached_property
    def autopilots(self) -> tuple[Autopilot, ...]:
        """The profiles of its vehicles."""
        return tuple(AUTOPILOTS[each.autopilot or self.autopilot] for each in self.fleet)

    @property
    def station_id(self) -> int:
        """System id of this station on the link."""
        ids = [each.system_id for each in self.fleet]
        return station_id(ids) if self.transport == "mavsdk" else SPARE_ID

    @property
    def places(self) -> tuple[Place, ...]:
        """Endpoints of `listen`. Raises: ConfigError."""
        return tuple(place_at(url, self.ports) for url in self.listen)

    @property
    def extra_share_bytes_per_s(self) -> float:
        """What features may send together. Raises: ConfigError."""
        return self.extra_bytes_per_s or extra_bytes_per_s(self.places)

    @model_validator(mode="after")
    def _check(self) -> "LinkSettings":
        try:
            taken = [each for place in self.places for each in occupied(place)]
        except ConfigError as error:
            raise ValueError(f"listen: {error}") from None
        if len(set(taken)) < len(taken):
            raise ValueError("listen: the same place is there twice")
        seen: set[int] = set()
        for vehicle in self.fleet:
            if vehicle.system_id in seen:
                raise ValueError(f"vehicles: system id {vehicle.system_id} is there twice")
            seen.add(vehicle.system_id)
        return self


class ApiSettings(Settings):
    """Address and ports of the REST API."""

    host: str = "127.0.0.1"
    """IP address to listen on; beyond 127.0.0.1 tokens are needed (`access.tokens_file`)."""
    port: Annotated[int, Field(ge=0, le=65535)] = 8000
    """TCP port of the API and the console; 0: any free one."""
    emergency_port: Annotated[int, Field(ge=0, le=65535)] | None = None
    """TCP port that answers emergency calls only; null: the next after `port`."""

    @property
    def lane_port(self) -> int:
        """Port of the emergency listener; 0: any free port."""
        if self.emergency_port is not None:
            return self.emergency_port
        return self.port + 1 if self.port else 0

    @model_validator(mode="after")
    def _check(self) -> "ApiSettings":
        if self.lane_port > 65535 or (self.port and self.lane_port == self.port):
            raise ValueError(f"emergency_port = {self.lane_port}: from 1 to 65535, and not port itself")
        return self


class OperationSettings(Settings):
    """Take-off, assembly and landing."""

    takeoff_height_m: Positive = 5.0
    """Height above its pad to which a vehicle climbs before it joins, in m."""
    takeoff_stagger_s: NotNegative = 1.0
    """Time between the take-offs of two vehicles, in s."""
    takeoff_timeout_s: Positive = 30.0
    """A vehicle that is not up after this time is landed by its autopilot, in s."""
    handover_height_m: Positive = 1.5
    """Height over the landing site below which the autopilot's LAND touches down, in m."""
    landing_site_spacing_m: Positive = 4.0
    """Least distance between the landing sites of a filtered descent, in m."""
    silence_s: Positive = 2.0
    """Without telemetry or a position for this long: offline, or lost if airborne, in s."""
    setpoint_loss_action: Literal["descend", "hold", "land", "return"] = "hold"
    """What the autopilot must do without setpoints (PX4: COM_OBL_RC_ACT)."""
    setpoint_loss_s: Annotated[float, Field(ge=0.5, le=10)] = 1.0
    """How long it may fly on without setpoints before that (PX4: COM_OF_LOSS_T), in s; above 1 vehicles keep
    farther apart on their way."""
    return_height_m: Positive = 30.0
    """Height above home at which the first vehicle returns by itself (RTL_RETURN_ALT), in m."""
    return_layer_m: NotNegative = 4.0
    """So much higher the next in the list returns, up to the fence, in m; 0: all alike."""
    pads_within_m: Positive = 50.0
    """All pads lie within this of the origin, in m; the autopilots' own fences allow for it."""
    pilot_takes_over: bool = True
    """Whether moving a stick must give the pilot control (COM_RC_OVERRIDE, COM_RC_IN_MODE)."""
    require_parameters: bool = True
    """Whether vehicles are refused if their parameters make the loss of this station unsafe."""
    require_safe_setpoint_loss: bool = True
    """Whether a start is refused where `setpoint_loss_action` brings vehicles together."""


class FormationSettings(Settings):
    """Initial sphere of the show, and the law that spreads the vehicles over it (docs/decisions/law.md)."""

    radius_m: Annotated[float, Field(gt=0, le=LENGTH_MAX_M)]
    """Radius of the sphere, in m."""
    height_m: Annotated[float, Field(gt=0, le=LENGTH_MAX_M)]
    """Height of the sphere's centre above the origin, in m."""
    law: LawName = DEFAULT_LAW
    """How vehicles spread: `slots`, `article`, `neighbours`, `flocking`, or a law of an installed package."""


class OrbitSettings(Settings):
    """Initial orbit of the show."""

    radius_m: Annotated[float, Field(ge=0, le=LENGTH_MAX_M)] = 0.0
    """Radius of the circle around the target, in m; 0: the centre stays above the target."""
    speed_m_s: Positive = 2.0
    """Speed of the centre along the circle, in m/s."""
    direction: Direction = Direction.COUNTERCLOCKWISE
    """Sense of the circle, seen from above."""


class InitialTarget(Settings):
    """Initial target of the show, at rest."""

    x_m: float = 0.0
    """Along the show's heading from its origin, in m."""
    y_m: float = 0.0
    """To the right of that, in m."""


class YawSettings(Settings):
    """Initial yaw policy; `heading_deg`, clockwise from north, applies to the policy "fixed"."""

    policy: YawPolicy = YawPolicy.HELD
    """`held`: as when it joined; `fixed`: `heading_deg`; `target`: towards the target."""
    heading_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """For `fixed`: degrees clockwise from north."""


class ShowsSettings(Settings):
    """Folder of uploaded shows."""

    folder: Path
    """Folder of uploaded shows."""
