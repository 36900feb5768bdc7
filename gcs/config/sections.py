"""The sections of a configuration, as frozen settings; keys of quantities end in their unit."""

import re
from functools import cached_property
from ipaddress import AddressValueError, IPv4Address
from itertools import combinations
from math import hypot
from pathlib import Path
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from gcs.config.setting_errors import located
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
from gcs.model.plan import Direction, LawName, YawPolicy
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import VehicleId

APART_MIN_M = 0.5
"""Least distance of two start places; nearer ones are the same place, written twice."""

LENGTH_MAX_M = 10_000.0
_PORT_MAX: Final = 65535


class StartPlace(Settings):
    """Place of a vehicle before the start, in the show frame: x along the show's heading, y to its right."""

    x_m: Annotated[float, Field(strict=True, ge=-LENGTH_MAX_M, le=LENGTH_MAX_M)]
    y_m: Annotated[float, Field(strict=True, ge=-LENGTH_MAX_M, le=LENGTH_MAX_M)]


class PreflightSettings(Settings):
    """Limits of the checks. The report names every check that a limit switches off."""

    battery_min: Annotated[float, Field(ge=0.1, le=1)] = 0.25  # a show's own need counts if it is higher
    require_fix: bool = True  # False: for vehicles with a position source other than GNSS
    rotation_max_deg: Annotated[float, Field(gt=0, le=45)] = 2.0  # of the start pattern
    shift_max_m: Positive = 2.0  # of the pattern's centre
    place_max_m: Positive = 1.5  # of one vehicle from its own place in the pattern
    height_spread_max_m: Positive = 2.0  # of a pad above or below the median height
    # Recorded: two vehicles on pads 4 m apart came to 2.3 m while their autopilots climbed and held position.
    wander_m: NotNegative = 0.85  # error of position in PX4's own TAKEOFF and HOLD; 0: not checked
    clock_max_s: Positive | None = 2.0  # between the clocks of vehicle and station; None: not checked
    start_places: dict[VehicleId, StartPlace] = Field(default_factory=dict)  # a written show has its own

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
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]
    altitude_amsl_m: float
    heading_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0

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
    system_id: SystemId
    autopilot: AutopilotName | None = None  # None: the link's
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
    autopilot: AutopilotName = DEFAULT.name  # of its vehicles, but those with an autopilot of their own
    listen: Urls
    ports: Annotated[int, Field(ge=1, le=1000)] = 1
    vehicles: Fleet
    streams: StreamSettings = StreamSettings()
    forward: Forwards = ()
    signing: SigningSettings | None = None
    extra_bytes_per_s: Positive | None = None  # for lights and corrections; None: `extra_bytes_per_s()`
    heartbeat_hold_s: Positive = 3.0  # heartbeats stop after control has stopped for this long

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
        """What lights and corrections may use together. Raises: ConfigError."""
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
    return_height_m: Positive = 30.0  # lowest RTL_RETURN_ALT, for vehicles that return when lost
    return_layer_m: NotNegative = 4.0  # by so much higher the next in the list returns, up to the fence
    pads_within_m: Positive = 50.0  # of the show's origin: the autopilots' fences are around their own pads
    pilot_takes_over: bool = True  # moving a stick gives the pilot control: COM_RC_OVERRIDE, COM_RC_IN_MODE
    require_parameters: bool = True  # refuse vehicles whose parameters make the loss of this station unsafe
    require_safe_setpoint_loss: bool = True  # refuse a setpoint-loss action that brings vehicles together


class FormationSettings(Settings):
    """Initial sphere of the show, and the law that spreads the vehicles over it (docs/decisions/law.md)."""

    radius_m: Annotated[float, Field(gt=0, le=LENGTH_MAX_M)]
    height_m: Annotated[float, Field(gt=0, le=LENGTH_MAX_M)]
    law: LawName = LawName.SLOTS


class OrbitSettings(Settings):
    """Initial orbit of the show."""

    radius_m: Annotated[float, Field(ge=0, le=LENGTH_MAX_M)] = 0.0
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


_MIDI_AT: Final = re.compile(
    r"^(?P<scheme>rtp-midi|udp-midi)://(?P<host>\d{1,3}(?:\.\d{1,3}){3}):(?P<port>\d{1,5})$"
)
_MIDI_PORT: Final = re.compile(r"^(?P<scheme>midi)://(?P<path>/[^:]+)$")
_SOUND: Final = re.compile(r"^(?P<scheme>ltc)://(?P<path>/[^:]+):(?P<rate>\d{1,6})$")
_TIMECODE_FORMS: Final = "rtp-midi://IP:PORT, udp-midi://IP:PORT, midi:///DEVICE or ltc:///PIPE:SAMPLES_PER_S"
_LABEL: Final = r"^([01]\d|2[0-3]):[0-5]\d:[0-5]\d(:[0-2]\d)?$"
_SAMPLES_MIN, _SAMPLES_MAX = 8_000, 192_000


class TimecodeSettings(Settings):
    """Timecode that written shows follow (docs/how-to/timecode.md)."""

    source: str
    starts_at: Annotated[str, Field(pattern=_LABEL)] = "00:00:00:00"  # the timecode of a show's beginning
    delay_s: Annotated[float, Field(ge=-10, le=10)] = 0.0  # the show runs so much later than the timecode
    freewheel_s: Annotated[float, Field(ge=0.1, le=10)] = 1.0  # drop-outs up to so long are flown through
    jump_max_s: Annotated[float, Field(ge=0.2, le=60)] = 5.0
    catch_up: Annotated[float, Field(ge=0.02, le=0.25)] = 0.1  # share by which a show may run faster

    @property
    def scheme(self) -> str:
        return self.source.partition(":")[0]

    @property
    def path(self) -> str:
        """Path of a device or a pipe; empty for an address."""
        found = _MIDI_PORT.match(self.source) or _SOUND.match(self.source)
        return "" if found is None else found["path"]

    @property
    def address(self) -> tuple[str, int]:
        """IP address and port to receive at. Raises: ConfigError for a device or a pipe."""
        found = _MIDI_AT.match(self.source)
        if found is None:
            raise ConfigError(f"{self.source} is no address")
        return found["host"], int(found["port"])

    @property
    def sample_rate_hz(self) -> float:
        """Of sound. Raises: ConfigError for another source."""
        found = _SOUND.match(self.source)
        if found is None:
            raise ConfigError(f"{self.source} is no sound")
        return float(found["rate"])

    @model_validator(mode="after")
    def _check(self) -> "TimecodeSettings":
        at, sound = _MIDI_AT.match(self.source), _SOUND.match(self.source)
        if at is not None:
            try:
                IPv4Address(at["host"])
            except AddressValueError:
                raise ValueError(f"source: {self.source}: {at['host']} is no IP address") from None
            last = int(at["port"]) + (at["scheme"] == "rtp-midi")  # sessions use two ports
            if not 1 < last <= _PORT_MAX:
                raise ValueError(f"source: {self.source}: a port up to {_PORT_MAX} is needed")
        elif sound is not None:
            if not _SAMPLES_MIN <= int(sound["rate"]) <= _SAMPLES_MAX:
                raise ValueError(
                    f"source: {self.source}: {_SAMPLES_MIN} to {_SAMPLES_MAX} samples a second are needed"
                )
        elif not _MIDI_PORT.match(self.source):
            raise ValueError(f"source: {self.source}: {_TIMECODE_FORMS} is needed")
        return self
