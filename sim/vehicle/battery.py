"""Batteries that discharge while the motors carry the vehicles; columns of a whole fleet."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from gcs.sim.vehicle.dynamics import Array, Mask
    from gcs.sim.vehicle.params import Columns
    from gcs.sim.vehicle.state import Numbers, State

OK, LOW, CRITICAL, EMERGENCY = 1, 2, 3, 4  # MAV_BATTERY_CHARGE_STATE


class Batteries:
    """Full at first; endurance_s in the air empties one. Voltage is linear between PX4's two thresholds."""

    def __init__(self, state: State, parameters: Columns, endurance_s: float) -> None:
        """Keep the charge in state.remaining; cells and thresholds are parameters.

        Raises:
            ValueError: an endurance that is not positive.
        """
        if not endurance_s > 0.0:
            raise ValueError(f"endurance_s must be > 0, not {endurance_s}")
        self._state = state
        self._parameters = parameters
        self._endurance_s = endurance_s

    def drain(self, powered: Mask, dt_s: float) -> None:
        """Discharge the batteries of powered vehicles, (n,), for dt_s."""
        used = powered * (dt_s / self._endurance_s)
        np.maximum(self._state.remaining - used, 0.0, out=self._state.remaining)

    def remaining_percent(self) -> Numbers:
        """(n,), rounded up, as PX4 does: 0 only when there is nothing left."""
        return np.ceil(100.0 * self._state.remaining).astype(np.int64)

    def voltage_mv(self) -> Array:
        """(n,), at the pack: recorded 16200 when full, 15300 at half."""
        p = self._parameters
        cell_v = p["BAT1_V_EMPTY"] + self._state.remaining * (p["BAT1_V_CHARGED"] - p["BAT1_V_EMPTY"])
        return np.round(1000.0 * p["BAT1_N_CELLS"] * cell_v)

    def charge_state(self) -> Numbers:
        """(n,), by the three thresholds BAT_LOW_THR, BAT_CRIT_THR, BAT_EMERGEN_THR."""
        remaining, p = self._state.remaining, self._parameters
        charge = np.where(remaining < p["BAT_LOW_THR"], LOW, OK)
        charge[remaining < p["BAT_CRIT_THR"]] = CRITICAL
        charge[remaining < p["BAT_EMERGEN_THR"]] = EMERGENCY
        return charge
