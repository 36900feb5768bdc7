"""`gcs demo` that is refused, and one that is ended by hand."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.machine import free_ports
from tests.support.processes import SOON_S, last_truths


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--vehicles", "1"], "--vehicles 1: 2 to 50"),
        (["--vehicles", "8", "--seconds", "20"], "--seconds 20: at least 170"),
    ],
)
@pytest.mark.computes
def test_impossible_demo_is_refused_with_a_message(arguments: list[str], says: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "gcs", "demo", *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert says in done.stderr


@pytest.mark.soak
def test_ctrl_c_brings_the_fleet_home(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "gcs", "demo", "--vehicles", "2", "--truth", str(tmp_path)]
    command += ["--api-port", "0", "--port-base", str(free_ports(2))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as demo:
        assert demo.stdout is not None
        stated = ""
        while "organise" not in stated:
            stated = demo.stdout.readline()
            assert stated, "ended before it flew"
        demo.send_signal(signal.SIGINT)
        rest, _ = demo.communicate(timeout=2 * SOON_S)
    assert "landed" in rest
    assert demo.returncode == 130
    states = last_truths(tmp_path / "truth.jsonl")
    assert [(state["landed"], state["armed"]) for state in states] == [(True, False)] * 2
