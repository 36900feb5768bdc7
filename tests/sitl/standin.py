"""What both stand-ins for real programs have: a fake vehicle behind the surface of the program."""

import json
import os
import selectors
import socket
import struct
import threading
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import ClassVar, TypeAlias

from pymavlink.dialects.v20 import common

from gcs.sim import cli
from tests.support.machine import free_ports
from tests.support.processes import READY_AT_ONCE

Address: TypeAlias = tuple[str, int]
Faults: TypeAlias = Mapping[tuple[str, float], Mapping[str, object]]
"""What a parameter of the simulation, at a value, does to a fake vehicle."""

HOST = "127.0.0.1"
LONGEST = 2048


class Surface(ABC):
    """The simulator's side of one vehicle: its true states go out, parameters of the simulation come in.

    It can be armed at once, for tests. Without STANDIN_VERSION it has the recorded version of its autopilot.
    """

    faults: ClassVar[Faults] = {}

    def __init__(self, index: int, simulator: Address) -> None:
        """`simulator`: where the program's simulator link or second serial port leads."""
        self._index, self._simulator = index, simulator
        self._inside, self._outside = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._inside.bind((HOST, 0))
        self._control = (HOST, free_ports())
        self._decoder = common.MAVLink(None)
        self._decoder.robust_parsing = True

    def fly(self, options: Sequence[str]) -> int:
        """Fly the vehicle until the process is stopped. Returns: the exit code."""
        threading.Thread(target=self._live, daemon=True).start()
        own = ["--first", str(self._index), "--count", "1", "--spacing", "0", *READY_AT_ONCE]
        own += ["--simulator-link", str(self._inside.getsockname()[1] - self._index)]
        own += ["--control", str(self._control[1])]
        own += ["--autopilot-version", version] if (version := os.environ.get("STANDIN_VERSION")) else []
        return cli.main([*own, *options])

    @abstractmethod
    def of_states(self, data: bytes) -> None:
        """Pass on what the fake vehicle sends on its simulator link."""

    def send(self, data: bytes) -> None:
        """Send on the simulator link."""
        with suppress(ConnectionRefusedError):  # nothing listens there
            self._outside.sendto(data, self._simulator)

    def _live(self) -> None:
        with selectors.DefaultSelector() as selector:
            for port in (self._inside, self._outside):
                selector.register(port, selectors.EVENT_READ)
            self._outside.bind((HOST, 0))
            while True:
                for key, _ in selector.select():
                    try:
                        data = key.fileobj.recv(LONGEST)  # type: ignore[union-attr]  # a socket
                    except ConnectionRefusedError:
                        continue  # nothing listens there
                    if key.fileobj is self._inside:
                        self.of_states(data)
                    else:
                        self._take(data)

    def _take(self, data: bytes) -> None:
        """Execute PARAM_SET of these bytes that stand for a fault."""
        for message in self._decoder.parse_buffer(data) or ():
            if message.get_type() != "PARAM_SET":
                continue
            value = message.param_value
            if message.param_type == common.MAV_PARAM_TYPE_INT32:
                value = struct.unpack("<i", struct.pack("<f", value))[0]
            fault = self.faults.get((message.param_id, value))
            if fault is not None:
                command = json.dumps({"vehicle": self._index + 1, **fault})
                self._inside.sendto(command.encode(), self._control)
