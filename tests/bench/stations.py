"""Several stations, real: 1,200 fake vehicles on 4 stations as processes, beside a station with 300 alone.

`make bench` prints it; `python tests/bench/stations.py --vehicles 80 --seconds 20` is a small try. All five
fly at the same time, for the same work takes up to 1.4 times as much from one minute to the next: over
UDP, MAVLink and the bus, assembly, orbit, home. Times and CPU are those of the steady orbit, while nothing
asks the stations. Violations are counted in the true states.
"""

import argparse
import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from math import nan
from pathlib import Path
from typing import Any, Final

if __name__ == "__main__" and not __package__:  # as a script: from the root, which has `tests`
    os.chdir(Path(__file__).parents[2])
    os.execv(sys.executable, [sys.executable, "-m", "tests.bench.stations", *sys.argv[1:]])  # noqa: S606 (this program)

import numpy as np
import yaml
from pydantic_core import from_json

from gcs.cli.demo.demo_script import ORBIT_SPEED_M_S, USUAL_RADIUS_M
from gcs.client import Client
from gcs.config.schema import Config
from gcs.model.errors import LinkError, RefusedError
from gcs.model.state import Array
from gcs.safety.floor import Floor, minimum_separation, pairs_that_count, scaled_distance_m
from tests.bench.fake_fleet import busy_s
from tests.bench.links import PASSED_ON_MS, Requirement
from tests.support.machine import free_ports
from tests.support.site_processes import NAMES, fleet_words, ports_of, site_config
from tests.support.started import DEVNULL, Started

STATIONS: Final = len(NAMES)
ALONE, TOGETHER = "alone", "together"
STAGGER_S: Final = 0.02
SETTLE_S: Final = 10.0
LONG_S: Final = 600.0
"""For each part of the flight: a busy machine is slow."""

START_S: Final = 180.0
"""Until all is ready to start."""

ENDS_S: Final = 20.0
NOT_FLOWN: Final = 1

TIMES_ALONE, BYTES_MOST, ACROSS_MS = 1.3, 64.0, 5.0
"""What is asked: CPU over that of a station alone; a vehicle and tick on the bus; beyond a tick across it."""


@dataclass(slots=True)
class Fleet:
    """Stations that fly together, their processes, and the true states of their vehicles."""

    config: Config
    folder: Path
    names: Sequence[str]
    vehicles: Started = field(init=False)
    stations: dict[str, Started] = field(default_factory=dict)
    clients: dict[str, Client] = field(default_factory=dict)
    refused: str = ""  # why the newest start was

    @property
    def truth(self) -> Path:
        return self.folder / "truth.jsonl"

    def probe(self, name: str) -> Path:
        return self.folder / f"{name}.json"

    def show(self) -> str:
        """Phase of the whole show, at the first station."""
        return self.clients[self.names[0]].show().phase

    def all_show(self, phase: str) -> bool:
        return all(client.show().phase == phase for client in self.clients.values())

    def starts(self) -> bool:
        """Command the start. Returns: whether it has begun."""
        try:
            self.clients[self.names[0]].start()
        except LinkError:
            return False
        except RefusedError as error:  # also when the answer of an earlier start came too late
            self.refused = str(error)
            return self.show() != "idle"
        return True


def site_of(stations: int, each: int, rate_hz: float) -> Config:
    """A configuration of `stations` stations, or without stations for one that flies alone."""
    parts = 2 if stations == 1 else stations  # a site has two stations at least: take their links
    share = each // 2 if stations == 1 else each
    operation = {"takeoff_stagger_s": STAGGER_S}
    config = site_config(parts, share, free_ports(ports_of(parts, share)), operation=operation)
    scheduling = Config.model_fields["scheduling"].default  # not as in tests, which share the machine
    raw = config.model_dump(mode="json") | {"tick_rate_hz": rate_hz, "scheduling": scheduling}
    if stations == 1:
        raw |= {"api": raw["stations"][0]["api"], "stations": []}
    return Config.model_validate(raw)


