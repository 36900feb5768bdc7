"""What the service says to systemd, or to a supervisor of its own, over a real socket."""

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs.cli.notify import Notifier, from_environment


@pytest.fixture
def received(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.settimeout(60.0)
        yield listener


def test_it_is_ready_and_beats_four_times_in_the_time_that_it_may_be_silent(received: socket.socket) -> None:
    clock = iter([0.0, 0.0, 0.1, 0.8, 0.8])
    notifier = Notifier(received.getsockname(), 3.0, lambda: next(clock))
    notifier.ready()
    for _ in range(3):  # of which the second is too soon
        notifier.beat()
    notifier.stopping()
    assert [received.recv(100) for _ in range(4)] == [b"READY=1", b"WATCHDOG=1", b"WATCHDOG=1", b"STOPPING=1"]
    notifier.close()


def test_whom_nobody_asked_says_nothing_and_fails_at_nothing() -> None:
    notifier = from_environment({})
    notifier.ready()
    notifier.beat()
    assert notifier.problem == ""


def test_what_was_asked_of_us_is_not_asked_of_our_children(received: socket.socket) -> None:
    asked = {"NOTIFY_SOCKET": received.getsockname(), "WATCHDOG_USEC": "3000000", "PATH": "/bin"}
    notifier = from_environment(asked)
    assert asked == {"PATH": "/bin"}
    notifier.beat()
    assert received.recv(100) == b"WATCHDOG=1"
    notifier.close()


def test_a_watchdog_for_another_process_is_not_fed(received: socket.socket) -> None:
    other = {"WATCHDOG_PID": str(os.getpid() + 1), "WATCHDOG_USEC": "3000000"}
    notifier = from_environment({"NOTIFY_SOCKET": received.getsockname(), **other})
    notifier.beat()
    notifier.ready()
    assert received.recv(100) == b"READY=1"
    notifier.close()


def test_it_says_when_nobody_listens_any_more_and_when_somebody_does_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "notify"
    notifier = Notifier(str(path), 0.0)
    for _ in range(3):
        notifier.ready()
    assert notifier.problem != ""
    assert [record.message for record in caplog.records] == ["supervisor_gone"]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(path))
        notifier.ready()
    assert notifier.problem == ""
    notifier.close()
