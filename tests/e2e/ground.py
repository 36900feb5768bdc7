"""What the end-to-end tests stand on: fake vehicles in processes of their own, and the service over them."""

import asyncio
import json
import random
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from gcs import config as configuration

ORIGIN = "47.397742,8.545594,488.0"


def free_ports(count: int) -> int:
    """The first of `count` consecutive UDP ports that are free now."""
    start = random.SystemRandom().randrange(20000, 60000)  # tests beside this one look for ports too
    for first in range(start, start + 5000, count):
        with ExitStack() as stack:
            try:
                for port in range(first, first + count):
                    stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)).bind(
                        ("127.0.0.1", port)
                    )
            except OSError:
                continue
            return first
    raise OSError("no free ports")


def flying_config(count: int, port_base: int, **formation: float) -> configuration.Config:
    """The demo's configuration for `count` vehicles, with a free API port."""
    raw = configuration.load(configuration.find("demo")).model_dump()
    raw["links"][0].update(listen=f"udpin://127.0.0.1:{port_base}", ports=count)
    raw["links"][0]["vehicles"]["count"] = count
    raw["api"]["port"] = 0
    raw["operation"]["takeoff_stagger_s"] = 0.2
    raw["formation"] |= formation
    return configuration.Config.model_validate(raw)


@contextmanager
def vehicles(
    count: int, port_base: int, truth: Path, *options: str
) -> Iterator[list[subprocess.Popen[bytes]]]:
    """One fake vehicle a process, true states in `truth`/0.jsonl and so on; ended with the block."""
    command = [sys.executable, "-m", "sim", "--count", "1", "--port-base", str(port_base)]
    command += ["--origin", ORIGIN, "--grid-columns", "3", *options]
    children = [
        subprocess.Popen(
            [*command, "--first", str(i), "--truth", str(truth / f"{i}.jsonl")], stdout=subprocess.DEVNULL
        )
        for i in range(count)
    ]
    try:
        yield children
    finally:
        for child in children:
            child.terminate()
        for child in children:
            child.wait(10)


def last_truth(path: Path) -> dict[str, object]:
    """The newest whole sample of one vehicle's truth file."""
    lines = path.read_text(encoding="utf-8").splitlines()
    for line in reversed(lines):
        try:
            sample = json.loads(line)
        except json.JSONDecodeError:
            continue
        vehicle: dict[str, object] = sample["vehicles"][0]
        return vehicle
    return {}


def wait_until(what: str, seconds: float, reached: Callable[[], bool]) -> None:
    """Poll; fails the test when it takes too long."""
    end_s = time.monotonic() + seconds
    while not reached():
        assert time.monotonic() < end_s, f"{what}: not within {seconds:g} s"
        time.sleep(0.1)


async def until(what: str, seconds: float, reached: Callable[[], bool]) -> None:
    """The same on an event loop."""
    end_s = time.monotonic() + seconds
    while not reached():
        assert time.monotonic() < end_s, f"{what}: not within {seconds:g} s"
        await asyncio.sleep(0.05)


def rate_hz(times_s: Sequence[float], start_s: float, end_s: float) -> float:
    """How many of the times fall in the window, per second."""
    return sum(start_s <= time_s < end_s for time_s in times_s) / (end_s - start_s)
