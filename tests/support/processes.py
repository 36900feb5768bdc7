"""Fixtures of the end-to-end tests: fake vehicles in separate processes and the service over them.

The machine may pause for a second or two at any time, and be slow for longer. Waits are therefore long, and
flights that do not test the loss of setpoints use `PATIENT_S`.
"""

import asyncio
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from math import ceil, sqrt
from pathlib import Path

import numpy as np
import yaml

from gcs.api.app import create_app
from gcs.api.server import serve as serve_api
from gcs.client import Client
from gcs.config import schema as configuration
from gcs.flight.orchestrator import Orchestrator
from gcs.model.errors import GcsError
from gcs.model.preflight_report import Check, describe
from gcs.planning.feasibility import smallest_formation_radius_m
from gcs.preflight.parameters import settings_of
from gcs.service import ShowAction
from gcs.sim.cli import parameter_options
from gcs.sim.settings import PAD_SPACING_M
from gcs.testing.views import vehicles_of
from tests.support.machine import free_ports
from tests.support.started import DEVNULL, PIPE, Started, run

ORIGIN = "47.397742,8.545594,488.0"

SOON_S = 120.0
"""For whatever takes a few seconds."""

PATIENT_S = 5.0
"""PX4 takes a second without setpoints for the loss of its ground station; these take five."""


REPORTED_M = 0.225
"""What the accuracy of the fake vehicles counts as."""

READY_AT_ONCE = ("--quirk", "late-ready=off")
AT_ONCE = (
    *READY_AT_ONCE,
    *("--param", "COM_DISARM_LAND=0.5", "--param", "LNDMC_TRIG_TIME=0.25"),
)
"""Fake vehicles with these options save 10 s of each flight from boot to disarming."""


def proper(config: configuration.Config) -> tuple[str, ...]:
    """Options of fake vehicles with the parameters that `config` requires."""
    return tuple(parameter_options(settings_of(config)))


def flying_config(
    count: int, port_base: int, *, silence_s: float, **operation: object
) -> configuration.Config:
    """The demo's configuration for `count` vehicles, with a free API port and long time limits.

    Its formation is small and low, which saves half of a flight: 20 s with three vehicles.
    """
    raw = configuration.load(configuration.find("demo")).model_dump()
    raw["links"][0].update(listen=f"udpin://127.0.0.1:{port_base}", ports=count)
    raw["links"][0]["vehicles"]["count"] = count
    raw["api"]["port"] = 0
    radius_m = max(5.0, min(count + 0.5, 40.0))  # 50 also fit inside the fence
    raw["formation"] = {"radius_m": radius_m, "height_m": radius_m + 4.0}
    raw["operation"] |= {"takeoff_height_m": 3.0, "takeoff_stagger_s": 0.2}
    raw["operation"] |= {"silence_s": silence_s, "setpoint_loss_s": PATIENT_S, **operation}
    for cause in ("service_late", "links_late", "wind"):  # a busy machine is late, which ends no flight here
        raw["failsafes"][cause]["action"] = "ignore"
    raw["scheduling"] = "usual"  # several services share the machine of a test run
    return configuration.Config.model_validate(raw)


def close_together(config: configuration.Config) -> tuple[configuration.Config, tuple[str, ...]]:
    """The same with as small a formation as its vehicles may have, above pads in a square.

    Returns: it, and options of the vehicles. Pads in three columns are outside the fence from 31 vehicles on.
    """
    count, safety = len(config.ids), config.control.safety
    columns = ceil(sqrt(count))
    middle_m = (columns - 1) * PAD_SPACING_M / 2.0
    radius_m = max(4.0, 1.2 * smallest_formation_radius_m(count, safety, np.full(count, REPORTED_M)))
    raw = config.model_dump(mode="json")
    raw["formation"] = {"radius_m": radius_m, "height_m": radius_m + 4.0}
    raw["target"] |= {"x_m": middle_m, "y_m": middle_m}
    raw["operation"] |= {"takeoff_stagger_s": 0.2}
    return configuration.Config.model_validate(raw), ("--grid-columns", str(columns))


