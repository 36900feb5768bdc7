"""The plan's own clock: it waits for who is held back, so that nobody passes before its turn."""

import numpy as np

from gcs.model.state import Array, Mask
from gcs.planning.return_paths.paths import ReturnPaths

KEPT_UP_M = 2.5
"""Who is no farther from where it should be keeps up."""

HELD_UP_M = 5.0
"""For who is that far, or farther, the plan stands still."""

GIVEN_UP_M = 9.0
"""Farther from it, a vehicle does not fly the plan any more, and is not waited for."""

PATIENCE_S = 15.0
"""For so long the plan waits, in all: one vehicle that something holds must not keep up all the others."""


class PathProgress:
    """How far a plan has been flown."""

    def __init__(self, return_paths: ReturnPaths) -> None:
        self.return_paths = return_paths
        self.time_s = 0.0
        """In the plan: never ahead of the clock, and behind it by what was waited."""
        self._waited_s = 0.0

    def advance(self, step_s: float, position_m: Array, flown: Mask) -> None:
        """Let the plan go on for `step_s`, or less.

        Args:
            step_s: since the last time.
            position_m: (n, 3) where they are now, show frame.
            flown: (n,) which vehicles fly the plan; those that found no way are never waited for.
        """
        behind_m = np.linalg.norm(position_m - self.return_paths.expected_m(self.time_s), axis=1)
        followed = flown & (behind_m < GIVEN_UP_M)
        followed[list(self.return_paths.unplanned)] = False
        waited_for = behind_m[followed]
        share = (HELD_UP_M - float(waited_for.max(initial=0.0))) / (HELD_UP_M - KEPT_UP_M)
        waits_s = min(step_s * (1.0 - min(max(share, 0.0), 1.0)), PATIENCE_S - self._waited_s)
        self._waited_s += waits_s
        self.time_s += step_s - waits_s

    def goal_m(self, row: int) -> Array:
        """(3,) what draws that vehicle now."""
        return self.return_paths.goal_m(row, self.time_s)

    def is_over(self, row: int) -> bool:
        """Whether its way has led it above its pad."""
        return self.time_s >= float(self.return_paths.over_s[row])
