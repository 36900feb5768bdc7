"""The process of a long-running command: structured log, exact event loop, messages to the supervisor."""

import asyncio
import logging
import os
import select
import selectors
import signal
import socket
import sys
import time
from collections.abc import Callable, Coroutine, MutableMapping
from typing import Any, Final, TypeVar

from pythonjsonlogger.json import JsonFormatter

from gcs.cli.outlet import Outlet, OutletHandler
from gcs.cli.service.supervisor import hangs_up

FIELDS: Final = {"levelname": "level", "name": "logger", "message": "event", "exc_info": "traceback"}


class JsonLines(JsonFormatter):
    """Formats time, level, logger, event, and the caller's extra fields."""

    def __init__(self, station: str | None = None) -> None:
        """`station` is named in every line."""
        super().__init__(
            ["levelname", "name", "message"], timestamp="time", rename_fields=FIELDS, json_default=str
        )
        self._named = {} if station is None else {"station": station}

    def process_log_record(self, log_data: dict[str, Any]) -> dict[str, Any]:
        """Put time (in milliseconds) and station first; levels are in lower case."""
        time = log_data.pop("time").isoformat(timespec="milliseconds")
        return {"time": time, **self._named, **log_data, "level": log_data["level"].lower()}


def set_up_log(level: int, station: str | None = None) -> None:
    """Log this project's packages from `level`, and others' warnings. A record may receive lower levels.

    `station` is named in every line.
    """
    form = JsonLines(station)
    handler = OutletHandler(Outlet(sys.stderr, lambda count: form.format(_not_written(count))))
    handler.setFormatter(form)
    handler.addFilter(lambda record: record.levelno >= level or record.name.split(".")[0] != "gcs")
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(logging.WARNING)
    logging.getLogger("gcs").setLevel(level)


def _not_written(count: int) -> logging.LogRecord:
    given = {"name": __name__, "levelno": logging.WARNING, "levelname": "WARNING", "msg": "lines_not_written"}
    return logging.makeLogRecord({**given, "count": count})


T = TypeVar("T")


def run_exactly(main: Coroutine[Any, Any, T]) -> T:
    """As `asyncio.run`, on such a loop when the platform supports it."""
    with asyncio.Runner(loop_factory=_exact_loop) as runner:
        return runner.run(main)


if sys.platform == "linux":

    class _ExactSelector(selectors.EpollSelector):
        """Waits with `select`, whose timeout is in microseconds, for epoll, whose own is in milliseconds."""

        def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
            if timeout is not None and timeout > 0:
                select.select((self.fileno(),), (), (), timeout)
                timeout = 0
            return super().select(timeout)

    def _exact_loop() -> asyncio.AbstractEventLoop:
        return asyncio.SelectorEventLoop(_ExactSelector())

else:

    def _exact_loop() -> asyncio.AbstractEventLoop:
        return asyncio.new_event_loop()


class StopRequests:
    """Requests to stop, by signals. A second one stops at once.

    A closed terminal or a lost connection (SIGHUP) counts only as a first request: it may send several, and
    no operator reads there what a second one would do.
    """

    def __init__(self) -> None:
        """Must be made on the running event loop."""
        self.first, self.second = asyncio.Event(), asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, self._take)
        if hangs_up():
            loop.add_signal_handler(signal.SIGHUP, self.first.set)
        self._count = 0

    def _take(self) -> None:
        self._count += 1
        self.first.set()
        if self._count > 1:
            self.second.set()


def ignore_the_terminal() -> None:
    """Let no key of the terminal stop this process: neither Ctrl-Z nor a write in the background."""
    for number in (signal.SIGTSTP, signal.SIGTTOU):
        signal.signal(number, signal.SIG_IGN)


log = logging.getLogger(__name__)

BEATS: Final = 4.0
"""Watchdog messages in one watchdog period."""


class Notifier:
    """Sends one datagram per message; it never blocks or raises. Without an address it sends nothing."""

    def __init__(
        self, address: str = "", watchdog_s: float = 0.0, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        """`address` is a path, or an abstract name that begins with @; empty: no supervisor."""
        self._address = f"\0{address[1:]}" if address.startswith("@") else address
        self._period_s = watchdog_s / BEATS
        self._clock_s = clock_s
        self._due_s = 0.0
        self._socket: socket.socket | None = None
        self.problem = ""  # why no supervisor receives messages any more, as text
        if address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setblocking(False)

    def ready(self) -> None:
        """Report that the API answers and control runs."""
        self._say("READY=1")

    def stopping(self) -> None:
        """Report that the service was asked to stop, and brings the fleet home first."""
        self._say("STOPPING=1")

    def beat(self) -> None:
        """Report a tick in time; sent only `BEATS` times per watchdog period."""
        if self._period_s and self._clock_s() >= self._due_s:
            self._due_s = self._clock_s() + self._period_s
            self._say("WATCHDOG=1")

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _say(self, text: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(text.encode(), self._address)
        except BlockingIOError:  # the supervisor reads late; the next message suffices
            return
        except OSError as error:
            if not self.problem:
                log.warning("supervisor_gone", extra={"cause": str(error)})
            self.problem = "nothing starts this service again"
        else:
            self.problem = ""


def notifier_from_environment(environment: MutableMapping[str, str] = os.environ) -> Notifier:
    """Make the notifier of the environment, and remove its variables, so that child processes ignore them."""
    address = environment.pop("NOTIFY_SOCKET", "")
    interval_us = environment.pop("WATCHDOG_USEC", "0")
    pid = environment.pop("WATCHDOG_PID", str(os.getpid()))
    is_ours = pid == str(os.getpid()) and interval_us.isdigit()
    return Notifier(address, float(interval_us) * 1e-6 if is_ours else 0.0)
