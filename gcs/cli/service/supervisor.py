"""`gcs serve --supervised`: a small parent process that restarts the service when it ends or hangs.

It implements systemd's protocol (sd_notify: READY=1, WATCHDOG=1 over a Unix datagram socket), so that the
service runs the same way under systemd. It uses only the standard library, so that little can fail here. The
service has a session of its own, so that it receives Ctrl-C only once, from this process. It also outlives
this process, and then reports that it has no supervisor.
"""

import json
import os
import selectors
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType
from typing import Final

OPTION: Final = "--supervised"
ALL: Final = "--all"
STATION: Final = "--station"

WATCHDOG_S: Final = 3.0
"""Time without a watchdog message until the service counts as hanging. PX4 leaves OFFBOARD after one second
without setpoints, but a machine that stood still for two seconds must not cause a restart.
"""

START_S: Final = 300.0
"""Time limit until the service is ready: after a change of the code all kernels are compiled again."""

WAITS_S: Final = (0.0, 0.5, 1.0, 2.0, 5.0)
"""Waits before successive restarts while the service never gets ready; the last one repeats."""

TRACE_S: Final = 0.5
"""Time for a hanging service to print its stack after SIGABRT, before it is killed."""

LOOK_S: Final = 0.1
STOOD_STILL_S: Final = 1.0
HOPELESS: Final = frozenset({0, 1, 2})
"""Exit codes of a service that was never ready and that a restart cannot help: stopped, refused, or invalid
arguments.
"""


def hangs_up() -> bool:
    """Whether a closed terminal is noticed: not with SIGHUP ignored from the start, as `nohup` does."""
    return signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN


def pass_on(received: list[int]) -> None:
    """Note the requests to stop that a parent receives, as it sends them to its children.

    A closed terminal (SIGHUP) is passed on as such, because no number of them stops a flight at once.
    """

    def note(number: int, _frame: FrameType | None) -> None:
        received.append(signal.SIGHUP if number == signal.SIGHUP else signal.SIGTERM)

    for number in (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hangs_up() else [])):
        signal.signal(number, note)


def is_requested(words: Sequence[str]) -> bool:
    """Whether this process is to supervise one service; with `--all` each station gets a supervisor."""
    return list(words[:1]) == ["serve"] and OPTION in words and ALL not in words


def run(words: Sequence[str]) -> int:
    """Supervise `gcs WORDS`. Returns: the service's exit code, when it was asked to stop or cannot start."""
    command = [sys.executable, "-m", "gcs", *(word for word in words if word != OPTION)]
    return Supervisor(command, station=_station(words)).run()


def _station(words: Sequence[str]) -> str | None:
    for word, following in zip(words, [*words[1:], ""], strict=True):
        if word == STATION:
            return following
        if word.startswith(f"{STATION}="):
            return word.removeprefix(f"{STATION}=")
    return None


class Supervisor:
    """Keeps one command running."""

    def __init__(
        self,
        command: Sequence[str],
        *,
        watchdog_s: float = WATCHDOG_S,
        waits_s: Sequence[float] = WAITS_S,
        station: str | None = None,
    ) -> None:
        """`station` is named in every line of the log."""
        self._command = list(command)
        self._named = {} if station is None else {"station": station}
        self._watchdog_s = watchdog_s
        self._waits_s = tuple(waits_s)
        self._stop_requests: list[int] = []  # signals that request a stop
        self._passed_on = 0
        self._selector = selectors.DefaultSelector()

    def run(self) -> int:
        wake_in, wake_out = os.pipe()
        for end in (wake_in, wake_out):
            os.set_blocking(end, False)
        with (
            tempfile.TemporaryDirectory(prefix="gcs-") as folder,
            socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notify,
        ):
            path = Path(folder) / "notify"
            notify.bind(str(path))
            notify.setblocking(False)
            self._selector.register(notify, selectors.EVENT_READ)
            self._selector.register(wake_in, selectors.EVENT_READ)
            pass_on(self._stop_requests)
            signal.signal(signal.SIGCHLD, lambda _number, _frame: None)  # wakes the selector
            signal.set_wakeup_fd(wake_out, warn_on_full_buffer=False)
            return self._keep(path, notify, wake_in)

    def _keep(self, path: Path, notify: socket.socket, wake: int) -> int:
        failures = 0
        while True:
            child, was_ready = self._watched(path, notify, wake)
            code = child.returncode
            if self._must_stop() or code == 0 or (not was_ready and failures == 0 and code in HOPELESS):
                self._log("info" if code == 0 else "error", "service_ended", code=code, restarted=False)
                return code if code >= 0 else 128 - code
            failures = 0 if was_ready else failures + 1
            wait_s = self._waits_s[min(failures, len(self._waits_s) - 1)]
            self._log("error", "service_ended", code=code, restarted=True, wait_s=wait_s)
            until_s = time.monotonic() + wait_s
            while not self._must_stop() and (left_s := until_s - time.monotonic()) > 0:
                self._wait(left_s, notify, wake)
            if self._must_stop():
                return 0

    def _log(self, level: str, event: str, **more: object) -> None:
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        head = {"time": now, **self._named, "level": level, "logger": __name__, "event": event}
        with suppress(OSError):  # a closed terminal must not stop the supervisor
            sys.stderr.write(f"{json.dumps({**head, **more})}\n")
            sys.stderr.flush()

    def _must_stop(self) -> bool:
        return bool(self._stop_requests)  # a signal handler changes it

    def _watched(self, path: Path, notify: socket.socket, wake: int) -> tuple[subprocess.Popen[bytes], bool]:
        """Start the service and wait for its end. Returns: its process, and whether it was ever ready."""
        environment = os.environ | {
            "NOTIFY_SOCKET": str(path),
            "WATCHDOG_USEC": str(round(self._watchdog_s * 1e6)),
        }
        self._wait(0.0, notify, wake)  # drop messages of the previous process
        child = subprocess.Popen(self._command, env=environment, start_new_session=True)  # noqa: S603 (this program's own command)
        self._log("info", "service_started", pid=child.pid)
        is_ready, due_s, looked_s = False, time.monotonic() + START_S, time.monotonic()
        while child.poll() is None:
            messages = self._wait(LOOK_S, notify, wake)
            now_s = time.monotonic()
            if b"READY=1" in messages and not is_ready:
                is_ready = True
                self._log("info", "service_ready", pid=child.pid)
            if is_ready and (messages & {b"READY=1", b"WATCHDOG=1"} or now_s - looked_s > STOOD_STILL_S):
                # also if this process stood still: the service may have, too
                due_s = now_s + self._watchdog_s
            looked_s = now_s
            for number in self._stop_requests[self._passed_on :]:
                self._passed_on += 1
                child.send_signal(number)
            if now_s > due_s:
                self._end(child, is_ready=is_ready)
        return child, is_ready

    def _end(self, child: subprocess.Popen[bytes], *, is_ready: bool) -> None:
        self._log("error", "service_hangs", pid=child.pid, was_ready=is_ready)
        child.send_signal(signal.SIGABRT)
        try:
            child.wait(TRACE_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()

    def _wait(self, timeout_s: float, notify: socket.socket, wake: int) -> set[bytes]:
        """Wait for a message, a signal or the timeout. Returns: the service's messages."""
        self._selector.select(timeout_s)
        with suppress(BlockingIOError):
            os.read(wake, 4096)
        messages: set[bytes] = set()
        with suppress(BlockingIOError):
            while True:
                messages.update(notify.recv(4096).split(b"\n"))
        return messages
