"""YAML to frozen settings. An unknown or repeated key is an error; keys of quantities end in their unit."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from math import isfinite, radians
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import Field, PrivateAttr, ValidationError, model_validator

from gcs.areas.files.site_files import read_site
from gcs.areas.site import FlightSite
from gcs.areas.site_fence import fence_within, uploaded_fence
from gcs.bus.settings import BusSettings
from gcs.config import sections, yaml_files
from gcs.config.setting_errors import Misfit, explained, located
from gcs.config.stations import SiteRows, StationSettings, check_inputs, check_stations
from gcs.config.yaml_files import Loc, Source
from gcs.control import ControlSettings
from gcs.estimation.height_bias import HeightSettings
from gcs.estimation.positioning import Positioning
from gcs.failsafe.policy import FailsafePolicy
from gcs.formation.orbit import CLEAR_OF_FENCE_M
from gcs.links.features import FeatureSettings
from gcs.links.settings import INSTANCES_MAX, RecordSettings, instances, occupied
from gcs.links.tak.settings import OwnTracks
from gcs.model.errors import FileError, InvalidError, Problem, SiteError
from gcs.model.frames import ShowFrame
from gcs.model.plan import Formation, Orbit, Plan, Target, Yaw
from gcs.model.polygon_fence import PolygonFence
from gcs.model.settings import Settings
from gcs.model.state import Array, VehicleId
from gcs.planning.feasibility import (
    check_formation,
    check_orbit,
    check_target,
    radius_allowed,
    smallest_formation_radius_m,
)
from gcs.planning.lost_space import return_heights_m
from gcs.safety.surroundings import SafetySettings
from gcs.safety.walls import Fence
from gcs.service.access import AccessSettings, is_loopback
from gcs.service.map_settings import MapSettings

NOT_FOR_FILES: Final = ("flight_site", "fence_without_site")


class FlightSettings(Settings):
    """All sections of a configuration but those of features."""

    show_frame: sections.ShowFrameSettings
    """Where the show's origin lies on the earth, and where its x axis points."""
    links: tuple[sections.LinkSettings, ...]
    """The links to the vehicles; their order, and that in each list, is the order of the fleet."""
    formation: sections.FormationSettings
    """The sphere at the start, and the law that spreads the vehicles over it."""
    orbit: sections.OrbitSettings = sections.OrbitSettings()
    """The circle of the formation's centre around the target at the start."""
    target: sections.InitialTarget = sections.InitialTarget()
    """The target at the start, at rest."""
    yaw: sections.YawSettings = sections.YawSettings()
    """Heading of the vehicles at the start."""
    api: sections.ApiSettings = sections.ApiSettings()
    """Address and ports of the REST API and the console."""
    access: AccessSettings = AccessSettings()
    """Tokens, TLS and rates of calls."""
    record: RecordSettings | None = None
    """What is recorded; without it nothing is, and a restart knows nothing of the flight."""
    shows: sections.ShowsSettings | None = None
    """Where uploaded shows are kept; without it none can be uploaded."""
    map: MapSettings | None = None
    """The map under the console's grid; without it no request goes to a tile server."""
    operation: sections.OperationSettings = sections.OperationSettings()
    """Take-off, landing, loss of setpoints, and what the autopilots' parameters must be."""
    control: ControlSettings = ControlSettings()
    """The law, the safety filter and the inner loop."""
    positioning: Positioning = Positioning()
    """How uncertain the positions of neighbours are towards each other."""
    heights: HeightSettings = HeightSettings()
    """The difference between heights from which a vehicle is named and kept farther from others."""
    failsafes: FailsafePolicy = FailsafePolicy()
    """What the service does by itself when something goes wrong in the air."""
    preflight: sections.PreflightSettings = sections.PreflightSettings()
    """Limits of the checks before a start."""
    tick_rate_hz: Annotated[float, Field(ge=5, le=100)] = 20.0
    """Turns of control a second."""
    setpoint_timeout_s: Annotated[float, Field(gt=0, le=0.2)] = 0.2
    """No setpoint leaves later than this after its tick, in s."""
    scheduling: Literal["real-time", "usual"] = "real-time"
    """`real-time` asks the machine for priority and locked memory, and may get less; `usual` for nothing."""
    stations: tuple[StationSettings, ...] = ()
    """The stations of the whole site; without any, one station has all links."""
    bus: BusSettings = BusSettings()
    """How the stations of a site exchange messages."""
    site_rows: SiteRows | None = None
    """Set by `gcs serve --station` in that station's own configuration; not for files."""
    site: Path | None = None
    """File of the site, beside the configuration: a .geojson, a .kml or a QGroundControl .plan. Its areas and
    heights narrow `control.safety.fence`."""
    flight_site: FlightSite | None = None
    """The site as it was read; not for files."""
    fence_without_site: Fence | None = None
    """The fence before the site narrowed it; not for files."""


