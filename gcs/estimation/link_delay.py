"""Delay of each vehicle's link, from the clock that it sends and from its answers. Pure; times are given."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.model.state import Array, Mask

FORGETS: Final = 2e-4
"""Seconds per second by which the smallest delay is forgotten: clocks drift."""

SMOOTH_S: Final = 3.0
"""Time constant of the average; a sample comes once a second."""

CLOCK_SET_S: Final = 3.0
"""A difference that changes by more is a clock that was set: no link delays messages for that long."""

WINDOW_S: Final = 4.0
"""Of each the soonest sample counts for the clock's rate: the others were delayed."""

WINDOWS: Final = 5
"""So many from a clock's first sample on must lie on a line. A link that fills up begins to do so later."""

WINDOWS_AGAIN: Final = 3
"""The same once the clock is known to be a simulation's, which loses more when its machine has more to do."""

STRAIGHT_S: Final = 0.03
"""Off the line at most."""

RATES: Final = (1e-3, 0.05)
"""Seconds per second: of a clock set by satellites less, of a link that fills up more."""


ANSWERS: Final = 8
"""Of so many newest answers the soonest counts: the others waited on the way."""


class LinkDelay:
    """Delay of each vehicle's link: the constant part, and how much later telemetry is than it could be.

    The constant part is half the time from a request to its answer, of the soonest of the newest answers. A
    loop through the link is late by both ways together, however they share it.

    A vehicle's SYSTEM_TIME contains its own clock as the message left. Clocks differ by a constant, so the
    varying part of the difference to its arrival is the link's delay. A simulator's clock also runs at a rate
    of its own, 1 to 2 % slow on a busy machine: what differs at a constant rate is no delay.

    Attributes:
        late_s: (n,) average delay of telemetry over its smallest so far; 0 where nothing is known.
        delay_s: (n,) one way, all of it; 0 where nothing is known.
        rate: (n,) by how much the vehicle's clock runs faster than ours; 0 where it does not measurably.
    """

    def __init__(self, count: int) -> None:
        self._base_s = np.full(count, np.nan)  # the newest sample: vehicle's clock less arrival
        self._soonest_s = np.full(count, np.nan)  # the largest of them without the rate: the smallest delay
        self._sampled_s = np.full(count, np.nan)
        self.late_s: Array = np.zeros(count)
        self.delay_s: Array = np.zeros(count)
        self._answers_s = np.full((count, ANSWERS), np.nan)  # the newest round trips, the newest last
        self._soonest_answer_s = np.full(count, np.inf)  # of all
        self.rate: Array = np.zeros(count)
        self._origin_s = np.zeros(count)  # the rate is counted from here
        self._window_s = np.zeros(count)  # begin of the window
        self._peak = np.full((count, 3), -np.inf)  # its soonest sample: base without the rate, arrival, delay
        self._peaks = np.full((count, WINDOWS, 3), np.nan)  # of the windows before: base, arrival, delay
        self._windows: Array = np.zeros(count)  # since the clock was first seen or set

    def note(self, clock_base_s: Array, round_trip_s: Array, now_s: float) -> None:
        """Add what is newest.

        Args:
            clock_base_s: (n,) each vehicle's clock when ours was 0; NaN: not known.
            round_trip_s: (n,) from a request to its answer; NaN: none.
            now_s: our clock.
        """
        answered = (round_trip_s != self._answers_s[:, -1]) & ~np.isnan(round_trip_s)
        has_answered = np.count_nonzero(answered) > 0
        if has_answered:
            self._answers_s[answered, :-1] = self._answers_s[answered, 1:]
            self._answers_s[answered, -1] = round_trip_s[answered]
            self._soonest_answer_s = np.fmin(self._soonest_answer_s, round_trip_s)
        if not (self._note_clocks(clock_base_s, now_s) or has_answered):
            return
        has_answer = np.isfinite(self._soonest_answer_s)
        constant_s = 0.5 * np.fmin.reduce(self._answers_s, axis=1, initial=np.inf)
        least_s = np.where(has_answer, 0.5 * self._soonest_answer_s, 0.0)
        self.delay_s = np.maximum(np.where(has_answer, constant_s, 0.0), least_s + self.late_s)

    def _note_clocks(self, clock_base_s: Array, now_s: float) -> bool:
        """Add new samples of the clocks. Returns: whether there were any."""
        new = (clock_base_s != self._base_s) & ~np.isnan(clock_base_s)
        if not np.count_nonzero(new):
            return False
        level_s = clock_base_s - self.rate * (now_s - self._origin_s)
        soonest_s = self._soonest_s - FORGETS * np.nan_to_num(now_s - self._sampled_s)
        late_s = soonest_s - level_s
        anew = new & ~(np.abs(late_s) < CLOCK_SET_S)  # also the first
        self._begin(anew, now_s)
        level_s = np.where(anew, clock_base_s, level_s)
        soonest_s = np.where(new, np.fmax(soonest_s, level_s), self._soonest_s)
        self._soonest_s = np.where(anew, clock_base_s, soonest_s)
        late_s = np.where(anew, 0.0, np.maximum(late_s, 0.0))
        weight = -np.expm1(-np.nan_to_num(now_s - self._sampled_s, nan=np.inf) / SMOOTH_S)
        self.late_s = np.where(new, self.late_s + weight * (late_s - self.late_s), self.late_s)
        self._sampled_s = np.where(new, now_s, self._sampled_s)
        self._base_s = np.where(new, clock_base_s, self._base_s)
        sooner = new & (level_s > self._peak[:, 0])
        self._peak[sooner] = np.stack([level_s, np.full(len(new), now_s), late_s], axis=1)[sooner]
        if (ended := new & (now_s - self._window_s >= WINDOW_S)).any():
            self._end_windows(np.flatnonzero(ended), now_s)
        return True

    def _begin(self, anew: Mask, now_s: float) -> None:
        """Forget the rate of clocks that are new or were set."""
        self.rate = np.where(anew, 0.0, self.rate)
        self._origin_s[anew] = self._window_s[anew] = now_s
        self._windows[anew], self._peak[anew] = 0, -np.inf
        self._peaks[anew] = np.nan

    def _end_windows(self, rows: NDArray[np.intp], now_s: float) -> None:
        """Add the soonest samples of these rows' windows, and take the rates of those on a line."""
        peak = self._peak[rows]
        peak[:, 0] += self.rate[rows] * (peak[:, 1] - self._origin_s[rows])
        self._peaks[rows] = np.roll(self._peaks[rows], -1, axis=1)
        self._peaks[rows, -1] = peak
        self._windows[rows] += 1
        self._window_s[rows], self._peak[rows] = now_s, -np.inf
        first = self._windows[rows] == WINDOWS
        again = (self.rate[rows] != 0.0) & (self._windows[rows] > WINDOWS)
        for some, windows in ((first, WINDOWS), (again, WINDOWS_AGAIN)):
            self._take_rates(rows[some], windows)

    def _take_rates(self, rows: NDArray[np.intp], windows: int) -> None:
        """Take the rate of these rows' last windows, where their soonest samples lie on a line.

        All of them are as late as the first: a clock that runs on as before makes no link prompt again.
        """
        base_s, arrived_s, late_s = np.moveaxis(self._peaks[rows, -windows:], 2, 0)
        passed_s = arrived_s - arrived_s[:, :1]
        changed_s = base_s - base_s[:, :1]
        rate = changed_s[:, -1] / passed_s[:, -1]
        off_s = np.abs(changed_s - rate[:, np.newaxis] * passed_s).max(axis=1)
        good = (off_s <= STRAIGHT_S) & (np.abs(rate) >= RATES[0]) & (np.abs(rate) <= RATES[1])
        taken = rows[good]
        self.rate[taken] = rate[good]
        level_s = base_s[good, 0] - rate[good] * (arrived_s[good, 0] - self._origin_s[taken])
        self._soonest_s[taken] = level_s + late_s[good, 0]
        self._peaks[taken, -windows:, 2] = late_s[good, :1]
