"""Programs of ours, each in a copy of one process that has loaded them: a start takes 0.4 s, not 2.5.

A copy runs `python -m MODULE WORDS` as its own process, with files and signals of its own. How a program is
loaded is tested where `subprocess` starts it: `gcs demo`, the SITL program, supervised services.
"""

import atexit
import gc
import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import IO, TextIO

import gcs.cli.kill.kill
import gcs.cli.service.serve
import gcs.sim.cli  # noqa: F401
from gcs import control
from gcs.cli.service.memory import save_memory
from gcs.mavlink import codec, reports
from gcs.planning.return_paths import planner
from gcs.service import check_process
from tests.support.machine import restrict_at_usual_priority
from tests.support.netns import enter

PIPE, DEVNULL = subprocess.PIPE, subprocess.DEVNULL


class Started:
    """A running program; offers what the tests use of `subprocess.Popen`."""

    def __init__(
        self,
        module: str,
        *words: str,
        stdout: int | IO[str],
        stderr: IO[str] | None = None,
        folder: Path | None = None,
        namespace: str | None = None,
    ) -> None:
        """Start `python -m MODULE WORDS` in `folder`. `stdout` is `PIPE`, `DEVNULL` or an open file.

        `namespace`: of the network, as `ip netns` names it; None: this one.
        """
        self.stdout: TextIO | None = None
        self.returncode: int | None = None
        ours, theirs = socket.socketpair()
        with Path(os.devnull).open("w") as nothing, theirs:
            files = [(nothing if stdout == DEVNULL or isinstance(stdout, int) else stdout).fileno()]
            if stdout == PIPE:
                reader, files[0] = os.pipe()
                self.stdout = os.fdopen(reader)
            files += [(sys.__stderr__ or nothing if stderr is None else stderr).fileno(), theirs.fileno()]
            request = [str(folder or "."), namespace or "", module, *words]
            socket.send_fds(loaded(), [json.dumps(request).encode()], files)
            if stdout == PIPE:
                os.close(files[0])
        self._status = ours.makefile("r")
        ours.close()
        self.pid = int(self._status.readline())

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def poll(self) -> int | None:
        with suppress(subprocess.TimeoutExpired):
            self.wait(0.0)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end. Returns: the exit code. Raises: TimeoutExpired."""
        if self.returncode is None:
            if not select.select([self._status], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout or 0.0)
            self.returncode = int(self._status.readline())
            self._status.close()
        return self.returncode

    def end(self) -> None:
        """Kill it, unless it has ended."""
        self.kill()
        self.wait()
        if self.stdout is not None:
            self.stdout.close()


def run(module: str, *words: str, timeout_s: float) -> "subprocess.CompletedProcess[str]":
    """Run a program to its end, with nothing to read."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        started = Started(module, *words, stdout=out, stderr=err)
        try:
            code = started.wait(timeout_s)
        finally:
            started.end()
        for each in (out, err):
            each.seek(0)
        return subprocess.CompletedProcess([module, *words], code, out.read(), err.read())


@cache
def loaded() -> socket.socket:
    """The way to the process that has loaded everything; it ends with this one, whose forks share it."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    command = [sys.executable, "-m", __name__, str(theirs.fileno())]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}  # as `gcs` sets it
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, pass_fds=[theirs.fileno()], env=environment)
    theirs.close()

    def end() -> None:
        ours.close()
        process.wait()

    atexit.register(end)
    return ours


def _load() -> None:
    """Load machine code; the modules are loaded with this one."""
    save_memory()
    vars(check_process)["restrict"] = restrict_at_usual_priority
    for warm_up in (control.warm_up, planner.warm_up, codec.warm_up, reports.warm_up):
        warm_up()
    gc.collect()
    gc.freeze()  # collected objects would be copied page by page


def _copy_on_request(requests: socket.socket) -> None:
    """Fork for each request until the other end is closed. Returns in a copy only."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # no zombies
    while True:
        request, files, *_ = socket.recv_fds(requests, 65536, 3)
        if not request:
            os._exit(0)
        if os.fork() == 0:
            requests.close()
            return _watched(json.loads(request), *files)
        for file in files:
            os.close(file)


def _watched(request: list[str], out: int, err: int, status: int) -> None:
    """Fork once more, and report the end of that copy, in which alone this returns."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    child = os.fork()
    if child:
        os.write(status, f"{child}\n".encode())
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        os.write(status, f"{code}\n".encode())
        os._exit(0)
    os.close(status)
    os.dup2(out, 1)
    os.dup2(err, 2)
    # as a new process has them: the old ones may believe that they can seek in what is a pipe now
    sys.stdout, sys.stderr = (os.fdopen(number, "w", closefd=False) for number in (1, 2))
    sys.stderr.reconfigure(line_buffering=True)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    folder, namespace, *sys.argv = request
    os.chdir(folder)
    if namespace:
        enter(namespace)


if __name__ == "__main__":
    _load()
    _copy_on_request(socket.socket(fileno=int(sys.argv[1])))
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
