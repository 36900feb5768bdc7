"""One target as one source reports it: what is believed, and which reports are not. Pure."""

from collections import deque
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from math import hypot, inf, isfinite, nan
from typing import Final

import numpy as np

from gcs.estimation.targets.height import HeightBelief
from gcs.estimation.targets.motion import (
    TargetBelief,
    TargetMotion,
    begun,
    corrected,
    foreseen,
    off,
)
from gcs.estimation.targets.source_clock import STEP_S, SourceClock
from gcs.model.state import Array

GATE: Final = 4.5
"""A report farther than this from where the target is expected, in standard deviations, is refused."""

GATE_LEAST_M: Final = 3.0
"""Nearer than this none is refused: sources err by more than they say."""

FASTER_M_S: Final = 1.0
"""By so much a target may have been faster than before, while nothing was received."""

REFUSED_S: Final = 1.0
"""After refused reports for so long the source counts as saying something else."""

STANDS_M: Final = 0.01
"""Two reports nearer to each other than this are of the same place."""

STANDS_S, STANDING_M_S = 1.0, 0.5
"""A source that repeats a place for so long, of a target that moves faster than this, has stopped.

One that reports such a velocity beside it is not believed from the first repetition on.
"""

STOPS_M_S: Final = 2.0
"""Nor is one without a velocity, of a target that was faster than this: such a one brakes before it stops."""

NOT_AGAIN: Final = 256
"""Newest reports that a source may not repeat."""

KEPT: Final = 32
"""Newest reports that are kept for those that arrive out of order."""

SILENT_S, SILENT_PERIODS = 0.5, 2.5
"""A source is silent when nothing came for both so long and so many of its periods."""

FRESH_S, FRESH_PERIODS = 0.3, 1.6
"""A source gives way to another one when its next report is later than this, and the other's is not."""

STEADY_S: Final = 12.0
"""Without reports a target that has moved alike is followed for as long again, and so long at most."""

LEAST, GREATEST = 1e-3, 1e5
"""A standard deviation beyond counts as these, in m and m/s: no receiver is better; worse says nothing."""

FASTEST_M_S: Final = 1_000.0
"""A greater reported velocity does not count, whatever else was reported."""

FARTHEST_M: Final = 100_000.0
"""Farther from the show's origin a report is of another frame: degrees exchanged, or none."""


class TrackState(StrEnum):
    """How well a target is known."""

    NONE = "none"
    """Nothing was received yet."""
    TRACKED = "tracked"
    """Reports arrive, and are believed."""
    COASTING = "coasting"
    """None are, for a short time; the estimate moves on as it did."""
    LOST = "lost"
    """None are, for longer than the estimate is followed without them."""


@dataclass(frozen=True, slots=True)
class TargetReport:
    """A report in the show frame. NaN where the source does not say."""

    arrived_s: float
    position_m: tuple[float, float]
    velocity_m_s: tuple[float, float] = (nan, nan)
    deviation_m: float = nan
    velocity_deviation_m_s: float = nan
    source_s: float = nan
    height_m: float = nan  # above the show's origin
    height_deviation_m: float = nan


UP_SHARE: Final = 2.0
"""Standard deviation of a reported height for that of a place sideways, where the source does not say."""

VELOCITY_DEVIATION_M_S: Final = 0.15
"""Of a reported velocity along each axis, where the source does not say."""

CHANGES_M_S2, CHANGES_M_S = 8.0, 5.0
"""A reported velocity that changed by more since the last report does not count: no target changes so hard.
Believed, it would lead away from all places that follow."""


