"""A site of several stations as processes, over one fleet of fake vehicles; judged on true states.

`running_site` runs the stations on this machine's loopback. `tests.support.netns` runs each station in a
network namespace of its own.
"""

import fcntl
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from math import ceil, sqrt
from pathlib import Path
from typing import Protocol, Self, TypeVar

import httpx
import numpy as np
import yaml
from pydantic import TypeAdapter

from gcs.bus.shared_memory import shared_file
from gcs.cli.demo.demo_report import GroundTruth, separation
from gcs.cli.service.scheduling import PriorityRequest
from gcs.client import Client
from gcs.config import schema as configuration
from gcs.config.schema import Config
from gcs.links.settings import SYSTEM_ID_MAX
from gcs.model.errors import GcsError, LinkError, RefusedError
from gcs.planning.feasibility import smallest_formation_radius_m
from gcs.recording.trajectories import read_true_states
from gcs.service import StationView
from gcs.sim.settings import PAD_SPACING_M
from tests.support.machine import free_ports
from tests.support.processes import AT_ONCE, ORIGIN, REPORTED_M, SOON_S, proper, wait_until
from tests.support.started import DEVNULL, Started

T = TypeVar("T")

NAMES = ("north", "south", "west", "east")

LOSS_S = 3.0
"""Fake vehicles take so long without setpoints for the loss of their station: the machine may pause."""

SAMPLE_S = 0.02

STATIONS_LIST = TypeAdapter(list[StationView])


class Work(Protocol):
    """Runs a function where a station's API can be reached."""

    def __call__(self, function: Callable[[], T], /) -> T: ...


def here(function: Callable[[], T]) -> T:
    """On this machine's loopback."""
    return function()


