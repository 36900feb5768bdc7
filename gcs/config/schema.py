"""YAML to frozen settings. An unknown or repeated key is an error; keys of quantities end in their unit."""

import re
from collections import Counter
from collections.abc import Callable
from functools import cached_property
from math import radians
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationError,
    model_validator,
)

from gcs.config import yaml_files as documents
from gcs.config.preflight import PreflightSettings
from gcs.config.rules import fence_too_small, misfits_of_fleet
from gcs.config.setting_errors import explained, located
from gcs.config.yaml_source import Source
from gcs.control import ControlSettings
from gcs.estimation.position_uncertainty import Positioning
from gcs.failsafe.policy import FailsafePolicy
from gcs.links.endpoints.urls import Listen, Place, occupied
from gcs.links.endpoints.urls import parse as place_at
from gcs.links.settings import Forward, RecordSettings, SigningSettings, StreamSettings
from gcs.links.vehicle_ids import INSTANCES_MAX, SYSTEM_ID_MAX, instances
from gcs.model.errors import ConfigError, FileError, InvalidError, Problem
from gcs.model.frames import ShowFrame
from gcs.model.plan import Direction, Formation, Orbit, Plan, Target, Yaw, YawPolicy
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import VehicleId
from gcs.planning.feasibility import check_formation, check_orbit, check_target
from gcs.service.access import AccessSettings, is_loopback
from gcs.service.map_settings import MapSettings

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
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]
    altitude_amsl_m: float
    heading_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0


class VehicleSettings(Settings):
    """One vehicle of a link."""

    id: Annotated[str, AfterValidator(_vehicle_id)]
    system_id: SystemId
    charge: Positive = 1.0
    speed_max_m_s: Positive | None = None  # in any direction; None: the limits of `control.safety`


class RangeSettings(Settings):
    """Consecutive system ids, named by a pattern."""

    first_system_id: SystemId = 1
    count: Annotated[int, Field(ge=1, le=SYSTEM_ID_MAX)]
    id_pattern: str = "d{system_id}"  # may also use {link}, because links may share system ids

    @model_validator(mode="after")
    def _check(self) -> "RangeSettings":
        last = self.first_system_id + self.count - 1
        if last > SYSTEM_ID_MAX:
            text = f"the last would have the system_id {last}: at most {SYSTEM_ID_MAX}"
            raise located(text, "count")
        return self

    def expanded(self, link: str) -> tuple[VehicleSettings, ...]:
        """Return one entry per vehicle."""
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
    transport: Literal["mavsdk", "native"] = "mavsdk"
    listen: Urls
    ports: Annotated[int, Field(ge=1, le=1000)] = 1
    vehicles: Fleet
    streams: StreamSettings = StreamSettings()
    forward: Forwards = ()
    signing: SigningSettings | None = None
    heartbeat_hold_s: Positive = 3.0  # heartbeats stop after control has stopped for this long

    @cached_property
    def fleet(self) -> tuple[VehicleSettings, ...]:
        """Every vehicle of the link."""
        vehicles = self.vehicles
        return vehicles.expanded(self.name) if isinstance(vehicles, RangeSettings) else vehicles

    @property
    def places(self) -> tuple[Place, ...]:
        """Endpoints of `listen`. Raises: ConfigError."""
        return tuple(place_at(url, self.ports) for url in self.listen)

    @property
    def udp_ports(self) -> Listen:
        """UDP ports of `listen`, for the native transport. Raises: ConfigError for any other endpoint."""
        places = self.places
        if len(places) != 1 or not isinstance(places[0], Listen):
            raise ConfigError("transport native needs one udpin://HOST:PORT")
        return places[0]

    @model_validator(mode="after")
    def _check(self) -> "LinkSettings":
        try:
            taken = [each for place in self.places for each in occupied(place)]
        except ConfigError as error:
            raise ValueError(f"listen: {error}") from None
        if len(set(taken)) < len(taken):
            raise ValueError("listen: the same place is there twice")
        if self.transport == "native":
            self._check_native()
        seen: set[int] = set()
        for vehicle in self.fleet:
            if vehicle.system_id in seen:
                raise ValueError(f"vehicles: system id {vehicle.system_id} is there twice")
            seen.add(vehicle.system_id)
        return self

    def _check_native(self) -> None:
        try:
            _ = self.udp_ports
        except ConfigError as error:
            raise ValueError(f"listen: {error}") from None
        for key, value in (("signing", self.signing), ("forward", self.forward)):
            if value:
                raise ValueError(f"{key}: transport native has none; transport: mavsdk has")


