"""Keeps the process of the plan's law, where it is no shipped one, and pauses the show when it fails."""

import logging
from collections.abc import Callable, Iterable
from math import inf
from typing import Final

from gcs.control.law_step import LawRunner
from gcs.flight.features.laws.process import BEGINS_S, LawProcess
from gcs.flight.state.feature import Feature, Instant
from gcs.flight.state.newest import InForce
from gcs.formation.laws.registry import SHIPPED
from gcs.model.errors import GcsError, InvalidError
from gcs.model.lifecycle import ON_THE_GROUND, ShowPhase
from gcs.model.preflight_report import Check, State
from gcs.model.settings import Settings
from gcs.service.alarms import AlarmCause, Condition

log = logging.getLogger(__name__)

FORMED: Final = frozenset({ShowPhase.ASSEMBLING, ShowPhase.RUNNING})
"""Phases in which the law flies, and the show can be paused."""


AGAIN_S: Final = 10.0
"""A law that failed begins anew this long after its last begin, once the show is on the ground."""


class LawGuard(Feature):
    """The law of the plan. A shipped one runs within the tick, any other in a process of its own."""

    name = ""

    def __init__(
        self, in_force: InForce, rows_max: Callable[[], int], tick_s: float, wait_s: float | None
    ) -> None:
        """Arguments as of `LawProcess`."""
        self._in_force, self._rows_max, self._tick_s, self._wait_s = in_force, rows_max, tick_s, wait_s
        self._process: LawProcess | None = None
        self._name, self._begun_s, self._why = "", -inf, ""  # why the law cannot be begun
        self._settings: Settings | None = None  # with which it was begun
        self.pause: Callable[[str], object] = lambda _: None

    @property
    def runner(self) -> LawRunner | None:
        """What computes the law; None: a shipped one, or one that cannot be begun: vehicles then stop."""
        return None if self._process is None else self._process.velocity

    @property
    def failed(self) -> str:
        """Why the law is not relied on; empty: it is."""
        return self._why or ("" if self._process is None else self._process.failed)

    def lead(self, at: Instant) -> None:
        """Begin the law that the plan names, anew on the ground, and pause a show whose law has failed."""
        name, on_ground = self._in_force.plan.formation.law, at.show in ON_THE_GROUND
        settings = self._in_force.control.law.laws.get(name)  # a written show has others
        again = self.failed and at.time_s - self._begun_s > AGAIN_S
        if name != self._name or (on_ground and (again or settings != self._settings)):
            self._name, self._settings, self._begun_s = name, settings, at.time_s
            self._begin(name)
        if self._process is not None:
            self._process.begin()
        if self.failed and at.show in FORMED:
            self._pause(f"law {name} failed: {self.failed}")

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.close()
        self._process = None

    def checks(self, at: Instant) -> Iterable[Check]:  # noqa: ARG002
        process, name = self._process, self._in_force.plan.formation.law
        if name in SHIPPED:
            return
        problem = self.failed or ("" if process is not None and process.ready else "it has not begun yet")
        to_do = "run gcs law check, or choose another law" if problem else ""
        yield Check("law", State.FAIL if problem else State.PASS, problem=problem, to_do=to_do)

    def conditions(self, at: Instant) -> Iterable[Condition]:
        if self.failed:
            name = self._in_force.plan.formation.law
            flies = at.show not in ON_THE_GROUND
            follows = "All vehicles hold, and the safety filter keeps them apart." if flies else ""
            yield Condition(AlarmCause.LAW_FAILED, self.failed, consequence=follows, about=name)

    def _begin(self, name: str) -> None:
        self.close()
        self._why = ""
        if name in SHIPPED:
            return
        settings = self._in_force.control.law.given(name)
        try:
            self._process = LawProcess(name, settings, self._rows_max(), self._tick_s, self._wait_s)
        except (InvalidError, OSError) as error:
            self._why = str(error)
        else:
            self._process.begin(0.0 if self._wait_s is None else BEGINS_S)

    def _pause(self, reason: str) -> None:
        try:
            self.pause(reason)
        except GcsError as error:
            log.warning("law_not_paused", extra={"reason": reason, "error": str(error)})
