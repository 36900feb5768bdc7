"""`gcs serve`: runs the service, and its API in a process beside it."""

import argparse
import asyncio
import errno
import logging
import secrets
import socket
import sys
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, nullcontext
from pathlib import Path
from typing import Final, TypeAlias

from pydantic import ValidationError

from gcs.api.map_tiles import open_map
from gcs.cli.output import REFUSED, Say, failed, lines, require_stations
from gcs.cli.service import scheduling, site_processes, supervisor, wall_clock
from gcs.cli.service.api_process import api_process
from gcs.cli.service.memory import save_memory
from gcs.cli.service.process import (
    Notifier,
    StopRequests,
    ignore_the_terminal,
    notifier_from_environment,
    run_exactly,
    set_up_log,
)
from gcs.config import schema as configuration
from gcs.config import yaml_files as documents
from gcs.config.schema import Config
from gcs.config.sections import LinkSettings
from gcs.config.setting_errors import Misfit, explained
from gcs.config.site import station_config
from gcs.config.yaml_files import Source
from gcs.flight.orchestrator import Heart, Orchestrator
from gcs.formation.laws.registry import allow_code
from gcs.links.batch_link import Link
from gcs.links.mavsdk.link import MavsdkLink
from gcs.links.native.link import NativeLink
from gcs.links.settings import Listen, TcpIn
from gcs.links.signing import Signing
from gcs.links.stream_requests import desired_rates
from gcs.model.errors import ConfigError, FileError, GcsError, Problem, RefusedError
from gcs.model.interrupted_flight import Offer
from gcs.model.lifecycle import AIRBORNE, Phase, ShowPhase
from gcs.model.preflight_report import named
from gcs.model.state import VehicleId, Whereabouts, whereabouts
from gcs.recording.audit_reader import exclusions, interruption, lost_begin
from gcs.recording.session import Record
from gcs.service import FleetView, ShowAction
from gcs.service.access import ACCESS_OFF, is_loopback
from gcs.service.alarms import AlarmCause
from gcs.service.folder_lock import owned
from gcs.site.member import Membership
from gcs.site.service import SiteService

log = logging.getLogger(__name__)

FAILURES_S: Final = 1.0
"""How often `gcs serve` looks for links that have failed."""

StationService: TypeAlias = Orchestrator | SiteService
"""The service of a station that flies alone, or of one of a site."""


def make_link(settings: LinkSettings, config: Config, record: Path | None = None) -> Link:
    """Make the link with the transport of its settings; it records frames into the folder `record`.

    Raises: ConfigError for an invalid signing key.
    """
    transport = NativeLink if settings.transport == "native" else MavsdkLink
    signing = settings.signing
    return transport(
        settings.name,
        {vehicle.id: vehicle.system_id for vehicle in settings.fleet},
        settings.places,
        config.frame,
        autopilots=settings.autopilots,
        setpoint_timeout_s=config.setpoint_timeout_s,
        heartbeat_hold_s=settings.heartbeat_hold_s,
        rates_hz=desired_rates(settings.streams),
        record=record,
        signing=None if signing is None else Signing(signing.key_file, signing.link_id),
        forward=settings.forward,
        extra_bytes_per_s=settings.extra_share_bytes_per_s,
    )


@asynccontextmanager
async def running(
    config: Config,
    heart: Heart | None = None,
    *,
    priority: scheduling.PriorityRequest = "usual",
    site: Config | None = None,
) -> AsyncIterator[tuple[StationService, int]]:
    """Run the service with its API until the block ends. Yields the service and the API's port.

    The API has a process of its own; a failed one is replaced without effect on control. An error of control
    ends the block. `heart` is notified of every tick in time. `priority` is
    asked of the machine for this process. `site` is the configuration out of which `station_config` made
    `config`; None: this station flies alone.

    Raises:
        LinkError: the API's port is not available at the start.
        ConfigError: the file of tokens or keys is not valid.
        RefusedError: another service writes the folder of records.
    """
    with nullcontext() if config.record is None else owned(config.record.folder):
        async with _served(config, heart, priority, site) as (service, port):
            yield service, port


