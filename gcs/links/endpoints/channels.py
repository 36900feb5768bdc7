"""TCP and serial channels: TCP sockets and a serial device, opened, read and written without waiting.

No call blocks: BlockingIOError means that there is nothing to read, or no room. Every other OSError means
that the channel has ended. A broken connection may show only when the kernel gives up: after `_GIVE_UP_S`.
Data that it had accepted by then is lost with it. Data delivered late within that time cannot be called back.
"""

import errno
import os
import socket
import termios
from contextlib import suppress
from fcntl import ioctl
from struct import Struct
from typing import Final, TypeAlias

import serial

_CONNECT_S: Final = 5.0
_GIVE_UP_S: Final = 1.0
_SEND_BUFFER_BYTES: Final = 1 << 16
_SIOCOUTQNSD: Final = 0x894B  # Linux: bytes that have not left yet
_INT: Final = Struct("@i")
_ASSUMED_BYTES_PER_S: Final = 100_000
_BITS_PER_BYTE: Final = 10  # with start and stop bit


class SocketChannel:
    """A connected socket."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected
        self.read, self.write, self.fileno = connected.recv, connected.send, connected.fileno
        connected.setblocking(False)
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in (
            (socket.TCP_KEEPIDLE, 2),
            (socket.TCP_KEEPINTVL, 1),
            (socket.TCP_KEEPCNT, 3),
            (socket.TCP_USER_TIMEOUT, round(_GIVE_UP_S * 1000)),
        ):
            connected.setsockopt(socket.IPPROTO_TCP, option, value)
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)

    def delay_s(self) -> float:
        """Delay of the bytes that have not left yet; 0 where the kernel does not report them."""
        try:
            (waiting_bytes,) = _INT.unpack(ioctl(self._socket.fileno(), _SIOCOUTQNSD, bytes(_INT.size)))
        except OSError:  # a kernel without this call
            return 0.0
        delay_s: float = waiting_bytes / _ASSUMED_BYTES_PER_S
        return delay_s

    def close(self) -> None:
        """Reset instead of finishing: data still waiting is too old for the next connection."""
        with suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, Struct("@ii").pack(1, 0))
        self._socket.close()


class TcpDial:
    """Connects without waiting."""

    def __init__(self, host: str, port: int) -> None:
        self._at = (host, port)
        self._pending: socket.socket | None = None
        self._began_s = 0.0

    def __call__(self, now_s: float) -> SocketChannel | None:
        """Begin, or check whether it is connected by now. Raises: OSError when that failed."""
        if self._pending is None:
            self._pending = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
            self._pending.setblocking(False)
            self._began_s = now_s
            cause = self._pending.connect_ex(self._at)
        else:
            cause = self._pending.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if cause not in (0, errno.EINPROGRESS):
            self.cancel()
            raise OSError(cause, os.strerror(cause))
        try:
            self._pending.getpeername()
        except OSError:
            if now_s - self._began_s > _CONNECT_S:
                self.cancel()
                raise TimeoutError(f"no answer within {_CONNECT_S:g} s") from None
            return None
        if self._pending.getpeername() == self._pending.getsockname():  # TCP connected to itself
            self.cancel()
            raise ConnectionRefusedError("nothing listens")
        connected, self._pending = self._pending, None
        return SocketChannel(connected)

    def cancel(self) -> None:
        if self._pending is not None:
            self._pending.close()
            self._pending = None


def listen(host: str, port: int) -> socket.socket:
    """A listening socket that never blocks. Raises: OSError, OverflowError."""
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listening.setblocking(False)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen()
    except (OSError, OverflowError):
        listening.close()
        raise
    return listening


class SerialChannel:
    """An open port."""

    def __init__(self, port: serial.Serial) -> None:
        self._port = port
        self._byte_s = _BITS_PER_BYTE / port.baudrate

    def fileno(self) -> int:
        number: int = self._port.fileno()
        return number

    def read(self, size: int) -> bytes:
        """Read what has arrived. Raises: OSError. Nothing, although readable: the port was unplugged."""
        return os.read(self.fileno(), size)

    def write(self, data: bytes) -> int:
        return os.write(self.fileno(), data)

    def delay_s(self) -> float:
        waiting_bytes: int = self._port.out_waiting
        return waiting_bytes * self._byte_s

    def close(self) -> None:
        """Close; the output buffer is discarded first, otherwise closing could wait half a minute for it."""
        with suppress(OSError, termios.error):
            self._port.reset_output_buffer()
        with suppress(OSError, termios.error):
            self._port.close()


class SerialDial:
    """Opens a port, which takes milliseconds."""

    def __init__(self, device: str, baud: int) -> None:
        self._device = device
        self._baud = baud

    def __call__(self, now_s: float) -> SerialChannel:  # noqa: ARG002
        """Open it exclusively. Raises: OSError."""
        try:
            port = serial.Serial(self._device, self._baud, timeout=0, write_timeout=0, exclusive=True)
            _say_when_empty(port.fileno())
        except (OSError, termios.error, ValueError) as error:
            raise OSError(errno.ENODEV, str(error)) from error
        return SerialChannel(port)

    def cancel(self) -> None:
        """Nothing is pending."""


def _say_when_empty(file: int) -> None:
    """Make reads raise BlockingIOError without data; with pyserial's setting they would return the end."""
    os.set_blocking(file, False)
    settings = termios.tcgetattr(file)
    settings[6][termios.VMIN] = 1
    termios.tcsetattr(file, termios.TCSANOW, settings)


Channel: TypeAlias = SocketChannel | SerialChannel
Dial: TypeAlias = TcpDial | SerialDial
"""Opens a channel without waiting: None while it takes longer, then it is called again."""
