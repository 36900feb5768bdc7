"""Datagrams of vehicles to the addresses of a link, without a link."""

from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.links.address_book import Addresses
from gcs.links.endpoints.ports import Datagrams
from gcs.links.endpoints.streams import LinkPorts
from gcs.links.link import Counters
from gcs.mavlink.codec import find

PERIOD_S = 0.1
PX4 = dialect.MAV_AUTOPILOT_PX4


class Sender:
    """A component that counts its frames; its boot clock began at `boot_s`."""

    def __init__(
        self, system_id: int = 3, component: int = 1, *, boot_s: float = -100.0, number: int = 0
    ) -> None:
        self.packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=component)
        self.packer.seq, self.boot_s = number, boot_s

    def raw(self, message: Any) -> bytes:
        packed = bytes(message.pack(self.packer))
        self.packer.seq = (self.packer.seq + 1) % 256
        return packed

    def beat(self, autopilot: int = PX4) -> bytes:
        return self.raw(dialect.MAVLink_heartbeat_message(2, autopilot, 0x81, 6 << 16, 4, 3))

    def position(self, time_s: float) -> bytes:
        boot_ms = round(1000 * (time_s - self.boot_s))
        return self.raw(
            dialect.MAVLink_global_position_int_message(boot_ms, 474000000, 85000000, 0, 0, 0, 0, 0, 0)
        )

    def status(self) -> bytes:
        return self.raw(dialect.MAVLink_extended_sys_state_message(0, 1))

    def radio(self) -> bytes:
        return self.raw(dialect.MAVLink_radio_status_message(200, 200, 100, 50, 50, 0, 0))


class Book:
    """Addresses of system ids 3 and 4 (rows 0 and 1), and their clock."""

    def __init__(self) -> None:
        self.now_s, self.counters = 0.0, Counters()
        self.of = Addresses(
            "test", (3, 4), LinkPorts("test", (), lambda: 0.0).address, self.counters, lambda: self.now_s
        )
        self.vehicle = Sender()

    def take(self, raw: bytes, source: int, time_s: float) -> int:
        """One datagram. Returns: number of accepted frames."""
        self.now_s = time_s
        data = np.frombuffer(bytearray(raw), np.uint8)
        start, length = np.zeros(1, np.int64), np.array([len(raw)])
        arrived = Datagrams(data, start, length, np.array([source]), np.array([time_s]))
        return len(self.of.judge(find(data, start, length).frames, arrived)[0])

    def fly(
        self, source: int, begin_s: float, end_s: float, vehicle: Sender | None = None
    ) -> list[tuple[float, int]]:
        """A vehicle's streams. Returns: time and number of accepted frames of each datagram."""
        sender, taken = vehicle or self.vehicle, list[tuple[float, int]]()
        for step in range(round(begin_s / PERIOD_S), round(end_s / PERIOD_S)):
            time_s = step * PERIOD_S
            raw = sender.position(time_s) + sender.status() + (sender.beat() if step % 10 == 0 else b"")
            taken.append((time_s, self.take(raw, source, time_s)))
        return taken