@asynccontextmanager
async def _served(
    config: Config, heart: Heart | None, priority: scheduling.PriorityRequest, site: Config | None
) -> AsyncIterator[tuple[StationService, int]]:
    async with api_process(config) as api:  # it loads its modules while control is made
        record = make_record(config, site)
        keeps_frames = config.record is not None and config.record.frames
        folder = record.folder if record is not None and keeps_frames else None
        links = [make_link(link, config, folder) for link in config.links]
        planning = ThreadPoolExecutor(1, thread_name_prefix="ways", initializer=scheduling.step_down)
        reading = ThreadPoolExecutor(1, thread_name_prefix="shows", initializer=scheduling.step_down)
        local = Orchestrator(
            config,
            links,
            record,
            clock_problem=wall_clock.problem,
            heart=heart,
            planning=planning,
            problems=map_problems(config),
        )
        service: StationService = local
        if site is not None:
            service = SiteService(local, make_membership(config, site), reading)
        raise_priority(local, priority)
        with nullcontext() if record is None else record:
            log_access(config)
            keeper = asyncio.create_task(api.keep(service), name="api")
            try:
                async with asyncio.TaskGroup() as group:
                    control = group.create_task(service.run(), name="service")
                    sources = [group.create_task(each.receive()) for each in local.flight.features]
                    await api.tried.wait()
                    yield service, api.port
                    for source in sources:
                        source.cancel()
                    control.cancel()
            finally:
                keeper.cancel()
                await asyncio.wait((keeper,))


def make_membership(config: Config, site: Config) -> Membership:
    """Make the bus of this station, not opened yet. Must be called on the running event loop.

    Raises: ConfigError when the extra `stations` is not installed.
    """
    require_stations("a configuration with stations", "zenoh")
    from gcs.bus.zenoh_bus import ZenohBus  # noqa: PLC0415 (needs the extra)

    if config.site_rows is None:
        raise ConfigError("this configuration is not of one of several stations")
    station = config.site_rows.station
    endpoints = {each.name: each.endpoint for each in site.stations}
    now_s = asyncio.get_running_loop().time
    bus = ZenohBus(station, endpoints, keys=site.bus.keys, now_s=now_s)
    return Membership(station, site, bus, secrets.randbits(31))


def raise_priority(orchestrator: Orchestrator, asked: scheduling.PriorityRequest) -> None:
    """Ask for it, once all kernels are compiled; threads that start afterwards inherit what is granted."""
    granted = scheduling.ask(asked)
    orchestrator.granted(granted)
    others = ThreadPoolExecutor(thread_name_prefix="others", initializer=scheduling.step_down)
    asyncio.get_running_loop().set_default_executor(others)
    if asked == "real-time" and not (granted.priority.startswith("real-time") and granted.memory_locked):
        log.warning("scheduling_not_granted", extra={"has": granted.text, "fix": scheduling.FIX})


def make_record(config: Config, site: Config | None = None) -> Record | None:
    """Make a new session's record, not opened yet; None when the configuration has no folder."""
    if config.record is None:
        return None
    vehicles = {each.id: (each.system_id, link.name) for link in config.links for each in link.fleet}
    folder = config.record.folder
    try:
        found, excluded, begin = interruption(folder), exclusions(folder), lost_begin(folder)
    except GcsError as error:  # a damaged record must not prevent a flight
        log.error("record_unread", extra={"cause": str(error)})
        found, excluded, begin = None, {}, None
    return Record(
        folder,
        config.model_dump_json(),
        vehicles,
        flight=config.record.flight,
        interruption=found,
        excluded=excluded,
        lost_begin=begin,
        elsewhere={} if site is None else _elsewhere(config, site),
        site_json=None if site is None else site.model_dump_json(),
        autopilots=(site or config).autopilots,
        site_hash="" if config.flight_site is None else config.flight_site.digest,
    )


def _elsewhere(config: Config, site: Config) -> dict[VehicleId, tuple[int, str]]:
    """System id and link of the other stations' vehicles, in the order of a view's rows."""
    own = set(config.ids)
    links = {link.name: link for link in site.links}
    return {
        each.id: (each.system_id, name)
        for station in site.stations
        for name in station.links
        for each in links[name].fleet
        if each.id not in own
    }


def map_problems(config: Config) -> list[str]:
    """Why the map cannot be used, for an operator.

    An unusable map file does not prevent a flight: an interrupted service must be able to start without it.
    """
    try:
        ground = open_map(config.map)
    except ConfigError as error:
        log.warning("map_missing", extra={"cause": str(error)})
        return [f"no map: {error}"]
    if ground is not None and ground.file is not None:
        ground.file.close()
    return []


def log_access(config: Config) -> None:
    """Log what is open to others."""
    access = config.access
    if access.tokens_file is None:
        log.warning("access_off", extra={"host": config.api.host, "means": ACCESS_OFF})
    elif access.tls is None and not is_loopback(config.api.host):
        fix = "access.tls; until then anyone on the network can read the tokens"
        log.warning("access_without_tls", extra={"host": config.api.host, "fix": fix})


