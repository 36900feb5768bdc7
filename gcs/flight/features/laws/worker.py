"""The process of one law, begun by `gcs.flight.features.laws.process` only.

An error of the law ends it; its last line says which. So do too much memory, and a call without end.
"""

import ctypes
import json
import os
import resource
import signal
import sys
import time
import traceback
from dataclasses import asdict, replace
from mmap import mmap
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Final

import numpy as np
from pydantic import ValidationError

from gcs.flight.features.laws.rows import ANSWER, Declared, line, received, table_in
from gcs.formation.laws.conformance import answered, sample
from gcs.formation.laws.protocol import LawAnswer, LawInputs
from gcs.formation.laws.registry import law_at
from gcs.model.errors import InvalidError

MEMORY_MAX: Final = 256 * 2**20
"""Bytes that a law may take beyond those of its process at the beginning."""

PR_SET_PDEATHSIG: Final = 1
"""Of prctl(2): the kernel ends this process with the service, in whatever its law is then."""

STUCK_S: Final = 5.0
"""A call that lasts longer ends the process, whoever began it."""


def main() -> None:
    place, folder, settings, memory_fd, size = sys.argv[1:]
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what the law prints is no answer

    def report(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        frames = traceback.extract_tb(trace)
        where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
        text = ": ".join(filter(None, (kind.__name__, str(error)[:200]))) + where
        if isinstance(error, ValidationError):
            text = _misfits(error)
        elif isinstance(error, InvalidError):  # of this program, about the law
            text = str(error)
        answers.write(line({"error": text}))

    sys.excepthook = report
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    if folder:
        sys.path.insert(0, folder)
    memory = mmap(int(memory_fd), int(size))
    _serve(place, json.loads(settings), sys.stdin.buffer, answers, memory)


def _serve(place: str, values: object, requests: BinaryIO, answers: BinaryIO, memory: mmap) -> None:
    law, table, before = law_at(place), table_in(memory), None
    settings = law.settings.model_validate(values)
    answered(law, sample(5, settings))  # imports and compiles what is done at the first call
    answers.write(line(asdict(Declared(law.goal_shape.value, law.adds_spin, law.stations))))
    _bound_memory()
    for request in requests:
        inputs = received(json.loads(request), table, before, settings)
        signal.setitimer(signal.ITIMER_REAL, STUCK_S)
        began_s = time.process_time()
        answer = answered(law, inputs)
        before = replace(inputs, state=answer.next_state())
        took_s = time.process_time() - began_s
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        answers.write(line(_put(answer, inputs, table) | {"took_s": took_s}))


def _put(answer: LawAnswer, inputs: LawInputs, table: np.ndarray) -> dict[str, object]:
    velocity_m_s, shape = np.asarray(answer.velocity_m_s, np.float64), (len(inputs.ids), 3)
    if velocity_m_s.shape != shape:
        return {"error": f"it returned an array of shape {velocity_m_s.shape}; {shape} is needed"}
    table[: len(inputs.ids), ANSWER] = velocity_m_s
    return {}


def _misfits(error: ValidationError) -> str:
    """Which settings the law does not take, on one line."""
    texts = [f"{'.'.join(map(str, each['loc']))}: {each['msg']}" for each in error.errors()]
    return ("its settings do not fit: " + ", ".join(texts))[:300]


def _bound_memory() -> None:
    """Have the law get no more memory than `MEMORY_MAX` from now on."""
    if sys.platform == "linux":
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
        most = pages * resource.getpagesize() + MEMORY_MAX
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))


if __name__ == "__main__":
    main()
