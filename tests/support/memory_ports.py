"""Ports of a link in memory, for one vehicle that is written by the test."""

from collections.abc import Callable
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.links.endpoints.ports import Datagrams, Ports, host_number, source_of
from gcs.mavlink.kernels import Bytes, Whole

VEHICLE_AT = source_of(host_number("10.0.0.1"), 14550, 0)


class MemoryPorts(Ports):
    """Attributes: sent: messages to the vehicle, decoded, oldest first, each with its time."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.send_errors = self.no_room = 0
        self.sent: list[tuple[float, Any]] = []
        self._clock, self._arrived = clock, list[tuple[float, bytes]]()
        self._reader, self._sender = dialect.MAVLink(None), dialect.MAVLink(None, srcSystem=1, srcComponent=1)

    def open(self) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """Nothing to close."""

    def say(self, *messages: Any) -> None:
        """Let the vehicle, system 1, send these."""
        self._arrived += [(self._clock(), bytes(each.pack(self._sender))) for each in messages]

    def of_kind(self, name: str) -> list[Any]:
        return [message for _, message in self.sent if message.get_type() == name]

    def receive(self, take: Callable[[Datagrams], None]) -> None:
        arrived, self._arrived = self._arrived, []
        if arrived:
            length = np.array([len(raw) for _, raw in arrived])
            data = np.frombuffer(bytearray(b"".join(raw for _, raw in arrived)), np.uint8)
            time_s = np.array([at_s for at_s, _ in arrived])
            start = np.cumsum(length) - length
            take(Datagrams(data, start, length, np.full(len(arrived), VEHICLE_AT), time_s))

    def send(
        self, data: Bytes, length: Whole, destination: Whole, *, until_s: float = inf
    ) -> NDArray[np.bool_]:
        left: NDArray[np.bool_] = (destination == VEHICLE_AT) & (self._clock() <= until_s)
        for row in np.flatnonzero(left).tolist():
            (message,) = self._reader.parse_buffer(bytes(data[row, : length[row]]))
            self.sent.append((self._clock(), message))
        return left
