"""A minimal vehicle: real MAVLink frames over a real UDP socket, or another line, from its own thread.

It obeys at once and has no dynamics; the fake fleet of `sim` flies. Unlike the fake fleet it can share a
system id, fall silent, refuse commands, and keep every frame that it received.
"""

import threading
import time
from types import TracebackType
from typing import Any, Self

from pymavlink.dialects.v20 import common as dialect

from tests.support.link_lines import Line, UdpLine

PREARM = 0x10000000
GYRO_ACCEL_MAG_GPS = 0x1 | 0x2 | 0x4 | 0x20
FIRST_BEATS_S = 0.1
"""Between heartbeats until the ground has said something: no vehicle waits to be discovered."""

HOLD, OFFBOARD, TAKEOFF, LAND, RETURN = (4, 3), (6, 0), (4, 2), (4, 6), (4, 5)


class Peer:
    """One PX4-like vehicle, sending to `port` on this host, or over a line, until closed."""

    def __init__(
        self,
        port: int,
        system_id: int,
        *,
        refuses: bool = False,
        answers: bool = True,
        position_s: float = 0.02,
        beat_s: float = 1.0,
        line: Line | None = None,
        key: bytes | None = None,
        signs_as: int = 0,
    ) -> None:
        """With a `key` it signs its frames, and accepts no unsigned ones; `signs_as` is its link id."""
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
        self.parameters: dict[str, tuple[float, int]] = {}  # value as it is sent, and its type
        self.line = UdpLine(port) if line is None else line
        self._packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
        self._parser = dialect.MAVLink(None)
        self._parser.robust_parsing = True
        if key is not None:
            self._packer.signing.secret_key = self._parser.signing.secret_key = key
            self._packer.signing.sign_outgoing = True
            self._packer.signing.link_id = signs_as
            self._packer.signing.timestamp = int((time.time() - 1_420_070_400) * 1e5)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._live, name=f"peer/{system_id}")
        self._thread.start()

    @property
    def port(self) -> int:
        """The local port."""
        return self.line.address[1]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopped.set()
        self._thread.join()
        self.line.close()

    def messages(self, name: str) -> list[tuple[float, Any]]:
        """Arrival time and message of every received message of one type.

        The times are the kernel's, not those of reading.
        """
        return [(time_s, message) for time_s, message in list(self.received) if message.get_type() == name]

    def send(self, message: Any) -> None:
        """Send one message now; the next one has the next number."""
        self.send_bytes(message.pack(self._packer))
        self._packer.seq = (self._packer.seq + 1) % 256

    def send_bytes(self, data: bytes) -> None:
        """Send these bytes."""
        self.line.send(data)

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
        arrived = self.line.receive()
        if arrived is None:
            return
        data, arrived_s = arrived
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
            self.parameters[message.param_id] = message.param_value, message.param_type
            self._send_parameter(message.param_id)
        elif name == "PARAM_REQUEST_READ" and message.param_id in self.parameters:
            self._send_parameter(message.param_id)

    def _send_parameter(self, name: str) -> None:
        value, kind = self.parameters[name]
        self.send(dialect.MAVLink_param_value_message(name.encode(), value, kind, 1, 0))

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
