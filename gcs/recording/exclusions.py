"""Finds in the record the vehicles that are excluded from the show, over any number of sessions."""

import json
from pathlib import Path
from typing import Final

from gcs.model.errors import GcsError
from gcs.model.preflight_report import Exclusion
from gcs.model.state import VehicleId
from gcs.recording.last_known import audit_file, rows

EXCLUDED: Final = "excluded"
INCLUDED: Final = "included"


def exclusions(root: Path) -> dict[VehicleId, Exclusion]:
    """Excluded vehicles, by which operator, why and since when. To be called before a new session begins.

    Raises: GcsError when there is a record, and it cannot be read.
    """
    if not audit_file(root).is_file():
        return {}
    sql = f"SELECT * FROM events WHERE event IN ('{EXCLUDED}', '{INCLUDED}') ORDER BY rowid"  # noqa: S608
    out: dict[VehicleId, Exclusion] = {}
    for row in rows(root, sql):
        out.pop(row["vehicle"], None)
        if row["event"] == EXCLUDED:
            try:
                stated = json.loads(row["detail"])
                out[row["vehicle"]] = Exclusion(stated["by"], stated["reason"], float(row["unix_s"]))
            except (KeyError, TypeError, ValueError) as error:
                reported = f"the exclusion of {row['vehicle']} cannot be read: {error!r}"
                raise GcsError(f"{root}: {reported}") from None
    return out