class ApiSettings(Settings):
    """Address and ports of the REST API."""

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8000
    emergency_port: Annotated[int, Field(ge=0, le=65535)] | None = None  # None: the next after `port`

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
    takeoff_stagger_s: NotNegative = 1.0
    takeoff_timeout_s: Positive = 30.0
    handover_height_m: Positive = 1.5  # below this height over the landing site PX4's LAND touches down
    landing_site_spacing_m: Positive = 4.0  # between the landing sites of a filtered descent
    silence_s: Positive = 2.0  # without a heartbeat and a position: offline, or lost if airborne
    setpoint_loss_action: Literal["descend", "hold", "land", "return"] = "hold"  # COM_OBL_RC_ACT
    setpoint_loss_s: Annotated[float, Field(ge=0.5, le=10)] = 1.0  # COM_OF_LOSS_T
    return_height_m: Positive = 30.0  # RTL_RETURN_ALT, for vehicles that return when lost
    pads_within_m: Positive = 50.0  # of the show's origin: the autopilots' fences are around their own pads
    pilot_takes_over: bool = True  # moving a stick gives the pilot control: COM_RC_OVERRIDE, COM_RC_IN_MODE
    require_parameters: bool = True  # refuse vehicles whose parameters make the loss of this station unsafe
    require_safe_setpoint_loss: bool = True  # refuse a setpoint-loss action that brings vehicles together


class FormationSettings(Settings):
    """Initial sphere of the show."""

    radius_m: Positive
    height_m: Positive


class OrbitSettings(Settings):
    """Initial orbit of the show."""

    radius_m: NotNegative = 0.0
    speed_m_s: Positive = 2.0
    direction: Direction = Direction.COUNTERCLOCKWISE


class TargetSettings(Settings):
    """Initial target of the show, at rest."""

    x_m: float = 0.0
    y_m: float = 0.0


class YawSettings(Settings):
    """Initial yaw policy; `heading_deg`, clockwise from north, applies to the policy "fixed"."""

    policy: YawPolicy = YawPolicy.HELD
    heading_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0


class ShowsSettings(Settings):
    """Folder of uploaded shows."""

    folder: Path


