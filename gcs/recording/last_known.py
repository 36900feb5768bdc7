"""The last known state and all commands, read from the record after a restart or without a service."""

import json
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from sqlite3 import DatabaseError, Row
from typing import Any, Final

from gcs.model.errors import GcsError
from gcs.model.state import VehicleId
from gcs.recording.schema import open_to_read

AUDIT: Final = "audit.sqlite"
"""Name of the audit file in the folder configured under `record`."""


@dataclass(frozen=True, slots=True)
class Session:
    """One run of the service."""

    id: str
    began_unix_s: float
    ended_unix_s: float | None  # None: it runs, or was killed
    folder: Path  # its flight data
    config: Mapping[str, Any]  # as `gcs.config.schema.Config.model_validate` takes it


@dataclass(frozen=True, slots=True)
class KnownVehicle:
    """The last known state of one vehicle. None: never known."""

    id: VehicleId
    session: str  # the newest that recorded it
    unix_s: float
    system_id: int
    link: str
    host: str | None  # an address and a port, or a serial port and 0
    port: int | None
    phase: str | None
    reason: str | None
    mode: str | None
    armed: bool | None
    home_m: tuple[float, float, float] | None  # show frame of its session's configuration


@dataclass(frozen=True, slots=True)
class KnownShow:
    """The last known state of the show."""

    session: str
    unix_s: float
    phase: str
    reason: str
    plan: Mapping[str, Any]  # formation, orbit, target ...; `time_s` is of a clock that has ended


@dataclass(frozen=True, slots=True)
class LastKnown:
    """All that is needed to find the vehicles and to continue their show."""

    session: Session | None  # the newest
    show: KnownShow | None
    vehicles: Mapping[VehicleId, KnownVehicle]


@dataclass(frozen=True, slots=True)
class PastCommand:
    """An accepted command, with its last outcome for each vehicle: (outcome, reason)."""

    session: str
    id: str
    accepted_unix_s: float
    who: str
    action: str
    outcomes: Mapping[VehicleId, tuple[str, str]]


def audit_file(path: Path) -> Path:
    """Return the audit's file: the path itself, or the one in a folder."""
    return path / AUDIT if path.is_dir() else path


def last_known(path: Path) -> LastKnown:
    """Read the last known state, also while the service runs or after it was killed.

    Args:
        path: the audit, or its folder.

    Raises: GcsError when there is none, or the file is damaged or of another program.
    """
    sessions = rows(path, "SELECT * FROM sessions ORDER BY began_unix_s DESC, id DESC LIMIT 1")
    shows = rows(path, "SELECT * FROM show")
    vehicles = rows(path, "SELECT * FROM vehicles ORDER BY id")
    return LastKnown(
        _session(sessions[0]) if sessions else None,
        _show(shows[0]) if shows else None,
        {row["id"]: _vehicle(row) for row in vehicles},
    )


def commands(path: Path) -> list[PastCommand]:
    """Return every accepted command, oldest first. Raises: GcsError."""
    outcomes: dict[tuple[str, str], dict[VehicleId, tuple[str, str]]] = {}
    for row in rows(path, "SELECT * FROM outcomes ORDER BY rowid"):
        parts = outcomes.setdefault((row["session"], row["command_id"]), {})
        parts[row["vehicle"]] = (row["outcome"], row["reason"])
    return [
        PastCommand(**dict(row), outcomes=outcomes.get((row["session"], row["id"]), {}))
        for row in rows(path, "SELECT * FROM commands ORDER BY accepted_unix_s, session, length(id), id")
    ]


def calls(path: Path) -> list[dict[str, Any]]:
    """Return every recorded call of the API, oldest first. Raises: GcsError."""
    return [dict(row) for row in rows(path, "SELECT * FROM calls ORDER BY rowid")]


def events(path: Path) -> list[dict[str, Any]]:
    """Return every event, oldest first, with its parsed `detail`. Raises: GcsError."""
    found = rows(path, "SELECT * FROM events ORDER BY rowid")
    return [{**dict(row), "detail": json.loads(row["detail"])} for row in found]


def rows(path: Path, sql: str, *values: str) -> list[Row]:
    """Return the rows of a query. Raises: GcsError."""
    file = audit_file(path)
    with closing(open_to_read(file)) as connection:
        try:
            return connection.execute(sql, values).fetchall()
        except DatabaseError as error:
            raise GcsError(f"{file}: cannot be read: {error}") from None


def _session(row: Row) -> Session:
    return Session(
        row["id"], row["began_unix_s"], row["ended_unix_s"], Path(row["folder"]), json.loads(row["config"])
    )


def _show(row: Row) -> KnownShow:
    return KnownShow(row["session"], row["unix_s"], row["phase"], row["reason"], json.loads(row["plan"]))


def _vehicle(row: Row) -> KnownVehicle:
    values = dict(row)
    home_m = tuple(values.pop(name) for name in ("home_x_m", "home_y_m", "home_z_m"))
    armed = values.pop("armed")
    known = None if None in home_m else home_m
    return KnownVehicle(**values, armed=None if armed is None else bool(armed), home_m=known)
