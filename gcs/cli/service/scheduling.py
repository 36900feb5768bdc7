"""The scheduling class of a service: what the machine grants of real-time priority and locked memory.

The whole process is raised, not control's thread alone: a thread at usual priority that holds the
interpreter's lock while other programs have its core would stop control. Threads that compute long step down
(`step_down`), and programs that the service starts are set back (`set_back`, `gcs.service.check_process`).
"""

import ctypes
import gc
import os
import resource
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final, Literal

from gcs.service import Scheduling

PriorityRequest = Literal["real-time", "usual"]

PRIORITY: Final = 10
"""Of 1 to 99: above every ordinary program, below the kernel's threads for network cards (50)."""

NICE: Final = -10

_CURRENT, _FUTURE, _ON_FAULT = 1, 2, 4
"""mlockall's flags. On fault: only pages that are used, not the whole stack of every thread."""

FIX: Final = (
    "grant LimitRTPRIO=10 and LimitMEMLOCK=infinity in the unit file (docs/formation-gcs.service), "
    "or set scheduling: usual"
)


def ask(asked: PriorityRequest) -> Scheduling:
    """Raise this thread, and all threads that it starts from now on, as far as the machine permits.

    Also locks the memory, so that no page has to be read again in flight, and hides what exists now from
    the garbage collector. To be called after all kernels have been compiled.

    Returns: what was granted.
    """
    gc.collect()
    gc.freeze()
    if asked == "usual" or sys.platform != "linux":
        return Scheduling()
    return Scheduling(_raised(), _locked())


def step_down() -> None:
    """Let this thread, which computes for long, run as an ordinary one.

    Real-time threads take turns of 100 ms on one core. Ordinary ones with nice -10 are nine times as fast as
    other programs, so that the interpreter's lock is not held for long.
    """
    if sys.platform == "linux":
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def set_back(pid: int) -> None:
    """Let a process that this one has started run as an ordinary one. Raises: ProcessLookupError."""
    if sys.platform == "linux":
        os.sched_setscheduler(pid, os.SCHED_OTHER, os.sched_param(0))
    if os.getpriority(os.PRIO_PROCESS, pid) < 0:
        os.setpriority(os.PRIO_PROCESS, pid, 0)


def _raised() -> str:
    if os.getpriority(os.PRIO_PROCESS, 0) > NICE:
        with suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, 0, NICE)  # of this thread, in Linux
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
        return f"real-time {PRIORITY}"
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    return f"nice {nice}" if nice < 0 else Scheduling().priority


def _locked() -> bool:
    """With a limit, later allocations would fail: memory is locked only without one."""
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if limit != resource.RLIM_INFINITY and not _is_privileged():
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    return bool(libc.mlockall(_CURRENT | _FUTURE | _ON_FAULT) == 0)


_CAP_IPC_LOCK: Final = 14


def _is_privileged() -> bool:
    """Whether this process may lock any amount of memory."""
    with suppress(OSError):
        for line in Path("/proc/self/status").read_bytes().splitlines():
            if line.startswith(b"CapEff:"):
                return bool(int(line.split()[1], 16) >> _CAP_IPC_LOCK & 1)
    return False
