"""Lines of a long-running command to its terminal, pipe or file, without waiting for it.

A terminal that was closed or is stopped (Ctrl-S), and a pipe whose reader is late or gone, must neither end
nor delay what flies: such a line is dropped, and counted before the next one that can be written.
"""

import logging
import os
import select
from collections.abc import Callable
from contextlib import suppress
from typing import Final, TextIO

_PIECE_BYTES: Final = 4096
"""A pipe that is ready takes as much at once."""


class Outlet:
    """Writes whole lines to a stream."""

    def __init__(self, stream: TextIO | None, lost: Callable[[int], str]) -> None:
        """`stream` is None in a process that was started without it. `lost` says how many were dropped."""
        self._stream = stream
        self._lost = lost
        self._dropped = 0
        self._cut = False  # a line was written in part
        self._handle: int | None = None
        if stream is not None:
            with suppress(OSError, ValueError):  # no file: a stream in memory
                self._handle = stream.fileno()

    def write(self, line: str) -> None:
        """Write a line, or drop it."""
        if self._dropped:
            line = f"{self._lost(self._dropped)}\n{line}"
        if self._written(f"{line}\n"):
            self._dropped = 0
        else:
            self._dropped += 1

    def _written(self, text: str) -> bool:
        if self._stream is None:
            return False
        if self._handle is None:
            with suppress(ValueError):  # closed
                self._stream.write(text)
            return True
        data = ("\n" * self._cut + text).encode(self._stream.encoding, "backslashreplace")
        sent = 0
        try:
            while sent < len(data) and _is_ready(self._handle):
                sent += os.write(self._handle, data[sent : sent + _PIECE_BYTES])
        except OSError:  # the terminal or the reader is gone
            return False
        if sent:
            self._cut = sent < len(data)
        return sent == len(data)


def _is_ready(handle: int) -> bool:
    """Whether a write would not wait. Raises: OSError."""
    poll = select.poll()
    poll.register(handle, select.POLLOUT)
    return bool(poll.poll(0))


class OutletHandler(logging.Handler):
    """Logs to an outlet."""

    def __init__(self, outlet: Outlet) -> None:
        super().__init__()
        self._lines = outlet

    def emit(self, record: logging.LogRecord) -> None:
        self._lines.write(self.format(record))
