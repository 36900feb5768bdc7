"""The API's process, as control's process sees it: started beside control, watched, and replaced.

The listeners belong to control's process, so that the ports stay the same, and connections wait while a new
process starts. A failure of the API, whatever it is, has no effect on control.
"""

import asyncio
import logging
import os
import signal
import socket
import sys
from collections.abc import AsyncIterator, Sequence
from contextlib import ExitStack, asynccontextmanager, closing, suppress
from typing import Final

from gcs.api.auth.tokens import Tokens
from gcs.api.listener import check_tls, listen
from gcs.cli.service import scheduling
from gcs.cli.service.api_settings import ApiProcessSettings
from gcs.config.schema import Config
from gcs.model.errors import LinkError
from gcs.service import Service
from gcs.service.remote import PortServer

log = logging.getLogger(__name__)

API_RETRY_S: Final = 1.0

STOPS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

LOOK_S: Final = 1.0
HANGS: Final = 5
"""Looks without a sign of life until the process counts as hanging: each comes from its event loop."""

STARTS: Final = 120
"""The same until it listens: its modules are loaded first, on a machine that may be busy."""

ENDS_S: Final = 4.0
"""Time for its connections to be closed, once it is to end."""


@asynccontextmanager
async def api_process(config: Config) -> AsyncIterator["ApiProcess"]:
    """Open the listeners, and start a process, which waits for `keep`, until the block ends.

    Raises: LinkError when a port is not available or no process can be started, ConfigError for an invalid
        certificate or file of tokens.
    """
    access, host = config.access, config.api.host
    check_tls(access.tls)
    if access.tokens_file is not None:
        Tokens(access.tokens_file)
    station = None if config.site_rows is None else config.site_rows.station
    # as the command line set it: a record lets lower levels pass, which are for the record alone
    level = logging.getLogger("gcs").getEffectiveLevel()
    with ExitStack() as stack:
        listeners = []
        for name, port in (("api.port", config.api.port), ("api.emergency_port", config.api.lane_port)):
            try:
                listeners.append(stack.enter_context(closing(await listen(host, port))))
            except LinkError as error:
                raise LinkError(f"{name}: {error}") from None
        port, lane_port = (each.getsockname()[1] for each in listeners)
        record = None if config.record is None else config.record.folder
        links = config.model_dump_json(include={"links"})
        settings = ApiProcessSettings(host, lane_port, access, config.map, level, station, record, links)
        api = ApiProcess(port, listeners, settings)
        try:
            await api.start()
        except OSError as error:
            raise LinkError(f"the API's process cannot be started: {error}") from None
        try:
            yield api
        finally:
            await api.end()


class ApiProcess:
    """The process, and those that replace it. Implements `gcs.service.remote.messages.ApiWatch`."""

    def __init__(self, port: int, listeners: Sequence[socket.socket], settings: ApiProcessSettings) -> None:
        """`port` is that of the first listener."""
        self.port = port
        self._listeners = listeners
        self._settings = settings
        self._process: asyncio.subprocess.Process
        self._line: socket.socket
        self._beats = False
        self._listens = False
        self.tried = asyncio.Event()  # the API has answered, or failed

    def listens(self) -> None:
        self._listens = True
        self.tried.set()

    def beat(self) -> None:
        self._beats = True

    @property
    def pid(self) -> int:
        return self._process.pid

    async def end(self) -> None:
        """Ask the process to end, and wait for that."""
        self._line.close()
        await self._end(ENDS_S if self._listens else 0.0)

    async def start(self) -> None:
        """Start a process, which waits for `keep` once it is loaded. Raises: OSError."""
        self._line, theirs = socket.socketpair()
        self._listens = self._beats = False
        with theirs:
            files = [each.fileno() for each in (theirs, *self._listeners)]
            ours = signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
            try:  # the process inherits what is blocked
                self._process = await asyncio.create_subprocess_exec(
                    *(sys.executable, "-m", "gcs.cli.service.api_child", *map(str, (os.getpid(), *files))),
                    stdin=asyncio.subprocess.DEVNULL,
                    stdout=asyncio.subprocess.DEVNULL,
                    pass_fds=files,
                )
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, ours)
        with suppress(ProcessLookupError):  # it has ended already
            scheduling.set_back(self._process.pid)

    async def keep(self, service: Service) -> None:
        """Answer the process, which is started, and start another one whenever it ends or hangs."""
        while True:
            cause = await self._serve(service)
            self.tried.set()
            log.error("api_failed", extra={"listener": "api.port", "cause": cause})
            while True:
                await asyncio.sleep(API_RETRY_S)
                try:
                    await self.start()
                    break
                except OSError as error:  # no memory, or too many files
                    log.error("api_failed", extra={"listener": "api.port", "cause": str(error)})

    async def _serve(self, service: Service) -> str:
        """Answer one process until it has ended. Returns: why it ended."""
        server = asyncio.create_task(PortServer(service, self, self._line, self._settings).run(), name="port")
        watch = asyncio.create_task(self._watch(), name="api/watch")
        try:
            await asyncio.wait((server, watch), return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (server, watch):
                task.cancel()
            await asyncio.wait((server, watch))
        hangs = not watch.cancelled()
        code = await self._end(0.0 if hangs else ENDS_S)
        if hangs:
            return f"process {self.pid} gave no sign of life for {HANGS * LOOK_S:g} s"
        cause = None if server.cancelled() else server.exception()
        return f"process {self.pid} ended with {code}" if cause is None else f"process {self.pid}: {cause}"

    async def _watch(self) -> None:
        """Return when the process hangs. Looks are counted, not seconds: this process may stand still."""
        silent = 0
        while silent < (HANGS if self._listens else STARTS):
            await asyncio.sleep(LOOK_S)
            silent = 0 if self._beats and self._listens else silent + 1
            self._beats = False

    async def _end(self, within_s: float) -> int:
        """Wait for the process's end, which a closed line asks it for. Returns: its exit code."""
        with suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                return await self._process.wait()
        with suppress(ProcessLookupError):
            self._process.kill()
        return await self._process.wait()