class Config(FeatureSettings, FlightSettings):
    """A whole configuration file."""

    _polygon_fence: PolygonFence | None = PrivateAttr(default=None)

    @property
    def polygon_fence(self) -> PolygonFence | None:
        """What the autopilots keep by themselves; None: nothing is uploaded to them."""
        if self._polygon_fence is None and self.flight_site is not None:
            return uploaded_fence(self.flight_site)
        return self._polygon_fence

    def fenced(self, fence: PolygonFence) -> "Config":
        """The same with a fence for the autopilots."""
        config = self.model_copy()
        config._polygon_fence = fence  # noqa: SLF001 (its own copy)
        return config

    @property
    def frame(self) -> ShowFrame:
        return self.show_frame.frame

    @property
    def plan(self) -> Plan:
        return Plan(
            Formation(**self.formation.model_dump()),
            Orbit(**self.orbit.model_dump()),
            Target(**self.target.model_dump()),
            yaw=Yaw(self.yaw.policy, radians(self.yaw.heading_deg - self.show_frame.heading_deg)),
        )

    @cached_property
    def fleet(self) -> tuple[sections.VehicleSettings, ...]:
        return tuple(vehicle for link in self.links for vehicle in link.fleet)

    @cached_property
    def ids(self) -> tuple[VehicleId, ...]:
        return tuple(vehicle.id for vehicle in self.fleet)

    @cached_property
    def autopilots(self) -> dict[VehicleId, str]:
        """Name of each vehicle's autopilot."""
        return {
            each.id: profile.name
            for link in self.links
            for each, profile in zip(link.fleet, link.autopilots, strict=True)
        }

    @property
    def own_tracks(self) -> OwnTracks:
        """What all stations of this show send to TAK: the vehicles and the centre."""
        if self.tak is None:
            return OwnTracks()
        vehicles = len(self.fleet) if self.site_rows is None else self.site_rows.count
        return OwnTracks(self.tak.uid(self.frame), vehicles + 1)

    @cached_property
    def return_heights_m(self) -> Array:
        """(n,) RTL_RETURN_ALT of each vehicle, above its home; layered over all vehicles of the site."""
        operation, highest_m = self.operation, self.control.safety.fence.height_max_m
        count = len(self.fleet) if self.site_rows is None else self.site_rows.count
        heights_m = return_heights_m(count, operation.return_height_m, operation.return_layer_m, highest_m)
        return heights_m if self.site_rows is None else heights_m[list(self.site_rows.rows)]

    @model_validator(mode="after")
    def _check(self) -> "Config":
        if not self.fleet:
            raise ValueError("links: at least one link with at least one vehicle is needed")
        for what, names in (("link", [link.name for link in self.links]), ("vehicle", list(self.ids))):
            twice = {name for name, count in Counter(names).items() if count > 1}
            if twice:
                raise ValueError(f"links: {what} {', '.join(sorted(twice))} is there twice")
        self._check_stations()
        self._check_links()
        self._check_access()
        if (self.site is None) != (self.flight_site is None):
            raise located("it is read with its file: gcs.config.schema.load", "site")
        strangers = sorted(set(self.preflight.start_places) - set(self.ids))
        if strangers:
            raise ValueError(f"preflight.start_places: there is no vehicle {', '.join(strangers)}")
        given = set() if self.remote_id is None else set(self.remote_id.basic_ids)
        if strangers := sorted(given - set(self.ids)):
            raise ValueError(f"remote_id.basic_ids: there is no vehicle {', '.join(strangers)}")
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

    def _check_stations(self) -> None:
        if self.stations:
            counts = {link.name: len(link.fleet) for link in self.links}
            check_stations(self.stations, counts, self.api, self.bus.keys)
            check_inputs(self.stations, self)
        own = self.site_rows
        if own is not None and (len(own.rows) != len(self.ids) or max(own.rows) >= own.count):
            text = f"one row below count for each of the {len(self.ids)} vehicles; only gcs serve sets them"
            raise located(text, "site_rows", "rows")

    def _check_access(self) -> None:
        """Check that each API is reachable from other machines only with tokens."""
        if self.go is not None and self.go.confirmed_by_another and self.access.tokens_file is None:
            text = "needs access.tokens_file: tokens tell callers apart"
            raise located(text, "go", "confirmed_by_another")
        apis = [("api", self.api)]
        apis += [(f"stations.{at}.api", each.api or self.api) for at, each in enumerate(self.stations)]
        for key, api in apis:
            if self.access.tokens_file is None and not is_loopback(api.host):
                raise ValueError(
                    f"{key}.host = {api.host}: beyond 127.0.0.1 tokens are needed: gcs token create NAME"
                    " --role operate --file tokens.json, then access.tokens_file: tokens.json"
                )

    def _check_links(self) -> None:
        """Check that no two links on one machine use the same resource, and count the MAVSDK instances."""
        machines: dict[str, list[sections.LinkSettings]] = {}
        processes: dict[str, list[sections.LinkSettings]] = {}
        for link in self.links:
            station = next((each for each in self.stations if link.name in each.links), None)
            machines.setdefault("" if station is None else station.machine, []).append(link)
            processes.setdefault("" if station is None else station.name, []).append(link)
        for links in machines.values():
            _check_resources(links)
        for links in processes.values():
            count = sum(instances(len(link.fleet)) for link in links if link.transport == "mavsdk")
            if count > INSTANCES_MAX:
                raise ValueError(f"links: {count} MAVSDK instances; one process bears {INSTANCES_MAX}")


