"""Paths home for the whole fleet without conflicts, planned before they are flown; pure.

`candidates` generates the paths that each vehicle may take, and `conflicts` selects path and time for each.
`planner` repeats that in rounds. `paths` is the plan, how it is followed, and when a vehicle descends.
"""

from gcs.planning.return_paths.candidates import AreFree
from gcs.planning.return_paths.paths import (
    IN_PLACE_M,
    STEP_S,
    PathProgress,
    ReturnPaths,
    above_place_m,
    is_above,
    keeps_to_path,
    lowest_beside_m,
    may_hand_over,
)
from gcs.planning.return_paths.planner import (
    Planner,
    ReturnSettings,
    plan_return_paths,
    return_planner,
    warm_up,
)

__all__ = [
    "IN_PLACE_M",
    "STEP_S",
    "AreFree",
    "PathProgress",
    "Planner",
    "ReturnPaths",
    "ReturnSettings",
    "above_place_m",
    "is_above",
    "keeps_to_path",
    "lowest_beside_m",
    "may_hand_over",
    "plan_return_paths",
    "return_planner",
    "warm_up",
]