@contextmanager
def vehicles(
    count: int, port_base: int, truth: Path, *options: str, apart: int | None = None
) -> Iterator[Started]:
    """Run fake vehicles in a separate process until the block ends; true states are in `truth`/truth.jsonl.

    One process flies all vehicles except `apart`, whose own process is yielded and can be killed.
    The vehicles can be armed at once and are disarmed soon after landing: only the demo and the README
    session wait as PX4 does.
    """
    words = ("--port-base", str(port_base), "--origin", ORIGIN, "--grid-columns", "3")

    def started(first: int, end: int, *more: str) -> Started:
        some = (*AT_ONCE, *options, "--first", str(first), "--count", str(end - first))
        return Started("gcs.sim", *words, *some, *more, stdout=DEVNULL)

    file = ("--truth", str(truth / "truth.jsonl"))
    if apart is None:
        children = [started(0, count, *file)]
    else:
        children = [started(apart, apart + 1), started(0, apart, *file), started(apart + 1, count)]
    try:
        yield children[0]
    finally:
        for child in children:
            child.terminate()
        for child in children:
            child.wait(60)


@contextmanager
def service(config: configuration.Config, folder: Path, *options: str) -> Iterator[tuple[Client, Started]]:
    """Run `gcs serve` in a separate process; its configuration, its recording and its log are in `folder`.

    In the folder of a service that has ended, the same service starts again.
    """
    folder.mkdir(exist_ok=True)
    raw = config.model_dump(mode="json") | {"record": {"folder": str(folder)}}
    (folder / "config.yaml").write_text(yaml.safe_dump(raw), encoding="utf-8")
    words = ("serve", "--config", str(folder / "config.yaml"), "--quiet", *options)
    with (folder / "log").open("a") as log:
        process = Started("gcs", *words, stdout=PIPE, stderr=log)
    try:
        assert process.stdout is not None
        address = re.search(r"http://\S+:\d+", process.stdout.readline())
        assert address is not None, (folder / "log").read_text()
        with Client(address[0], timeout_s=30.0) as client:
            yield client, process
    finally:
        process.end()


@contextmanager
def session_of(name: str, folder: Path, *sim_options: str, height_m: float) -> Iterator[tuple[str, Started]]:
    """Run `gcs sim`, `gcs params apply` and `gcs serve` as a user does, with a configuration of the tests.

    Ports are free, time limits long, and the formation is at `height_m`. True states are in
    `folder`/truth.jsonl. Yields the API's address.
    """
    base = free_ports(10)
    text = configuration.find(name).read_text(encoding="utf-8").replace("14540", str(base))
    text = text.replace("operation:\n", f"operation:\n  setpoint_loss_s: {PATIENT_S}\n")
    text = text.replace("takeoff_stagger_s: 2.0", "takeoff_stagger_s: 0.5")
    text = re.sub(r"(formation: .*height_m: )[\d.]+", rf"\g<1>{height_m}", text)
    assert "failsafes:" not in text
    ignored = ", ".join(f"{cause}: {{action: ignore}}" for cause in ("service_late", "links_late", "wind"))
    text += f"\nfailsafes: {{{ignored}}}\n"
    config = folder / f"{name}.yaml"
    config.write_text(text, encoding="utf-8")
    sim = ("--port-base", str(base), "--origin", ORIGIN, *sim_options)
    truth = ("--truth", str(folder / "truth.jsonl"), "--param", f"COM_OF_LOSS_T={PATIENT_S}")
    vehicles = Started("gcs", "sim", *sim, *truth, stdout=DEVNULL)
    try:
        applied = run("gcs", "params", "apply", "--config", str(config), timeout_s=SOON_S)
        assert applied.returncode == 0, applied.stdout + applied.stderr
        service = Started("gcs", "serve", "--config", str(config), "--port", "0", "--quiet", stdout=PIPE)
        try:
            assert service.stdout is not None
            address = re.search(r"http://\S+:\d+", service.stdout.readline())
            assert address is not None
            yield address[0], service
        finally:
            service.end()
    finally:
        vehicles.terminate()
        vehicles.wait(SOON_S)


TRUTHS_BYTES = 1 << 20
"""At the end of a truth file: several samples of a hundred vehicles. Forty write half a megabyte a second."""


