"""Records every frame to a `.tlog`, as QGroundControl and pymavlink open it.

A record is 8 bytes, big-endian, microseconds of Unix time, and the frame.
"""

import logging
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from struct import Struct
from time import time as wall_time_s
from typing import Final

from gcs.links.disk_writer import DiskWriter, WholeFile
from gcs.links.link import FrameDirection

log = logging.getLogger(__name__)

_STAMP: Final = Struct(">Q")
_QUEUE_MAX_BYTES: Final = 32 << 20


def record(unix_us: int, raw: bytes) -> bytes:
    return _STAMP.pack(unix_us) + raw


class Recorder(DiskWriter[bytes]):
    """Writes a new file each time it is opened. `record` is for any thread and takes a microsecond."""

    def __init__(self, folder: Path, name: str, clock: Callable[[], float]) -> None:
        """Nothing is opened yet. `clock` is that of the times given to `record`."""
        super().__init__(folder, "frames", _QUEUE_MAX_BYTES)
        self._folder = folder
        self._name = re.sub(r"[^A-Za-z0-9_.-]", "_", name)
        self._clock = clock
        self._offset_s = 0.0
        self._newest_us = 0
        self._file: WholeFile | None = None
        self.path: Path | None = None  # the newest file, once it exists

    def open(self) -> None:
        self._offset_s = wall_time_s() - self._clock()  # once: the file's time never goes back
        super().open()

    def record(self, time_s: float, _direction: FrameDirection, raw: bytes, _system_id: int) -> None:
        if self._closed:
            return
        with self._changed:
            # the kernel's time of an arrival may be older than a frame sent meanwhile
            self._newest_us = max(self._newest_us, round((time_s + self._offset_s) * 1e6))
            self.put((record(self._newest_us, raw),), len(raw))

    def _write(self, batch: Sequence[bytes]) -> None:
        if batch:
            if self._file is None or not self._file.is_open:
                self._file = self._create()
            self._file.write(b"".join(batch))
            self._file.flush()

    def _create(self) -> WholeFile:
        self._folder.mkdir(parents=True, exist_ok=True)
        began = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
        for turn in range(1, 1000):
            self.path = self._folder / f"{began}-{self._name}{'' if turn == 1 else f'-{turn}'}.tlog"
            with suppress(FileExistsError):
                file = WholeFile(self.path)
                log.info("recording", extra={"file": str(self.path)})
                return file
        raise FileExistsError(f"{self._folder}: too many recordings of this second")

    def _end(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            with suppress(OSError):
                file.close()
