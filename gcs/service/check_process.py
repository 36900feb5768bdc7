"""Run a `gcs` subcommand in a low-priority subprocess and return its JSON.

Such a process reads untrusted files. It may exhaust neither the machine's memory nor the service's: its
memory and its output are bounded here, its time by the caller.
"""

import asyncio
import contextlib
import json
import os
import resource
import sys
from collections.abc import Sequence
from typing import Any, Final

from gcs.model.errors import RefusedError

LOWEST, LOWER, USUAL = 19, 10, 0
"""Priorities beside a flight of what takes minutes and of what takes seconds, and where no vehicle flies."""

WORDS: Final = 300

ANSWER_MAX_BYTES: Final = 4 << 20
"""The check of the largest show prints a few hundred kilobytes."""

MEMORY_MAX_BYTES: Final = 2 << 30
"""Limit of the address space, of which libraries reserve half a gigabyte that they never use."""

FRUGAL: Final = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}
"""Without these, libraries reserve address space for every core."""

PIECE_BYTES: Final = 1 << 16


class EndedError(RefusedError):
    """The process reported an error: `words` of its own."""

    def __init__(self, code: int | None, words: str) -> None:
        super().__init__(f"it ended with {code}: {words}")
        self.words = words


async def answered(arguments: Sequence[str], within_s: float, *given: Any, **named: Any) -> dict[str, Any]:
    """Return the JSON object that `gcs ARGUMENTS` prints; arguments and errors as of `printed`.

    Raises: ValueError when the output is not JSON.
    """
    answer = await asyncio.to_thread(json.loads, await printed(arguments, within_s, *given, **named))
    if not isinstance(answer, dict):
        raise RefusedError("it answered no JSON object")
    return answer


async def printed(
    arguments: Sequence[str],
    within_s: float,
    priority: int = LOWEST,
    *,
    codes: Sequence[int] = (0, 1),
    answer_max_bytes: int = ANSWER_MAX_BYTES,
    memory_max_bytes: int = MEMORY_MAX_BYTES,
) -> bytes:
    """Return what `gcs ARGUMENTS` prints, also if it reports problems.

    Args:
        arguments: of the command.
        within_s: after this time the process is ended.
        priority: of the process; 19 is the lowest.
        codes: exit codes with which the output is an answer.
        answer_max_bytes: a process that prints more is ended.
        memory_max_bytes: limit of its address space; beyond it, its allocations fail.

    Raises: EndedError with its last lines when it failed, RefusedError when it printed too much, OSError when
        it could not be started, TimeoutError after `within_s`.
    """
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "gcs", *arguments),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        env=os.environ | FRUGAL,
    )
    try:
        restrict(process.pid, priority, memory_max_bytes)
        async with asyncio.timeout(within_s), asyncio.TaskGroup() as group:
            answer = group.create_task(_read(process.stdout, answer_max_bytes))
            complaint = group.create_task(_read(process.stderr, answer_max_bytes))
            group.create_task(process.wait())
    except ExceptionGroup as failed:  # of one reader; the other was cancelled
        raise failed.exceptions[0] from None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    output = answer.result()
    if process.returncode not in codes or not output:
        words = _words(complaint.result())
        if "MemoryError" in words:
            words = f"it needed more than {memory_max_bytes >> 20} MiB of memory"
        raise EndedError(process.returncode, words[-WORDS:])
    return output


def _words(complaint: bytes) -> str:
    """Return the process's error text if its output is JSON, otherwise the whole output."""
    words = complaint.decode(errors="replace").strip()
    try:
        return str(json.loads(words.rpartition("\n")[2])["error"]["detail"])
    except (ValueError, KeyError, TypeError, RecursionError):
        return words


def restrict(pid: int, priority: int, memory_max_bytes: int) -> None:
    """Set a process back: its scheduling, its priority, and the limit of its address space."""
    with contextlib.suppress(ProcessLookupError):  # it has ended already
        if sys.platform == "linux":
            os.sched_setscheduler(pid, os.SCHED_OTHER, os.sched_param(0))  # a service may be real-time
            resource.prlimit(pid, resource.RLIMIT_AS, (memory_max_bytes, memory_max_bytes))
        os.setpriority(os.PRIO_PROCESS, pid, priority)


async def _read(stream: asyncio.StreamReader | None, most_bytes: int) -> bytes:
    """Read all output. Raises: RefusedError if it exceeds `most_bytes`."""
    if stream is None:
        return b""
    output = bytearray()
    while piece := await stream.read(PIECE_BYTES):
        output += piece
        if len(output) > most_bytes:
            raise RefusedError(f"it was ended: it printed more than {most_bytes >> 10} KiB")
    return bytes(output)
