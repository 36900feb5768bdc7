"""Commands of ours in a process of their own, at the lowest priority: for what computes beside the flight."""

import asyncio
import contextlib
import json
import os
import sys
from collections.abc import Sequence
from typing import Any, Final

from gcs.errors import RefusedError

LOWEST_PRIORITY: Final = 19
WORDS: Final = 300


async def answered(arguments: Sequence[str], within_s: float) -> dict[str, Any]:
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
            os.setpriority(os.PRIO_PROCESS, process.pid, LOWEST_PRIORITY)
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
