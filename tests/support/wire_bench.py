"""A router without MAVSDK, and the bytes that its tests send through it."""

import asyncio
import socket
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, closing
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from gcs.links.endpoints import Listen, Place
from gcs.links.framed.router import Router
from gcs.links.kill_latch import KillLatch
from gcs.links.setpoint_watchdog import SetpointWatchdog
from gcs.links.settings import Forward
from gcs.links.signing_keys import Signing
from gcs.mavlink.framing import Frame
from tests.support.machine import free_ports

GROUND = dialect.MAVLink(None, srcSystem=245, srcComponent=190)


class Bench:
    """A router and the frames that it delivered."""

    def __init__(
        self,
        listen: Place,
        system_ids: tuple[int, ...],
        signing: Signing | None = None,
        forward: Sequence[Forward] = (),
    ) -> None:
        self.port = listen.first_port if isinstance(listen, Listen) else 0
        self.setpoint_watchdog = SetpointWatchdog(0.2)
        self.delivered: list[Frame] = []
        self.latch = KillLatch(system_ids)
        self.router = Router(
            name="bench",
            system_ids=system_ids,
            listen=listen,
            setpoint_watchdog=self.setpoint_watchdog,
            latch=self.latch,
            clock=time.monotonic,
            deliver=self.delivered.append,
            signing=signing,
            forward=forward,
        )

    async def receive(self) -> None:
        while True:
            self.router.receive()
            await asyncio.sleep(0.002)


@asynccontextmanager
async def bench(
    *system_ids: int,
    port_count: int = 1,
    listen: Place | None = None,
    signing: Signing | None = None,
    forward: Sequence[Forward] = (),
) -> AsyncIterator[Bench]:
    """Run a router, by default on free UDP ports."""
    place = listen or Listen("127.0.0.1", free_ports(port_count), port_count)
    made = Bench(place, system_ids, signing, forward)
    made.router.open()
    receiving = asyncio.create_task(made.receive())
    try:
        yield made
    finally:
        receiving.cancel()
        made.router.close()


def a_socket() -> closing[socket.socket]:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    made.setblocking(False)
    return closing(made)


def beat(system_id: int, autopilot: int = 12) -> bytes:
    packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
    return bytes(dialect.MAVLink_heartbeat_message(2, autopilot, 0x81, 6 << 16, 4, 3).pack(packer))


def packed(message: Any) -> bytes:
    return bytes(message.pack(GROUND))


def setpoint(target: int) -> bytes:
    return packed(
        dialect.MAVLink_set_position_target_local_ned_message(
            0, target, 1, 1, 0x9C7, 0, 0, 0, 1.0, 2.0, 3.0, 0, 0, 0, 0, 0
        )
    )


def command(target: int) -> bytes:
    return packed(dialect.MAVLink_command_long_message(target, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))


async def arrived(sock: socket.socket) -> bytes:
    async with asyncio.timeout(120):
        return await asyncio.get_running_loop().sock_recv(sock, 2048)


def is_empty(sock: socket.socket) -> bool:
    try:
        sock.recv(2048)
    except BlockingIOError:
        return True
    return False


def address_of(sock: socket.socket) -> str:
    host, port = sock.getsockname()
    return f"{host}:{port}"
