"""A confirmed kill stops the named motors within 3 s, whatever hangs, has ended or is damaged."""

import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
import yaml

from gcs.client import Client
from gcs.config.schema import Config
from gcs.model.errors import GcsError
from tests.support.machine import Pauses, free_ports
from tests.support.processes import (
    SOON_S,
    close_together,
    flying_config,
    last_truths,
    proper,
    vehicles,
    wait_until,
)
from tests.support.started import DEVNULL, Started

pytestmark = pytest.mark.soak

STOPPED_S = 3.0
TIMES = (1, 20)
"""In each state, without a terminal and on one. More, and the bound of the time, are for `make soak`."""

STATES = (
    "control stopped",
    "API stopped",
    "both stopped",
    "control stopped between the steps",
    "service killed",
    "record damaged",
)

KILL = (sys.executable, "-m", "gcs", "kill")


def config_of(count: int, port_base: int) -> Config:
    raw = flying_config(count, port_base, silence_s=20.0, setpoint_loss_action="hold").model_dump()
    raw["links"][0]["transport"] = "native"
    raw["operation"]["takeoff_height_m"] = 5.0  # at 3 m an autopilot may end its climb below half of it
    return Config.model_validate(raw)


class Station:
    """`gcs serve` with an emergency listener whose port is known, and its files."""

    def __init__(self, folder: Path, config: Config) -> None:
        self.port = free_ports(2)
        self.file, self.record, self._log = folder / "config.yaml", folder / "runs", folder / "log"
        raw = config.model_dump(mode="json") | {"record": {"folder": str(self.record), "frames": False}}
        self.file.write_text(yaml.safe_dump(raw | {"api": {"port": self.port}}), encoding="utf-8")
        with self._log.open("w") as log:
            words = ("serve", "--config", str(self.file), "--quiet")
            self.control = Started("gcs", *words, stdout=DEVNULL, stderr=log)

    @property
    def api(self) -> int:
        """Process id of its API."""
        for entry in Path("/proc").iterdir():
            with suppress(OSError, ValueError):
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
                words = (entry / "cmdline").read_bytes()
                if parent == self.control.pid and b"gcs.cli.service.api_child" in words:
                    return int(entry.name)
        raise AssertionError("the service has no API process")

    def words(self, name: str, state: str) -> list[str]:
        """Of a kill of that vehicle."""
        url, lane = (f"http://127.0.0.1:{self.port + at}" for at in (0, 1))
        words = [name, "--url", url, "--emergency-url", lane, "--record", str(self.record)]
        return [*words, "--config", str(self.file)] if state == "record damaged" else words

    def reach(self, state: str) -> None:
        if state in {"API stopped", "both stopped"}:
            os.kill(self.api, signal.SIGSTOP)
        if state in {"control stopped", "both stopped", "control stopped between the steps"}:
            self.control.send_signal(signal.SIGSTOP)
        if state in {"service killed", "record damaged"}:
            self.control.kill()
            self.control.wait()
        if state == "record damaged":
            for file in self.record.glob("audit.sqlite*"):
                file.write_bytes(b"junk" * 4096)

    def end(self) -> None:
        self.control.send_signal(signal.SIGCONT)
        self.control.end()


@contextmanager
def flying(folder: Path, count: int) -> Iterator[Station]:
    """Vehicles in formation, with their addresses in the record."""
    base = free_ports(count)
    config, square = close_together(config_of(count, base))
    with vehicles(count, base, folder, "--telemetry-hz", "10", *square, *proper(config)):
        station = Station(folder, config)
        try:
            with Client(f"http://127.0.0.1:{station.port}", timeout_s=30.0) as client:
                wait_until("ready", SOON_S, lambda: is_ready(client))
                wait_until("started", SOON_S, lambda: has_started(client))
                wait_until("running", SOON_S, lambda: client.show().phase == "running")
            time.sleep(1.5)
            assert len(flies(folder)) == count, "all fly before the first kill"
            yield station
        finally:
            station.end()


