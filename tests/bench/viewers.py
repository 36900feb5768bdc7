"""What five viewers cost the service, each, in percent of one core; and what one that reads nothing delays.

`make bench` prints it; `python -m tests.bench.viewers 200` measures one fleet. The service flies a formation
over the native transport in a process of its own, which alone is measured; vehicles (`link_traffic`) and
viewers have others. The alternative beside it is the stream of JSON.
"""

import asyncio
import contextlib
import json
import logging
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from websockets.asyncio.client import connect

from gcs.api.app import create_app
from gcs.api.server import serve
from gcs.cli.service.process import run_exactly
from gcs.flight.orchestrator import Orchestrator
from tests.bench.link_measures import WARM_UP_S, flying
from tests.bench.link_service import config_of, ended, in_formation, links_of, p99_ms

COUNTS = (200, 1000)
VIEWERS, RATE_HZ, TICK_HZ = 5, 10.0, 20.0
MEASURED_S, SETTLED_S = 10.0, 2.0
PERCENT_MAX = 5.0
CONSOLE, PLAIN = "/api/v1/stream/console", "/api/v1/stream"


@dataclass(frozen=True, slots=True)
class Part:
    """Of a flight, between two marks."""

    core_percent: float
    tick_p99_ms: float
    late_p99_ms: float
    late_max_ms: float


async def fly(count: int) -> None:
    """The service, until standard input ends; tells the port, and for every line what was since the last."""
    config = config_of(count, TICK_HZ)
    links = links_of(config)
    orchestrator = Orchestrator(config, links)
    listening: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    app = create_app(orchestrator)
    app.openapi()
    tasks = [
        asyncio.create_task(orchestrator.run()),
        asyncio.create_task(serve(app, port=0, listening=listening)),
    ]
    await in_formation(orchestrator, links, count)
    await asyncio.sleep(WARM_UP_S)
    print(await listening, flush=True)
    clock = orchestrator._clock
    wall_s, cpu_s = time.monotonic(), time.process_time()
    while await asyncio.to_thread(sys.stdin.readline):
        before, (wall_s, cpu_s) = (wall_s, cpu_s), (time.monotonic(), time.process_time())
        core_percent = 100 * (cpu_s - before[1]) / (wall_s - before[0])
        late_ms = 1e3 * max(clock._lateness_s, default=0.0)
        part = [core_percent, p99_ms(list(clock._duration_s)), p99_ms(list(clock._lateness_s)), late_ms]
        clock._duration_s.clear()
        clock._lateness_s.clear()
        print(json.dumps(part), flush=True)
    await ended(tasks)


async def watch(port: int, path: str) -> None:
    """Five viewers until SIGTERM; tells how many messages each read since SIGUSR1, and how many bytes."""
    messages, sizes = [0] * VIEWERS, [0] * VIEWERS
    enough, see = asyncio.Event(), asyncio.Event()

    def anew() -> None:
        messages[:] = sizes[:] = [0] * VIEWERS

    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, enough.set)
    asyncio.get_running_loop().add_signal_handler(signal.SIGUSR1, anew)

    async def one(index: int) -> None:
        url = f"ws://127.0.0.1:{port}{path}?rate_hz={RATE_HZ:g}"
        async with connect(url, max_size=None, compression=None) as stream:
            async for message in stream:
                messages[index] += isinstance(message, bytes) or path == PLAIN
                sizes[index] += len(message)
                if all(messages):
                    see.set()

    watching = [asyncio.create_task(one(index)) for index in range(VIEWERS)]
    await see.wait()
    print("all see", flush=True)
    await enough.wait()
    print(json.dumps([messages, sizes]), flush=True)
    await ended(watching)


def read_nothing(port: int) -> socket.socket:
    """A viewer that shakes hands, and then reads nothing, with little room for what it does not read."""
    viewer = socket.socket()
    viewer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    viewer.connect(("127.0.0.1", port))
    lines = [
        f"GET {CONSOLE}?rate_hz=20 HTTP/1.1",
        "Host: 127.0.0.1",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version: 13",
    ]
    viewer.sendall("\r\n".join([*lines, "", ""]).encode())
    return viewer


