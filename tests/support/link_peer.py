"""A minimal vehicle: real MAVLink frames over a real UDP socket, from its own thread.

It obeys at once and has no dynamics; the fake fleet of `sim` flies. Unlike the fake fleet it can share a
system id, fall silent, refuse commands, and keep every frame that it received.
"""

import socket
import struct
import threading
import time
from types import TracebackType
from typing import Any, Self

from pymavlink.dialects.v20 import common as dialect

PREARM = 0x10000000
GYRO_ACCEL_MAG_GPS = 0x1 | 0x2 | 0x4 | 0x20
FIRST_BEATS_S = 0.1
"""Between heartbeats until the ground has said something: no vehicle waits to be discovered."""

SO_TIMESTAMPNS, TIMESPEC = 35, struct.Struct("@qq")
HOLD, OFFBOARD, TAKEOFF, LAND, RETURN = (4, 3), (6, 0), (4, 2), (4, 6), (4, 5)


class Peer:
    """One PX4-like vehicle, sending to `port` on this host until closed."""

    def __init__(
        self,
        port: int,
        system_id: int,
        *,
        refuses: bool = False,
        answers: bool = True,
        position_s: float = 0.02,
        beat_s: float = 1.0,
    ) -> None:
        self.system_id = system_id
        self.refuses = refuses
        self.answers = answers  # to commands; its streams go on
        self.acknowledges = True
        self.speaks = True
        self.armed = False
        self.mode = HOLD
        self.landed = 1
        self.latitude_deg = 47.4
        self.boot_s = time.monotonic() - 1.0
        self._position_period_s = position_s
        self._beat_period_s = beat_s
        self.received: list[tuple[float, Any]] = []
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.01)
        self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self._ground = ("127.0.0.1", port)
        self._packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
        self._parser = dialect.MAVLink(None)
        self._parser.robust_parsing = True
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._live, name=f"peer/{system_id}")
        self._thread.start()

    @property
    def port(self) -> int:
        """The local port."""
        port: int = self._socket.getsockname()[1]
        return port

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopped.set()
        self._thread.join()
        self._socket.close()

    def messages(self, name: str) -> list[tuple[float, Any]]:
        """Arrival time and message of every received message of one type.

        The times are the kernel's, not those of reading.
        """
        return [(time_s, message) for time_s, message in list(self.received) if message.get_type() == name]

    def send(self, message: Any) -> None:
        """Send one message now."""
        self.send_bytes(message.pack(self._packer))

    def send_bytes(self, data: bytes) -> None:
        """Send these bytes."""
        self._socket.sendto(data, self._ground)

    def say(self, text: str) -> None:
        """Send a status text."""
        self.send(dialect.MAVLink_statustext_message(4, text.encode()))

    def beat(self) -> None:
        """Send a heartbeat."""
        main, sub = self.mode
        self.send(dialect.MAVLink_heartbeat_message(2, 12, 1 | self.armed << 7, main << 16 | sub << 24, 4, 3))

    def _live(self) -> None:
        beat_s = status_s = position_s = 0.0
        while not self._stopped.is_set():
            now_s = time.monotonic()
            if self.speaks and now_s >= beat_s:
                beat_s = now_s + (self._beat_period_s if self.received else FIRST_BEATS_S)
                self.beat()
            if self.speaks and now_s >= status_s:
                status_s = now_s + 0.2
                self._send_status()
            if self.speaks and now_s >= position_s:
                position_s = now_s + self._position_period_s
                self._send_position()
            self._listen()

    def _listen(self) -> None:
        try:
            data, ancillary, *_ = self._socket.recvmsg(2048, 64)
        except TimeoutError:
            return
        arrived_s = _arrived_s(ancillary)
        for message in self._parser.parse_buffer(data) or []:
            self.received.append((arrived_s, message))
            if self.answers:
                self._answer(message)

    def _send_status(self) -> None:
        health = PREARM | GYRO_ACCEL_MAG_GPS
        self.send(
            dialect.MAVLink_sys_status_message(health, health, health, 0, 16000, 0, 80, 0, 0, 0, 0, 0, 0)
        )
        self.send(dialect.MAVLink_extended_sys_state_message(0, self.landed))
        self.send(
            dialect.MAVLink_battery_status_message(
                0, 0, 0, 0, [4000] * 4 + [65535] * 6, -1, -1, -1, 80, 0, 0, [0] * 4, 0, 0
            )
        )
        quaternion = [1.0, 0.0, 0.0, 0.0]
        home = (int(self.latitude_deg * 1e7), 85000000, 500000, 0.0, 0.0, 0.0, quaternion, 0.0, 0.0, 0.0)
        self.send(dialect.MAVLink_home_position_message(*home))

    def _send_position(self) -> None:
        latitude = round(self.latitude_deg * 1e7)
        boot_ms = round((time.monotonic() - self.boot_s) * 1000)
        self.send(
            dialect.MAVLink_global_position_int_message(
                boot_ms, latitude, 85000000, 500000, 0, 150, -20, 30, 9000
            )
        )

    def _answer(self, message: Any) -> None:
        name = message.get_type()
        if name == "COMMAND_LONG":
            self._obey(message)
        elif name == "PARAM_SET":
            self.send(
                dialect.MAVLink_param_value_message(
                    message.param_id.encode(), message.param_value, message.param_type, 1, 0
                )
            )

    def _obey(self, message: Any) -> None:
        command = message.command
        before = (self.armed, self.mode)
        asked_only = command in {511, 512, 520}
        result = 3 if asked_only else 2 if self.refuses else 0
        if result == 0:
            self._change(command, message)
        ack = dialect.MAVLink_command_ack_message(
            command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
        )
        if self.acknowledges:
            self.send(ack)
        if result == 2:
            self.say("Arming denied: the test says so")
        if before != (self.armed, self.mode):
            self.beat()

    def _change(self, command: int, message: Any) -> None:
        if command == dialect.MAV_CMD_COMPONENT_ARM_DISARM:
            self.armed = message.param1 == 1
        elif command == dialect.MAV_CMD_DO_SET_MODE:
            self.mode = (int(message.param2), int(message.param3))
        elif command == dialect.MAV_CMD_NAV_TAKEOFF:
            self.mode, self.landed = TAKEOFF, 3
        elif command == dialect.MAV_CMD_NAV_LAND:
            self.mode, self.landed = LAND, 4
        elif command == dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            self.mode = RETURN


def _arrived_s(ancillary: list[tuple[int, int, bytes]]) -> float:
    """Arrival time on the monotonic clock, read without a pause of the machine between the two readings."""
    ((_, _, stamp),) = ancillary
    seconds, nanoseconds = TIMESPEC.unpack(stamp)
    while True:
        now_s, wall_s, later_s = time.monotonic(), time.time(), time.monotonic()
        if later_s - now_s < 0.001:
            arrived_s: float = now_s - (wall_s - (seconds + nanoseconds * 1e-9))
            return arrived_s