def _check_resources(links: Sequence[sections.LinkSettings]) -> None:
    """Raises: ValueError for what two of these links use."""
    owner: dict[str, str] = {}
    for link in links:
        used = [f"listen on {port}" for place in link.places for port in occupied(place)]
        if link.signing is not None:
            used.append(f"sign as link_id {link.signing.link_id} with {link.signing.key_file}")
        for each in used:
            other = owner.setdefault(each, link.name)
            if other != link.name:
                raise ValueError(f"links: {link.name} and {other} both {each}")
    for link in links:
        for to in link.forward:
            if f"listen on {to.url.removeprefix('udp://')}" in owner:
                raise ValueError(f"links: {link.name}: forward {to.url}: we listen there ourselves")


find = yaml_files.CONFIGURATIONS.find


def load(path: Path) -> Config:
    """Read and check a configuration.

    Raises: ConfigError that names the file, the line, the key, its value and what is allowed.
    """
    return parse(yaml_files.read(path), str(path))


def parse(text: str, source: str) -> Config:
    """Parse the configuration in `text`; `source` names it in errors. Raises: ConfigError."""
    written = Source(text, source)
    raw = written.mapping("show_frame, links and formation at least")
    named = raw.pop("site", None)
    made = next((key for key in NOT_FOR_FILES if raw.pop(key, None) is not None), None)
    if made is not None or not isinstance(named, str | None):
        key = made or "site"
        text = f"{key}: the name of a site's file is needed, as in site: FILE.geojson"
        raise FileError(source, [Problem(written.line(key), None, text)])
    try:
        config = Config.model_validate(raw)
        if named is not None:
            config = on_site(config, Path(source).parent / named)
    except ValidationError as error:
        raise explained(error, source, Config, written) from None
    except SiteError as error:
        problems = [Problem(written.line("site"), None, text) for text in str(error).splitlines()]
        raise FileError(source, problems) from None
    ports, counts = [link.ports for link in config.links], [len(link.fleet) for link in config.links]
    misfits = [*misfits_of_fleet(ports, counts, config.formation.radius_m, config.control.safety)]
    if misfits:
        raise FileError(source, [Problem(written.line(*misfit.loc), None, str(misfit)) for misfit in misfits])
    return config


