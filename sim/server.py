"""The fleet on real UDP sockets and the real clock. Thin: all behaviour is in sim.fleet and below."""

from __future__ import annotations

import asyncio
import signal
import time
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from sim.fleet import STEP_S, Fleet, Settings

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sim.autopilot import Autopilot
    from sim.truth import TruthFile

Address: TypeAlias = tuple[str, int]

HOST = "127.0.0.1"
CATCH_UP_S = 0.25  # a longer stall is dropped, as if the vehicles had been paused
PEER_SILENT_AFTER_S = 3.0
DATAGRAM_LENGTH = 1400


class PortError(OSError):
    """A vehicle's port cannot be opened; the message names it."""


@dataclass(frozen=True, slots=True)
class Port:
    """One vehicle's side of a link: where it binds (0: anywhere) and whom it talks to unasked."""

    bind: int
    destination: int


class Endpoint(asyncio.DatagramProtocol):
    """One vehicle's socket.

    Until someone has spoken, the vehicle talks to its destination. Then it talks to whoever spoke first,
    until that one has been silent for a while; others get the answers to what they send.
    """

    def __init__(self, autopilot: Autopilot, fleet: Fleet, destination: Address) -> None:
        """Serve one autopilot of the fleet."""
        self._autopilot = autopilot
        self._fleet = fleet
        self._peer = destination
        self._heard_s = -PEER_SILENT_AFTER_S
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:  # type: ignore[override]
        """Keep the socket."""
        self._transport = transport

    def datagram_received(self, data: bytes, addr: Address) -> None:
        """Hand it to the autopilot; answer at once, as PX4 does within milliseconds."""
        now_s = self._fleet.time_s
        if not self._autopilot.receive(data, now_s):
            return
        if addr == self._peer or now_s - self._heard_s >= PEER_SILENT_AFTER_S:
            self._peer, self._heard_s = addr, now_s
        frames = self._autopilot.take_frames(now_s, streams=False)
        self._send(frames, self._peer)
        if addr != self._peer:
            self._send(frames, addr)

    def error_received(self, exc: Exception) -> None:
        """Nobody listens there (ICMP): a vehicle goes on talking."""

    def send_due(self) -> None:
        """Send what the autopilot has to say now."""
        self._send(self._autopilot.take_frames(self._fleet.time_s), self._peer)

    def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.close()

    def _send(self, frames: Sequence[bytes], address: Address) -> None:
        """Several frames share a datagram, as PX4 does."""
        if self._transport is None or self._transport.is_closing():
            return
        packet = b""
        for frame in frames:
            if len(packet) + len(frame) > DATAGRAM_LENGTH:
                self._transport.sendto(packet, address)
                packet = b""
            packet += frame
        if packet:
            self._transport.sendto(packet, address)


async def serve(settings: Settings, ports: Sequence[Port], truth: TruthFile | None, greeting: str) -> None:
    """Fly the fleet until SIGINT or SIGTERM; print the greeting when it can be reached.

    Raises:
        PortError: a port is taken.
    """
    loop = asyncio.get_running_loop()
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    fleet = Fleet(settings, start_s=time.monotonic(), unix_at_start_s=time.time())
    endpoints: list[Endpoint] = []
    try:
        for autopilot, port in zip(fleet.autopilots, ports, strict=True):
            make = partial(Endpoint, autopilot, fleet, (HOST, port.destination))
            try:
                _, endpoint = await loop.create_datagram_endpoint(make, local_addr=(HOST, port.bind))
            except OSError as error:
                raise PortError(f"udp port {port.bind}: {error.strerror}") from error
            endpoints.append(endpoint)
        print(greeting, flush=True)  # noqa: T201 - the command's output
        await _fly(fleet, endpoints, truth, stop)
    finally:
        for endpoint in endpoints:
            endpoint.close()


async def _fly(
    fleet: Fleet, endpoints: Sequence[Endpoint], truth: TruthFile | None, stop: asyncio.Event
) -> None:
    """Step the fleet in time with the clock: whole steps, so nothing drifts; long stalls are dropped."""
    dropped_s = time.monotonic() - fleet.time_s
    while not stop.is_set():
        behind_s = time.monotonic() - dropped_s - fleet.time_s
        if behind_s > CATCH_UP_S:
            dropped_s += behind_s
            behind_s = 0.0
        for _ in range(int(behind_s / STEP_S)):
            fleet.step()
            for endpoint in endpoints:
                endpoint.send_due()
            if truth is not None:
                truth.offer(fleet, fleet.time_s + dropped_s)
        await asyncio.sleep(max(fleet.time_s + STEP_S + dropped_s - time.monotonic(), 0.0))