@dataclass(slots=True, eq=False)
class Tracker:
    """Estimates one target from the reports of one source.

    Attributes:
        deviation_m: of a report along each axis, where its source does not say.
        coast_s: how long the estimate is believed without reports, at least.
        clock: of the source.
        steady_s: of a target that has moved alike for longer: as long again, and so long at most; not while
            its source sends what is not believed.
        belief: None: nothing was received.
        height: None: no height was received.
        newest_s: when the newest believed report was true, loop clock.
        period_s: between reports, smoothed.
        why: why reports are not believed, in words; empty: they are.
        accepted, outliers, doubled, standing: how many reports were each.
    """

    deviation_m: float
    coast_s: float
    clock: SourceClock
    steady_s: float = STEADY_S
    belief: TargetBelief | None = None
    height: HeightBelief | None = None
    newest_s: float = -inf
    period_s: float = 1.0
    why: str = ""
    accepted: int = 0
    outliers: int = 0
    doubled: int = 0
    standing: int = 0
    _believed: deque[tuple[float, Array, Array, TargetBelief]] = field(
        default_factory=lambda: deque(maxlen=KEPT), init=False
    )
    _arrived_s: float = field(default=-inf, init=False)
    _reported: dict[tuple[float, tuple[float, float]], None] = field(default_factory=dict, init=False)
    _place_m: tuple[float, float] = field(default=(nan, nan), init=False)
    _since_s: float = field(default=nan, init=False)  # when the source began to say this place
    _refused_s: float = field(default=nan, init=False)  # when it began to be refused
    _away: tuple[Array, float] = field(default=(np.zeros(2), -inf), init=False)  # refused last, and when
    _late_s: float = field(default=0.0, init=False)  # how late the newest believed report was

    def take(self, report: TargetReport, unix_minus_loop_s: float = nan) -> None:
        """Take one report, whatever it says."""
        far_m = hypot(*report.position_m)
        if not far_m <= FARTHEST_M:  # written so that NaN is refused
            self.outliers += 1
            far = "it is reported too far away; latitude and longitude may be exchanged"
            self.why = far if isfinite(far_m) else "it is reported without a place"
            return
        if isfinite(report.source_s) and (report.source_s, report.position_m) in self._reported:
            self.doubled += 1
            is_old = next(reversed(self._reported))[0] - report.source_s > STEP_S
            if is_old or report.arrived_s - self._arrived_s > self._silent_s:
                self.why = "its source repeats old reports"
            return
        self._reported[report.source_s, report.position_m] = None
        if len(self._reported) > NOT_AGAIN:
            del self._reported[next(iter(self._reported))]
        if self._stands(report):
            self.standing += 1
            stands_s = report.arrived_s - self._since_s
            if stands_s >= STANDS_S:
                self.why = f"its source has repeated one place for {stands_s:.1f} s"
            return
        was_s = self.clock.was_s(report.arrived_s, report.source_s, unix_minus_loop_s)
        if not isfinite(was_s):
            self.why = "the times of its source do not agree"
            return
        self._note_period(report.arrived_s)
        self._believe(report, was_s)

    def state(self, now_s: float) -> TrackState:
        """How well the target is known at `now_s`."""
        if self.belief is None:
            return TrackState.NONE
        late_s = now_s - self.newest_s - self._late_s
        if late_s <= self._silent_s and not self.why:
            return TrackState.TRACKED
        goes_on_s = 0.0 if self.why else min(self.belief.lasted_s, self.steady_s)
        return TrackState.COASTING if late_s <= max(self.coast_s, goes_on_s) else TrackState.LOST

    def is_fresh(self, now_s: float) -> bool:
        """Whether it is tracked, and the next report is not late."""
        if self.belief is None or self.why:
            return False
        return now_s - self.newest_s - self._late_s <= max(FRESH_S, FRESH_PERIODS * self.period_s)

    def motion(self, now_s: float) -> TargetMotion | None:
        """How the target moves at `now_s`; None: nothing was received."""
        if self.belief is None:
            return None
        motion = foreseen(self.belief, now_s)
        return motion if self.height is None else motion._replace(height=self.height.foreseen(now_s))

    @property
    def _silent_s(self) -> float:
        """Without a report for longer the source is silent."""
        return max(SILENT_S, SILENT_PERIODS * self.period_s)

    def begin_again(self) -> None:
        """Forget the target: the next report is believed, wherever it is."""
        self.belief, self.height, self.why, self.newest_s = None, None, "", -inf
        self._believed.clear()
        self._refused_s = self._since_s = nan

    def _stands(self, report: TargetReport) -> bool:
        """Whether a source repeats a place although the target moves."""
        off_m = hypot(report.position_m[0] - self._place_m[0], report.position_m[1] - self._place_m[1])
        if not off_m <= STANDS_M:
            self._place_m, self._since_s = report.position_m, report.arrived_s
            return False
        moves_m_s = hypot(*report.velocity_m_s)
        if isfinite(moves_m_s):
            return moves_m_s > STANDING_M_S
        motion = self.motion(report.arrived_s)
        moves_m_s = 0.0 if motion is None else float(np.hypot(*motion.velocity_m_s))
        return moves_m_s > (STANDING_M_S if report.arrived_s - self._since_s >= STANDS_S else STOPS_M_S)

    def _note_period(self, arrived_s: float) -> None:
        if isfinite(self._arrived_s):
            apart_s = min(max(arrived_s - self._arrived_s, 0.0), 5.0)
            self.period_s += 0.2 * (apart_s - self.period_s)
        self._arrived_s = arrived_s

    def _believe(self, report: TargetReport, was_s: float) -> None:
        reported, variance = self._values(report)
        before = self._before(was_s)
        if before is None:
            if self.belief is None:
                self._insert(was_s, reported, variance, None)
                self._take_height(report, was_s)
                self._late_s = report.arrived_s - was_s
            return  # older than all that are kept
        off_m = self._off_m(before, was_s, report.position_m, variance[0])
        if off_m > 0.0:
            if self._is_found_again(before, was_s, reported, variance):
                self._believed.clear()
                self._insert(was_s, reported, variance, None)
                return
            self.outliers += 1
            if not isfinite(self._refused_s):
                self._refused_s = was_s
            if was_s - self._refused_s >= REFUSED_S:
                self.why = f"it is reported {off_m:.0f} m from where it was expected"
            return
        if len(reported) > 2 and self._cannot_move_so(before, was_s, reported[2:], variance[2]):
            reported, variance = reported[:2], variance[:2]
            self.outliers += 1
        self._insert(was_s, reported, variance, before)
        self._take_height(report, was_s)
        self._late_s = report.arrived_s - was_s

    def _cannot_move_so(
        self, before: TargetBelief, was_s: float, velocity_m_s: Array, variance_m2_s2: float
    ) -> bool:
        """Whether a reported velocity (2,) cannot be that of a target that moved as is believed."""
        changed_m_s = np.hypot(*(velocity_m_s - foreseen(before, was_s).velocity_m_s))
        most_m_s = CHANGES_M_S + CHANGES_M_S2 * (was_s - before.time_s) + GATE * np.sqrt(variance_m2_s2)
        return not changed_m_s <= most_m_s

    def _take_height(self, report: TargetReport, was_s: float) -> None:
        """Believe the height of a report with a place that is believed."""
        if not abs(report.height_m) <= FARTHEST_M:  # written so that NaN does not count
            return
        deviation_m = report.height_deviation_m
        if not isfinite(deviation_m):
            sideways_m = report.deviation_m if isfinite(report.deviation_m) else self.deviation_m
            deviation_m = UP_SHARE * sideways_m
        deviation_m = _bounded(deviation_m)
        believed = HeightBelief.begun if self.height is None else self.height.corrected
        self.height = believed(was_s, report.height_m, deviation_m)

    def _off_m(
        self, before: TargetBelief, was_s: float, position_m: tuple[float, float], variance_m2: float
    ) -> float:
        """How far a report is from where it is expected, if that is too far; else 0.

        While reports are refused the gate stops growing: what says another place stays refused.
        """
        known_s = min(was_s, self._refused_s + REFUSED_S) if isfinite(self._refused_s) else was_s
        off_m, deviations = off(before, was_s, known_s, position_m, variance_m2)
        return off_m if off_m > GATE_LEAST_M and deviations > GATE else 0.0

    def _is_found_again(self, before: TargetBelief, was_s: float, reported: Array, variance: Array) -> bool:
        """Whether after a drop-out this report and the refused one before agree on a place within reach.

        What the target did was not seen: it may be as far from its last place as it can have moved by the
        time at which the first report was refused, and a second later.
        """
        (refused_m, refused_s), self._away = self._away, (reported[:2], was_s)
        if not self._refused_s - before.time_s > self._silent_s:
            return False
        last = foreseen(before, before.time_s)
        speeds_m_s = [float(np.hypot(*each)) for each in (last.velocity_m_s, reported[2:]) if len(each)]
        fastest_m_s = max(speeds_m_s) + FASTER_M_S
        unseen_s = min(was_s, self._refused_s + REFUSED_S) - before.time_s
        scatter_m = GATE * float(np.sqrt(2.0 * variance[0]))
        is_within_reach = np.hypot(*(reported[:2] - last.position_m)) <= fastest_m_s * unseen_s + scatter_m
        agree = np.hypot(*(reported[:2] - refused_m)) <= fastest_m_s * (was_s - refused_s) + scatter_m
        return bool(is_within_reach and agree)

    def _before(self, was_s: float) -> TargetBelief | None:
        """The newest belief that is not later than a report; None: all that are kept are."""
        return next((belief for time_s, _, _, belief in reversed(self._believed) if time_s <= was_s), None)

    def _values(self, report: TargetReport) -> tuple[Array, Array]:
        deviation_m = _bounded(report.deviation_m if isfinite(report.deviation_m) else self.deviation_m)
        if not hypot(*report.velocity_m_s) <= FASTEST_M_S:  # written so that NaN does not count
            return np.array(report.position_m), np.array([deviation_m**2] * 2)
        deviation_m_s = report.velocity_deviation_m_s
        if not isfinite(deviation_m_s):
            deviation_m_s = VELOCITY_DEVIATION_M_S
        variance = [deviation_m**2] * 2 + [_bounded(deviation_m_s) ** 2] * 2
        return np.array([*report.position_m, *report.velocity_m_s]), np.array(variance)

    def _insert(self, was_s: float, reported: Array, variance: Array, belief: TargetBelief | None) -> None:
        """Believe a report after `belief`; later ones that arrived before it are believed again."""
        again = [(was_s, reported, variance)]
        while self._believed and self._believed[-1][0] > was_s:
            again.insert(1, self._believed.pop()[:3])
        for time_s, values, variances in again:
            believed = begun if belief is None else partial(corrected, belief)
            belief = believed(time_s, values, variances)
            if not np.isfinite(belief.values).all():
                belief = begun(time_s, values, variances)
            self._believed.append((time_s, values, variances, belief))
        self.belief, self.newest_s = belief, self._believed[-1][0]
        self.why, self._refused_s = "", nan
        self.accepted += 1


def _bounded(deviation: float) -> float:
    return min(max(deviation, LEAST), GREATEST)
