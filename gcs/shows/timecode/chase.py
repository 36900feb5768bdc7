"""Where a timecode is between its readings, which jitter, drift, drop out and jump. Pure.

A straight line through the newest readings says where the timecode is. Readings far from it count only once
several of them agree on another place: then the timecode has jumped. What is far from the place of the show
and from where the timecode was is refused. At midnight the labels begin again, and the timecode goes on.
"""

from collections import deque
from dataclasses import dataclass, field
from enum import StrEnum
from math import inf, nan
from typing import Final

import numpy as np

from gcs.shows.timecode.smpte import PULL, PULL_WITHIN, Rate, Reading, within_a_day

WINDOW_S: Final = 2.0
"""The line goes through the readings of this time."""

READINGS_MAX: Final = 512

SLOPE_FROM: Final = 8
SLOPE_FROM_S: Final = 0.5
"""With fewer readings, or over a shorter time, the timecode is taken to run at its rate."""

SLOPE_OFF_MAX: Final = 0.1
"""A timecode that runs faster or slower than its rate by this share is not followed."""

STRAY_S: Final = 0.1
"""A reading this far off the line is not taken into it."""

AGREE: Final = 6
AGREE_S: Final = 0.15
"""So many readings, over such a time, begin a line where no other reading fits the one there was."""

SILENT_S: Final = 0.1
"""Without a reading for so long the timecode has dropped out, and the line goes on."""

PACE_S: Final = 16.0
"""Over this time readings say whether 24 and 30 frames a second are in truth 23.976 and 29.97."""

AGE_MAX_S: Final = 0.5
"""A source may not say that a reading was true longer ago."""


@dataclass(slots=True)
class FittedLine:
    """The straight line through readings; a further one costs the same however many there are.

    Sums count from `_from_s` and `_from_time_s`, which follow the readings: so they keep their precision.
    """

    window_s: float = WINDOW_S
    most: int = READINGS_MAX
    points: deque[tuple[float, float]] = field(default_factory=deque)  # time, timecode
    _from_s: float = 0.0
    _from_time_s: float = 0.0
    _t: float = 0.0
    _y: float = 0.0
    _tt: float = 0.0
    _ty: float = 0.0

    def __len__(self) -> int:
        return len(self.points)

    def clear(self) -> None:
        self.points.clear()

    def add(self, at_s: float, time_s: float) -> None:
        """Add a reading, and leave out those that are too old or too many."""
        points = self.points
        if not points or abs(at_s - self._from_s) > 2.0 * self.window_s:
            self._from_s, self._from_time_s = at_s, time_s
            self._t = self._y = self._tt = self._ty = 0.0
            for point in points:
                self._count(point, 1.0)
        points.append((at_s, time_s))
        self._count(points[-1], 1.0)
        while at_s - points[0][0] > self.window_s or len(points) > self.most:
            self._count(points.popleft(), -1.0)

    def _count(self, point: tuple[float, float], sign: float) -> None:
        t, y = point[0] - self._from_s, point[1] - self._from_time_s
        self._t += sign * t
        self._y += sign * y
        self._tt += sign * t * t
        self._ty += sign * t * y

    @property
    def span_s(self) -> float:
        """Time between the first reading and the last."""
        return self.points[-1][0] - self.points[0][0] if self.points else 0.0

    def scaled(self, factor: float) -> "FittedLine":
        """The line through the same readings, their timecodes times a factor."""
        line = FittedLine(self.window_s, self.most)
        for at_s, time_s in self.points:
            line.add(at_s, time_s * factor)
        return line

    def fit(self) -> tuple[float, float, float]:
        """Time and timecode of the middle of at least one reading, and the slope."""
        count = len(self.points)
        t, y, slope = self._t / count, self._y / count, 1.0
        if count >= SLOPE_FROM and self.span_s >= SLOPE_FROM_S:
            slope = (self._ty - count * t * y) / (self._tt - count * t * t)
        slope = min(max(slope, 1.0 - SLOPE_OFF_MAX), 1.0 + SLOPE_OFF_MAX)
        return self._from_s + t, self._from_time_s + y, slope


