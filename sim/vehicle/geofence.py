"""PX4's uploaded fences: who is outside, five times a second, and what GF_ACTION does then.

Source: src/modules/navigator. The predicted breach (GF_PREDICT), and the cylinder of GF_MAX_HOR_DIST and
GF_MAX_VER_DIST, are not imitated.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.sim.vehicle.commander import Commander
from gcs.sim.vehicle.dynamics import Mask
from gcs.sim.vehicle.parameters import Columns
from gcs.sim.vehicle.polygons import Fenced, outside
from gcs.sim.vehicle.sensors import Sensors
from gcs.sim.vehicle.state import State

CHECK_S = 0.2


@dataclass(eq=False)
class Geofence:
    """The fences of a fleet; row i of each is vehicle i."""

    state: State
    commanders: Sequence[Commander]
    parameters: Columns
    fences: Sequence[Fenced]
    _next_s: float = -math.inf

    def update(self, sensors: Sensors, awake: Mask) -> None:
        """Look at the estimated places of vehicles that are awake (n,), if it is time."""
        state = self.state
        if state.now_s < self._next_s:
            return
        self._next_s = state.now_s + CHECK_S
        acts = self.parameters["GF_ACTION"] > 0
        rows = [row for row, each in enumerate(self.fences) if each.in_force and acts[row] and awake[row]]
        breached = np.zeros(state.count, dtype=np.bool_)
        places = sensors.place(np.array(rows, dtype=np.intp)).tolist() if rows else ()
        for row, place in zip(rows, places, strict=True):
            breached[row] = outside(self.fences[row].in_force, place)
        fresh, state.fence_breached = breached & ~state.fence_breached, breached
        for row in fresh.nonzero()[0].tolist():
            self.commanders[row].leave_fence()
