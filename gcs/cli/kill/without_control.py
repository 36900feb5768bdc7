"""A kill by the API's process, while control's process hangs: for consoles and clients on other computers."""

import asyncio
import json
import logging
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from gcs.cli.kill.directly import KillPart, kill_directly
from gcs.cli.kill.plan import KillPlan, links_of, plan_of
from gcs.model.errors import GcsError
from gcs.model.state import VehicleId
from gcs.service import CALLER, CommandRecord, Outcome, VehicleOutcome

log = logging.getLogger(__name__)

WITHIN_S: Final = 2.0
KEPT_MAX: Final = 100


class KillWithoutControl:
    """Implements `gcs.service.interface.LastResort` with control's record and links."""

    def __init__(self, record: Path | None, links: str) -> None:
        """`links` are those of the configuration, as JSON."""
        self._record = record
        self._links = links_of(json.loads(links), "the configuration")
        self._commands: dict[str, CommandRecord] = {}
        self._recording: set[asyncio.Task[None]] = set()

    def find(self, command_id: str) -> CommandRecord | None:
        return self._commands.get(command_id)

    async def kill(self, vehicle_ids: Sequence[VehicleId]) -> CommandRecord:
        began_unix_s, caller = time.time(), CALLER.get()
        parts = await asyncio.to_thread(self._killed, vehicle_ids)
        log.warning("kill_without_control", extra={"vehicles": ", ".join(vehicle_ids), "by": caller})
        outcomes = {
            name: VehicleOutcome(
                Outcome.DONE if part.done else Outcome.FAILED, f"without control: {part.reason}"
            )
            for name, part in parts.items()
        }
        command = CommandRecord(f"outside-{began_unix_s:.3f}", "kill", began_unix_s, outcomes, caller)
        self._commands[command.id] = command
        while len(self._commands) > KEPT_MAX:
            del self._commands[next(iter(self._commands))]
        task = asyncio.create_task(self._keep(parts, began_unix_s, caller), name="kill/record")
        self._recording.add(task)
        task.add_done_callback(self._recording.discard)
        return command

    def _killed(self, names: Sequence[VehicleId]) -> Mapping[VehicleId, KillPart]:
        try:
            plan = KillPlan("the configuration", self._links)
            if self._record is not None:
                plan = plan_of(self._record, self._links)
            return kill_directly(plan, names, WITHIN_S)
        except GcsError as error:
            return {name: KillPart(False, str(error)) for name in names}

    async def _keep(self, parts: Mapping[VehicleId, KillPart], began_unix_s: float, caller: str) -> None:
        if self._record is not None:
            await asyncio.to_thread(_recorded, self._record, parts, began_unix_s, caller)


def _recorded(record: Path, parts: Mapping[VehicleId, KillPart], began_unix_s: float, caller: str) -> None:
    from gcs.cli.kill.record import record_kill  # noqa: PLC0415 (a second, only where control hangs)

    if problem := record_kill(record, parts, began_unix_s, caller):
        log.error("recording_failed", extra={"what": "kills", "cause": problem})