def is_ready(client: Client) -> bool:
    with suppress(GcsError):
        return all(vehicle.ready for vehicle in client.vehicles())
    return False


def has_started(client: Client) -> bool:
    """Start. A kept connection may be closed on a slow machine, before or after the command."""
    with suppress(GcsError):
        client.start()
    return client.show().phase not in {"idle", "landed"}


def flies(folder: Path) -> list[str]:
    """Vehicles whose motors run."""
    truths = last_truths(folder / "truth.jsonl")
    return [f"d{number}" for number, truth in enumerate(truths, 1) if truth["armed"]]


def without_a_terminal(words: Sequence[str], between: Callable[[], None], look: Callable[[], None]) -> str:
    """Kill as a program does; `look` is called all the while after the confirmation."""
    first = subprocess.run(
        [*KILL, *words], capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False
    )
    code = re.search(r"--confirm ([0-9a-f]{6})", first.stdout)
    assert code is not None, first.stdout + first.stderr
    between()
    with subprocess.Popen(
        [*KILL, *words, "--confirm", code[1]],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        text=True,
    ) as second:
        look()
        return second.communicate()[0]


def on_a_terminal(words: Sequence[str], between: Callable[[], None], look: Callable[[], None]) -> str:
    """As an operator does."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.execv(sys.executable, [*KILL, *words])  # noqa: S606 (this program)
    shown, until_s, is_typed = b"", time.monotonic() + SOON_S, False
    while time.monotonic() < until_s:
        if select.select([terminal], [], [], 0.05)[0]:
            try:
                shown += os.read(terminal, 4096)
            except OSError:  # it has ended
                break
        if not is_typed and b"to kill:" in shown:
            is_typed = True
            between()
            os.write(terminal, words[0].encode() + b"\n")
            look()
    os.waitpid(pid, 0)
    os.close(terminal)
    return shown.decode()


@pytest.mark.keeps("both stopped-1")
@pytest.mark.parametrize("times", [TIMES[0], pytest.param(TIMES[1], marks=pytest.mark.soak)])
@pytest.mark.parametrize("state", STATES)
def test_confirmed_kill_stops_the_named_motors(tmp_path: Path, state: str, times: int) -> None:
    count = 2 * times + 1
    confirmed_s: list[float] = []
    stopped_s: list[float] = []
    with flying(tmp_path, count) as station, Pauses() as machine:
        names = [f"d{number}" for number in range(1, count + 1)]

        def between() -> None:
            if "between" in state:
                station.reach(state)
            confirmed_s.append(time.monotonic())

        for turn, name in enumerate(names[:-1]):

            def look(name: str = name) -> None:
                wait_until("stopped", SOON_S, lambda: name not in flies(tmp_path))
                stopped_s.append(time.monotonic())

            if "between" not in state and (turn == 0 or state == "API stopped"):
                station.reach(state)
            kill = on_a_terminal if turn % 2 else without_a_terminal
            printed = kill(station.words(name, state), between, look)
            way = rf"{name}: (done by the service|done without the service|failed by no way)"
            assert re.search(way, printed), printed
            assert flies(tmp_path) == names[turn + 1 :], "the others fly on"
            if "between" in state:
                station.control.send_signal(signal.SIGCONT)
        took_s = [machine.awake_s(began, ended) for began, ended in zip(confirmed_s, stopped_s, strict=True)]
    if times == TIMES[1]:
        assert max(took_s) <= STOPPED_S, took_s


@pytest.mark.soak
def test_api_kills_while_control_hangs(tmp_path: Path) -> None:
    with flying(tmp_path, 2) as station:
        station.reach("control stopped")
        with Client(f"http://127.0.0.1:{station.port}", timeout_s=30.0) as client:
            command = client.confirm_kill(client.arm_kill(["d1"]).code)
            wait_until("stopped", SOON_S, lambda: flies(tmp_path) == ["d2"])
            assert command.outcomes["d1"].reason.startswith("without control: ")
            assert client.command_record(command.id) == command
