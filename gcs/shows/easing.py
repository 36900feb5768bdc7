"""Smooth transitions between two values without a jump in speed or acceleration. Pure."""

from bisect import bisect_right
from dataclasses import dataclass
from math import sqrt

import numpy as np

from gcs.model.state import Array

RATE = 15.0 / 8.0
"""Greatest rate of the transition, times time over change: of 10 u^3 - 15 u^4 + 6 u^5 at u = 1/2."""

ACCELERATION = 10.0 / sqrt(3.0)
"""Greatest acceleration, times time squared over change: at u = 1/2 -+ 1 / (2 sqrt(3))."""


def shortest_s(change: float, rate_max: float, acceleration_max: float) -> float:
    """Least time in s in which a change keeps rate and acceleration; any unit, its own per s and s^2."""
    size = abs(change)
    return max(RATE * size / rate_max, sqrt(ACCELERATION * size / acceleration_max))


@dataclass(frozen=True, slots=True, eq=False)
class Glide:
    """Transition of one value (...) to another between two times; constant before and after."""

    from_s: float
    to_s: float
    before: Array
    after: Array
    cue: int  # index in the file's timeline of the cue that requests it

    def value(self, time_s: float) -> Array:
        """(...) Value at that time."""
        u = self._share(time_s)
        value: Array = self.before + (u * u * u * (10.0 + u * (6.0 * u - 15.0))) * (self.after - self.before)
        return value

    def rate(self, time_s: float) -> Array:
        """(...) Rate per s at that time."""
        u = self._share(time_s)
        if self.to_s <= self.from_s:
            return np.zeros_like(self.after)
        rate: Array = 30.0 * u * u * (1.0 - u) ** 2 / (self.to_s - self.from_s) * (self.after - self.before)
        return rate

    def _share(self, time_s: float) -> float:
        if time_s >= self.to_s:
            return 1.0
        if time_s <= self.from_s:
            return 0.0
        return (time_s - self.from_s) / (self.to_s - self.from_s)


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One quantity over the whole show: transitions in order of time, without overlap."""

    glides: tuple[Glide, ...]

    def at(self, time_s: float) -> Glide:
        """Return the newest transition that has begun; the first one before that."""
        begun = bisect_right(self.glides, time_s, key=lambda glide: glide.from_s)
        return self.glides[max(begun - 1, 0)]

    def value(self, time_s: float) -> Array:
        """(...) Value at that time."""
        return self.at(time_s).value(time_s)
