"""Reads what the audit keeps for people: commands, calls and events."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gcs.model.state import VehicleId
from gcs.recording.audit_reader import rows


@dataclass(frozen=True, slots=True)
class PastCommand:
    """An accepted command, with its last outcome for each vehicle: (outcome, reason)."""

    session: str
    id: str
    accepted_unix_s: float
    caller: str
    action: str
    outcomes: Mapping[VehicleId, tuple[str, str]]


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
