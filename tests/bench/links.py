"""What links and the service cost, in percent of one core: the direct transport beside pymavlink per message.

`make bench` prints it; `python tests/bench/links.py service 1000` measures one row. The vehicles are
`link_traffic`, in a process of their own; only the process that flies them is measured.
"""

import asyncio
import contextlib
import resource
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from link_traffic import FRAME, HOST
from pymavlink.dialects.v20 import common as dialect

from gcs.cli.serve import make_link
from gcs.config import Config, parse
from gcs.control import Memory
from gcs.lifecycle import Phase, ShowPhase
from gcs.links.direct.link import DirectLink
from gcs.orchestrator import Orchestrator
from gcs.state import Array, Mode, Setpoints, Telemetry

FIRST_PORT = 15400
EACH = 250
WARM_UP_S, MEASURED_S = 8.0, 15.0


@dataclass(frozen=True, slots=True)
class Cost:
    """Of one run."""

    core_percent: float
    resident_mb: float
    per_s: float  # setpoints that left
    passed_on_p99_ms: float = float("nan")  # from telemetry's arrival until a setpoint made with it has left
    tick_p99_ms: float = float("nan")
    late_p99_ms: float = float("nan")
    missing_percent: float = float("nan")  # of the positions that were sent


def radius_m(count: int) -> float:
    """Of a sphere on which so many have room."""
    return float(max(15.0, 1.6 * count**0.5))