@contextmanager
def flying(config: Config, folder: Path) -> Iterator[Fleet]:
    """Run vehicles and stations until the block ends, which kills them all."""
    folder.mkdir()
    fleet = Fleet(config, folder, tuple(one.name for one in config.stations) or (folder.name,))
    file = folder / "config.yaml"
    raw = config.model_dump(mode="json") | {"record": {"folder": str(folder / "runs"), "frames": False}}
    file.write_text(yaml.safe_dump(raw), encoding="utf-8")
    base = config.links[0].listen[0].rpartition(":")[2]
    words = (*fleet_words(config, 0, len(config.ids)), "--port-base", base, "--truth", str(fleet.truth))
    with ExitStack() as stack:
        fleet.vehicles = Started("gcs", "sim", *words, stdout=DEVNULL)
        stack.callback(fleet.vehicles.end)
        for name in fleet.names:
            station = ("--station", name) if config.stations else ()
            command = (str(fleet.probe(name)), "serve", "--config", str(file), "--quiet", *station)
            with (folder / f"{name}.log").open("w") as log:
                process = Started("tests.bench.station_probe", *command, stdout=DEVNULL, stderr=log)
            stack.callback(process.end)
            fleet.stations[name] = process
            apis = {one.name: one.api for one in config.stations}
            api = apis.get(name) or config.api
            client = Client(f"http://{api.host}:{api.port}", timeout_s=30.0)
            fleet.clients[name] = stack.enter_context(client)
        yield fleet


def wait(
    what: str, fleets: Sequence[Fleet], reached: Callable[[Fleet], bool], limit_s: float = LONG_S
) -> None:
    """Until it holds of all, which is then not asked again. Raises: TimeoutError."""
    left, began_s = list(fleets), time.monotonic()
    while left := [fleet for fleet in left if not reached(fleet)]:
        if time.monotonic() > began_s + limit_s:
            shows = [(fleet.clients[fleet.names[0]].show(), fleet.refused) for fleet in left]
            reasons = [f"{show.phase}: {show.reason}; {refused}" for show, refused in shows]
            raise TimeoutError(f"{what}: not within {limit_s:g} s: {reasons}")
        time.sleep(0.5)
    print(f"  {what} after {time.monotonic() - began_s:.0f} s, load {os.getloadavg()[0]:.1f}", flush=True)


def metrics(client: Client) -> dict[str, float]:
    """Those without labels."""
    lines = [line.split() for line in client.metrics().splitlines() if line[:1].isalpha() and "{" not in line]
    return {name: float(value) for name, value in lines}


@dataclass(slots=True)
class Measured:
    """Of one station, in the steady orbit."""

    core_percent: float
    ticks: float
    missed: float
    sent_bytes: float
    waits_ms: Array  # of positions, until their setpoints left
    made_s: dict[int, float]  # when each batch was made
    used: list[tuple[str, int, float]]  # station, number of its batch, when

    @property
    def setpoint_p99_ms(self) -> float:
        return percentile(self.waits_ms, 99)


def percentile(values: Array, share: float) -> float:
    """Nan of none."""
    return float(np.percentile(values, share)) if len(values) else nan


def measure(fleets: Sequence[Fleet], seconds: float) -> dict[str, Measured]:
    """Measure all stations of all fleets at the same time; nothing asks them meanwhile.

    Processor time comes first, then as long what passes through them: to note that takes time as well.
    """
    stations = [(fleet, name) for fleet in fleets for name in fleet.names]
    before = {name: metrics(fleet.clients[name]) for fleet, name in stations}
    time.sleep(2.0)
    began = {}
    for fleet, name in stations:
        began[name] = time.monotonic(), busy_s(fleet.stations[name].pid)
    vehicles_s = sum(busy_s(fleet.vehicles.pid) for fleet in fleets)
    time.sleep(seconds)
    percent = {}
    for fleet, name in stations:
        process, (from_s, used_s) = fleet.stations[name], began[name]
        percent[name] = 100.0 * (busy_s(process.pid) - used_s) / (time.monotonic() - from_s)
    vehicles = 100.0 * (sum(busy_s(fleet.vehicles.pid) for fleet in fleets) - vehicles_s) / seconds
    load = os.getloadavg()[0]
    print(f"  measured for {seconds:g} s, load {load:.1f}; vehicles {vehicles:.0f} % of a core", flush=True)
    for fleet, name in stations:
        fleet.stations[name].send_signal(signal.SIGUSR1)
    time.sleep(seconds)
    for fleet, name in stations:
        fleet.stations[name].send_signal(signal.SIGUSR2)
    found = {}
    for fleet, name in stations:
        after = metrics(fleet.clients[name])
        change = {key: after.get(key, 0.0) - value for key, value in before[name].items()}
        noted = read_probe(fleet.probe(name))
        found[name] = Measured(
            percent[name],
            change["gcs_ticks_total"],
            change["gcs_ticks_missed_total"],
            change.get("gcs_bus_sent_bytes_total", nan),
            1e3 * np.array(noted["waits_s"]),
            dict(noted["made"]),
            [(station, number, at_s) for station, number, at_s in noted["used"]],
        )
    return found


