"""A serial port. pyserial opens it and sets its speed; bytes go past it, since it waits and we do not."""

import errno
import os
import termios
from contextlib import suppress

import serial

_BITS_PER_BYTE = 10  # with start and stop bit


class SerialChannel:
    """An open port. A `Channel`."""

    def __init__(self, port: serial.Serial) -> None:
        """Take over an open port."""
        self._port = port
        self._byte_s = _BITS_PER_BYTE / port.baudrate

    def fileno(self) -> int:
        """For the selector."""
        number: int = self._port.fileno()
        return number

    def read(self, size: int) -> bytes:
        """What has come. Raises: OSError; nothing though there was something: it was pulled out."""
        return os.read(self.fileno(), size)

    def write(self, data: bytes) -> int:
        """How much of it was taken. Raises: OSError."""
        return os.write(self.fileno(), data)

    def delay_s(self) -> float:
        """Of what waits in the kernel, at the port's speed."""
        waiting_bytes: int = self._port.out_waiting
        return waiting_bytes * self._byte_s

    def close(self) -> None:
        """End; without throwing away what waits, closing could wait for it half a minute."""
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
        """Open it, for us alone. Raises: OSError."""
        try:
            port = serial.Serial(self._device, self._baud, timeout=0, write_timeout=0, exclusive=True)
            _say_when_empty(port.fileno())
        except (OSError, termios.error, ValueError) as error:
            raise OSError(errno.ENODEV, str(error)) from error
        return SerialChannel(port)

    def cancel(self) -> None:
        """Nothing was begun."""


def _say_when_empty(file: int) -> None:
    """Have reading raise BlockingIOError when nothing is there; pyserial has it read as the end."""
    os.set_blocking(file, False)
    settings = termios.tcgetattr(file)
    settings[6][termios.VMIN] = 1
    termios.tcsetattr(file, termios.TCSANOW, settings)
