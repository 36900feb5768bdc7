"""Runs a server on its own event loop in another thread, for blocking callers."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from starlette.types import ASGIApp, Receive, Scope, Send

from gcs.api.app import create_app
from gcs.api.auth.authorization import Authorization
from gcs.api.server import serve
from tests.support.api_fake_service import FakeService

TICK_S = 0.1


class Ticking:
    """The app of a service that has a new state ten times a second."""

    def __init__(self, service: FakeService, authorization: Authorization | None = None) -> None:
        self._service, self._app = service, create_app(service, authorization=authorization)
        self._task: asyncio.Task[None] | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if self._task is None:
            self._service.tick()
            self._task = asyncio.create_task(self._tick(), name="ticks")
        await self._app(scope, receive, send)

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(TICK_S)
            self._service.tick()


@contextmanager
def in_background(app: ASGIApp, port: int = 0) -> Iterator[int]:
    """Serve until the block ends. Yields the port."""
    ready: list[tuple[asyncio.AbstractEventLoop, asyncio.Task[None], int]] = []
    up = threading.Event()

    async def main() -> None:
        loop = asyncio.get_running_loop()
        listening = loop.create_future()
        task = asyncio.create_task(serve(app, port=port, listening=listening))
        ready.append((loop, task, await listening))
        up.set()
        with pytest.raises(asyncio.CancelledError):
            await task

    thread = threading.Thread(target=asyncio.run, args=(main(),))
    thread.start()
    assert up.wait(30)
    loop, task, port = ready[0]
    try:
        yield port
    finally:
        loop.call_soon_threadsafe(task.cancel)
        thread.join(30)
        assert not thread.is_alive()
