"""Control's end of the service port: executes what the API's process asks for."""

import asyncio
import inspect
import logging
import pickle
import socket
from functools import partial
from typing import Any, Final

from gcs.model.errors import GcsError, LinkError
from gcs.service.commands import CALLER
from gcs.service.interface import Service
from gcs.service.remote.messages import (
    CHANGED,
    LENGTH_BYTES,
    METHODS,
    REQUEST_MAX_BYTES,
    Answer,
    ApiWatch,
    Hello,
    Request,
    framed,
    request_of,
)

log = logging.getLogger(__name__)

UNANSWERED_MAX: Final = 64
"""Requests that may wait for their answers, from a disk for instance; no further one is read then."""


class PortServer:
    """Answers one client. It executes one request at a time, between which the event loop goes on."""

    def __init__(self, service: Service, api: ApiWatch, line: socket.socket, settings: Any = None) -> None:
        """Make it, for one run.

        Args:
            service: what the client may ask.
            api: receives what the client reports of itself.
            line: one of a pair of sockets; `run` closes it.
            settings: for the client, which receives a pickle of them.
        """
        self._service = service
        self._api = api
        self._line = line
        self._settings = settings
        self._tasks: set[asyncio.Task[None]] = set()
        self._writer: asyncio.StreamWriter

    async def run(self) -> None:
        """Answer until the client closes its end. Raises: LinkError for a message that is no request."""
        reader, self._writer = await asyncio.open_unix_connection(sock=self._line)
        service, has_stations = self._service, self._service.stations is not None
        hello = service.frame, service.view.value, service.shows.why_not_kept, has_stations, self._settings
        self._write(Hello(*hello))
        notices = asyncio.create_task(self._notify(), name="port/notices")
        try:
            while True:
                content = await _read(reader)
                request, arguments = request_of(content)
                task = asyncio.create_task(self._answer(request, arguments), name=f"port/{request.method}")
                self._tasks.add(task)
                task.add_done_callback(partial(self._answered, request))
                await asyncio.sleep(0)  # control's turn, however much there is to read
                await self._writer.drain()
                while len(self._tasks) >= UNANSWERED_MAX:
                    await asyncio.wait(self._tasks, return_when=asyncio.FIRST_COMPLETED)
        except (asyncio.IncompleteReadError, ConnectionError):
            return
        finally:
            for each in (notices, *self._tasks):
                each.cancel()
            self._writer.transport.abort()

    async def _notify(self) -> None:
        """Say that there is a new state, unless the client has yet to read what was sent before."""
        while True:
            await self._service.view.changed()
            if not self._writer.transport.get_write_buffer_size():
                self._writer.write(CHANGED)

    async def _answer(self, request: Request, arguments: bytes) -> None:
        """Runs as a task, so that an error of a role, a bug included, ends nothing else."""
        if asyncio.get_running_loop().time() > request.deadline_s:
            return  # too late: a command that its caller believes lost is not executed
        CALLER.set(request.caller)
        method = METHODS[request.method]
        try:
            given = method.unpacked(arguments)
            role = self._api if method.role == "api" else getattr(self._service, method.role)
            if role is None:
                raise LinkError(f"no request: this service has no {method.role}")
            member = getattr(role, method.name)
            value = member if method.is_property else member(*given.args, **given.kwargs)
            answer = Answer(request.id, await value if inspect.isawaitable(value) else value)
        except GcsError as error:
            answer = Answer(request.id, error=error)
        if request.id:
            self._write(answer)

    def _answered(self, request: Request, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (cause := task.exception()) is not None:
            extra = {"request": request.method, "cause": repr(cause)}
            log.error("request_failed", extra=extra, exc_info=cause)
            self._write(Answer(request.id, error=GcsError(f"{request.method} failed; the log says more")))

    def _write(self, message: Answer | Hello) -> None:
        self._writer.write(framed(pickle.dumps(message, pickle.HIGHEST_PROTOCOL)))


async def _read(reader: asyncio.StreamReader) -> bytes:
    """Return one message's content. Raises: LinkError when it is too long."""
    size = int.from_bytes(await reader.readexactly(LENGTH_BYTES))
    if size > REQUEST_MAX_BYTES:
        raise LinkError(f"a request of {size} bytes: at most {REQUEST_MAX_BYTES}")
    return await reader.readexactly(size)
