"""The flight's end of a law's process: asks it in every tick, waits a bounded time, and judges the answer.

The tick never waits longer than the law's budget. Between answers the last velocities are flown, for
`LATE_S` at most; from then on, and from the first answer that breaks a bound, all vehicles stop.
"""

import contextlib
import fcntl
import json
import os
import select
import signal
import subprocess
import sys
import time
import weakref
from collections import deque
from collections.abc import Mapping
from mmap import mmap
from typing import Any, Final

import numpy as np

from gcs.flight.features.laws.rows import ANSWER, handed_over, size_of, table_in
from gcs.formation.article import no_faster
from gcs.formation.laws.conformance import why_wrong
from gcs.formation.laws.protocol import GoalShape, LawAnswer, LawInputs, waits
from gcs.formation.laws.registry import code_folder, declare, place_of
from gcs.model.errors import InvalidError, visible
from gcs.model.state import Array, Mask, VehicleId

BUDGET_SHARE: Final = 0.2
"""Share of a tick that a law may take, and that the tick waits for it."""

LATE_S: Final = 0.25
"""A law that is late for so long is not relied on any more."""

TURNS_M_S, TURNS_MOST, TURNS_WITHIN = 1.0, 4, 8
"""A velocity that is reversed by more than this, so often within so many ticks, toggles."""

ANEW_S: Final = 1.0
"""A law that was not asked for so long has no state: the formation is new, or flies again."""

BEGINS_S: Final = 20.0
"""A process that says nothing for so long after its begin has failed."""

ANSWER_MAX, WHY_MAX = 4096, 300

SEALS: Final = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL
"""The shared table keeps its size: reading beyond a shorter one would end the service."""