class Service:
    """The service's process."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self.port = int(self._line())

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    def mark(self) -> Part:
        """What was since the last mark."""
        assert self._process.stdin is not None
        self._process.stdin.write("mark\n")
        self._process.stdin.flush()
        return Part(*json.loads(self._line()))

    def measured(self) -> Part:
        """The next seconds."""
        time.sleep(SETTLED_S)
        self.mark()
        time.sleep(MEASURED_S)
        return self.mark()


def started(*arguments: object) -> subprocess.Popen[str]:
    """This file in another part."""
    command = [sys.executable, "-m", "tests.bench.viewers", *map(str, arguments)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


@contextlib.contextmanager
def serving(count: int) -> Iterator[Service]:
    """The service flies, until the block ends."""
    with flying(count), started("fly", count) as process:
        try:
            yield Service(process)
        finally:
            process.kill()


def watched(service: Service, path: str) -> tuple[Part, list[float], float]:
    """While five watch. Returns: what was, messages a second of each viewer, and kB of a message."""
    with started("watch", service.port, path) as process:
        assert process.stdout is not None
        process.stdout.readline()  # all see
        process.send_signal(signal.SIGUSR1)
        began_s = time.monotonic()
        part = service.measured()
        wall_s = time.monotonic() - began_s
        process.terminate()
        messages, sizes = json.loads(process.stdout.readline())
    rates_hz = [count / wall_s for count in messages]
    return part, rates_hz, sum(sizes) / max(sum(messages), 1) / 1e3


def row(what: str, part: Part, rates_hz: Sequence[float] = (), kilobytes: float = 0.0) -> str:
    """One line of the table."""
    seen = f"{min(rates_hz):>8.1f}{kilobytes:>8.0f}" if rates_hz else f"{'-':>8}{'-':>8}"
    late = f"{part.late_p99_ms:>10.1f}{part.late_max_ms:>10.1f}"
    return f"  {what:<36}{part.core_percent:>8.1f}{seen}{part.tick_p99_ms:>10.1f}{late}"


def tell(count: int) -> bool:
    """Measure one fleet and print it. Returns: whether what must be reached is."""
    heads = f"{'% core':>8}{'msg/s':>8}{'kB':>8}{'tick p99':>10}{'late p99':>10}{'late max':>10}"
    print(f"{f'{count} vehicles, {VIEWERS} viewers at {RATE_HZ:g} Hz (ms)':<38}{heads}")
    with serving(count) as service:
        alone = service.measured()
        print(row("no viewer", alone))
        console, rates_hz, kilobytes = watched(service, CONSOLE)
        print(row("the console's frames", console, rates_hz, kilobytes))
        with read_nothing(service.port):
            slow, slow_hz, kilobytes = watched(service, CONSOLE)
        print(row("  and one more that reads nothing", slow, slow_hz, kilobytes))
        plain, plain_hz, kilobytes = watched(service, PLAIN)
        print(row("the stream of JSON", plain, plain_hz, kilobytes))
    each, plainly = ((part.core_percent - alone.core_percent) / VIEWERS for part in (console, plain))
    good = each < PERCENT_MAX and min(slow_hz) > 0.9 * RATE_HZ
    times = plainly / max(each, 0.01)
    print(f"  each viewer {each:.2f} % of a core, of JSON {plainly:.2f} %: {times:.0f} times")
    must = f"< {PERCENT_MAX:g} % each, {RATE_HZ:g} a second beside one that reads nothing"
    print(f"    must: {must}: {'pass' if good else 'MISS'}", flush=True)
    return good


def main(desired: list[str]) -> None:
    """One part, or the table."""
    logging.disable(logging.WARNING)  # a thousand vehicles found in the air say so
    if desired[:1] == ["fly"]:
        run_exactly(fly(int(desired[1])))
    elif desired[:1] == ["watch"]:
        asyncio.run(watch(int(desired[1]), desired[2]))
    else:
        reached = [tell(count) for count in (map(int, desired) if desired else COUNTS)]
        if not all(reached):
            print("not reached: viewers")


if __name__ == "__main__":
    main(sys.argv[1:])
