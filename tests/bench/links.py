"""What links and the service cost, in percent of one core, with what it must not exceed and what others cost.

`make bench` prints it; `python tests/bench/links.py service direct 1000` measures one row. The vehicles are
`link_traffic`, in a process of their own; only the process that flies them is measured.
"""

import asyncio
import contextlib
import logging
import resource
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from link_traffic import FRAME, HOST
from mavsdk_plainly import sent_with_subscriptions, sent_with_wrappers
from pymavlink.dialects.v20 import common as dialect

from gcs.cli.serve import make_link
from gcs.config import Config, parse
from gcs.control import Memory
from gcs.lifecycle import Phase, ShowPhase
from gcs.links import Link
from gcs.links.direct.link import DirectLink
from gcs.links.mavlink_frames import GLOBAL_POSITION_INT
from gcs.links.mavsdk_link import MavsdkLink
from gcs.orchestrator import Orchestrator
from gcs.state import Array, Mode, Setpoints, Telemetry

AnyLink = DirectLink | MavsdkLink

FIRST_PORT = 15400
EACH = 250
WARM_UP_S, MEASURED_S = 8.0, 15.0
MEETING_S = 10.0  # for MAVSDK alone to find its vehicles


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


def config_of(count: int, rate_hz: float, transport: str = "direct") -> Config:
    """So many vehicles, 250 to a port."""
    links = [
        {
            "name": f"n{index}",
            "transport": transport,
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
def traffic(count: int, *options: str) -> Iterator[None]:
    """Vehicles on their sphere, until the block ends."""
    wide_m = radius_m(count)
    shape = [FIRST_PORT, max(1, count // EACH), min(EACH, count), wide_m, wide_m + 10.0]
    script = str(Path(__file__).with_name("link_traffic.py"))
    process = subprocess.Popen([sys.executable, script, *map(str, shape), *options])
    try:
        yield
    finally:
        process.terminate()
        process.wait(30)


class Passage:
    """How long it takes from a position's arrival until a setpoint made with it has left."""

    def __init__(self, link: AnyLink) -> None:
        self.waits_s: list[Array] = []
        self.positions = 0
        self._link = link
        self._used_s = np.full(len(link.ids), -np.inf)  # arrival of the positions that setpoints were made of
        self._open: tuple[float, Array] | None = (
            None  # when they were read, and the arrivals, of the last tick
        )
        self._snapshot = link.snapshot
        link.snapshot = self.snapshot  # type: ignore[method-assign]

    def snapshot(self) -> Telemetry:
        """As the link's. What was read the last time has left by now, or has not left at all."""
        if self._open is not None:
            self._note(*self._open)
        read_s = time.monotonic()
        telemetry = self._snapshot()
        self._open = read_s, telemetry.position_time_s
        return telemetry

    def _note(self, read_s: float, arrived_s: Array) -> None:
        left_s = self._left_s()
        new = np.isfinite(self._used_s) & (arrived_s > self._used_s) & (left_s >= read_s)
        self.waits_s.append(left_s[new] - arrived_s[new])
        self._used_s = np.where((left_s >= read_s) | ~np.isfinite(self._used_s), arrived_s, self._used_s)

    def _left_s(self) -> Array:
        """(n,) when the newest setpoint left, as the link's own records say."""
        link = self._link
        if isinstance(link, DirectLink):
            return link._sent.newest_s.copy()
        times_s = [record[-1] if record else -np.inf for record in link._wire._sent_s.values()]
        return np.array(times_s)

    def restart(self) -> None:
        """Forget what was before."""
        self.waits_s = []
        self.positions = self._heard()

    def received(self) -> int:
        """Positions since."""
        return self._heard() - self.positions

    def _heard(self) -> int:
        link = self._link
        if isinstance(link, DirectLink):
            return int(link._heard.positions.sum())
        return sum(heard.counts[GLOBAL_POSITION_INT] for heard in link._wire.heard.values())


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
        float(np.percentile(waits_s, 99)) * 1e3 if len(waits_s) else nan,
        missing_percent=100 * (1 - received / (count * 10.0 * wall_s)),
    )


async def service(count: int, rate_hz: float, transport: str, missing: int = 0) -> Cost:
    """The whole service with a formation in the air: law, safety, setpoints. Nobody asks the API.

    `missing` vehicles are never heard; the figures are those of the others.
    """
    config = config_of(count, rate_hz, transport)
    links = [make_link(settings, config) for settings in config.links]
    passages = [Passage(link) for link in links if isinstance(link, DirectLink | MavsdkLink)]
    orchestrator = Orchestrator(config, links)
    flight = orchestrator._flight
    running = asyncio.create_task(orchestrator.run())
    here = await met(links, count - missing)
    for vehicle in flight.vehicles.values():
        if vehicle.id not in here:
            continue
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
    cost = cost_of(began_cpu_s, began_s, sent, passages, count - missing)
    in_formation = sum(vehicle.phase is Phase.FORMATION for vehicle in flight.vehicles.values())
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running
    if in_formation < count - missing:
        print(f"only {in_formation} of {count - missing} are still in formation", file=sys.stderr)
    return Cost(
        cost.core_percent,
        cost.resident_mb,
        cost.per_s,
        cost.passed_on_p99_ms,
        float(np.percentile(np.array(clock._duration_s), 99)) * 1e3,
        float(np.percentile(np.array(clock._lateness_s), 99)) * 1e3,
        cost.missing_percent,
    )


async def met(links: Sequence[Link], count: int) -> frozenset[str]:
    """Until so many fly in OFFBOARD with a position. Returns: who."""
    while True:
        told = [link.snapshot() for link in links]
        here = frozenset(
            name
            for each in told
            for name, mode, latitude_deg in zip(each.ids, each.mode, each.latitude_deg.tolist(), strict=True)
            if mode is Mode.OFFBOARD and isfinite(latitude_deg)
        )
        if len(here) >= count:
            return here
        await asyncio.sleep(0.1)


async def connecting_s(count: int, transport: str) -> float:
    """The longest time from a vehicle's first heartbeat until it has a position and could be ordered."""
    config = config_of(count, 20.0, transport)
    links = [make_link(settings, config) for settings in config.links]
    running = [asyncio.create_task(link.run()) for link in links]
    await asyncio.sleep(2.0)
    first_s: dict[str, float] = {}
    took_s: dict[str, float] = {}
    with traffic(count):
        while len(took_s) < count:
            await asyncio.sleep(0.02)
            for told in (link.snapshot() for link in links):
                places_deg, beats_s = told.latitude_deg.tolist(), told.heartbeat_time_s.tolist()
                for name, place_deg, beat_s in zip(told.ids, places_deg, beats_s, strict=True):
                    if isfinite(beat_s) and isfinite(place_deg) and name not in took_s:
                        took_s[name] = time.monotonic() - first_s.setdefault(name, beat_s)
                    elif isfinite(beat_s):
                        first_s.setdefault(name, beat_s)
    for task in running:
        task.cancel()
    await asyncio.gather(*running, return_exceptions=True)
    return max(took_s.values())


def plainly(count: int, rate_hz: float, *, wrapped: bool) -> Cost:
    """MAVSDK without us: one instance, one port for each vehicle, subscriptions."""
    start_s = time.monotonic()
    marks: list[tuple[float, float]] = []

    def began() -> bool:
        if not marks and time.monotonic() > start_s + MEETING_S + WARM_UP_S:
            marks.append((time.monotonic(), time.process_time()))
        return bool(marks)

    def ended() -> bool:
        return bool(marks) and time.monotonic() > marks[0][0] + MEASURED_S

    given = HOST, FIRST_PORT, count, rate_hz, began, ended
    sent = asyncio.run(sent_with_wrappers(*given)) if wrapped else sent_with_subscriptions(*given)
    wall_s = time.monotonic() - marks[0][0]
    return Cost(100 * (time.process_time() - marks[0][1]) / wall_s, resident_mb(), sent / wall_s)


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


MUST = {  # what, vehicles, Hz, transport: % of a core, MB
    ("service", "mavsdk", 64, 20.0): "<= 15 %",
    ("service", "mavsdk", 250, 20.0): "<= 40 %",
    ("service", "direct", 1000, 20.0): "<= 45 %, 250 MB, nothing lost, tick 25 ms, late 10 ms",
    ("service", "direct", 250, 50.0): "<= 25 %",
}
"""Beside this: passed on within one tick period and 3 ms, connected within 3 s."""

ROWS = (
    ("service", "mavsdk", 64, 20.0),
    ("plainly", "mavsdk", 64, 20.0),
    ("wrapped", "mavsdk", 64, 20.0),
    ("service", "mavsdk", 250, 20.0),
    ("plainly", "mavsdk", 250, 20.0),
    ("wrapped", "mavsdk", 250, 20.0),
    ("service", "direct", 1000, 20.0),
    ("direct", "direct", 1000, 20.0),
    ("pymavlink", "direct", 1000, 20.0),
    ("service", "direct", 250, 50.0),
    ("pymavlink", "direct", 250, 50.0),
    ("service", "direct", 250, 20.0),
    ("silent", "direct", 250, 20.0),
    ("garbage", "direct", 250, 20.0),
    ("service", "mavsdk", 250, 20.0),
    ("silent", "mavsdk", 250, 20.0),
    ("garbage", "mavsdk", 250, 20.0),
    ("connect", "direct", 250, 20.0),
    ("connect", "mavsdk", 250, 20.0),
)
TITLES = {
    "service": "the service over {}",
    "silent": "  with 5 % silent",
    "garbage": "  with 5 % that send garbage",
    "direct": "  its link alone",
    "pymavlink": "  pymavlink per message, alone",
    "plainly": "  one instance, subscriptions",
    "wrapped": "  its asyncio wrappers",
    "connect": "connecting, {}: the slowest",
}
BROKEN_SHARE = 0.05


def measured(what: str, transport: str, count: int, rate_hz: float) -> Cost:
    """One row."""
    broken = round(BROKEN_SHARE * count)
    if what in {"plainly", "wrapped"}:
        with traffic(count, "--own-ports"):
            return plainly(count, rate_hz, wrapped=what == "wrapped")
    if what in {"silent", "garbage"}:
        with traffic(count, f"--{what}", str(broken)):
            return asyncio.run(service(count, rate_hz, transport, broken))
    with traffic(count):
        if what == "pymavlink":
            return per_message(count, rate_hz)
        return asyncio.run(
            service(count, rate_hz, transport) if what == "service" else direct(count, rate_hz)
        )


def one(what: str, transport: str, count: int, rate_hz: float) -> None:
    """Measure one row and print it."""
    title = f"{TITLES[what].format(transport):<32}{count:>6}{rate_hz:>5.0f}"
    if what == "connect":
        print(f"{title}{asyncio.run(connecting_s(count, transport)):>9.2f} s   must: <= 3 s", flush=True)
        return
    cost = measured(what, transport, count, rate_hz)
    figures = f"{cost.core_percent:>9.1f}{cost.resident_mb:>8.0f}{cost.per_s:>10.0f}"
    times = f"{cost.passed_on_p99_ms:>12.1f}{cost.tick_p99_ms:>9.1f}{cost.late_p99_ms:>9.1f}"
    must = MUST.get((what, transport, count, rate_hz))
    wanted = "" if must is None else f"   must: {must}; passed {1e3 / rate_hz + 3:.0f} ms"
    print(f"{title}{figures}{times}{cost.missing_percent:>9.2f}{wanted}", flush=True)


def main(wanted: list[str]) -> None:
    """Print the table, each row measured in a process of its own."""
    if len(wanted) >= 3:
        logging.disable(logging.WARNING)  # a thousand vehicles found in the air say so
        one(wanted[0], wanted[1], int(wanted[2]), float((*wanted, "20")[3]))
        return
    columns = (
        f"{'% core':>9}{'MB':>8}{'sent/s':>10}{'passed p99':>12}{'tick p99':>9}{'late p99':>9}{'lost %':>9}"
    )
    print(f"{'what':<32}{'N':>6}{'Hz':>5}{columns}")
    for what, transport, count, rate_hz in ROWS:
        if not wanted or wanted[0] in (what, transport):
            row = [what, transport, str(count), str(rate_hz)]
            subprocess.run([sys.executable, __file__, *row], check=True)


if __name__ == "__main__":
    main(sys.argv[1:])
