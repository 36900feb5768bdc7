"""The API's program: the app, its listeners, and the line to control, with which it ends."""

import asyncio
import gc
import socket

from starlette.types import ASGIApp

from gcs.api.app import create_app
from gcs.api.auth.authorization import Authorization
from gcs.api.auth.middleware import EmergencyLane
from gcs.api.auth.tokens import Tokens
from gcs.api.map_tiles import GroundMap, open_map
from gcs.api.server import serve_on
from gcs.cli.kill.without_control import KillWithoutControl
from gcs.cli.service.api_settings import ApiProcessSettings
from gcs.cli.service.process import set_up_log
from gcs.model.errors import ConfigError, LinkError
from gcs.service.map_settings import MapSettings
from gcs.service.remote import RemoteService


def run(line: int, *listeners: int) -> None:
    """Serve until control ends. The numbers are those of open sockets; settings come over the line."""
    try:
        service = RemoteService(socket.socket(fileno=line))
    except LinkError:  # control has ended before it began
        return
    asyncio.run(_serve(service, [socket.socket(fileno=listener) for listener in listeners]))


async def _serve(service: RemoteService, listeners: list[socket.socket]) -> None:
    """Serve until control ends. Raises: the error that ended a listener."""
    settings: ApiProcessSettings = service.settings
    set_up_log(settings.log_level, settings.station)
    access = settings.access
    tokens = None if access.tokens_file is None else Tokens(access.tokens_file)
    authorization = Authorization(tokens, calls_per_s=access.calls_per_s, burst=access.burst)
    names, ground = ("localhost", settings.host), _ground(settings.map)
    app = create_app(service, host_names=names, authorization=authorization, ground=ground)
    app.openapi()  # takes a quarter of a second: do it now, not at a request during a flight
    app.state.context.emergency_port = settings.lane_port
    app.state.context.last_resort = KillWithoutControl(settings.record, settings.links)
    gc.collect()
    gc.freeze()
    loop = asyncio.get_running_loop()
    apps: list[ASGIApp] = [app, EmergencyLane(app, listeners[0].getsockname()[1])]
    listening: list[asyncio.Future[int]] = [loop.create_future() for _ in listeners]
    serving = [
        loop.create_task(serve_on(listener, served, listening=port, tls=access.tls))
        for listener, served, port in zip(listeners, apps, listening, strict=True)
    ]
    control = loop.create_task(service.run())
    listens = loop.create_task(_listen(service, listening))
    await asyncio.wait((control, *serving), return_when=asyncio.FIRST_COMPLETED)
    listens.cancel()
    for task in serving:
        task.cancel()
    await asyncio.wait(serving)
    for task in serving:
        if not task.cancelled():
            task.result()  # raises the error that ended it


async def _listen(service: RemoteService, listening: list[asyncio.Future[int]]) -> None:
    await asyncio.gather(*listening)
    service.listens()


def _ground(settings: MapSettings | None) -> GroundMap | None:
    """Open the map; control's process has reported why it cannot be used."""
    try:
        return open_map(settings)
    except ConfigError:
        return None
