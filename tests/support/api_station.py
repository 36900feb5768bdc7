"""The API over real TCP, with its service in this process."""

import asyncio
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, nullcontext

import pytest

from gcs.api.app import create_app
from gcs.api.auth.authorization import Authorization
from gcs.api.server import serve
from tests.support.api_fake_service import FakeService


@asynccontextmanager
async def served(service: FakeService, authorization: Authorization | None = None) -> AsyncIterator[int]:
    """Serve on a free port; cancelling stops the server, as in production."""
    listening = asyncio.get_running_loop().create_future()
    app = create_app(service, authorization=authorization)
    task = asyncio.create_task(serve(app, port=0, listening=listening), name="api")
    try:
        yield await asyncio.wait_for(listening, timeout=120)
    finally:
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task


@asynccontextmanager
async def ticking(service: FakeService, period_s: float) -> AsyncIterator[None]:
    """Call `tick` as the control loop does."""

    async def tick() -> None:
        while True:
            service.tick()
            await asyncio.sleep(period_s)

    task = asyncio.create_task(tick(), name="tick")
    try:
        yield
    finally:
        task.cancel()


def run(
    main: Callable[[FakeService, int], Awaitable[None]], count: int = 3, tick_s: float | None = None
) -> None:
    """Run `main` beside a server; the service of `count` vehicles ticks where a period is given."""

    async def both() -> None:
        service = FakeService(count)
        ticks = nullcontext() if tick_s is None else ticking(service, tick_s)
        async with asyncio.timeout(240), served(service) as port, ticks:
            await main(service, port)

    asyncio.run(both())


def narrow(port: int) -> socket.socket:
    """Connect a viewer whose receive buffer is small."""
    made = socket.socket()
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    made.connect(("127.0.0.1", port))
    return made