def site_config(
    stations: int,
    each: int,
    port_base: int,
    *,
    hosts: Sequence[str] | None = None,
    keys: Path | None = None,
    operation: Mapping[str, object] | None = None,
) -> Config:
    """A site of some stations with `each` vehicles: n1, n2 ... s1 ...; small, low, with long time limits.

    With more vehicles than a link has system ids a station has several links: north1, north2; n1-1, n1-2 ...

    Args:
        stations: of the first names in `NAMES`.
        each: vehicles of a station; equal shares where it has several links.
        port_base: `ports_of` ports: those of all links, then each station's endpoint and its API's two.
        hosts: addresses of the stations' endpoints; None: loopback.
        keys: folder of `gcs key site`.
        operation: settings of that section.
    """
    names = NAMES[:stations]
    raw = configuration.load(configuration.find("demo")).model_dump()
    parts = _links_each(each)
    numbers = [""] if parts == 1 else [str(part + 1) for part in range(parts)]
    dash = "" if parts == 1 else "-"
    raw["links"] = [
        {
            "name": f"{name}{number}",
            "transport": "native",
            "listen": f"udpin://127.0.0.1:{port_base + parts * at + part}",
            "vehicles": {"count": each // parts, "id_pattern": f"{name[0]}{number}{dash}{{system_id}}"},
        }
        for at, name in enumerate(names)
        for part, number in enumerate(numbers)
    ]
    first = port_base + parts * stations
    raw["stations"] = [
        {
            "name": name,
            "links": [f"{name}{number}" for number in numbers],
            "endpoint": {"host": "127.0.0.1" if hosts is None else hosts[at], "port": first + 3 * at},
            "api": {"port": first + 3 * at + 1, "emergency_port": first + 3 * at + 2},
        }
        for at, name in enumerate(names)
    ]
    if keys is not None:
        raw["bus"] = {"keys": keys}
    count = stations * each
    safety = configuration.Config.model_validate(raw).control.safety
    reported_m = np.full(count, REPORTED_M)
    radius_m = max(4.0, 1.2 * smallest_formation_radius_m(count, safety, reported_m))
    field_m = (columns(count) - 1) * PAD_SPACING_M
    raw["formation"] = {"radius_m": radius_m, "height_m": radius_m + 4.0}
    raw["target"] = {"x_m": field_m / 2.0, "y_m": field_m / 2.0}
    raw["operation"] |= {"takeoff_height_m": 3.0, "takeoff_stagger_s": 0.2, "setpoint_loss_s": LOSS_S}
    raw["operation"] |= {"setpoint_loss_action": "hold", "silence_s": 20.0, **(operation or {})}
    raw["operation"]["pads_within_m"] = max(50.0, 1.5 * field_m)
    fence = raw["control"]["safety"]["fence"]
    fence["height_max_m"] = max(fence["height_max_m"], 2.0 * radius_m + 30.0)
    for cause in ("service_late", "links_late", "wind"):  # a busy machine is late, which ends no flight here
        raw["failsafes"][cause]["action"] = "ignore"
    raw["scheduling"] = "usual"  # several stations share the machine of a test run
    return configuration.Config.model_validate(raw)


def _links_each(each: int) -> int:
    """Links of a station, so that each has enough system ids."""
    return ceil(each / SYSTEM_ID_MAX)


def ports_of(stations: int, each: int) -> int:
    """Number of ports that `site_config` uses."""
    return stations * (_links_each(each) + 3)


def columns(count: int) -> int:
    """Of the grid on which so many vehicles stand."""
    return ceil(sqrt(count))


def fleet_words(config: Config, first: int, count: int) -> tuple[str, ...]:
    """Words of `gcs sim` for these vehicles of the site, one station after the other."""
    each = len(config.links[0].fleet)
    words = ("--first", str(first), "--count", str(count), "--namespace-size", str(each), "--shared-port")
    grid = ("--origin", ORIGIN, "--grid-columns", str(columns(len(config.ids))))
    lasting = ("--battery", "600")  # the longest of these flights is half an hour
    return (*words, *grid, *lasting, "--telemetry-hz", "10", "--seed", "7", *AT_ONCE, *proper(config))


@dataclass(frozen=True, slots=True)
class Verdict:
    """On the true states of a flight."""

    nearest_m: float  # of the pairs that count, scaled
    violations: int  # how often a pair fell below the floor
    landed: frozenset[str]  # on the ground and disarmed at the end


def verdict(config: Config, files: Sequence[Path]) -> Verdict:
    """Judge what `gcs sim --truth` wrote."""
    known = read_true_states(files, period_s=SAMPLE_S)
    airborne, armed = known.values[..., 6] > 0.5, known.values[..., 8] > 0.5
    landed = ~(airborne[-1] | armed[-1])
    truth = GroundTruth(known.time_s, known.position_m(config.frame), airborne, landed)
    nearest_m, violations = separation(truth, config.control.safety.floor)
    by_number = [config.ids[number - 1] for number in known.numbers]
    return Verdict(nearest_m, violations, frozenset(np.array(by_number)[landed].tolist()))


@dataclass(frozen=True, slots=True)
class Timing:
    """Ticks of a station."""

    ticks: int
    missed_s: float  # periods of ticks that were dropped
    late: int  # ticks that began more than 10 ms late

    def since(self, before: "Timing") -> "Timing":
        """The ticks after those of `before`."""
        return Timing(self.ticks - before.ticks, self.missed_s - before.missed_s, self.late - before.late)

    def __add__(self, other: "Timing") -> "Timing":
        return Timing(self.ticks + other.ticks, self.missed_s + other.missed_s, self.late + other.late)


class SiteProcesses:
    """Running stations, by name. Each has its folder with its log and its records."""

    def __init__(self, config: Config, folder: Path) -> None:
        self.config, self.folder = config, folder
        self.names = tuple(station.name for station in config.stations)
        self.file = folder / "site.yaml"
        raw = config.model_dump(mode="json") | {"record": {"folder": str(folder / "runs"), "frames": False}}
        self.file.write_text(yaml.safe_dump(raw), encoding="utf-8")
        self.processes: dict[str, Started] = {}
        self.clients: dict[str, Client] = {}
        self.reach: dict[str, Work] = {}
        self.truths: list[Path] = []

    def start_station(self, name: str, *, reach: Work = here, namespace: str | None = None) -> None:
        """Start one station; `namespace` of the network, None: this one."""
        words = ("serve", "--config", str(self.file), "--quiet", "--station", name)
        with (self.folder / f"{name}.log").open("a") as log:
            process = Started("gcs", *words, stdout=DEVNULL, stderr=log, namespace=namespace)
        self.processes[name], self.reach[name] = process, reach
        self.clients[name] = Client(self.url(name), timeout_s=30.0)

    def url(self, name: str) -> str:
        """Of a station's API."""
        api = next(station.api for station in self.config.stations if station.name == name)
        assert api is not None
        return f"http://{api.host}:{api.port}"

    def end(self) -> None:
        """Kill every station."""
        for process in self.processes.values():
            process.end()
        for client in self.clients.values():
            client.close()

    # asked of one station

    def at(self, name: str, ask: Callable[[Client], T]) -> T:
        """Ask one station's API."""
        return self.reach[name](partial(ask, self.clients[name]))

    def show(self, name: str) -> str:
        """Phase of the show at a station."""
        return self.at(name, lambda client: client.show().phase)

    def stations(self, name: str) -> dict[str, StationView]:
        """All stations, as one of them receives them."""
        answer = self.reach[name](partial(httpx.get, f"{self.url(name)}/api/v1/stations", timeout=30.0))
        return {one.name: one for one in STATIONS_LIST.validate_json(answer.content)}

    def take_lead(self, name: str) -> None:
        """Have a station lead, and wait until all that are left follow it."""
        answer = self.reach[name](partial(httpx.post, f"{self.url(name)}/api/v1/stations/lead", timeout=30.0))
        answer.raise_for_status()
        for each in self.left:
            wait_until(f"{each} follows {name}", SOON_S, partial(self.follows, each, name))

    def follows(self, name: str, lead: str) -> bool:
        """Whether a station obeys that lead."""
        return self.stations(name)[lead].leads

    def receives(self, name: str, *others: str) -> bool:
        """Whether a station receives these now."""
        found = self.stations(name)
        return all(found[other].received for other in others)

    def own_phases(self, name: str) -> list[str]:
        """Phases of a station's own vehicles."""
        fleet = self.at(name, lambda client: client.fleet())
        return [one.phase for one in fleet.vehicles if one.id.startswith(name[0])]

    def all_form(self, *names: str) -> bool:
        """Whether all vehicles of these stations, or of all that run, fly in formation."""
        return all(set(self.own_phases(name)) == {"formation"} for name in names or self.left)

    # the flight

    @property
    def left(self) -> list[str]:
        """Stations that run."""
        return [name for name, process in self.processes.items() if process.poll() is None]

    def all_show(self, phase: str, *names: str) -> bool:
        """Whether the show is in that phase at these stations, or at all that run."""
        return all(self.show(name) == phase for name in names or self.left)

    def start_show(self, at: str | None = None) -> None:
        """Start at one station (the first) as soon as all are ready, and wait until all fly in formation."""
        refused = "no station answers"

        def accepted() -> bool:
            nonlocal refused
            try:
                self.at(at or self.names[0], lambda client: client.start())
            except (LinkError, RefusedError) as error:
                refused = str(error)
                with suppress(LinkError):  # it may have been accepted after the client gave up
                    return self.show(at or self.names[0]) not in {"idle", "landed"}
                return False
            return True

        end_s = time.monotonic() + SOON_S
        while not accepted():
            assert time.monotonic() < end_s, refused
            time.sleep(0.3)
        wait_until("running", SOON_S, lambda: self.all_show("running"))
        assert self.all_form()

    def come_home(self, at: str) -> None:
        """Stop the show at one station, and wait until the vehicles of all that run are on the ground."""
        self.at(at, lambda client: client.stop())

        def down() -> bool:
            return all(phase == "standby" for name in self.left for phase in self.own_phases(name))

        wait_until("down", SOON_S, down)

    def vehicles_of(self, *names: str) -> set[str]:
        """Ids of the vehicles of these stations."""
        return {one for one in self.config.ids if any(one.startswith(name[0]) for name in names)}

    def timing(self, name: str) -> "Timing":
        """Of all ticks since its start, as the station itself reports them."""
        return timing_of(self.at(name, lambda client: client.metrics()), self.config.tick_rate_hz)

    def metric(self, name: str, metric: str) -> float:
        """One value of a station's metrics."""
        return _metric(self.at(name, lambda client: client.metrics()), metric)

    def verdict(self) -> Verdict:
        """On the flight; to be asked when the vehicles have ended."""
        return verdict(self.config, self.truths)

    def log(self, name: str) -> str:
        """What a station wrote."""
        return (self.folder / f"{name}.log").read_text(encoding="utf-8")


def timing_of(text: str, tick_rate_hz: float) -> Timing:
    """Of all ticks since a service's start, out of its metrics."""
    ticks, in_time = (
        int(_metric(text, f"gcs_tick_lateness_seconds_{name}")) for name in ("count", 'bucket{le="0.01"}')
    )
    return Timing(ticks, _metric(text, "gcs_ticks_missed_total") / tick_rate_hz, ticks - in_time)


def _metric(text: str, name: str) -> float:
    return next(float(line.split()[-1]) for line in text.splitlines() if line.split(" ")[0] == name)


@contextmanager
def fleet(site: SiteProcesses, *options: str) -> Iterator[Started]:
    """Run the site's fake vehicles in one process until the block ends."""
    truth = site.folder / "truth.jsonl"
    base = site.config.links[0].listen[0].rpartition(":")[2]
    words = (*fleet_words(site.config, 0, len(site.config.ids)), "--port-base", base, "--truth", str(truth))
    process = Started("gcs", "sim", *words, *options, stdout=DEVNULL)
    site.truths.append(truth)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(SOON_S)


@contextmanager
def running_site(
    folder: Path,
    stations: int = 4,
    each: int = 3,
    *options: str,
    operation: Mapping[str, object] | None = None,
    shares_memory: bool = True,
    keys: Path | None = None,
    scheduling: PriorityRequest = "usual",
) -> Iterator[SiteProcesses]:
    """Run stations and vehicles until the block ends; `options` are those of `gcs sim`.

    Without `shares_memory` the stations exchange their messages over Zenoh, as in containers of their own.
    """
    config = site_config(stations, each, free_ports(ports_of(stations, each)), operation=operation, keys=keys)
    site = SiteProcesses(config.model_copy(update={"scheduling": scheduling}), folder)
    with ExitStack() as stack:
        for station in () if shares_memory else config.stations:
            file = shared_file(station.endpoint)
            taken = stack.enter_context(file.open("wb"))
            stack.callback(file.unlink)
            fcntl.flock(taken, fcntl.LOCK_EX)  # as of another process that writes it, and is no station
        stack.enter_context(fleet(site, *options))
        stack.callback(site.end)
        for name in site.names:
            site.start_station(name)
        yield site


class Operators:
    """Change the orbit's speed at each of some stations, one after the other, and note what was refused."""

    def __init__(self, site: SiteProcesses, stations: Sequence[str]) -> None:
        self.accepted: Counter[str] = Counter()  # by station
        self.refused: list[tuple[str, str]] = []  # station and reason
        self._site, self._stations = site, tuple(stations)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._work, name="operators")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Ends once each station was asked again."""
        self._ended.set()
        self._thread.join()

    def _work(self) -> None:
        speeds_m_s, turn = (1.5, 2.0), 0
        while True:
            last = self._ended.is_set()
            turn += 1
            for name in self._stations:
                change = partial(Client.change_orbit, speed_m_s=speeds_m_s[turn % 2])
                try:
                    self._site.at(name, change)
                except GcsError as refused:
                    self.refused.append((name, str(refused)))
                else:
                    self.accepted[name] += 1
            if last:
                return
            self._ended.wait(0.2)
