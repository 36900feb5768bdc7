"""When the selected show begins to move, and how fast it runs: at a time, by another clock, or at once.

A show that waits stays in `assembling`, its vehicles where it begins. The tick's phase is shifted, a little
with each tick, until a tick falls on the time of the beginning: then the first setpoints of motion leave.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from math import inf, isnan, nan
from typing import Final

from gcs.flight.state.elsewhere import Elsewhere
from gcs.flight.state.external_clock import ExternalClock
from gcs.flight.state.newest import Newest
from gcs.flight.state.running_show import LONGEST_STEP_S, ShowRun
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles
from gcs.model.errors import InvalidError, RefusedError
from gcs.model.lifecycle import ON_THE_GROUND, ShowEvent, ShowPhase
from gcs.recording.audit_reader import LostBegin
from gcs.service import BeginState, BeginView
from gcs.shows.tempo import Tempo, desired_rate

log = logging.getLogger(__name__)

AHEAD_MAX_S: Final = 24 * 3600.0
"""A start or a beginning can be scheduled at most one day ahead."""

ALIGNS_S: Final = 5.0
"""The tick's phase is shifted in the time before the beginning."""

EARLY_S: Final = 5e-4
"""A tick that comes earlier by so much is the one at which the show begins: timers are not exact."""


