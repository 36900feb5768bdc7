"""Writes of tlog and record to a disk, from a thread: callers queue items, and never wait for the disk.

It is in `gcs.links`, below both: `gcs.links.tlog` and `gcs.recording` use it.
"""

import asyncio
import logging
import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from threading import Condition, Thread
from typing import ClassVar, Final, Generic, TypeVar

from gcs.model.errors import GcsError

log = logging.getLogger(__name__)

Item = TypeVar("Item")

RETRY_S: Final = 1.0
JOIN_S: Final = 5.0
WAIT_S: Final = 1.0
"""Longest wait for a disk that hangs: `kept` then returns False."""


class WholeFile:
    """A new file to which each `flush` writes all that was given to `write` before, or nothing."""

    def __init__(self, path: Path) -> None:
        """Raises: OSError; FileExistsError when there is such a file."""
        self._size_bytes = 0
        self._rest = bytearray()
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)

    @property
    def is_open(self) -> bool:
        """False also once the disk was gone: if it comes back, then with a new file."""
        return self._file >= 0

    def write(self, data: bytes) -> int:
        self._rest += data
        return len(data)

    def tell(self) -> int:
        return self._size_bytes + len(self._rest)

    def flush(self) -> None:
        """Raises: OSError, on a full disk for instance: half a record would hide all that follow."""
        data, self._rest = self._rest, bytearray()
        written = 0
        try:
            while written < len(data):
                written += os.write(self._file, data[written:])
        except OSError:
            try:
                os.ftruncate(self._file, self._size_bytes)
            except OSError:
                with suppress(OSError):
                    self.close()
            raise
        self._size_bytes += written

    def close(self) -> None:
        """Raises: OSError."""
        file, self._file = self._file, -1
        if file >= 0:
            os.close(file)


