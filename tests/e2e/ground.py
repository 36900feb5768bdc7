"""What the end-to-end tests stand on: fake vehicles in processes of their own, and the service over them.

The machine may stand still for a second or two at any moment, and be slow for longer: what is waited for is
waited for generously, and a flight that is not about the loss of setpoints is flown with `PATIENT_S`.
"""

import asyncio
import json
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

from api.app import create_app
from api.server import serve
from gcs import config as configuration
from gcs.orchestrator import Orchestrator
from gcs.parameters import requirements, settings_of
from gcs.service import ShowAction

ORIGIN = "47.397742,8.545594,488.0"

SOON_S = 120.0
"""For whatever takes a few seconds."""

PATIENT_S = 5.0
"""PX4 takes a second without setpoints for the loss of its ground station; these take five."""


def proper(config: configuration.Config) -> tuple[str, ...]:
    """Options of fake vehicles that have the parameters which `config` asks for."""
    values = settings_of(requirements(config.operation, config.control))
    return tuple(word for name, value in values.items() for word in ("--param", f"{name}={value:g}"))


def flying_config(
    count: int, port_base: int, *, silence_s: float, **operation: object
) -> configuration.Config:
    """The demo's configuration for `count` vehicles, with a free API port, patient with silent ones."""
    raw = configuration.load(configuration.find("demo")).model_dump()
    raw["links"][0].update(listen=f"udpin://127.0.0.1:{port_base}", ports=count)
    raw["links"][0]["vehicles"]["count"] = count
    raw["api"]["port"] = 0
    raw["operation"]["takeoff_stagger_s"] = 0.2
    raw["operation"] |= {"silence_s": silence_s, "setpoint_loss_s": PATIENT_S, **operation}
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
            child.wait(60)


def last_truths(path: Path) -> list[dict[str, object]]:
    """The newest whole sample of a truth file: each of its vehicles."""
    for line in reversed(path.read_text(encoding="utf-8").splitlines()):
        try:
            found: list[dict[str, object]] = json.loads(line)["vehicles"]
        except json.JSONDecodeError:
            continue
        return found
    return []


def wait_until(what: str, seconds: float, reached: Callable[[], bool]) -> None:
    """Poll; fails the test when it takes too long."""
    end_s = time.monotonic() + seconds
    while not reached():
        assert time.monotonic() < end_s, f"{what}: not within {seconds:g} s"
        time.sleep(0.05)


async def until(what: str, seconds: float, reached: Callable[[], bool]) -> None:
    """The same on an event loop. What was reached is so still when this returns: nothing ran in between."""
    end_s = time.monotonic() + seconds
    while not reached():
        assert time.monotonic() < end_s, f"{what}: not within {seconds:g} s"
        await asyncio.sleep(0.05)


@asynccontextmanager
async def served(orchestrator: Orchestrator) -> AsyncIterator[int]:
    """The service with its API until the block ends, begun, its vehicles ready and ordered to fly.

    Yields the API's port.
    """
    listening: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    tasks = [
        asyncio.create_task(orchestrator.run()),
        asyncio.create_task(serve(create_app(orchestrator), port=0, listening=listening)),
    ]
    view = orchestrator.view
    try:
        await until("ready", SOON_S, lambda: all(vehicle.ready for vehicle in view.value.vehicles))
        orchestrator.command_show(ShowAction.START)
        yield await listening
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
