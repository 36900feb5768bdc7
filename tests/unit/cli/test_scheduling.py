"""What a service asks of the machine: each case in a process of its own, whose priority it changes."""

import json
import os
import resource
import subprocess
import sys
from dataclasses import dataclass

import pytest

from gcs.cli.service.scheduling import PRIORITY

ASK = """
import json, os, sys, threading
from gcs.cli.service import scheduling

asked, without_rights = sys.argv[1:]
if without_rights == "without rights" and os.geteuid() == 0:
    os.setgroups([])
    os.setgid(65534)
    os.setuid(65534)
granted = scheduling.ask(asked)
classes = {}

def look(name, before):
    before()
    classes[name] = os.sched_getscheduler(0)

for name, before in (("inherits", lambda: None), ("steps down", scheduling.step_down)):
    thread = threading.Thread(target=look, args=(name, before))
    thread.start()
    thread.join()
status = open("/proc/self/status", "rb").read().decode()
print(json.dumps({
    "priority": granted.priority,
    "memory_locked": granted.memory_locked,
    "locked_kb": int(status.split("VmLck:")[1].split()[0]),
    "real_time": os.sched_getparam(0).sched_priority,
    "nice": os.getpriority(os.PRIO_PROCESS, 0),
    "classes": classes,
    "block": len(bytearray(64 << 20)),
}))
"""


@dataclass(frozen=True)
class Answer:
    priority: str
    memory_locked: bool
    locked_kb: int
    real_time: int
    nice: int
    classes: dict[str, int]
    block: int


def ask(asked: str, rights: str = "with rights") -> Answer:
    command = [sys.executable, "-c", ASK, asked, rights]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return Answer(**json.loads(done.stdout))


@pytest.mark.parametrize("rights", ["with rights", "without rights"])
def test_what_is_reported_is_what_the_kernel_grants(rights: str) -> None:
    answer = ask("real-time", rights)
    if answer.real_time:
        assert answer.priority == f"real-time {PRIORITY}"
        assert answer.real_time == PRIORITY
        assert answer.classes == {"inherits": os.SCHED_RR, "steps down": os.SCHED_OTHER}
    else:
        assert answer.priority == (f"nice {answer.nice}" if answer.nice < 0 else "usual")
        assert set(answer.classes.values()) == {os.SCHED_OTHER}
    assert answer.memory_locked == (answer.locked_kb > 0)


def test_memory_is_not_locked_under_a_limit() -> None:
    """With mlockall under a limit of 8 MB the block of 64 MB could not be had."""
    answer = ask("real-time", "without rights")
    if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] != resource.RLIM_INFINITY:
        assert not answer.memory_locked
    assert answer.block == 64 << 20


def test_nothing_is_asked_where_the_configuration_says_so() -> None:
    answer = ask("usual")
    assert (answer.priority, answer.memory_locked) == ("usual", False)
    assert (answer.real_time, answer.locked_kb) == (0, 0)
    assert answer.nice == os.getpriority(os.PRIO_PROCESS, 0)


def test_products_of_matrices_wait_for_no_other_thread() -> None:
    """Threads of OpenBLAS do not get real-time priority, and control would wait for them in a busy loop."""
    program = "import os; from gcs.__main__ import main; main(); import numpy as np; "
    program += "np.ones((600, 600)) @ np.ones((600, 600)); "
    program += "print(len(os.listdir('/proc/self/task')))"
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    command = [sys.executable, "-c", program, "--version"]
    found = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert found.stdout.splitlines()[-1] == "1"
