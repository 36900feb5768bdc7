"""Writes rows into the audit, many with one commit; callers may wait for it."""

import sqlite3
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

from gcs.links.disk_writer import DiskWriter
from gcs.recording.schema import open_to_write

Value: TypeAlias = str | int | float | None

_ROWS_MAX: Final = 50_000


class Row(NamedTuple):
    """One statement and its values."""

    sql: str
    values: Sequence[Value]


class Journal(DiskWriter[Row]):
    """One file. Rows that the disk does not accept are kept, and written once it does."""

    PERIOD_S = 0.0
    REPEATS = True

    def __init__(self, path: Path) -> None:
        """Opens nothing yet."""
        super().__init__(path, "rows of the audit", _ROWS_MAX)
        self._path = path
        self._connection: sqlite3.Connection | None = None

    def _write(self, batch: Sequence[Row]) -> None:
        """Write all rows in one transaction, or none."""
        try:
            if self._connection is None:
                self._connection = open_to_write(self._path)
            self._connection.execute("BEGIN IMMEDIATE")
            for row in batch:
                self._connection.execute(row.sql, row.values)
            self._connection.execute("COMMIT")
        except (sqlite3.IntegrityError, sqlite3.ProgrammingError):
            raise  # a bug: it ends the thread
        except sqlite3.DatabaseError as error:
            self._end()
            raise OSError(str(error)) from error

    def _end(self) -> None:
        """Close the file, and roll back what was not committed."""
        if self._connection is not None:
            with suppress(sqlite3.Error):
                self._connection.close()
            self._connection = None
