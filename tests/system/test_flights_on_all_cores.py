"""Flights in processes of their own: they end with the program that takes them, whatever it does."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcs.model.errors import RefusedError
from gcs.simulation.cores import on_all_cores
from tests.support.machine import soon

PROGRAM = """\
import sys, time
from gcs.simulation import Scenario, fly_many
if __name__ == "__main__" or sys.argv[1] == "bare":
    scenario = Scenario.load("assembly").with_(duration_s=20.0)
    for flight in fly_many(scenario, 4, range(100_000), workers=2):
        print(flight.seed, flush=True)
        if sys.argv[1] == "looks":
            time.sleep(600.0)
        if sys.argv[1] == "fails":
            raise OSError("what a program does with a flight may fail")
"""
ENDS_S = 60.0
"""On a busy machine; all that was asked for takes hours."""


def started(folder: Path, how: str) -> subprocess.Popen[str]:
    """The program in a session of its own, as a terminal starts one."""
    file = folder / "program.py"
    file.write_text(PROGRAM, encoding="utf-8")
    return subprocess.Popen(
        [sys.executable, str(file), how],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def left(session: int) -> list[int]:
    """Processes of a session."""
    pids = [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()]
    return [pid for pid in pids if _session_of(pid) == session]


def _session_of(pid: int) -> int:
    try:
        return os.getsid(pid)
    except ProcessLookupError:
        return -1


@pytest.mark.soak
@pytest.mark.parametrize("how", ["flies", "looks"])
def test_ctrl_c_ends_all_flights_at_once(tmp_path: Path, how: str) -> None:
    """While the next flight is awaited, and while the program looks at one."""
    program = started(tmp_path, how)
    assert program.stdout is not None
    assert program.stdout.readline() == "0\n"
    os.killpg(program.pid, signal.SIGINT)  # as a terminal does
    _, errors = program.communicate(timeout=ENDS_S)
    assert program.returncode == -signal.SIGINT
    assert errors.count("Traceback") == 1, "of the program alone"
    soon(lambda: left(program.pid) == [])


@pytest.mark.soak
def test_flights_end_with_a_program_that_fails(tmp_path: Path) -> None:
    program = started(tmp_path, "fails")
    _, errors = program.communicate(timeout=180.0)
    assert "OSError: what a program does" in errors
    soon(lambda: left(program.pid) == [])


@pytest.mark.soak
def test_a_script_that_each_process_runs_is_named(tmp_path: Path) -> None:
    program = started(tmp_path, "bare")
    _, errors = program.communicate(timeout=180.0)
    assert errors.rstrip().endswith('A script that calls this needs `if __name__ == "__main__":`')
    soon(lambda: left(program.pid) == [])


def test_a_process_that_ends_is_an_error() -> None:
    with pytest.raises(RefusedError, match="a process that flew ended"):
        list(on_all_cores(os._exit, [3, 3, 3], 2))


def test_results_come_in_the_order_of_the_runs() -> None:
    """Those of the first are late; far more than are kept wait for it."""
    lengths_s = [0.5, *[0.0] * 99]
    assert list(on_all_cores(_slept, list(enumerate(lengths_s)), 3)) == list(range(100))


def _slept(run: tuple[int, float]) -> int:
    time.sleep(run[1])
    return run[0]
