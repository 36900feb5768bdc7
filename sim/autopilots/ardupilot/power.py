"""ArduCopter's battery: charge by BATT_CAPACITY, voltage by SIM_BATT_VOLTAGE, load and charge (habit 52)."""

from dataclasses import dataclass

import numpy as np

from gcs.sim.autopilots.ardupilot.state import ArduState
from gcs.sim.vehicle.dynamics import Array
from gcs.sim.vehicle.parameters import Columns
from gcs.sim.vehicle.state import Numbers

RESISTANCE_OHM = 0.017  # recorded: 12.59 V at rest, 12.24 V with 20.5 A
FALLS_V, FALLS_BELOW = 2.1, 0.2
"""Voltage lost at the end of the charge, so that a fault of the battery shows; in SITL none is."""
LEVELS = (("BATT_LOW_VOLT", "BATT_FS_LOW_ACT", "low"), ("BATT_CRT_VOLT", "BATT_FS_CRT_ACT", "critical"))
CHARGES = ("BATT_LOW_MAH", "BATT_CRT_MAH")
"""Thresholds of voltage and of charge; those that are 0 do not count, as the critical ones are delivered."""


@dataclass(eq=False)
class Batteries:
    """Full at first; endurance_s in the air empties one."""

    state: ArduState
    parameters: Columns
    endurance_s: float

    def __post_init__(self) -> None:
        if not self.endurance_s > 0.0:
            raise ValueError(f"endurance_s must be > 0, not {self.endurance_s}")

    def step(self, dt_s: float) -> None:
        """Discharge the batteries of flying vehicles for dt_s, and note since when the voltage is low."""
        state = self.state
        state.remaining -= np.minimum(state.remaining, state.powered * (dt_s / self.endurance_s))
        voltage_v, p = self.voltage_v(), self.parameters
        for level, (name, _, _) in enumerate(LEVELS):
            since_s = state.weak_since_s[:, level]
            left_mah, least_mah = state.remaining * p["BATT_CAPACITY"], p[CHARGES[level]]
            weak = ((voltage_v < p[name]) & (p[name] > 0.0)) | ((left_mah < least_mah) & (least_mah > 0.0))
            state.weak_since_s[:, level] = np.where(weak, np.minimum(since_s, state.now_s), np.inf)

    def level(self, since_s: Array | None = None) -> Numbers:
        """(n,): 0, or 1 for low and 2 for critical, for BATT_LOW_TIMER; counted from since_s (n,) at most."""
        begin_s = self.state.weak_since_s
        if since_s is not None:
            begin_s = np.maximum(begin_s, since_s[:, np.newaxis])
        expired = self.state.now_s - begin_s >= self.parameters["BATT_LOW_TIMER"][:, np.newaxis]
        level: Numbers = np.where(expired[:, 1], 2, np.where(expired[:, 0], 1, 0))
        return level

    def current_a(self) -> Array:
        """(n,): the current in flight that empties the battery in the endurance; none with motors off."""
        hover_a = 3.6 * self.parameters["BATT_CAPACITY"] / self.endurance_s
        current_a: Array = np.where(self.state.powered, hover_a, 0.0)
        return current_a

    def voltage_v(self) -> Array:
        """(n,), of the whole pack."""
        emptied = np.maximum(1.0 - self.state.remaining / FALLS_BELOW, 0.0)
        full_v = self.parameters["SIM_BATT_VOLTAGE"] - FALLS_V * emptied
        voltage_v: Array = full_v - RESISTANCE_OHM * self.current_a()
        return voltage_v

    def used_mah(self) -> Array:
        """(n,)."""
        used_mah: Array = (1.0 - self.state.remaining) * self.parameters["BATT_CAPACITY"]
        return used_mah

    def remaining_percent(self) -> Numbers:
        """(n,)."""
        return np.floor(100.0 * self.state.remaining + 1e-9).astype(np.int64)

    def sagging(self, row: int) -> str:
        """The text of a low or critical battery."""
        word = LEVELS[int(self.level()[row]) - 1][2]
        return f"Battery 1 is {word} {self.voltage_v()[row]:.2f}V used {self.used_mah()[row]:.0f} mAh"

    def reasons(self, row: int) -> list[str]:
        """Why it would not arm; each text is sent twice, as recorded."""
        level, problems = int(self.level()[row]), []
        if level and self.parameters[LEVELS[level - 1][1]][row] > 0:
            problems.append(f"Battery 1 {LEVELS[level - 1][2]} voltage failsafe")
        if self.voltage_v()[row] < self.parameters["BATT_ARM_VOLT"][row]:
            problems.append("Battery 1 below minimum arming voltage")
        return [text for text in problems for _ in range(2)]
