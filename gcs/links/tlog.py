"""Records every frame to a `.tlog`, as QGroundControl and pymavlink open it, from a thread of its own.

A record is 8 bytes, big-endian, microseconds of Unix time, and the frame. The disk never delays the flight:
frames wait in a bounded queue, and are counted when they cannot be kept.
"""

import logging
import os
import re
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from struct import Struct
from threading import Event, Lock, Thread
from time import time as wall_time_s
from typing import Final

from gcs.links.counters import Counters, Direction

log = logging.getLogger(__name__)

_STAMP: Final = Struct(">Q")
_WRITE_PERIOD_S: Final = 0.25
_RETRY_S: Final = 1.0
_QUEUE_MAX_BYTES: Final = 32 << 20
_JOIN_S: Final = 5.0


def record(unix_us: int, raw: bytes) -> bytes:
    """One frame as a record of the file."""
    return _STAMP.pack(unix_us) + raw


class Recorder:
    """Writes a new file each time it is opened. `record` is for any thread and takes a microsecond."""

    def __init__(self, folder: Path, name: str, counters: Counters, clock: Callable[[], float]) -> None:
        """Nothing is opened yet.

        Args:
            folder: created when missing.
            name: becomes part of the file's name.
            counters: its `recorded` and `not_recorded` are kept here.
            clock: that of the times given to `record`.
        """
        self._folder = folder
        self._name = re.sub(r"[^A-Za-z0-9_.-]", "_", name)
        self._counters = counters
        self._clock = clock
        self._lock = Lock()
        self._queue: list[bytes] = []
        self._queued_bytes = 0
        self._offset_s = 0.0
        self._newest_us = 0
        self._closed = Event()
        self._writer: Thread | None = None
        self._file = -1
        self._whole_bytes = 0
        self._problem = ""
        self._path: Path | None = None

    @property
    def problem(self) -> str:
        """Why nothing is being recorded; empty while it is."""
        return self._problem

    @property
    def path(self) -> Path | None:
        """The newest file, once it exists."""
        return self._path

    def open(self) -> None:
        """Begin a new file, as soon as the disk allows."""
        self._offset_s = wall_time_s() - self._clock()  # once: the file's time never goes back
        self._closed.clear()
        self._writer = Thread(target=self._write, name=f"record/{self._name}", daemon=True)
        self._writer.start()

    def close(self) -> None:
        """Write what is left. Blocks for a limited time, also on a disk that hangs."""
        if self._writer is not None:
            self._closed.set()
            self._writer.join(_JOIN_S)
            self._writer = None

    def record(self, time_s: float, _direction: Direction, raw: bytes, _system_id: int) -> None:
        """Keep a frame. An `Observer`."""
        if self._writer is None:
            return
        with self._lock:
            # the kernel's time of an arrival may be older than a frame sent meanwhile
            self._newest_us = max(self._newest_us, round((time_s + self._offset_s) * 1e6))
            if self._queued_bytes > _QUEUE_MAX_BYTES:
                self._counters.not_recorded += 1
                return
            self._queue.append(record(self._newest_us, raw))
            self._queued_bytes += len(raw)

    def _write(self) -> None:
        """On the thread: until closed, and once more."""
        try:
            while not self._closed.wait(_RETRY_S if self._problem else _WRITE_PERIOD_S):
                self._write_once()
            self._write_once()
        finally:
            self._end_file()

    def _write_once(self) -> None:
        with self._lock:
            batch, self._queue, self._queued_bytes = self._queue, [], 0
        if not batch:
            return
        try:
            if self._file < 0:
                self._create()
            self._append(b"".join(batch))
        except OSError as error:
            with self._lock:
                self._counters.not_recorded += len(batch)
            if not self._problem:
                log.error("recording_failed", extra={"folder": str(self._folder), "cause": str(error)})
            self._problem = f"recording to {self._folder} fails: {error}"
            return
        self._counters.recorded += len(batch)
        if self._problem:
            log.warning("recording_goes_on", extra={"file": str(self._path)})
        self._problem = ""

    def _create(self) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        began = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
        for turn in range(1, 1000):
            path = self._folder / f"{began}-{self._name}{'' if turn == 1 else f'-{turn}'}.tlog"
            try:
                self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
            except FileExistsError:
                continue
            self._path, self._whole_bytes = path, 0
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
                self._end_file()
            raise
        self._whole_bytes += written

    def _end_file(self) -> None:
        if self._file >= 0:
            with suppress(OSError):
                os.close(self._file)
        self._file = -1
