"""Lines of a running service: a terminal or pipe that is gone or does not read neither ends nor delays it."""

import os
import pty
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from gcs.cli.outlet import Outlet

PROMPT_S = 1.0


def lost(count: int) -> str:
    return f"lost {count}"


@contextmanager
def pipe() -> Iterator[tuple[int, TextIO]]:
    reader, writer = os.pipe()
    with open(writer, "w", encoding="utf-8") as stream:  # noqa: PTH123 (a handle)
        yield reader, stream


def test_pipe_that_is_not_read_delays_nothing_and_losses_count() -> None:
    with pipe() as (reader, stream):
        outlet, began_s = Outlet(stream, lost), time.monotonic()
        for number in range(3000):
            outlet.write(f"{number:099d}")
        assert time.monotonic() - began_s < PROMPT_S
        kept = os.read(reader, 1 << 20).decode()
        outlet.write("again")
        reported, newest = os.read(reader, 1 << 20).decode().split("\n")[-3:-1]
        os.close(reader)
    whole = [line for line in kept.split("\n") if len(line) == 99]
    assert whole == [f"{number:099d}" for number in range(len(whole))]
    assert (reported, newest) == (f"lost {3000 - len(whole)}", "again")


def test_reader_that_is_gone_ends_nothing() -> None:
    with pipe() as (reader, stream):
        os.close(reader)
        outlet = Outlet(stream, lost)
        for _ in range(3):
            outlet.write("a line")
        assert not stream.closed, "it is not ours to close"


def test_closed_terminal_ends_nothing() -> None:
    terminal, near = pty.openpty()
    with open(near, "w", encoding="utf-8") as stream:  # noqa: PTH123 (a handle)
        outlet = Outlet(stream, lost)
        outlet.write("a line")
        assert os.read(terminal, 100) == b"a line\r\n"
        os.close(terminal)
        outlet.write("another")


def test_process_without_a_standard_output_goes_on() -> None:
    program = (
        "import sys; from gcs.cli.outlet import Outlet; Outlet(sys.stdout, str).write('a line'); sys.exit(7)"
    )
    shell = ["sh", "-c", 'exec "$0" -c "$1" >&-', sys.executable, program]
    done = subprocess.run(shell, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (7, "")
