"""A link without heartbeats and setpoints of its own, and the bytes that its tests send through it."""

import asyncio
import socket
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, closing
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as dialect

from gcs.links.link import Address, FrameDirection
from gcs.links.native.link import NativeLink
from gcs.links.settings import Forward, Listen, Place
from gcs.links.signing import Signing
from gcs.mavlink.codec import heartbeats, joined, split, target_system
from gcs.mavlink.framing import HEARTBEAT, SETPOINT_MESSAGES, Frame
from gcs.model.frames import ShowFrame
from tests.support.machine import free_ports

GROUND = dialect.MAVLink(None, srcSystem=254, srcComponent=190)


class Bench:
    """A link whose ports are open, and the frames that it accepted."""

    def __init__(
        self,
        listen: Place | Sequence[Place],
        system_ids: tuple[int, ...],
        signing: Signing | None = None,
        forward: Sequence[Forward] = (),
    ) -> None:
        self.port = listen.first_port if isinstance(listen, Listen) else 0
        self.delivered: list[Frame] = []
        vehicles = {f"v{system_id}": system_id for system_id in system_ids}
        frame = ShowFrame(47.4, 8.5, 500.0)
        self.link = NativeLink("bench", vehicles, listen, frame, signing=signing, forward=forward)
        self.counters, self.latch = self.link.counters, self.link._latch
        self._rows = {system_id: row for row, system_id in enumerate(system_ids)}
        self.link.observe(self._note)

    def _note(self, _time_s: float, direction: FrameDirection, raw: bytes, _system_id: int) -> None:
        if direction is FrameDirection.RECEIVED:
            self.delivered += split(raw).frames

    def open(self) -> None:
        self.link._ports.open()
        self.link._forwarding.open()

    def close(self) -> None:
        self.link._forwarding.close()
        self.link._ports.close()

    def receive(self) -> None:
        self.link._receive()

    def send(self, data: bytes) -> None:
        """Frames of ours, one by one, each to its target; setpoints as those of a tick at this moment."""
        for frame in split(data).frames:
            row, now_s = np.array([self._rows[target_system(frame)]]), time.monotonic()
            if frame.message_id in SETPOINT_MESSAGES:
                self.link.outbox.send(joined([frame.raw]), row, now_s, until_s=now_s + 60.0)
            else:
                self.link.outbox.send_raw([frame.raw], row, now_s)

    def broadcast(self) -> None:
        """Send our heartbeat."""
        self.link.outbox.broadcast(HEARTBEAT, heartbeats(1), time.monotonic())

    def address(self, system_id: int) -> Address | None:
        source = int(self.link._addresses.source[self._rows[system_id]])
        return None if source < 0 else self.link._ports.address(source)

    async def keep_receiving(self) -> None:
        while True:
            self.receive()
            await asyncio.sleep(0.002)


@asynccontextmanager
async def bench(
    *system_ids: int,
    port_count: int = 1,
    listen: Place | Sequence[Place] | None = None,
    signing: Signing | None = None,
    forward: Sequence[Forward] = (),
) -> AsyncIterator[Bench]:
    """Run a link, by default on free UDP ports."""
    place = listen or Listen("127.0.0.1", free_ports(port_count), port_count)
    made = Bench(place, system_ids, signing, forward)
    made.open()
    receiving = asyncio.create_task(made.keep_receiving())
    try:
        yield made
    finally:
        receiving.cancel()
        made.close()


def a_socket() -> closing[socket.socket]:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    made.setblocking(False)
    return closing(made)


def beat(system_id: int, autopilot: int = 12) -> bytes:
    packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
    return bytes(dialect.MAVLink_heartbeat_message(2, autopilot, 0x81, 6 << 16, 4, 3).pack(packer))


def is_our_heartbeat(data: bytes) -> bool:
    """Whether this is one heartbeat of ours."""
    return [(frame.message_id, frame.system_id) for frame in split(data).frames] == [(0, 254)]


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