def on_site(config: Config, path: Path) -> Config:
    """The configuration with the site's areas in its fence. Raises: SiteError, ValidationError."""
    return within_site(config, read_site(path), path)


def within_site(config: Config, site: FlightSite, path: Path) -> Config:
    """As `on_site`, with a site that was read; one that the configuration has is replaced."""
    safety = config.control.safety
    whole = config.fence_without_site or safety.fence
    fence = fence_within(site, config.frame, whole)
    control = config.control.model_copy(update={"safety": safety.model_copy(update={"fence": fence})})
    within = {"site": path, "flight_site": site, "control": control, "fence_without_site": whole}
    return Config.model_validate({key: getattr(config, key) for key in Config.model_fields} | within)


def misfits_of_fleet(
    ports: Sequence[int], counts: Sequence[int], radius_m: float, safety: SafetySettings
) -> Iterator[Misfit]:
    """Yield ports that cannot serve their vehicles, and a formation radius that is too small.

    `ports` and `counts` (of vehicles) are those of each link. Only configuration files are checked: a
    recorded configuration was flown, and is accepted unchanged.
    """
    for at, (given, count) in enumerate(zip(ports, counts, strict=True)):
        if 1 < given < count:
            text = f"1 port for all, or one for each of the {count} vehicles: {count}"
            yield _misfit(("links", at, "ports"), given, text)
    count = sum(counts)
    if radius_m < smallest_formation_radius_m(count, safety):
        yield _misfit(("formation", "radius_m"), radius_m, radius_allowed(count, safety))


def fence_too_small(radius_m: float, orbit_radius_m: float, fence: Fence) -> tuple[Loc, str] | None:
    """Check whether a sphere of that radius fits between the fence's heights and inside its distance.

    Returns: None when it fits; else the key to change and the allowed value. The key is the fence's if the
        default fence would suffice, else the radius.
    """
    room_m = fence.height_max_m - fence.height_min_m
    around_m = orbit_radius_m + CLEAR_OF_FENCE_M
    greatest_m = min(room_m / 2.0, fence.distance_max_m - around_m)
    if radius_m <= greatest_m:
        return None
    usual = Fence()
    usual_m = min((usual.height_max_m - usual.height_min_m) / 2.0, usual.distance_max_m - around_m)
    if isfinite(radius_m) and (greatest_m <= 0.0 or radius_m <= usual_m):
        if 2.0 * radius_m > room_m:
            key, least_m = "height_max_m", fence.height_min_m + 2.0 * radius_m
        else:
            key, least_m = "distance_max_m", radius_m + around_m
        text = f"too small for formation.radius_m = {radius_m:g}: at least {least_m:g} m"
        return ("control", "safety", "fence", key), text
    text = (
        f"at most {greatest_m:g} m, so that it fits inside the fence ({fence.height_min_m:g} to"
        f" {fence.height_max_m:g} m high, {fence.distance_max_m:g} m from the origin)"
    )
    return ("formation", "radius_m"), text


def _misfit(loc: Loc, value: object, text: str) -> Misfit:
    return Misfit(loc, ".".join(str(part) for part in loc), str(value), text)
