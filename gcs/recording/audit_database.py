"""The audit's tables in SQLite, how a file is opened, and the journal that writes rows in the background.

`application_id` identifies the program, `user_version` the layout. A file of another program or of an unknown
version is refused, and left as it is.
"""

import sqlite3
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from importlib import resources
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

from gcs.links.disk_writer import DiskWriter
from gcs.model.errors import GcsError

APPLICATION_ID: Final = 0x46474353  # "FGCS"
VERSION: Final = 2  # of audit.sql
BUSY_S: Final = 1.0
ROWS_MAX: Final = 50_000

Value: TypeAlias = str | int | float | None

SCHEMA: Final = resources.files("gcs.recording").joinpath("audit.sql").read_text(encoding="utf-8")


def open_to_write(path: Path) -> sqlite3.Connection:
    """Open the audit, created if missing. For one thread.

    Raises: sqlite3.Error or OSError on a disk error; GcsError when the file is of another program.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with ExitStack() as unless_good:
        connection = sqlite3.connect(path, timeout=BUSY_S, isolation_level=None)
        unless_good.callback(connection.close)
        numbers = (_number(connection, path, name) for name in ("application_id", "user_version"))
        tables = "SELECT count(*) FROM sqlite_schema"
        # nothing was written yet; a file of another program is never taken for an empty one
        if not any(numbers) and connection.execute(tables).fetchone()[0] == 0:
            connection.execute("PRAGMA journal_mode = WAL")
            connection.executescript(
                f"BEGIN IMMEDIATE; {SCHEMA}"
                f"PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {VERSION}; COMMIT;"
            )
        _require_ours(connection, path)
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")
        unless_good.pop_all()
    return connection


def open_to_read(path: Path) -> sqlite3.Connection:
    """Open the audit without changing it, also while a service writes.

    Raises: GcsError naming the file, when it is missing or of another program.
    """
    if not path.is_file():
        raise GcsError(f"{path}: there is no such file; a service with a `record` writes audit.sqlite")
    try:
        connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True, timeout=BUSY_S)
        connection.row_factory = sqlite3.Row
    except sqlite3.Error as error:
        raise GcsError(f"{path}: cannot be read: {error}") from None
    with ExitStack() as unless_good:
        unless_good.callback(connection.close)
        _require_ours(connection, path)
        unless_good.pop_all()
    return connection


def _require_ours(connection: sqlite3.Connection, path: Path) -> None:
    """Raises: GcsError when the file is not an audit, or of an unknown version."""
    if _number(connection, path, "application_id") != APPLICATION_ID:
        raise GcsError(f"{path}: a database, but not an audit of this program")
    version = _number(connection, path, "user_version")
    if version != VERSION:
        raise GcsError(f"{path}: an audit of version {version}; this program knows version {VERSION}")


def _number(connection: sqlite3.Connection, path: Path, name: str) -> int:
    try:
        return int(connection.execute(f"PRAGMA {name}").fetchone()[0])
    except sqlite3.OperationalError:
        raise  # busy, or a disk error
    except sqlite3.DatabaseError as error:
        raise GcsError(f"{path}: not an audit of this program: {error}") from None


class AuditRow(NamedTuple):
    """One statement and its values."""

    sql: str
    values: Sequence[Value]


class Journal(DiskWriter[AuditRow]):
    """One file. Rows that the disk does not accept are kept, and written once it does."""

    PERIOD_S = 0.0
    REPEATS = True

    def __init__(self, path: Path) -> None:
        super().__init__(path, "rows of the audit", ROWS_MAX)
        self._path = path
        self._connection: sqlite3.Connection | None = None

    def _write(self, batch: Sequence[AuditRow]) -> None:
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
