"""What PX4's estimator does in flight: it aligns the heading, and goes on without GPS for a while.

Recorded on v1.16: 13 resets until the vehicle is ready, and one in each flight at 1.5 m above the ground.
That was 4.5 s after "Takeoff detected" in a take-off and 2.8 s in a climb in OFFBOARD. The heading turned by
-3.9 and 1.1 degrees. The position did not jump: its change was the 4 cm that the vehicle flew meanwhile.
"""

from dataclasses import dataclass

import numpy as np

from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.px4 import Mode
from gcs.sim.vehicle.state import FIX_3D, State

RESETS_AT_BOOT = 13
ALIGNED_ABOVE_M = 1.5
TAKEOFF_ALIGNED_S, ALIGNED_S = 4.5, 2.8
"""At the earliest after "Takeoff detected": a vehicle here gains height sooner than the recorded one."""
LARGEST_TURN_RAD = np.radians(4.0)
POSITION_LASTS_S = 4.8
"""From the last fix until PX4 no longer trusts its position: flown."""
DRIFT_M_S2 = 0.02
"""Growth of the velocity's error without GPS: 4 m after 20 s. ArduCopter drifted 1.7 and 11 m in that."""


@dataclass(eq=False)
class Estimator:
    """The estimators of a fleet; `resets`: whether they are reset at boot and in flight."""

    state: State
    resets: bool

    def boot(self, row: int, random: np.random.Generator) -> None:
        """Draw what this vehicle's estimator will do in flight."""
        state, direction_rad = self.state, random.uniform(-np.pi, np.pi)
        state.reset_counter[row] = RESETS_AT_BOOT if self.resets else 0
        state.heading_turn_rad[row] = random.uniform(-LARGEST_TURN_RAD, LARGEST_TURN_RAD)
        state.drift_m_s2[row] = DRIFT_M_S2 * np.array((np.cos(direction_rad), np.sin(direction_rad), 0.0))

    def update(self, height_m: Array, dt_s: float) -> Mask:
        """Advance all estimators.

        Args:
            height_m: (n,), above the ground.
            dt_s: since the last step.

        Returns: (n,), vehicles that no longer know their position.
        """
        state = self.state
        if self.resets:
            due = state.powered & ~state.heading_aligned & (height_m >= ALIGNED_ABOVE_M)
            if np.count_nonzero(due):
                waits_s = np.where(state.mode == Mode.TAKEOFF.number, TAKEOFF_ALIGNED_S, ALIGNED_S)
                due &= state.now_s - state.airborne_since_s >= waits_s
            if np.count_nonzero(due):
                state.heading_aligned |= due
                state.reset_counter += due.astype(np.uint8)
                state.yaw_rad = np.where(due, state.yaw_rad + state.heading_turn_rad, state.yaw_rad)
            state.heading_aligned &= ~state.landed
        has_gps = state.fix_type >= FIX_3D
        drifting = state.gps_lost_s < np.inf
        if not np.count_nonzero(~has_gps | drifting):
            return drifting
        back = has_gps & drifting
        state.reset_counter += back.astype(np.uint8)
        state.gps_lost_s = np.where(has_gps, np.inf, np.minimum(state.gps_lost_s, state.now_s))
        blind = ~has_gps[:, np.newaxis]
        state.drift_m_s = np.where(blind, state.drift_m_s + dt_s * state.drift_m_s2, 0.0)
        state.drift_m = np.where(blind, state.drift_m + dt_s * state.drift_m_s, 0.0)
        lost: Mask = state.now_s - state.gps_lost_s >= POSITION_LASTS_S
        return lost
