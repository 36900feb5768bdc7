"""What connects a `Peer` with the ground: a UDP socket, a TCP connection, a pseudo terminal."""

import os
import pty
import socket
import struct
import time
import tty
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Protocol

SO_TIMESTAMPNS, TIMESPEC = 35, struct.Struct("@qq")
LOOK_S = 0.01


class Line(Protocol):
    """A vehicle's end of its connection. `lose` and `restore` may be called on any thread."""

    @property
    def address(self) -> tuple[str, int]:
        """As the link names it."""
        ...

    def send(self, data: bytes) -> None:
        """Send, or lose what cannot be sent."""
        ...

    def receive(self) -> tuple[bytes, float] | None:
        """Bytes and their arrival on the monotonic clock; None after some milliseconds without any."""
        ...

    def lose(self) -> None:
        """Break the connection."""
        ...

    def restore(self) -> None:
        """Connect again, from another address where there is one."""
        ...

    def close(self) -> None: ...


class UdpLine:
    """UDP to a port of this host, with the kernel's times of arrival."""

    def __init__(self, port: int) -> None:
        self._ground = ("127.0.0.1", port)
        self._lost = False
        self._lock = Lock()
        self._socket = self._made()

    def _made(self) -> socket.socket:
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.bind(("127.0.0.1", 0))
        made.settimeout(LOOK_S)
        made.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        return made

    @property
    def address(self) -> tuple[str, int]:
        host, port = self._socket.getsockname()
        return host, port

    def send(self, data: bytes) -> None:
        if not self._lost:
            self._socket.sendto(data, self._ground)

    def receive(self) -> tuple[bytes, float] | None:
        with self._lock:
            try:
                data, ancillary, *_ = self._socket.recvmsg(2048, 64)
            except TimeoutError:
                return None
        return data, _arrived_s(ancillary)

    def lose(self) -> None:
        self._lost = True

    def restore(self) -> None:
        with self._lock:
            before, self._socket = self._socket, self._made()
            before.close()
        self._lost = False

    def close(self) -> None:
        self._socket.close()


class TcpLine:
    """A TCP client of the link, which connects again by itself unless it is lost."""

    def __init__(self, port: int) -> None:
        self._ground = ("127.0.0.1", port)
        self._lost = False
        self._lock = Lock()
        self._socket: socket.socket | None = None

    @property
    def address(self) -> tuple[str, int]:
        with self._lock:
            if self._socket is None:
                return "", 0
            host, port = self._socket.getsockname()
            return host, port

    def _connected(self) -> socket.socket | None:
        if self._socket is None and not self._lost:
            with suppress(OSError):
                self._socket = socket.create_connection(self._ground, timeout=1.0)
                self._socket.settimeout(LOOK_S)
        return self._socket

    def _drop(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def send(self, data: bytes) -> None:
        with self._lock:
            connection = self._connected()
            if connection is not None:
                try:
                    connection.sendall(data)
                except OSError:
                    self._drop()

    def receive(self) -> tuple[bytes, float] | None:
        with self._lock:
            connection = self._connected()
            if connection is not None:
                try:
                    data = connection.recv(4096)
                except TimeoutError:
                    return None
                except OSError:
                    data = b""
                if data:
                    return data, time.monotonic()
                self._drop()
        time.sleep(LOOK_S)
        return None

    def lose(self) -> None:
        with self._lock:
            self._lost = True
            self._drop()

    def restore(self) -> None:
        self._lost = False

    def close(self) -> None:
        self.lose()


class Cable:
    """A pseudo terminal whose near end lies at a path of its own, so that it can be pulled and put back."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.master = -1

    def plug(self) -> None:
        self.master, near = pty.openpty()
        tty.setraw(near)  # a terminal would echo what comes before somebody opens the port
        os.set_blocking(self.master, False)
        self.path.symlink_to(os.ttyname(near))
        self._near = near

    def pull(self) -> None:
        if self.master < 0:
            return
        os.close(self._near)
        os.close(self.master)
        self.path.unlink()
        self.master = -1

    def write(self, data: bytes) -> None:
        os.write(self.master, data)

    def read(self) -> bytes:
        try:
            return os.read(self.master, 4096)
        except BlockingIOError:
            return b""


class SerialLine:
    """A cable that can be pulled."""

    def __init__(self, path: Path) -> None:
        self._cable = Cable(path)
        self._lock = Lock()
        self._cable.plug()

    @property
    def address(self) -> tuple[str, int]:
        return str(self._cable.path), 0

    def send(self, data: bytes) -> None:
        with self._lock, suppress(OSError):  # a full buffer, while the port is not open
            self._cable.write(data)

    def receive(self) -> tuple[bytes, float] | None:
        data = b""
        with self._lock, suppress(OSError):
            data = self._cable.read()
        if data:
            return data, time.monotonic()
        time.sleep(LOOK_S)
        return None

    def lose(self) -> None:
        with self._lock:
            self._cable.pull()

    def restore(self) -> None:
        with self._lock:
            self._cable.plug()

    def close(self) -> None:
        self.lose()


def _arrived_s(ancillary: list[tuple[int, int, bytes]]) -> float:
    """Arrival time on the monotonic clock, read without a pause of the machine between the two readings."""
    ((_, _, stamp),) = ancillary
    seconds, nanoseconds = TIMESPEC.unpack(stamp)
    while True:
        now_s, wall_s, later_s = time.monotonic(), time.time(), time.monotonic()
        if later_s - now_s < 0.001:
            arrived_s: float = now_s - (wall_s - (seconds + nanoseconds * 1e-9))
            return arrived_s
