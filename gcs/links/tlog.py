"""Records every frame to a `.tlog`, as QGroundControl and pymavlink open it.

A record is 8 bytes, big-endian, microseconds of Unix time, and the frame.
"""

import logging
import os
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from struct import Struct
from time import time as wall_time_s
from typing import Final

from gcs.links.disk_writer import DiskWriter
from gcs.links.link import Direction

log = logging.getLogger(__name__)

_STAMP: Final = Struct(">Q")
_QUEUE_MAX_BYTES: Final = 32 << 20


def record(unix_us: int, raw: bytes) -> bytes:
    return _STAMP.pack(unix_us) + raw


class Recorder(DiskWriter[bytes]):
    """Writes a new file each time it is opened. `record` is for any thread and takes a microsecond."""

    def __init__(self, folder: Path, name: str, clock: Callable[[], float]) -> None:
        """Nothing is opened yet.

        Args:
            folder: created when missing.
            name: becomes part of the file's name.
            clock: that of the times given to `record`.
        """
        super().__init__(folder, "frames", _QUEUE_MAX_BYTES)
        self._folder = folder
        self._name = re.sub(r"[^A-Za-z0-9_.-]", "_", name)
        self._clock = clock
        self._offset_s = 0.0
        self._newest_us = 0
        self._file = -1
        self._whole_bytes = 0
        self.path: Path | None = None  # the newest file, once it exists

    def open(self) -> None:
        """Begin a new file, as soon as the disk allows."""
        self._offset_s = wall_time_s() - self._clock()  # once: the file's time never goes back
        super().open()

    def record(self, time_s: float, _direction: Direction, raw: bytes, _system_id: int) -> None:
        """Keep a frame. An `Observer`."""
        if self._closed:
            return
        with self._changed:
            # the kernel's time of an arrival may be older than a frame sent meanwhile
            self._newest_us = max(self._newest_us, round((time_s + self._offset_s) * 1e6))
            self.put((record(self._newest_us, raw),), len(raw))

    def _write(self, batch: Sequence[bytes]) -> None:
        if batch:
            if self._file < 0:
                self._create()
            self._append(b"".join(batch))

    def _create(self) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        began = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
        for turn in range(1, 1000):
            path = self._folder / f"{began}-{self._name}{'' if turn == 1 else f'-{turn}'}.tlog"
            try:
                self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
            except FileExistsError:
                continue
            self.path, self._whole_bytes = path, 0
            log.info("recording", extra={"file": str(path)})
            return
        raise FileExistsError(f"{self._folder}: too many recordings of this second")

    def _append(self, data: bytes) -> None:
        """All of it or, on a full disk, nothing: half a record would hide all that follow."""
        written = 0
        try:
            while written < len(data):
                written += os.write(self._file, data[written:])
        except OSError:
            try:
                os.ftruncate(self._file, self._whole_bytes)
            except OSError:  # the disk itself is gone; if it comes back, then with a new file
                self._end()
            raise
        self._whole_bytes += written

    def _end(self) -> None:
        if self._file >= 0:
            with suppress(OSError):
                os.close(self._file)
        self._file = -1
