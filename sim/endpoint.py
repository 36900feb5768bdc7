"""The fleet on UDP sockets and the real clock: ports, peers, links with faults, and fault commands."""

import os
import selectors
import signal
import socket
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from itertools import groupby
from typing import TypeAlias

from gcs.sim.faults.commands import LONGEST_LINE
from gcs.sim.faults.injector import FaultInjector
from gcs.sim.fleet import STEP_S
from gcs.sim.ground_truth import HOST, GroundTruthFile, SimulatorLink
from gcs.sim.mixed import AnyFleet, fleet_of
from gcs.sim.protocol.frames import SETPOINT, SETPOINT_FRAME
from gcs.sim.settings import Settings

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


def _bound(host: str, port: int, buffer: int = 0) -> socket.socket:
    """A UDP socket that never blocks. Raises: PortError when the port is taken."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bound.setblocking(False)
    for option in (socket.SO_RCVBUF, socket.SO_SNDBUF) if buffer else ():
        bound.setsockopt(socket.SOL_SOCKET, option, buffer)
    try:
        bound.bind((host, port))
    except OSError as error:
        bound.close()
        raise PortError(f"udp port {port}: {error.strerror}") from error
    return bound


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
        self._socket = _bound(host, port.bind, BUFFER if len(port.rows) > 1 else 0)
        self.fileno, self.close = self._socket.fileno, self._socket.close

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

    fleet: AnyFleet
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
            system_id = self.fleet.autopilots[row].system_id
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


class StandardInput:
    """Newline-delimited JSON on this process's standard input; answers on its standard output."""

    _part = b""

    def fileno(self) -> int:
        return sys.stdin.fileno()

    def read(self, fault_injector: FaultInjector) -> bool:
        data = os.read(self.fileno(), LARGEST)
        *lines, self._part = (self._part + data).split(b"\n")
        if len(self._part) > LONGEST_LINE or (not data and self._part):
            lines.append(self._part)
            self._part = b""
        for line in lines:
            if line.strip():
                print(fault_injector.obey(line), flush=True)  # noqa: T201 - the command's output
        return bool(data)


class ControlPort:
    """The same commands in UDP datagrams, answered to the sender."""

    def __init__(self, host: str, port: int) -> None:
        """Open it. Raises: PortError when the port is taken."""
        self._socket = _bound(host, port)
        self.fileno, self.close = self._socket.fileno, self._socket.close

    def read(self, fault_injector: FaultInjector) -> bool:
        try:
            data, sender = self._socket.recvfrom(LARGEST)
            answers = [fault_injector.obey(line) for line in data.split(b"\n") if line.strip()]
            if answers:
                self._socket.sendto("\n".join(answers).encode() + b"\n", sender)
        except OSError:  # ICMP: the sender no longer listens
            pass
        return True


CATCH_UP_S = 0.25  # a longer stall is dropped, as if the vehicles had been paused
REST_S = 0.002  # time in which datagrams of a continuous flow gather; PX4 answers in 1 to 4 ms
STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def noted_stops(stack: ExitStack) -> list[int]:
    """Requests to stop, as they come; until the stack is closed."""
    stops: list[int] = []
    for number in STOPS:
        if number == signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN:  # nohup
            continue
        before = signal.signal(number, lambda signum, _: stops.append(signum))
        stack.callback(signal.signal, number, before)
    return stops


def serve(
    settings: Settings,
    ports: Sequence[Port],
    truth: GroundTruthFile | None,
    greeting: str,
    *,
    control_port: int | None = None,
    control_input: bool = False,
    simulator_port: int | None = None,
) -> None:
    """Fly the fleet until SIGINT, SIGTERM or SIGHUP; print the greeting when it can be reached.

    With `simulator_port`, vehicle i sends its true state to that port + i, as PX4's SIH does.

    Raises: PortError when a port is taken.
    """
    with ExitStack() as stack:
        stops = noted_stops(stack)
        fleet = fleet_of(settings, start_s=time.monotonic(), unix_at_start_s=time.time())
        fault_injector = FaultInjector(fleet)
        endpoints = [
            stack.enter_context(closing(Endpoint(HOST, port, fleet.receiver.circle(port.rows))))
            for port in ports
        ]
        controls: list[StandardInput | ControlPort] = []
        if control_port is not None:
            controls.append(stack.enter_context(closing(ControlPort(HOST, control_port))))
        if control_input:
            controls.append(StandardInput())
        simulator = None
        if simulator_port is not None:
            simulator = stack.enter_context(closing(SimulatorLink(simulator_port, settings.count)))
        selector = stack.enter_context(selectors.DefaultSelector())
        for endpoint in endpoints:
            selector.register(endpoint, selectors.EVENT_READ, endpoint)
        for control in controls:
            try:
                selector.register(control, selectors.EVENT_READ, control)
            except PermissionError:  # a file cannot be waited for: its commands are executed now
                while control.read(fault_injector):
                    pass
        print(greeting, flush=True)  # noqa: T201 - the command's output
        radio = Radio(fleet, fault_injector, endpoints)
        for waited_s in _paced(fleet, radio, fault_injector, truth, simulator, stops):
            _read(selector, waited_s, radio, fault_injector)


def _paced(
    fleet: AnyFleet,
    radio: Radio,
    fault_injector: FaultInjector,
    truth: GroundTruthFile | None,
    simulator: SimulatorLink | None,
    stops: Sequence[int],
) -> Iterator[float]:
    """Step the fleet in time with the clock: whole steps, so nothing drifts; long stalls are dropped.

    Yields: how long to wait for datagrams.
    """
    dropped_s = time.monotonic() - fleet.time_s
    while not stops:
        behind_s = time.monotonic() - dropped_s - fleet.time_s
        if behind_s > CATCH_UP_S:
            dropped_s += behind_s - STEP_S
            fleet.skip(behind_s - STEP_S)  # GPS time continues
            behind_s = STEP_S  # at least one step: a machine that is always late still flies, slowly
        for _ in range(int(behind_s / STEP_S + 1e-9)):
            fleet.step()
            fault_injector.pass_time()
            radio.send()
            if fault_injector.broken:
                radio.deliver()
            if truth is not None:
                truth.offer(fleet, fleet.time_s + dropped_s)
            if simulator is not None:
                simulator.offer(fleet, fleet.time_s)
        yield max(fleet.time_s + STEP_S + dropped_s - time.monotonic(), 0.0)


def _read(
    selector: selectors.BaseSelector, wait_s: float, radio: Radio, fault_injector: FaultInjector
) -> None:
    """Wait for datagrams until the next step at most, then give more of them a moment to gather."""
    if not (ready := selector.select(wait_s)):
        return
    readers = [key.data for key, _ in ready]
    for reader in readers:
        if not isinstance(reader, Endpoint) and not reader.read(fault_injector):
            selector.unregister(reader)
    radio.receive([reader for reader in readers if isinstance(reader, Endpoint)])
    if wait_s > REST_S:
        time.sleep(REST_S)
