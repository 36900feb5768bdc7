"""Records commands given to a fleet without its service, in the session that knew it last."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Self

from gcs.model.lifecycle import Phase
from gcs.model.state import VehicleId
from gcs.recording.audit import Audit
from gcs.recording.last_known import LastKnown, audit_file
from gcs.recording.sqlite_writer import Journal, Row
from gcs.service import CommandRecord, Outcome, VehicleOutcome

REASON = "motors stopped by gcs kill, without the service"


class OfflineAudit:
    """Rows for the newest session. A disk error is reported by `problem`, and stops nothing."""

    def __init__(self, root: Path, known: LastKnown, who: str) -> None:
        """Writes nothing before it is entered."""
        vehicles = {one.id: (one.system_id, one.link) for one in known.vehicles.values()}
        self._known = known
        self._who = who
        self._journal = Journal(audit_file(root))
        self._audit = Audit(self._journal, "" if known.session is None else known.session.id, vehicles)
        self.problem = ""

    def __enter__(self) -> Self:
        """Begin to write, as soon as the disk allows."""
        self._journal.open()
        return self

    def __exit__(self, *_error: object) -> None:
        """Write what is left."""
        self._journal.close()
        self.problem = self._journal.problem

    def opened(self, action: str, vehicles: Sequence[VehicleId]) -> str:
        """Record a command. Returns: its id, distinct from those of every service."""
        now_s = time.time()
        parts = {name: VehicleOutcome(Outcome.PENDING) for name in vehicles}
        command = CommandRecord(f"outside-{now_s:.3f}", action, now_s, parts, self._who)
        self._audit.opened(command, self._who)
        return command.id

    def closed(self, command_id: str, vehicle_id: VehicleId, part: VehicleOutcome) -> None:
        """Record the outcome of one vehicle's part."""
        self._audit.closed(command_id, vehicle_id, part.outcome, part.reason)

    def killed(self, vehicle_id: VehicleId) -> None:
        """Record that its motors are off, for the next start of the service."""
        was = self._known.vehicles[vehicle_id].phase
        detail = {"was": was, "phase": Phase.KILLED.value, "reason": REASON}
        self._audit.event(time.time(), "warning", "vehicle_phase", vehicle_id, detail)
        sql = "UPDATE vehicles SET unix_s = ?, phase = ?, reason = ?, armed = 0 WHERE id = ?"
        self._journal.put([Row(sql, (time.time(), Phase.KILLED.value, REASON, vehicle_id))])