class Config(Settings):
    """A whole configuration file."""

    show_frame: ShowFrameSettings
    links: tuple[LinkSettings, ...]
    formation: FormationSettings
    orbit: OrbitSettings = OrbitSettings()
    target: TargetSettings = TargetSettings()
    yaw: YawSettings = YawSettings()
    api: ApiSettings = ApiSettings()
    access: AccessSettings = AccessSettings()
    record: RecordSettings | None = None
    shows: ShowsSettings | None = None  # None: no shows can be uploaded
    map: MapSettings | None = None  # None: only a grid, and no requests to a tile server
    operation: OperationSettings = OperationSettings()
    control: ControlSettings = ControlSettings()
    positioning: Positioning = Positioning()
    failsafes: FailsafePolicy = FailsafePolicy()
    preflight: PreflightSettings = PreflightSettings()
    tick_rate_hz: Annotated[float, Field(ge=5, le=100)] = 20.0
    setpoint_timeout_s: Annotated[float, Field(gt=0, le=0.2)] = 0.2

    @property
    def frame(self) -> ShowFrame:
        return ShowFrame(**self.show_frame.model_dump())

    @property
    def plan(self) -> Plan:
        """The initial plan."""
        return Plan(
            Formation(**self.formation.model_dump()),
            Orbit(**self.orbit.model_dump()),
            Target(**self.target.model_dump()),
            yaw=Yaw(self.yaw.policy, radians(self.yaw.heading_deg - self.show_frame.heading_deg)),
        )

    @cached_property
    def fleet(self) -> tuple[VehicleSettings, ...]:
        return tuple(vehicle for link in self.links for vehicle in link.fleet)

    @cached_property
    def ids(self) -> tuple[VehicleId, ...]:
        """Ids of all vehicles, in order."""
        return tuple(vehicle.id for vehicle in self.fleet)

    @model_validator(mode="after")
    def _check(self) -> "Config":
        if not self.fleet:
            raise ValueError("links: at least one link with at least one vehicle is needed")
        for what, names in (("link", [link.name for link in self.links]), ("vehicle", list(self.ids))):
            twice = {name for name, count in Counter(names).items() if count > 1}
            if twice:
                raise ValueError(f"links: {what} {', '.join(sorted(twice))} is there twice")
        self._check_links()
        self._check_access()
        strangers = sorted(set(self.preflight.start_places) - set(self.ids))
        if strangers:
            raise ValueError(f"preflight.start_places: there is no vehicle {', '.join(strangers)}")
        self._check_limits()
        self._check_plan()
        return self

    def _check_limits(self) -> None:
        fence, law = self.control.safety.fence, self.control.law
        if not fence.height_min_m < fence.height_max_m:
            text = f"above height_min_m = {fence.height_min_m}"
            raise located(text, "control", "safety", "fence", "height_max_m")
        if self.operation.takeoff_height_m < fence.height_min_m:
            raise located(f"at least the fence's {fence.height_min_m} m", "operation", "takeoff_height_m")
        fastest_m_s = self.control.safety.limits.horizontal_m_s
        for key in ("speed_m_s", "center_speed_max_m_s"):
            if getattr(law, key) > fastest_m_s:
                text = f"at most control.safety.limits.horizontal_m_s = {fastest_m_s}"
                raise located(text, "control", "law", key)

    def _check_plan(self) -> None:
        """Check that at least one vehicle can fly the initial plan."""
        plan, control = self.plan, self.control
        fence = control.safety.fence
        too_small = fence_too_small(self.formation.radius_m, self.orbit.radius_m, fence)
        if too_small is not None:
            loc, text = too_small
            raise located(text, *loc)
        checks: tuple[tuple[str, Callable[[], None]], ...] = (
            ("formation", lambda: check_formation(plan.formation, 1, control.safety)),
            ("orbit", lambda: check_orbit(plan.orbit, control.law)),
            ("target", lambda: check_target(plan.target, plan.orbit, plan.formation, control)),
        )
        for section, check in checks:
            try:
                check()
            except InvalidError as error:
                if error.field in type(getattr(self, section)).model_fields:
                    raise located(error.allowed, section, error.field) from None
                raise located(str(error), section) from None

    def _check_access(self) -> None:
        """Check that the API is reachable from other machines only with tokens."""
        if self.access.tokens_file is None and not is_loopback(self.api.host):
            raise ValueError(
                f"api.host = {self.api.host}: beyond 127.0.0.1 tokens are needed: gcs token create NAME"
                " --role operate --file tokens.json, then access.tokens_file: tokens.json"
            )

    def _check_links(self) -> None:
        """Check that no two links use the same resource, and the number of MAVSDK instances."""
        owner: dict[str, str] = {}
        for link in self.links:
            used = [f"listen on {port}" for place in link.places for port in occupied(place)]
            if link.signing is not None:
                used.append(f"sign as link_id {link.signing.link_id} with {link.signing.key_file}")
            for each in used:
                other = owner.setdefault(each, link.name)
                if other != link.name:
                    raise ValueError(f"links: {link.name} and {other} both {each}")
        for link in self.links:
            for to in link.forward:
                if f"listen on {to.url.removeprefix('udp://')}" in owner:
                    raise ValueError(f"links: {link.name}: forward {to.url}: we listen there ourselves")
        count = sum(instances(len(link.fleet)) for link in self.links if link.transport == "mavsdk")
        if count > INSTANCES_MAX:
            raise ValueError(f"links: {count} MAVSDK instances; one process bears {INSTANCES_MAX}")


def find(name: str) -> Path:
    """Find a configuration by path or shipped name. Raises: ConfigError that names the shipped ones."""
    return documents.CONFIGURATIONS.find(name)


def load(path: Path) -> Config:
    """Read and check a configuration.

    Raises: ConfigError that names the file, the line, the key, its value and what is allowed.
    """
    return parse(documents.read(path), str(path))


def parse(text: str, source: str) -> Config:
    """Parse the configuration in `text`; `source` names it in errors. Raises: ConfigError."""
    written = Source(text, source)
    raw = written.mapping("show_frame, links and formation at least")
    try:
        config = Config.model_validate(raw)
    except ValidationError as error:
        raise explained(error, source, Config, written) from None
    ports, counts = [link.ports for link in config.links], [len(link.fleet) for link in config.links]
    found = [*misfits_of_fleet(ports, counts, config.formation.radius_m, config.control.safety)]
    if found:
        raise FileError(source, [Problem(written.line(*one.loc), None, str(one)) for one in found])
    return config
