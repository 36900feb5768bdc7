"""Ways home for a whole fleet that do not cross: found and checked before anybody leaves. Pure.

`choices` lays the ways that each may take, `meeting` finds who takes which and when, `planner` has that done
round after round, and `pace` lets the plan wait for who is held back.
`arrival` says when a vehicle comes down.
"""

from gcs.homeward.arrival import IN_PLACE_M, WELL_IN_PLACE_M, is_above, may_hand_over
from gcs.homeward.choices import AreFree
from gcs.homeward.pace import Pace
from gcs.homeward.planner import Homeward, Planner, plan_ways, warm_up
from gcs.homeward.ways import STEP_S, Ways

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
