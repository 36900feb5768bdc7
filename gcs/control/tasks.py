"""What every vehicle has to do in a tick."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from gcs.model.state import Array, Mask, freeze


class Task(IntEnum):
    """What the tick does with a vehicle."""

    NONE = 0  # no setpoint is sent
    FORMATION = 1
    GOAL = 2  # to a goal of its own, through the same filter


@dataclass(frozen=True, slots=True, eq=False)
class Tasks:
    """What every vehicle of the fleet has to do. Rows as in FleetState. Owns its arrays."""

    task: NDArray[np.int8]  # (n,) of Task
    goal_m: Array  # (n,) possibly in the air: other vehicles keep away
    airborne: Mask  # (n,) in the air, or possibly so: others keep away
    descending: Mask  # (n,) descending to land
    segments_m: Array  # (m, 2, 3), paths that lost vehicles may take
    center_moves: bool = False  # False: the centre stays (assembling)
    formation_waits: bool = False  # paused: centre and radius are kept although no vehicle follows them
    follows_planned_path: Mask | None = (
        None  # (n,) follows a path planned for the whole fleet: no rules of the road
    )

    def __post_init__(self) -> None:
        n = len(self.task)
        freeze(self.goal_m, (n, 3), "goal_m")
        freeze(self.segments_m, (len(self.segments_m), 2, 3), "segments_m")

    @staticmethod
    def of_formation(count: int, *, center_moves: bool) -> "Tasks":
        """All `count` vehicles are airborne and in formation, and none was lost."""
        none = np.zeros(count, dtype=np.bool_)
        return Tasks(
            np.full(count, Task.FORMATION, dtype=np.int8),
            np.full((count, 3), np.nan),
            np.ones(count, dtype=np.bool_),
            none,
            np.zeros((0, 2, 3)),
            center_moves=center_moves,
            follows_planned_path=none,
        )
