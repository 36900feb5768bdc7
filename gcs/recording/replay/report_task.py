"""The flight report of a record while it is replayed: `gcs report` in a process of its own."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from gcs.model.errors import GcsError
from gcs.recording.flight_report import EXIT_CODES
from gcs.service import CheckState, ReportState
from gcs.service.check_process import LOWER, answered

WITHIN_S: Final = 1800.0

MEMORY_MAX_BYTES: Final = 16 << 30
"""Limit of the address space: a long flight of a thousand vehicles is held in memory."""


class ReportTask:
    """Runs the report once. Used on the event loop."""

    def __init__(self, files: Sequence[Path]) -> None:
        """Flight data, and files of true positions if there are any."""
        self._files = tuple(files)
        self._found = ReportState(CheckState.RUNNING)
        self._task: asyncio.Task[None] | None = None

    def ask(self) -> ReportState:
        """Return the state of the report; the first call starts it."""
        if self._task is None:
            self._task = asyncio.create_task(self._judge(), name="report")
        return self._found

    async def _judge(self) -> None:
        try:
            arguments = ("report", *map(str, self._files), "--json")
            report = await answered(
                arguments,
                WITHIN_S,
                LOWER,
                codes=tuple(EXIT_CODES.values()),
                memory_max_bytes=MEMORY_MAX_BYTES,
            )
            self._found = ReportState(CheckState.DONE, report=report)
        except TimeoutError:
            self._found = ReportState(CheckState.FAILED, f"not done within {WITHIN_S:g} s")
        except (GcsError, OSError, ValueError) as error:
            self._found = ReportState(CheckState.FAILED, str(error))

    async def close(self) -> None:
        """End the running process."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
