"""PX4's commander: the transitions of one vehicle, and whether it can arm. When they are due: `transitions`.

Two modes are kept apart, as in PX4: the one requested (intended) and the one flown (mode). They differ
during a failsafe. Items in comments are those of FACTS, section 3.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from gcs.sim.vehicle import failsafe, px4
from gcs.sim.vehicle.dynamics import Mask
from gcs.sim.vehicle.parameters import Columns
from gcs.sim.vehicle.px4 import Mode, Parameters, Quirks
from gcs.sim.vehicle.state import State, Stuck

CRITICAL, INFO = 2, 6  # MAV_SEVERITY
ODID_REQUIRED = 2  # COM_ARM_ODID: no arming without a transponder that is ready
IMPATIENT_S = 0.25  # longest time without setpoints in OFFBOARD where the quirk of item 13 is off
OVERRIDE_AUTO, OVERRIDE_OFFBOARD = 1, 2  # bits of COM_RC_OVERRIDE


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
HOLD = Mode.HOLD.number
BY_HAND = np.array([mode in px4.NEEDS_PILOT for mode in px4.MODES])
COMPLAINTS = {
    0x1: "No valid data from Gyro 0",
    0x2: "No valid data from Accel 0",
    0x4: "Compass 0 fault",
    0x8: "No valid data from Baro 0",
    0x20: "GPS fix too low",
    0x200000: "ekf2 missing data",
}
"""By bit of MAV_SYS_STATUS_SENSOR, from PX4's sources."""
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
    able &= (state.unhealthy_sensors == 0) & ~state.position_lost & ~state.terminated & ~state.fence_breached
    able &= (parameters["COM_ARM_ODID"] < ODID_REQUIRED) | state.transponder_ok
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
    firmware_release: tuple[int, int]
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
            self.complain()
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

    def complain(self) -> None:
        """Send what fails its checks before arming: when that changes, and when arming is refused."""
        unhealthy = int(self.state.unhealthy_sensors[self.row])
        if self.parameters["COM_ARM_ODID"] and not self.state.transponder_ok[self.row]:
            self._report(CRITICAL, "Preflight Fail: Open Drone ID system not ready")
        for bit, text in COMPLAINTS.items():
            if unhealthy & bit:
                self._report(CRITICAL, f"Preflight Fail: {text}")

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
        lost = bool(self.state.position_lost[self.row])
        missing |= lost and mode in px4.NEEDS_POSITION
        if self.armed and missing:
            self._report(CRITICAL, f"Switching to {mode.name.capitalize()} is currently not available")
            return Result.TEMPORARILY_REJECTED
        self.intend(mode)
        if mode is Mode.LAND:
            self.state.blind[self.row] = lost
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
        self._report(CRITICAL, failsafe.ACTIVATED)
        action = failsafe.setpoint_loss_action(
            self.firmware_release, int(self.parameters["COM_OBL_RC_ACT"]), int(self.parameters["NAV_RCL_ACT"])
        )
        if action < 0:
            self._stop_by_failsafe(action)
        else:
            state.mode[row] = action
            self.changed()

    def lose_station(self) -> None:
        """Apply NAV_DLL_ACT; it never ends a landing, nor a return in favour of a hold."""
        action = failsafe.LOSS_ACTIONS.get(int(self.parameters["NAV_DLL_ACT"]))
        if action is None or self.mode is Mode.LAND or (self.mode is Mode.RETURN and action == HOLD):
            return
        self._report(INFO, "Connection to ground station lost")
        self._act_after_hold(action)

    def weaken(self, charge: int) -> None:
        """Apply COM_LOW_BAT_ACT at each worsening; what has no action is a warning."""
        self.state.charge[self.row] = charge
        self._report(CRITICAL, failsafe.BATTERY_TEXTS[charge])
        action = failsafe.BATTERY_ACTIONS.get((int(self.parameters["COM_LOW_BAT_ACT"]), charge))
        if action is not None and self.mode is not Mode.LAND:
            self._act_after_hold(action)
        elif action is None and self.firmware_release < failsafe.NO_TEXT_FOR_WARNINGS:
            self._report(CRITICAL, failsafe.ACTIVATED)

    def leave_fence(self) -> None:
        """Apply GF_ACTION: its text in any case, the rest in flight."""
        self._report(CRITICAL, failsafe.fence_text(self.firmware_release))
        if self.landed or not self.armed or self.mode is Mode.LAND:
            return
        action = failsafe.FENCE_ACTIONS.get(int(self.parameters["GF_ACTION"]))
        if action is None:
            if self.firmware_release < failsafe.NO_TEXT_FOR_WARNINGS:
                self._report(CRITICAL, failsafe.ACTIVATED)
        elif action == HOLD:
            self._report(CRITICAL, failsafe.ACTIVATED)
            self._intervene(Mode.HOLD)
        elif action < 0:
            self._stop_by_failsafe(action)
        else:
            self._act_after_hold(action)

    def lose_transponder(self) -> None:
        """Apply COM_ARM_ODID in flight; it never ends a landing."""
        action = failsafe.TRANSPONDER_ACTIONS[int(self.parameters["COM_ARM_ODID"])]
        self._report(CRITICAL, "Open Drone ID system not ready")
        if action < 0:
            self._stop_by_failsafe(action)
        elif self.mode is not Mode.LAND:
            self._act_after_hold(action)

    def lose_position(self) -> None:
        """Descend without a position, at once: PX4's DESCEND, which HEARTBEAT shows as LAND."""
        self._report(CRITICAL, failsafe.ACTIVATED)
        self._intervene(Mode.LAND)
        self.state.blind[self.row] = True

    def terminate(self) -> bool:
        """Flight termination: the motors stop until the next boot. Returns: whether it was armed."""
        state, row = self.state, self.row
        if not state.armed[row]:
            return False
        self._report(CRITICAL, failsafe.ACTIVATED)
        self.intend(Mode.TERMINATION)
        state.terminated[row] = True
        return True

    def doubt_compass(self) -> bool:
        """The text of a compass that disagrees with the estimator in flight. Returns: True."""
        self._report(CRITICAL, "Compass needs calibration - Land now!")
        return True

    def act(self) -> None:
        """Execute the action of a failsafe whose HOLD is over."""
        state, row = self.state, self.row
        action = int(state.action[row])
        state.acts_at_s[row] = math.inf
        if action == HOLD:
            return
        self._report(CRITICAL, failsafe.ACTIVATED)
        if action < 0:
            self._stop_by_failsafe(action)
        else:
            self._intervene(px4.MODES[action])

    def _act_after_hold(self, action: int) -> None:
        """HOLD for COM_FAIL_ACT_T, in which a pilot may take over; at once within another failsafe."""
        state, row = self.state, self.row
        hold_s = float(self.parameters["COM_FAIL_ACT_T"])
        state.action[row] = action
        if state.acts_at_s[row] < math.inf:
            return
        if hold_s <= 0.0 or state.intervenes[row] or not self.quirks.failsafe_hold:
            self.act()
            return
        self._report(CRITICAL, failsafe.hold_text(self.firmware_release, hold_s))
        self._intervene(Mode.HOLD)
        state.acts_at_s[row] = state.now_s + hold_s

    def _stop_by_failsafe(self, action: int) -> None:
        if action == failsafe.TERMINATE:
            self.terminate()
        else:
            self.stop("Disarmed by failsafe")

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
        state.armed[row] = state.failsafe[row] = state.intervenes[row] = state.blind[row] = False
        state.climb_since_s[row] = state.acts_at_s[row] = math.inf
        self._report(INFO, text)
        if state.terminated[row]:
            return
        reverts = self.quirks.mode_reverts
        state.intended[row] = state.mode[row] = state.after_disarming[row] if reverts else Mode.HOLD.number
        self.changed()

    def intend(self, mode: Mode) -> None:
        """Fly that mode from now on, whatever requested it."""
        state, row = self.state, self.row
        if state.terminated[row]:
            return
        state.failsafe[row] = state.intervenes[row] = state.blind[row] = False
        state.acts_at_s[row] = math.inf
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
