"""A battery that empties while the motors carry the vehicle."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim.params import Parameters

OK, LOW, CRITICAL, EMERGENCY = 1, 2, 3, 4  # MAV_BATTERY_CHARGE_STATE


class Battery:
    """Full at first; endurance_s in the air empties it. Voltage is linear between PX4's two thresholds."""

    def __init__(self, parameters: Parameters, endurance_s: float) -> None:
        """Take the cells and thresholds from the parameters.

        Raises:
            ValueError: an endurance that is not positive.
        """
        if not endurance_s > 0.0:
            raise ValueError(f"endurance_s must be > 0, not {endurance_s}")
        self._parameters = parameters
        self._endurance_s = endurance_s
        self.remaining = 1.0

    def drain(self, dt_s: float) -> None:
        """Carry the vehicle for dt_s."""
        self.remaining = max(self.remaining - dt_s / self._endurance_s, 0.0)

    @property
    def remaining_percent(self) -> int:
        """Rounded up, as PX4 does: 0 only when there is nothing left."""
        return -int(-100.0 * self.remaining // 1)

    @property
    def voltage_mv(self) -> int:
        """At the pack: recorded 16200 when full, 15300 at half."""
        p = self._parameters
        empty_v, full_v = p["BAT1_V_EMPTY"], p["BAT1_V_CHARGED"]
        return round(1000.0 * p["BAT1_N_CELLS"] * (empty_v + self.remaining * (full_v - empty_v)))

    @property
    def charge_state(self) -> int:
        """By the three thresholds BAT_LOW_THR, BAT_CRIT_THR, BAT_EMERGEN_THR."""
        states = (("BAT_EMERGEN_THR", EMERGENCY), ("BAT_CRIT_THR", CRITICAL), ("BAT_LOW_THR", LOW))
        for name, state in states:
            if self.remaining < self._parameters[name]:
                return state
        return OK
