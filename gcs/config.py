"""YAML to frozen settings. Read once; an unknown or repeated key is an error; every key ends in its unit."""

import re
from collections import Counter
from collections.abc import Hashable
from functools import cached_property
from importlib import resources
from math import radians
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import yaml
from pydantic import Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from gcs.control import ControlSettings
from gcs.errors import ConfigError, GcsError
from gcs.feasibility import check_formation, check_orbit, check_target
from gcs.frames import ShowFrame
from gcs.plan import Direction, Formation, Orbit, Plan, Target, Yaw, YawPolicy
from gcs.settings import NotNegative, Positive, Settings
from gcs.state import VehicleId

LISTEN = re.compile(r"^udpin://(?P<host>[^:/]+):(?P<port>\d{1,5})$")

MAVSDK_VEHICLES_MAX = 64
"""What one MAVSDK instance carries well."""

SystemId: TypeAlias = Annotated[int, Field(ge=1, le=250)]


class ShowFrameSettings(Settings):
    """Origin of the show frame, and where its x axis points."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]
    altitude_amsl_m: float
    heading_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0


class VehicleSettings(Settings):
    """One vehicle of a link."""

    id: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,32}$")]
    system_id: SystemId
    charge: Positive = 1.0
    speed_max_m_s: Positive | None = None  # in any direction; None: the limits of `control.safety`


class RangeSettings(Settings):
    """Consecutive system ids, named by a pattern."""

    first_system_id: SystemId = 1
    count: Annotated[int, Field(ge=1, le=250)]
    id_pattern: str = "d{system_id}"  # may use {link} too, for several links carry the same system ids

    def expanded(self, link: str) -> tuple[VehicleSettings, ...]:
        """One entry for each."""
        pattern = self.id_pattern.replace("{link}", link)
        ids = range(self.first_system_id, self.first_system_id + self.count)
        return tuple(VehicleSettings(id=pattern.replace("{system_id}", str(i)), system_id=i) for i in ids)


class LinkSettings(Settings):
    """Where vehicles are heard. `ports` consecutive UDP ports, beginning with the one in `listen`.

    The settings below `vehicles` are the direct transport's only.
    """

    name: Annotated[str, Field(min_length=1)]
    transport: Literal["mavsdk", "direct"] = "mavsdk"
    listen: Annotated[str, Field(pattern=LISTEN.pattern)]
    ports: Annotated[int, Field(ge=1, le=1000)] = 1
    vehicles: tuple[VehicleSettings, ...] | RangeSettings
    position_hz: Annotated[float, Field(ge=1, le=50)] = 10.0  # asked of every vehicle
    heartbeat_hold_s: Positive = 3.0  # our heartbeats end when control has been dead for this long

    @cached_property
    def fleet(self) -> tuple[VehicleSettings, ...]:
        """Every vehicle, written out."""
        vehicles = self.vehicles
        return vehicles.expanded(self.name) if isinstance(vehicles, RangeSettings) else vehicles

    @property
    def address(self) -> tuple[str, int]:
        """Host and first port."""
        found = LISTEN.match(self.listen)
        if found is None:
            raise ConfigError(f"listen: {self.listen}: udpin://HOST:PORT is needed")
        return found["host"], int(found["port"])

    @model_validator(mode="after")
    def _check(self) -> "LinkSettings":
        port = self.address[1]
        if not 1 <= port <= 65536 - self.ports:
            raise ValueError(f"listen: ports {port} to {port + self.ports - 1}: at most 65535 is possible")
        if self.transport == "mavsdk" and len(self.fleet) > MAVSDK_VEHICLES_MAX:
            raise ValueError(
                f"vehicles: {len(self.fleet)}; MAVSDK carries {MAVSDK_VEHICLES_MAX}, transport: direct more"
            )
        seen: set[int] = set()
        for vehicle in self.fleet:
            if vehicle.system_id in seen:
                raise ValueError(f"vehicles: system id {vehicle.system_id} is there twice")
            seen.add(vehicle.system_id)
        return self


class ApiSettings(Settings):
    """Where the REST API listens."""

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8000


class OperationSettings(Settings):
    """Take-off, assembly and landing."""

    takeoff_height_m: Positive = 5.0
    takeoff_stagger_s: NotNegative = 1.0
    takeoff_timeout_s: Positive = 30.0
    handover_height_m: Positive = 1.5  # below this over its place the autopilot's own LAND touches down
    place_spacing_m: Positive = 4.0  # between the places of a filtered descent
    silence_s: Positive = 2.0  # without a heartbeat and a position: offline, or lost when in the air
    setpoint_loss_action: Literal["descend", "hold", "land", "return"] = "descend"  # as COM_OBL_RC_ACT
    return_height_m: Positive = 30.0  # RTL_RETURN_ALT, for vehicles that return when lost


class FormationSettings(Settings):
    """The sphere the show begins with."""

    radius_m: Positive
    height_m: Positive


class OrbitSettings(Settings):
    """The orbit the show begins with."""

    radius_m: NotNegative = 0.0
    speed_m_s: Positive = 2.0
    direction: Direction = Direction.COUNTERCLOCKWISE


class TargetSettings(Settings):
    """The target the show begins with, standing."""

    x_m: float = 0.0
    y_m: float = 0.0


class YawSettings(Settings):
    """Where the vehicles look; `heading_deg`, clockwise from north, counts for the policy "fixed"."""

    policy: YawPolicy = YawPolicy.HELD
    heading_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0


class Config(Settings):
    """A whole configuration file."""

    show_frame: ShowFrameSettings
    links: tuple[LinkSettings, ...]
    formation: FormationSettings
    orbit: OrbitSettings = OrbitSettings()
    target: TargetSettings = TargetSettings()
    yaw: YawSettings = YawSettings()
    api: ApiSettings = ApiSettings()
    operation: OperationSettings = OperationSettings()
    control: ControlSettings = ControlSettings()
    tick_rate_hz: Annotated[float, Field(ge=5, le=100)] = 20.0
    deadman_s: Annotated[float, Field(gt=0, le=0.2)] = 0.2

    @property
    def frame(self) -> ShowFrame:
        """The show frame."""
        return ShowFrame(**self.show_frame.model_dump())

    @property
    def plan(self) -> Plan:
        """What the show begins with."""
        return Plan(
            Formation(**self.formation.model_dump()),
            Orbit(**self.orbit.model_dump()),
            Target(**self.target.model_dump()),
            yaw=Yaw(self.yaw.policy, radians(self.yaw.heading_deg - self.show_frame.heading_deg)),
        )

    @cached_property
    def fleet(self) -> tuple[VehicleSettings, ...]:
        """Every vehicle of every link."""
        return tuple(vehicle for link in self.links for vehicle in link.fleet)

    @cached_property
    def ids(self) -> tuple[VehicleId, ...]:
        """Of every vehicle, in order."""
        return tuple(vehicle.id for vehicle in self.fleet)

    @model_validator(mode="after")
    def _check(self) -> "Config":
        if not self.fleet:
            raise ValueError("links: at least one link with at least one vehicle is needed")
        for what, names in (("link", [link.name for link in self.links]), ("vehicle", list(self.ids))):
            twice = {name for name, count in Counter(names).items() if count > 1}
            if twice:
                raise ValueError(f"links: {what} {', '.join(sorted(twice))} is there twice")
        self._check_ports()
        fence, law = self.control.safety.fence, self.control.law
        if not fence.height_min_m < fence.height_max_m:
            raise ValueError(f"control.safety.fence.height_max_m = {fence.height_max_m}: above height_min_m")
        if self.operation.takeoff_height_m < fence.height_min_m:
            raise ValueError(f"operation.takeoff_height_m: at least the fence's {fence.height_min_m} m")
        fastest_m_s = self.control.safety.limits.horizontal_m_s
        if max(law.speed_m_s, law.center_speed_max_m_s) > fastest_m_s:
            raise ValueError(
                f"control.law: speeds beyond control.safety.limits.horizontal_m_s = {fastest_m_s}"
            )
        try:
            check_formation(self.plan.formation, 1, self.control.safety)
            check_orbit(self.plan.orbit, law)
            check_target(self.plan.target, self.plan.orbit, self.plan.formation, self.control)
        except GcsError as error:
            raise ValueError(str(error)) from None
        return self

    def _check_ports(self) -> None:
        owner: dict[tuple[str, int], str] = {}
        for link in self.links:
            host, first = link.address
            for port in range(first, first + link.ports):
                other = owner.setdefault((host, port), link.name)
                if other != link.name:
                    raise ValueError(f"links: {link.name} and {other} both listen on {host}:{port}")


class _StrictLoader(yaml.SafeLoader):
    """YAML in which a repeated key is an error."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, object]:
        """As SafeLoader, after looking for repetitions."""
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue  # refused below
            if key.value in seen:
                raise ConfigError(f"line {key.start_mark.line + 1}: key '{key.value}' is there twice")
            seen.add(key.value)
        return super().construct_mapping(node, deep=deep)


