"""UDP sockets of the vehicles: their ports and peers, and datagrams on links with faults."""

import socket
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TypeAlias

from gcs.sim.faults.injector import FaultInjector
from gcs.sim.fleet import Fleet
from gcs.sim.protocol.frames import SETPOINT, SETPOINT_FRAME

HOST = "127.0.0.1"
PX4_BIND, PX4_DESTINATION, PX4_SHARED_FROM = 14580, 14540, 9
PX4_NAMESPACE_PORTS = 10  # a namespace's destinations are this much below those of the namespace before
MAX_PORT = 65535


@dataclass(frozen=True, slots=True)
class Port:
    """One socket: the port it binds (0: any), its first destination, and the vehicles behind it."""

    bind: int
    destination: int
    rows: tuple[int, ...]


def own_ports(first: int, count: int, namespace_size: int, base: int | None) -> list[Port]:
    """A socket for each vehicle: vehicle i (from 0) sends to base + i, or as PX4 does.

    As PX4: it binds 14580 + i and sends to 14540 + its place in its namespace, from the tenth on all to
    14549; the ports of namespace k are 10 k lower.
    """
    indices = range(first, first + count)
    if base is not None:
        return [Port(0, base + i, (i - first,)) for i in indices]
    ports = []
    for i in indices:
        namespace, place = divmod(i, namespace_size)
        to = PX4_DESTINATION - PX4_NAMESPACE_PORTS * namespace + min(place, PX4_SHARED_FROM)
        ports.append(Port(PX4_BIND + i, to, (i - first,)))
    return ports