async def serve(config: Config, say: Say, notifier: Notifier, *, site: Config | None = None) -> None:
    """Run until a signal requests a stop. The first Ctrl-C brings the fleet home; the second stops at once.

    A closed terminal brings it home as well.

    `site` as of `running`.

    Raises: GcsError when it cannot start.
    """
    stop = StopRequests()
    ignore_the_terminal()
    async with running(config, notifier, priority=config.scheduling, site=site) as (service, port):
        notifier.ready()
        scheme = "http" if config.access.tls is None else "https"
        url = f"{scheme}://{config.api.host}:{port}"
        count = len(config.ids)
        text = f"serving {count} vehicles; look at them at {url}/ ; API at {url}/docs"
        say("serving", text, url=url, vehicles=count)
        if config.access.tokens_file is None:
            off = "access is off: every user of this machine can fly; gcs token create makes tokens"
            say("access_off", off)
        failures = asyncio.create_task(say_failures(service, say), name="link failures")
        await stop.first.wait()
        failures.cancel()
        notifier.stopping()
        if _any_airborne(service.view.value):
            await _brought_home(service, stop, say)
        if left := left_behind(service.view.value):
            say("left_behind", f"ended; {left}")


async def _brought_home(service: StationService, stop: StopRequests, say: Say) -> None:
    """Stop the show, and wait until its vehicles are down, or for a second signal."""
    try:
        service.commands.command_show(ShowAction.STOP)
    except RefusedError as refused:
        say("stop_refused", f"{refused}")  # still wait until no vehicle is airborne
    say(
        "coming_home",
        "coming home; press Ctrl-C again to stop at once (the vehicles' own failsafe takes over)",
    )
    landed = asyncio.create_task(_landed(service), name="landed")
    again = asyncio.create_task(stop.second.wait(), name="again")
    await asyncio.wait((landed, again), return_when=asyncio.FIRST_COMPLETED)
    landed.cancel()
    again.cancel()


async def say_failures(service: StationService, say: Say) -> None:
    """Say each link that fails, with how many vehicles are received all the same."""
    printed = set[str]()
    while True:
        view = service.view.value
        failed = {alarm.id: alarm.text for alarm in view.alarms if alarm.cause is AlarmCause.LINK_FAILED}
        for alarm_id in failed.keys() - printed:
            offline = list(view.rows.phases).count(Phase.OFFLINE)
            count = len(view.rows.phases)
            received = f"{count - offline} of {count} vehicles are received"
            say("link_failed", f"{failed[alarm_id]} {received}")
        printed |= failed.keys()
        await asyncio.sleep(FAILURES_S)


def left_behind(view: FleetView) -> str:
    """Which vehicles are, or may be, in the air without this station's control as it ends, in words."""
    rows, places = view.rows, dict[Whereabouts, list[str]]()
    for row in _own_rows(view):
        where = whereabouts(
            rows.phases[row],
            rows.landed[row],
            armed=rows.armed[row],
            heartbeat_age_s=float(rows.heartbeat_age_s[row]),
        )
        places.setdefault(where, []).append(f"{rows.ids[row]} ({rows.phases[row]})")
    up = [
        name for where in (Whereabouts.CONTROLLED, Whereabouts.UNCONTROLLED) for name in places.get(where, ())
    ]
    unknown = places.get(Whereabouts.UNKNOWN, [])
    return "; ".join(
        f"{text}: {named(names)}"
        for text, names in (
            ("still in the air, not under this station's control", up),
            ("not known whether on the ground", unknown),
        )
        if names
    )


async def _landed(service: StationService) -> None:
    async for view in service.view.values():
        if not _any_airborne(view):
            return


def _any_airborne(view: FleetView) -> bool:
    """Whether a vehicle that `stop` would bring home is airborne, or about to be."""
    if view.show in {ShowPhase.PREFLIGHT, ShowPhase.ARMING}:
        return True
    if view.interrupted is not None and Offer.BRING_HOME in view.interrupted.offers:
        return True  # a stall or restart left vehicles hovering
    return not AIRBORNE.isdisjoint(view.rows.phases[row] for row in _own_rows(view))


def _own_rows(view: FleetView) -> list[int]:
    """The rows of the vehicles that this station flies."""
    own = next((station.name for station in view.stations if station.own), "")
    flown_by = view.rows.stations or [""] * len(view.rows.phases)
    return [row for row, by in enumerate(flown_by) if by == own]


