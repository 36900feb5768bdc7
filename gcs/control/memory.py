"""State that one tick passes to the next."""

from dataclasses import dataclass

import numpy as np

from gcs.formation.orbit import Center
from gcs.model.state import Array


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """State that one tick passes to the next. Rows as in FleetState. Owns its arrays."""

    time_s: float
    center: Center | None  # None until a formation flies
    radius_m: float
    desired_m_s: Array  # (n, 3) velocity after the safety filter, NaN where not commanded
    yaw_rad: Array  # (n,) commanded, NaN where not commanded
    held_yaw_rad: Array  # (n,) at engagement
    engaged_time_s: Array  # (n,) when it joined the formation, NaN outside
    place: Array  # (n, 3) slots: unit vectors from the centre, NaN outside the formation
    change: Array  # (n, 3) of the slots in the last sweep
    trim_m_s: Array  # (n, 3) correction of setpoints for wind, drag and the vehicle's own response
    expected_m_s: Array  # (n, 3) velocity relative to the centre's that each should have, NaN: not commanded
    pace: float  # share of the orbit's speed that the vehicles can keep up with
    sides: dict[str, float]

    @staticmethod
    def fresh(count: int, time_s: float) -> "Memory":
        """The state before the first tick: nothing is commanded."""
        nothing, nowhere, still = np.full(count, np.nan), np.full((count, 3), np.nan), np.zeros((count, 3))
        return Memory(
            time_s=time_s,
            center=None,
            radius_m=0.0,
            desired_m_s=nowhere,
            yaw_rad=nothing,
            held_yaw_rad=nothing,
            engaged_time_s=nothing,
            place=nowhere,
            change=still,
            trim_m_s=still,
            expected_m_s=nowhere,
            pace=1.0,
            sides={},
        )
