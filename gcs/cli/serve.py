"""Run the service and its API on one loop, each in a group of its own."""

import asyncio
import contextlib
import logging
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from api.app import create_app
from api.server import serve as serve_api
from gcs.config import Config, LinkSettings
from gcs.errors import GcsError, RefusedError
from gcs.lifecycle import AIRBORNE, ShowPhase
from gcs.links import Link
from gcs.links.direct.link import DirectLink
from gcs.links.keys import Signing
from gcs.links.mavsdk_link import MavsdkLink
from gcs.links.rates import wanted
from gcs.orchestrator import Orchestrator
from gcs.service import FleetView, ShowAction

log = logging.getLogger(__name__)

API_RETRY_S = 1.0


def make_link(settings: LinkSettings, config: Config) -> Link:
    """The transport that a link's settings name. Raises: ConfigError for a signing key that is none."""
    vehicles = {vehicle.id: vehicle.system_id for vehicle in settings.fleet}
    record = None if config.record is None else config.record.folder
    if settings.transport == "direct":
        return DirectLink(
            settings.name,
            vehicles,
            settings.udp_ports,
            config.frame,
            deadman_s=config.deadman_s,
            heartbeat_hold_s=settings.heartbeat_hold_s,
            rates_hz=wanted(settings.streams),
            record=record,
        )
    signing = settings.signing
    return MavsdkLink(
        settings.name,
        vehicles,
        settings.places,
        config.frame,
        deadman_s=config.deadman_s,
        heartbeat_hold_s=settings.heartbeat_hold_s,
        rates_hz=wanted(settings.streams),
        record=record,
        signing=None if signing is None else Signing(signing.key_file, signing.link_id),
        forward=settings.forward,
    )


@asynccontextmanager
async def running(config: Config) -> AsyncIterator[tuple[Orchestrator, int]]:
    """The service with its API, until the block ends. Yields the orchestrator and the API's port.

    Control and API share the loop, not their fate: an API that fails is restarted, and control does not
    notice. When control fails, its error ends the block.

    Raises: LinkError when the API's port cannot be had at the start.
    """
    orchestrator = Orchestrator(config, [make_link(link, config) for link in config.links])
    listening: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    api = asyncio.create_task(_keep_api(orchestrator, config, listening), name="api")
    try:
        ready = asyncio.create_task(_ready(listening), name="api/ready")
        await asyncio.wait((ready, api), return_when=asyncio.FIRST_COMPLETED)
        ready.cancel()
        if not listening.done():
            await api  # raises what kept it from listening
        async with asyncio.TaskGroup() as group:
            control = group.create_task(orchestrator.run(), name="service")
            yield orchestrator, listening.result()
            control.cancel()
    finally:
        api.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await api


async def _ready(listening: asyncio.Future[int]) -> None:
    await asyncio.shield(listening)


async def _keep_api(orchestrator: Orchestrator, config: Config, listening: asyncio.Future[int]) -> None:
    """Serve; once it has listened, a failure is retried on the same port."""
    app = create_app(orchestrator, host_names=("localhost", config.api.host))
    port = config.api.port
    while True:
        # a task of its own: whatever ends it, a bug included, ends the API alone
        server = asyncio.create_task(
            serve_api(app, config.api.host, port, listening=listening), name="api/server"
        )
        try:
            await asyncio.wait((server,))
        finally:
            server.cancel()
            await asyncio.wait((server,))
        cause = None if server.cancelled() else server.exception()
        if cause is not None and not listening.done():
            raise cause
        log.error("api_failed", extra={"cause": str(cause)})
        if listening.done():
            port = listening.result()
        await asyncio.sleep(API_RETRY_S)


async def serve(config: Config, say: Callable[[str], None]) -> None:
    """Run until asked to stop. The first Ctrl-C brings the fleet home, the second stops at once.

    Raises: GcsError when it cannot start.
    """
    asked = asyncio.Semaphore(0)  # counts the times somebody asked it to stop
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, asked.release)
    async with running(config) as (orchestrator, port):
        say(f"serving {len(config.ids)} vehicles; API at http://{config.api.host}:{port}/docs")
        await asked.acquire()
        if not _anybody_up(orchestrator.view.value):
            return
        try:
            orchestrator.command_show(ShowAction.STOP)
        except RefusedError as refused:
            say(f"{refused}")  # and yet nothing is left in the air
        say("coming home; press Ctrl-C again to stop at once (the vehicles' own failsafe takes over)")
        landed = asyncio.create_task(_landed(orchestrator), name="landed")
        again = asyncio.create_task(asked.acquire(), name="again")
        await asyncio.wait((landed, again), return_when=asyncio.FIRST_COMPLETED)
        landed.cancel()
        again.cancel()


async def _landed(orchestrator: Orchestrator) -> None:
    async for view in orchestrator.view.values():
        if not _anybody_up(view):
            return


def _anybody_up(view: FleetView) -> bool:
    """Whether a vehicle of ours is in the air, or about to be."""
    if view.show in {ShowPhase.PREFLIGHT, ShowPhase.ARMING}:
        return True
    return any(vehicle.phase in AIRBORNE for vehicle in view.vehicles)


def run(config: Config, say: Callable[[str], None]) -> int:
    """Serve on a loop of its own. Returns: the exit code."""
    try:
        asyncio.run(serve(config, say))
    except GcsError as error:
        say(str(error))
        return 1
    return 0
