"""`gcs kill` when no service answers: the record says where the vehicles are, and their motors stop."""

import re
import subprocess
from pathlib import Path

import pytest

from gcs.config.schema import Config
from gcs.recording.audit_reader import interruption, last_known
from tests.support.audit_rows import commands
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, flying_config, last_truths, proper, service, vehicles, wait_until
from tests.support.started import run

IDS = ("d1", "d2")
NO_ROW = "http://127.0.0.1:9"


def config_of(port_base: int) -> Config:
    return flying_config(len(IDS), port_base, silence_s=20.0)


def gcs_kill(record: Path, *words: str, url: str = NO_ROW) -> "subprocess.CompletedProcess[str]":
    """As typed where no terminal is."""
    return run("gcs", "kill", *words, "--record", str(record), "--url", url, timeout_s=SOON_S)


def code_in(text: str) -> str:
    found = re.search(r"--confirm ([0-9a-f]{6})", text)
    assert found is not None, text
    return found[1]


def armed(folder: Path) -> list[bool]:
    return [bool(truth["armed"]) for truth in last_truths(folder / "truth.jsonl")]


def test_kill_without_the_service_is_recorded(tmp_path: Path) -> None:
    base = free_ports(len(IDS))
    config = config_of(base)
    record = tmp_path / "station"
    with vehicles(len(IDS), base, tmp_path, *proper(config)):
        with service(config, record) as (client, process):
            wait_until("ready", SOON_S, lambda: all(vehicle.ready for vehicle in client.vehicles()))
            client.start()
            wait_until("running", SOON_S, lambda: client.show().phase == "running")
            process.kill()
            process.wait()
        first = gcs_kill(record, "d2")
        assert (first.returncode, armed(tmp_path)) == (1, [True, True])
        assert "this stops the motors of d2" in first.stderr
        wrong = gcs_kill(record, "d1", "--confirm", code_in(first.stdout))
        assert (wrong.returncode, armed(tmp_path)) == (1, [True, True])
        assert "does not confirm d1" in wrong.stderr
        second = gcs_kill(record, "d2", "--confirm", code_in(first.stdout))
        assert (second.returncode, second.stdout) == (
            0,
            "d2: done without the service, its motors are off\n",
        ), second.stderr
        assert armed(tmp_path) == [True, False]
        *_, command = commands(record)
        assert (command.action, command.caller.partition(" (")[0]) == ("kill", "gcs kill")
        assert command.outcomes == {"d2": ("done", "its motors are off")}
        assert last_known(record).vehicles["d2"].phase == "killed"
        found = interruption(record)
        assert found is not None
        assert set(found.vehicles) == {"d1"}, "no command offers to recover what was killed"
        everything = gcs_kill(record, "--all")
        assert gcs_kill(record, "--all", "--confirm", code_in(everything.stdout)).returncode == 0
        assert armed(tmp_path) == [False, False]


@pytest.mark.computes
def test_invalid_kill_arguments_kill_no_vehicle(tmp_path: Path) -> None:
    for words, code, stated in (
        ((), 2, "names, or --all"),
        (("d1", "--all"), 2, "names, or --all"),
        (("d1",), 1, "there is no such file"),
    ):
        answer = gcs_kill(tmp_path, *words)
        assert answer.returncode == code, answer.stderr
        assert stated in answer.stderr
