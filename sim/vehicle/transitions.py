"""Decides when transitions of PX4's commander are due, for a whole fleet at once.

Loss of setpoints or of the ground station, battery, landing, take-off, disarming. The effect on one vehicle
is in sim.vehicle.commander.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.sim.vehicle.commander import IMPATIENT_S, LandedState
from gcs.sim.vehicle.modes import MODES, PREVENTS_ARMING, Mode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gcs.sim.vehicle.battery import Batteries
    from gcs.sim.vehicle.commander import Commander
    from gcs.sim.vehicle.dynamics import Array, Mask
    from gcs.sim.vehicle.params import Columns
    from gcs.sim.vehicle.quirks import Quirks
    from gcs.sim.vehicle.state import Numbers, State

# From spool-up to "Takeoff detected": recorded 1.84 s after arming, of which COM_SPOOLUP_TIME is 1.0.
TAKEOFF_DETECTION_S = 0.84
# PX4 passes through three stages, each LNDMC_TRIG_TIME long at least: recorded 3.3 s after touching.
LANDING_STAGES = 3
CLIMB_DEMAND_M_S = 0.3

OFFBOARD, TAKEOFF, LAND = Mode.OFFBOARD.number, Mode.TAKEOFF.number, Mode.LAND.number
NOT_ARMABLE = np.array([mode in PREVENTS_ARMING for mode in MODES])


class Transitions:
    """Advances the commanders of a fleet."""

    def __init__(
        self, state: State, commanders: Sequence[Commander], parameters: Columns, quirks: Quirks
    ) -> None:
        """Row i of the state is commanders[i]."""
        self._state = state
        self._commanders = commanders
        self._parameters = parameters
        self._quirks = quirks

    def update(self, awake: Mask, contact: Mask, climb_m_s: Array, batteries: Batteries) -> None:
        """Execute the transitions that are due at the state's time.

        Args:
            awake: (n,), vehicles with a position.
            contact: (n,), vehicles on the ground.
            climb_m_s: (n,), the upward speed that the flown mode demands.
            batteries: for MAV_BATTERY_CHARGE_STATE.
        """
        state = self._state
        armed = awake & state.armed
        if armed.any():
            self._watch_setpoints(armed)
            self._watch_station(armed)
            charge = batteries.charge_state()
            weak = armed & ~state.landed & (charge > state.charge)
            for row in weak.nonzero()[0].tolist():
                self._commanders[row].weaken(int(charge[row]))
        waiting = awake & state.armed & state.landed
        self._watch_landing(awake & ~state.landed, contact, climb_m_s)
        if waiting.any():
            self._watch_takeoff(waiting, climb_m_s)
        standing = awake & state.armed & state.landed
        if standing.any():
            self._watch_disarming(standing)

    def fed(self) -> Mask:
        """(n,): whether a setpoint has arrived within COM_OF_LOSS_T."""
        patience_s = self._parameters["COM_OF_LOSS_T"]
        if not self._quirks.patient_offboard:
            patience_s = np.minimum(patience_s, IMPATIENT_S)
        fed: Mask = self._state.now_s - self._state.setpoint_s < patience_s
        return fed

    def can_arm(self) -> Mask:
        """(n,): the prearm check, as Commander.can_arm."""
        state = self._state
        able: Mask = (state.now_s >= state.ready_at_s) & ~NOT_ARMABLE[state.intended]
        able &= state.unhealthy_sensors == 0
        if self._quirks.starved_offboard:
            able &= (state.intended != OFFBOARD) | self.fed()
        return able

    def landed_state(self) -> Numbers:
        """(n,): MAV_LANDED_STATE, as in EXTENDED_SYS_STATE."""
        state = self._state
        flying = np.where(state.mode == LAND, int(LandedState.LANDING), int(LandedState.IN_AIR))
        flying[state.armed & (state.mode == TAKEOFF)] = LandedState.TAKEOFF
        return np.where(state.landed, int(LandedState.ON_GROUND), flying)

    def _watch_setpoints(self, armed: Mask) -> None:
        state = self._state
        due = armed & (state.intended == OFFBOARD) & (self.fed() == state.failsafe)
        if not self._quirks.resume:
            due &= ~state.failsafe
        if not self._quirks.setpoint_loss:
            due &= state.failsafe
        for row in due.nonzero()[0].tolist():
            self._commanders[row].starve_or_feed()

    def _watch_station(self, armed: Mask) -> None:
        """Apply NAV_DLL_ACT, once, COM_DL_LOSS_T after the last heartbeat of a ground station."""
        state, p = self._state, self._parameters
        silent = state.now_s - state.station_s > p["COM_DL_LOSS_T"]
        if not silent.any():
            state.station_lost[:] = False
            return
        due = armed & ~state.landed & silent & ~state.station_lost & (p["NAV_DLL_ACT"] > 0)
        state.station_lost = silent & (state.station_lost | due)
        for row in np.flatnonzero(due).tolist():
            self._commanders[row].lose_station()

    def _watch_takeoff(self, waiting: Mask, climb_m_s: Array) -> None:
        state = self._state
        spooled_s = state.armed_s + self._parameters["COM_SPOOLUP_TIME"]
        climbing = waiting & (climb_m_s >= CLIMB_DEMAND_M_S) & (state.now_s >= spooled_s)
        state.climb_since_s[waiting & ~climbing] = np.inf
        state.climb_since_s[climbing] = np.minimum(state.climb_since_s[climbing], state.now_s)
        for row in np.flatnonzero(
            climbing & (state.now_s >= state.climb_since_s + TAKEOFF_DETECTION_S)
        ).tolist():
            self._commanders[row].lift_off()

    def _watch_landing(self, flying: Mask, contact: Mask, climb_m_s: Array) -> None:
        """On the ground with a descent demanded: landed after a while, at once when the motors are off."""
        state = self._state
        if not contact.any():
            state.down_since_s[flying] = np.inf
            return
        down = flying & contact & ~(state.armed & (climb_m_s >= 0.0))
        state.down_since_s[flying & ~down] = np.inf
        if not down.any():
            return
        state.down_since_s[down] = np.minimum(state.down_since_s[down], state.now_s)
        wait_s = np.where(state.armed, LANDING_STAGES * self._parameters["LNDMC_TRIG_TIME"], 0.0)
        for row in np.flatnonzero(down & (state.now_s >= state.down_since_s + wait_s)).tolist():
            self._commanders[row].touch_down()

    def _watch_disarming(self, standing: Mask) -> None:
        """Apply COM_DISARM_LAND after a flight, COM_DISARM_PRFLT before one; not positive means never."""
        state, p = self._state, self._parameters
        wait_s = np.where(state.flown, p["COM_DISARM_LAND"], p["COM_DISARM_PRFLT"])
        since_s = np.where(state.flown, state.landed_s, state.armed_s)
        still = standing & (state.climb_since_s == np.inf) & (wait_s > 0.0)
        for row in np.flatnonzero(still & (state.now_s >= since_s + wait_s)).tolist():
            landed = state.flown[row]
            self._commanders[row].stop(
                "Disarmed by landing" if landed else "Disarmed by auto preflight disarming"
            )
