"""Whether vehicles that stand are still reported where they stood once they were ready. Pure.

While an estimator starts its position jumps: ArduCopter reports latitude and longitude 0 for its first 9 s,
and uses its receiver from 40 s on (FACTS-ARDUPILOT, 19). That is held against no vehicle. One that is ready
and stands does not move: recorded were 0.15 m of ArduCopter, and 0.2 m of PX4, which reported 0.9 m.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.model.state import FIX_3D, Array, Landed, Mask, Telemetry

PERIOD_S: Final = 0.2
"""Interval between two samples."""

SETTLES_S: Final = 10.0
"""So long a vehicle is ready at one place before that is where it stands, and before it is back there."""

DEVIATIONS: Final = 3.0
"""Two positions of one place differ by at most so many standard deviations of both together."""

LEAST_M: Final = 1.0
"""And by no less than this: the worst error of a recorded estimate beside its accuracy was 0.9 m."""

FOLLOWS_S: Final = 60.0
"""Time constant with which the height of a place follows: a barometer drifts with the weather, and what
drifts unlike the others is found by `gcs.estimation.height_bias`.
"""

LEAST_NAMED_M: Final = 0.5
"""A smaller part of a way is not named."""

AGO_IN_S_MAX: Final = 120.0
"""A longer time is given in minutes."""

BETTER: Final = 0.5
"""A place is taken anew where the deviation has shrunk to this share."""


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
    """How far n vehicles are reported from where they stood."""

    way_m: Array  # (n, 3) show frame, NaN: no place is known yet
    limit_m: Array  # (n, 2) sideways, up or down: what accuracies explain
    since_s: Array  # (n,) loop's time, inf: it has not moved

    @property
    def by_m(self) -> Array:
        """(n, 2) sideways, up or down."""
        return np.stack([np.hypot(self.way_m[:, 0], self.way_m[:, 1]), np.abs(self.way_m[:, 2])], axis=1)

    @property
    def away(self) -> Mask:
        """(n,) which are farther than accuracies explain now."""
        return np.asarray((self.by_m > self.limit_m).any(axis=1))

    def in_words(self, row: int, now_s: float) -> tuple[str, str]:
        """How far one of them moved, and when."""
        down = "down" if self.way_m[row, 2] > 0.0 else "up"
        ways = zip(self.by_m[row].tolist(), ("sideways", down), strict=True)
        by = " and ".join(f"{part_m:.2g} m {way}" for part_m, way in ways if part_m >= LEAST_NAMED_M)
        ago_s = now_s - float(self.since_s[row])
        return by, f"{ago_s:.0f} s ago" if ago_s < AGO_IN_S_MAX else f"{ago_s / 60.0:.0f} min ago"


class PadPlaces:
    """Compares the places of vehicles on the ground from sample to sample.

    Attributes:
        found: the newest result.
    """

    def __init__(self, count: int, up_share: float) -> None:
        """`up_share` is `Floor.vertical_uncertainty`."""
        self._share = np.array([1.0, up_share])
        self._due_s = -np.inf
        self._none_stands = False
        self._reboots = np.zeros(count, np.int64)
        self._place_m, self._deviation_m = np.full((count, 3), np.nan), np.full(count, np.nan)
        self._held_m, self._held_s = self._place_m.copy(), np.full(count, np.inf)
        self._since_s = np.full(count, np.inf)
        self.found = Moved(self._place_m.copy(), np.full((count, 2), np.inf), self._since_s.copy())

    def is_due(self, now_s: float) -> bool:
        return now_s >= self._due_s

    def note(self, telemetry: Telemetry, position_m: Array, fresh: Mask, wide_m: Array, now_s: float) -> None:
        """Take a sample.

        Args:
            telemetry: of all.
            position_m: (n, 3) show frame.
            fresh: (n,) which of these are fresh and believed.
            wide_m: (n,) standard deviation of each, sideways.
            now_s: loop's time.
        """
        self._due_s = now_s + PERIOD_S
        none_stood, self._none_stands = self._none_stands, all(telemetry.armed)
        self._none_stands &= Landed.ON_GROUND not in telemetry.landed
        if none_stood and self._none_stands:
            return  # all places are forgotten already
        landed = np.array([each is Landed.ON_GROUND for each in telemetry.landed])
        restarted = self._reboots != np.array(telemetry.reboot_count)
        self._reboots = np.array(telemetry.reboot_count)
        self.forget(restarted | (np.array(telemetry.armed) & ~landed))
        fresh = fresh & landed & np.isfinite(position_m).all(axis=1)
        ready = fresh & np.array(telemetry.ready) & ~(telemetry.fix_type < FIX_3D)
        self._hold(position_m, ready, self._limit_m(wide_m, wide_m), now_s)
        steady = ready & (now_s - self._held_s >= SETTLES_S)
        limit_m = self._limit_m(self._deviation_m, wide_m)
        way_m = np.where(fresh[:, None], position_m - self._place_m, self.found.way_m)
        away, before_s = Moved(way_m, limit_m, self._since_s).away, self._since_s
        begins, ends = away & fresh & np.isinf(before_s), ~away & steady
        self._since_s = np.where(begins, now_s, np.where(ends, np.inf, before_s))
        stood = np.isinf(self._since_s)
        self._place_m[:, 2] += np.where(fresh & stood, way_m[:, 2], 0.0) * (PERIOD_S / FOLLOWS_S)
        anew = steady & stood & ~(self._deviation_m * BETTER < wide_m)
        self._place_m[anew], self._deviation_m[anew] = position_m[anew], wide_m[anew]
        self.found = Moved(way_m, limit_m, self._since_s.copy())

    def forget(self, rows: Mask) -> None:
        """Take the places of these rows (n,) anew: where they are reported now is where they stand."""
        self._place_m[rows], self._deviation_m[rows] = np.nan, np.nan
        self._held_s[rows] = self._since_s[rows] = np.inf
        way_m, since_s = self.found.way_m.copy(), self._since_s.copy()
        way_m[rows] = np.nan
        self.found = Moved(way_m, self.found.limit_m, since_s)

    def _hold(self, position_m: Array, ready: Mask, limit_m: Array, now_s: float) -> None:
        """Note since when each is ready at one place."""
        way_m = position_m - self._held_m
        stays = (np.hypot(way_m[:, 0], way_m[:, 1]) <= limit_m[:, 0]) & (np.abs(way_m[:, 2]) <= limit_m[:, 1])
        begins = ~(stays & ready & np.isfinite(self._held_s))
        self._held_m[begins] = position_m[begins]
        self._held_s[begins] = np.where(ready, now_s, np.inf)[begins]

    def _limit_m(self, one_m: Array, other_m: Array) -> Array:
        """(n, 2) how far apart positions of these deviations (n,) may be: sideways, up or down."""
        wide_m = DEVIATIONS * np.hypot(one_m, other_m)
        return np.asarray(np.maximum(wide_m[:, None] * self._share, LEAST_M))
