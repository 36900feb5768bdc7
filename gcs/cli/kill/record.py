"""Records a kill without the service, after it: in the newest session of the service's record."""

from collections.abc import Mapping
from pathlib import Path

from gcs.model.errors import GcsError
from gcs.recording.audit import OfflineAudit
from gcs.recording.audit_reader import last_known
from gcs.service import Outcome, VehicleOutcome


def record_kill(
    record: Path, outcomes: Mapping[str, tuple[bool, str]], began_unix_s: float, caller: str
) -> str:
    """Record the command, and for each vehicle whether it is done, and why. Returns: the problem, or ""."""
    try:
        known = last_known(record)
    except GcsError as error:
        return str(error)
    with OfflineAudit(record, known, caller) as audit:
        command_id = audit.opened("kill", [*outcomes], began_unix_s)
        for name, (done, reason) in outcomes.items():
            audit.closed(command_id, name, VehicleOutcome(Outcome.DONE if done else Outcome.FAILED, reason))
    return audit.problem
