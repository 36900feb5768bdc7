"""PX4's commander for one vehicle: its transitions. `sim.vehicle.transitions` decides when they are due.

Two modes are kept apart, as in PX4: the one requested (intended) and the one flown (mode). They differ
during a failsafe. Items in comments are those of FACTS, section 3.
"""

from __future__ import annotations

import math
from enum import Enum, IntEnum
from typing import TYPE_CHECKING

from gcs.sim.vehicle import battery
from gcs.sim.vehicle.modes import (
    MODES,
    NEEDS_PILOT,
    OFFBOARD_LOSS_MODE,
    PREVENTS_ARMING,
    STATION_LOSS_MODE,
    Mode,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from gcs.sim.vehicle.params import Parameters
    from gcs.sim.vehicle.quirks import Quirks
    from gcs.sim.vehicle.state import State

CRITICAL, INFO = 2, 6  # MAV_SEVERITY
IMPATIENT_S = 0.25  # longest time without setpoints in OFFBOARD where the quirk of item 13 is off
OVERRIDE_AUTO, OVERRIDE_OFFBOARD = 1, 2  # bits of COM_RC_OVERRIDE
BATTERY_TEXTS = {
    battery.LOW: "Low battery",
    battery.CRITICAL: "Critical battery",
    battery.EMERGENCY: "Emergency battery level",
}
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


class Stuck(Enum):
    """Answer of a vehicle with a stuck mode to a request for another one."""

    NO = "no"
    SAYS_YES = "accepted"
    SAYS_NO = "rejected"


class Commander:
    """One row of the fleet's state, and the texts that its transitions produce."""

    def __init__(
        self,
        state: State,
        row: int,
        parameters: Parameters,
        quirks: Quirks,
        say: Callable[[int, str], None],
        changed: Callable[[], None],
    ) -> None:
        """Command vehicle `row`; `say` takes a MAV_SEVERITY and a text, `changed` reports mode and arming."""
        self._state = state
        self._row = row
        self._parameters = parameters
        self._quirks = quirks
        self._tell = say
        self._changed = changed
        self.stuck = Stuck.NO

    @property
    def mode(self) -> Mode:
        """The mode that is flown."""
        return MODES[int(self._state.mode[self._row])]

    @property
    def armed(self) -> bool:
        """Whether the motors may turn."""
        return bool(self._state.armed[self._row])

    @property
    def landed(self) -> bool:
        """Whether its own landed state is on the ground."""
        return bool(self._state.landed[self._row])

    @property
    def failsafe(self) -> bool:
        """Whether setpoints were lost."""
        return bool(self._state.failsafe[self._row])

    @property
    def setpoint_seen(self) -> bool:
        """Whether there has ever been a setpoint."""
        return bool(self._state.setpoint_seen[self._row])

    @property
    def airborne_since_s(self) -> float:
        """When it lifted off, on the fleet's clock."""
        return float(self._state.airborne_since_s[self._row])

    @property
    def can_arm(self) -> bool:
        """The prearm check: started up, in a mode that allows arming, with the setpoints that mode needs."""
        intended = MODES[int(self._state.intended[self._row])]
        fed = intended is not Mode.OFFBOARD or not self._quirks.starved_offboard or self.fed
        started = self._state.now_s >= self._state.ready_at_s[self._row]
        sound = self._state.unhealthy_sensors[self._row] == 0
        return bool(started and sound and intended not in PREVENTS_ARMING and fed)

    @property
    def fed(self) -> bool:
        """Whether a setpoint has arrived within COM_OF_LOSS_T (items 5 and 13)."""
        patience_s = self._parameters["COM_OF_LOSS_T"]
        if not self._quirks.patient_offboard:
            patience_s = min(patience_s, IMPATIENT_S)
        return bool(self._state.now_s - self._state.setpoint_s[self._row] < patience_s)

    def arm(self, *, force: bool = False) -> Result:
        """Start the motors, if the checks allow it (item 2, 4, 7) or are overridden."""
        state, row = self._state, self._row
        if state.armed[row]:
            return Result.ACCEPTED
        if not (self.can_arm or force):
            self._say(CRITICAL, "Arming denied: Resolve system health failures first")
            return Result.TEMPORARILY_REJECTED
        state.armed[row], state.armed_s[row] = True, state.now_s
        state.flown[row] = not state.landed[row]
        state.climb_since_s[row] = math.inf
        self._say(INFO, "Armed by external command")
        if self.mode is Mode.TAKEOFF and math.isnan(state.takeoff_altitude_amsl_m[row]):
            self._say(INFO, f"Using default takeoff altitude: {self._parameters['MIS_TAKEOFF_ALT']:.1f} m")
        self._changed()
        return Result.ACCEPTED

    def disarm(self, *, force: bool = False) -> Result:
        """Stop the motors; in the air only when forced, which is the kill switch (item 11)."""
        if not self.armed:
            return Result.ACCEPTED
        if not (self.landed or force) and self._quirks.disarm_refused:
            self._say(CRITICAL, "Disarming denied: not landed")
            return Result.TEMPORARILY_REJECTED
        self.stop("Disarmed by external command")
        return Result.ACCEPTED

    def change_mode(self, mode: Mode) -> Result:
        """Change the mode, as DO_SET_MODE requests; in the air only to modes that can be flown (item 4)."""
        if self.stuck is not Stuck.NO:
            return Result.ACCEPTED if self.stuck is Stuck.SAYS_YES else Result.TEMPORARILY_REJECTED
        starved = mode is Mode.OFFBOARD and self._quirks.starved_offboard and not self.fed
        missing = starved or (mode in NEEDS_PILOT and not self._state.piloted[self._row])
        if self.armed and missing:
            self._say(CRITICAL, f"Switching to {mode.title} is currently not available")
            return Result.TEMPORARILY_REJECTED
        self.intend(mode)
        if mode is Mode.LAND:
            self._say(INFO, "Landing at current position")
        return Result.ACCEPTED

    def take_off(self, altitude_amsl_m: float | None) -> Result:
        """Climb to that altitude, or MIS_TAKEOFF_ALT above ground; at the next arming (item 11)."""
        if not self.armed and not self._quirks.early_takeoff:
            return Result.TEMPORARILY_REJECTED
        self._state.takeoff_altitude_amsl_m[self._row] = (
            math.nan if altitude_amsl_m is None else altitude_amsl_m
        )
        return self.change_mode(Mode.TAKEOFF)

    def overridden(self) -> bool:
        """Whether moving the sticks takes the vehicle over from its present mode (COM_RC_OVERRIDE)."""
        bits = int(self._parameters["COM_RC_OVERRIDE"])
        mode = self.mode
        if mode in NEEDS_PILOT:
            return False
        return bool(bits & (OVERRIDE_OFFBOARD if mode is Mode.OFFBOARD else OVERRIDE_AUTO))

    def starve_or_feed(self) -> None:
        """Failsafe when OFFBOARD loses setpoints (item 5), and back by itself when they return (item 6)."""
        state, row = self._state, self._row
        if state.failsafe[row]:
            state.failsafe[row], state.mode[row] = False, Mode.OFFBOARD.number
            self._changed()
            return
        state.failsafe[row] = True
        self._say(CRITICAL, "Failsafe activated")
        action = int(self._parameters["COM_OBL_RC_ACT"])
        if action in OFFBOARD_LOSS_MODE:
            state.mode[row] = OFFBOARD_LOSS_MODE[action].number
            self._changed()
        else:
            self.stop("Disarmed by failsafe")

    def lose_station(self) -> None:
        """Apply NAV_DLL_ACT; it never ends a landing, nor a return in favour of a hold."""
        mode = STATION_LOSS_MODE.get(int(self._parameters["NAV_DLL_ACT"]))
        if self.mode is Mode.LAND or (self.mode is Mode.RETURN and mode is Mode.HOLD):
            return
        self._say(INFO, "GCS connection lost")
        self._say(CRITICAL, "Failsafe activated")
        if mode is None:
            self.stop("Disarmed by failsafe")
        else:
            self._intervene(mode)

    def weaken(self, charge: int) -> None:
        """Apply COM_LOW_BAT_ACT at each worsening: 2 lands at critical; 3 returns, at emergency lands."""
        self._state.charge[self._row] = charge
        self._say(CRITICAL, BATTERY_TEXTS[charge])
        action = int(self._parameters["COM_LOW_BAT_ACT"])
        mode = BATTERY_ACTIONS.get((action, charge))
        if mode is not None and self.mode is not Mode.LAND:
            self._say(CRITICAL, "Failsafe activated")
            self._intervene(mode)

    def lift_off(self) -> None:
        """Take-off detected."""
        state, row = self._state, self._row
        state.landed[row], state.flown[row] = False, True
        state.airborne_since_s[row] = state.now_s
        state.down_since_s[row] = math.inf
        self._say(INFO, "Takeoff detected")

    def touch_down(self) -> None:
        """Landing detected."""
        state, row = self._state, self._row
        state.landed[row], state.landed_s[row] = True, state.now_s
        if state.armed[row]:
            self._say(INFO, "Landing detected")

    def stop(self, text: str) -> None:
        """Disarm; the mode falls back to the last one that allows arming (item 7)."""
        state, row = self._state, self._row
        state.armed[row] = state.failsafe[row] = state.intervenes[row] = False
        state.climb_since_s[row] = math.inf
        self._say(INFO, text)
        reverts = self._quirks.mode_reverts
        state.intended[row] = state.mode[row] = state.after_disarming[row] if reverts else Mode.HOLD.number
        self._changed()

    def intend(self, mode: Mode) -> None:
        """Fly that mode from now on, whatever requested it."""
        state, row = self._state, self._row
        state.failsafe[row] = state.intervenes[row] = False
        state.intended[row] = state.mode[row] = mode.number
        if mode not in PREVENTS_ARMING:
            state.after_disarming[row] = mode.number
        self._changed()

    def _intervene(self, mode: Mode) -> None:
        """Fly that mode by the autopilot's own failsafe; the heartbeat shows it until the next request."""
        self.intend(mode)
        self._state.intervenes[self._row] = True

    def _say(self, severity: int, text: str) -> None:
        self._tell(severity, text + "\t")  # PX4 ends its texts with a tab
