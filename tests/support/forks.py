"""`pytest --forks N`: tests are collected once, and N copies of the process take one file after the other.

Workers of pytest-xdist collect each for themselves, and load the kernels again: 8 s of a processor for each.
"""

import atexit
import json
import os
import select
import signal
import struct
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from itertools import groupby
from typing import IO, Any

import pytest

ENDS_S = 60.0
_INDEX, _END = struct.Struct("<I"), b"end"


class Forks:
    """The plugin in the process that collects."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._before: list[Callable[[], object]] = []

    def prepare(self, work: Callable[[], object]) -> None:
        """Have this done once, before the process is copied."""
        self._before.append(work)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool | None:
        """Run all tests in copies of this process, and report what they report.

        A test has failed if its copy ended without a report, or if no copy has run it.
        """
        if session.config.option.collectonly or session.testsfailed:
            return None
        for prepare in self._before:
            prepare()
        session.config._tmp_path_factory.getbasetemp()  # type: ignore[attr-defined]
        files = [list(group) for _, group in groupby(session.items, lambda item: item.path)]
        left, pipes = _queue(len(files)), {}
        for number in range(min(self._count, len(files))):
            reader, pid = _copied(session, files, left, number)
            pipes[reader] = pid
        os.close(left)
        missing, ended = {item.nodeid: item for item in session.items}, False
        try:
            for line in _lines(pipes):
                report = session.config.hook.pytest_report_from_serializable(
                    config=session.config, data=json.loads(line)
                )
                if report.when == "teardown":
                    missing.pop(report.nodeid, None)
                session.config.hook.pytest_runtest_logreport(report=report)
            ended = True
        finally:
            if not ended:
                _interrupt(pipes.values())
            for pipe, pid in pipes.items():
                pipe.close()
                _ended(pid)
        for item in missing.values():
            session.config.hook.pytest_runtest_logreport(report=_not_run(item))
        return True


def _queue(count: int) -> int:
    """The end to read of a pipe with the numbers of all files: each number is read by one copy."""
    reader, writer = os.pipe()
    os.write(writer, b"".join(map(_INDEX.pack, range(count))))  # a pipe holds 16,384 of them
    os.close(writer)
    return reader


def _copied(
    session: pytest.Session, files: list[list[pytest.Item]], left: int, number: int
) -> tuple[IO[bytes], int]:
    """Returns: what a new copy reports, one report in a line; its process."""
    reader, writer = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # the copy needs no thread of this process
        pid = os.fork()
    if pid:
        os.close(writer)
        return os.fdopen(reader, "rb", buffering=0), pid
    code = 1
    try:
        os.close(reader)
        with os.fdopen(writer, "wb", buffering=0) as reports:
            _run(session, files, left, number, reports)
            reports.write(_END + b"\n")
        code = 0
    finally:  # the process ends here, whatever happened
        if code:
            traceback.print_exc()
        try:
            atexit._run_exitfuncs()
        finally:
            os._exit(code)


class _Reports:
    """The plugin in a copy: instead of the terminal."""

    def __init__(self, config: pytest.Config, to: IO[bytes]) -> None:
        self._config, self._to = config, to

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        data = self._config.hook.pytest_report_to_serializable(config=self._config, report=report)
        line = memoryview(json.dumps(data).encode() + b"\n")
        while line:
            line = line[self._to.write(line) :]


def _run(
    session: pytest.Session, files: list[list[pytest.Item]], left: int, number: int, to: IO[bytes]
) -> None:
    """Run file after file, as long as there are any."""
    config = session.config
    os.environ["PYTEST_XDIST_WORKER"] = f"gw{number}"  # `machine.free_ports` reads it
    captured = config.pluginmanager.getplugin("capturemanager")
    if captured is not None:
        captured.stop_global_capturing()
        captured.start_global_capturing()  # into files of its own
    config.pluginmanager.unregister(name="terminalreporter")
    config.pluginmanager.register(_Reports(config, to))
    factory: Any = config._tmp_path_factory  # type: ignore[attr-defined]
    factory._basetemp = factory.getbasetemp() / f"copy{number}"
    factory._basetemp.mkdir(mode=0o700)
    try:
        while taken := os.read(left, _INDEX.size):
            items = files[_INDEX.unpack(taken)[0]]
            for item, following in zip(items, [*items[1:], None], strict=True):
                config.hook.pytest_runtest_protocol(item=item, nextitem=following)
    finally:
        session._setupstate.teardown_exact(None)


def _lines(pipes: dict[IO[bytes], int]) -> Iterator[bytes]:
    """What the copies report, until all have ended."""
    open_, begun = set(pipes), dict.fromkeys(pipes, b"")
    while open_:
        for pipe in select.select(list(open_), [], [])[0]:
            read = pipe.read(1 << 20)
            if not read:
                open_.discard(pipe)
            *lines, begun[pipe] = (begun[pipe] + read).split(b"\n")
            if lines and lines[-1] == _END:  # what a test has left may hold the pipe open
                open_.discard(pipe)
                lines.pop()
            yield from lines


def _interrupt(pids: Iterable[int]) -> None:
    """End those that still run: after Ctrl-C, or when the first failure ends all."""
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGINT)


def _ended(pid: int) -> None:
    """Wait for a copy whose tests have ended; what it still does then may hang."""
    until_s = time.monotonic() + ENDS_S
    while os.waitpid(pid, os.WNOHANG)[0] == 0:
        if time.monotonic() > until_s:
            os.kill(pid, signal.SIGKILL)
        time.sleep(0.02)


def _not_run(item: pytest.Item) -> pytest.TestReport:
    return pytest.TestReport(
        nodeid=item.nodeid,
        location=item.location,
        keywords={},
        outcome="failed",
        longrepr="its process ended before it did",
        when="call",
    )