def utc(unix_s: float) -> str:
    """A clock time for the log."""
    return datetime.fromtimestamp(unix_s, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


@dataclass(eq=False)
class ShowBegin:
    """Lets the selected show begin. Called on the event loop only."""

    newest: Newest
    vehicles: FlightVehicles
    show: ShowState
    outside_clock: ExternalClock
    unix_s: Callable[[], float]
    clock_problem: Callable[[], str]
    assembled: Callable[[], bool]
    elsewhere: Callable[[], Elsewhere]
    _at_unix_s: float | None = None  # None: no time was given
    _given_to: str = ""  # name of the show that it was given to
    _held: bool = False
    _ready: bool = False  # all vehicles have been where it begins
    _before_s: float | None = None  # the tick before
    _flew: bool = False  # the show was in the air at the tick before

    # commands

    def begin_at(self, at_unix_s: float) -> None:
        """Set the time. Raises: InvalidError, RefusedError."""
        show_run = self.check(at_unix_s)
        self._at_unix_s, self._held, self._given_to = at_unix_s, False, show_run.name
        self._show(show_run)
        doubt = self.clock_problem()
        reported = {"show": show_run.name, "at": utc(at_unix_s), "at_unix_s": at_unix_s, "reason": doubt}
        log.info("show_begins_at", extra=reported)

    def check(self, at_unix_s: float) -> ShowRun:
        """Check whether the selected show can begin then. Raises: InvalidError, RefusedError."""
        show_run = self._unbegun("a time to begin")
        if self.follows_clock:
            raise RefusedError(f"shows follow the {self.outside_clock.name}, which says when they begin")
        ahead_s = at_unix_s - self.unix_s()
        if not 0.0 < ahead_s <= AHEAD_MAX_S:
            allowed = f"ahead by at most {AHEAD_MAX_S / 3600.0:g} h; it is {self.unix_s():.1f} now"
            raise InvalidError("at_unix_time_s", at_unix_s, allowed)
        return show_run

    def check_cancel(self) -> ShowRun:
        """Check whether there is a time to cancel. Raises: RefusedError."""
        show_run = self._unbegun("no time to begin")
        if self._at_unix_s is None and not self._held:
            raise RefusedError("no time to begin was given")
        return show_run

    @property
    def follows_clock(self) -> bool:
        """Whether an external clock says when the show begins."""
        led = self.elsewhere().shows.begin
        return self.outside_clock.followed if led is None else led.follows_clock

    def cancel(self) -> None:
        """Forget the time. Raises: RefusedError."""
        show_run = self.check_cancel()
        self._at_unix_s = None
        self._held = self.show.phase not in ON_THE_GROUND or bool(self.vehicles.airborne)
        self._show(show_run)
        log.info("show_begin_cancelled", extra={"show": show_run.name, "held": self._held})

    def follow_external_clock(self, follow: bool) -> None:
        """Follow the external clock, or this station's. Raises: RefusedError."""
        outside = self.outside_clock
        if not outside.configured:
            raise RefusedError(f"no {outside.name} is configured")
        outside.followed = follow
        if follow:
            self.forget(f"it follows the {outside.name}")
        log.info("external_clock_followed", extra={"clock": outside.name, "followed": follow})

    def forget(self, why: str) -> None:
        """Forget the time, and log it if there was one."""
        if self._at_unix_s is not None:
            reported = {"show": self._given_to, "at": utc(self._at_unix_s), "reason": why}
            log.warning("show_begin_forgotten", extra=reported)
        self._at_unix_s, self._held, self._ready = None, False, False

    def keep(self, show_run: ShowRun, begin: BeginView | None) -> None:
        """Note how the show waits by another flight, for the time when this one leads."""
        self._at_unix_s, self._given_to = None if begin is None else begin.at_unix_time_s, show_run.name
        self._held = begin is not None and begin.state is BeginState.HELD

    def log_lost(self, lost: LostBegin) -> None:
        """Log that a show waited for its time when the session before ended: it does no longer."""
        reported = {"show": lost.show, "at": lost.at, "reason": self.elsewhere().shows.why_begin_lost}
        log.warning("show_begin_forgotten", extra=reported)

    def _unbegun(self, what: str) -> ShowRun:
        show_run = self.show.run
        if show_run is None:
            raise RefusedError(f"no show is selected: {what} is for one that is")
        if show_run.begun:
            raise RefusedError(f"show {show_run.name!r} has begun")
        return show_run

    @property
    def why_doubtful(self) -> str:
        """Why the beginning may come at a wrong time; empty where no show waits for it."""
        return "" if self._at_unix_s is None else self.clock_problem()

    @property
    def waits(self) -> bool:
        """Whether a show that could begin must not yet."""
        if (led := self.elsewhere().shows.begin) is not None:
            return led.waits
        given = self._held or self._at_unix_s is not None
        return self.show.run is not None and (given or self.outside_clock.followed)

    # once a tick

    def due_s(self, now_s: float) -> float | None:
        """When a tick should come, on the loop's clock; None: any time is as good."""
        if (led := self.elsewhere().shows.begin) is not None:
            return led.due_s(now_s)
        show_run, outside = self.show.run, self.outside_clock
        if show_run is None or not self._ready or self.show.phase is not ShowPhase.ASSEMBLING:
            return None
        left_s = inf
        if outside.followed:
            if outside.runs(now_s):
                left_s = (show_run.clock.show_s(now_s) - outside.show_s(now_s)) / outside.slope
        elif self._at_unix_s is not None:
            left_s = self._at_unix_s - self.unix_s()
        return now_s + left_s if 0.0 < left_s < ALIGNS_S else None

    def look(self) -> None:
        """Let the show begin when it is time, and keep its tempo. Call once a tick, before the show leads."""
        show_run = self.show.run
        now_s = self.newest.state.time_s
        before_s, self._before_s = self._before_s, now_s
        flew, self._flew = self._flew, self.show.phase not in ON_THE_GROUND
        over = self.show.phase in {ShowPhase.RETURNING, ShowPhase.ABORTING} or (flew and not self._flew)
        if show_run is None or over:
            self.forget("the show is over, or none is selected")
        if show_run is None:
            return
        if self.outside_clock.configured:
            self.outside_clock.problem, self.outside_clock.expected = "", False
            self._keep_time(show_run, now_s, 0.0 if before_s is None else now_s - before_s)
        if self.show.phase is not ShowPhase.ASSEMBLING:
            self._ready = False
        else:
            self._ready = self._ready or self.assembled()
            begins_s = self._begins_s(show_run, now_s) if self.waits and self._ready else None
            if begins_s is not None:
                self.begin_now(show_run, begins_s)
        if show_run.begun:
            self._at_unix_s, self._held = None, False
        self._show(show_run)

    def _begins_s(self, show_run: ShowRun, now_s: float) -> float | None:
        """When the show begins, at the latest now; None: not yet."""
        outside = self.outside_clock
        if outside.followed:
            outside.problem = why = outside.why_not(now_s)
            if why:
                return None
            over_s = outside.show_s(now_s) - show_run.clock.show_s(now_s)
            if over_s < -EARLY_S:
                outside.expected = True
                outside.problem = f"the {outside.name} comes to where the show is in {-over_s:.0f} s"
                return None
            if over_s > outside.jump_max_s and not show_run.begun:
                outside.problem = f"the {outside.name} is {over_s:.1f} s past the show's beginning"
                return None
            return now_s - over_s if over_s < LONGEST_STEP_S else now_s
        if self._at_unix_s is None:
            return None
        late_s = self.unix_s() - self._at_unix_s
        if late_s < -EARLY_S:
            return None
        return now_s - late_s if late_s < LONGEST_STEP_S else now_s

    def begin_now(self, show_run: ShowRun, begins_s: float) -> None:
        """Have the show begin now; `begins_s` is the moment, in the tick's time."""
        now_s = self.newest.state.time_s
        show_run.begins_s, show_run.tempo = begins_s, Tempo()
        late_s = 0.0 if self._at_unix_s is None else self.unix_s() - self._at_unix_s
        self.show.move(ShowEvent.ASSEMBLED, "the show's time has come")
        log.info(
            "show_began",
            extra={
                "show": show_run.name,
                "late_s": round(late_s, 4),
                "tick_after_s": round(now_s - begins_s, 4),
            },
        )

    def _keep_time(self, show_run: ShowRun, now_s: float, dt_s: float) -> None:
        """Set the tempo of a show that runs by an external clock."""
        outside = self.outside_clock
        clock_s = show_run.clock.show_s(now_s) - (1.0 - show_run.rate) * min(dt_s, LONGEST_STEP_S)
        outside.note_show(clock_s if show_run.begun else nan)
        stands, desired = False, 1.0
        if show_run.clock.runs and outside.followed and outside.configured:
            behind_s = outside.show_s(now_s) - clock_s
            outside.problem = outside.why_not(now_s)
            stands = bool(outside.problem) or isnan(behind_s)
            desired = 0.0 if stands else desired_rate(behind_s, outside.slope, outside.catch_up)
        outside.note_frozen(stands, self.unix_s())
        if show_run.clock.runs:
            show_run.tempo = show_run.tempo.step(desired, min(dt_s, LONGEST_STEP_S))

    def _show(self, show_run: ShowRun) -> None:
        """Write how it waits, for displays."""
        at_unix_s = self._at_unix_s
        if show_run.begun or not (self._held or at_unix_s is not None):
            show_run.begin = None
            return
        in_s = None if at_unix_s is None else at_unix_s - self.unix_s()
        if in_s is None:
            state = BeginState.HELD
        elif in_s < 0.0:
            state = BeginState.LATE
        else:
            state = BeginState.WAITING if self._ready else BeginState.ARMED
        show_run.begin = BeginView(state, at_unix_s, in_s)
