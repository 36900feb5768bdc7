"""Input of fault commands: lines on standard input, or datagrams on a UDP port. Each gets a line back."""

from __future__ import annotations

import os
import socket
import sys
from typing import TYPE_CHECKING, Protocol

from gcs.sim.endpoint import LARGEST, PortError
from gcs.sim.faults.commands import LONGEST_LINE

if TYPE_CHECKING:
    from gcs.sim.faults.injector import FaultInjector


class Control(Protocol):
    """A source of fault commands, read whenever it is readable."""

    def fileno(self) -> int:
        """File descriptor to wait for."""
        ...

    def read(self, fault_injector: FaultInjector) -> bool:
        """Execute the commands that have arrived, and answer them. Returns: whether more can arrive."""
        ...

    def close(self) -> None:
        """Release it."""
        ...


class StandardInput:
    """Newline-delimited JSON on this process's standard input; answers on its standard output."""

    def __init__(self) -> None:
        """Read without waiting."""
        self._part = b""

    def fileno(self) -> int:
        """File descriptor of standard input."""
        return sys.stdin.fileno()

    def read(self, fault_injector: FaultInjector) -> bool:
        """Execute the whole lines that have arrived."""
        data = os.read(self.fileno(), LARGEST)
        *lines, self._part = (self._part + data).split(b"\n")
        if len(self._part) > LONGEST_LINE or (not data and self._part):
            lines.append(self._part)
            self._part = b""
        for line in lines:
            if line.strip():
                print(fault_injector.obey(line), flush=True)  # noqa: T201 - the command's output
        return bool(data)

    def close(self) -> None:
        """Standard input stays open."""


class ControlPort:
    """The same commands in UDP datagrams, answered to the sender."""

    def __init__(self, host: str, port: int) -> None:
        """Open it.

        Raises:
            PortError: the port is taken.
        """
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise PortError(f"udp port {port}: {error.strerror}") from error

    def fileno(self) -> int:
        """File descriptor of the socket."""
        return self._socket.fileno()

    def read(self, fault_injector: FaultInjector) -> bool:
        """Execute the lines of one datagram."""
        try:
            data, sender = self._socket.recvfrom(LARGEST)
            answers = [fault_injector.obey(line) for line in data.split(b"\n") if line.strip()]
            if answers:
                self._socket.sendto("\n".join(answers).encode() + b"\n", sender)
        except OSError:  # ICMP: the sender no longer listens
            pass
        return True

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
