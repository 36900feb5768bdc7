"""Paths home for the whole fleet without conflicts, planned before they are flown; pure.

`candidates` generates the paths that each vehicle may take, and `conflicts` selects path and time for each.
`planner` repeats that in rounds, and `progress` lets the plan wait for vehicles that are behind.
`arrival` decides when a vehicle descends.
"""

from gcs.planning.return_paths.arrival import IN_PLACE_M, WELL_IN_PLACE_M, is_above, may_hand_over
from gcs.planning.return_paths.candidates import AreFree
from gcs.planning.return_paths.paths import STEP_S, ReturnPaths
from gcs.planning.return_paths.planner import Planner, ReturnSettings, plan_return_paths, warm_up
from gcs.planning.return_paths.progress import PathProgress

__all__ = [
    "IN_PLACE_M",
    "STEP_S",
    "WELL_IN_PLACE_M",
    "AreFree",
    "PathProgress",
    "Planner",
    "ReturnPaths",
    "ReturnSettings",
    "is_above",
    "may_hand_over",
    "plan_return_paths",
    "warm_up",
]
