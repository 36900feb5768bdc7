"""A UDP socket with vehicles behind it, and the peer that they send to."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterable

    from gcs.sim.ports import Port

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

        Raises:
            PortError: the port is taken.
        """
        self.rows = port.rows
        self.circle = circle
        self._peer = (host, port.destination)
        self._received_s = -PEER_SILENT_AFTER_S
        self._askers: set[Address] = set()
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
        """File descriptor of the socket."""
        return self._socket.fileno()

    def read(self) -> list[tuple[bytes, Address]]:
        """The datagrams that have arrived, with their senders."""
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
        """Record the sender of a valid frame."""
        if address == self._peer or now_s - self._received_s >= PEER_SILENT_AFTER_S:
            self._peer, self._received_s = address, now_s
        else:
            self._askers.add(address)

    def answer(self, frames: Iterable[bytes]) -> None:
        """Send answers: to the peer, and to other senders since the last answers."""
        packets = _packed(frames)
        for address in (self._peer, *self._askers):
            self._send(packets, address)

    def send(self, frames: Iterable[bytes]) -> None:
        """Send to the peer."""
        self._send(_packed(frames), self._peer)

    def send_alone(self, datagram: bytes) -> None:
        """Send to the peer a datagram that must not be combined with others."""
        self._send([datagram], self._peer)

    def answered(self) -> None:
        """Forget the other senders."""
        self._askers.clear()

    def close(self) -> None:
        """Close the socket."""
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
