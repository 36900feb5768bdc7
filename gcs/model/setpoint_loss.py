"""What vehicles do by themselves when their setpoints end. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf, nan
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.model.state import Array

STOP_S: Final = 1.0
"""After it notices the loss, a vehicle of PX4 stops as if it kept its last velocity for this time."""


@dataclass(frozen=True, slots=True)
class WithoutSetpoints:
    """One vehicle: it flies on with its last setpoint, stops, and then acts."""

    flies_on_s: float = 1.0
    lag_s: float = STOP_S  # it stops as if it kept its velocity for this time
    deceleration_m_s2: float = inf  # and for what v / (2 a) adds to it
    action: str = "return"  # "hold", "return", "land" or "descend"
    changes_mode: bool = True  # its heartbeat then reports the mode of the action
    return_height_m: float = nan  # above home, at which it returns; NaN: not read

    def stop_s(self, speed_m_s: float) -> float:
        """How long it would keep that speed for the way that it needs to stop."""
        return self.lag_s + speed_m_s / (2.0 * self.deceleration_m_s2)


@dataclass(slots=True, eq=False)
class FleetWithoutSetpoints:
    """The same of n vehicles, as columns."""

    vehicles: Sequence[WithoutSetpoints]  # (n,)
    flies_on_s: Array = field(init=False)  # (n,), as of the next two
    lag_s: Array = field(init=False)
    deceleration_m_s2: Array = field(init=False)
    action: NDArray[np.str_] = field(init=False)
    return_height_m: Array = field(init=False)  # (n,)

    def __post_init__(self) -> None:
        self.flies_on_s = np.array([each.flies_on_s for each in self.vehicles])
        self.lag_s = np.array([each.lag_s for each in self.vehicles])
        self.deceleration_m_s2 = np.array([each.deceleration_m_s2 for each in self.vehicles])
        self.action = np.array([each.action for each in self.vehicles], np.str_)
        self.return_height_m = np.array([each.return_height_m for each in self.vehicles])

    def returns_at_m(self, configured_m: Array) -> Array:
        """(n,) heights above home at which they return: as read, else as configured (n,)."""
        return np.where(np.isfinite(self.return_height_m), self.return_height_m, configured_m)

    def stop_s(self, rows: NDArray[np.intp], velocity_m_s: Array) -> Array:
        """(p,) as `WithoutSetpoints.stop_s`, of vehicles (p,) at (p, 3) velocities; not finite: at rest."""
        speed_m_s = np.linalg.norm(np.nan_to_num(velocity_m_s, posinf=0.0, neginf=0.0), axis=1)
        stop_s: Array = self.lag_s[rows] + speed_m_s / (2.0 * self.deceleration_m_s2[rows])
        return stop_s
