"""A serial port. pyserial opens it and sets its speed; reads and writes bypass pyserial: it would block."""

import errno
import os
import termios
from contextlib import suppress

import serial

_BITS_PER_BYTE = 10  # with start and stop bit


class SerialChannel:
    """An open port. A `Channel`."""

    def __init__(self, port: serial.Serial) -> None:
        """Use an open port."""
        self._port = port
        self._byte_s = _BITS_PER_BYTE / port.baudrate

    def fileno(self) -> int:
        """For the selector."""
        number: int = self._port.fileno()
        return number

    def read(self, size: int) -> bytes:
        """Read what has arrived. Raises: OSError. Nothing, although readable: the port was unplugged."""
        return os.read(self.fileno(), size)

    def write(self, data: bytes) -> int:
        """Number of bytes accepted. Raises: OSError."""
        return os.write(self.fileno(), data)

    def delay_s(self) -> float:
        """Delay of the bytes that wait in the kernel, at the port's speed."""
        waiting_bytes: int = self._port.out_waiting
        return waiting_bytes * self._byte_s

    def close(self) -> None:
        """Close; the output buffer is discarded first, otherwise closing could wait half a minute for it."""
        with suppress(OSError, termios.error):
            self._port.reset_output_buffer()
        with suppress(OSError, termios.error):
            self._port.close()


class SerialDial:
    """Opens a port, which takes milliseconds. A `Dial`."""

    def __init__(self, device: str, baud: int) -> None:
        """Nothing is opened yet."""
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