class ChaseState(StrEnum):
    """How it is with a timecode."""

    NONE = "none"  # nothing has arrived yet
    RUNNING = "running"
    DROPPED_OUT = "dropped-out"  # nothing arrives for a moment, and the show goes on
    STOPPED = "stopped"  # its source says where it stands, or repeats it
    LOST = "lost"  # nothing arrives any more: its source stands without saying so, or is cut off
    REFUSED = "refused"  # it runs where the show does not follow


@dataclass(slots=True)
class Chase:
    """Follows one timecode. Every `now_s` is the loop's clock.

    Attributes:
        freewheel_s: for so long the timecode is taken to run on without a reading.
        jump_max_s: a jump beyond this is refused.
        show_s: the timecode that belongs to where the show is; NaN: it has not begun, and follows anywhere.
        rate: of the newest reading, 23.976 or 29.97 once it is seen to be so.
    """

    freewheel_s: float
    jump_max_s: float
    show_s: float = nan
    rate: Rate | None = None
    _line: FittedLine = field(default_factory=FittedLine)
    _pace: FittedLine = field(default_factory=lambda: FittedLine(PACE_S, 4 * READINGS_MAX))  # as labelled
    _pulled: bool = False  # labels of 24 and 30 frames are in truth those of 23.976 and 29.97
    _strays: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=READINGS_MAX))
    _newest_s: float = -inf  # when the newest reading of the line was true
    _stands: bool = False  # the source has said so since the timecode ran last
    _arrived_s: float = -inf  # when a reading arrived last, followed or not
    _stood_s: float = nan  # the timecode at the newest reading of a line that ended, or where it was brought
    _refused_s: float = -inf  # when readings were refused last
    _jump_s: float = nan  # by how much these were off
    _fit: tuple[float, float, float] | None = None  # time, timecode and slope, until the next reading

    def take(self, reading: Reading, now_s: float) -> None:
        """Take a reading that has just arrived."""
        self._arrived_s = now_s
        self._take_rate(reading.rate)
        at_s = now_s - min(max(reading.age_s, 0.0), AGE_MAX_S)
        time_s = self._unwrapped(reading.time_s * self._pull(reading.rate), at_s)
        if not reading.runs:
            self._end_line()
            self._strays.clear()
            self._stands = True
            self._stood_s = time_s if self._near(time_s) else self._stood_s
            return
        if self._line and at_s - self._newest_s > self.freewheel_s:
            self._end_line()
        if self._line and abs(time_s - self._on_line_s(at_s)) <= STRAY_S:
            self._line.add(at_s, time_s)
            self._newest_s, self._fit = max(self._newest_s, at_s), None
            self._strays.clear()
            self._take_pace(reading.rate, at_s, time_s)
        else:
            self._stray(at_s, time_s)

    def _pull(self, rate: Rate) -> float:
        """By what times of readings of this rate are multiplied."""
        return PULL if self._pulled and rate is not rate.pulled_down else 1.0

    def _take_rate(self, rate: Rate) -> None:
        """Note the rate of a reading, whose source may know that it is 23.976 or 29.97."""
        if rate is not rate.nominal and not self._pulled:
            self._change_pull(pulled=True)
        self.rate = rate.pulled_down if self._pulled else rate

    def _take_pace(self, rate: Rate, at_s: float, time_s: float) -> None:
        """See by this clock whether labels of 24 or 30 frames run slower by 1001/1000."""
        if rate.nominal.pulled_down is rate.nominal:
            return
        self._pace.add(at_s, time_s / (PULL if self._pulled else 1.0))
        if self._pace.span_s < 0.9 * PACE_S:
            return
        slope = self._pace.fit()[2]
        if abs(slope * PULL - 1.0) <= PULL_WITHIN and not self._pulled:
            self._change_pull(pulled=True)
        elif abs(slope - 1.0) <= PULL_WITHIN and self._pulled:
            self._change_pull(pulled=False)
        self._take_rate(rate.nominal)

    def _change_pull(self, *, pulled: bool) -> None:
        """Have all times mean what they mean at the other rate; the show's comes with the next tick."""
        self._pulled = pulled
        if self.rate is None or self.rate.nominal.pulled_down is self.rate.nominal:
            return
        factor = PULL if pulled else 1.0 / PULL
        self._line, self._fit = self._line.scaled(factor), None
        self._strays = deque(((at_s, time_s * factor) for at_s, time_s in self._strays), READINGS_MAX)
        self._stood_s, self.show_s = self._stood_s * factor, self.show_s * factor

    def _unwrapped(self, time_s: float, at_s: float) -> float:
        """The time of a reading in the day that is nearest to where the timecode is, or the show."""
        known_s = self._stood_s if np.isnan(self.show_s) else self.show_s
        if self._line:
            known_s = self._on_line_s(at_s)
        elif self._strays:
            known_s = self._strays[-1][1] + at_s - self._strays[-1][0]
        if self.rate is None or np.isnan(known_s):
            return time_s
        return known_s + within_a_day(time_s - known_s, self.rate)

    def _stray(self, at_s: float, time_s: float) -> None:
        """Note a reading off the line; several that agree begin another."""
        strays = self._strays
        if strays and abs((time_s - at_s) - (strays[-1][1] - strays[-1][0])) > STRAY_S:
            strays.clear()
        strays.append((at_s, time_s))
        while strays[-1][0] - strays[0][0] > WINDOW_S:
            strays.popleft()
        agree_s = strays[-1][0] - strays[0][0]
        if len(strays) < AGREE or agree_s < AGREE_S:
            return
        if abs((strays[-1][1] - strays[0][1]) / agree_s - 1.0) > SLOPE_OFF_MAX + STRAY_S / agree_s:
            return
        if not self._near(time_s):
            self._end_line()
            self._refused_s = at_s
            from_s = self.show_s if np.isnan(self._stood_s) else self._stood_s
            self._jump_s = self._apart_s(time_s, from_s)
            return
        self._pace.clear()
        self._line.clear()
        for stray in strays:
            self._line.add(*stray)
        strays.clear()
        self._newest_s, self._fit, self._refused_s = at_s, None, -inf
        self._stands = False

    def _near(self, time_s: float) -> bool:
        """Whether the show follows to there."""
        if np.isnan(self.show_s):
            return True
        was_s = self._on_line_s(self._newest_s) if self._line else self._stood_s
        places_s = self.show_s, was_s
        return any(abs(self._apart_s(time_s, place_s)) <= self.jump_max_s for place_s in places_s)

    def _apart_s(self, time_s: float, place_s: float) -> float:
        """By how much a timecode is off another one, the shorter way round the day."""
        return time_s - place_s if self.rate is None else within_a_day(time_s - place_s, self.rate)

    def _end_line(self) -> None:
        if self._line:
            self._stood_s = self._on_line_s(self._newest_s)
        self._pace.clear()
        self._line.clear()
        self._fit = None

    def _on_line_s(self, at_s: float) -> float:
        """The timecode at a time by the newest line, of at least one reading."""
        if self._fit is None:
            self._fit = self._line.fit()
        middle_s, mean_s, slope = self._fit
        return mean_s + slope * (at_s - middle_s)

    def state(self, now_s: float) -> ChaseState:
        """How it is with the timecode."""
        silent_s = now_s - self._newest_s
        if self._line and silent_s <= self.freewheel_s:
            return ChaseState.RUNNING if silent_s <= SILENT_S else ChaseState.DROPPED_OUT
        if now_s - self._refused_s <= self.freewheel_s:
            return ChaseState.REFUSED
        if self._stands or now_s - self._arrived_s <= self.freewheel_s:
            return ChaseState.STOPPED
        return ChaseState.NONE if self.rate is None else ChaseState.LOST

    def runs(self, now_s: float) -> bool:
        """Whether the show has a timecode to follow."""
        return self.state(now_s) in {ChaseState.RUNNING, ChaseState.DROPPED_OUT}

    def time_s(self, now_s: float) -> float:
        """The timecode now, from 00:00:00:00; where it stands if it stands; NaN: nowhere yet."""
        if self._line:
            return self._on_line_s(now_s if self.runs(now_s) else self._newest_s)
        return self._stood_s

    def slope(self) -> float:
        """How fast it runs: 1.0 at its rate."""
        if not self._line:
            return 1.0
        self._on_line_s(self._newest_s)
        return 1.0 if self._fit is None else self._fit[2]

    def age_s(self, now_s: float) -> float:
        """Since the newest reading that was followed; NaN: none was."""
        return max(0.0, now_s - self._newest_s) if np.isfinite(self._newest_s) else nan

    @property
    def jump_s(self) -> float:
        """By how much the newest readings that were refused are off."""
        return self._jump_s