def shared_ports(first: int, count: int, namespace_size: int, base: int | None) -> list[Port]:
    """A socket for each namespace, as behind a radio or a router: namespace k sends to base + k.

    Without a base it binds 14580 + k and sends to 14540 + k.
    """
    groups = groupby(range(count), lambda row: (first + row) // namespace_size)
    return [
        Port(PX4_BIND + k, PX4_DESTINATION + k, tuple(rows))
        if base is None
        else Port(0, base + k, tuple(rows))
        for k, rows in groups
    ]


Address: TypeAlias = tuple[str, int]

PEER_SILENT_AFTER_S = 3.0
DATAGRAM_LENGTH = 1400
LARGEST = 65536
READ_MOST = 2000  # datagrams at a time: a flood on one socket does not stop the flight
BUFFER = 1 << 21


class PortError(OSError):
    """A vehicle's port cannot be opened; the message names it."""


class Endpoint:
    """At first the vehicles send to their configured destination.

    Then they send to the first sender, until it has been silent for a while; other senders get the answers to
    their own messages.
    """

    def __init__(self, host: str, port: Port, circle: int) -> None:
        """Open the socket; `circle` is the receiver's number for the vehicles behind it.

        Raises: PortError when the port is taken.
        """
        self.rows = port.rows
        self.circle = circle
        self._peer = (host, port.destination)
        self._received_s = -PEER_SILENT_AFTER_S
        self.other_senders: set[Address] = set()  # since the last answers
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        if len(port.rows) > 1:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
        try:
            self._socket.bind((host, port.bind))
        except OSError as error:
            self._socket.close()
            raise PortError(f"udp port {port.bind}: {error.strerror}") from error

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> list[tuple[bytes, Address]]:
        arrived: list[tuple[bytes, Address]] = []
        receive, keep = self._socket.recvfrom, arrived.append
        try:
            while len(arrived) < READ_MOST:
                keep(receive(LARGEST))
        except BlockingIOError:
            pass
        except OSError:  # ICMP: nothing listens there; a vehicle continues to send
            pass
        return arrived

    def received(self, address: Address, now_s: float) -> None:
        if address == self._peer or now_s - self._received_s >= PEER_SILENT_AFTER_S:
            self._peer, self._received_s = address, now_s
        else:
            self.other_senders.add(address)

    def answer(self, frames: Iterable[bytes]) -> None:
        """Send answers: to the peer, and to other senders since the last answers."""
        packets = _packed(frames)
        for address in (self._peer, *self.other_senders):
            self._send(packets, address)

    def send(self, packets: Iterable[bytes]) -> None:
        """Send datagrams to the peer."""
        self._send(packets, self._peer)

    def close(self) -> None:
        self._socket.close()

    def _send(self, packets: Iterable[bytes], address: Address) -> None:
        for packet in packets:
            try:
                self._socket.sendto(packet, address)
            except BlockingIOError:  # a full buffer loses packets, as radios do
                return
            except OSError:  # ICMP, as above
                continue


def _packed(frames: Iterable[bytes]) -> list[bytes]:
    """Combine frames in datagrams, as PX4 does."""
    whole = b"".join(frames)
    if len(whole) <= DATAGRAM_LENGTH:
        return [whole] if whole else []
    packets, packet = [], b""
    for frame in frames:
        if len(packet) + len(frame) > DATAGRAM_LENGTH and packet:
            packets.append(packet)
            packet = b""
        packet += frame
    packets.append(packet)
    return packets


Origin: TypeAlias = tuple[Endpoint, Address]
"""Source of a datagram."""

SETPOINT_ID = SETPOINT.id.to_bytes(3, "little")
TARGET_AT = 10 + 50  # header, and the fields before target_system


@dataclass(eq=False)
class Radio:
    """Carries datagrams both ways for all endpoints."""

    fleet: Fleet
    fault_injector: FaultInjector
    endpoints: Sequence[Endpoint]

    def __post_init__(self) -> None:
        self._by_row = {row: endpoint for endpoint in self.endpoints for row in endpoint.rows}
        self._changes = 0
        self._separate: dict[Endpoint, list[tuple[int, int]]] = {}

    def receive(self, ready: Sequence[Endpoint]) -> None:
        """Read the ready endpoints; answer at once, as PX4 does within milliseconds."""
        fleet, broken = self.fleet, self.fault_injector.broken
        if self._changes != self.fault_injector.changes:
            self._separate_faulty()
        batch: list[tuple[int, bytes, Origin]] = []
        for endpoint in ready:
            for datagram, address in endpoint.read():
                batch.append((endpoint.circle, datagram, (endpoint, address)))
                for row, system_id in self._separate.get(endpoint, ()):
                    if _concerns(datagram, system_id):
                        broken[row].into.put(datagram, (endpoint, address), fleet.time_s)
        self._receive(batch)
        self.deliver()

    def deliver(self) -> None:
        """Process what links with faults have let through by now, and send all answers."""
        self._receive(
            [
                (row, datagram, origin)
                for row, channel in self.fault_injector.broken.items()
                for datagram, origin in channel.into.take(self.fleet.time_s)
            ]
        )
        sent = self.fleet.take_frames(streams=False)
        if sent:
            self._send(sent, answers=True)
        for endpoint in self.endpoints if sent else ():
            endpoint.other_senders.clear()

    def send(self) -> None:
        self._send(self.fleet.take_frames(), answers=False)

    def _receive(self, batch: list[tuple[int, bytes, Origin]]) -> None:
        if not batch:
            return
        valid = self.fleet.receiver.receive([(circle, datagram) for circle, datagram, _ in batch])
        for (_, _, (endpoint, address)), is_valid in zip(batch, valid, strict=True):
            if is_valid:
                endpoint.received(address, self.fleet.time_s)

    def _send(self, sent: dict[int, list[bytes]], *, answers: bool) -> None:
        now_s, broken = self.fleet.time_s, self.fault_injector.broken
        for row in broken:
            frames = sent.pop(row, None)
            if frames:
                broken[row].out.put(b"".join(frames), None, now_s)
        together: dict[Endpoint, list[bytes]] = {}
        for row, frames in sent.items():
            together.setdefault(self._by_row[row], []).extend(frames)
        for endpoint, frames in together.items():
            if answers:
                endpoint.answer(frames)
            else:
                endpoint.send(_packed(frames))
        for row, channel in broken.items():
            packets = [packet for packet, _ in channel.out.take(now_s)]
            self._by_row[row].send([*packets, *channel.jammer.take(now_s)])

    def _separate_faulty(self) -> None:
        """Separate vehicles with link faults: they receive datagrams only through their fault models."""
        self._changes = self.fault_injector.changes
        self._separate = {}
        for row in self.fault_injector.broken:
            system_id = int(self.fleet.state.system_id[row])
            self._separate.setdefault(self._by_row[row], []).append((row, system_id))
        for endpoint in self.endpoints:
            self.fleet.receiver.regroup(
                endpoint.circle, [row for row in endpoint.rows if row not in self.fault_injector.broken]
            )


def _concerns(datagram: bytes, system_id: int) -> bool:
    """False for a setpoint for another vehicle: most of what a shared socket receives."""
    if len(datagram) != SETPOINT_FRAME or datagram[7:10] != SETPOINT_ID:
        return True
    return datagram[TARGET_AT] in {0, system_id}