def read_probe(file: Path) -> dict[str, Any]:
    """What a station wrote. Raises: TimeoutError."""
    end_s = time.monotonic() + ENDS_S
    while not file.exists():
        if time.monotonic() > end_s:
            raise TimeoutError(f"{file.name} was not written")
        time.sleep(0.05)
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return found


@dataclass(frozen=True, slots=True)
class Verdict:
    """On the true states of one fleet."""

    nearest_m: float  # of the pairs that count, in the floor's metric
    violations: int  # how often a pair fell below the floor
    landed: int  # on the ground and disarmed at the end
    count: int


def judge(file: Path, floor: Floor) -> Verdict:
    """Line by line: the states of a whole flight of 1,200 vehicles would take gigabytes."""
    nearest_m, violations, inside_before = np.inf, 0, set[tuple[int, int]]()
    landed = np.zeros(0, np.bool_)
    with file.open("rb") as lines:
        for line in lines:
            if not line.endswith(b"\n"):
                break  # its writer was killed
            vehicles = from_json(line)["vehicles"]
            position_m = np.array([(one["north_m"], one["east_m"], one["down_m"]) for one in vehicles])
            airborne = np.array([not one["landed"] for one in vehicles])
            landed = ~airborne & np.array([not one["armed"] for one in vehicles])
            least_m, below = minimum_separation(position_m, airborne, floor)
            nearest_m = min(nearest_m, least_m)
            inside: set[tuple[int, int]] = set()
            if below:
                first, second = pairs_that_count(position_m, airborne, floor)
                close = scaled_distance_m(position_m, first, second, floor) < floor.horizontal_m
                inside = set(zip(first[close].tolist(), second[close].tolist(), strict=True))
            violations += len(inside - inside_before)
            inside_before = inside
    return Verdict(float(nearest_m), violations, int(landed.sum()), len(landed))


def across_ms(measured: dict[str, Measured]) -> Array:
    """From the making of each batch to its use, over all pairs of stations. Lost ones are not in it."""
    took_s = [
        at_s - measured[station].made_s[number]
        for one in measured.values()
        for station, number, at_s in one.used
        if number in measured[station].made_s
    ]
    return 1e3 * np.array(took_s)


def fly(
    configs: Mapping[str, Config], folder: Path, seconds: float
) -> tuple[dict[str, Measured], dict[str, Verdict]]:
    """Assembly, orbit, home, of fleets by their names, at the same time. Raises: TimeoutError."""
    with ExitStack() as stack:
        fleets = [stack.enter_context(flying(config, folder / name)) for name, config in configs.items()]
        wait("started", fleets, Fleet.starts, START_S)
        wait("running", fleets, lambda fleet: fleet.all_show("running"))
        for fleet in fleets:
            client = fleet.clients[fleet.names[0]]
            client.change_orbit(radius_m=USUAL_RADIUS_M, speed_m_s=ORBIT_SPEED_M_S)
        time.sleep(SETTLE_S)
        measured = measure(fleets, seconds)
        for fleet in fleets:
            fleet.clients[fleet.names[0]].stop()
        wait("landed", fleets, lambda fleet: fleet.all_show("landed"))
        time.sleep(1.0)  # the last true states
    floors = {fleet.folder.name: fleet.config.control.safety.floor for fleet in fleets}
    return measured, {fleet.folder.name: judge(fleet.truth, floors[fleet.folder.name]) for fleet in fleets}