def find(name: str) -> Path:
    """A configuration file: a path as it is, else one of those that come with the package.

    Works from a checkout and from an installed wheel. Raises: ConfigError naming what there is.
    """
    path = Path(name)
    if path.is_file():
        return path
    shipped = shipped_folder()
    stem = path.name.removesuffix(".yaml")
    if path.parent in {Path(), Path("configs")} and (shipped / f"{stem}.yaml").is_file():
        return shipped / f"{stem}.yaml"
    known = ", ".join(sorted(found.stem for found in shipped.glob("*.yaml")))
    raise ConfigError(f"{name}: there is no such file; configurations that come with the package: {known}")


def shipped_folder() -> Path:
    """Where the configurations lie: inside an installed wheel, or beside `gcs` in a checkout."""
    package = Path(str(resources.files("gcs")))
    packed = package / "_configs"
    return packed if packed.is_dir() else package.parent / "configs"


def load(path: Path) -> Config:
    """Read and check a configuration.

    Raises: ConfigError that names the file, the key, its value and what would be right.
    """
    return parse(read(path), str(path))


def read(path: Path) -> str:
    """The text of a file. Raises: ConfigError when it cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None


def parse(text: str, source: str) -> Config:
    """The configuration in `text`; `source` names it in errors. Raises: ConfigError."""
    raw = parse_mapping(text, source, "show_frame, links and formation at least")
    try:
        return Config.model_validate(raw)
    except ValidationError as error:
        raise explained(error, source) from None


def parse_mapping(text: str, source: str, needed: str) -> dict[str, object]:
    """The YAML mapping in `text`, no key twice; `needed` says what it should hold. Raises: ConfigError."""
    try:
        raw = yaml.load(text, Loader=_StrictLoader)  # noqa: S506  (a SafeLoader, stricter)
    except yaml.YAMLError as error:
        raise ConfigError(f"{source}: not YAML: {error}") from None
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from None
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        # PyYAML's own constructors, of a month 13 or a tag that does not fit its value
        raise ConfigError(f"{source}: not YAML: {error}") from None
    if not isinstance(raw, dict):
        raise ConfigError(f"{source}: a mapping is needed, with {needed}")
    return {str(key): value for key, value in raw.items()}


def explained(error: ValidationError, source: str) -> ConfigError:
    """What a reader of `source` can mend: every key, its value and what would be right."""
    return ConfigError(f"{source}: " + "; ".join(_plain(problem) for problem in error.errors()))


def _plain(problem: ErrorDetails) -> str:
    """Key, value and what would be right; without the value where it is a whole section."""
    key = ".".join(str(part) for part in problem["loc"])
    value = "" if isinstance(problem["input"], dict) else f" = {problem['input']!r}"
    return f"{key}{value}: {problem['msg'].removeprefix('Value error, ')}".removeprefix(": ")
