"""Vehicles of crazyflow (learnsyslab), a model that is not ours: Crazyflies with a Mellinger controller.

`make race` puts the package into the folder build: it is in none of this project's environments. Motors,
attitude and position controller are crazyflow's. The controller gets the velocity setpoint and the place
where it leads, at most `LEASH_M` from the vehicle. The delay of MAVLink and the wind are not in it.
"""

import sys
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np

from gcs.model.state import Array, Mask

PACKAGES: Final = Path(__file__).parents[3] / "build" / "crazyflow"
STEPS_HZ: Final = 480
"""Steps of the motors and the attitude controller; a whole number of them is one of the flight's."""
HOVERS_S: Final = 3.0
"""Before the flight: at first the motors stand."""
LEASH_M: Final = 0.2
FLIP: Final = np.array([1.0, -1.0, -1.0])
"""From x ahead, y right, z down to x ahead, y left, z up, and back."""


def crazyflow_version() -> str:
    """Empty: it is not installed."""
    names = [path.name for path in PACKAGES.glob("crazyflow-*.dist-info")]
    return names[0].removeprefix("crazyflow-").removesuffix(".dist-info") if names else ""


class Crazyflies:
    """True states of n Crazyflies, in the show frame, as `gcs.simulation.vehicles.Vehicles`."""

    def __init__(self, start_m: Array, step_s: float) -> None:
        sys.path.append(str(PACKAGES))  # at the end: numpy and the like are this project's
        jax, crazyflow = import_module("jax"), import_module("crazyflow.sim")
        jax.config.update("jax_compilation_cache_dir", str(PACKAGES / "compiled"))
        rates = {"freq": STEPS_HZ, "state_freq": STEPS_HZ // 4, "attitude_freq": STEPS_HZ}
        self._sim: Any = crazyflow.Sim(n_drones=len(start_m), control="state", **rates)
        self._step_s, self._place_m = step_s, np.array(start_m)
        self._steps = round(step_s * STEPS_HZ)
        self._command = np.zeros(
            (1, len(start_m), 16), np.float32
        )  # place, velocity, acceleration, attitude, rates
        states = self._sim.data.states
        states = states.replace(pos=states.pos.at[0].set((start_m * FLIP).astype(np.float32)))
        self._sim.data = self._sim.data.replace(states=states)
        self._command[0, :, :3] = start_m * FLIP
        self._command[0, :, 12] = 1.0  # level
        for _ in range(round(HOVERS_S / step_s)):
            self._advance()

    def step(self, command_m_s: Array, wind_m_s: Array, error_m_s: Array) -> Array:
        ahead_m = self._place_m + self._step_s * command_m_s - self.position_m
        far_m = np.linalg.norm(ahead_m, axis=1, keepdims=True)
        self._place_m = self.position_m + ahead_m * np.minimum(1.0, LEASH_M / np.maximum(far_m, 1e-9))
        self._command[0, :, :3], self._command[0, :, 3:6] = self._place_m * FLIP, command_m_s * FLIP
        self._advance()
        return self.position_m

    def rest(self, rows: Mask, place_m: Array) -> None:
        """One that fell stays where it is, whatever its motors do."""
        self.position_m[rows], self.velocity_m_s[rows] = place_m[rows], 0.0

    def _advance(self) -> None:
        self._sim.state_control(self._command)
        self._sim.step(self._steps)
        states = self._sim.data.states
        self.position_m: Array = np.asarray(states.pos[0], np.float64) * FLIP
        self.velocity_m_s: Array = np.asarray(states.vel[0], np.float64) * FLIP