def config_of(count: int, rate_hz: float) -> Config:
    """So many vehicles, 250 to a port."""
    links = [
        {
            "name": f"n{index}",
            "transport": "direct",
            "listen": f"udpin://{HOST}:{FIRST_PORT + index}",
            "vehicles": {"count": min(EACH, count), "id_pattern": "{link}-{system_id}"},
        }
        for index in range(max(1, count // EACH))
    ]
    origin = {
        "latitude_deg": FRAME.latitude_deg,
        "longitude_deg": FRAME.longitude_deg,
        "altitude_amsl_m": FRAME.altitude_amsl_m,
    }
    wide_m = radius_m(count)
    raw = {
        "show_frame": origin,
        "links": links,
        "formation": {"radius_m": wide_m, "height_m": wide_m + 10.0},
        "tick_rate_hz": rate_hz,
        "control": {"safety": {"fence": {"height_max_m": 300.0}}},
        "api": {"port": 0},
    }
    return parse(yaml.safe_dump(raw), "bench")


@contextlib.contextmanager
def traffic(count: int) -> Iterator[None]:
    """Vehicles on their sphere, until the block ends."""
    wide_m = radius_m(count)
    shape = [FIRST_PORT, max(1, count // EACH), min(EACH, count), wide_m, wide_m + 10.0]
    script = str(Path(__file__).with_name("link_traffic.py"))
    process = subprocess.Popen([sys.executable, script, *map(str, shape)])
    try:
        yield
    finally:
        process.terminate()
        process.wait(30)


class Passage:
    """How long it takes from a position's arrival until a setpoint made with it has left."""

    def __init__(self, link: DirectLink) -> None:
        self.waits_s: list[Array] = []
        self.positions = 0
        self._link = link
        self._seen_s: Array | None = None
        self._snapshot, self._send = link.snapshot, link.send
        link.snapshot, link.send = self.snapshot, self.send  # type: ignore[method-assign]
        self._telemetry: Telemetry | None = None

    def snapshot(self) -> Telemetry:
        """As the link's."""
        self._telemetry = self._snapshot()
        return self._telemetry

    def send(self, setpoints: Setpoints) -> None:
        """As the link's; then note what was new."""
        self._send(setpoints)
        if self._telemetry is None:
            return
        arrived_s, left_s = self._telemetry.position_time_s, self._link._sent.newest_s
        if self._seen_s is not None:
            new = (arrived_s > self._seen_s) & (left_s > arrived_s)
            self.waits_s.append((left_s - arrived_s)[new])
        self._seen_s = arrived_s

    def restart(self) -> None:
        """Forget what was before."""
        self.waits_s = []
        self.positions = int(self._link._heard.positions.sum())

    def received(self) -> int:
        """Positions since."""
        return int(self._link._heard.positions.sum()) - self.positions


def resident_mb() -> float:
    """The most this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def cost_of(began_cpu_s: float, began_s: float, setpoints: int, passages: list[Passage], count: int) -> Cost:
    """Since the beginning of a measurement."""
    wall_s = time.monotonic() - began_s
    waits_s = np.concatenate([np.concatenate(passage.waits_s) for passage in passages])
    received = sum(passage.received() for passage in passages)
    return Cost(
        100 * (time.process_time() - began_cpu_s) / wall_s,
        resident_mb(),
        setpoints / wall_s,
        float(np.percentile(waits_s, 99)) * 1e3,
        missing_percent=100 * (1 - received / (count * 10.0 * wall_s)),
    )


async def service(count: int, rate_hz: float) -> Cost:
    """The whole service with a formation in the air: law, safety, setpoints. Nobody asks the API."""
    config = config_of(count, rate_hz)
    links = [make_link(settings, config) for settings in config.links]
    passages = [Passage(link) for link in links if isinstance(link, DirectLink)]
    orchestrator = Orchestrator(config, links)
    flight = orchestrator._flight
    running = asyncio.create_task(orchestrator.run())
    while not all(mode is Mode.OFFBOARD for link in links for mode in link.snapshot().mode):  # noqa: ASYNC110
        await asyncio.sleep(0.1)
    for vehicle in flight.vehicles.values():
        vehicle.phase, vehicle.modes = Phase.FORMATION, frozenset({Mode.OFFBOARD})
        vehicle.home_m = flight.position_m(vehicle).copy()
    flight.memory = Memory.fresh(count, asyncio.get_running_loop().time())
    flight.show = ShowPhase.RUNNING
    await asyncio.sleep(WARM_UP_S)
    clock = orchestrator._clock
    clock._duration_s.clear()
    clock._lateness_s.clear()
    for passage in passages:
        passage.restart()
    began_s, began_cpu_s = time.monotonic(), time.process_time()
    before = sum(link.setpoints_sent for link in links)
    await asyncio.sleep(MEASURED_S)
    sent = sum(link.setpoints_sent for link in links) - before
    cost = cost_of(began_cpu_s, began_s, sent, passages, count)
    in_formation = sum(vehicle.phase is Phase.FORMATION for vehicle in flight.vehicles.values())
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running
    if in_formation < count:
        print(f"only {in_formation} of {count} are still in formation", file=sys.stderr)
    return Cost(
        cost.core_percent,
        cost.resident_mb,
        cost.per_s,
        cost.passed_on_p99_ms,
        float(np.percentile(np.array(clock._duration_s), 99)) * 1e3,
        float(np.percentile(np.array(clock._lateness_s), 99)) * 1e3,
        cost.missing_percent,
    )


async def direct(count: int, rate_hz: float) -> Cost:
    """The links alone: telemetry to one batch, a batch to setpoints, nothing between."""
    config = config_of(count, rate_hz)
    links = [link for settings in config.links if isinstance(link := make_link(settings, config), DirectLink)]
    passages = [Passage(link) for link in links]
    running = [asyncio.create_task(link.run()) for link in links]
    still = np.zeros((EACH, 3))

    async def ticks(duration_s: float) -> None:
        start_s, tick = time.monotonic(), 0
        while time.monotonic() < start_s + duration_s:
            for link in links:
                link.snapshot()
                n = len(link.ids)
                link.send(Setpoints(time.monotonic(), link.ids, still[:n], still[:n, 0].copy()))
            tick += 1
            await asyncio.sleep(start_s + tick / rate_hz - time.monotonic())

    await ticks(WARM_UP_S)
    for passage in passages:
        passage.restart()
    began_s, began_cpu_s = time.monotonic(), time.process_time()
    before = sum(link.setpoints_sent for link in links)
    await ticks(MEASURED_S)
    cost = cost_of(began_cpu_s, began_s, sum(link.setpoints_sent for link in links) - before, passages, count)
    for task in running:
        task.cancel()
    await asyncio.gather(*running, return_exceptions=True)
    return cost


def read_all(
    source: socket.socket, parser: Any, places: dict[tuple[int, int], tuple[float, float, float, float]]
) -> tuple[str, int] | tuple[()]:
    """Everything that waits in a socket, message by message. Returns: the last sender's address."""
    address: tuple[str, int] | tuple[()] = ()
    with contextlib.suppress(BlockingIOError):
        while True:
            data, address = source.recvfrom(2048)
            for message in parser.parse_buffer(data) or ():
                if message.get_type() == "GLOBAL_POSITION_INT":
                    here = message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3
                    places[source.fileno(), message.get_srcSystem()] = (time.monotonic(), *here)
    return address


def per_message(count: int, rate_hz: float) -> Cost:
    """The same with pymavlink, one message at a time on plain sockets."""
    sockets = []
    for index in range(max(1, count // EACH)):
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        made.bind((HOST, FIRST_PORT + index))
        made.setblocking(False)
        sockets.append(made)
    packer, parser = dialect.MAVLink(None, 254, 190), dialect.MAVLink(None)
    places: dict[tuple[int, int], tuple[float, float, float, float]] = {}
    addresses: list[tuple[str, int] | tuple[()]] = [()] * len(sockets)
    sent, began_s, began_cpu_s, began_sent, start_s, tick = 0, 0.0, 0.0, 0, time.monotonic(), 0
    while time.monotonic() < start_s + WARM_UP_S + MEASURED_S:
        if not began_s and time.monotonic() > start_s + WARM_UP_S:
            began_s, began_cpu_s, began_sent = time.monotonic(), time.process_time(), sent
        for index, made in enumerate(sockets):
            addresses[index] = read_all(made, parser, places) or addresses[index]
            if not addresses[index]:
                continue
            for system_id in range(1, min(EACH, count) + 1):
                message = dialect.MAVLink_set_position_target_local_ned_message(
                    0, system_id, 1, 1, 0x9C7, 0, 0, 0, 0.1, 0.2, 0.3, 0, 0, 0, 0.4, 0
                )
                made.sendto(message.pack(packer), addresses[index])
                sent += 1
        tick += 1
        time.sleep(max(0.0, start_s + tick / rate_hz - time.monotonic()))
    wall_s = time.monotonic() - began_s
    for made in sockets:
        made.close()
    return Cost(
        100 * (time.process_time() - began_cpu_s) / wall_s, resident_mb(), (sent - began_sent) / wall_s
    )


ROWS = (
    ("direct", 250, 20.0),
    ("pymavlink", 250, 20.0),
    ("direct", 1000, 20.0),
    ("pymavlink", 1000, 20.0),
    ("service", 250, 20.0),
    ("service", 250, 50.0),
    ("service", 1000, 20.0),
)
TITLES = {
    "direct": "direct link alone",
    "pymavlink": "pymavlink per message, alone",
    "service": "service over direct",
}


def one(what: str, count: int, rate_hz: float) -> None:
    """Measure one row and print it."""
    with traffic(count):
        if what == "pymavlink":
            cost = per_message(count, rate_hz)
        else:
            cost = asyncio.run((service if what == "service" else direct)(count, rate_hz))
    figures = f"{cost.core_percent:>9.1f}{cost.resident_mb:>8.0f}{cost.per_s:>10.0f}"
    times = f"{cost.passed_on_p99_ms:>12.1f}{cost.tick_p99_ms:>9.1f}{cost.late_p99_ms:>9.1f}"
    print(
        f"{TITLES[what]:<30}{count:>6}{rate_hz:>5.0f}{figures}{times}{cost.missing_percent:>9.2f}", flush=True
    )


def main(wanted: list[str]) -> None:
    """Print the table, each row measured in a process of its own."""
    if len(wanted) >= 2:
        one(wanted[0], int(wanted[1]), float((*wanted, "20")[2]))
        return
    columns = (
        f"{'% core':>9}{'MB':>8}{'sent/s':>10}{'passed p99':>12}{'tick p99':>9}{'late p99':>9}{'lost %':>9}"
    )
    print(f"{'what':<30}{'N':>6}{'Hz':>5}{columns}")
    for what, count, rate_hz in ROWS:
        if not wanted or what in wanted:
            subprocess.run([sys.executable, __file__, what, str(count), str(rate_hz)], check=True)


if __name__ == "__main__":
    main(sys.argv[1:])
