"""What the service says to systemd, or to a supervisor of its own, over a real socket."""

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs.cli.service.process import Notifier, notifier_from_environment


@pytest.fixture
def received(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.settimeout(60.0)
        yield listener


def test_ready_and_four_beats_within_the_watchdog_time(received: socket.socket) -> None:
    clock = iter([0.0, 0.0, 0.1, 0.8, 0.8])
    notifier = Notifier(received.getsockname(), 3.0, lambda: next(clock))
    notifier.ready()
    for _ in range(3):  # of which the second is too soon
        notifier.beat()
    notifier.stopping()
    assert [received.recv(100) for _ in range(4)] == [b"READY=1", b"WATCHDOG=1", b"WATCHDOG=1", b"STOPPING=1"]
    notifier.close()


def test_without_a_notify_socket_nothing_is_sent_or_fails() -> None:
    notifier = notifier_from_environment({})
    notifier.ready()
    notifier.beat()
    assert notifier.problem == ""


def test_notify_variables_are_removed_from_the_environment(received: socket.socket) -> None:
    asked = {"NOTIFY_SOCKET": received.getsockname(), "WATCHDOG_USEC": "3000000", "PATH": "/bin"}
    notifier = notifier_from_environment(asked)
    assert asked == {"PATH": "/bin"}
    notifier.beat()
    assert received.recv(100) == b"WATCHDOG=1"
    notifier.close()


def test_watchdog_of_another_process_is_not_notified(received: socket.socket) -> None:
    other = {"WATCHDOG_PID": str(os.getpid() + 1), "WATCHDOG_USEC": "3000000"}
    notifier = notifier_from_environment({"NOTIFY_SOCKET": received.getsockname(), **other})
    notifier.beat()
    notifier.ready()
    assert received.recv(100) == b"READY=1"
    notifier.close()


def test_lost_and_restored_notify_socket_is_reported(
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