class DiskWriter(ABC, Generic[Item]):
    """A bounded queue, and the thread that writes it in batches; a subclass defines how."""

    PERIOD_S: ClassVar = 0.25  # between batches; 0: write at once
    REPEATS: ClassVar = False  # a failed batch is written again, otherwise dropped

    def __init__(self, place: Path, items: str, capacity: int) -> None:
        """Opens nothing yet.

        Args:
            place: file or folder, for messages.
            items: what is written, in the plural, for messages.
            capacity: the largest total size of the queued items.
        """
        self._place = place
        self._items = items
        self._capacity = capacity
        self._changed = Condition()  # guards all that follows
        self._queue: list[Item] = []
        self._size = 0  # of the queued items
        self._is_full = False  # the newest items found no room
        self._accepted = 0  # calls of `put` that found room
        self._stored = 0  # the newest of them whose items are on the disk
        self._waiting: list[tuple[int, Future[bool]]] = []
        self._closed = True
        self._runs = False  # the thread, which outlives `close` while the disk hangs
        self._thread: Thread | None = None
        self._failure = ""
        self.written = 0
        self.dropped = 0

    @property
    def problem(self) -> str:
        """Why nothing is being recorded, or how much was dropped; empty while all was recorded."""
        with self._changed:  # a thread that is being started is not alive yet
            ended = self._thread is not None and not self._thread.is_alive() and not self._closed
        if self._failure:
            return self._failure
        if ended:
            return f"{self._place}: the thread that writes {self._items} has ended; the log says why"
        return f"{self._place}: {self.dropped} {self._items} were not recorded" if self.dropped else ""

    @property
    def waiting(self) -> int:
        return len(self._queue)

    def open(self) -> None:
        """Begin to write, as soon as the disk allows. A thread that still hangs in the disk goes on."""
        with self._changed:
            self._closed = False
            if self._runs:
                return
            self._runs = True
            self._thread = Thread(target=self._run, name=f"record/{self._items}", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Write what is left. Blocks, but only for a limited time on a disk that hangs."""
        if self._thread is not None:
            with self._changed:
                self._closed = True
                self._changed.notify()
            self._thread.join(JOIN_S)

    def put(self, items: Sequence[Item], size: int | None = None) -> None:
        """Queue items for one batch. Callable on any thread; takes a microsecond."""
        size = len(items) if size is None else size
        with self._changed:
            self._is_full = self._size + size > self._capacity
            if self._is_full:
                self.dropped += self._count(items)
                return
            self._queue += items
            self._size += size
            self._accepted += 1
            if not self.PERIOD_S:
                self._changed.notify()

    async def kept(self) -> bool:
        """Return once all items put so far are on the disk. False: they are not, see `problem`."""
        with self._changed:
            if self._is_full or self._failure:
                return False
            if self._stored >= self._accepted:
                return True
            if self._closed or self._thread is None or not self._thread.is_alive():
                return False
            answer: Future[bool] = Future()
            self._waiting.append((self._accepted, answer))
        try:
            return await asyncio.wait_for(asyncio.wrap_future(answer), WAIT_S)
        except TimeoutError:
            return False

    # on the thread

    @abstractmethod
    def _write(self, batch: Sequence[Item]) -> None:
        """Write a batch: all or nothing. Without a failure it is also called with none, every period.

        Raises: OSError or GcsError when the disk fails; anything else ends the thread.
        """

    @abstractmethod
    def _end(self) -> None:
        """Close what `_write` has opened. Raises: OSError."""

    def _count(self, items: Sequence[Item]) -> int:
        return len(items)

    def _run(self) -> None:
        try:
            while self._runs:
                self._write_until_closed()
                with self._changed:
                    self._runs = not self._closed  # opened again while the disk hung: this thread goes on
        finally:
            self._runs = False

    def _write_until_closed(self) -> None:
        try:
            while not self._wait():
                self._write_once()
            self._write_once()
        finally:
            try:
                self._end()
            except OSError as error:
                self._failed(error)
            self._answer(self._accepted, kept=False)

    def _wait(self) -> bool:
        """Wait for the next batch. Returns: whether the writer is being closed."""
        with self._changed:
            wait_s = RETRY_S if self._failure else self.PERIOD_S
            if wait_s:
                self._changed.wait_for(lambda: self._closed, wait_s)
            else:
                self._changed.wait_for(lambda: self._closed or self._queue)
            return self._closed

    def _write_once(self) -> None:
        with self._changed:
            batch, self._queue = self._queue, []
            size, self._size = self._size, 0
            newest = self._accepted
        count = self._count(batch)
        try:
            if batch or not self._failure:
                self._write(batch)
        except (OSError, GcsError) as error:
            with self._changed:
                if self.REPEATS:
                    self._queue[:0] = batch
                    self._size += size
                else:
                    self.dropped += count
            self._failed(error)
            self._answer(self._accepted, kept=False)
            return
        with self._changed:
            self.written += count
            self._stored = newest
            had_failed = bool(self._failure and count)
            self._failure = "" if count else self._failure
        self._answer(newest, kept=True)
        if had_failed:
            log.warning("recording_resumed", extra={"what": self._items, "place": str(self._place)})

    def _failed(self, error: Exception) -> None:
        cause = str(error) if str(self._place) in str(error) else f"{self._place}: {error}"
        with self._changed:
            had_failed, self._failure = bool(self._failure), f"{self._items} are not recorded: {cause}"
        if not had_failed:
            log.error("recording_failed", extra={"what": self._items, "cause": cause})

    def _answer(self, newest: int, *, kept: bool) -> None:
        """Answer the calls of `kept` that wait for a `put` up to this one."""
        with self._changed:
            due = [answer for number, answer in self._waiting if number <= newest]
            self._waiting = [each for each in self._waiting if each[0] > newest]
        for answer in due:
            if answer.set_running_or_notify_cancel():  # otherwise its caller waits no more
                answer.set_result(kept)
