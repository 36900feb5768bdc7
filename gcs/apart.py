"""Commands of ours in a process of their own, at a lower priority: for what computes beside the service."""

import asyncio
import contextlib
import json
import os
import sys
from collections.abc import Sequence
from typing import Any, Final

from gcs.errors import RefusedError

LOWEST, LOWER = 19, 10
"""Priorities: beside a flight, and where nothing flies."""

WORDS: Final = 300


async def answered(arguments: Sequence[str], within_s: float, priority: int = LOWEST) -> dict[str, Any]:
    """The JSON object that `gcs ARGUMENTS` prints; it may find something wrong (exit code 1).

    Raises: RefusedError with its last words when it fails, OSError when it cannot be started, TimeoutError,
    ValueError when it prints no JSON.
    """
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "gcs", *arguments),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        with contextlib.suppress(ProcessLookupError):  # it has ended already
            os.setpriority(os.PRIO_PROCESS, process.pid, priority)
        async with asyncio.timeout(within_s):
            said, complaint = await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    if process.returncode not in (0, 1) or not said:
        words = complaint.decode(errors="replace").strip()
        raise RefusedError(f"it ended with {process.returncode}: {words[-WORDS:]}")
    answer = json.loads(said)
    if not isinstance(answer, dict):
        raise RefusedError("it answered no JSON object")
    return answer
