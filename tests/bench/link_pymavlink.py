"""pymavlink, message by message on plain sockets, for `links.py` to compare with: nothing of ours between."""

import contextlib
import socket
import time
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from tests.bench.link_measures import (
    EACH,
    FIRST_PORT,
    MEETING_S,
    CannotError,
    Cost,
    Fleet,
    Window,
    flying,
    namespaces,
)
from tests.bench.link_traffic import HOST

VELOCITY_AND_YAW = 0x9C7


class Station:
    """Receives from vehicles, and sends to those."""

    def __init__(self, count: int) -> None:
        self.sent = 0
        self.met_s: dict[tuple[int, int], float] = {}
        self._sockets = [_bound(FIRST_PORT + index) for index in range(namespaces(count))]
        self._packer, self._parser = dialect.MAVLink(None, 254, 190), dialect.MAVLink(None)
        self._parser.robust_parsing = True
        self._beating: set[tuple[int, int]] = set()
        self._places: dict[tuple[int, int], Any] = {}
        self._addresses: dict[int, Any] = {}

    def close(self) -> None:
        for bound in self._sockets:
            bound.close()

    def read(self) -> None:
        """Everything that waits in the sockets."""
        for index, bound in enumerate(self._sockets):
            with contextlib.suppress(BlockingIOError):
                while True:
                    data, self._addresses[index] = bound.recvfrom(2048)
                    self._take(index, data)

    def _take(self, index: int, data: bytes) -> None:
        for message in self._parser.parse_buffer(data) or ():
            kind, key = message.get_type(), (index, message.get_srcSystem())
            if kind == "HEARTBEAT":
                self._beating.add(key)
            elif kind == "GLOBAL_POSITION_INT":
                self._places[key] = message
            if key in self._beating and key in self._places:
                self.met_s.setdefault(key, time.monotonic())

    def send(self) -> None:
        """A setpoint to every vehicle with a position; its yaw returns the position's stamp."""
        for (index, system_id), place in self._places.items():
            message = dialect.MAVLink_set_position_target_local_ned_message(
                0, system_id, 1, 1, VELOCITY_AND_YAW, 0, 0, 0, 0.1, 0.2, 0.0, 0, 0, 0,
                place.relative_alt * 1e-3, 0,
            )  # fmt: skip
            self._sockets[index].sendto(message.pack(self._packer), self._addresses[index])
            self.sent += 1


def _bound(port: int) -> socket.socket:
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    bound.bind((HOST, port))
    bound.setblocking(False)
    return bound


def per_message(fleet: Fleet, count: int, rate_hz: float) -> Cost:
    """Fly them; what is sent is always the same, no law and no safety."""
    station, window = Station(count), Window(fleet)
    start_s, tick = time.monotonic(), 0
    while window.goes_on(station.sent):
        station.read()
        station.send()
        tick += 1
        time.sleep(max(0.0, start_s + tick / rate_hz - time.monotonic()))
    station.close()
    return window.cost()


def connecting_s(count: int) -> float:
    """The longest time from a vehicle's first heartbeat until it has a position."""
    station = Station(count)
    with flying(min(EACH, count)) as fleet:
        until_s = time.monotonic() + MEETING_S
        while len(station.met_s) < count:
            if time.monotonic() > until_s:
                raise CannotError(f"has met {len(station.met_s)} of {count} within {MEETING_S:.0f} s")
            station.read()
            time.sleep(0.02)
    station.close()
    return fleet.connecting_s([(*key, when_s) for key, when_s in station.met_s.items()])