def tell(
    site: Config, measured: dict[str, Measured], verdicts: dict[str, Verdict], *, was_idle: bool
) -> None:
    """Print the rows, and what is asked."""
    count = len(site.ids)
    alone_percent = measured[ALONE].core_percent
    of_site = {name: one for name, one in measured.items() if name != ALONE}
    period_ms = 1e3 / site.tick_rate_hz
    print("scale")
    for name, verdict in verdicts.items():
        near = f"nearest {verdict.nearest_m:.2f} m of {site.control.safety.floor.horizontal_m:g}"
        landed = f"landed {verdict.landed} of {verdict.count}"
        print(f"  {name:<10}{landed}, violations {verdict.violations}, {near}")
    for name, one in measured.items():
        ticks = f"{one.ticks:.0f} ticks, {one.missed:.0f} missed"
        ratio = one.core_percent / alone_percent
        print(f"  {name:<10}{one.core_percent:5.1f} % of a core, {ratio:.2f} x that alone, {ticks}")
    worst = max(one.core_percent for one in of_site.values()) / alone_percent
    took_ms = across_ms(of_site)
    bytes_each = sum(one.sent_bytes / max(one.ticks, 1.0) for one in of_site.values()) / count
    print("delay")
    made = sum(len(one.made_s) for one in of_site.values()) * (len(of_site) - 1)
    across = f"p50 {percentile(took_ms, 50):.1f}  p99 {percentile(took_ms, 99):.1f}"
    print(f"  batch made to batch used   {across} ms, {len(took_ms)} used of {made} made")
    print(f"  bus traffic                {bytes_each:.1f} bytes a vehicle and tick")
    for name, one in measured.items():
        waits = f"p50 {percentile(one.waits_ms, 50):.1f}  p99 {percentile(one.waits_ms, 99):.1f} ms"
        print(f"  sample to setpoint, {name:<8}{waits}")
    missing = sum(verdict.count - verdict.landed for verdict in verdicts.values())
    violations = sum(verdict.violations for verdict in verdicts.values())
    required = [
        Requirement("vehicles not landed", missing, 0.0),
        Requirement("violations", violations, 0.0),
        Requirement("CPU, times that alone", worst, TIMES_ALONE),
        Requirement("bytes a vehicle and tick", bytes_each, BYTES_MOST),
        Requirement("batch made to used p99, ms", percentile(took_ms, 99), period_ms + ACROSS_MS),
    ]
    for name in of_site:
        what = f"sample to setpoint p99 at {name}, ms"
        required.append(Requirement(what, measured[name].setpoint_p99_ms, period_ms + PASSED_ON_MS))
    busy = "" if was_idle else "   (the machine was busy: times are asked of one that is idle otherwise)"
    print("must" + busy)
    for each in required:
        print(f"  {each.figure:8.2f}  {each}")


def main() -> int:
    """Fly and print. Returns: 0 when it was measured, whatever the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=1200, help="of all four stations")
    parser.add_argument("--seconds", type=float, default=60.0, help="of the steady orbit")
    parser.add_argument("--rate", type=float, default=10.0, help="ticks a second")
    arguments = parser.parse_args()
    each = arguments.vehicles // STATIONS
    if each < 2 or each % 2 or each * STATIONS != arguments.vehicles:
        parser.error(f"--vehicles {arguments.vehicles}: a multiple of {2 * STATIONS}")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends all processes as Ctrl-C does
    load = os.getloadavg()[0]
    title = f"{each * STATIONS} vehicles on {STATIONS} stations beside {each} on one alone"
    print(f"{title}, {arguments.rate:g} Hz, {os.cpu_count()} cores, load before {load:.1f}", flush=True)
    configs = {name: site_of(of, each, arguments.rate) for name, of in ((ALONE, 1), (TOGETHER, STATIONS))}
    with tempfile.TemporaryDirectory(prefix="gcs-bench-") as folder:
        try:
            measured, verdicts = fly(configs, Path(folder), arguments.seconds)
        except TimeoutError as error:
            print(f"not flown: {error}")
            return NOT_FLOWN
    tell(configs[TOGETHER], measured, verdicts, was_idle=load < 0.5)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
