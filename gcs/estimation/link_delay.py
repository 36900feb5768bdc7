"""Delay of each vehicle's telemetry, compared with its smallest so far. Pure; times are given.

A vehicle's SYSTEM_TIME contains its own clock as the message left. Clocks differ by a constant, so the
varying part of the difference to its arrival is the link's delay. (The boot clock is not suitable: a
simulator's loses 1 to 2 % against the wall clock.)
"""

from typing import Final

import numpy as np

from gcs.model.state import Array

FORGETS: Final = 2e-4
"""Seconds per second by which the smallest delay is forgotten: clocks drift."""

SMOOTH_S: Final = 3.0
"""Time constant of the average; a sample comes once a second."""

CLOCK_SET_S: Final = 3.0
"""A difference that changes by more is a clock that was set: no link delays messages for that long."""


class LinkDelay:
    """Columns of all vehicles, rows as in FleetState."""

    def __init__(self, count: int) -> None:
        self._base_s = np.full(count, np.nan)  # the newest sample: vehicle's clock less arrival
        self._soonest_s = np.full(count, np.nan)  # the largest of them: the smallest delay
        self._sampled_s = np.full(count, np.nan)
        self._late_s = np.zeros(count)

    def note(self, clock_base_s: Array, now_s: float) -> None:
        """Add (n,) each vehicle's clock when ours was 0; NaN: not known."""
        new = (clock_base_s != self._base_s) & ~np.isnan(clock_base_s)
        if not new.any():
            return
        soonest_s = self._soonest_s - FORGETS * np.nan_to_num(now_s - self._sampled_s)
        late_s = soonest_s - clock_base_s
        anew = new & ~(np.abs(late_s) < CLOCK_SET_S)  # also the first
        soonest_s = np.where(new, np.fmax(soonest_s, clock_base_s), self._soonest_s)
        self._soonest_s = np.where(anew, clock_base_s, soonest_s)
        late_s = np.where(anew, 0.0, np.maximum(late_s, 0.0))
        weight = -np.expm1(-np.nan_to_num(now_s - self._sampled_s, nan=np.inf) / SMOOTH_S)
        self._late_s = np.where(new, self._late_s + weight * (late_s - self._late_s), self._late_s)
        self._sampled_s = np.where(new, now_s, self._sampled_s)
        self._base_s = np.where(new, clock_base_s, self._base_s)

    @property
    def late_s(self) -> Array:
        """(n,) average delay; 0 where nothing is known."""
        return self._late_s
