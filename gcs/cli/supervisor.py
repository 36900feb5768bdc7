"""`gcs serve --supervised`: a small parent that starts the service again, whatever ends it or makes it hang.

It speaks systemd's protocol (sd_notify: READY=1, WATCHDOG=1 over a Unix datagram socket), so that the service
is the same under systemd. The standard library alone: what can fail here is little. The service has a session
of its own, so that Ctrl-C comes once, from here; and it outlives this process, and then says that nobody
watches over it.
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

WATCHDOG_S: Final = 3.0
"""PX4 gives up on us after one second without setpoints; a machine that stood still for two is no hang."""

START_S: Final = 300.0
"""Until it is ready: after a change of the code all kernels are compiled anew."""

WAITS_S: Final = (0.0, 0.5, 1.0, 2.0, 5.0)
"""Before the next try, while none of them gets ready; the last for ever."""

TRACE_S: Final = 0.5
"""What hangs is asked where, by SIGABRT, before it is killed."""

LOOK_S: Final = 0.1
STOOD_STILL_S: Final = 1.0
HOPELESS: Final = frozenset({0, 1, 2})
"""Exit codes of one that was never ready, and will not be by another try: asked to end, refused, no sense."""


def is_requested(words: Sequence[str]) -> bool:
    """Whether a command line asks for a supervisor."""
    return list(words[:1]) == ["serve"] and OPTION in words


def run(words: Sequence[str]) -> int:
    """Supervise `gcs WORDS`. Returns: the service's exit code, once it was asked to end or cannot begin."""
    return Supervisor([sys.executable, "-m", "gcs", *(word for word in words if word != OPTION)]).run()


def _log(level: str, event: str, **more: object) -> None:
    """One line, as the service's own."""
    now = datetime.now(UTC).isoformat(timespec="milliseconds")
    line = {"time": now, "level": level, "logger": "gcs.cli.supervisor", "event": event, **more}
    with suppress(OSError):  # a terminal that is gone stops nothing
        sys.stderr.write(f"{json.dumps(line)}\n")
        sys.stderr.flush()


class Supervisor:
    """Keeps one command running."""

    def __init__(
        self, command: Sequence[str], *, watchdog_s: float = WATCHDOG_S, waits_s: Sequence[float] = WAITS_S
    ) -> None:
        """Nothing is started before `run`."""
        self._command = list(command)
        self._watchdog_s = watchdog_s
        self._waits_s = tuple(waits_s)
        self._asked = 0  # how often we were asked to stop
        self._passed_on = 0
        self._selector = selectors.DefaultSelector()

    def run(self) -> int:
        """Until asked to stop. Returns: the exit code."""
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
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, self._note_signal)
            signal.signal(signal.SIGCHLD, lambda _number, _frame: None)  # it wakes us
            signal.set_wakeup_fd(wake_out, warn_on_full_buffer=False)
            return self._keep(path, notify, wake_in)

    def _note_signal(self, _number: int, _frame: FrameType | None) -> None:
        self._asked += 1

    def _keep(self, path: Path, notify: socket.socket, wake: int) -> int:
        failures = 0
        while True:
            child, was_ready = self._watched(path, notify, wake)
            code = child.returncode
            if self._is_asked() or code == 0 or (not was_ready and failures == 0 and code in HOPELESS):
                _log("info" if code == 0 else "error", "service_ended", code=code, restarted=False)
                return code if code >= 0 else 128 - code
            failures = 0 if was_ready else failures + 1
            wait_s = self._waits_s[min(failures, len(self._waits_s) - 1)]
            _log("error", "service_ended", code=code, restarted=True, wait_s=wait_s)
            self._pause(wait_s, notify, wake)
            if self._is_asked():
                return 0

    def _pause(self, wait_s: float, notify: socket.socket, wake: int) -> None:
        """Until it is time for the next try, or we are asked to stop."""
        until_s = time.monotonic() + wait_s
        while not self._is_asked() and (left_s := until_s - time.monotonic()) > 0:
            self._wait(left_s, notify, wake)

    def _is_asked(self) -> bool:
        return self._asked > 0  # a signal changes it

    def _watched(self, path: Path, notify: socket.socket, wake: int) -> tuple[subprocess.Popen[bytes], bool]:
        """Start it, and return when it has ended, and whether it was ever ready."""
        environment = os.environ | {
            "NOTIFY_SOCKET": str(path),
            "WATCHDOG_USEC": str(round(self._watchdog_s * 1e6)),
        }
        self._wait(0.0, notify, wake)  # what the one before had still to say
        child = subprocess.Popen(self._command, env=environment, start_new_session=True)  # noqa: S603 (ours)
        _log("info", "service_started", pid=child.pid)
        is_ready, due_s, looked_s = False, time.monotonic() + START_S, time.monotonic()
        while child.poll() is None:
            stated = self._wait(LOOK_S, notify, wake)
            now_s = time.monotonic()
            if b"READY=1" in stated and not is_ready:
                is_ready = True
                _log("info", "service_ready", pid=child.pid)
            if is_ready and (stated & {b"READY=1", b"WATCHDOG=1"} or now_s - looked_s > STOOD_STILL_S):
                due_s = now_s + self._watchdog_s  # or we stood still ourselves: it may have, too
            looked_s = now_s
            while self._passed_on < self._asked:
                self._passed_on += 1
                child.send_signal(signal.SIGTERM)
            if now_s > due_s:
                self._end(child, is_ready=is_ready)
        return child, is_ready

    def _end(self, child: subprocess.Popen[bytes], *, is_ready: bool) -> None:
        _log("error", "service_hangs", pid=child.pid, was_ready=is_ready)
        child.send_signal(signal.SIGABRT)
        try:
            child.wait(TRACE_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()

    def _wait(self, timeout_s: float, notify: socket.socket, wake: int) -> set[bytes]:
        """Wait for something to happen. Returns: what the service has said."""
        self._selector.select(timeout_s)
        with suppress(BlockingIOError):
            os.read(wake, 4096)
        stated: set[bytes] = set()
        with suppress(BlockingIOError):
            while True:
                stated.update(notify.recv(4096).split(b"\n"))
        return stated
