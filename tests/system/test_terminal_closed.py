"""The terminal of a service is closed in flight, as by a dropped connection: the fleet comes home."""

import os
import pty
import re
import select
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
import yaml

from gcs.client import Client
from tests.support.audit_rows import commands
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, flying_config, last_truths, proper, vehicles, wait_until

pytestmark = pytest.mark.soak

COUNT = 2


@contextmanager
def on_a_terminal(*words: str) -> Iterator[tuple[int, int, str]]:
    """Run `gcs WORDS` on a terminal of its own. Yields: its process, the terminal, and the API's address."""
    pid, terminal = pty.fork()
    if pid == 0:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored where the tests run under nohup
        os.execv(sys.executable, [sys.executable, "-m", "gcs", *words])  # noqa: S606 (this program)
    shown, until_s = "", time.monotonic() + SOON_S
    try:
        while (address := re.search(r"http://[\d.:]+", shown)) is None:
            assert time.monotonic() < until_s, shown
            if select.select([terminal], [], [], 0.1)[0]:
                shown += os.read(terminal, 4096).decode()
        yield pid, terminal, address[0]
    finally:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def ended(pid: int) -> int | None:
    """The exit code of a child; None while it runs."""
    done, status = os.waitpid(pid, os.WNOHANG)
    return os.waitstatus_to_exitcode(status) if done else None


@pytest.mark.keeps("options0")
@pytest.mark.parametrize("options", [(), ("--supervised",)])
def test_closed_terminal_brings_the_fleet_home(tmp_path: Path, options: tuple[str, ...]) -> None:
    base, record = free_ports(COUNT), tmp_path / "runs"
    config = flying_config(COUNT, base, silence_s=20.0)
    raw = config.model_dump(mode="json") | {"record": {"folder": str(record)}}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(raw), encoding="utf-8")
    words = ("serve", "--config", str(tmp_path / "config.yaml"), "--quiet", *options)
    codes: list[int] = []

    def has_ended(pid: int) -> bool:
        code = ended(pid)
        codes.extend([] if code is None else [code])
        return code is not None

    with vehicles(COUNT, base, tmp_path, *proper(config)), on_a_terminal(*words) as (pid, terminal, url):
        with Client(url, timeout_s=30.0) as client:
            wait_until("ready", SOON_S, lambda: all(vehicle.ready for vehicle in client.vehicles()))
            client.start()
            wait_until("running", SOON_S, lambda: client.show().phase == "running")
        os.close(terminal)
        wait_until("ended", SOON_S, lambda: has_ended(pid))
        assert codes == [0]
        assert [command.action for command in commands(record)] == ["start", "stop"]
        assert [(truth["landed"], truth["armed"]) for truth in last_truths(tmp_path / "truth.jsonl")] == [
            (True, False)
        ] * COUNT


def test_second_ctrl_c_names_what_is_left_in_the_air(tmp_path: Path) -> None:
    base = free_ports(COUNT)
    config = flying_config(COUNT, base, silence_s=20.0)
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config.model_dump(mode="json")), encoding="utf-8")
    words = ("serve", "--config", str(tmp_path / "config.yaml"), "--quiet")
    with vehicles(COUNT, base, tmp_path, *proper(config)), on_a_terminal(*words) as (pid, terminal, url):
        with Client(url, timeout_s=30.0) as client:
            wait_until("ready", SOON_S, lambda: all(vehicle.ready for vehicle in client.vehicles()))
            client.start()
            wait_until("running", SOON_S, lambda: client.show().phase == "running")
        shown = ""
        for last in ("coming home; press Ctrl-C again", "ended; still in the air, not under this station"):
            os.kill(pid, signal.SIGINT)
            while last not in shown:
                assert select.select([terminal], [], [], SOON_S)[0], shown
                shown += os.read(terminal, 4096).decode()
        wait_until("ended", SOON_S, lambda: ended(pid) is not None)
