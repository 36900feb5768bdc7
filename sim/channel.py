"""Carries datagrams between sockets and vehicles; links with faults pass through their fault models."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.sim.protocol.frames import SETPOINT, SETPOINT_FRAME

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gcs.sim.endpoint import Address, Endpoint
    from gcs.sim.faults.injector import FaultInjector
    from gcs.sim.fleet import Fleet

SETPOINT_ID = SETPOINT.id.to_bytes(3, "little")
TARGET_AT = 10 + 50  # header, and the fields before target_system


class Radio:
    """Carries datagrams both ways for all endpoints."""

    def __init__(self, fleet: Fleet, fault_injector: FaultInjector, endpoints: Sequence[Endpoint]) -> None:
        """Every vehicle of the fleet is behind one of the endpoints."""
        self._fleet = fleet
        self._fault_injector = fault_injector
        self._endpoints = endpoints
        self._by_row = {row: endpoint for endpoint in endpoints for row in endpoint.rows}
        self._changes = 0
        self._apart: dict[Endpoint, list[tuple[int, int]]] = {}

    def listen(self, ready: Sequence[Endpoint]) -> None:
        """Read the ready endpoints; answer at once, as PX4 does within milliseconds."""
        fleet, broken = self._fleet, self._fault_injector.broken
        if self._changes != self._fault_injector.changes:
            self._part()
        batch: list[tuple[int, bytes]] = []
        origins: list[tuple[Endpoint, Address]] = []
        for endpoint in ready:
            for datagram, address in endpoint.read():
                batch.append((endpoint.circle, datagram))
                origins.append((endpoint, address))
                for row, system_id in self._apart.get(endpoint, ()):
                    if _concerns(datagram, system_id):
                        broken[row].into.put(datagram, (endpoint, address), fleet.time_s)
        self._hear(batch, origins)
        self.deliver()

    def deliver(self) -> None:
        """Process what links with faults have let through by now, and send all answers."""
        batch: list[tuple[int, bytes]] = []
        origins: list[tuple[Endpoint, Address]] = []
        for row, channel in self._fault_injector.broken.items():
            for datagram, origin in channel.into.take(self._fleet.time_s):
                batch.append((row, datagram))
                origins.append(origin)
        self._hear(batch, origins)
        stated = self._fleet.take_frames(streams=False)
        if stated:
            self._speak(stated, answers=True)
        for endpoint in self._endpoints if stated else ():
            endpoint.answered()

    def speak(self) -> None:
        """Send everything that is due."""
        self._speak(self._fleet.take_frames(), answers=False)

    def _hear(self, batch: list[tuple[int, bytes]], origins: list[tuple[Endpoint, Address]]) -> None:
        if not batch:
            return
        sound = self._fleet.receiver.hear(batch)
        for (endpoint, address), is_sound in zip(origins, sound, strict=True):
            if is_sound:
                endpoint.received(address, self._fleet.time_s)

    def _speak(self, stated: dict[int, list[bytes]], *, answers: bool) -> None:
        now_s, broken = self._fleet.time_s, self._fault_injector.broken
        for row in broken:
            frames = stated.pop(row, None)
            if frames:
                broken[row].out.put(b"".join(frames), None, now_s)
        together: dict[Endpoint, list[bytes]] = {}
        for row, frames in stated.items():
            together.setdefault(self._by_row[row], []).extend(frames)
        for endpoint, frames in together.items():
            if answers:
                endpoint.answer(frames)
            else:
                endpoint.send(frames)
        for row, channel in broken.items():
            endpoint = self._by_row[row]
            for packet, _ in channel.out.take(now_s):
                endpoint.send_alone(packet)
            for garbage in channel.jammer.take(now_s):
                endpoint.send_alone(garbage)

    def _part(self) -> None:
        """Separate vehicles with link faults: they receive datagrams only through their fault models."""
        self._changes = self._fault_injector.changes
        self._apart = {}
        for row in self._fault_injector.broken:
            system_id = int(self._fleet.state.system_id[row])
            self._apart.setdefault(self._by_row[row], []).append((row, system_id))
        for endpoint in self._endpoints:
            self._fleet.receiver.regroup(
                endpoint.circle, [row for row in endpoint.rows if row not in self._fault_injector.broken]
            )


def _concerns(datagram: bytes, system_id: int) -> bool:
    """False for a setpoint for another vehicle: most of what a shared socket receives."""
    if len(datagram) != SETPOINT_FRAME or datagram[7:10] != SETPOINT_ID:
        return True
    return datagram[TARGET_AT] in {0, system_id}
