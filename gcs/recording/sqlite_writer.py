"""Writes rows into SQLite from a thread of its own, many with one commit; callers may wait for it.

The disk never delays flight: rows wait in a bounded queue, `put` takes a microsecond, and the thread syncs.
Rows that the disk does not accept are kept, and written once it does.
"""

import asyncio
import logging
import sqlite3
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Condition, Thread
from typing import Final, NamedTuple, TypeAlias

from gcs.model.errors import GcsError
from gcs.recording.schema import open_to_write

log = logging.getLogger(__name__)

Value: TypeAlias = str | int | float | None

_RETRY_S: Final = 1.0
_JOIN_S: Final = 5.0
_WAIT_S: Final = 1.0
"""Longest wait for a disk that hangs: the answer then says that the call is not recorded."""

_ROWS_MAX: Final = 50_000


class Row(NamedTuple):
    """One statement and its values."""

    sql: str
    values: Sequence[Value]


class _Waiting(NamedTuple):
    number: int
    loop: asyncio.AbstractEventLoop
    answer: asyncio.Future[bool]


class Journal:
    """One file. `put` is for any thread; `kept` for event loops."""

    def __init__(self, path: Path) -> None:
        """Opens nothing yet."""
        self._path = path
        self._changed = Condition()  # guards all that follows
        self._rows: list[Row] = []
        self._put = 0  # rows accepted so far
        self._committed = 0
        self._lost = 0
        self._is_full = False  # the newest rows found no room
        self._waiting: list[_Waiting] = []
        self._problem = ""
        self._closing = False
        self._writer: Thread | None = None

    @property
    def problem(self) -> str:
        """Why nothing is being recorded, or what was lost; empty without a problem."""
        if self._problem:
            return self._problem
        if self._writer is not None and not self._writer.is_alive() and not self._closing:
            return f"{self._path}: the writer has ended; the log says why"
        return f"{self._path}: {self._lost} rows were lost while the disk failed" if self._lost else ""

    def open(self) -> None:
        """Begin to write, as soon as the disk allows."""
        self._closing = False
        self._writer = Thread(target=self._run, name="record/journal", daemon=True)
        self._writer.start()

    def close(self) -> None:
        """Write what is left. Blocks, but only for a limited time on a disk that hangs."""
        if self._writer is not None:
            with self._changed:
                self._closing = True
                self._changed.notify()
            self._writer.join(_JOIN_S)
            self._writer = None

    def put(self, rows: Iterable[Row]) -> None:
        """Queue these rows, to be written in one transaction."""
        rows = list(rows)
        with self._changed:
            room = max(0, _ROWS_MAX - len(self._rows))
            self._is_full = len(rows) > room
            self._lost += max(0, len(rows) - room)
            self._rows += rows[:room]
            self._put += len(rows[:room])
            self._changed.notify()

    async def kept(self) -> bool:
        """Return once all rows put so far are on the disk. False: they are not, see `problem`."""
        loop = asyncio.get_running_loop()
        with self._changed:
            if self._is_full or self._problem:
                return False
            if self._committed >= self._put:
                return True
            if self._writer is None or not self._writer.is_alive():
                return False
            answer: asyncio.Future[bool] = loop.create_future()
            self._waiting.append(_Waiting(self._put, loop, answer))
        try:
            return await asyncio.wait_for(answer, _WAIT_S)
        except TimeoutError:
            return False

    # on the thread

    def _run(self) -> None:
        connection: sqlite3.Connection | None = None
        try:
            while True:
                with self._changed:
                    if self._problem:
                        self._changed.wait_for(lambda: self._closing, _RETRY_S)
                    else:
                        self._changed.wait_for(lambda: self._closing or self._rows)
                    batch, last = list(self._rows), self._closing
                try:
                    connection = connection or open_to_write(self._path)
                    _write(connection, batch)
                except (sqlite3.IntegrityError, sqlite3.ProgrammingError):
                    raise  # a bug; `problem` says that the writer has ended
                except (sqlite3.DatabaseError, OSError, GcsError) as error:
                    self._failed(error)
                    _close(connection)
                    connection = None
                else:
                    self._done(len(batch))
                if last:
                    return
        finally:
            _close(connection)
            self._answer(lambda _each: True, kept=False)

    def _done(self, count: int) -> None:
        with self._changed:
            del self._rows[:count]
            self._committed += count
            had_failed, self._problem = bool(self._problem), ""
            committed = self._committed
        self._answer(lambda each: each.number <= committed, kept=True)
        if had_failed:
            log.warning("audit_goes_on", extra={"file": str(self._path)})

    def _failed(self, error: Exception) -> None:
        text = str(error) if isinstance(error, GcsError) else f"{self._path}: {error}"
        with self._changed:
            is_news, self._problem = not self._problem, f"nothing is recorded: {text}"
        self._answer(lambda _each: True, kept=False)
        if is_news:
            log.error("audit_failed", extra={"file": str(self._path), "cause": text})

    def _answer(self, whom: Callable[[_Waiting], bool], *, kept: bool) -> None:
        with self._changed:
            reported = [each for each in self._waiting if whom(each)]
            self._waiting = [each for each in self._waiting if not whom(each)]
        for each in reported:
            with suppress(RuntimeError):  # its loop has ended: no caller waits any more
                each.loop.call_soon_threadsafe(_set, each.answer, kept)


def _set(answer: asyncio.Future[bool], kept: bool) -> None:
    if not answer.done():
        answer.set_result(kept)


def _write(connection: sqlite3.Connection, batch: Sequence[Row]) -> None:
    """Write all rows, or none."""
    if not batch:
        return
    connection.execute("BEGIN IMMEDIATE")
    try:
        for row in batch:
            connection.execute(row.sql, row.values)
        connection.execute("COMMIT")
    finally:
        if connection.in_transaction:  # it may have failed earlier
            connection.execute("ROLLBACK")


def _close(connection: sqlite3.Connection | None) -> None:
    if connection is not None:
        with suppress(sqlite3.Error):
            connection.close()
