"""The plan's own clock: it waits for vehicles that are behind, so that each one keeps its turn."""

import numpy as np

from gcs.model.state import Array, Mask
from gcs.planning.return_paths.paths import ReturnPaths

KEPT_UP_M = 2.5
"""Up to this distance from its expected position a vehicle is on time."""

HELD_UP_M = 5.0
"""From this distance on the plan's clock stops."""

GIVEN_UP_M = 9.0
"""Farther away, a vehicle does not follow the plan any more, and the plan does not wait for it."""

PATIENCE_S = 15.0
"""Total time that the plan waits: one blocked vehicle must not delay all others for longer."""


class PathProgress:
    """How far a plan has been flown."""

    def __init__(self, return_paths: ReturnPaths) -> None:
        self.return_paths = return_paths
        self.time_s = 0.0
        """Time in the plan: never ahead of the clock, and behind it by the total wait."""
        self._waited_s = 0.0

    def advance(self, step_s: float, position_m: Array, flown: Mask) -> None:
        """Advance the plan by `step_s`, or less.

        Args:
            step_s: since the last call.
            position_m: (n, 3) present positions, show frame.
            flown: (n,) which vehicles follow the plan; it never waits for those without a path.
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
        """(3,) Present goal of that vehicle."""
        return self.return_paths.goal_m(row, self.time_s)

    def is_over(self, row: int) -> bool:
        """Whether its path has led it above its pad."""
        return self.time_s >= float(self.return_paths.over_s[row])
