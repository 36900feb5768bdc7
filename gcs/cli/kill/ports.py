"""Ports of a kill without the service. They load and open at once, and never wait.

A port that the service holds is replaced by any free one: the commands leave, and answers go to the service.
"""

import re
import socket
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Final, Protocol

from gcs.cli.kill.plan import KillLink
from gcs.model.errors import ConfigError

if TYPE_CHECKING:
    from gcs.links.endpoints.channels import Channel, Dial

Address = tuple[str, int]
"""Host and port; of a stream a name and a number that distinguish it."""

RETRY_S: Final = 0.5
READS_MAX: Final = 256
"""Datagrams or pieces in one turn: a flood must not keep commands from being sent."""

_URL: Final = re.compile(r"(udpin|udpout|tcpin|tcpout)://([^:/]+):(\d{1,5})|serial://([^:]+):(\d{1,8})")


class Port(Protocol):
    """One socket, or one port with its connections."""

    is_stream: bool
    problem: str

    def open(self) -> None: ...

    def close(self) -> None: ...

    def receive(self) -> Iterable[tuple[bytes, Address]]:
        """What has arrived, without waiting."""

    def send(self, data: bytes, to: Address) -> None:
        """Raises: OSError."""

    def standing(self) -> Sequence[Address]:
        """Where vehicles can be before any was received."""


class UdpPort:
    """A UDP port of ours."""

    is_stream = False

    def __init__(self, host: str, port: int, far: Sequence[Address] = ()) -> None:
        """`port` 0: any free one; `far` are the far ends that wait for a first datagram."""
        self.problem = ""
        self._at = (host, port)
        self._far = far
        self._socket: socket.socket

    def open(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(self._at)
        except OSError as error:
            host, port = self._at
            self.problem = f"UDP port {port} on {host}: {error.strerror}: does a service hold it?"

    def close(self) -> None:
        self._socket.close()

    def receive(self) -> Iterable[tuple[bytes, Address]]:
        for _ in range(READS_MAX):
            try:
                yield self._socket.recvfrom(2048)
            except BlockingIOError:
                return
            except OSError:  # ICMP: no process listens at one of the addresses
                continue

    def send(self, data: bytes, to: Address) -> None:
        self._socket.sendto(data, to)

    def standing(self) -> Sequence[Address]:
        return self._far


class KillStreamPort:
    """A TCP server, or whatever is dialled: a TCP client, a serial device."""

    is_stream = True

    def __init__(self, name: str, dial: "Dial | None", at: Address | None = None) -> None:
        """Without `dial` it listens `at` an address."""
        self.problem = ""
        self._name = name
        self._dial = dial
        self._at = at
        self._listening: socket.socket | None = None
        self._streams: dict[Address, Channel] = {}
        self._retry_s = 0.0

    def open(self) -> None:
        if self._at is not None:
            from gcs.links.endpoints.channels import listen  # noqa: PLC0415 (numpy, of its package)

            try:
                self._listening = listen(*self._at)
            except (OSError, OverflowError) as error:
                self.problem = f"{self._name}: {error}: does a service hold it?"

    def close(self) -> None:
        if self._dial is not None:
            self._dial.cancel()
        if self._listening is not None:
            self._listening.close()
        for stream in self._streams.values():
            stream.close()

    def receive(self) -> Iterable[tuple[bytes, Address]]:
        self._connect()
        for at, stream in tuple(self._streams.items()):
            try:
                data = stream.read(4096)
            except BlockingIOError:
                continue
            except OSError as error:
                self._lost(at, str(error))
                continue
            if data:
                yield data, at
            else:
                self._lost(at, "ended by the far end")

    def send(self, data: bytes, to: Address) -> None:
        stream = self._streams.get(to)
        if stream is None:
            raise ConnectionError("not connected")
        if stream.write(data) < len(data):
            raise BlockingIOError("no room")

    def standing(self) -> Sequence[Address]:
        return [*self._streams]

    def _connect(self) -> None:
        from gcs.links.endpoints.channels import SocketChannel  # noqa: PLC0415 (numpy, of its package)

        if self._listening is not None:
            with suppress(OSError):
                connected, at = self._listening.accept()
                self._streams[at] = SocketChannel(connected)
        if self._dial is None or self._streams or time.monotonic() < self._retry_s:
            return
        try:
            channel = self._dial(time.monotonic())
        except OSError as error:
            self.problem = f"{self._name}: {error}"
            self._retry_s = time.monotonic() + RETRY_S
            return
        if channel is not None:
            self.problem = ""
            self._streams[self._name, 0] = channel

    def _lost(self, at: Address, cause: str) -> None:
        self._streams.pop(at).close()
        self.problem = f"{self._name}: {cause}"
        self._retry_s = time.monotonic() + RETRY_S


def ports_of(link: KillLink) -> list[Port]:
    """The ports of a link, not opened yet; UDP ports come first. Raises: ConfigError."""
    found = [port for url in link.urls for port in _ports(url, link.ports)]
    return sorted(found, key=lambda port: port.is_stream)


def _ports(url: str, count: int) -> list[Port]:
    match = _URL.fullmatch(url)
    if match is None:
        raise ConfigError(f"{url}: no place of a link")
    kind, host, port, device, baud = match.groups()
    if kind == "udpin":
        return [UdpPort(host, int(port) + at) for at in range(count)]
    if kind == "udpout":
        return [UdpPort("0.0.0.0", 0, [(host, int(port) + at)]) for at in range(count)]  # noqa: S104
    from gcs.links.endpoints.channels import SerialDial, TcpDial  # noqa: PLC0415 (numpy, of its package)

    if kind == "tcpin":
        return [KillStreamPort(url, None, (host, int(port)))]
    return [KillStreamPort(url, TcpDial(host, int(port)) if kind else SerialDial(device, int(baud)))]
