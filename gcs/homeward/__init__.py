"""Ways home for a whole fleet that do not cross: found and checked before anybody leaves. Pure.

`choices` lays the ways that each may take, `meeting` finds who takes which and when, `planner` has that done
round after round, and `pace` lets the plan wait for who is held back.
"""

from gcs.homeward.choices import AreFree
from gcs.homeward.pace import Pace
from gcs.homeward.planner import Homeward, Planner, plan_ways, warm_up
from gcs.homeward.ways import STEP_S, Ways

__all__ = ["STEP_S", "AreFree", "Homeward", "Pace", "Planner", "Ways", "plan_ways", "warm_up"]
