"""PX4's commander: the transitions of one vehicle, and for a whole fleet when they are due.

Two modes are kept apart, as in PX4: the one requested (intended) and the one flown (mode). They differ
during a failsafe. Items in comments are those of FACTS, section 3.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from gcs.sim.vehicle import px4
from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.parameters import Columns
from gcs.sim.vehicle.px4 import Mode, Parameters, Quirks
from gcs.sim.vehicle.sensors import Batteries
from gcs.sim.vehicle.state import Charge, Numbers, State, Stuck

CRITICAL, INFO = 2, 6  # MAV_SEVERITY
IMPATIENT_S = 0.25  # longest time without setpoints in OFFBOARD where the quirk of item 13 is off
OVERRIDE_AUTO, OVERRIDE_OFFBOARD = 1, 2  # bits of COM_RC_OVERRIDE
BATTERY_TEXTS: Mapping[int, str] = {
    Charge.LOW: "Low battery",
    Charge.CRITICAL: "Critical battery",
    Charge.EMERGENCY: "Emergency battery level",
}
BATTERY_ACTIONS: Mapping[tuple[int, int], Mode] = {
    (2, Charge.CRITICAL): Mode.LAND,
    (2, Charge.EMERGENCY): Mode.LAND,
    (3, Charge.CRITICAL): Mode.RETURN,
    (3, Charge.EMERGENCY): Mode.LAND,
}


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


OFFBOARD, TAKEOFF, LAND = Mode.OFFBOARD.number, Mode.TAKEOFF.number, Mode.LAND.number
NOT_ARMABLE = np.array([mode in px4.PREVENTS_ARMING for mode in px4.MODES])


def fed(state: State, parameters: Parameters | Columns, quirks: Quirks) -> Mask:
    """(n,): whether a setpoint has arrived within COM_OF_LOSS_T (items 5 and 13)."""
    patience_s = parameters["COM_OF_LOSS_T"]
    if not quirks.patient_offboard:
        patience_s = np.minimum(patience_s, IMPATIENT_S)
    fed: Mask = state.now_s - state.setpoint_s < patience_s
    return fed


def can_arm(state: State, parameters: Parameters | Columns, quirks: Quirks) -> Mask:
    """(n,): the prearm check: started up, in a mode that allows arming, with the setpoints that it needs."""
    able: Mask = (state.now_s >= state.ready_at_s) & ~NOT_ARMABLE[state.intended]
    able &= state.unhealthy_sensors == 0
    if quirks.starved_offboard:
        able &= (state.intended != OFFBOARD) | fed(state, parameters, quirks)
    return able


@dataclass(eq=False)
class Commander:
    """One row of the fleet's state, and the texts that its transitions produce."""

    state: State
    row: int
    parameters: Parameters
    quirks: Quirks
    send_text: Callable[[int, str], None]  # takes a MAV_SEVERITY and a text
    changed: Callable[[], None]  # reports mode and arming
    stuck: Stuck = Stuck.NO

    @property
    def mode(self) -> Mode:
        return px4.MODES[int(self.state.mode[self.row])]

    @property
    def armed(self) -> bool:
        return bool(self.state.armed[self.row])

    @property
    def landed(self) -> bool:
        return bool(self.state.landed[self.row])

    def arm(self, *, force: bool = False) -> Result:
        """Start the motors, if the checks allow it (item 2, 4, 7) or are overridden."""
        state, row = self.state, self.row
        if state.armed[row]:
            return Result.ACCEPTED
        if not (force or can_arm(state, self.parameters, self.quirks)[row]):
            self._report(CRITICAL, "Arming denied: Resolve system health failures first")
            return Result.TEMPORARILY_REJECTED
        state.armed[row], state.armed_s[row] = True, state.now_s
        state.flown[row] = not state.landed[row]
        state.climb_since_s[row] = math.inf
        self._report(INFO, "Armed by external command")
        if self.mode is Mode.TAKEOFF and math.isnan(state.takeoff_altitude_amsl_m[row]):
            self._report(INFO, f"Using default takeoff altitude: {self.parameters['MIS_TAKEOFF_ALT']:.1f} m")
        self.changed()
        return Result.ACCEPTED

    def disarm(self, *, force: bool = False) -> Result:
        """Stop the motors; in the air only when forced, which is the kill switch (item 11)."""
        if not self.armed:
            return Result.ACCEPTED
        if not (self.landed or force) and self.quirks.disarm_refused:
            self._report(CRITICAL, "Disarming denied: not landed")
            return Result.TEMPORARILY_REJECTED
        self.stop("Disarmed by external command")
        return Result.ACCEPTED

    def change_mode(self, mode: Mode) -> Result:
        """Change the mode, as DO_SET_MODE requests; in the air only to modes that can be flown (item 4)."""
        if self.stuck is not Stuck.NO:
            return Result.ACCEPTED if self.stuck is Stuck.SAYS_YES else Result.TEMPORARILY_REJECTED
        is_fed = bool(fed(self.state, self.parameters, self.quirks)[self.row])
        starved = mode is Mode.OFFBOARD and self.quirks.starved_offboard and not is_fed
        missing = starved or (mode in px4.NEEDS_PILOT and not self.state.piloted[self.row])
        if self.armed and missing:
            self._report(CRITICAL, f"Switching to {mode.name.capitalize()} is currently not available")
            return Result.TEMPORARILY_REJECTED
        self.intend(mode)
        if mode is Mode.LAND:
            self._report(INFO, "Landing at current position")
        return Result.ACCEPTED

    def take_off(self, altitude_amsl_m: float | None) -> Result:
        """Climb to that altitude, or MIS_TAKEOFF_ALT above ground; at the next arming (item 11)."""
        if not self.armed and not self.quirks.early_takeoff:
            return Result.TEMPORARILY_REJECTED
        self.state.takeoff_altitude_amsl_m[self.row] = (
            math.nan if altitude_amsl_m is None else altitude_amsl_m
        )
        return self.change_mode(Mode.TAKEOFF)

    def overridden(self) -> bool:
        """Whether moving the sticks takes the vehicle over from its present mode (COM_RC_OVERRIDE)."""
        bits = int(self.parameters["COM_RC_OVERRIDE"])
        mode = self.mode
        if mode in px4.NEEDS_PILOT:
            return False
        return bool(bits & (OVERRIDE_OFFBOARD if mode is Mode.OFFBOARD else OVERRIDE_AUTO))

    def take_over(self, mode: str, *, by_sticks: bool) -> bool:
        """Let a pilot fly it; False where COM_RC_OVERRIDE keeps the sticks from it."""
        if by_sticks and not self.overridden():
            return False
        self.intend(Mode[mode])
        return True

    def release(self) -> None:
        """Let it hold where it was flown by hand."""
        if self.state.piloted[self.row] and self.mode in px4.NEEDS_PILOT:
            self.intend(Mode.HOLD)

    def starve_or_feed(self) -> None:
        """Failsafe when OFFBOARD loses setpoints (item 5), and back by itself when they return (item 6)."""
        state, row = self.state, self.row
        if state.failsafe[row]:
            state.failsafe[row], state.mode[row] = False, Mode.OFFBOARD.number
            self.changed()
            return
        state.failsafe[row] = True
        self._report(CRITICAL, "Failsafe activated")
        action = int(self.parameters["COM_OBL_RC_ACT"])
        if action in px4.OFFBOARD_LOSS_MODE:
            state.mode[row] = px4.OFFBOARD_LOSS_MODE[action].number
            self.changed()
        else:
            self.stop("Disarmed by failsafe")

    def lose_station(self) -> None:
        """Apply NAV_DLL_ACT; it never ends a landing, nor a return in favour of a hold."""
        mode = px4.STATION_LOSS_MODE.get(int(self.parameters["NAV_DLL_ACT"]))
        if self.mode is Mode.LAND or (self.mode is Mode.RETURN and mode is Mode.HOLD):
            return
        self._report(INFO, "GCS connection lost")
        self._report(CRITICAL, "Failsafe activated")
        if mode is None:
            self.stop("Disarmed by failsafe")
        else:
            self._intervene(mode)

    def weaken(self, charge: int) -> None:
        """Apply COM_LOW_BAT_ACT at each worsening: 2 lands at critical; 3 returns, at emergency lands."""
        self.state.charge[self.row] = charge
        self._report(CRITICAL, BATTERY_TEXTS[charge])
        action = int(self.parameters["COM_LOW_BAT_ACT"])
        mode = BATTERY_ACTIONS.get((action, charge))
        if mode is not None and self.mode is not Mode.LAND:
            self._report(CRITICAL, "Failsafe activated")
            self._intervene(mode)

    def lift_off(self) -> None:
        state, row = self.state, self.row
        state.landed[row], state.flown[row] = False, True
        state.airborne_since_s[row] = state.now_s
        state.down_since_s[row] = math.inf
        self._report(INFO, "Takeoff detected")

    def touch_down(self) -> None:
        state, row = self.state, self.row
        state.landed[row], state.landed_s[row] = True, state.now_s
        if state.armed[row]:
            self._report(INFO, "Landing detected")

    def stop(self, text: str) -> None:
        """Disarm; the mode falls back to the last one that allows arming (item 7)."""
        state, row = self.state, self.row
        state.armed[row] = state.failsafe[row] = state.intervenes[row] = False
        state.climb_since_s[row] = math.inf
        self._report(INFO, text)
        reverts = self.quirks.mode_reverts
        state.intended[row] = state.mode[row] = state.after_disarming[row] if reverts else Mode.HOLD.number
        self.changed()

    def intend(self, mode: Mode) -> None:
        """Fly that mode from now on, whatever requested it."""
        state, row = self.state, self.row
        state.failsafe[row] = state.intervenes[row] = False
        state.intended[row] = state.mode[row] = mode.number
        if mode not in px4.PREVENTS_ARMING:
            state.after_disarming[row] = mode.number
        self.changed()

    def _intervene(self, mode: Mode) -> None:
        """Fly that mode by the autopilot's own failsafe; the heartbeat shows it until the next request."""
        self.intend(mode)
        self.state.intervenes[self.row] = True

    def _report(self, severity: int, text: str) -> None:
        self.send_text(severity, text + "\t")  # PX4 ends its texts with a tab


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
        if armed.any():
            self._watch_setpoints(armed)
            self._watch_station(armed)
            charge = batteries.charge_state()
            weak = armed & ~state.landed & (charge > state.charge)
            for row in weak.nonzero()[0].tolist():
                self.commanders[row].weaken(int(charge[row]))
        waiting = awake & state.armed & state.landed
        self._watch_landing(awake & ~state.landed, contact, climb_m_s)
        if waiting.any():
            self._watch_takeoff(waiting, climb_m_s)
        standing = awake & state.armed & state.landed
        if standing.any():
            self._watch_disarming(standing)

    def landed_state(self) -> Numbers:
        """(n,): MAV_LANDED_STATE, as in EXTENDED_SYS_STATE."""
        state = self.state
        flying = np.where(state.mode == LAND, int(LandedState.LANDING), int(LandedState.IN_AIR))
        flying[state.armed & (state.mode == TAKEOFF)] = LandedState.TAKEOFF
        return np.where(state.landed, int(LandedState.ON_GROUND), flying)

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
        if not silent.any():
            state.station_lost[:] = False
            return
        due = armed & ~state.landed & silent & ~state.station_lost & (p["NAV_DLL_ACT"] > 0)
        state.station_lost = silent & (state.station_lost | due)
        for row in due.nonzero()[0].tolist():
            self.commanders[row].lose_station()

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
        if not contact.any():
            state.down_since_s[flying] = np.inf
            return
        down = flying & contact & ~(state.armed & (climb_m_s >= 0.0))
        state.down_since_s[flying & ~down] = np.inf
        if not down.any():
            return
        state.down_since_s[down] = np.minimum(state.down_since_s[down], state.now_s)
        wait_s = np.where(state.armed, LANDING_STAGES * self.parameters["LNDMC_TRIG_TIME"], 0.0)
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