def last_truths(path: Path) -> list[dict[str, object]]:
    """The newest complete sample of a truth file, for each of its vehicles."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - TRUTHS_BYTES))
        newest = file.read().decode(errors="replace")
    for line in reversed(newest.splitlines()):
        try:
            found: list[dict[str, object]] = json.loads(line)["vehicles"]
        except json.JSONDecodeError:
            continue
        return found
    return []


def wait_until(what: str, seconds: float, reached: Callable[[], bool]) -> None:
    """Poll until the condition holds; fail the test after the time limit."""
    end_s = time.monotonic() + seconds
    while not reached():
        assert time.monotonic() < end_s, f"{what}: not within {seconds:g} s"
        time.sleep(0.05)


def wait_passes(client: Client) -> None:
    """Poll until preflight passes; fail the test after the time limit, with the checks that do not pass."""
    end_s = time.monotonic() + SOON_S
    while not (report := client.preflight.report()).passes:
        found: list[tuple[str | None, Check]] = [(None, check) for check in report.fleet]
        found += [(each.id, check) for each in report.vehicles if each.flies for check in each.checks]
        assert time.monotonic() < end_s, f"{describe(found)}; {report.not_flying}: not within {SOON_S:g} s"
        time.sleep(0.05)


async def until(what: str, seconds: float, reached: Callable[[], bool]) -> None:
    """Wait on an event loop. The condition still holds when this returns: no other task ran in between."""
    end_s = time.monotonic() + seconds
    while not reached():
        assert time.monotonic() < end_s, f"{what}: not within {seconds:g} s"
        await asyncio.sleep(0.05)


@asynccontextmanager
async def served(orchestrator: Orchestrator) -> AsyncIterator[int]:
    """Run the service with its API until the block ends, with vehicles ready and commanded to fly.

    Yields the API's port.
    """
    listening: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    tasks = [
        asyncio.create_task(orchestrator.run()),
        asyncio.create_task(serve_api(create_app(orchestrator), port=0, listening=listening)),
    ]
    view = orchestrator.view
    try:
        await until("ready", SOON_S, lambda: all(vehicle.ready for vehicle in vehicles_of(view.value)))
        orchestrator.commands.command_show(ShowAction.START)
        yield await listening
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)


class Supervised:
    """`gcs serve --supervised` on free ports; its output is in `folder`."""

    def __init__(self, config: configuration.Config, folder: Path, *options: str) -> None:
        """Start the service."""
        folder.mkdir()
        self.folder = folder
        port = free_ports(2)
        raw = config.model_dump(mode="json") | {"record": {"folder": str(folder), "frames": False}}
        raw["api"] = {"port": port}
        (folder / "config.yaml").write_text(yaml.safe_dump(raw), encoding="utf-8")
        self.url, self.lane = f"http://127.0.0.1:{port}", f"http://127.0.0.1:{port + 1}"
        command = [sys.executable, "-m", "gcs", "serve", "--config", str(folder / "config.yaml"), "--quiet"]
        with (folder / "log").open("w") as log:
            self.parent = subprocess.Popen(
                [*command, "--supervised", *options], stdout=subprocess.DEVNULL, stderr=log
            )

    def logged(self, event: str) -> list[dict[str, object]]:
        """Every complete line of the log with that event."""
        lines = (self.folder / "log").read_text(encoding="utf-8").splitlines()
        reported = [json.loads(line) for line in lines if line.startswith("{") and line.endswith("}")]
        return [line for line in reported if line["event"] == event]

    @property
    def pid(self) -> int:
        """Process id of the service that runs now or ran last."""
        return int(str(self.logged("service_started")[-1]["pid"]))

    def answers(self) -> bool:
        """Whether the API answers and control is alive."""
        try:
            with Client(self.url, timeout_s=1.0) as client:
                return client.health().alive
        except GcsError:
            return False

    def end(self) -> None:
        """End all processes in any state."""
        self.parent.kill()
        self.parent.wait()
        for line in self.logged("service_started"):
            with suppress(ProcessLookupError):
                os.kill(int(str(line["pid"])), signal.SIGKILL)


@contextmanager
def supervised(config: configuration.Config, folder: Path) -> Iterator[Supervised]:
    """Run a supervised service until the block ends. Yields once it answers."""
    started = Supervised(config, folder)
    try:
        wait_until("answers", SOON_S, started.answers)
        yield started
    finally:
        started.end()
