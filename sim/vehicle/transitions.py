"""The transitions of PX4's commanders, for a whole fleet when they are due."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gcs.sim.vehicle import failsafe
from gcs.sim.vehicle.commander import BY_HAND, LAND, OFFBOARD, TAKEOFF, Commander, LandedState, fed
from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.parameters import Columns
from gcs.sim.vehicle.px4 import Quirks
from gcs.sim.vehicle.sensors import Batteries
from gcs.sim.vehicle.state import Numbers, State

# From spool-up to "Takeoff detected": recorded 1.84 s after arming, of which COM_SPOOLUP_TIME is 1.0.
TAKEOFF_DETECTION_S = 0.84
# PX4 passes through three stages, each LNDMC_TRIG_TIME long at least: recorded 3.3 s after touching.
LANDING_STAGES = 3
CLIMB_DEMAND_M_S = 0.3


@dataclass(eq=False)
class Transitions:
    """Advances the commanders of a fleet."""

    state: State
    commanders: Sequence[Commander]
    parameters: Columns
    quirks: Quirks
    _unhealthy: Numbers | None = field(default=None, init=False)  # as of the last step

    def update(self, awake: Mask, contact: Mask, climb_m_s: Array, batteries: Batteries) -> None:
        """Execute the transitions that are due at the state's time.

        Args:
            awake: (n,), vehicles with a position.
            contact: (n,), vehicles on the ground.
            climb_m_s: (n,), the upward speed that the flown mode demands.
            batteries: for MAV_BATTERY_CHARGE_STATE.
        """
        state = self.state
        armed = awake & state.armed
        self._watch_health(awake & ~state.armed)
        if np.count_nonzero(armed):
            self._watch_setpoints(armed)
            self._watch_station(armed)
            self._watch_transponders(armed)
            for row in (armed & (state.now_s >= state.acts_at_s)).nonzero()[0].tolist():
                self.commanders[row].act()
            if np.count_nonzero(state.position_lost):
                lost = armed & ~state.landed & state.position_lost & ~state.blind & ~BY_HAND[state.mode]
                for row in (lost & ~state.terminated).nonzero()[0].tolist():
                    self.commanders[row].lose_position()
            charge = batteries.charge_state()
            if self.commanders[0].firmware_release >= failsafe.WORSE_THAN_AT_ARMING:
                waits = armed & ~state.flown
                state.charge[waits] = charge[waits]
            weak = armed & ~state.landed & (charge > state.charge)
            for row in weak.nonzero()[0].tolist():
                self.commanders[row].weaken(int(charge[row]))
        waiting = awake & state.armed & state.landed
        self._watch_landing(awake & ~state.landed, contact, climb_m_s)
        if np.count_nonzero(waiting):
            self._watch_takeoff(waiting, climb_m_s)
        standing = awake & state.armed & state.landed
        if np.count_nonzero(standing):
            self._watch_disarming(standing)

    def landed_state(self) -> Numbers:
        """(n,): MAV_LANDED_STATE, as in EXTENDED_SYS_STATE."""
        state = self.state
        landing = (state.mode == LAND) & ~state.blind
        flying = np.where(landing, int(LandedState.LANDING), int(LandedState.IN_AIR))
        flying[state.armed & (state.mode == TAKEOFF)] = LandedState.TAKEOFF
        return np.where(state.landed, int(LandedState.ON_GROUND), flying)

    def _watch_health(self, waiting: Mask) -> None:
        now, before = self.state.unhealthy_sensors, self._unhealthy
        if before is None or np.count_nonzero(now != before):
            self._unhealthy = now.copy()
            for row in (waiting & (now != (0 if before is None else before))).nonzero()[0].tolist():
                self.commanders[row].complain()

    def _watch_setpoints(self, armed: Mask) -> None:
        state = self.state
        is_fed = fed(state, self.parameters, self.quirks)
        due = armed & (state.intended == OFFBOARD) & (is_fed == state.failsafe)
        if not self.quirks.resume:
            due &= ~state.failsafe
        if not self.quirks.setpoint_loss:
            due &= state.failsafe
        for row in due.nonzero()[0].tolist():
            self.commanders[row].starve_or_feed()

    def _watch_station(self, armed: Mask) -> None:
        """Apply NAV_DLL_ACT, once, COM_DL_LOSS_T after the last heartbeat of a ground station."""
        state, p = self.state, self.parameters
        silent = state.now_s - state.station_s > p["COM_DL_LOSS_T"]
        if not np.count_nonzero(silent):
            state.station_lost[:] = False
            return
        due = armed & ~state.landed & silent & ~state.station_lost & (p["NAV_DLL_ACT"] > 0)
        state.station_lost = silent & (state.station_lost | due)
        for row in due.nonzero()[0].tolist():
            self.commanders[row].lose_station()

    def _watch_transponders(self, armed: Mask) -> None:
        """Apply COM_ARM_ODID, once for each loss in the air."""
        state = self.state
        if self.commanders[0].firmware_release < failsafe.TRANSPONDER_ACTS or state.transponder_ok.all():
            state.transponder_lost[:] = False
            return
        acts = np.isin(self.parameters["COM_ARM_ODID"], list(failsafe.TRANSPONDER_ACTIONS))
        lost = armed & acts & ~state.landed & ~state.transponder_ok
        due = lost & ~state.transponder_lost
        state.transponder_lost = lost
        for row in due.nonzero()[0].tolist():
            self.commanders[row].lose_transponder()

    def _watch_takeoff(self, waiting: Mask, climb_m_s: Array) -> None:
        state = self.state
        spooled_s = state.armed_s + self.parameters["COM_SPOOLUP_TIME"]
        climbing = waiting & (climb_m_s >= CLIMB_DEMAND_M_S) & (state.now_s >= spooled_s)
        state.climb_since_s[waiting & ~climbing] = np.inf
        state.climb_since_s[climbing] = np.minimum(state.climb_since_s[climbing], state.now_s)
        for row in np.flatnonzero(
            climbing & (state.now_s >= state.climb_since_s + TAKEOFF_DETECTION_S)
        ).tolist():
            self.commanders[row].lift_off()

    def _watch_landing(self, flying: Mask, contact: Mask, climb_m_s: Array) -> None:
        """On the ground with a descent demanded: landed after a while, at once when the motors are off."""
        state = self.state
        if not np.count_nonzero(contact):
            state.down_since_s[flying] = np.inf
            return
        carried = state.armed & ~state.terminated
        down = flying & contact & ~(carried & (climb_m_s >= 0.0))
        state.down_since_s[flying & ~down] = np.inf
        if not np.count_nonzero(down):
            return
        state.down_since_s[down] = np.minimum(state.down_since_s[down], state.now_s)
        wait_s = np.where(carried, LANDING_STAGES * self.parameters["LNDMC_TRIG_TIME"], 0.0)
        for row in np.flatnonzero(down & (state.now_s >= state.down_since_s + wait_s)).tolist():
            self.commanders[row].touch_down()

    def _watch_disarming(self, standing: Mask) -> None:
        """Apply COM_DISARM_LAND after a flight, COM_DISARM_PRFLT before one; not positive means never."""
        state, p = self.state, self.parameters
        wait_s = np.where(state.flown, p["COM_DISARM_LAND"], p["COM_DISARM_PRFLT"])
        since_s = np.where(state.flown, state.landed_s, state.armed_s)
        still = standing & (state.climb_since_s == np.inf) & (wait_s > 0.0)
        for row in np.flatnonzero(still & (state.now_s >= since_s + wait_s)).tolist():
            landed = state.flown[row]
            self.commanders[row].stop(
                "Disarmed by landing" if landed else "Disarmed by auto preflight disarming"
            )
