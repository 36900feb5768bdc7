"""Both ends of the service port in one process: control's on an event loop of its own, in a thread."""

import asyncio
import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any, Self

from gcs.service import Service
from gcs.service.remote import PortServer, RemoteService


class Reports:
    """What the client reported of itself. A `gcs.service.remote.messages.ApiWatch`."""

    def __init__(self) -> None:
        self.beats, self.listening = 0, False

    def listens(self) -> None:
        self.listening = True

    def beat(self) -> None:
        self.beats += 1


class Control:
    """A service that answers in another thread."""

    def __init__(self, service: Service, line: socket.socket) -> None:
        self.reports, self.ended = Reports(), Future[None]()
        self._service, self._line = service, line
        self._loop: asyncio.AbstractEventLoop
        self._over = asyncio.Event()
        self._up = threading.Event()
        self._thread = threading.Thread(target=asyncio.run, args=(self._main(),))

    def __enter__(self) -> Self:
        self._thread.start()
        assert self._up.wait(30)
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
        self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join(30)
        assert not self._thread.is_alive()

    async def _main(self) -> None:
        self._loop = asyncio.get_running_loop()
        server = PortServer(self._service, self.reports, self._line, {"answer": 42})
        self._task = asyncio.create_task(server.run())
        self._up.set()
        await asyncio.wait((self._task,))
        if self._task.cancelled():
            self.ended.cancel()
        elif (error := self._task.exception()) is not None:
            self.ended.set_exception(error)
        else:
            self.ended.set_result(None)
        await self._over.wait()

    def end(self) -> None:
        """Close control's end."""
        self._loop.call_soon_threadsafe(self._task.cancel)

    def do(self, what: Callable[[], Any]) -> Any:
        """Do it on control's event loop, and wait until it is done."""

        async def done() -> Any:
            return what()

        return asyncio.run_coroutine_threadsafe(done(), self._loop).result(30)

    @contextmanager
    def hanging(self) -> Iterator[None]:
        """Let control stand still during the block."""
        go_on, hangs = threading.Event(), threading.Event()

        def hang() -> None:
            hangs.set()
            go_on.wait(60)

        self._loop.call_soon_threadsafe(hang)
        assert hangs.wait(30)
        try:
            yield
        finally:
            go_on.set()


@contextmanager
def remote(service: Service, answer_s: float = 5.0) -> Iterator[tuple[RemoteService, Control]]:
    """Both ends, until the block ends."""
    ours, theirs = socket.socketpair()
    with theirs, Control(service, ours) as control:
        yield RemoteService(theirs, answer_s), control
