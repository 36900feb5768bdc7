"""PX4's commander for one vehicle: arming, modes, setpoint loss, landing and disarming. Sans-I/O.

Two modes are kept apart, as in PX4: the one asked for (intended) and the one flown (mode). They differ
during a failsafe. Items in comments are those of FACTS, section 3.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import TYPE_CHECKING

from sim import battery
from sim.modes import NEEDS_PILOT, OFFBOARD_LOSS_MODE, PREVENTS_ARMING, Mode

if TYPE_CHECKING:
    from sim.params import Parameters
    from sim.sensed import Sensed

CRITICAL, INFO = 2, 6  # MAV_SEVERITY
# From spool-up to "Takeoff detected": recorded 1.84 s after arming, of which COM_SPOOLUP_TIME is 1.0.
TAKEOFF_DETECTION_S = 0.84
# PX4 passes through three stages, each LNDMC_TRIG_TIME long at least: recorded 3.3 s after touching.
LANDING_STAGES = 3
CLIMB_DEMAND_M_S = 0.3
BATTERY_TEXTS = {battery.LOW: "Low", battery.CRITICAL: "Critical", battery.EMERGENCY: "Dangerously low"}
BATTERY_ACTIONS = {
    (2, battery.CRITICAL): Mode.LAND,
    (2, battery.EMERGENCY): Mode.LAND,
    (3, battery.CRITICAL): Mode.RETURN,
    (3, battery.EMERGENCY): Mode.LAND,
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


class Commander:
    """The state, its transitions, and the texts they produce (drained by take_texts)."""

    def __init__(self, parameters: Parameters, *, ready_at_s: float) -> None:
        """Start on the ground, disarmed, in HOLD; ready to arm at ready_at_s on the caller's clock."""
        self._parameters = parameters
        self._ready_at_s = ready_at_s
        self.mode = Mode.HOLD
        self.armed = False
        self.landed = True
        self.failsafe = False
        self.setpoint_seen = False
        self.takeoff_altitude_amsl_m: float | None = None
        self.airborne_since_s = -math.inf
        self._intended = Mode.HOLD
        self._after_disarming = Mode.HOLD
        self._now_s = -math.inf
        self._setpoint_s = -math.inf
        self._armed_s = -math.inf
        self._climb_since_s = math.inf
        self._down_since_s = math.inf
        self._landed_s = -math.inf
        self._flown = False
        self._charge = battery.OK
        self._texts: list[tuple[int, str]] = []

    @property
    def landed_state(self) -> LandedState:
        """What EXTENDED_SYS_STATE says."""
        if self.landed:
            return LandedState.ON_GROUND
        if self.armed and self.mode is Mode.TAKEOFF:
            return LandedState.TAKEOFF
        return LandedState.LANDING if self.mode is Mode.LAND else LandedState.IN_AIR

    @property
    def powered(self) -> bool:
        """Whether the motors carry the vehicle."""
        return self.armed and not self.landed

    @property
    def can_arm(self) -> bool:
        """The prearm check: started up, and a mode that may be armed and has what it needs."""
        fed = self._intended is not Mode.OFFBOARD or self._fed()
        return self._now_s >= self._ready_at_s and self._intended not in PREVENTS_ARMING and fed

    def take_texts(self) -> list[tuple[int, str]]:
        """The texts since the last call, with their MAV_SEVERITY."""
        texts, self._texts = self._texts, []
        return texts

    def arm(self, now_s: float, *, force: bool = False) -> Result:
        """Start the motors, if the checks allow it (item 2, 4, 7) or are overridden."""
        self._now_s = now_s
        if self.armed:
            return Result.ACCEPTED
        if not (self.can_arm or force):
            self._say(CRITICAL, "Arming denied: Resolve system health failures first")
            return Result.TEMPORARILY_REJECTED
        self.armed, self._armed_s = True, now_s
        self._flown = not self.landed
        self._climb_since_s = math.inf
        self._say(INFO, "Armed by external command")
        if self.mode is Mode.TAKEOFF and self.takeoff_altitude_amsl_m is None:
            self._say(INFO, f"Using default takeoff altitude: {self._parameters['MIS_TAKEOFF_ALT']:.1f} m")
        return Result.ACCEPTED

    def disarm(self, *, force: bool = False) -> Result:
        """Stop the motors; in the air only when forced, which is the kill switch (item 11)."""
        if not self.armed:
            return Result.ACCEPTED
        if not (self.landed or force):
            self._say(CRITICAL, "Disarming denied: not landed")
            return Result.TEMPORARILY_REJECTED
        self._stop("Disarmed by external command")
        return Result.ACCEPTED

    def change_mode(self, mode: Mode, now_s: float) -> Result:
        """What DO_SET_MODE and its like ask for; in the air only what can be flown (item 4)."""
        self._now_s = now_s
        missing = (mode is Mode.OFFBOARD and not self._fed()) or mode in NEEDS_PILOT
        if self.armed and missing:
            self._say(CRITICAL, f"Switching to {mode.title} is currently not available")
            return Result.TEMPORARILY_REJECTED
        self._intend(mode)
        if mode is Mode.LAND:
            self._say(INFO, "Landing at current position")
        return Result.ACCEPTED

    def take_off(self, altitude_amsl_m: float | None, now_s: float) -> Result:
        """Climb to that altitude, or MIS_TAKEOFF_ALT above ground; at the next arming (item 11)."""
        self.takeoff_altitude_amsl_m = altitude_amsl_m
        return self.change_mode(Mode.TAKEOFF, now_s)

    def took_off(self) -> None:
        """The takeoff altitude is reached: hold there."""
        self._intend(Mode.HOLD)

    def hear_setpoint(self, now_s: float) -> None:
        """A setpoint that commands something has arrived."""
        self._setpoint_s = now_s
        self.setpoint_seen = True

    def update(self, now_s: float, sensed: Sensed, *, climb_m_s: float, charge: int) -> None:
        """Let time pass.

        Args:
            now_s: the time it is now.
            sensed: the estimate.
            climb_m_s: the upward speed that the flown mode demands.
            charge: the battery's MAV_BATTERY_CHARGE_STATE.
        """
        self._now_s = now_s
        if self.armed:
            self._watch_setpoints()
        if self.powered:
            self._watch_battery(charge)
        if not self.landed:
            self._watch_landing(sensed, climb_m_s)
        elif self.armed:
            self._watch_takeoff(climb_m_s)
        if self.armed and self.landed:
            self._watch_disarming()

    def _watch_setpoints(self) -> None:
        """Failsafe when OFFBOARD starves (item 5), and back by itself when it is fed again (item 6)."""
        if self._intended is not Mode.OFFBOARD or self._fed() != self.failsafe:
            return
        if self.failsafe:
            self.failsafe, self.mode = False, Mode.OFFBOARD
            return
        self.failsafe = True
        self._say(CRITICAL, "Failsafe activated")
        action = int(self._parameters["COM_OBL_RC_ACT"])
        if action in OFFBOARD_LOSS_MODE:
            self.mode = OFFBOARD_LOSS_MODE[action]
        else:
            self._stop("Disarmed by failsafe")

    def _watch_battery(self, charge: int) -> None:
        """COM_LOW_BAT_ACT, once per worsening: 2 lands at critical; 3 returns then, lands at emergency."""
        if charge <= self._charge:
            return
        self._charge = charge
        self._say(CRITICAL, f"{BATTERY_TEXTS[charge]} battery level")
        action = int(self._parameters["COM_LOW_BAT_ACT"])
        mode = BATTERY_ACTIONS.get((action, charge))
        if mode is not None and self.mode is not Mode.LAND:
            self._say(CRITICAL, "Failsafe activated")
            self._intend(mode)

    def _watch_takeoff(self, climb_m_s: float) -> None:
        spooled_s = self._armed_s + self._parameters["COM_SPOOLUP_TIME"]
        if climb_m_s < CLIMB_DEMAND_M_S or self._now_s < spooled_s:
            self._climb_since_s = math.inf
            return
        self._climb_since_s = min(self._climb_since_s, self._now_s)
        if self._now_s >= self._climb_since_s + TAKEOFF_DETECTION_S:
            self.landed, self._flown = False, True
            self.airborne_since_s = self._now_s
            self._down_since_s = math.inf
            self._say(INFO, "Takeoff detected")

    def _watch_landing(self, sensed: Sensed, climb_m_s: float) -> None:
        """On the ground and told to sink: landed after a while; at once when the motors stand still."""
        if not sensed.contact or (self.armed and climb_m_s >= 0.0):
            self._down_since_s = math.inf
            return
        self._down_since_s = min(self._down_since_s, self._now_s)
        wait_s = LANDING_STAGES * self._parameters["LNDMC_TRIG_TIME"] if self.armed else 0.0
        if self._now_s >= self._down_since_s + wait_s:
            self.landed, self._landed_s = True, self._now_s
            if self.armed:
                self._say(INFO, "Landing detected")

    def _watch_disarming(self) -> None:
        """COM_DISARM_LAND after a flight, COM_DISARM_PRFLT before one; not positive means never."""
        name, since_s, text = (
            ("COM_DISARM_LAND", self._landed_s, "Disarmed by landing")
            if self._flown
            else ("COM_DISARM_PRFLT", self._armed_s, "Disarmed by auto preflight disarming")
        )
        wait_s = self._parameters[name]
        if wait_s > 0.0 and self._climb_since_s == math.inf and self._now_s >= since_s + wait_s:
            self._stop(text)

    def _stop(self, text: str) -> None:
        """Disarm; the mode falls back to the last one that may be armed in (item 7)."""
        self.armed = self.failsafe = False
        self._climb_since_s = math.inf
        self._say(INFO, text)
        self._intended = self.mode = self._after_disarming

    def _intend(self, mode: Mode) -> None:
        self.failsafe = False
        self._intended = self.mode = mode
        if mode not in PREVENTS_ARMING:
            self._after_disarming = mode

    def _fed(self) -> bool:
        """Whether a setpoint has come within COM_OF_LOSS_T."""
        return self._now_s - self._setpoint_s < self._parameters["COM_OF_LOSS_T"]

    def _say(self, severity: int, text: str) -> None:
        self._texts.append((severity, text + "\t"))  # PX4 ends its texts so
