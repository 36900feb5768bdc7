"""Paths home for the whole fleet without conflicts, planned before they are flown; pure.

`choices` lays the ways that each may take, `meeting` finds who takes which and when, `planner` has that done
round after round, and `pace` lets the plan wait for who is held back.
`arrival` says when a vehicle comes down.
"""

from gcs.planning.return_paths.arrival import IN_PLACE_M, WELL_IN_PLACE_M, is_above, may_hand_over
from gcs.planning.return_paths.candidates import AreFree
from gcs.planning.return_paths.paths import STEP_S, Ways
from gcs.planning.return_paths.planner import Homeward, Planner, plan_ways, warm_up
from gcs.planning.return_paths.progress import Pace

__all__ = [
    "IN_PLACE_M",
    "STEP_S",
    "WELL_IN_PLACE_M",
    "AreFree",
    "Homeward",
    "Pace",
    "Planner",
    "Ways",
    "is_above",
    "may_hand_over",
    "plan_ways",
    "warm_up",
]
