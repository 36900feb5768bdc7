"""`python -m tests.bench.bus`: states between four processes over the bus, beside plain UDP datagrams.

Four stations on loopback publish a batch each, 20 times a second, with their time of making. One way: from
there until the receiver, which looks once a millisecond, holds it. Then one is killed, and one is stopped.
Each process has the priority of `gcs serve`; `--usual` leaves it as it is.
"""

import argparse
import asyncio
import os
import signal
import socket
import struct
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from multiprocessing import Pipe, Process, get_context
from multiprocessing.connection import Connection
from pathlib import Path

from gcs.bus.interface import Accepts, Bus, BusCounters, Received, anything
from gcs.bus.keys import make_site_keys
from gcs.bus.settings import Endpoint
from gcs.bus.zenoh_bus import ZenohBus
from gcs.cli.service.scheduling import PriorityRequest, ask
from gcs.links.intake import Intake
from tests.support.machine import free_ports

STATIONS, RATE_HZ, LOOK_S = 4, 20.0, 0.001
ROW_BYTES = 34
HEAD = struct.Struct("<dI")  # time of making, number


class DatagramBus:
    """One UDP datagram for each message and receiver; only for this comparison."""

    def __init__(self, station: str, endpoints: dict[str, Endpoint]) -> None:
        self.station, self.counters = station, BusCounters()
        self.accepts: Accepts = anything
        self.intakes: Sequence[Intake] = ()
        self._to = [(one.host, one.port) for name, one in endpoints.items() if name != station]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_000_000)
        self._socket.bind((endpoints[station].host, endpoints[station].port))
        self._socket.setblocking(False)

    async def run(self) -> None:
        await asyncio.Event().wait()

    def publish(self, messages: Mapping[str, bytes]) -> None:
        for payload in messages.values():
            for address in self._to:
                self._socket.sendto(payload, address)

    def newest(self) -> list[Received]:
        return list(self._received())

    def _received(self) -> Iterator[Received]:
        while True:
            try:
                payload, address = self._socket.recvfrom(65535)
            except BlockingIOError:
                return
            yield Received(str(address[1]), "states", payload, time.monotonic())

    @property
    def present(self) -> frozenset[str]:
        return frozenset()


def _make(kind: str, station: str, endpoints: dict[str, Endpoint], keys: Path) -> Bus:
    if kind == "udp":
        return DatagramBus(station, endpoints)
    tls = keys if kind == "zenoh, TLS" else None
    return ZenohBus(station, endpoints, keys=tls, now_s=time.monotonic)


async def _fly(bus: Bus, rows: int, seconds: float, out: Connection) -> None:
    running = asyncio.create_task(bus.run())
    await asyncio.sleep(3.0)
    gone_s: dict[str, float] = {}
    took_s, before = [], bus.present
    numbers: dict[str, list[int]] = {}
    began_s, cpu_s = time.monotonic(), time.process_time()
    due_s = began_s
    sent = 0
    while (now_s := time.monotonic()) < began_s + seconds:
        if now_s >= due_s:
            due_s += 1.0 / RATE_HZ
            sent += 1
            bus.publish({"states": HEAD.pack(time.monotonic(), sent) + bytes(rows * ROW_BYTES)})
        for one in bus.newest():
            made_s, number = HEAD.unpack_from(one.payload)
            took_s.append(time.monotonic() - made_s)
            numbers.setdefault(one.sender, []).append(number)
        for name in before - bus.present:
            gone_s.setdefault(name, time.monotonic())
        await asyncio.sleep(LOOK_S)
    lost = sum(max(each) - min(each) + 1 - len(each) for each in numbers.values())
    out.send((took_s, lost, (time.process_time() - cpu_s) / seconds, gone_s))
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


def _station(
    kind: str,
    station: str,
    endpoints: dict[str, Endpoint],
    keys: Path,
    priority: PriorityRequest,
    rows: int,
    s: float,
    out: Connection,
) -> None:
    ask(priority)
    asyncio.run(_fly(_make(kind, station, endpoints, keys), rows, s, out))


def measure(
    kind: str, vehicles: int, seconds: float, port: int, keys: Path, priority: PriorityRequest
) -> str:
    """One row. `keys`: a folder in which none exist yet."""
    names = [f"s{number}" for number in range(STATIONS)]
    endpoints = {name: Endpoint(host="127.0.0.1", port=port + k) for k, name in enumerate(names)}
    make_site_keys(keys, {name: ["127.0.0.1"] for name in names})
    pipes, processes = [], []
    for name in names:
        ours, theirs = Pipe()
        rows = vehicles // STATIONS
        process: Process = get_context("spawn").Process(  # type: ignore[assignment]
            target=_station, args=(kind, name, endpoints, keys, priority, rows, seconds, theirs)
        )
        process.start()
        pipes.append(ours)
        processes.append(process)
    time.sleep(3.0 + 0.7 * seconds)
    noticed = ""
    killed_s = time.monotonic()
    os.kill(processes[3].pid or 0, signal.SIGKILL)
    time.sleep(0.1 * seconds)
    stopped_s = time.monotonic()
    os.kill(processes[2].pid or 0, signal.SIGSTOP)
    found = [pipe.recv() for pipe in pipes[:2]]
    os.kill(processes[2].pid or 0, signal.SIGKILL)
    for process in processes:
        process.join()
    if kind != "udp":
        gone = [gone_s for *_, gone_s in found]
        kills = [1e3 * (one["s3"] - killed_s) for one in gone if "s3" in one]
        stops = [1e3 * (one["s2"] - stopped_s) for one in gone if "s2" in one]
        noticed = f"  killed {max(kills, default=-1):.0f} ms  stopped {max(stops, default=-1):.0f} ms"
    took_ms = sorted(1e3 * one for each in found for one in each[0])
    lost = sum(each[1] for each in found)
    p50, p99 = took_ms[len(took_ms) // 2], took_ms[int(0.99 * len(took_ms))]
    cpu = 100.0 * max(each[2] for each in found)
    return (
        f"{kind:<10} {vehicles:>6} vehicles  p50 {p50:.2f}  p99 {p99:.2f}  p99.9"
        f" {took_ms[int(0.999 * len(took_ms))]:.2f}  worst {took_ms[-1]:.2f} ms"
        f"  received {len(took_ms)}, missed {lost}  CPU {cpu:.1f} %{noticed}"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--usual", action="store_true")
    arguments = parser.parse_args()
    priority: PriorityRequest = "usual" if arguments.usual else "real-time"
    port = free_ports(6 * STATIONS * arguments.rounds)
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(arguments.rounds):
            for vehicles in (1000, 5000):
                for kind in ("zenoh", "zenoh, TLS", "udp"):
                    keys = Path(folder) / str(port)
                    load = f"load {os.getloadavg()[0]:.1f}"
                    row = measure(kind, vehicles, arguments.seconds, port, keys, priority)
                    print(f"{row}  {load}", flush=True)
                    port += STATIONS
    return 0


if __name__ == "__main__":
    sys.exit(main())