def run_serve(arguments: argparse.Namespace) -> int:
    """Serve. Returns: the exit code. Raises: ConfigError."""
    if arguments.all:
        return _run_all(arguments)
    if arguments.supervised:
        return supervisor.run(sys.argv[1:])
    save_memory()
    set_up_log(logging.WARNING if arguments.quiet else logging.INFO, arguments.station)
    if arguments.allow_law_code:
        allow_code(configuration.find(arguments.config).parent)
    config, site = load_here(arguments.config, arguments.station)
    if config.stations:
        names = ", ".join(each.name for each in config.stations)
        raise ConfigError(f"{arguments.config}: it has the stations {names}: --station NAME, or --all")
    changes = {"host": arguments.host, "port": arguments.port}
    api = config.api.model_dump() | {key: value for key, value in changes.items() if value is not None}
    try:
        config = configuration.Config.model_validate(config.model_dump() | {"api": api})
    except ValidationError as error:
        raise explained(error, "with --host and --port", configuration.Config, None) from None
    notifier = notifier_from_environment()
    try:
        run_exactly(serve(config, lines(arguments), notifier, site=site))
    except GcsError as error:
        return failed(error, arguments, REFUSED)
    finally:
        notifier.close()
    return 0


def _run_all(arguments: argparse.Namespace) -> int:
    """Serve every station. Returns: the exit code. Raises: ConfigError."""
    if arguments.port is not None:
        raise ConfigError(f"--port {arguments.port}: with --all each station has an api.port of its own")
    path = configuration.find(arguments.config)
    if arguments.allow_law_code:
        allow_code(path.parent)
    names = [each.name for each in configuration.load(path).stations]
    if not names:
        raise ConfigError(f"{path}: it has no stations, so leave --all out")
    require_stations("a configuration with stations", "zenoh")
    notifier = notifier_from_environment()
    try:
        return site_processes.run(names, sys.argv[1:], arguments, notifier)
    finally:
        notifier.close()


def load_here(name: str, station: str | None = None) -> tuple[Config, Config | None]:
    """Load a configuration, or that of one station of a site.

    Returns: the configuration and, for a station, that of its site.
    Raises: ConfigError, also for addresses that this computer does not have.
    """
    path = configuration.find(name)
    whole = configuration.load(path)
    config = whole
    if station is not None:
        try:
            config = station_config(whole, station)
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from None
    found = [*_misfits(whole, config)]
    if found:
        written = Source(documents.read(path), str(path))
        raise FileError(str(path), [Problem(written.line(*one.loc), None, str(one)) for one in found])
    return config, None if station is None else whole


def _misfits(whole: Config, config: Config) -> Iterator[Misfit]:
    """Yield the addresses that do not belong to this computer, of what `config` has of the whole file."""
    for link, at in _listens(whole, config):
        for place, url in zip(link.places, link.listen, strict=True):
            if isinstance(place, Listen | TcpIn) and not _is_ours(place.host):
                text = f"this computer has no address {place.host}: one of its own, or 0.0.0.0 for all"
                yield Misfit(at, ".".join(map(str, at)), f"'{url}'", text)
    loc: tuple[str | int, ...] = ("api", "host")
    for number, station in enumerate(whole.stations):
        if config.site_rows is not None and station.name == config.site_rows.station:
            if not _is_ours(station.endpoint.host):
                text = "this computer has no such address: start this station on the host that has it"
                key, value = f"stations.{number}.endpoint.host", f"'{station.endpoint.host}'"
                yield Misfit(("stations", number, "endpoint", "host"), key, value, text)
            if station.api is not None:
                loc = ("stations", number, "api", "host")
    if not _is_ours(config.api.host):
        text = "this computer has no such address: one of its own, or 127.0.0.1"
        yield Misfit(loc, ".".join(map(str, loc)), f"'{config.api.host}'", text)


def _listens(whole: Config, config: Config) -> Iterator[tuple[LinkSettings, tuple[str | int, ...]]]:
    """Yield the links that `config` opens, each with its place in the whole file."""
    at: dict[str, tuple[str | int, ...]] = {
        link.name: ("links", number, "listen") for number, link in enumerate(whole.links)
    }
    for number, station in enumerate(whole.stations):
        if config.site_rows is not None and station.name == config.site_rows.station:
            for mirror, one in enumerate(station.standby):
                at[one.link] = "stations", number, "standby", mirror, "listen"
    yield from ((link, at[link.name]) for link in config.links)


def _is_ours(host: str) -> bool:
    """Whether this computer has that address; True when it cannot be tested."""
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE)
    except OSError:
        return False
    family, kind, protocol, _, address = found[0]
    with socket.socket(family, kind, protocol) as trial:
        try:
            trial.bind(address)
        except OSError as error:
            return error.errno != errno.EADDRNOTAVAIL
    return True