class LawProcess:
    """One law in a process of its own. `failed` says why it is not relied on; it stays so."""

    def __init__(
        self,
        name: str,
        settings: Mapping[str, object],
        rows_max: int,
        tick_s: float,
        wait_s: float | None = None,
    ) -> None:
        """Begins the process, and does not wait for it.

        Args:
            name: of a law that is not shipped.
            settings: for the law's own model.
            rows_max: most vehicles in formation.
            tick_s: from one tick to the next.
            wait_s: for an answer, in true time; None: the law's budget. More where time is virtual.
        """
        self.name, self.failed = name, ""
        self.ready = False
        self._budget_s = BUDGET_SHARE * tick_s
        self._wait_s = self._budget_s if wait_s is None else wait_s
        self._late_most, self._late, self._asked = max(1, round(LATE_S / tick_s)), 0, False
        self._inputs: LawInputs | None = None  # that were asked about last
        self._named: tuple[VehicleId, ...] = ()  # as the process has them
        self._last: dict[VehicleId, Array] = {}  # (3,) of the newest answer
        self._last_m_s = np.zeros((0, 3))
        self._turned: deque[Mask] = deque(maxlen=TURNS_WITHIN)
        self._unread, self._began_s = b"", time.monotonic()
        memory_fd = os.memfd_create("law", os.MFD_ALLOW_SEALING)
        os.ftruncate(memory_fd, size_of(rows_max))
        fcntl.fcntl(memory_fd, fcntl.F_ADD_SEALS, SEALS)
        self._table = table_in(mmap(memory_fd, size_of(rows_max)))
        values = json.dumps(dict(settings))
        words = [place_of(name), code_folder(), values, str(memory_fd), str(size_of(rows_max))]
        self._process = subprocess.Popen(  # noqa: S603 (this program)
            [sys.executable, "-m", "gcs.flight.features.laws.worker", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            pass_fds=(memory_fd,),
            bufsize=0,
            start_new_session=True,  # an interrupt of the terminal is for the service
            env=os.environ | dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"),
        )
        os.close(memory_fd)
        to, answers = self._process.stdin, self._process.stdout
        if to is None or answers is None:
            raise InvalidError("law", name, "a process with pipes")
        self._to, self._from = to.fileno(), answers.fileno()
        os.set_blocking(self._to, False)
        os.set_blocking(self._from, False)
        self._ends = weakref.finalize(self, _end, self._process)
        self._poll = select.poll()
        self._poll.register(self._from, select.POLLIN)

    def begin(self, wait_s: float = 0.0) -> None:
        """Note whether the process has begun, waiting so long for it, and what its law says of itself."""
        if self.ready or self.failed:
            return
        values = self._read(time.monotonic() + wait_s)
        if values is not None:
            shapes = [shape for shape in GoalShape if shape == values.get("goal_shape")]
            led = values.get("stations") == "led"
            declare(self.name, *shapes, adds_spin=values.get("adds_spin") is True, led=led)
            self.ready = True
        elif time.monotonic() - self._began_s > BEGINS_S:
            self.fail(f"it did not begin within {BEGINS_S:g} s")

    def velocity(self, inputs: LawInputs) -> LawAnswer:
        """The law's answer, or what is flown instead. Never raises, and waits for `wait_s` at most."""
        until_s = time.monotonic() + self._wait_s
        self.begin()
        if not self.ready:  # vehicles that flew before this service began hold until then
            return waits(len(inputs.ids))
        if self._asked:
            self._take(until_s)
        on_time = False
        if not (self._asked or self.failed):
            self._ask(inputs)
            on_time = self._take(until_s)
        self._late = 0 if on_time else self._late + 1
        if self._late >= self._late_most:
            self.fail(
                f"it took longer than {1e3 * self._budget_s:g} ms in {self._late} ticks one after the other"
            )
        return waits(len(inputs.ids)) if self.failed else LawAnswer(self._newest_m_s(inputs.ids))

    def fail(self, why: str) -> None:
        """Rely on the law no more, and end its process; its reason becomes one line for any terminal."""
        self.failed = self.failed or visible(why[:WHY_MAX].replace("\n", " "))
        _kill(self._process)

    def close(self) -> None:
        """End the process."""
        self._ends()

    def _newest_m_s(self, ids: tuple[VehicleId, ...]) -> Array:
        """(n, 3) velocities of the newest answer; 0 for vehicles that joined since."""
        asked = self._inputs
        if asked is not None and asked.ids == ids and len(self._last_m_s) == len(ids):
            return self._last_m_s.copy()
        nothing = np.zeros(3)
        return np.array([self._last.get(name, nothing) for name in ids]).reshape(-1, 3)

    def _ask(self, inputs: LawInputs) -> None:
        if len(inputs.ids) > len(self._table):
            self.fail(f"{len(inputs.ids)} vehicles are in formation, more than {len(self._table)}")
            return
        named, before = inputs.ids != self._named, self._inputs
        anew = before is not None and inputs.time_s - before.time_s > ANEW_S
        if anew:
            self._last, self._last_m_s = {}, np.zeros((0, 3))
        request = handed_over(inputs, self._table, named=named, anew=anew)
        try:
            sent = os.write(self._to, request)
        except OSError as error:  # its process has ended, or does not read
            self.fail(f"its process takes no request: {error.strerror}")
            return
        if sent < len(request):
            self.fail("its process takes no request")
        self._inputs, self._named, self._asked = inputs, inputs.ids, True

    def _take(self, until_s: float) -> bool:
        """Take the answer, if it has come by then. Returns: whether it was also made within the budget."""
        values, inputs = self._read(until_s), self._inputs
        if values is None or inputs is None:
            return False
        self._asked = False
        asked_m_s = self._table[: len(inputs.ids), ANSWER].copy()
        wrong = self._wrong(asked_m_s, inputs)
        if wrong:
            self.fail(wrong)
            return False
        self._last_m_s = no_faster(asked_m_s, inputs.own_speed_max_m_s)
        self._last = dict(zip(inputs.ids, self._last_m_s, strict=True))
        took_s = values.get("took_s")
        return isinstance(took_s, float) and took_s <= self._budget_s

    def _wrong(self, asked_m_s: Array, inputs: LawInputs) -> str:
        """Which bound the answer (n, 3) breaks, in words; empty: none."""
        wrong = why_wrong(asked_m_s, inputs)
        if wrong:
            return wrong
        if self._toggles(asked_m_s):
            return f"it reverses a velocity {TURNS_MOST} times within {TURNS_WITHIN} ticks"
        return ""

    def _toggles(self, asked_m_s: Array) -> bool:
        before_m_s = self._last_m_s
        if len(before_m_s) != len(asked_m_s):
            self._turned.clear()
            return False
        against = (before_m_s * asked_m_s).sum(axis=1) < 0.0
        self._turned.append(against & (np.linalg.norm(asked_m_s - before_m_s, axis=1) > TURNS_M_S))
        if len(self._turned[0]) != len(asked_m_s):
            self._turned.clear()
        return len(self._turned) > 0 and int(np.sum(self._turned, axis=0).max(initial=0)) >= TURNS_MOST

    def _read(self, until_s: float) -> dict[str, Any] | None:
        """The next line of the process; None: it has not come by then, or the process failed."""
        while b"\n" not in self._unread:
            if not self._poll.poll(max(0.0, 1e3 * (until_s - time.monotonic()))):
                return None
            received = os.read(self._from, ANSWER_MAX)
            self._unread += received
            if not received or len(self._unread) > ANSWER_MAX:
                self.fail("its process sends what is no answer" if received else "its process ended")
                return None
        first, _, self._unread = self._unread.partition(b"\n")
        try:
            values = json.loads(first)
        except (ValueError, RecursionError):  # the latter for brackets in brackets
            values = None
        if not isinstance(values, dict) or "error" in values:
            self.fail(
                str(values["error"]) if isinstance(values, dict) else "its process sends what is no answer"
            )
            return None
        return values


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End the process, and each that it began in its session."""
    if process.returncode is None:  # nothing has waited for it: the number is still its own
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def _end(process: subprocess.Popen[bytes]) -> None:
    _kill(process)
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()
