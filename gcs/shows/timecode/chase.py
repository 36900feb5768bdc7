"""Where a timecode is between its readings, which jitter, drift, drop out and jump. Pure.

A straight line through the newest readings says where the timecode is. Readings far from it count only once
several of them agree on another place: then the timecode has jumped. What is far from the place of the show
and from where the timecode was is refused.
"""

from collections import deque
from dataclasses import dataclass, field
from enum import StrEnum
from math import inf, nan
from typing import Final

import numpy as np

from gcs.shows.timecode.smpte import Rate, Reading

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

AGE_MAX_S: Final = 0.5
"""A source may not say that a reading was true longer ago."""


@dataclass(slots=True)
class FittedLine:
    """The straight line through readings; a further one costs the same however many there are.

    Sums count from `_from_s` and `_from_time_s`, which follow the readings: so they keep their precision.
    """

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
        if not points or abs(at_s - self._from_s) > 2.0 * WINDOW_S:
            self._from_s, self._from_time_s = at_s, time_s
            self._t = self._y = self._tt = self._ty = 0.0
            for point in points:
                self._count(point, 1.0)
        points.append((at_s, time_s))
        self._count(points[-1], 1.0)
        while at_s - points[0][0] > WINDOW_S or len(points) > READINGS_MAX:
            self._count(points.popleft(), -1.0)

    def _count(self, point: tuple[float, float], sign: float) -> None:
        t, y = point[0] - self._from_s, point[1] - self._from_time_s
        self._t += sign * t
        self._y += sign * y
        self._tt += sign * t * t
        self._ty += sign * t * y

    def fit(self) -> tuple[float, float, float]:
        """Time and timecode of the middle of at least one reading, and the slope."""
        count = len(self.points)
        t, y, slope = self._t / count, self._y / count, 1.0
        if count >= SLOPE_FROM and self.points[-1][0] - self.points[0][0] >= SLOPE_FROM_S:
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
        rate: of the newest reading.
    """

    freewheel_s: float
    jump_max_s: float
    show_s: float = nan
    rate: Rate | None = None
    _line: FittedLine = field(default_factory=FittedLine)
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
        self.rate, self._arrived_s = reading.rate, now_s
        if not reading.runs:
            self._end_line()
            self._strays.clear()
            self._stands = True
            self._stood_s = reading.time_s if self._near(reading.time_s) else self._stood_s
            return
        at_s = now_s - min(max(reading.age_s, 0.0), AGE_MAX_S)
        if self._line and at_s - self._newest_s > self.freewheel_s:
            self._end_line()
        if self._line and abs(reading.time_s - self._on_line_s(at_s)) <= STRAY_S:
            self._line.add(at_s, reading.time_s)
            self._newest_s, self._fit = max(self._newest_s, at_s), None
            self._strays.clear()
        else:
            self._stray(at_s, reading.time_s)

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
            self._jump_s = time_s - from_s
            return
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
        return any(abs(time_s - place_s) <= self.jump_max_s for place_s in (self.show_s, was_s))

    def _end_line(self) -> None:
        if self._line:
            self._stood_s = self._on_line_s(self._newest_s)
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
